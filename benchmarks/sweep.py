"""Sweeps: overhead against a loop by hand, two processes against one, and variants of a model per second.

Variants are solved one by one, and together as one array, as the processes of a sweep do with a chunk of them.

Run with ``python benchmarks/sweep.py``. A case is cheap: five positions of the two-rod arm at rest, with another mass.
Best of several, taken in turn. Cores that others are using as well show in the second row.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import pinarm
from pinarm.use.cases.case import Task, Wanted
from pinarm.use.cases.together import CaseSolver
from pinarm.use.result.measures import MEASURES

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "gen411_arm_static.yaml"
FEW_ROWS = ["problem.over.phi.samples=5"]
LOOP = ROOT / "scenarios" / "crank_rocker_turning.yaml"
LOOP_LENGTHS = {"a": (0.095, 0.105), "b": (0.34, 0.36)}
MASSES = {"m_A": (0.1, 0.5)}
CASES, VARIANTS, LOOPS, ROUNDS = 10_000, 1000, 1000, 3


def best(*functions: Callable[[], object]) -> list[float]:
    """Return the shortest time of each function [s], the functions taken in turn."""
    times: list[list[float]] = [[] for _ in functions]
    for _ in range(ROUNDS):
        for function, record in zip(functions, times, strict=True):
            begin = time.perf_counter()
            function()
            record.append(time.perf_counter() - begin)
    return [min(record) for record in times]


def by_hand(cases: int) -> np.ndarray:
    """Solve the cases one by one and keep what a sweep keeps."""
    scenario, rows = pinarm.load(SCENARIO, FEW_ROWS), []
    for mass in np.linspace(0.1, 0.5, cases).tolist():
        result = scenario.varied({"arguments.m_A": f"{mass!r} kg"}).run()
        series = [result[name].values for name in scenario.content.outputs]
        extremes = [extreme for values in series for extreme in (values.min(), values.max())]
        rows.append([*extremes, *(result.figures[name] for name in MEASURES if name in result.figures)])
    return np.array(rows)


def swept(cases: int, workers: int) -> np.ndarray:
    """Solve them as a sweep, with its journal and its files."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = pinarm.load(SCENARIO, FEW_ROWS)
        sweep = pinarm.sweep(scenario, {"arguments.m_A": f"0.1:0.5:{cases} kg"}, workers=workers, folder=folder)
        sweep.save(folder, plots=False)
    assert not sweep.errors
    return np.column_stack([series.values for series in sweep.columns])


def together(scenario: pinarm.Scenario, cases: list[dict[str, str]]) -> np.ndarray:
    """Solve them as a process of a sweep does with a chunk; return what it keeps."""
    quantities = scenario.quantities()
    wanted = tuple(Wanted.read(text).measured(quantities)[0] for text in scenario.content.outputs)
    solver = CaseSolver(Task.of(scenario, wanted))
    return np.array([row.numbers for row in solver.together([(k, "", given) for k, given in enumerate(cases)])])


Bounds = dict[str, tuple[float, float]]
"""Argument -> its least and greatest value [SI]."""


def rate_together(path: Path, values: list[str], bounds: Bounds, cases: int) -> float:
    """Return how many cases are solved together in a second of one core's time."""
    scenario, rng = pinarm.load(path, values), np.random.default_rng(1)
    units = {name: scenario.mechanism.argument_units[name] for name in bounds}
    rows = [
        {f"arguments.{name}": f"{rng.uniform(*ends)!r} {units[name]}" for name, ends in bounds.items()}
        for _ in range(cases)
    ]
    begin = time.process_time()
    assert len(together(scenario, rows)) == cases
    return cases / (time.process_time() - begin)


def main() -> None:
    reference, table = by_hand(50), swept(50, 2)
    assert np.allclose(reference[:, : table.shape[1]], table, rtol=1e-12, atol=1e-12)
    hand, one, two = best(lambda: by_hand(CASES), lambda: swept(CASES, 1), lambda: swept(CASES, 2))
    begin = time.process_time()
    by_hand(VARIANTS)
    rate = VARIANTS / (time.process_time() - begin)
    masses = rate_together(SCENARIO, FEW_ROWS, MASSES, CASES)
    loops = rate_together(LOOP, [], LOOP_LENGTHS, LOOPS)
    print(f"{CASES} cheap cases: by hand {hand:.1f} s, one process {one:.1f} s, two {two:.1f} s")
    print(f"{'sweep with one process / loop by hand':45s} {one / hand:6.2f}   wanted: at most 1.25")
    print(f"{'one process / two':45s} {one / two:6.2f}   wanted: at least 1.7")
    print(f"{'variants of a mass per second of one core':45s} {rate:6.0f}   wanted: at least 300")
    print(f"{'the same, 10,000 of them together':45s} {masses:6.0f}   wanted: at least 10000")
    print(f"{'four-bars of two lengths, a revolution each':45s} {loops:6.0f}   wanted: at least 1000")


if __name__ == "__main__":
    main()
