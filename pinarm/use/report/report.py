"""The report: one document on results, as a page of HTML or as PDF, with everything in it."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, printable
from pinarm.language import document, in_language, said, spoken, told, writing
from pinarm.records import Record, replace
from pinarm.use.facade import Result
from pinarm.use.output import write_file
from pinarm.use.report.chapter import Chapter, appendix, chapter_on, keyless, problem_rows, provenance
from pinarm.use.show.text import (
    ReportTable,
    figure,
    frame,
    number,
    part,
    rounded,
    sentences,
    tag,
    text,
    unit_text,
    with_unit,
)
from pinarm.use.study.restore import restore
from pinarm.use.study.sweep.plots import pictures
from pinarm.use.study.sweep.table import Sweep, ranges, remarks, stored_sweep

STYLE = Path(__file__).parent / "report.css"
HTML, PDF = ".html", ".pdf"

IN_MARGIN = 90
"""Characters of the title that the margin of a page has room for."""

HEAD = """<!DOCTYPE html>
<html lang="LANGUAGE">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
"""

MOST_CASES = 100
"""Cases of the table of a sweep that are printed; ``cases.csv`` has all."""

READY = '<script>document.documentElement.dataset.ready = "yes";</script>'


class Report(Record, frozen=True):
    """A report on results.

    Attributes:
        title: Its heading.
        html: The page, with the replays; printed it is the PDF.
    """

    unshown = ("html",)

    title: str
    html: str

    def save(self, path: str | Path) -> Path:
        """Write it as a page (``.html``) or for print (``.pdf``, by Chromium), and return the file.

        Raises:
            InputError: The ending is another one, or the file cannot be written.
            PinarmError: There is no Chromium.
        """
        path = Path(path)
        raw = _printed(self.html) if kind_of(path) == PDF else self.html.encode()
        write_file(path, [raw])
        return path

    def _repr_html_(self) -> str:
        return frame(self.html, height=800)


def report(
    results: Result | Sweep | str | Path | Sequence[Result | Sweep | str | Path],
    path: str | Path | None = None,
    *,
    title: str = "",
    student: bool = False,
    equations: bool = False,
    lang: str = "",
) -> Report:
    """Return one document on results: question, answers and accuracy, mechanism, curves, sections, what was left out.

    Tables that few readers need are in an appendix. Of a sweep: what was varied, statistics, curves, cases.

    Args:
        results: A result or a sweep, or the folder that it was written to; or several, a chapter each.
        path: Where to write it, ``.html`` or ``.pdf``; nowhere where it is left out.
        title: Its heading; that of the first scenario where it is left out.
        student: Whether the answer key, ``expect``, is left out: values that are expected or published are neither
            printed nor drawn.
        equations: Whether the equations of the mechanism in letters are in it; they need SymPy.
        lang: Language, ``en`` or ``fr``; that of each scenario where it is left out.

    Raises:
        InputError: A folder is no result, or the ending of the file or the language is unknown.
        PinarmError: The file is a PDF and there is no Chromium, or a saved motion cannot be solved again.
    """
    sources = [results] if isinstance(results, Result | Sweep | str | Path) else list(results)
    moving = path is None or kind_of(Path(path)) == HTML
    date = time.strftime("%Y-%m-%d %H:%M %z")
    with writing(lang):
        chapters = [_chapter(source, date, moving, student, equations) for source in sources]
        if not chapters:
            raise InputError("there is no result to report on", expected="at least one")
        heading = title or chapters[0].title
        with document(chapters[0].language):
            written = Report(heading, _page(heading, _told_apart(chapters, sources), date))
    if path is not None:
        written.save(path)
    return written


def kind_of(path: Path) -> str:
    """Return the ending of a file that a report can be written to.

    Raises:
        InputError: It is another one.
    """
    if path.suffix not in (HTML, PDF):
        expected, hint = choices(path.suffix, [HTML, PDF])
        raise InputError(f"a report is not written as '{path.suffix}'", expected=expected, hint=hint)
    return path.suffix


def _chapter(source: Result | Sweep | str | Path, date: str, moving: bool, student: bool, equations: bool) -> Chapter:
    if not isinstance(source, Result | Sweep) and (Path(source) / "sweep.yaml").is_file():
        source = stored_sweep(Path(source))
    if isinstance(source, Sweep):
        return _chapter_on_sweep(source, date)
    folder, result = (None, source) if isinstance(source, Result) else (Path(source), restore(source))
    shown = keyless(result) if student else result
    return chapter_on(shown, folder, date, moving=moving, student=student, equations=equations)


@in_language
def _chapter_on_sweep(sweep: Sweep, date: str) -> Chapter:
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
        part("Curves", *(figure(drawn) for _, drawn in pictures(sweep))),
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


def _told_apart(chapters: Sequence[Chapter], sources: Sequence[Result | Sweep | str | Path]) -> list[Chapter]:
    """Return the chapters; of those with one title, with the folder of each result after it, or the scenario's name."""
    titles, named = Counter(chapter.title for chapter in chapters), []
    for chapter, source in zip(chapters, sources, strict=True):
        name = source.name if isinstance(source, Result | Sweep) else str(source)
        named.append(replace(chapter, title=f"{chapter.title} ({name})") if titles[chapter.title] > 1 else chapter)
    return named


def _page(title: str, chapters: Sequence[Chapter], date: str) -> str:
    several, entries, articles = len(chapters) > 1, list[str](), list[str]()
    for k, chapter in enumerate(chapters, 1):
        link, subtitle = f'<a href="#chapter-{k}">{text(chapter.title)}</a>', text(chapter.subtitle)
        entries.append(tag("li", f"{link} {tag('span', subtitle, 'subtitle')}"))
        heading = tag("h2", text(chapter.title)) + tag("p", subtitle, "subtitle") if several else ""
        articles.append(f'<article id="chapter-{k}">\n{heading}{chapter.body}\n</article>')
    top = tag("nav", tag("ol", "\n".join(entries))) if several else tag("p", text(chapters[0].subtitle), "subtitle")
    subject = said("Report on simulations") if several else said("Report on a simulation")
    line = tag("div", tag("span", subject) + tag("span", date), "line")
    margin = "".join(f"\\{ord(character):06x}" for character in printable(title[:IN_MARGIN]))
    style = tag("style", STYLE.read_text(encoding="utf-8").replace("MARGIN", margin))
    header = tag("header", f"{line}\n{tag('h1', text(title))}\n{top}")
    body = "\n".join([header, *articles, READY])
    head = HEAD.replace("LANGUAGE", spoken())
    return f"{head}{tag('title', text(title))}\n{style}\n</head>\n<body>\n{body}\n</body>\n</html>\n"


def _printed(html: str) -> bytes:
    from pinarm.use.show.replay.chromium import browser

    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        page.write_text(html, encoding="utf-8")
        shown.open(page)
        return shown.pdf()
