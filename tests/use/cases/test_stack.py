"""Cases solved together against the same cases alone, on every scenario that can take part."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm import PinarmError
from pinarm.records import replace
from pinarm.use.cases.case import WORTH, Task, Value, Wanted, solve_case
from pinarm.use.cases.solving import Stack
from tests.use.cases.conftest import Chunk

SCENARIOS = Path(__file__).parents[3] / "scenarios"
TOGETHER = {
    "gen411_arm_dynamic": ("m_A", "l1", "l2"), "gen411_arm_dynamic_true": ("m_BA", "l2", "m_B"),
    "gen411_arm_horizontal": ("m_A", "m_BA"), "gen411_arm_horizontal_general": ("m_A", "l1", "l2"),
    "gen411_arm_static": ("m_A", "l0", "l1", "l2"), "gen411_arm_vertical": ("m_A", "m_BA", "l1"), "handling_arm_c1": (),
    "handling_arm_profile": (), "magic_arms_cycle": (), "magic_arms_kinematics": ("l1", "l2"),
    "unbalanced_rotor_free": (), "crank_rocker_turning": ("a", "b", "c", "m2", "m3", "m4"), "rotor_horizontal": (),
    "rotor_static_balance": (), "rotor_vertical": (), "rssr_turning": ("a", "b", "c", "m3"),
    "slider_crank_bearings": ("r", "L", "m3", "m4", "I3"),
}  # fmt: skip
"""Scenarios whose cases are solved together -> the arguments that are varied; all where there are none."""

SAME = 1e-12
"""Difference relative to the largest number of a case: some hundred roundings of terms no larger than that."""

ROUNDING = {"closure acceleration": 1e-10}
"""Largest difference of a measure that is rounding itself [m/s^2 or rad/s^2]: of accelerations of 1e5 rad/s^2."""

Cases = list[dict[str, Value]]


def task_of(path: Path, results: Sequence[str] = (), values: Sequence[str] = ()) -> Task:
    scenario = pinarm.load(path, list(values))
    quantities = scenario.quantities()
    read = (Wanted.read(text, scenario.numbered) for text in results or scenario.content.outputs)
    return Task.of(scenario, (entry.measured(quantities)[0] for entry in read))


def cases_of(path: Path, names: Sequence[str], count: int) -> Cases:
    """Return cases whose arguments are those of the model, each a little larger or smaller."""
    mechanism, rng = pinarm.load(path).mechanism, np.random.default_rng(7)
    units = {name: str(mechanism.argument_units.get(name, "1")) for name in mechanism.arguments}
    return [
        {f"arguments.{name}": f"{mechanism.arguments[name] * x!r} {units[name]}"
         for name, x in zip(names, rng.uniform(0.8, 1.25, len(names)).tolist(), strict=True)}
        for _ in range(count)
    ]  # fmt: skip


FEW = ("gen411_arm_dynamic", "crank_rocker_turning", "rssr_turning", "magic_arms_kinematics")
"""Open and closed, in the plane and in space, of every kind of problem; the others are slow tests."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in FEW else pytest.mark.slow) for name in TOGETHER]
)
def test_numbers_and_figures_are_those_of_each_case_alone(name: str) -> None:
    path = SCENARIOS / f"{name}.yaml"
    names = TOGETHER[name] or [*pinarm.load(path).mechanism.arguments]
    cases = cases_of(path, names, 6)
    task = task_of(path)
    assert compared(task, cases) >= 4


COLUMNS: list[tuple[str, Sequence[str], dict[str, tuple[float, float, str]]]] = [
    ("gen411_arm_vertical", (), {"problem.motion.O.speed": (18.0, 25.0, "rad/s"), "arguments.l1": (0.25, 0.255, "m")}),
    ("gen411_arm_dynamic", (), {"problem.acceleration.phi": (3.0, 8.0, "rad/s^2"), "arguments.l2": (0.2, 0.3, "m")}),
    ("crank_rocker_turning", ["t @ max(T)", "T @ theta2=2 rad", "theta4 @ mean"],
     {"arguments.b": (0.33, 0.37, "m"), "problem.motion.theta2.speed": (90.0, 120.0, "rpm")}),
    ("gen411_arm_static", ["phi @ max(C_B)", "C_B @ p40", "C_B", "F_By @ end"],
     {"arguments.m_A": (0.1, 0.5, "kg"), "problem.hold.O": (0.0, 60.0, "deg")}),
]  # fmt: skip
"""Scenarios, results, and paths with the least and the greatest of their values: laws, rows and arguments."""


@pytest.mark.parametrize(("name", "results", "ranges"), COLUMNS)
def test_laws_and_numbers_are_those_of_each_case_alone(
    name: str, results: Sequence[str], ranges: dict[str, tuple[float, float, str]]
) -> None:
    cases: Cases = [
        {path: f"{low + share * (high - low)!r} {unit}" for path, (low, high, unit) in ranges.items()}
        for share in (0.3, 0.0, 1.0)
    ]
    few = ["problem.time.samples=121"] if name == "crank_rocker_turning" else []
    assert compared(task_of(SCENARIOS / f"{name}.yaml", results, few), cases) == 3


def compared(task: Task, cases: Cases) -> int:
    """Compare cases solved together with each alone, and return how many have been."""
    stack, count = Stack.begin(task, cases[0]), 0
    assert stack is not None
    for values, row in zip(cases, stack.rows(cases), strict=True):
        alone = solve_case(task, values)
        if row is None:  # where a motion is out of reach, or comes near a singular position
            continue
        count += 1
        assert (row.error, row.files) == (alone.error, alone.files)
        own, other = np.array(row.numbers), np.array(alone.numbers)
        results, rounding = len(own) - len(WORTH), [ROUNDING.get(name, SAME) for name in WORTH]
        np.testing.assert_allclose(own[:results], other[:results], rtol=0, atol=SAME * np.abs(other[:results]).max())
        np.testing.assert_array_equal(np.isnan(own), np.isnan(other))
        apart = np.abs(own - other)[results:] - SAME * np.abs(other[results:])
        assert (np.isnan(apart) | (apart <= rounding)).all(), dict(zip(WORTH, apart, strict=True))
    return count


@pytest.fixture
def arm() -> Path:
    return SCENARIOS / "gen411_arm_static.yaml"


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.slow)])
def test_every_quantity_is_that_of_each_case_alone_or_is_not_told(arm: Path, step: int) -> None:
    """Whatever can be asked by name: a number of another variant, or rows and variants mixed up, would be seen."""
    cases = cases_of(arm, ("m_A", "l1", "l2"), 3)  # as many as rows: a wrong axis would fit
    task = task_of(arm, (), ["problem.over.phi.samples=3"])
    stack = Stack.begin(task, cases[0])
    assert stack is not None
    alone = [task.case(case).run() for case in cases]
    known = {
        "C_B",
        "phi",
        "theta",
        "g",
        "l2",
        "A_x",
        "A_side",
        "point.A.position.y",
        "joint.B.force.norm",
        "joint.B.power",
    }
    told = set()
    for name in known.union(stack.base.quantities.names()[::step]):
        try:
            entry, _ = Wanted.read(name).measured(stack.base.quantities)
            rows = replace(stack, task=replace(task, wanted=(entry,))).rows(cases)
        except PinarmError:
            continue
        if None in rows:
            continue
        told.add(name)
        for result, row in zip(alone, rows, strict=True):
            expected = [number for number, _ in entry.numbers(result)]
            np.testing.assert_allclose(row.numbers[:2], expected, atol=1e-12, err_msg=name)
    assert known <= told
    assert len(told) > 100 / step


def test_a_motion_that_comes_near_a_singular_position_is_left_to_each_case_alone() -> None:
    """Its regularity is looked for between rows: with a = 0.145 m the crank all but stretches the linkage."""
    path = SCENARIOS / "crank_rocker_turning.yaml"
    task, cases = task_of(path), [{"arguments.a": text} for text in ("0.10 m", "0.12 m", "0.1985 m", "0.25 m")]
    stack = Stack.begin(task, cases[0])
    assert stack is not None
    assert [row is None for row in stack.rows(cases)] == [False, False, True, True]
    assert not solve_case(task, cases[2]).error
    assert solve_case(task, cases[3]).error


def test_what_cannot_be_solved_together_is_none(arm: Path) -> None:
    task, cases = task_of(arm), cases_of(arm, ("m_A",), 6)
    stack = Stack.begin(task, cases[0])
    assert stack is not None
    odd: Cases = [{"arguments.m_A": text} for text in ("-3 kg", "200 g", "nan kg", "1e200 kg", "0.2 kg")]
    rows = stack.rows([*odd, *cases])
    assert [row is None for row in rows[:4]] == [True, False, True, True]
    assert None not in rows[4:]
    for place in (1, 4):
        np.testing.assert_allclose(rows[place].numbers, solve_case(task, odd[place]).numbers, atol=1e-12)


def test_forces_that_only_the_sweep_asks_for_are_judged_and_solved_together(chunk: Chunk) -> None:
    """Residuals of the bodies' balances are told beside forces of joints, which are no outputs of the scenario."""
    scenario = pinarm.load(SCENARIOS / "crank_rocker_turning.yaml", ["problem.time.samples=61", "outputs=[theta4]"])
    cases = [{"arguments.m3": f"{mass} kg"} for mass in (0.8, 0.9, 1.0, 1.1)]
    numbers = chunk(scenario, cases, ["F_A @ max"])
    assert (numbers[:, 1 + WORTH.index("bodies")] < 1e-12).all()
