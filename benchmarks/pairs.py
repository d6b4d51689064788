"""Processor time of every scenario, in pairs with another commit.

``python -m benchmarks.pairs COMMIT [NAME ...]`` keeps a process of this tree and one of COMMIT's, and lets them solve
the same scenarios in turn, so that both meet the same machine. It prints the ratio of the processor times of second
runs, the longest first, and ends with code 1 where one is above ``MOST`` and the run takes ``LONG`` or more.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from benchmarks.answers import ROOT, checkout, git

MOST = 1.5
"""Largest ratio that is not a loss: two rounds of the same tree differ by up to a third on a machine that is shared."""

LONG = 0.3
"""Processor time of a run from which on a user notices a loss [s]."""

WORKER = """
import sys, time, warnings
import pinarm
warnings.simplefilter("ignore")
for line in sys.stdin:
    seconds, begin = [], time.perf_counter()
    try:
        while len(seconds) < 3 or (len(seconds) < 7 and time.perf_counter() - begin < 3.0):
            start = time.process_time()
            pinarm.run(line.strip())
            seconds.append(time.process_time() - start)
        print(min(seconds[1:]), flush=True)
    except Exception as error:
        print(f"failed: {error}".splitlines()[0], flush=True)
"""

FAILED = "failed: "


class Pair(NamedTuple):
    """What a scenario takes with both trees [s], or why it has no answer."""

    name: str
    before: str
    after: str

    @property
    def ratio(self) -> float:
        return float(self.after) / float(self.before)

    @property
    def solved(self) -> bool:
        return not any(text.startswith(FAILED) for text in (self.before, self.after))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("commit", help="the reference")
    parser.add_argument("names", nargs="*", help="scenarios; all of them if left out")
    options = parser.parse_args()
    reference = checkout(git("rev-parse", "--short=12", f"{options.commit}^{{commit}}"))
    files = sorted(
        file for file in (reference / "scenarios").glob("*.yaml") if (ROOT / "scenarios" / file.name).exists()
    )
    workers = [started(reference), started(ROOT)]
    pairs = [
        Pair(file.stem, time_of(workers[0], file), time_of(workers[1], ROOT / "scenarios" / file.name))
        for file in files
        if not options.names or file.stem in options.names
    ]
    for pair in sorted((pair for pair in pairs if pair.solved), key=lambda pair: -pair.ratio):
        print(f"{pair.ratio:6.2f}  {pair.name}: {float(pair.after):.3f} s, reference {float(pair.before):.3f} s")
    for pair in (pair for pair in pairs if not pair.solved):
        print(f"     -  {pair.name}: {pair.after}; reference {pair.before}")
    return int(any(not pair.solved or (pair.ratio > MOST and float(pair.after) >= LONG) for pair in pairs))


def started(tree: Path) -> subprocess.Popen[str]:
    """Return a process that solves the files that it is sent with the package of a tree, and says what they take."""
    environment = os.environ | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        (sys.executable, "-c", WORKER),
        cwd=tree,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )


def time_of(worker: subprocess.Popen[str], file: Path) -> str:
    """Return the processor time of a scenario [s], or what went wrong."""
    assert worker.stdin and worker.stdout
    print(file, file=worker.stdin, flush=True)
    return worker.stdout.readline().strip()


if __name__ == "__main__":
    sys.exit(main())
