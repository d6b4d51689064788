"""Who solves many runs."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from pinarm.errors import InputError
from pinarm.use.workers import choice
from pinarm.use.workers.choice import chosen_workers
from pinarm.use.workers.executor_workers import ExecutorWorkers
from pinarm.use.workers.local_processes import LocalProcesses
from pinarm.use.workers.runners import check_number


def test_processes_here_unless_there_is_an_executor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "cores", lambda: 3)
    here = chosen_workers(None, None)
    assert isinstance(here, LocalProcesses)
    assert (here.count(), chosen_workers(5, None).count()) == (3, 5)
    with ThreadPoolExecutor(3) as executor:
        there = chosen_workers(None, executor)
        assert isinstance(there, ExecutorWorkers)
        assert (there.count(), chosen_workers(7, executor).count()) == (3, 7)


def test_a_number_is_no_executor() -> None:
    with pytest.raises(InputError, match="3 is no executor"):
        chosen_workers(None, 3)  # type: ignore[arg-type]


@pytest.mark.parametrize("number", [0, -1])
def test_none_solve_nothing(number: int) -> None:
    with pytest.raises(InputError, match=f"{number} workers solve nothing"):
        check_number(number)
