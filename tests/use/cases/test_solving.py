"""Searches and sensitivities give the same numbers whoever solves their runs."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.cases.case import RowValues, Task, Wanted, failure
from pinarm.use.cases.solving import solving
from pinarm.use.workers.runners import HERE, Runners
from pinarm.use.workers.worker import LostJob

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


class Losing(Runners):
    """Loses every job."""

    @contextmanager
    def applying(self, function: Callable[..., Any]) -> Iterator[Any]:
        yield lambda jobs: (LostJob("its process died by SIGKILL") for _ in jobs)


def test_a_lost_case_is_a_row_that_says_so(held: pinarm.Scenario) -> None:
    with solving(Task.of(held, [RowValues("M")]), Losing()) as solve:
        [row] = solve([{}])
    assert (row.error, row.final) == ("its process died by SIGKILL", False)


def children(of: int) -> set[int]:
    shown = subprocess.run(["ps", "-o", "pid=", "--ppid", str(of)], capture_output=True, text=True, check=False)
    return {int(pid) for pid in shown.stdout.split()}


@pytest.mark.slow
def test_an_interrupt_ends_the_workers_with_the_exit_code_of_sweeps(path: Path, tmp_path: Path) -> None:
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs ignore interrupts
    asked = "sensitivity={of: [M @ rms], to: {m: 1 %}, monte_carlo: 100000}"
    running = subprocess.Popen(
        [sys.executable, "-m", "pinarm", "run", str(path), "-j", "2", "--set", asked, "-o", str(tmp_path / "out")],
        stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=heard,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
    )  # fmt: skip
    deadline = time.monotonic() + 60.0
    while len(workers := children(running.pid)) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(1.0)
    os.killpg(running.pid, signal.SIGINT)  # as a terminal does
    _, said = running.communicate(timeout=60)
    assert said == "interrupted\n"
    assert running.returncode in (130, -signal.SIGINT)  # shells say 130 of both
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert not (tmp_path / "out").exists()
