"""HTML for notebooks: tables, pictures, lines of text, sections, and a page in a frame of its own.

Pictures are in it as data and a replay is a whole page in a frame, so a saved notebook shows them offline. The types
that a notebook shows put their blocks together from these in ``_repr_html_``.
"""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinarm.use.show.terminal import further_rows, table_rows

if TYPE_CHECKING:
    from pinarm.use.result.presentation import Presentation
    from pinarm.use.result.section import Section, SectionTable
    from pinarm.use.show.picture import Picture


def blocks(*parts: str) -> str:
    """Return blocks of HTML below each other."""
    return f"<div>{''.join(f'<div>{part}</div>' for part in parts)}</div>"


def heading(text: str) -> str:
    """Return a line in bold."""
    return f'<div style="font-weight:600;margin:.4em 0">{html.escape(text)}</div>'


def table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first row is its heading, names and units to the left, numbers to the right."""

    def line(tag: str, row: Sequence[str]) -> str:
        sides = ["left", "left", *["right"] * (len(row) - 2)]
        cells = zip(sides, row, strict=True)
        return "".join(f'<{tag} style="text-align:{side}">{html.escape(text)}</{tag}>' for side, text in cells)

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows[1:])
    return f"<table><thead><tr>{line('th', rows[0])}</tr></thead><tbody>{body}</tbody></table>"


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
    return f"<details><summary>{html.escape(summary)}</summary>{part}</details>"


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
