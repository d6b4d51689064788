"""Chapter of a report on one result: question, answers, mechanism, curves, sections, accuracy and provenance."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from pinarm.engine.series import Series
from pinarm.errors import PinarmError
from pinarm.problems import KINDS
from pinarm.records import ValueRecord, replace
from pinarm.use.report.given import link_graph, mobility_words, question
from pinarm.use.result.measures import CLOSURES, COSTS, MEASURES, PATHS, RESIDUALS
from pinarm.use.result.number_accuracy import global_error
from pinarm.use.result.numbers import read_number
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.document import ReportTable, part, rounded, sentences, tag, text, unit_text, with_unit
from pinarm.use.show.free_bodies import free_body_diagrams, worst_instants
from pinarm.use.show.mechanism_tables import mechanism_tables
from pinarm.use.show.notebook import frame
from pinarm.use.show.plot import graph, plot
from pinarm.use.show.sketch import sketch
from pinarm.use.show.terminal import FEW, accuracy_lines, counted, error_lines, ranges
from pinarm.use.study.answers.check import HEADING, finding_of
from pinarm.use.study.answers.check import remarks as verdict_remarks
from pinarm.use.study.answers.check import rows as verdict_rows

if TYPE_CHECKING:
    from pinarm.use.facade import Result
    from pinarm.use.result.section import Section, SectionTable

CURVES = 2
"""Quantities a picture: a page holds two pictures, and little room is lost where one does not fit."""

MOST_ROWS = 60
"""Rows of a section's first table that are printed; the file beside the result has all."""

FEW_ROWS = 24
"""Rows of its further tables, in the appendix."""

REPLAY_HEIGHT = 420
"""Of the moving picture [px]."""


class Chapter(ValueRecord, frozen=True):
    """A chapter on one result.

    Attributes:
        title: Of the scenario.
        subtitle: The mechanism, and the kind of problem.
        body: All that is below these, as HTML.
    """

    title: str
    subtitle: str
    body: str


def keyless(result: Result) -> Result:
    """Return a result without its answer key: nothing of ``expect`` is printed or drawn."""
    content = msgspec.structs.replace(result.content, expect=[])
    return replace(result, scenario=replace(result.scenario, content=content), known=result.sections)


def chapter_on(result: Result, folder: Path | None, date: str, *, moving: bool) -> Chapter:
    """Return the chapter on a result.

    Args:
        result: The result.
        folder: The folder that it was read from, which tells the versions that solved it.
        date: When the report is made.
        moving: Whether the replay is wanted, which paper does not show.

    Raises:
        PinarmError: The motion of a saved result cannot be solved again, which numbers between its rows need.
    """
    mechanism = result.trajectory.mechanism
    limits = [f"Limit: {excess.words(result.trajectory)}." for excess in result.excesses()]
    replay, unshown = _replay(result) if moving else ("", [])
    verdicts, missed = _verdicts(result)
    asked = KINDS[result.kind].question if result.kind in KINDS else ""
    links, along = link_graph(mechanism), result.trajectory.parameter
    tables = mechanism_tables(mechanism, result.presentation)
    left_out = ReportTable(["Joint", "how", "why"], [(x.joint, x.how, x.why) for x in result.removals], range(3))
    parts = [
        sentences([*_warnings(result), *missed, *limits], "box warnings"),
        sentences(_merits(result, verdicts, missed), "box merits"),
        part("Question", tag("p", text(asked), "asked"), question(result)),
        part("Answers", _ranges(result), _numbers(result), _findings(result)),
        part("Mechanism", figure(sketch(result, titled=False).svg(), "sketch"), tag("p", text(mobility_words(result)))),
        part("Motion and curves", replay, *map(figure, _curves(result))),
        *(_part(section, result.presentation) for section in result.shown_sections.values()),
        part("Free-body diagrams", *map(figure, _free_bodies(result))),
        part("Comparison with independent and published values", verdicts),
        part("Accuracy", sentences(error_lines(result)), sentences(accuracy_lines(result.figures, along))),
        part("What was left out, and notes", left_out, sentences([*counted(result.notes()), *unshown])),
        appendix(
            part("Mechanism in numbers", figure(links) if links else "", *tables),
            *(_further(section) for section in result.shown_sections.values()),
            part("Measures of accuracy", _accuracy(result)),
            part("Provenance", _provenance(result, folder, date)),
        ),
    ]
    title, subtitle = result.content.title or result.name, f"{mechanism.title}, {result.kind}"
    return Chapter(title, subtitle, "\n".join(filter(None, parts)))


def appendix(*parts: str) -> str:
    """Return what few readers need, after all else."""
    inner = "\n".join(filter(None, parts)).replace("h3>", "h4>")
    return tag("section", f"{tag('h3', 'Appendix')}\n{inner}", "appendix")


def figure(drawn: str, kind: str = "") -> str:
    """Return a picture as a figure of the page."""
    return tag("figure", drawn, kind)


def _warnings(result: Result) -> list[str]:
    """Return reasons not to use the numbers."""
    target = result.content.accuracy.target
    reasons = [f"The error of these numbers has no bound: {result.no_bound}."] if result.no_bound else []
    if result.missed:
        reasons.append(f"The accuracy that was wanted, {target:g}, is not reached.")
    if result.error is None and "evaluations" in result.figures:
        reasons.append("The global error of this motion was not estimated; the residuals below do not bound it.")
    return reasons


def _merits(result: Result, verdicts: ReportTable, missed: Sequence[str]) -> Iterator[str]:
    """Yield the checks that the numbers passed."""
    if result.error is not None and isfinite(result.error) and not result.no_bound:
        bound = f"{result.error:.1e} of their largest values, in 99 of 100 cases"
        yield f"The global error of all outputs is below {bound}."
    if verdicts.rows and not missed:
        yield f"All {len(verdicts.rows)} entries of the answer key are met."


def _ranges(result: Result) -> ReportTable:
    """Return the ranges of the outputs, as the terminal shows them, with the bound of each one's error."""
    (_, _, *columns), *rows = ranges(result, rounded)
    run, remark = result.trajectory, ""
    headings = ["Quantity" if run.numbered else f"Quantity, at {len(run)} rows", "unit"]
    headings += [with_unit(name, run.unit) if name == f"at {run.parameter}" else name for name in columns]
    cells = [[name, unit_text(unit), *numbers] for name, unit, *numbers in rows]
    if result.errors:
        headings.append("error")
        bounds = [_bound(result.errors.get(series.name)) for series in result.columns()[1:]]
        cells = [[*row, bound] for row, bound in zip(cells, bounds, strict=True)]
        largest = "relative to the largest value of the quantity, in 99 of 100 cases"
        remark = f"error: bound of the global error {largest}"
    return ReportTable(headings, cells, range(2), remark=remark)


def _bound(error: float | None) -> str:
    return "" if error is None else f"{error:.1e}" if isfinite(error) else "unknown"


def _numbers(result: Result) -> ReportTable:
    rows = []
    for name, (series, error) in result.numbers().items():
        shown, (scale, _) = result.presentation.shown(series), result.presentation.scale(series)
        bound = global_error(result, read_number(name))
        bounds = [_bound(bound and bound * scale)] if result.errors else []
        value = [unit_text(shown.unit), rounded(float(shown.values[0])), f"{error * scale:.1e}" if error else "0"]
        rows.append([name, *value, *bounds])
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


def _free_bodies(result: Result) -> Iterator[str]:
    for at in worst_instants(result).values():
        yield free_body_diagrams(result, at, titled=False).svg()


def _further(section: Section) -> str:
    """Return the tables of a section after its first, for the appendix."""
    return part(section.title, *(_section_table(table, section.key, FEW_ROWS) for table in section.tables[1:]))


def _part(section: Section, how: Presentation) -> str:
    """Return the numbers, first table, remarks and pictures of a section."""
    tables = [_section_table(table, section.key) for table in section.tables]
    printed = {cell for table in tables for row in table.rows for cell in row}
    numbers = {name: how.shown(series) for name, series in section.numbers.items()}
    others = {name: series for name, series in numbers.items() if _cell(series) not in printed}
    rows = [[name, unit_text(series.unit), _cell(series)] for name, series in others.items()]
    more = ReportTable(["Number", "unit", "value"], rows, range(2))
    pictures = [figure(graph(drawn, how).svg()) for drawn in section.graphs]
    return part(section.title, more, *tables[:1], sentences(section.remarks), *pictures)


def _cell(series: Series) -> str:
    return rounded(float(series.values[0]))


def _section_table(table: SectionTable, key: str, most: int = MOST_ROWS) -> ReportTable:
    cleared = table.cleared().rows[:most]
    rows = [[cell if isinstance(cell, str) else rounded(cell) for cell in row] for row in cleared]
    if table.row_unit is not None:
        for row in rows:
            row[table.row_unit] = unit_text(row[table.row_unit])
    texts = {k for row in table.rows for k, cell in enumerate(row) if isinstance(cell, str) and cell}
    more = len(table.rows) - most
    remark = f"and {more} more rows in {key}_{table.name}.csv" if more > 0 else ""
    headings = zip(table.columns, table.units, strict=True)
    named = [name if unit is None else with_unit(name, unit) for name, unit in headings]
    return ReportTable(named, rows, texts, table.title, remark)


def _verdicts(result: Result) -> tuple[ReportTable, list[str]]:
    """Return the answer key, compared, and the misses in it, a sentence each."""
    heading = ["Verdict", "quantity", *HEADING[4:], "source"]
    if not result.content.expect:
        return ReportTable(heading, []), []
    findings, rows = [finding_of(result, expectation) for expectation in result.content.expect], []
    for (verdict, _, quantity, at, *rest), finding in zip(verdict_rows(findings), findings, strict=True):
        name = quantity if at == "all rows" else f"{quantity} @ {at}"
        rows.append([verdict, name, *rest, finding.expectation.source])
    *misses, counts = verdict_remarks(findings)
    remark = f"{counts}. Of many rows, the one that is farthest off is shown; the difference is relative."
    return ReportTable(heading, rows, range(len(heading)), remark=remark), misses


def _accuracy(result: Result) -> ReportTable:
    """Return the measures of accuracy of a run, and their meanings."""
    few, rows = {**RESIDUALS, **CLOSURES, **PATHS}, []
    for name, value in result.figures.items():
        if name in MEASURES:
            rows.append([name, f"{value:.1e}" if name in few else f"{value:.6g}", MEASURES[name]])
    rows += [[name, f"{value:.0f}", "cost"] for name, value in result.figures.items() if name in COSTS]
    return ReportTable(["Figure", "value", "meaning"], rows, range(3))


def _provenance(result: Result, folder: Path | None, date: str) -> str:
    """Return scenario, versions and digest of a result, those of a saved one as its folder has them; not this host."""
    summary = msgspec.json.decode((folder / "summary.json").read_bytes()) if folder else result.summary()
    versions = ", ".join(f"{name} {version}" for name, version in dict(summary.get("versions", {})).items())
    entries = {
        "Scenario": f"{result.name}, {len(result)} rows",
        "Solved with": versions,
        "SHA-256 of the input": str(summary.get("input", "")),
    }
    return provenance(entries, date)


def provenance(entries: Mapping[str, str], date: str) -> str:
    """Return what a result came of, and what made the report."""
    import pinarm

    host = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    entries = {**entries, "Report made with": f"pinarm {pinarm.__version__}, on {host}, {date}"}
    return tag("dl", "\n".join(tag("dt", text(term)) + tag("dd", text(words)) for term, words in entries.items()))


def _replay(result: Result) -> tuple[str, list[str]]:
    """Return the replay in a frame and nothing, or nothing and why there is none."""
    try:
        page = result.replay(plots=()).html
    except PinarmError as error:
        return "", [f"no replay: {error.message}"]
    return tag("div", frame(page, height=REPLAY_HEIGHT), "replay"), []
