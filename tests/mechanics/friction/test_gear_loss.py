"""Gears with losses behind motors in forward runs: closed forms, inverse dynamics by formula, and what they hold."""

import numpy as np
import pytest

import pinarm

URDF = """<robot name="inertia"><link name="base"/><link name="rotor">
<inertial><origin xyz="{arm} 0 0"/><mass value="1"/>
<inertia ixx="1" iyy="{own}" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 1 0"/></joint></robot>"""

N, ETA, ROTOR, LOAD = 10.0, 0.7, 1e-4, 0.02
REFLECTED = N * N * ROTOR
DRIVE = {"joint": "x", "ratio": N, "efficiency": ETA, "rotor_inertia": f"{ROTOR} kg*m^2"}


@pytest.fixture
def servo(tmp_path):
    """Make an inertia of 0.02 kg m^2 about a horizontal axis, its mass centre at a distance, behind a lossy gear."""

    def made(arm=0.0, **keys):
        (tmp_path / "inertia.urdf").write_text(URDF.format(arm=arm, own=LOAD - arm**2))
        drive = {**DRIVE, "motor": {"kind": "ideal"}, **keys}
        drive = {key: value for key, value in drive.items() if value is not None}
        values = {"drives": {"servo": drive}, "gravity": {"magnitude": "10 m/s^2"}}
        return pinarm.Mechanism.load(tmp_path / "inertia.urdf", values=values)

    return made


def forward(mechanism, control=(), end="1 s", outputs=("x",), start=None, **problem):
    return {"pinarm": 1, "mechanism": mechanism, "outputs": list(outputs), "problem": {
        "kind": "forward", "time": {"end": end, "samples": 7}, "initial": start or {}, "control": list(control),
        **problem,
    }}  # fmt: skip


def constant(command, **keys):
    unit = keys.pop("unit", "N*m")
    gains = [[f"0 {unit}/rad", f"0 {unit}*s/rad"]]
    return {"kind": "state_feedback", "drive": "servo", "states": ["x"], "gains": gains, "bias": [f"{command} {unit}"],
            **keys}  # fmt: skip


def push(effort):
    """An effort [N m] at the joint, or steps of it."""
    law = {"law": "constant", "value": f"{effort} N*m"} if isinstance(effort, float) else effort
    return {"push": {"kind": "joint_effort", "joint": "x", "effort": law}}


FORWARDS = N * ETA * 0.3 / (LOAD + ETA * REFLECTED)
"""Acceleration under 0.3 N m while the motor drives."""

BACKWARDS = N / ETA * 0.3 / (LOAD + REFLECTED / ETA)
"""Acceleration under 0.3 N m while the motor brakes."""


@pytest.mark.parametrize(("ratio", "period"), [
    (N, {}), (-N, {}), pytest.param(-N, {"period": "30 ms"}, marks=pytest.mark.slow)])  # fmt: skip
def test_a_constant_torque_drives_through_the_efficiency(servo, ratio, period):
    sign = np.sign(ratio)
    result = pinarm.run(forward(servo(ratio=ratio), [constant(0.3, **period)], outputs=("x", "drive.servo.torque")))
    t = result["t"].values
    assert np.abs(result["x"].values - 0.5 * sign * FORWARDS * t**2).max() < 1e-10
    assert np.abs(result["joint.x.effort"].values - sign * (LOAD + REFLECTED) * FORWARDS).max() < 1e-12
    assert np.abs(result["joint.x.link_effort"].values - sign * LOAD * FORWARDS).max() < 1e-12
    assert np.abs(result["drive.servo.torque"].values - 0.3).max() < 1e-12
    assert result.figures["energy"] < 1e-12


def test_a_motor_brakes_against_the_load_and_reverses(servo):
    """From 10 rad/s: the gear helps to brake; at rest the power changes its direction, and the gear costs."""
    asked = forward(
        servo(), [constant(-0.3)], outputs=("x", "drive.servo.friction"), start={"velocity": {"x": "10 rad/s"}}
    )
    result = pinarm.run(asked)
    t, turn = result["t"].values, 10.0 / BACKWARDS
    before = 10.0 - BACKWARDS * t
    assert 0.05 < turn < 0.5
    assert np.abs(result["joint.x.velocity"].values - np.where(t < turn, before, -FORWARDS * (t - turn))).max() < 1e-9
    assert result.figures["energy"] < 1e-9


@pytest.mark.parametrize("torque, moves", [(0.3 / ETA * 0.99, 0), (0.3 * ETA * 0.99, -1), (0.3 / ETA * 1.01, 1)])
@pytest.mark.parametrize("period", [{}, pytest.param({"period": "50 ms"}, marks=pytest.mark.slow)])
def test_a_gear_at_rest_holds_between_both_efficiencies(servo, torque, moves, period):
    """A load of -3 N m: motor torques from ``3 eta / N`` to ``3 / (N eta)`` hold it."""
    result = pinarm.run(forward(servo(), [constant(torque, **period)], "0.5 s", loads=push(-3.0)))
    gain = ETA if moves > 0 else 1.0 / ETA
    a = (N * gain * torque - 3.0) / (LOAD + gain * REFLECTED) if moves else 0.0
    t = result["t"].values
    assert np.sign(a) == moves
    assert np.abs(result["x"].values - 0.5 * a * t**2).max() < 1e-9


def test_a_torque_that_grows_from_nothing_breaks_an_unloaded_gear_loose_at_once(servo):
    """What holds the gear and the most that it holds grow together: ``x = N eta t^3 / (6 (I + eta J))``."""
    result = pinarm.run(forward(servo(), end="0.5 s"), control={"servo": lambda t, state: t})
    t = result["t"].values
    assert np.abs(result["x"].values - N * ETA * t**3 / 6.0 / (LOAD + ETA * REFLECTED)).max() < 1e-8


def demand(t):
    """Torque for ``x = 2 t + sin(4 t) / 2`` of a pendulum of 0.1 m: Newton's equation, then the gear by its formula."""
    x, v, a = 2 * t + 0.5 * np.sin(4 * t), 2 + 2 * np.cos(4 * t), -8 * np.sin(4 * t)
    effort = LOAD * a - 10.0 * 0.1 * np.cos(x)
    return (effort / ETA if effort * v > 0 else effort * ETA) / N + N * ROTOR * a


def test_forward_of_inverse_is_the_motion(servo):
    """The power changes its direction several times; at 0.785 s the speed vanishes for an instant."""
    start = {"velocity": {"x": "4 rad/s"}}
    asked = forward(servo(0.1), end="0.7 s", outputs=("x", "drive.servo.torque"), start=start)
    result = pinarm.run(asked, control={"servo": lambda t, state: demand(t)})
    t = result["t"].values
    assert np.abs(result["x"].values - 2 * t - 0.5 * np.sin(4 * t)).max() < 1e-7
    assert np.abs(result["drive.servo.torque"].values - [demand(one) for one in t]).max() < 1e-12
    assert result.figures["energy"] < 1e-7


def test_a_dc_motor_behind_a_gear_with_losses(servo):
    """``J v' = eta N k (V - k N v) / R``: the no-load speed, later by the losses."""
    r, k = 0.5, 0.04
    motor = {"kind": "dc", "resistance": f"{r} ohm", "constant": f"{k} N*m/A"}
    result = pinarm.run(forward(servo(motor=motor), [constant(12, unit="V")], "0.3 s"))
    lag = r * (LOAD + ETA * REFLECTED) / (ETA * (N * k) ** 2)
    exact = 12.0 / (k * N) * (1.0 - np.exp(-result["t"].values / lag))
    assert np.abs(result["joint.x.velocity"].values - exact).max() < 1e-7


WHEEL, STIFFNESS, DAMPING = 2e-3, 8.0, 0.05
SHAFT = """<robot name="shaft"><link name="base"/>
<link name="wheel"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="load"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint>
<joint name="twist" type="continuous"><parent link="wheel"/><child link="load"/><axis xyz="0 0 1"/></joint></robot>"""
"""A lossy gear whose wheel turns a load through an elastic shaft: efficiency and elasticity of one drive."""


@pytest.fixture
def shaft(tmp_path):
    (tmp_path / "shaft.urdf").write_text(SHAFT)
    spring = {"kind": "joint_spring", "joint": "twist", "stiffness": f"{STIFFNESS} N*m/rad",
              "damping": f"{DAMPING} N*m*s/rad"}  # fmt: skip
    values = {"drives": {"servo": {**DRIVE, "motor": {"kind": "ideal"}}}, "forces": {"shaft": spring}}
    return pinarm.Mechanism.load(tmp_path / "shaft.urdf", values=values)


def test_through_an_elastic_shaft_a_lossy_gear_drives_with_constant_acceleration(shaft):
    """``T = J alpha N + (tau + I alpha) / (N eta)``, tau the torque of the shaft, which is twisted from the start."""
    alpha = 12.0
    tau = LOAD * alpha
    torque = N * ROTOR * alpha + (tau + WHEEL * alpha) / (N * ETA)
    start = {"position": {"twist": f"{-tau / STIFFNESS} rad"}, "velocity": {"x": "1 rad/s", "twist": "0 rad/s"}}
    names = "x", "force.shaft.effort"
    result = pinarm.run(forward(shaft, [constant(torque)], end="50 ms", outputs=names, start=start))
    t = result["t"].values
    assert np.abs(result["x"].values - t - 0.5 * alpha * t**2).max() < 1e-9
    assert np.abs(result["force.shaft.effort"].values - tau).max() < 1e-9
