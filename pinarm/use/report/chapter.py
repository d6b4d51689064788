"""Chapter of a report on one result: texts, tables and pictures."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from pinarm.engine.series import Series
from pinarm.errors import PinarmError
from pinarm.problems import KINDS
from pinarm.use.report.link_graph import LinkGraph, link_graph
from pinarm.use.report.mechanism_tables import mechanism_tables, mobility_words
from pinarm.use.report.question import question
from pinarm.use.report.tables import ReportTable, number, unit_text, with_unit
from pinarm.use.result.measures import CLOSURES, COSTS, MEASURES, PATHS, RESIDUALS
from pinarm.use.result.number_accuracy import global_error
from pinarm.use.result.presentation import Presentation
from pinarm.use.result.section_number import read_number
from pinarm.use.show.plot import graph, plot
from pinarm.use.show.sketch import sketch
from pinarm.use.show.terminal import FEW, error_lines, ranges
from pinarm.use.study.answers.check import finding_of
from pinarm.use.study.answers.verdict_table import HEADING
from pinarm.use.study.answers.verdict_table import remarks as verdict_remarks
from pinarm.use.study.answers.verdict_table import rows as verdict_rows

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Section, SectionTable

CURVES = 2
"""Quantities a picture: a page holds two pictures, and little room is lost where one does not fit."""

MOST_ROWS = 60
"""Rows of a section's table that are printed; the file beside the result has all."""


@dataclass(frozen=True)
class Origin:
    """Origin of a result.

    Attributes:
        scenario: Name of the scenario.
        versions: Of the packages that solved it.
        digest: Hash of the input: see ``Result.digest``.
        rows: Number of rows of its table.
    """

    scenario: str
    versions: Mapping[str, str]
    digest: str
    rows: int

    @classmethod
    def of(cls, result: Result, folder: Path | None) -> Origin:
        """Return the origin of a result; that of a saved one is read from its folder."""
        summary = msgspec.json.decode((folder / "summary.json").read_bytes()) if folder else result.summary()
        versions = {str(name): str(version) for name, version in dict(summary.get("versions", {})).items()}
        return cls(result.name, versions, str(summary.get("input", "")), len(result))


def host_kind() -> str:
    """Return system, processor and Python of this machine; not its name."""
    return f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"


@dataclass(frozen=True)
class Part:
    """A section of a result, as it is printed.

    Attributes:
        title: Its heading.
        tables: Its tables.
        remarks: What to know, a sentence each.
        pictures: Its graphs as SVG.
    """

    title: str
    tables: Sequence[ReportTable]
    remarks: Sequence[str]
    pictures: Sequence[str] = field(repr=False)


@dataclass(frozen=True)
class Chapter:
    """A chapter on one result.

    Attributes:
        title: Of the scenario.
        subtitle: The mechanism, and the kind of problem.
        asked: The question in a sentence.
        question: What is given and asked.
        warnings: Reasons not to use the numbers, or to use them with care.
        merits: Checks that the numbers passed.
        answers: Ranges of the outputs, and numbers of the run.
        sketch: The positions at start and end, as SVG.
        mobility: How the mechanism can move, in a sentence.
        graph: Its graph of links; ``None`` where it has too many.
        mechanism: Its bodies, joints, loops, forces and drives.
        curves: The outputs over the parameter, as SVG.
        parts: Sections of the result.
        verdicts: The answer key, compared; ``None`` where there is none.
        accuracy: Measures of accuracy.
        error: Sentences on the global error.
        left_out: Joints that were not solved for.
        notes: Effects that are not modelled, doubts, and limits that are passed.
        origin: Versions and digest.
        replay: The page of the moving picture; empty where there is none.
    """

    title: str
    subtitle: str
    asked: str
    question: ReportTable
    warnings: Sequence[str]
    merits: Sequence[str]
    answers: Sequence[ReportTable]
    sketch: str = field(repr=False)
    mobility: str
    graph: LinkGraph | None
    mechanism: Sequence[ReportTable]
    curves: Sequence[str] = field(repr=False)
    parts: Sequence[Part]
    verdicts: ReportTable | None
    accuracy: ReportTable
    error: Sequence[str]
    left_out: ReportTable
    notes: Sequence[str]
    origin: Origin
    replay: str = field(repr=False)


def chapter(result: Result, origin: Origin, *, moving: bool) -> Chapter:
    """Return the chapter on a result.

    Args:
        result: The result.
        origin: Its origin.
        moving: Whether the replay is wanted, which paper does not show.

    Raises:
        PinarmError: The motion of a saved result cannot be solved again, which numbers between its rows need.
    """
    mechanism = result.trajectory.mechanism
    limits = [f"Limit: {excess.words(result.trajectory)}." for excess in result.excesses()]
    replay, unshown = _replay(result) if moving else ("", [])
    verdicts, missed = _verdicts(result)
    return Chapter(
        title=result.content.title or result.name,
        subtitle=f"{mechanism.title}, {result.kind}",
        asked=KINDS[result.kind].question if result.kind in KINDS else "",
        question=question(result),
        warnings=[*_warnings(result), *missed, *limits],
        merits=_merits(result, verdicts, missed),
        answers=[table for table in (_ranges(result), _numbers(result), _findings(result)) if table.rows],
        sketch=sketch(result, titled=False).svg(),
        mobility=mobility_words(result),
        graph=link_graph(mechanism),
        mechanism=mechanism_tables(mechanism),
        curves=list(_curves(result)),
        parts=[_part(section, result.presentation) for section in result.shown_sections.values()],
        verdicts=verdicts,
        accuracy=_accuracy(result),
        error=error_lines(result),
        left_out=ReportTable(["Joint", "how", "why"], [(x.joint, x.how, x.why) for x in result.removals], range(3)),
        notes=[*result.notes(), *unshown],
        origin=origin,
        replay=replay,
    )


def _warnings(result: Result) -> list[str]:
    """Return reasons not to use the numbers."""
    target = result.content.accuracy.target
    reasons = [f"The error of these numbers has no bound: {result.no_bound}."] if result.no_bound else []
    if result.missed:
        reasons.append(f"The accuracy that was wanted, {target:g}, is not reached.")
    if result.error is None and "evaluations" in result.figures:
        reasons.append("The global error of this motion was not estimated; the residuals below do not bound it.")
    return reasons


def _merits(result: Result, verdicts: ReportTable | None, missed: Sequence[str]) -> list[str]:
    """Return the checks that the numbers passed."""
    checks = []
    if result.error is not None and isfinite(result.error) and not result.no_bound:
        bound = f"{result.error:.1e} of their largest values, in 99 of 100 cases"
        checks.append(f"The global error of all outputs is below {bound}.")
    if verdicts is not None and not missed:
        checks.append(f"All {len(verdicts.rows)} entries of the answer key are met.")
    return checks


def _ranges(result: Result) -> ReportTable:
    """Return the ranges of the outputs, as the terminal shows them, with the bound of each one's error."""
    heading, *rows = ranges(result)
    run = result.trajectory
    names = [with_unit(text, run.unit) if text == f"at {run.parameter}" else text for text in heading[2:]]
    own = [[name, unit_text(unit), *numbers] for name, unit, *numbers in rows]
    first = "Quantity" if run.numbered else f"Quantity, at {len(run)} rows"
    if not result.errors:
        return ReportTable([first, "unit", *names], own, range(2))
    bounds = [_bound(result.errors.get(series.name)) for series in result.columns()[1:]]
    return ReportTable(
        [first, "unit", *names, "error"], [[*row, bound] for row, bound in zip(own, bounds, strict=True)],
        range(2),
        remark="error: bound of the global error relative to the largest value of the quantity, in 99 of 100 cases",
    )  # fmt: skip


def _bound(error: float | None) -> str:
    return "" if error is None else f"{error:.1e}" if isfinite(error) else "unknown"


def _numbers(result: Result) -> ReportTable:
    rows = []
    for text, (series, error) in result.numbers().items():
        shown, (scale, _) = result.presentation.shown(series), result.presentation.scale(series)
        bound = global_error(result, read_number(text))
        bounds = [
            f"{error * scale:.1e}" if error else "0",
            *([_bound(bound and bound * scale)] if result.errors else ()),
        ]
        rows.append([text, unit_text(shown.unit), number(float(shown.values[0])), *bounds])
    errors = ["quadrature error", *(["error below, in 99 of 100 cases"] if result.errors else ())]
    return ReportTable(["Number of the run", "unit", "value", *errors], rows, range(2))


def _findings(result: Result) -> ReportTable:
    """Return the figures that the problem found, such as values that were sought."""
    rows = [[name, f"{value:.9g}"] for name, value in result.figures.items() if name not in (*MEASURES, *COSTS)]
    return ReportTable(["Found", "value"], rows)


def _curves(result: Result) -> Iterator[str]:
    """Yield the outputs over the parameter, a few to a picture; nothing where the answers show every row."""
    if len(result) < 2 or (result.trajectory.numbered and len(result) <= FEW):
        return
    names = [series.name for series in result.columns()[1:]]
    for first in range(0, len(names), CURVES):
        yield plot(result, tuple(names[first : first + CURVES]), titled=False).svg()


def _part(section: Section, how: Presentation) -> Part:
    tables = [_section_table(table, section.key) for table in section.tables]
    printed = {cell for table in tables for row in table.rows for cell in row}
    others = {name: series for name, series in section.numbers.items() if _cell(series) not in printed}
    rows = [[name, unit_text(series.unit), _cell(series)] for name, series in others.items()]
    more = [ReportTable(["Number", "unit", "value"], rows, range(2))] if rows else []
    return Part(section.title, [*more, *tables], section.remarks, [graph(drawn, how).svg() for drawn in section.graphs])


def _cell(series: Series) -> str:
    return number(float(series.values[0]))


def _section_table(table: SectionTable, key: str) -> ReportTable:
    """Return a table of a section."""
    rows = [[cell if isinstance(cell, str) else number(cell) for cell in row] for row in table.rows[:MOST_ROWS]]
    if table.row_unit is not None:
        for row in rows:
            row[table.row_unit] = unit_text(row[table.row_unit])
    texts = {k for row in table.rows for k, cell in enumerate(row) if isinstance(cell, str) and cell}
    more = len(table.rows) - MOST_ROWS
    remark = f"and {more} more rows in {key}_{table.name}.csv" if more > 0 else ""
    headings = zip(table.columns, table.units, strict=True)
    named = [name if unit is None else with_unit(name, unit) for name, unit in headings]
    return ReportTable(named, rows, texts, table.title, remark)


def _verdicts(result: Result) -> tuple[ReportTable | None, list[str]]:
    """Return the answer key, compared, and the misses in it, a sentence each."""
    if not result.content.expect:
        return None, []
    findings = [finding_of(result, expectation) for expectation in result.content.expect]
    rows = [[quantity if at == "all rows" else f"{quantity} @ {at}", *rest, finding.expectation.source]
            for (_, quantity, at, *rest), finding in zip(verdict_rows(findings), findings, strict=True)]  # fmt: skip
    *misses, counts = verdict_remarks(findings)
    heading = ["Quantity", *HEADING[3:], "source"]
    remark = f"{counts}. Of many rows, the one that is farthest off is shown; the difference is relative."
    return ReportTable(heading, rows, range(len(heading)), remark=remark), misses


def _accuracy(result: Result) -> ReportTable:
    """Return the measures of accuracy of a run, and their meanings."""
    few = {**RESIDUALS, **CLOSURES, **PATHS}
    rows = [[name, f"{value:.1e}" if name in few else f"{value:.6g}", MEASURES[name]]
            for name, value in result.figures.items() if name in MEASURES]  # fmt: skip
    rows += [[name, f"{value:.0f}", "cost"] for name, value in result.figures.items() if name in COSTS]
    return ReportTable(["Figure", "value", "meaning"], rows, range(3))


def _replay(result: Result) -> tuple[str, list[str]]:
    """Return the page of the replay and nothing, or nothing and why there is none."""
    try:
        return result.replay(plots=()).html, []
    except PinarmError as error:
        return "", [f"no replay: {error.message}"]
