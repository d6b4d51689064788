"""DC motors against their closed forms: stall, no load, two eigenvalues, and the rotor behind a gear."""

import numpy as np
import pytest
from scipy.linalg import expm

import pinarm
from pinarm.errors import InputError

URDF = """<robot name="inertia"><link name="base"/><link name="rotor"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/></joint></robot>"""

R, K, N, ROTOR, LOAD = 0.5, 0.04, 10.0, 1e-4, 0.02
MOTOR = {"kind": "dc", "resistance": f"{R} ohm", "constant": f"{K} N*m/A"}
INERTIA = LOAD + N * N * ROTOR
"""At the joint."""

OPEN_LOOP = {"kind": "state_feedback", "drive": "servo", "states": ["x"], "gains": [["0 V/rad", "0 V*s/rad"]],
             "bias": ["12 V"]}  # fmt: skip
"""A voltage of 12 V whatever happens."""


@pytest.fixture
def servo(tmp_path):
    """Make the mechanism with a motor."""
    (tmp_path / "inertia.urdf").write_text(URDF)

    def made(**motor):
        drive = {"joint": "x", "ratio": N, "rotor_inertia": f"{ROTOR} kg*m^2", "motor": {**MOTOR, **motor}}
        return pinarm.Mechanism.load(tmp_path / "inertia.urdf", values={"drives": {"servo": drive}})

    return made


def run(mechanism, control, end="0.4 s", outputs=("x",), **problem):
    return pinarm.run({"pinarm": 1, "mechanism": mechanism, "outputs": list(outputs), "problem": {
        "kind": "forward", "time": {"end": end, "samples": 41}, "control": [control], **problem,
    }})  # fmt: skip


def step(inductance, t):
    """Angle, speed and current under 12 V from rest: ``J w' = N k i``, ``L i' = V - R i - k N w``."""
    a = np.array([[0, 1, 0, 0], [0, 0, N * K / INERTIA, 0], [0, -K * N / inductance, -R / inductance, 12 / inductance],
                  [0, 0, 0, 0]])  # fmt: skip
    return np.array([(expm(a * instant) @ [0.0, 0.0, 0.0, 1.0])[:3] for instant in t])


@pytest.mark.parametrize("period", [{}, {"period": "10 ms"}])
def test_a_voltage_step_has_two_eigenvalues(servo, period):
    result = run(servo(inductance="5 mH"), {**OPEN_LOOP, **period})
    exact = step(5e-3, result["t"].values)
    assert np.abs(result["x"].values - exact[:, 0]).max() < 1e-8
    assert np.abs(result["joint.x.velocity"].values - exact[:, 1]).max() < 1e-6
    assert np.abs(result["control.servo.current"].values - exact[:, 2]).max() < 1e-6
    assert np.abs(result["joint.x.effort"].values - N * K * exact[:, 2]).max() < 1e-6
    assert (result["control.servo.voltage"].values == 12.0).all()
    assert result.figures["energy"] < 1e-7


def test_without_inductance_the_speed_rises_with_the_mechanical_time_constant(servo):
    result = run(servo(), OPEN_LOOP, "1 s")
    tau = R * INERTIA / (K * N) ** 2
    speed = 12.0 / (K * N) * (1.0 - np.exp(-result["t"].values / tau))
    assert np.abs(result["joint.x.velocity"].values - speed).max() < 1e-7
    assert result["drive.servo.speed"].values[-1] == pytest.approx(12.0 / K, rel=1e-3)  # no-load speed
    start = result["control.servo.effort"].values[0]
    assert start == pytest.approx(N * K * 12.0 / R, rel=1e-12)  # stall torque, at the joint


def test_the_motor_itself_turns_its_rotor(servo):
    """In front of the gear: torque ``k i``, the rotor's share included."""
    result = run(servo(inductance="5 mH"), OPEN_LOOP)
    assert result["drive.servo.torque"].values == pytest.approx(K * result["control.servo.current"].values, abs=1e-9)


@pytest.mark.parametrize("period", [None, 0.005])
def test_a_position_loop_of_a_motor_is_the_matrix_exponential(servo, period):
    control = {"kind": "pid", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}, "kp": "20 V/rad",
               "kd": "0.5 V*s/rad", **({"period": f"{period} s"} if period else {})}  # fmt: skip
    result = run(servo(inductance="5 mH"), control, "0.2 s", ("x", "control.servo.command"))
    a = np.array([[0, 1, 0], [0, 0, N * K / INERTIA], [0, -K * N / 5e-3, -R / 5e-3]])
    b, gain = np.array([[0.0], [0.0], [1 / 5e-3]]), np.array([[20.0, 0.5, 0.0]])
    if period:
        whole = expm(np.block([[a, b], [np.zeros((1, 4))]]) * period)
        end = np.linalg.matrix_power(whole[:3, :3] - whole[:3, 3:] @ gain, 40)
    else:
        end = expm((a - b @ gain) * 0.2)
    assert result["x"].values[-1] == pytest.approx(1.0 + (end @ [-1.0, 0.0, 0.0])[0], abs=1e-8)
    assert result["control.servo.command"].values[0] == 20.0


def test_limits_are_those_of_the_voltage(servo):
    control = {"kind": "pid", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}, "kp": "100 V/rad",
               "limits": ["-24 V", "24 V"]}  # fmt: skip
    result = run(servo(), control, "0.1 s", ("control.servo.voltage", "control.servo.effort"))
    assert result["control.servo.voltage"].values[0] == 24.0
    assert result["control.servo.effort"].values[0] == pytest.approx(N * K * 24.0 / R, rel=1e-12)


def test_functions_give_voltages(servo):
    scenario = {"pinarm": 1, "mechanism": servo(), "outputs": ["x"], "problem": {
        "kind": "forward", "time": {"end": "0.1 s", "samples": 5}}}  # fmt: skip
    same = run(servo(), OPEN_LOOP, "0.1 s")["x"].values[-1]
    assert pinarm.run(scenario, control={"servo": lambda t, state: 12.0})["x"].values[-1] == pytest.approx(
        same, abs=1e-12
    )


def test_mistakes_are_told(servo, tmp_path):
    effort = {"kind": "pid", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}, "kp": "20 N*m/rad"}
    with pytest.raises(InputError, match="not a unit"):
        run(servo(), effort)
    torque = {"kind": "computed_torque", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}}
    with pytest.raises(InputError, match="takes a voltage"):
        run(servo(), torque)
    drive = {"joint": "x", "efficiency": 0.8, "motor": MOTOR}
    with pytest.raises(InputError, match="losses"):
        pinarm.Mechanism.load(tmp_path / "inertia.urdf", values={"drives": {"servo": drive}})
    with pytest.raises(InputError, match="constant 0"):
        servo(constant="0 N*m/A")
