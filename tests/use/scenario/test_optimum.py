"""Optima against closed forms: functions first, then numbers of runs."""

import math
from pathlib import Path

import numpy as np
import pytest

from pinarm.engine.series import Series
from pinarm.errors import InputError, IntegrationError, PinarmError
from pinarm.input.units import unit
from pinarm.use.facade import Scenario
from pinarm.use.result.numbers import Condition
from pinarm.use.scenario.find import Find, Unknown
from pinarm.use.scenario.optimum import Optimum, Run, Runs
from pinarm.use.scenario.searches import optimum_section, refusal

ABOVE, EQUAL = Condition.read("a @ end", "> 0 mm"), Condition.read("b @ end", "= 0 m")


REFUSED = Run.refused("loop does not close", lambda: InputError("loop does not close"))


def asked(function, low, high, start, conditions=()) -> Optimum:
    """Ask for the least of a function that gives the objective and margins, or ``None`` where it cannot be run."""
    low, high = np.array(low, float), np.array(high, float)

    def run(x: np.ndarray) -> Run:
        numbers = function(low + x * (high - low))
        return REFUSED if numbers is None else Run(np.array(numbers, float))

    return Optimum(low, high, np.array(start, float), Runs(lambda points: map(run, points)), conditions)


def test_a_smooth_valley_is_followed_to_its_lowest_point():
    """Rosenbrock's function: (1, 1)."""
    valley = lambda x: [100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2]  # noqa: E731
    found = asked(valley, [-2, -2], [2, 2], [-1.2, 1.0]).solved(starts=2, seed=0)
    assert found.values(found.best) == pytest.approx([1.0, 1.0], abs=1e-4)


def test_a_kink_is_met_though_it_has_no_slope():
    """|x - 1| + |y + 1/2| is least at (1, -1/2)."""
    function = lambda x: [1.0 + abs(x[0] - 1.0) + 3.0 * abs(x[1] + 0.5)]  # noqa: E731
    found = asked(function, [-3, -3], [2.5, 4], [0, 0]).solved(starts=2, seed=0)
    assert found.values(found.best) == pytest.approx([1.0, -0.5], abs=1e-5)


def test_a_condition_holds_the_optimum_and_is_named():
    """Least x² + y² with x + y > 1: (1/2, 1/2); with y = 2 x as well: (1/3, 2/3)."""
    function = lambda x: [x @ x, x[0] + x[1] - 1.0]  # noqa: E731
    found = asked(function, [-2, -2], [2, 2], [1, 1], [ABOVE]).solved(3, 0)
    assert found.values(found.best) == pytest.approx([0.5, 0.5], abs=1e-5)
    assert found.active == [0]
    both = lambda x: [x @ x, x[0] + x[1] - 1.0, x[1] - 2.0 * x[0]]  # noqa: E731
    found = asked(both, [-2, -2], [2, 2], [1, 1], [ABOVE, EQUAL]).solved(3, 0)
    assert found.values(found.best) == pytest.approx([1.0 / 3.0, 2.0 / 3.0], abs=1e-5)
    assert found.active == [0, 1]


def test_runs_that_are_refused_are_no_optimum():
    """x falls to the left, where runs do not count below 0.3."""
    refused = lambda x: None if x[0] < 0.3 else [1.0 + x[0]]  # noqa: E731
    found = asked(refused, [0], [1], [0.9]).solved(1, 0)
    assert 0.3 <= found.values(found.best)[0] < 0.3 + 1e-4
    search = Find({"x": Unknown.read(["0 m", "1 m"])}, minimise="y @ end")
    remarks = optimum_section(search, found, Series("y @ end", unit("m"), np.zeros(1)), 0.0).remarks
    [held] = (remark for remark in remarks if remark.startswith("held by"))
    assert held == "held by refused runs beside this value of x"
    with pytest.raises(IntegrationError, match=r"none of the 2 starts can be run: loop does not close"):
        asked(lambda x: None, [0], [1], [0.9]).solved(2, 0)


def test_conditions_that_cannot_hold_are_said():
    said = r"none of the 2 starts leads to where all conditions hold: .* violates 'a @ end > 0 mm' by 1000 mm"
    with pytest.raises(IntegrationError, match=said):
        asked(lambda x: [x[0], -1.0 - x[0]], [0], [1], [0.9], [ABOVE]).solved(2, 0)


@pytest.mark.parametrize("everywhere", [False, True])
def test_what_does_not_depend_on_the_unknowns_is_said_to_be_flat(everywhere):
    rounded = lambda x: [0.3 + 1e-16 * math.sin(1e3 * x[0])]  # noqa: E731
    assert asked(rounded, [0], [1], [0.9]).solved(2, 0, everywhere=everywhere).is_flat()
    assert not asked(lambda x: [0.3 + x[0]], [0], [1], [0.9]).solved(2, 0, everywhere=everywhere).is_flat()


def test_a_global_search_leaves_the_nearest_valley():
    """Of x/10 - cos(2 pi x) on [-2.5, 2.5] the valley near -2 is the lowest: a start at 2 leads to another."""
    function = lambda x: [0.1 * x[0] - math.cos(2.0 * math.pi * x[0])]  # noqa: E731
    near = -math.asin(0.1 / (2.0 * math.pi)) / (2.0 * math.pi)
    one = asked(function, [-2.5], [2.5], [2.0]).solved(1, 0)
    assert one.values(one.best)[0] > -1.5
    whole = asked(function, [-2.5], [2.5], [2.0]).solved(1, 0, everywhere=True)
    assert whole.values(whole.best)[0] == pytest.approx(-2.0 + near, abs=1e-5)


URDF = """<robot name="inertia"><link name="world"/><link name="rotor"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="world"/><child link="rotor"/><axis xyz="0 0 1"/></joint></robot>"""
INERTIA = """
pinarm: 1
mechanism: inertia.urdf
gravity: none
problem:
  kind: inverse
  time: {{end: {end}, samples: 5}}
  motion: {{turn: {law}}}
{find}
outputs: [joint.turn.effort]
"""


def inertia(folder: Path, law: str, find: str, end: str = "1 s") -> Scenario:
    """An inertia J = 0.5 kg m² about its axis."""
    (folder / ".pinarm-root").touch()
    (folder / "inertia.urdf").write_text(URDF)
    text = INERTIA.format(end=end, law=law, find="\n  ".join(["find:", *find.splitlines()]))
    (folder / "inertia.yaml").write_text(text)
    return Scenario.load(folder / "inertia.yaml")


def test_a_run_whose_accuracy_fails_is_refused(tmp_path):
    """Its stamp says so: energy that nothing accounts for, a residual beyond rounding."""
    scenario = inertia(
        tmp_path, "{law: polynomial, from: 0 rad, to: 1 rad, duration: 1 s}",
        "for: {problem.time.end: [1 s, 2 s]}\nminimise: t @ end",
    )  # fmt: skip
    result = scenario.restated({key: x for key, x in scenario.document.data.items() if key != "find"}).run()
    assert refusal(result.figures) == ""
    assert "energy" in refusal({**result.figures, "energy": 0.01})
    assert "'return trip'" in refusal({**result.figures, "return trip": 1e-4})


@pytest.mark.slow
def test_the_trapezoid_of_least_heat_spends_a_third_of_its_time_on_each_part(tmp_path):
    """Speed v and acceleration a = v^2/(v - 1) cross 1 rad in 1 s; the rms torque J (2 a v)^(1/2) is least at v = 3/2.

    It is J 13.5^(1/2) there. By symmetry half of the way says it all.
    """
    scenario = inertia(
        tmp_path, "{law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 6 rad/s^2, speed: 1.3 rad/s}",
        "for:\n  problem.motion.turn.acceleration: {from: 3 rad/s^2, to: 9 rad/s^2, start: 6 rad/s^2}\n"
        "  problem.motion.turn.speed: {from: 1.1 rad/s, to: 1.9 rad/s, start: 1.3 rad/s}\n"
        "minimise: joint.turn.effort @ rms\nsubject_to: {turn @ end: = 0.5 rad}\nstarts: 1", end="0.5 s",
    )  # fmt: skip
    numbers = scenario.run().sections["find"].numbers
    assert numbers["objective"].values == pytest.approx([0.5 * math.sqrt(13.5)], rel=1e-5)
    assert numbers["problem.motion.turn.speed"].values == pytest.approx([1.5], rel=1e-3)
    assert numbers["problem.motion.turn.acceleration"].values == pytest.approx([4.5], rel=2e-3)


@pytest.mark.parametrize(
    ("find", "message"),
    [
        ("for: {problem.time.end: 1 s}\nminimise: t @ end", "searched between bounds"),
        ("for: {problem.time.end: [1 s, 2 s]}\nminimise: t", "no number of a run"),
        ("for: {problem.time.end: [1 s, 2 s]}\nso_that: {t @ end: 1 s}", "without bounds"),
        ("for: {problem.time.end: [1 s, 2 s]}\nminimise: t @ end\nsubject_to: {t @ end: 3 s}", "no condition"),
    ],
)
def test_what_is_refused(tmp_path, find, message):
    with pytest.raises(PinarmError) as caught:
        inertia(tmp_path, "{law: polynomial, from: 0 rad, to: 1 rad, duration: 1 s}", find).run()
    assert isinstance(caught.value, InputError)
    assert message in str(caught.value)
