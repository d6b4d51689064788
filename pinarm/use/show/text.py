"""Texts of results: summaries and tables for the terminal, and HTML for reports and notebooks.

A notebook shows reports, replays in a frame, and what else a terminal prints: a saved one shows them offline. Texts are
never markup.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from math import isfinite, isnan
from typing import TYPE_CHECKING

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import printable
from pinarm.input.units import Unit, printed
from pinarm.language import decimals, said, told, writing
from pinarm.problems.simplification import removal_lines
from pinarm.records import ValueRecord
from pinarm.use.result.measures import (
    CLOSURES,
    CONSISTENCIES,
    COSTS,
    MEASURES,
    NOT_ESTIMATED,
    PATHS,
    RESIDUALS,
    SOLVED,
    singularity_words,
)

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Section
    from pinarm.use.show.picture import Picture

MOST_ROWS = 12
"""Rows of a section's table that a terminal shows."""

OF_ROWS = "min and max are those of the rows, @ min and @ max look between them"
"""Remark on the ranges: extremes between rows are missing; ``numbers`` find them."""

FEW = 6
"""Rows that are shown side by side."""


def report(result: Result) -> str:
    """Return the summary of a run as text: ranges of the outputs with units, accuracy, cost."""
    with writing("en"):
        sections = [line for section in result.shown_sections.values() for line in section_lines(section)]
        head = printable(result.content.title or result.name)
        return "\n".join([head, *aligned(ranges(result)), *sections, *remarks(result)])


def seven_digits(value: float) -> str:
    """Return a number as terminals show it."""
    return f"{value + 0.0:.7g}"  # -0 becomes 0


def ranges(result: Result, written: Callable[[float], str] = seven_digits) -> list[list[str]]:
    """Return a heading and the range of every output; of a few separate rows, all values.

    Args:
        result: The run.
        written: Writes a number. An output that is 0 but for rounding is 0.
    """
    from pinarm.use.result.number_accuracy import rounded_to_zero

    zeros = rounded_to_zero(result)
    run, presentation = result.trajectory, result.presentation
    outputs = [presentation.shown(series) for series in result.columns()[1:]]
    names = [_heading(presentation.label(series.name), series.unit) for series in outputs]
    if run.numbered and len(run) <= FEW:
        rows = [["", said("unit"), *(said("row {number}", number=f"{number:g}") for number in run.grid.t)]]
        for name, series in zip(names, outputs, strict=True):
            values = np.zeros(len(run)) if series.name in zeros else series.values
            rows.append([*name, *map(written, values)])
        return rows
    along = presentation.unit(result.parameter)
    factor = along.factor if along is not None else 1.0
    at = said("at {place}", place=run.parameter) + (f" [{along}]" if factor != 1.0 else "")
    rows = [["", said("unit"), "min", at, "max", at]]
    for name, series in zip(names, outputs, strict=True):
        entry = result.headline(series)
        ends = (0.0, 0.0) if series.name in zeros else without_rounding(entry["min"], entry["max"])
        numbers = (ends[0], entry["at_min"] / factor, ends[1], entry["at_max"] / factor)
        rows.append([*name, *map(written, numbers)])
    return rows


def without_rounding(least: float, largest: float) -> tuple[float, float]:
    """Return the ends of a range, and 0 for an end that is rounding of the other one.

    A range that is small as a whole is left: its source of rounding is not known here.
    """
    level = SOLVED * max((abs(end) for end in (least, largest) if isfinite(end)), default=0.0)
    return (0.0 if abs(least) <= level else least), (0.0 if abs(largest) <= level else largest)


def section_lines(section: Section) -> list[str]:
    """Return a section as text: its first table, and its remarks."""
    lines = [printable(section.title)]
    for table in section.tables[:1]:
        rows = table.cleared().rows[:MOST_ROWS]
        cells = [[cell if isinstance(cell, str) else f"{cell:.7g}" for cell in row] for row in rows]
        lines += aligned([table.headings(), *cells]) if len(table.columns) > 1 else [row[0] for row in cells]
        more = len(table.rows) - MOST_ROWS
        lines += [f"and {more} more rows in {section.key}_{table.name}.csv"] if more > 0 else []
    return [*lines, *(printable(f"{section.key}: {remark}") for remark in section.remarks)]


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines of cells of equal width: names and units, which come first, to the left, numbers to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(text.ljust(w) if k < 2 else text.rjust(w) for k, (text, w) in enumerate(cells)).rstrip()
        for cells in (list(zip(row, widths, strict=True)) for row in rows)
    ]


def remarks(result: Result) -> list[str]:
    """Return the remarks on a run, a line each: accuracy, cost, findings, limits, notes."""
    run = result.trajectory
    lines = _number_lines(result)
    lines += error_lines(result) + accuracy_lines(result.figures, run.parameter)
    cost = [f"{int(value)} {name}" for name, value in result.figures.items() if name in COSTS]
    about = [", ".join(cost), "" if run.numbered else OF_ROWS]
    lines.append("; ".join(filter(None, [f"rows: {len(run)}", *about])))
    lines += [f"{name}: {value:.9g}" for name, value in result.figures.items() if name not in (*MEASURES, *COSTS)]
    lines += event_lines(result)
    lines += [
        f"payload {name}: {float(payload.mass):.9g} kg at {payload.point}"
        for name, payload in run.mechanism.payloads.items()
    ]
    lines += removal_lines(result.removals)
    lines += [f"limit: {excess.words(run)}" for excess in result.excesses()]
    lines += [f"note: {note}" for note in counted(result.notes())]
    return [printable(line) for line in lines]


def counted(notes: Sequence[str]) -> list[str]:
    """Return notes, of those that differ in numbers alone the first with their count; ``summary.json`` has all."""
    alike: dict[str, list[str]] = {}
    for note in notes:
        alike.setdefault(re.sub(r"(?<![\w.])[-+]?\d[\d.]*(e[-+]?\d+)?", "0", note), []).append(note)
    return [
        told(first) + (said(" (and {count} more like it)", count=len(more)) if more else "")
        for first, *more in alike.values()
    ]


def event_lines(result: Result) -> list[str]:
    """Return the times of the scenario's events, a line each."""
    lines = []
    for name in getattr(result.scenario.problem, "events", {}):
        times = [event.t for event in result.events if event.name == name and event.before is None]
        often = f", and {len(times) - 1} more, the last at t = {times[-1]:.7g} s" if len(times) > 1 else ""
        lines.append(f"event {name}: t = {times[0]:.7g} s{often}" if times else f"event {name}: does not take place")
    return lines


def _number_lines(result: Result) -> list[str]:
    return [
        _number_line(series, result.presentation.shown(series), error, result.number_errors.get(series.name))
        for series, error in result.numbers().values()
    ]


def _number_line(series: Series, shown: Series, left: float, bound: float | None) -> str:
    value, unit = float(shown.values[0]), str(shown.unit or "?")
    if isnan(value):  # an event that does not take place
        return f"{series.name}: no value in this run"
    scale = series.unit.factor / shown.unit.factor if series.unit and shown.unit else 1.0
    known = f" (known to {left * scale:.1e})" if left else ""
    error = (
        known if bound is None else f" (error below {bound * scale:.1e})" if isfinite(bound) else (" (error unknown)")
    )
    return f"{series.name}: {value:.7g} {'' if unit == '1' else unit}".rstrip() + error


def error_lines(result: Result) -> list[str]:
    """Return the global error, its growth, and whether it is below its target, a line each."""
    if result.error is None:
        integrated = "evaluations" in result.figures
        return [f"global error: {NOT_ESTIMATED}; residuals do not bound it, --verify does"] if integrated else []
    target = result.content.accuracy.target
    worst = max(result.errors, key=lambda name: result.errors[name])
    where = f", largest in {worst}" if len(result.errors) > 1 else ""
    bound = f"below {result.error:.1e} of the largest value in 99 of 100 cases{where}"
    lines = [f"global error: {bound if isfinite(result.error) else 'no bound'} ({result.setting})"]
    lines += [f"no bound of the error: {result.no_bound}"] if result.no_bound else []
    verdict = "MISSED" if result.missed else "reached"
    return lines + ([f"target {target:g}: {verdict}"] if target is not None else [])


def accuracy_lines(figures: Mapping[str, float], parameter: str) -> list[str]:
    """Return the measures of accuracy, a line for each kind."""
    residuals, gaps, path, rows = (
        said(", ").join(f"{said(name)} {decimals(f'{figures[name]:.1e}')}" for name in names if name in figures)
        for names in (RESIDUALS, CLOSURES, PATHS, CONSISTENCIES)
    )
    lines = [f"accuracy: relative residuals: {residuals}"] if residuals else []
    lines += [f"loops [m or rad, s]: {gaps}"] if gaps else []
    lines += [f"prescribed coordinates [m or rad, s]: {path}"] if path else []
    lines += [f"given rows, relative: {rows}"] if rows else []
    if words := singularity_words(figures):
        lines.append(
            f"regularity: {words}, at {parameter} = {figures['least regular at']:.6g}; 0 at a singular position"
        )
    return lines + ([f"condition of the masses: {figures['condition']:.2g}"] if "condition" in figures else [])


def _heading(label: str, measured: Unit | None) -> tuple[str, str]:
    return printable(label)[:48], str(measured or "?")


WHOLE, SENTENCE = 20, 40
"""Letters of a cell up to which it stays on one line, and from which it is wide."""

SHORT, DENSE = 12, 9
"""Rows of a table up to which it stays on one page, and columns from which its letters are small."""


MARKS = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#x27;"})


def escaped(words: str) -> str:
    """Return a text for HTML, as ``html.escape`` does, whose module a run does not import."""
    return words.translate(MARKS)


def lines(words: str) -> str:
    """Return a text that a terminal prints, with its lines and columns."""
    return f'<pre style="background:none">{escaped(words)}</pre>'


def figure(drawn: Picture, kind: str = "") -> str:
    """Return a picture as a figure of the page."""
    return tag("figure", drawn.svg(), kind)


def frame(page: str, *, height: int) -> str:
    """Return a page within the page, as wide as there is room; it starts when it comes into sight."""
    style = f"width:100%;height:{height}px;border:1px solid #d9dee3;border-radius:4px"
    return f'<iframe loading="lazy" srcdoc="{escaped(page)}" style="{style}"></iframe>'


def section_html(section: Section) -> str:
    """Return a section as text, and its graphs."""
    from pinarm.use.show.picture import graph

    words = lines("\n".join(section_lines(section)))
    return "".join([words, *(figure(graph(drawn)) for drawn in section.graphs)])


class ReportTable(ValueRecord, frozen=True):
    """A table of texts.

    Attributes:
        headings: Of its columns.
        rows: Its cells, row by row.
        texts: Columns, counted from 0, that hold texts; the others hold numbers, to the right.
        title: Above it; none where it is empty.
        remark: Below it; none where it is empty.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    texts: Collection[int] = range(1)
    title: str = ""
    remark: str = ""

    def html(self) -> str:
        """Return it as HTML; nothing where it has no rows."""
        if not self.rows:
            return ""
        look = ("short" if len(self.rows) <= SHORT else "") + (" dense" if len(self.headings) > DENSE else "")
        title = tag("caption", text(told(self.title))) if self.title else ""
        head = tag("thead", tag("tr", self._cells("th", self.headings)))
        body = tag("tbody", "".join(tag("tr", self._cells("td", row)) for row in self.rows))
        remark = tag("p", text(told(self.remark)), "remark") if self.remark else ""
        return tag("div", tag("table", title + head + body, look), "wide") + remark

    def _cells(self, name: str, cells: Iterable[str]) -> str:
        drawn = []
        for k, entry in enumerate(cells):
            cell = entry if k in self.texts else decimals(entry)
            wide = " sentence" if len(cell) > SENTENCE else " whole" if len(cell) <= WHOLE else ""
            drawn.append(tag(name, text(cell), ("text" if k in self.texts else "number") + wide))
        return "".join(drawn)


def tag(name: str, content: str, kind: str = "") -> str:
    """Return an element of HTML with its class."""
    return f'<{name} class="{kind}">{content}</{name}>' if kind else f"<{name}>{content}</{name}>"


def text(value: str) -> str:
    """Return a text for HTML."""
    return escaped(printable(value))


def sentences(texts: Iterable[str], kind: str = "plain") -> str:
    """Return sentences as a list, in the language of the document; nothing where there are none."""
    items = "".join(tag("li", text(told(sentence))) for sentence in texts)
    return tag("ul", items, kind) if items else ""


def part(title: str, *blocks: str | ReportTable) -> str:
    """Return a heading, in the language of the document, with what belongs below it; nothing where that is empty."""
    content = "\n".join(block.html() if isinstance(block, ReportTable) else block for block in blocks)
    return f"{tag('h3', text(told(title)))}\n{content}" if content.strip() else ""


def rounded(value: float) -> str:
    """Return a result with four digits; whole parts of up to six digits are not cut."""
    return f"{value:.0f}" if 999.5 <= abs(value) < 999999.5 else decimals(f"{value + 0.0:.4g}")


def number(value: float) -> str:
    """Return a given number with the digits that a terminal shows of it."""
    return decimals(f"{value + 0.0:.7g}")  # -0 becomes 0


def unit_text(unit: Unit | str | None) -> str:
    """Return a unit as it is printed: nothing for numbers without one, a question mark where it is not known."""
    name = "?" if unit is None else str(unit)
    return "" if name == "1" else printed(name)


def with_unit(name: str, unit: Unit | str | None) -> str:
    """Return a heading: a name, and its unit in brackets where it has one."""
    measured = unit_text(unit)
    return f"{name} [{measured}]" if measured else name


def shortened(words: str, most: int) -> str:
    """Return a text of at most so many characters, with an ellipsis where some are left out."""
    return words if len(words) <= most else f"{words[: most - 1]}…"
