"""What is shown of findings: a table of computed, independent and published numbers, and the verdict on each."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from pinarm.errors import printable
from pinarm.input.units import Unit, read_quantity
from pinarm.use.result.expectation import ERRATA, Expectation

if TYPE_CHECKING:
    from pinarm.use.study.answers.check import Finding

HEADING = ("verdict", "scenario", "quantity", "at", "computed", "independent", "published", "difference")
LOOKS = {"agrees": ("= agrees", "green"), "rounding": ("~ rounding", "cyan"), "reading": ("~ reading", "cyan"),
         "misprint": ("! misprint", "bold yellow"), "model_error": ("! model error", "bold yellow"),
         "MISS": ("X MISS", "bold red")}  # fmt: skip
"""Verdicts: how they are written, and their colour."""

WIDE = 200
"""Letters of a line where it is not a terminal's."""


def verdicts(findings: Sequence[Finding], *, coloured: bool = False) -> str:
    """Return the table of findings, why some are a miss, and how many there are of each, as text.

    Args:
        findings: What came out.
        coloured: For a terminal, whose width is kept.
    """
    if not findings:
        return remarks(findings)[0]
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    drawn = Table(*HEADING)
    for row, finding in zip(rows(findings), findings, strict=True):
        if row[1] and drawn.rows:
            drawn.add_section()
        drawn.add_row(Text(row[0], style=LOOKS[finding.verdict][1]), *map(Text, row[1:]))
    text = io.StringIO()
    Console(file=text, width=None if coloured else WIDE, force_terminal=coloured, highlight=False).print(drawn)
    return text.getvalue() + "\n".join(remarks(findings))


def rows(findings: Sequence[Finding]) -> list[list[str]]:
    """Return a row for every finding, with the cells that ``HEADING`` names; a scenario is named once."""
    found, previous = [], ""
    for finding in findings:
        entry, unit = finding.expectation, finding.shown_in or finding.unit
        independent = _shown(finding.independent, unit, entry) if entry.value is not None else entry.formula or ""
        cells = (
            LOOKS[finding.verdict][0], finding.scenario if finding.scenario != previous else "", entry.quantity,
            _where(entry.at), _shown(finding.computed, unit, entry), independent,
            entry.published or entry.published_formula or "", "" if finding.error is None else f"{finding.error:.1e}",
        )  # fmt: skip
        found.append([_clip(printable(cell)) for cell in cells])
        previous = finding.scenario
    return found


def remarks(findings: Sequence[Finding]) -> list[str]:
    """Return why findings are a miss, and how many there are of each verdict."""
    lines = [printable(miss_text(finding)) for finding in findings if not finding.ok]
    return [*lines, "; ".join(said for verdict in LOOKS if (said := _counted(findings, verdict))) or "nothing to check"]


def miss_text(finding: Finding) -> str:
    """Return what was found and expected of a miss: where, both numbers, their difference and what was allowed."""
    entry, unit = finding.expectation, finding.shown_in or finding.unit
    where = f" at {finding.where}" if finding.where else ""
    numbers = [f"computed {_shown(finding.computed, unit, entry)}"] if isfinite(finding.computed) else []
    if finding.independent is not None:
        numbers.append(f"expected {_shown(finding.independent, unit, entry)}")
    if finding.published is not None:
        numbers.append(f"published {_shown(finding.published, unit, entry)}")
    return f"MISS {finding.scenario}: {entry.quantity}{where}: {', '.join([*numbers, finding.reason])}"


def errata(findings: Iterable[Finding], verdict: str) -> int:
    """Return how many misprints, or model errors, there are: those that entries give one name count once."""
    alike = [finding.expectation.erratum for finding in findings if finding.verdict == verdict]
    return alike.count("") + len({name for name in alike if name})


def _counted(findings: Sequence[Finding], verdict: str) -> str:
    """Return how many findings of a verdict there are, and of how many errata they are; empty for none."""
    count, words = sum(finding.verdict == verdict for finding in findings), verdict.replace("_", " ")
    different = errata(findings, verdict) if verdict in ERRATA else count
    if different < count:
        return f"{different} {words} in {count} entries"
    return f"{count} {words}" if count else ""


def plain(finding: Finding) -> dict[str, Any]:
    """Return a finding as plain data."""
    entry = finding.expectation
    return {
        "scenario": finding.scenario, "quantity": entry.quantity, "at": entry.at, "unit": str(finding.unit or "?"),
        "computed": finding.computed, "independent": finding.independent, "published": entry.published,
        "where": finding.where, "difference": finding.error, "allowed": finding.allowed, "verdict": finding.verdict,
        "erratum": entry.erratum, "reason": finding.reason, "source": entry.source, "note": entry.note,
    }  # fmt: skip


def _where(at: object) -> str:
    if isinstance(at, dict):
        return " ".join(str(value) if key == "side" else f"{key}={value}" for key, value in at.items())
    return "all rows" if at == "all" else str(at)


def _clip(text: str) -> str:
    return text if len(text) <= 44 else f"{text[:41]}..."


def _shown(value: float | None, measured: Unit | None, entry: Expectation) -> str:
    """Return a number in the unit of the published one, else in SI."""
    if value is None:
        return ""
    printed = read_quantity(entry.published)[1] if entry.published else None
    measured = printed or measured
    factor = measured.factor if measured else 1.0
    return f"{value / factor:.9g}" if str(measured or "1") == "1" else f"{value / factor:.9g} {measured}"
