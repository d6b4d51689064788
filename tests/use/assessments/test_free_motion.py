"""A motor whose drive gives no torque: every ratio asks for the rotor's torque alone, the least for that of 0."""

import pinarm


def test_a_drive_that_moves_freely_is_sized_for_its_rotor(tmp_path):
    (tmp_path / "lever.yaml").write_text(
        "pinarm: 1\nplanar:\n  points: {O: [0, 0], A: [0.5 m, 0]}\n  ground: [O]\n"
        "  links: {arm: {points: [O, A], mass: 2 kg}}\ndrives: {motor: {joint: O}}\n"
    )
    (tmp_path / "motors.csv").write_text(
        "name,mass [kg],stall_torque [N*m],rated_torque [N*m],rated_speed [rpm],peak_torque [N*m],max_speed [rpm],"
        "rotor_inertia [kg*m^2],temperature_rise,max_temperature,time_constant [s]\n"
        "S20,0.11,0.055,0.048,6000,0.17,9000,2.1e-6,95,155,180\n"
    )
    (tmp_path / "falls.yaml").write_text(
        "pinarm: 1\nmechanism: lever.yaml\nproblem: {kind: forward, time: {end: 0.5 s, samples: 11}}\n"
        "outputs: [O]\nsizing: {drive: motor, catalogue: motors.csv, ratios: [30]}\n"
    )
    assert pinarm.run(tmp_path / "falls.yaml").number("sizing.rms_torque")[0] > 0.0
