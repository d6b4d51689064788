"""What holds to which accuracy at the extremes: ``python tests/extremes/table.py`` solves all cases and writes a table.

With ``--quick`` only the cases of every test, half a minute: their rows are replaced in the table. Exits with 1 where a
case is wrong. All cases take about half an hour; three motions over 1e5 periods most of it.
"""

from __future__ import annotations

import sys
import tempfile
from itertools import groupby
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "loops"))  # as pytest does

from cases import CASES
from extreme import Case, Outcome

DOCUMENT = Path(__file__).parents[2] / "benchmarks" / "results" / "extremes.md"

HEAD = """# What holds at the extremes

Written by `python tests/extremes/table.py`. Every case is held to its tolerance by `tests/extremes`, or refused for the
reason that is listed there. Errors are relative to the largest value, or in rad. References solve no equation of the
program's.
"""


def outcomes(cases: list[Case]) -> dict[Case, Outcome]:
    """Solve cases, each in a folder of its own."""
    found = {}
    for case in cases:
        with tempfile.TemporaryDirectory() as folder:
            found[case] = Outcome.of(case, Path(folder))
        print(f"{found[case].verdict(case):8s} {case.area}: {case.name}", file=sys.stderr)
    return found


def text(found: dict[Case, Outcome]) -> str:
    """Return the tables, one for each area."""
    parts = [HEAD]
    for area, cases in groupby(found, key=lambda case: case.area):
        parts.append(f"\n## {area.capitalize()}\n\n| case | reference | error | tolerance | because | verdict |\n"
                     "| --- | --- | --- | --- | --- | --- |\n")  # fmt: skip
        parts += [_row(case, found[case]) for case in cases]
    return "".join(parts)


def with_rows(document: str, found: dict[Case, Outcome]) -> str:
    """Return the document with the rows of some cases replaced."""
    rows = {case.name: _row(case, outcome) for case, outcome in found.items()}
    lines = document.splitlines(keepends=True)
    return "".join(rows.get(line.strip("| ").partition(" |")[0], line) for line in lines)


def _row(case: Case, outcome: Outcome) -> str:
    verdict = outcome.verdict(case)
    shown = (f"{outcome.error:.1e}", f"{case.tolerance:.0e}") if not outcome.refusal else ("", "")
    because = outcome.refusal or case.reason
    return f"| {case.name} | {case.reference} | {shown[0]} | {shown[1]} | {because} | {verdict} |\n"


def main() -> int:
    """Solve the cases and show them."""
    quick = "--quick" in sys.argv[1:]
    found = outcomes([case for case in CASES if case.when == "fast" or not quick])
    DOCUMENT.write_text(with_rows(DOCUMENT.read_text(), found) if quick else text(found))
    return int(any(outcome.verdict(case) == "WRONG" for case, outcome in found.items()))


if __name__ == "__main__":
    sys.exit(main())
