"""Sweeps: a loop by hand, one process and two, and cases per second of one core's time.

The process that gives cases out writes them down as well: 20 us a case, which limits sweeps of cheap ones. At the end
cases are solved one by one, and together as one array, as the processes of a sweep do with a chunk of them.

Run with ``python -m benchmarks.sweep``.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import pinarm
from pinarm.use.cases.case import WORTH, Task, Wanted, solve_case
from pinarm.use.cases.solving import CaseSolver
from pinarm.use.result.measures import MEASURES
from pinarm.use.workers.runners import in_order

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "gen411_arm_static.yaml"
FEW_ROWS = ["problem.over.phi.samples=5"]
ONE_BY_ONE = 40
"""Cases of each comparison that are solved by themselves."""


class Comparison(NamedTuple):
    """Cases of one scenario, solved together and one by one.

    Attributes:
        title: What varies.
        scenario: Name of the scenario.
        ranges: Path -> its least and greatest value, and their unit.
        cases: How many are solved together.
        values: Other values of the scenario.
        results: What is taken from each case; its outputs where nothing is named.
    """

    title: str
    scenario: str
    ranges: dict[str, tuple[float, float, str]]
    cases: int = 600
    values: Sequence[str] = ()
    results: Sequence[str] = ()


MASS, LENGTHS = (
    {"arguments.m_A": (0.1, 0.5, "kg")},
    {"arguments.a": (0.095, 0.105, "m"), "arguments.b": (0.34, 0.36, "m")},
)
SPEED = {"problem.motion.theta2.speed": (80.0, 120.0, "rpm")}
COMPARISONS = [
    Comparison("a mass, 5 rows", "gen411_arm_static", MASS, 10_000, FEW_ROWS),
    Comparison("a length, 5 rows", "gen411_arm_static", {"arguments.l2": (0.2, 0.3, "m")}, 10_000, FEW_ROWS),
    Comparison(
        "the angle that is held, 5 rows", "gen411_arm_static", {"problem.hold.O": (0.0, 60.0, "deg")}, 4000, FEW_ROWS
    ),
    Comparison("a mass, 241 rows", "gen411_arm_static", MASS, 2000),
    Comparison("a mass, 241 rows, C_B @ max", "gen411_arm_static", MASS, 1000, (), ["C_B @ max"]),
    Comparison("a mass, 241 rows, C_B @ rms", "gen411_arm_static", MASS, 1000, (), ["C_B @ rms"]),
    Comparison("a mass", "crank_rocker_turning", {"arguments.m3": (0.5, 1.5, "kg")}, 3000),
    Comparison("two lengths", "crank_rocker_turning", LENGTHS, 3000),
    Comparison("the speed of the crank", "crank_rocker_turning", SPEED),
    Comparison("two lengths, T @ max", "crank_rocker_turning", LENGTHS, 400, (), ["T @ max"]),
    Comparison("two lengths, T @ rms", "crank_rocker_turning", LENGTHS, 400, (), ["T @ rms"]),
]
BY_HAND, CHEAP, FULL = 500, 100_000, 40_000
"""Cases that a loop solves, and those of sweeps with a few rows and with all."""


def timed(function: Callable[[], object]) -> float:
    """Return how long a function takes [s]."""
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def by_hand(cases: int) -> np.ndarray:
    """Solve the cases one by one and keep what a sweep keeps."""
    scenario, rows = pinarm.load(SCENARIO, FEW_ROWS), []
    for mass in np.linspace(0.1, 0.5, cases).tolist():
        result = scenario.varied({"arguments.m_A": f"{mass!r} kg"}).run()
        series = [result[name].values for name in scenario.content.outputs]
        extremes = [extreme for values in series for extreme in (values.min(), values.max())]
        rows.append([*extremes, *(result.figures[name] for name in MEASURES if name in result.figures)])
    return np.array(rows)


def swept(cases: int, workers: int, values: Sequence[str] = FEW_ROWS) -> np.ndarray:
    """Solve them as a sweep, with its journal and its files."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = pinarm.load(SCENARIO, values)
        sweep = pinarm.sweep(scenario, {"arguments.m_A": f"0.1:0.5:{cases} kg"}, workers=workers, folder=folder)
        sweep.save(folder, plots=False)
    assert not sweep.errors
    return np.column_stack([series.values for series in sweep.columns])


def compared(given: Comparison) -> tuple[float, float]:
    """Return how many cases are solved one by one, and together, in a second of one core's time."""
    scenario, rng = (
        pinarm.load(ROOT / "scenarios" / f"{given.scenario}.yaml", list(given.values)),
        np.random.default_rng(1),
    )
    cases = [
        {path: f"{rng.uniform(low, high)!r} {unit}" for path, (low, high, unit) in given.ranges.items()}
        for _ in range(given.cases)
    ]
    quantities = scenario.quantities()
    wanted = tuple(Wanted.read(text).measured(quantities)[0] for text in given.results or scenario.content.outputs)
    task = Task.of(scenario, wanted)
    solver = CaseSolver(task)
    begin = time.process_time()
    rows = [row.numbers for row in in_order(solver.together(cases))]
    middle = time.process_time()
    alone = [solve_case(task, case).numbers for case in cases[:ONE_BY_ONE]]
    end = time.process_time()
    numbers = len(alone[0]) - len(WORTH)
    own, other = (np.array([row[:numbers] for row in table]) for table in (rows[:ONE_BY_ONE], alone))
    assert np.allclose(own, other, rtol=0.0, atol=1e-12 * np.abs(other).max())
    return ONE_BY_ONE / (end - middle), given.cases / (middle - begin)


def main() -> None:
    reference, table = by_hand(50), swept(50, 2)
    assert np.allclose(reference[:, : table.shape[1]], table, rtol=1e-12, atol=1e-12)
    hand = BY_HAND / timed(lambda: by_hand(BY_HAND))
    print(f"5 rows, a loop by hand: {hand:.0f} cases a second")
    for rows, cases, values in ((5, CHEAP, FEW_ROWS), (241, FULL, [])):
        one, two = (cases / timed(partial(swept, cases, workers, values)) for workers in (1, 2))
        print(f"{rows} rows, {cases} cases with their files, a second: one process {one:.0f}, two {two:.0f}")
    for each in COMPARISONS:
        alone, together = compared(each)
        print(f"{each.scenario + ': ' + each.title:60s} {alone:6.0f} {together:6.0f}   {together / alone:5.1f}")


if __name__ == "__main__":
    main()
