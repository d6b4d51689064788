"""The report: one document on results, as a page of HTML or as PDF, with everything in it."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pinarm.errors import InputError, choices, printable
from pinarm.records import replace
from pinarm.use.output.folder import write_file
from pinarm.use.report.chapter import Chapter, Origin, chapter, host_kind
from pinarm.use.result.result import Result
from pinarm.use.show.notebook import frame
from pinarm.use.store.restore import restore

FILES = Path(__file__).parent
HTML, PDF = ".html", ".pdf"
REPLAY_HEIGHT = 420
"""Of the moving picture [px]."""

IN_MARGIN = 90
"""Characters of the title that the margin of a page has room for."""


@dataclass(frozen=True)
class Report:
    """A report on results.

    Attributes:
        title: Its heading.
        html: The page, with the replays; printed it is the PDF.
    """

    title: str
    html: str = field(repr=False)

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
    results: Result | str | Path | Sequence[Result | str | Path], path: str | Path | None = None, *, title: str = ""
) -> Report:
    """Return one document on results: question, answers and accuracy, mechanism, curves, sections, what was left out.

    Args:
        results: A result, or the folder that it was written to; or several, a chapter each.
        path: Where to write it, ``.html`` or ``.pdf``; nowhere where it is left out.
        title: Its heading; that of the first scenario where it is left out.

    Raises:
        InputError: A folder is no result, the ending of the file is unknown, or Jinja2 is not installed.
        PinarmError: The file is a PDF and there is no Chromium, or a saved motion cannot be solved again.
    """
    sources = [results] if isinstance(results, Result | str | Path) else list(results)
    moving = path is None or kind_of(Path(path)) == HTML
    template = _template()
    chapters = [_chapter(source, moving) for source in sources]
    if not chapters:
        raise InputError("there is no result to report on", expected="at least one")
    heading = title or chapters[0].title
    document = Report(heading, _rendered(template, heading, _told_apart(chapters, sources)))
    if path is not None:
        document.save(path)
    return document


def kind_of(path: Path) -> str:
    """Return the ending of a file that a report can be written to.

    Raises:
        InputError: It is another one.
    """
    if path.suffix not in (HTML, PDF):
        expected, hint = choices(path.suffix, [HTML, PDF])
        raise InputError(f"a report is not written as '{path.suffix}'", expected=expected, hint=hint)
    return path.suffix


def _chapter(source: Result | str | Path, moving: bool) -> Chapter:
    if isinstance(source, Result):
        return chapter(source, Origin.of(source, None), moving=moving)
    result = restore(source)
    return chapter(result, Origin.of(result, Path(source)), moving=moving)


def _told_apart(chapters: Sequence[Chapter], sources: Sequence[Result | str | Path]) -> list[Chapter]:
    """Return the chapters; of those with one title, with the folder of each result after it, or the scenario's name."""
    titles = Counter(chapter.title for chapter in chapters)
    names = [source.name if isinstance(source, Result) else str(source) for source in sources]
    return [
        replace(chapter, title=f"{chapter.title} ({name})") if titles[chapter.title] > 1 else chapter
        for chapter, name in zip(chapters, names, strict=True)
    ]


def _template() -> Any:
    """Return the template; values are text, and never markup, unless they are marked as such.

    Raises:
        InputError: Jinja2 is not installed.
    """
    try:
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
    except ImportError:
        raise InputError("reports need Jinja2, which is not installed", hint="pip install 'pinarm[report]'") from None
    environment = Environment(
        loader=FileSystemLoader(FILES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=lambda value: printable(value) if type(value) is str else value,
    )  # fmt: skip
    return environment.get_template("report.html.jinja")


def _rendered(template: Any, title: str, chapters: Sequence[Chapter]) -> str:
    return str(template.render(
        title=title, chapters=chapters, style=(FILES / "report.css").read_text(encoding="utf-8"),
        margin=_css_text(title[:IN_MARGIN]),
        frames=[frame(chapter.replay, height=REPLAY_HEIGHT) for chapter in chapters],
        date=time.strftime("%Y-%m-%d %H:%M %z"), host=host_kind(), version=_version(),
    ))  # fmt: skip


def _version() -> str:
    import pinarm

    return pinarm.__version__


def _css_text(text: str) -> str:
    return "".join(f"\\{ord(character):06x}" for character in printable(text))


def _printed(html: str) -> bytes:
    from pinarm.use.show.replay.chromium import browser

    with browser() as shown, tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        page.write_text(html, encoding="utf-8")
        shown.open(page)
        return shown.pdf()
