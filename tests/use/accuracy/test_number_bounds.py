"""Bounds of the errors of numbers, those of sections among them, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.show.text import report

URDF = """<robot name="inertia"><link name="base"/><link name="rotor"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/></joint></robot>"""

NUMBERS = ["t @ max(x)", "joint.x.velocity @ x=0.5 rad, occurrence=1", "joint.x.velocity @ rms", "response.overshoot"]


@pytest.fixture
def step(tmp_path):
    """A flywheel of 1 kg m^2 that a PD controller turns by 1 rad; at a tolerance, a pulsation and a damping ratio."""
    (tmp_path / "inertia.urdf").write_text(URDF)
    mechanism = pinarm.Mechanism.load(tmp_path / "inertia.urdf")

    def scenario(tolerance, pulsation, damping, **more):
        control = {"kind": "pid", "drive": "x", "follows": {"law": "constant", "value": "1 rad"},
                   "kp": f"{pulsation**2!r} N*m/rad", "kd": f"{2 * damping * pulsation!r} N*m*s/rad"}  # fmt: skip
        problem = {"kind": "forward", "time": {"end": "2 s", "samples": 11}, "control": [control]}
        return pinarm.load({"pinarm": 1, "mechanism": mechanism, "outputs": ["x"], "problem": problem,
                            "accuracy": {"tolerance": tolerance}, "numbers": NUMBERS,
                            "response": {"of": "x", "final": "1 rad"}, **more})  # fmt: skip

    return scenario


def exact(pulsation, damping):
    """Numbers of ``x = 1 - exp(-d w t) (cos w_d t + d w / w_d sin w_d t)``, and of its rate."""
    decay, damped = damping * pulsation, pulsation * np.sqrt(1.0 - damping**2)

    def z(t):
        return 1.0 - np.exp(-decay * t) * (np.cos(damped * t) + decay / damped * np.sin(damped * t))

    def rate(t):
        return pulsation**2 / damped * np.exp(-decay * t) * np.sin(damped * t)

    def reached(y):
        from scipy.optimize import brentq

        return float(brentq(lambda t: z(t) - y, 0.0, np.pi / damped, xtol=1e-15))

    nodes, weights = np.polynomial.legendre.leggauss(200)
    top = float(np.exp(-decay * np.pi / damped))
    return {
        "t @ max(x)": np.pi / damped, "joint.x.velocity @ x=0.5 rad, occurrence=1": rate(reached(0.5)),
        "joint.x.velocity @ rms": np.sqrt(0.5 * weights @ rate(1.0 + nodes) ** 2), "response.overshoot": top,
        "response.rise_time": reached(0.9) - reached(0.1), "response.peak": 1.0 + top, "response.error": 1.0 - z(2.0),
    }  # fmt: skip


def test_true_errors_are_below_the_bounds(step):
    """Of 28 numbers at tolerances from 1e-3 to 1e-9; the bounds are not far above."""
    generator, ratios = np.random.default_rng(3), []
    for tolerance in np.geomspace(1e-3, 1e-9, 4):
        case = float(generator.uniform(3.0, 8.0)), float(generator.uniform(0.1, 0.5))
        result = step(float(tolerance), *case).verified()
        for name, value in exact(*case).items():
            ratios.append(abs(result.number(name)[0] - value) / result.number_errors[name])
    assert max(ratios) <= 1.0
    assert np.median(ratios) > 0.01


def test_bounds_stand_in_sections_summary_and_terminal_and_come_back(step, tmp_path):
    result = step(1e-6, 5.0, 0.3, limits={"keep": {"response.overshoot": "< 50 %"}}).verified()
    table = result.sections["response"].tables[-1]
    assert table.name == "bounds"
    bounds = {row[0]: row[3] for row in table.rows}
    assert bounds["overshoot"] == result.number_errors["response.overshoot"] > 0.0
    assert f"response.overshoot: 0.3723261 (error below {bounds['overshoot']:.1e})" in report(result)
    assert result.sections["limits"].tables[0].rows[0][4] == f"{100.0 * bounds['overshoot']:.1e}"  # in %
    again = pinarm.restore(result.save(tmp_path / "saved", plots=False))
    assert again.number_errors == pytest.approx(dict(result.number_errors), rel=1e-12)
    assert [each.name for each in again.sections["response"].tables] == ["response", "bounds"]


def test_a_number_that_a_run_does_not_come_to_has_none(step):
    result = step(1e-6, 5.0, 0.3, numbers=[], problem={**step(1e-6, 5.0, 0.3).document.data["problem"],
                  "time": {"end": "0.3 s", "samples": 5}}).verified()  # fmt: skip
    assert np.isnan(result.sections["response"].numbers["settling_time"].values[0])
    assert "response.settling_time" not in result.number_errors
    with pytest.raises(InputError):
        result.number("x @ x=3 rad")


def test_the_objective_of_a_search_has_that_of_its_number():
    """At the largest length of the rod, where a bound holds it."""
    search = {"for": {"arguments.l2": ["0.1 m", "0.5 m"]}, "maximise": "C_B @ rms", "starts": 2}
    more = {"find": search, "numbers": ["C_B @ rms"]}
    result = pinarm.load(Path(pinarm.__file__).parents[1] / "scenarios" / "gen411_arm_static.yaml", more).verified()
    [number] = result.numbers().values()
    assert result.section("find").errors["objective"] == number[1] > 0.0
    assert result.number_errors["find.objective"] == result.number_errors["C_B @ rms"] > number[1]
    assert any("at these values the objective is known to" in remark for remark in result.section("find").remarks)
