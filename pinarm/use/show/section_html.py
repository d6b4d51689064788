"""A section of a result, as a notebook shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinarm.use.show.notebook import blocks, folded, heading, lines, picture, table
from pinarm.use.show.terminal import further_rows, table_rows

if TYPE_CHECKING:
    from pinarm.use.result.presentation import Presentation
    from pinarm.use.result.section import Section, SectionTable


def section_html(section: Section, how: Presentation) -> str:
    """Return the first table, remarks, other tables folded, and graphs; long tables by their first rows."""
    from pinarm.use.show.figure import figure
    from pinarm.use.show.plot import graph

    first = [_table(section, each) for each in section.tables[:1]]
    others = [folded(each.title, _table(section, each)) for each in section.tables[1:]]
    pictures = [picture(figure(graph(drawn, how))) for drawn in section.graphs]
    return blocks(heading(section.title), *first, lines(section.remarks), *others, *pictures)


def _table(section: Section, shown: SectionTable) -> str:
    return table(table_rows(shown)) + lines(further_rows(section, shown))
