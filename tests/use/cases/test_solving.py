"""Searches and sensitivities give the same numbers whoever solves their runs."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.cases.case import RowValues, Task, Wanted, failure
from pinarm.use.cases.solving import solving
from pinarm.use.workers.runners import HERE

TOLERANCES = {"of": ["M @ max", "M @ rms"], "to": {"m": "1 %", "l": "1 mm", "gravity.magnitude": "10 ± 0.1 m/s^2"},
              "monte_carlo": 40, "sobol": 2}  # fmt: skip
LEAST = {"for": {"arguments.m": ["1 kg", "3 kg"], "arguments.l": ["0.5 m", "2 m"]}, "minimise": "M @ rms",
         "subject_to": {"m*l**2 @ start": "= 2 kg*m^2"}, "starts": 2}  # fmt: skip
BALANCED = {"for": {"arguments.m": "1 kg"}, "so_that": {"M": "20 N*m", "M @ end": "30 N*m"}}
TILTED = {"gravity": {"direction": "-z", "magnitude": "10 m/s^2"}}


def numbers(scenario: Path, **given: Any) -> dict[str, str]:
    """Return all numbers of a scenario's sections, and what was found, to their last digit."""
    workers = {name: given.pop(name) for name in ("workers", "executor") if name in given}
    result = pinarm.run(scenario, {**TILTED, **given}, **workers)
    told = {f"{key}.{name}": float(series.values[0])
            for key, section in result.sections.items() for name, series in section.numbers.items()}  # fmt: skip
    return {name: repr(value) for name, value in {**told, **result.figures}.items()}


ASKED: Mapping[str, Mapping[str, Any]] = {
    "tolerances": {"sensitivity": TOLERANCES, "arguments.m": "2 kg"},
    "least": {"find": LEAST, "arguments.m": "2 kg"},
    "balanced": {"find": BALANCED, "arguments.m": "2 kg"},
}


@pytest.mark.slow
@pytest.mark.parametrize("asked", ASKED)
def test_processes_and_threads_give_the_same_to_the_last_digit(path: Path, asked: str) -> None:
    here = numbers(path, **ASKED[asked])
    assert len(here) > 5
    for workers in (1, 2):
        assert numbers(path, workers=workers, **ASKED[asked]) == here
    with ThreadPoolExecutor(3) as executor:
        assert numbers(path, executor=executor, **ASKED[asked]) == here


def test_values_of_rows_come_with_numbers_of_the_run(held: pinarm.Scenario) -> None:
    """M = 2 kg * 10 m/s^2 * l * sin(alpha) at 0, 30, 60 and 90 deg."""
    task = Task.of(held, [RowValues("M"), Wanted.read("M @ end")])
    with solving(task, HERE) as solve:
        rows = list(solve([{"arguments.l": "1 m"}, {"arguments.l": "2 m"}, {"arguments.l": "two"}]))
    for row, length in zip(rows, (1.0, 2.0), strict=False):
        np.testing.assert_allclose(row.taken, 20 * length * np.array([0, 0.5, 0.75**0.5, 1, 1]), atol=1e-13)
        assert row.figures["equilibrium"] < 1e-12
    assert "'two'" in str(failure(task, {"arguments.l": "two"}, rows[2]))
    assert rows[2].error in str(failure(task, {"arguments.l": "two"}, rows[2])).replace("\n", " ")
