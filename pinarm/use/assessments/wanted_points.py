"""Points of a wanted path, from a file or from lists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, Location, PinarmError, within
from pinarm.input.csv_tables import split_heading, table
from pinarm.input.numbers import decimal
from pinarm.input.roots import contained_file, root_of
from pinarm.input.units import unit
from pinarm.input.yaml.schema import current_folder

AXES = ("x", "y", "z")

MOST = 10_000
"""Points of a path at most."""


def read_points(wanted: Mapping[str, Sequence[float]] | str) -> tuple[list[str], Array]:
    """Return the axes of the points, and their coordinates [m], shape (n, axes).

    Args:
        wanted: Coordinates by axis [m], or a CSV file with the columns ``x [mm]`` and so on.

    Raises:
        InputError: An axis is unknown, lists have different lengths, or the file is no table of points; located.
    """
    columns = _columns(wanted) if isinstance(wanted, str) else {name: list(map(float, x)) for name, x in wanted.items()}
    for name in columns:
        if name not in AXES:
            with within(name):
                raise InputError(f"'{name}' is no axis", expected="x, y or z")
    lengths = {name: len(values) for name, values in columns.items()}
    if not columns or len(set(lengths.values())) > 1:
        counts = ", ".join(f"{count} of {name}" for name, count in lengths.items()) or "none"
        raise InputError(
            f"points need as many coordinates along every axis, and there are {counts}",
            expected="such as {x: [20 mm, 25 mm], y: [0 mm, 5 mm]}",
        )
    axes = [axis for axis in AXES if axis in columns]
    return axes, np.array([columns[axis] for axis in axes]).T


def _columns(name: str) -> dict[str, list[float]]:
    """Return the columns of a CSV file of points [m]."""
    folder = current_folder() or Path(name).absolute().parent
    path = contained_file((folder / name).absolute(), root_of(folder))
    heads, below = table(path, path.name)
    lines = list(below)
    if not 1 <= len(lines) <= MOST:
        raise InputError(f"the file {path.name} has {len(lines)} points", expected=f"1 to {MOST}")
    columns: dict[str, list[float]] = {}
    for place, cell in enumerate(heads):
        heading = split_heading(cell)
        axis, written = heading or (cell, None)
        if axis in AXES:
            factor = _factor(axis, written, Location(path.name, 1, 1, cell))
            columns[axis] = [factor * _number(row, place, Location(path.name, line)) for line, row in lines]
    if not columns:
        raise InputError(f"the file {path.name} has no column of points", expected="headings such as x [mm], y [mm]")
    return columns


def _factor(axis: str, written: str | None, place: Location) -> float:
    try:
        measured = unit(written or "")
    except PinarmError as error:
        raise error.at(place) from None
    if written is None or measured.dimension != unit("m").dimension:
        raise InputError(f"the column '{axis}' has no unit of a length", expected=f"{axis} [mm]").at(place)
    return measured.factor


def _number(row: Sequence[str], place: int, line: Location) -> float:
    cell = row[place] if place < len(row) else ""
    try:
        value = decimal(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"'{cell[:40]}' is no number", expected="a coordinate in every column").at(line)
    return value
