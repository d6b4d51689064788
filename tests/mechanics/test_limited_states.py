"""States within limits: the last digit of a state at its limit decides nothing. Against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinarm
from pinarm.mechanics.limited_states import FREE, HIGHEST, LOWEST, StateLimits

LIMITS = StateLimits(-5.0, 0.7)


@pytest.mark.parametrize(("limit", "sign", "held"), [(0.7, 1.0, HIGHEST), (-5.0, -1.0, LOWEST)])
def test_a_state_at_its_limit_is_held_on_either_side_of_rounding(limit, sign, held):
    for value in (np.nextafter(limit, 0.0), limit, np.nextafter(limit, 2.0 * limit)):
        assert LIMITS.mode(value, sign * 2.0, 3.0, FREE) == held
        assert LIMITS.mode(value, 0.0, 3.0, held) == held  # as long as nothing takes it back
        assert LIMITS.mode(value, -sign * 1e-16, 3.0, held) == FREE
        assert LIMITS.mode(value, sign * 1e-16, 3.0, FREE) == FREE  # the instant at which it was let go
    assert LIMITS.mode(0.9 * limit, sign * 2.0, 3.0, FREE) == FREE
    assert StateLimits(-np.inf, np.inf).mode(1e9, 1.0, 1.0, FREE) == FREE


URDF = """<robot name="two"><link name="base"/>{}</robot>"""
WHEEL = """<link name="{0}_link"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="0.02" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="{0}" type="continuous"><parent link="base"/><child link="{0}_link"/><axis xyz="0 0 1"/>
</joint>"""


def solved(tmp_path, drives, control, outputs, end="0.3 s", **problem):
    """Run with a limit of steps: a state that hangs at its limit takes hundreds of thousands."""
    (tmp_path / "two.urdf").write_text(URDF.format("".join(WHEEL.format(drive["joint"]) for drive in drives.values())))
    mechanism = pinarm.Mechanism.load(tmp_path / "two.urdf", values={"drives": drives})
    return pinarm.run({
        "pinarm": 1, "mechanism": mechanism, "outputs": outputs, "accuracy": {"max_steps": 900},
        "problem": {"kind": "forward", "time": {"end": end, "samples": 31}, "control": control, **problem},
    })  # fmt: skip


@pytest.mark.parametrize("limit", np.linspace(3.0, 6.0, 13)[::6])
def test_a_current_stays_at_its_limit_whatever_its_last_digit(tmp_path, limit):
    motor = {"kind": "dc", "resistance": "1 ohm", "inductance": "2 mH", "constant": "0.03 N*m/A"}
    drive = {
        "joint": "x",
        "ratio": 20,
        "rotor_inertia": "1e-5 kg*m^2",
        "motor": {**motor, "current_limit": f"{limit} A"},
    }
    control = [{"kind": "pid", "drive": "servo", "follows": {"law": "constant", "value": "1 rad"}, "kp": "24 V/rad",
               "kd": "3 V*s/rad"}]  # fmt: skip
    result = solved(tmp_path, {"servo": drive}, control, ["x", "control.servo.current"], "60 ms")
    t, v = result["t"].values, result["joint.x.velocity"].values
    held = (t > 2e-3) & (t < 15e-3)
    assert result["control.servo.current"].values[held] == pytest.approx(limit, rel=1e-12)
    assert np.diff(v[held]) / np.diff(t[held]) == pytest.approx(0.6 * limit / 0.024, rel=1e-7)  # N k I / J


def sampled_motor(limit, samples, period):
    """Return position and current at the samples of a PD controller: free, linear stretches and held ones in turn.

    ``J w' = n k i``, ``L i' = u - R i - n k w``; at its limit the current stays until ``L i'`` would take it back.
    """
    ratio, resistance, inductance, constant, inertia = 20.0, 1.0, 2e-3, 0.03, 0.02 + 20.0**2 * 1e-5
    state, held, found = np.zeros(3), 0.0, []
    for _ in range(samples):
        found.append(state[[0, 2]])
        u = float(np.clip(24.0 * (1.0 - state[0]) - 0.6 * state[1], -24.0, 24.0))

        def rate(y, u=u):
            return (u - resistance * y[2] - ratio * constant * y[1]) / inductance

        def free(t, y, rate=rate):
            return [y[1], ratio * constant * y[2] / inertia, rate(y)]

        def fixed(t, y):
            return [y[1], ratio * constant * y[2] / inertia, 0.0]

        def reached(t, y):
            return limit - abs(y[2])

        def released(t, y, rate=rate):
            return rate(y) * np.sign(y[2])

        reached.terminal = released.terminal = True
        reached.direction = released.direction = -1
        t = 0.0
        if held and rate(state) * held < 0.0:
            held = 0.0
        while t < period:
            event = released if held else reached
            part = solve_ivp(fixed if held else free, (t, period), state, events=event, rtol=1e-11, atol=1e-12)
            t, state = part.t[-1], part.y[:, -1]
            if part.status == 1:
                held = 0.0 if held else float(np.sign(state[2]))
    return np.array(found)
