"""Controllers of forward runs against closed forms: matrix exponentials, known limits, and other routes."""

import numpy as np
import pytest
from scipy.linalg import expm

import pinarm
from pinarm.errors import InputError

URDF = """<robot name="inertia"><link name="base"/><link name="rotor"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/></joint></robot>"""

PD = {"kind": "pid", "drive": "x", "follows": {"law": "constant", "value": "0 rad"}, "kp": "25 N*m/rad",
      "kd": "6 N*m*s/rad"}  # fmt: skip
"""On J = 1: ``x'' + 6 x' + 25 x = 0``."""


@pytest.fixture
def inertia(tmp_path):
    """A flywheel of 1 kg m^2 about z."""
    (tmp_path / "inertia.urdf").write_text(URDF)
    return pinarm.Mechanism.load(tmp_path / "inertia.urdf")


def scenario(mechanism, control, end="1 s", outputs=("x",), start="1 rad", **problem):
    initial = {"position": {"x": start}} if start else {}
    return {"pinarm": 1, "mechanism": mechanism, "outputs": list(outputs), "problem": {
        "kind": "forward", "time": {"end": end, "samples": 101}, "initial": initial, "control": control, **problem,
    }}  # fmt: skip


def last(result, name="x"):
    return float(result[name].values[-1])


def held(a, b, gain, x, period, samples):
    """States of ``x' = A x + B u`` under ``u = -K x``, held over each period, by the matrix exponential."""
    n = len(a)
    whole = expm(np.block([[a, b], [np.zeros((1, n + 1))]]) * period)
    step = whole[:n, :n] - whole[:n, n:] @ gain[None]
    return np.linalg.matrix_power(step, samples) @ x


INTEGRATORS = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


def test_continuous_pd_is_the_published_number(inertia):
    exact = np.exp(-3.0) * (np.cos(4.0) + 0.75 * np.sin(4.0))
    found = last(pinarm.run(scenario(inertia, [PD])))
    assert round(found, 8) == -0.06080223
    assert found == pytest.approx(exact, abs=1e-8)  # tolerance 1e-9 a step


@pytest.mark.parametrize(("period", "jump", "number"), [("150 ms", "0.45 s", 3), ("100 ms", "0.3 s", 3)])
def test_a_sample_at_the_jump_of_a_reference_sees_it(inertia, period, jump, number):
    """0.15 s three times is less than 0.45 s in floating point, and 0.1 s three times more than 0.3 s."""
    follows = {"law": "steps", "points": [["0 s", "0 rad"], [jump, "1 rad"]]}
    control = {"kind": "pid", "drive": "x", "follows": follows, "kp": "1 N*m/rad", "period": period}
    h, x, v = float(period.split()[0]) / 1e3, 0.0, 0.0
    for k in range(number + 4):
        u = (k >= number) - x
        x, v = x + h * v + 0.5 * h * h * u, v + h * u
    found = last(pinarm.run(scenario(inertia, [control], end=f"{h * (number + 4)!r} s", start="0 rad")))
    assert found == pytest.approx(x, abs=1e-13)


@pytest.mark.parametrize("period", ["100 ms", "2 s"])
def test_references_of_sampled_controllers_are_told_between_samples_too(inertia, period):
    """Before the first sample the wheel stands still: the error is the reference, of which the mean square is known."""
    follows = {"law": "steps", "points": [["0 s", "0 rad"], ["0.35 s", "1 rad"], ["0.8 s", "-2 rad"]]}
    control = {"kind": "pid", "drive": "x", "follows": follows, "kp": "1e-12 N*m/rad", "period": period}
    outputs = ["x", "control.x.reference"]
    given = scenario(inertia, [control], outputs=outputs, start="0 rad")
    result = pinarm.run(given | {"numbers": ["control.x.error @ rms"]})
    t, told = result["t"].values, result["control.x.reference"].values
    assert told[np.flatnonzero(t == 0.35)].tolist() == [0.0, 1.0]
    assert told[np.flatnonzero(t == 0.8)].tolist() == [1.0, -2.0]
    assert (told == np.where(t < 0.35, 0.0, np.where(t < 0.8, 1.0, -2.0)))[(t != 0.35) & (t != 0.8)].all()
    assert result.number("control.x.error @ rms")[0] == pytest.approx(np.sqrt(0.45 + 0.2 * 4.0), abs=1e-11)


def test_the_integral_is_a_state_of_the_run(inertia):
    """``x'' + 6 x' + 25 x + 3 integral of x = 0`` by the matrix exponential."""
    found = last(pinarm.run(scenario(inertia, [{**PD, "ki": "3 N*m/rad/s"}])))
    a = np.array([[0.0, 1.0, 0.0], [-25.0, -6.0, -3.0], [1.0, 0.0, 0.0]])
    assert found == pytest.approx((expm(a) @ [1.0, 0.0, 0.0])[0], abs=1e-8)


@pytest.mark.parametrize("method, error", [("dop853", 1e-12), ("dopri5", 1e-12), ("stiff", 1e-9), ("rk4", 1e-12)])
def test_every_method_ends_its_steps_on_the_samples(inertia, method, error):
    exact = held(*INTEGRATORS, np.array([25.0, 6.0]), np.array([1.0, 0.0]), 0.05, 20)[0]
    setting = {"step": "1 s"} if method == "rk4" else {}
    asked = {**scenario(inertia, [{**PD, "period": "50 ms"}]), "accuracy": {"method": method, **setting}}
    assert exact == pytest.approx(-0.04278454, abs=1e-8)  # as published
    assert last(pinarm.run(asked)) == pytest.approx(exact, abs=error)


def test_limits_clip_the_effort_and_keep_the_integral(inertia):
    """Double integrator under bang effort until the command is within the limits, found by the closed form."""
    control = [{**PD, "kd": "10 N*m*s/rad", "limits": ["-1 N*m", "1 N*m"]}]
    result = pinarm.run(scenario(inertia, control, "3 s", ("x", "control.x.effort", "control.x.command")))
    t, x = result["t"].values, result["x"].values
    switch = (-10.0 + np.sqrt(100.0 + 4.0 * 12.5 * 24.0)) / 25.0  # x = 1 - t^2/2, -25 x + 10 t = -1
    saturated = t < switch - 1e-9
    assert np.abs(x[saturated] - (1.0 - 0.5 * t[saturated] ** 2)).max() < 1e-10
    effort, command = result["control.x.effort"].values, result["control.x.command"].values
    assert np.abs(effort - np.clip(command, -1.0, 1.0)).max() < 1e-12
    assert effort[saturated] == pytest.approx(-1.0, abs=1e-12)


def test_a_relay_cycles_between_its_hysteresis(inertia):
    """``x'' = -+1`` switched at ``x + x' = -+0.1``: every arc is a parabola, stepped here in closed form."""
    control = [{"kind": "switching", "drive": "x", "above": "1 N*m", "below": "-1 N*m", "hysteresis": "0.1 rad",
                "lead": "1 s"}]  # fmt: skip
    found = last(pinarm.run(scenario(inertia, control, "6 s")))
    t, x, v, u = 0.0, 1.0, 0.0, -1.0
    while True:  # s = -(x + v) reaches -0.1 sign(u): x + v + h (v + u) + u h^2 / 2 = 0.1 u
        b, c = v + u, x + v - 0.1 * u
        roots = np.roots([0.5 * u, b, c])
        ahead = [r.real for r in roots if abs(r.imag) < 1e-12 and r.real > 1e-9]
        h = min([*ahead, 6.0 - t])
        x, v, t = x + h * v + 0.5 * u * h * h, v + u * h, t + h
        if t >= 6.0:
            break
        u = -u
    assert found == pytest.approx(x, abs=1e-8)


def test_a_relay_needs_a_hysteresis_unless_it_is_sampled(inertia):
    relay = {"kind": "switching", "drive": "x", "above": "1 N*m", "below": "-1 N*m"}
    with pytest.raises(InputError, match="switch without end"):
        pinarm.run(scenario(inertia, [relay]))
    sampled = pinarm.run(scenario(inertia, [{**relay, "period": "10 ms", "lead": "1 s"}], "6 s"))
    assert abs(last(sampled)) < 0.05


def test_the_energy_balance_counts_the_controllers(inertia):
    """Work of the controller = change of energy: E falls from 0 to J v^2 / 2 by what the PD does, both ways."""
    for control in ({**PD}, {**PD, "period": "50 ms"}, {**PD, "ki": "3 N*m/rad/s", "limits": ["-9 N*m", "9 N*m"]}):
        result = pinarm.run(scenario(inertia, [control], outputs=("x", "energy.kinetic")))
        assert result.figures["energy"] < 1e-6
        assert result["energy.kinetic"].values.max() > 0.1


@pytest.mark.parametrize("key, value, said", [
    ("drive", "y", "no drive or joint 'y'"), ("drive", ["x", "x"], "twice"),
    ("limits", ["1 N*m", "-1 N*m"], "not above"), ("follows", {"law": "constant", "value": "1 m"}, "not a unit"),
    ("period", "1e-9 s", "samples"),
])  # fmt: skip
def test_mistakes_are_told_at_their_place(inertia, key, value, said):
    with pytest.raises(InputError, match=said) as caught:
        pinarm.run(scenario(inertia, [{**PD, key: value}]))
    assert "control.0" in str(caught.value)


def test_a_delay_may_be_one_and_a_half_periods(inertia):
    """Commands take effect between later samples: half periods stepped by hand."""
    found = last(pinarm.run(scenario(inertia, [{**PD, "kp": "4 N*m/rad", "period": "0.1 s", "delay": "0.15 s"}])))
    x, v, u, commands, h = 1.0, 0.0, 0.0, list[float](), 0.05
    for half in range(20):
        if half % 2 == 0:
            commands.append(-4.0 * x - 6.0 * v)
        elif half >= 3:
            u = commands[(half - 3) // 2]
        x, v = x + h * v + 0.5 * h * h * u, v + h * u
    assert found == pytest.approx(x, abs=1e-13)


def test_a_coarse_saturated_sampled_pid_is_stepped_by_hand(inertia):
    """Rounded positions, rates as differences, integral's part and effort within 2 N m, all at once."""
    asked = {**PD, "kp": "4 N*m/rad", "ki": "30 N*m/rad/s", "kd": "3 N*m*s/rad", "limits": ["-2 N*m", "2 N*m"],
             "period": "50 ms", "rates": "difference", "resolution": "0.01 rad"}  # fmt: skip
    found = last(pinarm.run(scenario(inertia, [asked], "2 s")))
    x, v, part, before, h = 1.0, 0.0, 0.0, 1.0, 0.05
    for _ in range(40):
        y = round(x / 0.01) * 0.01
        part = min(max(part - 30.0 * h * y, -2.0), 2.0)
        u = min(max(-4.0 * y - 3.0 * (y - before) / h + part, -2.0), 2.0)
        x, v, before = x + h * v + 0.5 * h * h * u, v + h * u, y
    assert found == pytest.approx(x, abs=1e-12)


def test_a_relay_starts_by_its_error_beside_a_sampled_controller(tmp_path):
    """Within the hysteresis the sign of the error decides at the start: +1 N m on 1 kg m^2 is 0.5 rad in 1 s."""
    links = [URDF.split('<link name="rotor">')[1].split("</link>")[0]] * 2
    joint = (
        '<joint name="{0}" type="continuous"><parent link="base"/><child link="{0}_rotor"/><axis xyz="0 0 1"/></joint>'
    )
    parts = [
        f'<link name="{name}_rotor">{link}</link>{joint.format(name)}' for name, link in zip("xy", links, strict=True)
    ]
    (tmp_path / "two.urdf").write_text(f'<robot name="two"><link name="base"/>{"".join(parts)}</robot>')
    two = pinarm.Mechanism.load(tmp_path / "two.urdf")
    relay = {"kind": "switching", "drive": "x", "follows": {"law": "constant", "value": "1 rad"}, "above": "1 N*m",
             "below": "-1 N*m", "hysteresis": "10 rad"}  # fmt: skip
    for other in ([], [{**PD, "drive": "y"}], [{**PD, "drive": "y", "period": "50 ms"}]):
        found = pinarm.run(scenario(two, [relay, *other], start=None))
        assert last(found) == pytest.approx(0.5, abs=1e-9)


def test_a_joint_has_one_controller_and_no_law(inertia):
    with pytest.raises(InputError, match="two controllers"):
        pinarm.run(scenario(inertia, [PD, PD]))
    with pytest.raises(InputError, match="follows a law"):
        pinarm.run(scenario(inertia, [PD], start=None, motion={"x": {"law": "constant", "value": "1 rad"}}))


@pytest.mark.parametrize(("key", "per"), [("kp", ""), ("ki", "/s"), ("kd", "*s")])
def test_a_gain_of_another_unit_is_refused_with_the_one_of_its_drive_and_coordinate(inertia, key, per):
    with pytest.raises(InputError, match="'N' is not a unit of this quantity") as caught:
        pinarm.load(scenario(inertia, [{**PD, key: "5 N"}])).validate()
    assert caught.value.expected == f"a unit such as N*m{per}/rad"
    right = pinarm.load(scenario(inertia, [{**PD, key: f"20 N*m{per}/rad"}]))
    right.validate()
