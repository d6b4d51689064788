"""DC motors against their closed forms: stall, no load, two eigenvalues, and the rotor behind a gear."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

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


def test_mistakes_are_told(servo):
    effort = {"kind": "pid", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}, "kp": "20 N*m/rad"}
    with pytest.raises(InputError, match="not a unit"):
        run(servo(), effort)
    torque = {"kind": "computed_torque", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}}
    with pytest.raises(InputError, match="with inductance"):
        run(servo(inductance="5 mH"), torque)
    with pytest.raises(InputError, match="0 is out of bounds"):
        servo(constant="0 N*m/A")


def ideal(tmp_path, **motor):
    """Make the mechanism with a motor whose torque is commanded."""
    drive = {"joint": "x", "ratio": N, "rotor_inertia": f"{ROTOR} kg*m^2", "motor": {"kind": "ideal", **motor}}
    return pinarm.Mechanism.load(tmp_path / "inertia.urdf", values={"drives": {"servo": drive}})


def constant(torque, **keys):
    """A torque [N m] whatever happens."""
    return {"kind": "state_feedback", "drive": "servo", "states": ["x"], "gains": [["0 N*m/rad", "0 N*m*s/rad"]],
            "bias": [f"{torque} N*m"], **keys}  # fmt: skip


T0, W0 = 0.5, 400.0
LINE = [["0 rad/s", f"{T0} N*m"], [f"{W0} rad/s", "0 N*m"]]
TAU = INERTIA * W0 / (N * N * T0)
"""Time constant of ``J v' = N T0 (1 - N v / w0)``."""


@pytest.mark.parametrize(("period", "sign"), [({}, -1.0), ({"period": "10 ms"}, 1.0)])
def test_along_a_linear_torque_speed_line_the_speed_is_an_exponential(servo, tmp_path, period, sign):
    """A command that is always beyond the line, in both directions."""
    result = run(ideal(tmp_path, peak=LINE), constant(2.0 * sign * T0, **period), "1 s", ("x", "control.servo.margin"))
    t = result["t"].values
    exact = sign * W0 / N * (1.0 - np.exp(-t / TAU))
    assert np.abs(result["joint.x.velocity"].values - exact).max() < 1e-7  # tolerance 1e-9 a step, speeds to 40
    torque = sign * T0 * np.exp(-t / TAU)
    assert np.abs(result["control.servo.torque"].values - torque).max() < 1e-9
    assert np.abs(result["drive.servo.torque"].values - torque).max() < 1e-9
    assert np.abs(result["control.servo.margin"].values).max() == 0.0
    assert result.figures["energy"] < 1e-7
    assert any("gives its peak torque from t = 0 s to 1 s" in note for note in result.notes())


def reached(torque, flat):
    """Instant at which a constant torque meets the line, which is flat at ``T0`` up to a speed, then falls to w0."""
    speed = flat + (W0 - flat) * (1.0 - torque / T0)
    return speed, INERTIA * speed / (N * N * torque)


def test_a_torque_above_the_continuous_one_is_told(servo, tmp_path):
    mechanism = ideal(tmp_path, continuous=[["0 rpm", "0.2 N*m"], ["6000 rpm", "0.1 N*m"]])
    result = run(mechanism, constant(0.3), "0.1 s", ("control.servo.continuous_margin",))
    allowed = 0.2 - 0.1 * N * N * 0.3 * 0.05 / INERTIA / (6000 * np.pi / 30)
    note = f"0.3 N*m rms at a mean speed of {N * N * 0.3 * 0.05 / INERTIA:.3g} rad/s, more than its continuous torque"
    assert any(note in one and f"{allowed:.3g} N*m" in one for one in result.notes())
    assert result["control.servo.continuous_margin"].values[0] == pytest.approx(-0.1, abs=1e-12)
    quiet = run(mechanism, constant(0.1), "0.1 s", ("x",))
    assert not any("continuous" in note for note in quiet.notes())


@pytest.mark.parametrize("motor, said", [
    ({"peak": [["0 rpm", "2 N*m"]]}, "do not ascend"), ({"peak": [["1 rpm", "2 N*m"], ["2 rpm", "0 N*m"]]}, "ascend"),
    ({"peak": [["0 rpm", "2 N*m"], ["2 rpm", "1 N*m"]]}, "ends with 1 N"), ({"peak": [["0 rpm", "2 V"]]}, "not a unit"),
    ({"resistance": "1 ohm"}, "resistance"),
])  # fmt: skip
def test_curves_that_are_none_are_refused(servo, tmp_path, motor, said):
    with pytest.raises(InputError, match=said):
        ideal(tmp_path, **motor)


LIMIT = 8.0
"""Of the current [A]; 12 V at rest would drive 24 A."""


def test_a_current_limit_without_inductance_is_a_parabola_then_an_exponential(servo):
    """At the limit ``J v' = N k I``; the winding takes over where ``12 - k N v = R I``."""
    result = run(servo(current_limit=f"{LIMIT} A"), OPEN_LOOP, "1 s", ("x", "control.servo.current_margin"))
    t, a = result["t"].values, N * K * LIMIT / INERTIA
    free = (12.0 - R * LIMIT) / (K * N)
    instant, tau = free / a, R * INERTIA / (K * N) ** 2
    speed = np.where(t < instant, a * t, 12.0 / (K * N) - (12.0 / (K * N) - free) * np.exp(-(t - instant) / tau))
    assert np.abs(result["joint.x.velocity"].values - speed).max() < 1e-7
    assert f"servo is at its current limit from t = 0 s to {instant:.6g} s" in " ".join(result.notes())
    held = t < instant
    assert result["control.servo.voltage"].values[held] == pytest.approx(R * LIMIT + K * N * speed[held], abs=1e-9)
    assert result["control.servo.voltage"].values[~held] == pytest.approx(12.0, abs=1e-12)
    assert np.abs(result["control.servo.current_margin"].values[held]).max() < 1e-12
    assert result.figures["energy"] < 1e-7


@pytest.mark.parametrize(("period", "sign"), [({}, -1.0), ({"period": "10 ms"}, 1.0)])
def test_a_current_limit_with_inductance_holds_and_lets_go(servo, period, sign):
    """Three parts: both eigenvalues, constant current, both eigenvalues again, each from where the other ended."""
    inductance = 5e-3
    control = {**OPEN_LOOP, "bias": [f"{12 * sign} V"], **period}
    result = run(servo(inductance="5 mH", current_limit=f"{LIMIT} A"), control, "1 s")
    t = result["t"].values
    reached = brentq(lambda at: step(inductance, [at])[0, 2] - LIMIT, 0.0, 0.01, xtol=1e-14)
    speed = float(step(inductance, [reached])[0, 1])
    a = N * K * LIMIT / INERTIA
    leaves = reached + ((12.0 - R * LIMIT) / (K * N) - speed) / a
    m = np.array([[-0.0, N * K / INERTIA, 0], [-K * N / inductance, -R / inductance, 12 / inductance], [0, 0, 0]])
    after = [expm(m * max(at - leaves, 0.0)) @ [speed + a * (leaves - reached), LIMIT, 1.0] for at in t]
    early = step(inductance, t)
    current = np.where(t < reached, early[:, 2], np.where(t < leaves, LIMIT, np.array(after)[:, 1]))
    rate = np.where(t < reached, early[:, 1], np.where(t < leaves, speed + a * (t - reached), np.array(after)[:, 0]))
    assert np.abs(result["control.servo.current"].values - sign * current).max() < 2e-6
    assert np.abs(result["joint.x.velocity"].values - sign * rate).max() < 1e-6
    assert (t[(t > reached) & (t < leaves)]).size > 5
    assert any("servo is at its current limit from t = " in note for note in result.notes())
    assert result.figures["energy"] < 1e-7


STALLED = {"initial": {"position": {"x": "0 rad"}}, "end_stops": {"x": {"upper": "1e-9 rad", "restitution": 0}}}
"""The load is held by a stop: only the controller and the motor move on."""


def against_the_stop(servo_mechanism, end="1 s", **keys):
    control = {"kind": "pid", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}, "kp": "0.4 N*m/rad",
               "ki": "2 N*m/rad/s", **keys}  # fmt: skip
    return run(servo_mechanism, control, end, ("control.servo.command", "control.servo.torque"), **STALLED)


@pytest.mark.parametrize(("keys", "time"), [({}, 0.2), ({"tracking_time": "50 ms"}, 0.05)])
def test_an_integral_follows_a_motor_at_its_peak_torque(servo, tmp_path, keys, time):
    """With e = 1 and kp e < T0, the part p = ki x rises by ki e until kp e + p = T0; then
    ``p' = ki e - (kp e + p - T0) / T_t``, whose end is ``T0 - kp e + ki e T_t``."""
    motor = ideal(tmp_path, peak=[["0 rad/s", "0.5 N*m"], ["400 rad/s", "0 N*m"]])
    result = against_the_stop(motor, "0.5 s", **keys)
    t = result["t"].values
    instant = (0.5 - 0.4) / 2.0
    exact = np.where(t < instant, 0.4 + 2.0 * t, 0.5 + 2.0 * time * (1.0 - np.exp(-(t - instant) / time)))
    assert np.abs(result["control.servo.command"].values - exact).max() < 1e-7  # the stop is 1 nrad away
    assert np.abs(result["control.servo.torque"].values - np.minimum(exact, 0.5)).max() < 1e-7


def test_mistakes_of_limits_are_told(servo, tmp_path):
    with pytest.raises(InputError, match="0 is out of bounds"):
        servo(current_limit="0 A")
    motor = ideal(tmp_path, peak=LINE)
    with pytest.raises(InputError, match="without kp there is no time") as caught:
        against_the_stop(motor, kp="0 N*m/rad")
    assert "tracking_time" in str(caught.value)
    with pytest.raises(InputError, match=r"a tracking time of 0\.001 s and a period of 0\.01 s"):
        against_the_stop(motor, period="10 ms", tracking_time="1 ms")
