"""Who solves many runs: processes of this machine, or the workers of an executor."""

from __future__ import annotations

from concurrent.futures import Executor

from pinarm.engine.dynamics.parallel import cores
from pinarm.errors import InputError
from pinarm.use.workers.distribute import Workers
from pinarm.use.workers.executor_workers import ExecutorWorkers
from pinarm.use.workers.local_processes import LocalProcesses


def chosen_workers(number: int | None, executor: Executor | None) -> Workers:
    """Return the workers of an executor, or where there is none processes of this machine, which start when needed.

    Args:
        number: How many; ``None`` for as many as the executor has, or as there are cores here.
        executor: Any of ``concurrent.futures``, which stays the caller's.

    Raises:
        InputError: What is given is no executor.
    """
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise InputError(f"{executor!r} is no executor", expected="one of concurrent.futures, or none",
                         hint="workers: for the number of processes")  # fmt: skip
    return LocalProcesses(number or cores()) if executor is None else ExecutorWorkers(executor, number)
