"""Tables of the report, of texts as they are printed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from pinarm.input.units import Unit, printed


@dataclass(frozen=True)
class ReportTable:
    """A table as it is printed.

    Attributes:
        headings: Of its columns.
        rows: Its cells, row by row.
        texts: Columns, counted from 0, that hold texts; the others hold numbers, which stand to the right.
        title: Above it; none where it is empty.
        remark: Below it; none where it is empty.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]] = field(repr=False)
    texts: Collection[int] = range(1)
    title: str = ""
    remark: str = ""


def number(value: float) -> str:
    """Return a number with the digits that a terminal shows of it."""
    return f"{value + 0.0:.7g}"  # -0 becomes 0


def unit_text(unit: Unit | str | None) -> str:
    """Return a unit as it is printed: nothing for numbers without one, a question mark where it is not known."""
    text = "?" if unit is None else str(unit)
    return "" if text == "1" else printed(text)


def with_unit(name: str, unit: Unit | str | None) -> str:
    """Return a heading: a name, and its unit in brackets where it has one."""
    text = unit_text(unit)
    return f"{name} [{text}]" if text else name


def shortened(text: str, most: int) -> str:
    """Return a text of at most so many characters, with an ellipsis where some are left out."""
    return text if len(text) <= most else f"{text[: most - 1]}…"
