"""From a URDF or xacro file to plain URDF text, safe for untrusted files.

xacro evaluates Python, reads any file and can be made to run for ever. So a private copy of it is loaded, separate from
the one a user may import, in which the functions that evaluate, read or recurse are replaced while a file is expanded:
expressions are the checked arithmetic of ``arithmetic``, only ``$(arg NAME)`` and ``$(find PACKAGE)`` are substituted,
included files lie under the root, and every step counts against a budget. Other files expand as with xacro.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, choices
from pinarm.input.roots import NO_PACKAGES, contained_file
from pinarm.input.xacro.expander import Expansion
from pinarm.input.xacro.expression_tape import CLOSE, OPEN, AnyColumn, Number, column, rows_of
from pinarm.input.xacro.templates import ExpandedColumns, Request, expanded, expanded_columns
from pinarm.input.xml_text import MAX_BYTES, MAX_TEXT, Survey, read


def expand(
    path: Path, arguments: Mapping[str, float | str], *, root: Path, packages: Mapping[str, Path] = NO_PACKAGES
) -> Expansion:
    """Expand a xacro file; a plain URDF file is checked and comes back as it is.

    Args:
        path: The file.
        arguments: Values of its ``xacro:arg``, in place of the defaults.
        root: Folder under which the file and what it includes must lie.
        packages: Names of packages -> folders, under which included files may lie too.

    Raises:
        ModelError: The model is malformed, does something that is not allowed, or is too large.
        UnknownArgument: It has no argument of a given name.
        InputError: A file is missing or lies elsewhere, or an expression is wrong.
    """
    source = str(path)
    path = contained_file(path.absolute(), root, packages)
    given = {name: _argument(name, value) for name, value in arguments.items()}
    if path.suffix != ".xacro":
        text = read(path, source, MAX_BYTES)
        if not Survey.of(text, source).is_xacro:
            check_declared(given, {})
            return Expansion(text, {})
    expansion = expanded(Request(path, source, root, packages, given))
    check_declared(given, expansion.arguments)
    return expansion


def expand_columns(
    path: Path, arguments: Mapping[str, float | str], columns: Mapping[str, Sequence[float] | Array], *, root: Path
) -> ExpandedColumns | None:
    """Expand a xacro file for columns of arguments; ``None`` where its expansion has not been recorded, or differs.

    Args:
        path: The file.
        arguments: Values of its ``xacro:arg`` in one row.
        columns: Those that vary, with their values in all rows.
        root: Folder under which the file and what it includes must lie.

    Raises:
        PinarmError: A file may not be read any more, or a number follows that cannot be computed.
    """
    path = contained_file(path.absolute(), root, NO_PACKAGES)
    given = {name: _argument(name, value) for name, value in arguments.items()}
    checked = {name: _column(name, values) for name, values in columns.items()}
    return expanded_columns(Request(path, str(path), root, NO_PACKAGES, given), checked)


def _argument(name: str, value: float | str) -> Number | str:
    plain = value if isinstance(value, str) else int(value) if isinstance(value, int) else float(value)
    text = str(plain)
    if text in ("nan", "inf", "-inf") or len(text) > MAX_TEXT or OPEN in text or CLOSE in text:
        raise InputError(f"the argument '{name}' is {text[:20]!r}", expected="a finite number or a short text")
    return plain


def _column(name: str, values: Sequence[float] | Array) -> AnyColumn:
    found = column(values)
    if isinstance(found, np.ndarray) and np.isfinite(found).all():
        return found
    return column(_argument(name, value) for value in rows_of(found))


class UnknownArgument(InputError):
    """An argument that a model does not have.

    Args:
        name: Its name.
        declared: The names that there are.
    """

    def __init__(self, name: str, declared: Iterable[str]) -> None:
        expected, hint = choices(name, declared, most=40)
        super().__init__(f"the model has no argument '{name}'", expected=expected, hint=hint)
        self.name = name


def check_declared(given: Iterable[str], declared: Mapping[str, object]) -> None:
    """Refuse names that are not among the arguments of a model.

    Raises:
        UnknownArgument: One is not.
    """
    for name in sorted(given):
        if name not in declared:
            raise UnknownArgument(name, declared)
