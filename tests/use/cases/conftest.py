"""Cases as a process solves a chunk of them, and which of them were solved by themselves."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

import pinarm
from pinarm.use.cases import solving
from pinarm.use.cases.case import Row, Task, Value, Wanted, solve_case
from pinarm.use.cases.solving import CaseSolver
from pinarm.use.workers.runners import in_order

Chunk = Callable[[pinarm.Scenario, Sequence[dict[str, Value]], Sequence[str]], np.ndarray]


@pytest.fixture
def chunk(monkeypatch: pytest.MonkeyPatch) -> Chunk:
    """Return a function that solves cases together, all but the first and the last of them, and returns their rows."""
    alone: list[dict[str, Value]] = []

    def noted(task: Task, values: dict[str, Value]) -> Row:
        alone.append(values)
        return solve_case(task, values)

    monkeypatch.setattr(solving, "solve_case", noted)

    def solved(scenario: pinarm.Scenario, cases: Sequence[dict[str, Value]], results: Sequence[str]) -> np.ndarray:
        quantities = scenario.quantities()
        wanted = tuple(Wanted.read(text).measured(quantities)[0] for text in results)
        solver = CaseSolver(Task.of(scenario, wanted))
        rows = list(in_order(solver.together(cases)))
        assert alone == [cases[-1]]  # to be compared
        assert not any(row.error for row in rows)
        return np.array([row.numbers for row in rows])

    return solved
