"""Chapter of a report on a sweep: what was varied, statistics, curves, failures, and the table of its cases."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from pinarm.engine.series import Series
from pinarm.language import in_language, said, told
from pinarm.use.report.chapter import Chapter, appendix, figure, provenance
from pinarm.use.report.given import problem_rows
from pinarm.use.show.document import ReportTable, number, part, rounded, sentences, unit_text, with_unit
from pinarm.use.study.sweep.plots import pictures
from pinarm.use.study.sweep.table import Sweep, ranges, remarks

MOST_CASES = 100
"""Cases of the table that are printed; ``cases.csv`` has all."""


@in_language
def chapter_on_sweep(sweep: Sweep, date: str) -> Chapter:
    """Return the chapter on a sweep."""
    (_, _, *columns), *rows = ranges(sweep)
    answers = [[name, unit_text(unit), *numbers] for name, unit, *numbers in rows]
    failed = (
        [said("{failed} of {count} cases failed.", failed=len(sweep.errors), count=len(sweep))] if sweep.errors else []
    )
    origin = {
        said("Scenario"): str(sweep.definition.get("scenario", sweep.name)),
        said("Cases"): str(len(sweep)),
    }
    parts = [
        sentences(failed, "box warnings"),
        part("Question", ReportTable([said("Given"), said("Of"), said("Value")], [*_question(sweep)], range(3))),
        part("Answers", ReportTable([said("Result"), said("unit"), *map(told, columns)], answers, range(2))),
        part("Curves", *(figure(drawn.svg()) for _, drawn in pictures(sweep))),
        part("Accuracy and notes", sentences(remarks(sweep))),
        appendix(part("Cases", _cases(sweep)), part("Provenance", provenance(origin, date))),
    ]  # fmt: skip
    return Chapter(
        sweep.title or sweep.name, said("Sweep over {count} cases", count=len(sweep)), "\n".join(filter(None, parts))
    )


def _question(sweep: Sweep) -> Iterator[tuple[str, str, str]]:
    """Yield the swept values, the sampling, the problem that was solved for each case, and its results."""
    for path, values in sweep.definition.get("over", {}).items():
        yield said("Swept"), str(path), ", ".join(map(str, values)) if isinstance(values, list) else str(values)
    drawn = {key: sweep.definition.get(key) for key in ("cases", "samples", "seed", "sampling")}
    kept = ("cases",) if not drawn["samples"] else tuple(drawn)
    yield from ((said(key.capitalize()), "", str(drawn[key])) for key in kept if drawn[key] is not None)
    base: dict[str, Any] = sweep.definition.get("base", {})
    yield from problem_rows(base.get("problem", {}))
    yield said("Asked for"), "", ", ".join(series.name for series in sweep.results())


def _cases(sweep: Sweep) -> ReportTable:
    """Return the table of the first cases, numbers in the units that people are shown."""
    shown = [*sweep.given, *map(sweep.presentation.shown, sweep.results())]
    count = min(len(sweep), MOST_CASES)
    given = len(sweep.given)
    rows = [
        [str(case), *(_cell(series, case, number if k < given else rounded) for k, series in enumerate(shown))]
        for case in range(count)
    ]
    more = said("and {more} more in cases.csv", more=len(sweep) - count) if len(sweep) > count else ""
    headings = [said("case"), *(with_unit(series.name, series.unit) for series in shown)]
    return ReportTable(headings, rows, (), remark=more)


def _cell(series: Series, case: int, form: Callable[[float], str]) -> str:
    value = series.values[case]
    return form(float(value)) if series.values.dtype.kind in "fiu" else str(value)
