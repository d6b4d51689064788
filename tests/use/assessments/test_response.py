"""Step responses against those of ``x'' + 2 d w x' + w^2 (x - 1) = 0``, whose numbers are known."""

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError

URDF = """<robot name="inertia"><link name="base"/><link name="rotor"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/></joint></robot>"""

PULSATION, DAMPING = 5.0, 0.3
DAMPED = PULSATION * np.sqrt(1.0 - DAMPING**2)
STEADY = {"x": {"law": "constant_speed", "speed": "1 rad/s"}}


@pytest.fixture
def step(tmp_path):
    """A flywheel of 1 kg m^2 under PD control to 1 rad, the derivative of the error: from rest at 0."""
    (tmp_path / "inertia.urdf").write_text(URDF)
    control = {"kind": "pid", "drive": "x", "follows": {"law": "constant", "value": "1 rad"},
               "kp": f"{PULSATION**2} N*m/rad", "kd": f"{2 * DAMPING * PULSATION} N*m*s/rad"}  # fmt: skip
    problem = {"kind": "forward", "time": {"end": "4 s", "samples": 11}, "control": [control]}
    mechanism = pinarm.Mechanism.load(tmp_path / "inertia.urdf")
    return {"pinarm": 1, "mechanism": mechanism, "outputs": ["x"], "problem": problem,
            "response": {"of": "x", "final": "1 rad"}}  # fmt: skip


def exact(t):
    """The closed form: ``1 - exp(-d w t) (cos w_d t + d w / w_d sin w_d t)``."""
    decay = np.exp(-DAMPING * PULSATION * t)
    return 1.0 - decay * (np.cos(DAMPED * t) + DAMPING * PULSATION / DAMPED * np.sin(DAMPED * t))


def first(values, t):
    return t[np.flatnonzero(values)[0]]


def test_numbers_are_those_of_the_closed_form(step):
    result = pinarm.run(step)
    t = np.linspace(0.0, 4.0, 4_000_001)
    y = exact(t)
    number = {name: result.number(f"response.{name}")[0] for name in
              ("overshoot", "peak_time", "rise_time", "settling_time", "peak", "error")}  # fmt: skip
    assert number["overshoot"] == pytest.approx(np.exp(-np.pi * DAMPING / np.sqrt(1.0 - DAMPING**2)), abs=1e-8)
    assert number["peak_time"] == pytest.approx(np.pi / DAMPED, abs=1e-4)  # a flat top, looked at 1e-6 of the run apart
    assert number["rise_time"] == pytest.approx(first(y >= 0.9, t) - first(y >= 0.1, t), abs=2e-6)
    assert number["settling_time"] == pytest.approx(t[np.flatnonzero(np.abs(y - 1.0) > 0.02)[-1]], abs=2e-6)
    assert number["peak"] == pytest.approx(1.0 + number["overshoot"], abs=1e-12)
    assert number["error"] == pytest.approx(1.0 - exact(4.0), abs=1e-8)


def test_a_later_step_down_counts_from_its_beginning(step):
    """From 1 s on, seen as a step from where it is: the settling time is that of the same curve, less 1 s."""
    whole = pinarm.run(step).number("response.settling_time")[0]
    later = pinarm.run({**step, "response": {"of": "-x", "final": "-1 rad", "initial": "0 rad", "begin": "1 s"}})
    assert later.number("response.settling_time")[0] == pytest.approx(whole - 1.0, abs=1e-9)


@pytest.mark.parametrize(("end", "told"), [(0.4, True), (0.35, False), (0.66, False)])
def test_a_run_that_ends_on_the_way_up_says_so(step, end, told):
    """At 0.4 s it passes 1.0186 on its way to 1.3723, which it reaches at 0.6587 s; at 0.35 s it is at 0.86."""
    step["problem"] = {**step["problem"], "time": {"end": f"{end} s", "samples": 11}}
    section = pinarm.run(step).sections["response"]
    assert any("may go on" in remark for remark in section.remarks) == told
    reached = max(exact(np.linspace(0.0, end, 1_000_001)).max() - 1.0, 0.0)
    assert section.numbers["overshoot"].values[0] == pytest.approx(reached, abs=1e-7)


@pytest.mark.parametrize("asked, said", [
    ({"of": "y"}, "y"), ({"of": "x", "final": "1 m"}, "unit"), ({"of": "x", "begin": "9 s"}, "does not come"),
    ({"of": "x", "final": "0 rad"}, "no step"),
])  # fmt: skip
def test_mistakes_are_told(step, asked, said):
    with pytest.raises(InputError, match=said) as caught:
        pinarm.run({**step, "response": asked}).sections["response"]
    assert "scenario: response" in str(caught.value)


def test_times_of_rows_that_stand_alone_are_those_of_rows(step):
    rows = 61
    t = np.linspace(0.0, 6.0, rows)
    y = exact(t)
    problem = {"kind": "recorded", "columns": {"t [s]": t.tolist(), "x [rad]": y.tolist()}}
    result = pinarm.run({**step, "problem": problem})
    times = {"rise_time": first(y >= 0.9, t) - first(y >= 0.1, t), "peak_time": t[y.argmax()],
             "settling_time": t[np.flatnonzero(np.abs(y - 1.0) > 0.02)[-1] + 1]}  # fmt: skip
    for name, time in times.items():
        assert result.number(f"response.{name}")[0] == pytest.approx(time, abs=1e-12)
    assert result.number("response.peak")[0] == pytest.approx(y.max(), rel=1e-12)
    assert any(f"those of rows, at most {6.0 / (rows - 1):.3g} s apart" in remark for remark in
               result.sections["response"].remarks)  # fmt: skip


def lag(step, pulsation, damping, end, **response):
    """Numbers of the response of another flywheel under PD control, with the step of 1 rad at the start."""
    control = {**step["problem"]["control"][0], "kp": f"{pulsation**2} N*m/rad",
               "kd": f"{2.0 * damping * pulsation} N*m*s/rad"}  # fmt: skip
    problem = {"kind": "forward", "time": {"end": f"{end} s", "samples": 2}, "control": [control]}
    accuracy = {"tolerance": 1e-11, "max_steps": 100_000}
    run = pinarm.run({**step, "problem": problem, "accuracy": accuracy, "response": {**step["response"], **response}})
    return {name: float(series.values[0]) for name, series in run.sections["response"].numbers.items()}


def test_a_response_that_is_short_beside_the_run_is_seen(step):
    """Its overshoot of 3 ms is between the first of evenly spaced instants of a run of 3 s."""
    found, damped = lag(step, 1000.0, DAMPING, 3.0), 1000.0 * np.sqrt(1.0 - DAMPING**2)
    assert found["overshoot"] == pytest.approx(np.exp(-np.pi * DAMPING / np.sqrt(1.0 - DAMPING**2)), abs=1e-8)
    assert found["peak_time"] == pytest.approx(np.pi / damped, rel=1e-4)
    t = np.linspace(0.0, 0.02, 400_001)
    y = exact(200.0 * t)  # of the pulsation 5 rad/s
    assert found["rise_time"] == pytest.approx(first(y >= 0.9, t) - first(y >= 0.1, t), abs=2e-7)
    assert found["settling_time"] == pytest.approx(t[np.flatnonzero(np.abs(y - 1.0) > 0.02)[-1]], abs=1e-7)


def test_the_top_of_a_held_effort_is_in_the_interval_that_follows_a_jump(step):
    """Sampled at 1 kHz, the rotor coasts through parabolas; their top is that of the recursion of samples."""
    problem = step["problem"]
    control = [{**problem["control"][0], "kp": "1e6 N*m/rad", "kd": "600 N*m*s/rad", "period": "1 ms"}]
    run = pinarm.run({**step, "problem": {**problem, "control": control, "time": {"end": "0.2 s", "samples": 2}}})
    x, v, top = 0.0, 0.0, 0.0
    for _ in range(50):
        u = 1e6 * (1.0 - x) - 600.0 * v
        coasting = -v / u if -1e-3 * u > v > 0.0 else 0.0
        top = max(top, x + v * coasting + 0.5 * u * coasting**2)
        x, v = x + 1e-3 * v + 0.5e-6 * u, v + 1e-3 * u
    assert run.number("response.overshoot")[0] == pytest.approx(top - 1.0, abs=1e-9)


@pytest.mark.parametrize("damping", np.linspace(0.15, 0.85, 3))
def test_the_errors_of_its_numbers_are_told(step, damping):
    """Of a formula: the error is that of the search. The times are those of roots that SciPy finds."""
    from scipy.optimize import brentq

    damped, end = np.sqrt(1.0 - damping**2), 40.0

    def z(t):
        return 1.0 - np.exp(-damping * t) * (np.cos(damped * t) + damping / damped * np.sin(damped * t))

    s = "(t/(1 s))"
    wave = f"cos({float(damped)!r}*{s}) + {float(damping / damped)!r}*sin({float(damped)!r}*{s})"
    law = {"kind": "inverse", "time": {"end": f"{end} s", "samples": 20}, "motion": STEADY}
    asked = {"of": f"5*(1 - exp(-{float(damping)!r}*{s})*({wave}))", "initial": "0 1", "final": "5 1"}
    found = pinarm.run({**step, "problem": law, "response": asked}).section("response")
    t = np.linspace(0.0, end, 400_001)
    outside = np.flatnonzero(np.abs(z(t) - 1.0) > 0.02)[-1]
    roots = [brentq(lambda t, y=y: z(t) - y, 0.0, np.pi / damped, xtol=1e-15) for y in (0.1, 0.9)]
    settled = brentq(lambda t: abs(z(t) - 1.0) - 0.02, t[outside], t[outside + 1], xtol=1e-15)
    top = np.exp(-damping * np.pi / damped)
    exact = {"rise_time": roots[1] - roots[0], "peak_time": np.pi / damped, "settling_time": settled, "overshoot": top,
             "peak": 5.0 * (1.0 + top), "error": 5.0 * (1.0 - z(end))}  # fmt: skip
    for name, value in exact.items():
        assert abs(found.numbers[name].values[0] - value) <= found.errors[name] + 1e-14, name
        assert found.errors[name] < (1e-3 if name == "peak_time" else 1e-8)
