"""Costs of distribution: of a chunk of jobs that do nothing, and of cases that are given out and written down.

Run with ``python -m benchmarks.distribution``; it starts a scheduler of Dask and workers on loopback.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pinarm
from pinarm.use.workers import dispatch
from pinarm.use.workers.dispatch import Dispatch, Workers, chosen_workers

SCENARIO = Path(__file__).parents[1] / "scenarios" / "gen411_arm_static.yaml"
FEW_ROWS = {"problem.over.phi.samples": 5}
CHUNKS, CASES = 500, 20_000


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


def chunk_times(workers: Workers) -> tuple[float, float]:
    """Return the time of a chunk of one job, once workers run, and the processor time of it here [s]."""
    with patch.object(dispatch, "GROWTH", 1), closing(Dispatch(abs, workers)) as chunks:
        answers = (answer for _, some in chunks.answers([0.0] * CHUNKS) for answer in some)
        first = len(list(islice(answers, 4 * workers.room())))
        begin, cpu = time.perf_counter(), time.process_time()
        left = sum(1 for _ in answers)
        assert first + left == CHUNKS
        return (time.perf_counter() - begin) / left, (time.process_time() - cpu) / left


def main() -> None:
    """Print all figures."""
    print(f"cores {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
    for number in (1, 2):
        with dask(number) as cluster:
            for name, executor in (("processes", None), ("Dask", cluster)):
                wall, cpu = chunk_times(chosen_workers(number, executor))
                print(f"chunk, {number} workers, {name:9s} {1e3 * wall:6.2f} ms, of which here {1e3 * cpu:.2f} ms")
                with tempfile.TemporaryDirectory() as folder:
                    begin, cpu = time.perf_counter(), time.process_time()
                    over = {"arguments.m_A": f"0.1:0.5:{CASES} kg"}
                    pinarm.sweep(SCENARIO, over, values=FEW_ROWS, workers=number, executor=executor, folder=folder)
                    wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
                print(
                    f"cases, {number} workers, {name:9s} {CASES / wall:6.0f} a second, {1e6 * cpu / CASES:.0f} us here"
                )


if __name__ == "__main__":
    main()
