"""HTML for notebooks and reports: tables, pictures, lines of text, sections, and a page in a frame of its own.

Pictures are in it as data and a replay is a whole page in a frame, so a saved notebook shows them offline. The types
that a notebook shows put their blocks together from these in ``_repr_html_``. Texts are never markup.
"""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from pinarm.errors import printable
from pinarm.input.units import Unit, printed
from pinarm.language import decimals, told
from pinarm.records import ValueRecord
from pinarm.use.show.terminal import further_rows, table_rows

if TYPE_CHECKING:
    from pinarm.use.result.presentation import Presentation
    from pinarm.use.result.section import Section, SectionTable
    from pinarm.use.show.picture import Picture


WHOLE, SENTENCE = 20, 40
"""Letters of a cell up to which it stays on one line, and from which it is wide."""

SHORT, DENSE = 12, 9
"""Rows of a table up to which it stays on one page, and columns from which its letters are small."""


def blocks(*parts: str) -> str:
    """Return blocks of HTML below each other."""
    return f"<div>{''.join(f'<div>{part}</div>' for part in parts)}</div>"


def heading(words: str) -> str:
    """Return a line in bold."""
    return f'<div style="font-weight:600;margin:.4em 0">{html.escape(words)}</div>'


def table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first row is its heading, names and units to the left, numbers to the right."""

    def line(name: str, row: Sequence[str]) -> str:
        sides = ["left", "left", *["right"] * (len(row) - 2)]
        cells = zip(sides, map(html.escape, row), strict=True)
        return tag("tr", "".join(f'<{name} style="text-align:{side}">{cell}</{name}>' for side, cell in cells))

    body = tag("tbody", "".join(line("td", row) for row in rows[1:]))
    return tag("table", tag("thead", line("th", rows[0])) + body)


def lines(texts: Sequence[str]) -> str:
    """Return lines of text, as they stand."""
    style = "font-size:90%;opacity:.8;white-space:pre-wrap;background:none;padding:0;margin:.6em 0"
    return f'<pre style="{style}">{html.escape(chr(10).join(texts))}</pre>'


def picture(figure: Picture) -> str:
    """Return a figure as an image that carries its own data."""
    data, size = figure._repr_png_()
    style = f"flex:0 1 {size['width']}px;min-width:0;max-width:min(100%, {size['width']}px)"
    return f'<img alt="plots" style="{style}" src="data:image/png;base64,{b64encode(data).decode()}">'


def side_by_side(*parts: str) -> str:
    """Return blocks beside each other, smaller where there is no room."""
    return f'<div style="display:flex;align-items:flex-start">{"".join(parts)}</div>'


def folded(summary: str, part: str) -> str:
    """Return a block that a click on its summary opens."""
    return tag("details", tag("summary", html.escape(summary)) + part)


def frame(page: str, *, height: int) -> str:
    """Return a page within the page, as wide as there is room; it starts when it comes into sight."""
    style = f"width:100%;height:{height}px;border:1px solid #d9dee3;border-radius:4px"
    return f'<iframe loading="lazy" srcdoc="{html.escape(page)}" style="{style}"></iframe>'


def section_html(section: Section, how: Presentation) -> str:
    """Return the first table, remarks, other tables folded, and graphs; long tables by their first rows."""
    from pinarm.use.show.plot import graph

    first = [_table(section, shown) for shown in section.tables[:1]]
    others = [folded(shown.title, _table(section, shown)) for shown in section.tables[1:]]
    pictures = [picture(graph(drawn, how)) for drawn in section.graphs]
    return blocks(heading(section.title), *first, lines(section.remarks), *others, *pictures)


def _table(section: Section, shown: SectionTable) -> str:
    return table(table_rows(shown)) + lines(further_rows(section, shown))


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
    return html.escape(printable(value))


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
