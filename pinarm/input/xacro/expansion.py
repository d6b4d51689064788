"""From a URDF or xacro file to plain URDF text, safe for untrusted files; for columns of arguments at once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import InputError, choices
from pinarm.input.roots import contained_file
from pinarm.input.xacro.columns import CLOSE, OPEN, AnyColumn, Column, NotByRows, Rows, column, joined
from pinarm.input.xacro.expander import Expander, Expansion
from pinarm.input.xml_text import MAX_BYTES, MAX_TEXT, read, tree_of
from pinarm.records import ValueRecord


class UnknownArgument(InputError):
    """An argument ``name`` that a model does not have."""

    def __init__(self, name: str, declared: Iterable[str]) -> None:
        expected, hint = choices(name, declared, most=40)
        super().__init__(f"the model has no argument '{name}'", expected=expected, hint=hint)
        self.name = name


class ExpandedColumns(ValueRecord, frozen=True):
    """An expansion for columns of numbers.

    Attributes:
        xml: The model, with words for the numbers that vary.
        columns: These words, with the numbers or texts in their place.
        arguments: Every ``xacro:arg``: its text, or its texts, floats in the place of what Python writes for them.
    """

    xml: str
    columns: Mapping[str, AnyColumn]
    arguments: Mapping[str, str | AnyColumn]
    holds: Flags


def expand(path: Path, arguments: Mapping[str, float | str], *, root: Path) -> Expansion:
    """Expand a xacro file; a plain URDF file is checked and comes back as it is.

    Args:
        arguments: Values of its ``xacro:arg``, in place of the defaults.
        root: Folder under which the file and what it includes must lie.
    """
    texts = {name: _argument(name, value) for name, value in arguments.items()}
    file, source = contained_file(path.absolute(), root), str(path)
    if file.suffix != ".xacro":
        text = read(file, source, MAX_BYTES)
        if not _is_xacro(tree_of(text, source), text):
            check_declared(arguments, {})
            return Expansion(text, {})
    expansion = Expander(root, texts).run(file, source)
    check_declared(arguments, expansion.arguments)
    return expansion


def expand_columns(
    path: Path, arguments: Mapping[str, float | str], columns: Mapping[str, Sequence[float] | Array], *, root: Path
) -> ExpandedColumns | None:
    """Expand a xacro file for columns of arguments; ``None`` where its expansion cannot be followed for many rows.

    Args:
        arguments: Values of its ``xacro:arg`` in the first row.
        columns: Those that vary, with their values in all rows.
        root: Folder under which the file and what it includes must lie.
    """
    rows = Rows(len(next(iter(columns.values()))))
    texts = {name: _argument(name, value) for name, value in arguments.items()}
    texts |= {name: str(Column(rows, _column(name, values))) for name, values in columns.items()}
    try:
        expansion = Expander(root, texts, rows).run(contained_file(path.absolute(), root), str(path))
    except NotByRows:
        return None
    pieces, used = rows.parts(expansion.xml)
    words = {varied.place: f"column_{varied.place}_of_{len(rows.marked)}" for varied in used}
    xml = joined(pieces, (words[varied.place] for varied in used))
    told = {name: _told(text, rows) for name, text in expansion.arguments.items()}
    return ExpandedColumns(xml, {words[varied.place]: varied.values for varied in used}, told, rows.holds)


def _told(text: str, rows: Rows) -> str | AnyColumn:
    """Return the text of an argument, or its texts in all rows."""
    if OPEN not in text:
        return text
    values = rows.lifted(text).values
    return values if values.dtype == np.float64 else column(map(str, values.tolist()))


def check_declared(names: Iterable[str], declared: Mapping[str, object]) -> None:
    """Refuse names that are not among the arguments of a model."""
    for name in sorted(names):
        if name not in declared:
            raise UnknownArgument(name, declared)


def _is_xacro(root: ElementTree.Element, text: str) -> bool:
    """Return whether a model contains anything of xacro; files written by xacro declare its namespace, no more."""
    has_expressions = "$" in text or "&#" in text
    return any(
        element.tag.startswith("xacro:") or any(_is_of_xacro(name, has_expressions) for name in element.attrib)
        for element in root.iter()
    )


def _is_of_xacro(name: str, has_expressions: bool) -> bool:
    return name.startswith("xacro:") or (has_expressions and name == "xmlns:xacro")


def _argument(name: str, value: float | str) -> str:
    plain: Any = value if isinstance(value, str) else int(value) if isinstance(value, int) else float(value)
    text = str(plain)
    if text in ("nan", "inf", "-inf") or len(text) > MAX_TEXT or OPEN in text or CLOSE in text:
        raise InputError(f"the argument '{name}' is {text[:20]!r}", expected="a finite number or a short text")
    return text


def _column(name: str, values: Sequence[float] | Array) -> AnyColumn:
    numbers = column(values)
    if numbers.dtype == np.float64 and np.isfinite(numbers).all():
        return numbers
    return column(_checked(name, numbers.tolist()))


def _checked(name: str, values: Iterable[Any]) -> Iterator[float | int]:
    for value in values:
        if not math.isfinite(float(_argument(name, value))):
            raise InputError(f"the argument '{name}' is {value!r}", expected="finite numbers")
        yield int(value) if isinstance(value, int) else float(value)
