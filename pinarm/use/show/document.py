"""Parts of a report as HTML: tables, sentences and figures. Texts are never markup."""

from __future__ import annotations

import html
from collections.abc import Collection, Iterable, Sequence

from pinarm.errors import printable
from pinarm.input.units import Unit, printed
from pinarm.language import decimals, told
from pinarm.records import ValueRecord

WHOLE, SENTENCE = 20, 40
"""Letters of a cell up to which it stays on one line, and from which it is wide."""

SHORT, DENSE = 12, 9
"""Rows of a table up to which it stays on one page, and columns from which its letters are small."""


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
