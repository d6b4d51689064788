"""Run the race: ``python -m benchmarks.race``; with ``--quick`` a short one.

An interrupted race goes on: problems that have a result in ``results/race`` are not run again, but with ``--fresh``.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from benchmarks.race import plot, report, variants
from benchmarks.race.problems import problems
from benchmarks.race.race import FULL, QUICK, run

ROOT = Path(__file__).parents[2]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.race", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="about 6 minutes; the page goes to results/race/quick")
    parser.add_argument("--only", metavar="NAME,...", help=f"some of {', '.join(problems())}")
    parser.add_argument("--fresh", action="store_true", help="forget what was done before")
    parser.add_argument("--page", action="store_true", help="run nothing: write the page of what was done before")
    arguments = parser.parse_args()
    kept = ROOT / "results" / "race" / ("quick" if arguments.quick else "full")
    names = arguments.only.split(",") if arguments.only else list(problems())
    if unknown := set(names) - set(problems()):
        parser.error(f"no problem is called {', '.join(sorted(unknown))}")
    if arguments.fresh:
        for name in names:
            (kept / f"{name}.json").unlink(missing_ok=True)
    if not arguments.page:
        run([problems()[name] for name in names], QUICK if arguments.quick else FULL, kept)
    results, folder = report.load(kept), kept if arguments.quick else ROOT / "benchmarks" / "results"
    command = f"python -m benchmarks.race{' --quick' if arguments.quick else ''}"
    page = report.page(results, command, plot.save(results, folder))
    (folder / "race.md").write_text(page + variants.section(kept))
    print(f"written to {os.path.relpath(folder / 'race.md')}")


if __name__ == "__main__":
    main()
