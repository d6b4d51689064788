"""Distribution: what a chunk and a case cost whoever gives them out, and what more workers bring.

Run with ``python -m benchmarks.distribution``; it starts a scheduler of Dask and workers on loopback. Jobs that rest
stand for work on other machines: they take no core of this one, so that what is lost is lost by distribution. The
figures of ``docs/distribution.md`` are of it.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from array import array
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import pinarm
from pinarm.engine.series import Series
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.cases.case import Task, Wanted, solve_case
from pinarm.use.cases.case_table import CaseTable, Column, RowTable
from pinarm.use.study.sweep.axes import Axis, Cases
from pinarm.use.study.sweep.case_solver import Solving
from pinarm.use.workers.chunk_order import Answers, ChunkOrder, answered, unpacked
from pinarm.use.workers.distribute import Pace, Workers, distribute
from pinarm.use.workers.executor_workers import ExecutorWorkers
from pinarm.use.workers.local_processes import LocalProcesses
from pinarm.use.workers.travelling_files import Parcel

SCENARIO = Path(__file__).parents[1] / "scenarios" / "gen411_arm_static.yaml"
FEW_ROWS = {"problem.over.phi.samples": 5}
CHUNKS, RESTS, CASES, JOURNALED = 500, 1500, 1000, 10_000
REST = 0.005
"""Time of a job that rests [s], about that of a case of the two-rod arm."""


@contextmanager
def dask(number: int) -> Iterator[Any]:
    """Yield the executor of a cluster with one process a worker."""
    from distributed import Client

    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        known = Path(folder) / "scheduler.json"
        options = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", str(known)]
        worker = ["worker", "--nthreads", "1", "--no-nanny", "--local-directory", folder]
        for command in (["scheduler", "--port", "0"], *[worker] * number):
            process = subprocess.Popen([sys.executable, "-m", "dask", *command, *options], stderr=subprocess.DEVNULL)
            stack.callback(process.wait)
            stack.callback(process.kill)
            while not known.exists():
                time.sleep(0.1)
        with Client(scheduler_file=str(known)) as client:
            client.wait_for_workers(number, timeout=120)
            yield client.get_executor()


def spent(function: Callable[[float], Any], jobs: list[float], workers: Workers) -> tuple[float, float]:
    """Return the time of a job, once workers run, and the processor time here [s]."""
    answers = distribute(function, iter(jobs), workers)
    for _ in range(4 * workers.count()):
        next(answers)
    begin, cpu = time.perf_counter(), time.process_time()
    left = sum(1 for _ in answers)
    return (time.perf_counter() - begin) / left, (time.process_time() - cpu) / left


def chunks(number: int) -> None:
    """Print what a chunk of one job that does nothing costs."""
    with patch.object(Pace, "note", lambda *_: None):
        local = spent(abs, [0.0] * CHUNKS, LocalProcesses(number))
        with dask(number) as executor:
            there = spent(abs, [0.0] * CHUNKS, ExecutorWorkers(executor))
    for name, (wall, cpu) in (("processes", local), ("Dask", there)):
        print(f"chunk, {number} workers, {name:9s} {1e3 * wall:6.2f} ms, of which here {1e3 * cpu:.2f} ms")


def rests(numbers: tuple[int, ...]) -> None:
    """Print the share of the time in which workers rest as they are to."""
    for number in numbers:
        local = spent(time.sleep, [REST] * RESTS, LocalProcesses(number))[0]
        with dask(number) as executor:
            there = spent(time.sleep, [REST] * RESTS, ExecutorWorkers(executor))[0]
        shares = [REST / (number * wall) for wall in (local, there)]
        print(f"resting jobs, {number:2d} workers: processes {shares[0]:.0%}, Dask {shares[1]:.0%}")


class Answered:
    """Workers that have answered already: what is left is the work of the process that gives cases out."""

    def __init__(self) -> None:
        self.files = Parcel()

    def count(self) -> int:
        """Return two."""
        return 2

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Answer a chunk by rows of 20 numbers."""
        order: ChunkOrder = pickle.loads(arguments[1])
        count = len(unpacked(order.jobs, ""))
        rows = RowTable(np.arange(count)[:, None] + np.arange(20) / 7, ("/a/b",))
        future = Future[Any]()
        future.set_result(answered(Answers([(np.arange(count), rows)], 0.004 * count), "/nowhere"))
        return future

    def outcome(self, future: Future[Any]) -> Any:
        """Return the answer."""
        return future.result()

    def require(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def here() -> None:
    """Print the processor time of the process that gives cases out, for each, its journal included."""
    scenario = pinarm.load(SCENARIO, FEW_ROWS)
    column = Column("arguments.m_A", np.linspace(0.1, 0.5, JOURNALED).tolist(), "kg")
    chosen, task = Cases((Axis((column,)),)), Task.of(scenario, ())
    named = [Series(f"x{k}", DIMENSIONLESS, np.zeros(0)) for k in range(20)]
    solving = Solving(task, chosen, named, lambda done, failed, total: None)
    with tempfile.TemporaryDirectory() as folder:
        begin = time.process_time()
        solving.run(Answered(), Path(folder))
    print(f"a case takes {1e6 * (time.process_time() - begin) / JOURNALED:.0f} us here")


def cases(numbers: tuple[int, ...]) -> None:
    """Print the rate of a sweep's cases, start-up included."""
    over = {"arguments.m_A": f"0.1:0.5:{CASES} kg"}
    for number in numbers:
        with tempfile.TemporaryDirectory() as folder, dask(number) as executor:
            for name, given in (("processes", None), ("Dask", executor)):
                begin = time.perf_counter()
                pinarm.sweep(SCENARIO, over, values=FEW_ROWS, workers=number, executor=given, folder=f"{folder}/{name}")
                print(f"cases, {number} workers, {name:9s} {CASES / (time.perf_counter() - begin):6.0f} a second")


def sizes() -> None:
    """Print the bytes of a case there and back."""
    scenario = pinarm.load(SCENARIO, FEW_ROWS)
    wanted = tuple(Wanted.read(text) for text in scenario.content.outputs)
    row = solve_case(Task.of(scenario, wanted), {"arguments.m_A": "0.1 kg"})
    rows = RowTable(np.tile(row.numbers, (CASES, 1)), row.files)
    jobs = CaseTable((Column("arguments.m_A", array("d", np.linspace(0.1, 0.5, CASES).tobytes()), "kg"),))
    there, back = (len(pickle.dumps(each)) / CASES for each in (jobs, rows))
    print(f"bytes: {there:.0f} a case there, {back:.0f} back")


def main() -> None:
    """Print all figures."""
    print(f"cores {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
    sizes()
    here()
    chunks(2)
    rests((1, 2, 4, 8))
    cases((1, 2, 4))
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
