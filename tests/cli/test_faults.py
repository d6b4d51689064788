"""What no input should cause: a fault of the program is reported as one, and not as a mistake of the user."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.engine.constraints.nullspace import solved_positive
from pinarm.errors import DynamicsError
from pinarm.use.facade import Scenario

SCENARIO = Path(pinarm.__file__).parents[1] / "scenarios" / "gen411_arm_swing.yaml"


def divide() -> float:
    return 1.0 / (1.0 - 1.0)


def recur() -> object:
    return recur()


def planted(monkeypatch: pytest.MonkeyPatch, fault: Callable[[], object]) -> None:
    """Let a fault be met where a scenario is solved, in whatever part of it."""
    monkeypatch.setattr(Scenario, "solve_once", lambda self: fault())


@pytest.mark.parametrize(
    ("fault", "said"),
    [(divide, "ZeroDivisionError: float division by zero"),
     (recur, "RecursionError: maximum recursion depth exceeded")],
)  # fmt: skip
def test_a_fault_is_reported_with_its_place(
    fault: Callable[[], object], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:  # fmt: skip
    planted(monkeypatch, fault)
    assert main(["run", str(SCENARIO), "-o", str(tmp_path / "out")]) == 4
    told = capsys.readouterr().err
    assert "Traceback (most recent call last)" in told
    assert f"in {fault.__name__}\n" in told
    assert f"has a fault: {said}" in told
    assert len(told) < 10_000
    with pytest.raises(
        (ZeroDivisionError, RecursionError)
    ):  # a caller in Python gets the error itself, with its traceback
        pinarm.run(SCENARIO)


def test_a_singular_mass_matrix_and_an_overflow_are_told_of_the_mechanism(monkeypatch: pytest.MonkeyPatch) -> None:
    planted(monkeypatch, lambda: solved_positive(np.zeros((2, 2)), np.ones((2, 1))))
    with pytest.raises(DynamicsError, match="the mass matrix of this mechanism is singular"):
        pinarm.run(SCENARIO)
    planted(monkeypatch, lambda: 1e200**2)
    with pytest.raises(DynamicsError, match="too large to be computed with"):
        pinarm.run(SCENARIO)


def test_memory_that_the_machine_has_not_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    planted(monkeypatch, lambda: np.empty(2**57))
    assert main(["run", str(SCENARIO), "-o", str(tmp_path / "out")]) == 3
    assert "not enough memory" in capsys.readouterr().err


def environment(**variables: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(pinarm.__file__).parents[1]), **variables}


@pytest.mark.slow
def test_sigterm_ends_a_sweep_with_words_and_its_own_code(tmp_path: Path) -> None:
    """143 is 128 + 15, as shells have it; the cases that are solved stay in the journal."""
    varied = ["--over", "problem.time.end=1:9:4000 s", "--over", "accuracy.tolerance=1e-9, 1e-10"]
    words = [sys.executable, "-m", "pinarm", "sweep", str(SCENARIO), *varied, "--no-plots", "-j", "1", "-o",
             str(tmp_path / "out")]  # fmt: skip
    begun = subprocess.Popen(words, env=environment(), stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    journal, patience = tmp_path / "out" / "journal.jsonl", time.monotonic() + 120.0
    while not (journal.exists() and journal.stat().st_size) and begun.poll() is None:
        assert time.monotonic() < patience, "the sweep does not begin"
        time.sleep(0.05)
    begun.send_signal(signal.SIGTERM)
    _, told = begun.communicate(timeout=120.0)
    assert begun.returncode == 143, told
    assert "interrupted with" in told
    assert "of 8000 cases solved" in told
