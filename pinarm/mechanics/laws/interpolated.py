"""Laws through points, given in the scenario or in a CSV table."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, UnitError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Abscissa, Level, Rate, check_each, named_file
from pinarm.mechanics.laws.motion_law import FILE_KEYS, SECOND, MotionLaw, Piece, polynomial
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.input.csv_tables import MotionTable


HEADINGS = ("{}", "joint.{}.position", "coordinate.{}.position")
"""Headings of the column of a table that has the values of a coordinate."""


class PointLaw(MotionLaw, frozen=True, rename=FILE_KEYS):
    """A law through points.

    Attributes:
        points: Instants and values.
    """

    least: ClassVar[int] = 1
    """Number of points at least."""
    repeats: ClassVar[bool] = False
    """Whether two points may be at one place: a jump."""
    order: ClassVar[int] = 0
    """Of the derivative that the points give."""

    points: list[tuple[Abscissa, Level]]

    def check(self) -> None:
        check_ascending([t for t, _ in self.points], self.least, jumps=self.repeats)

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        super().check_units(of, along)
        for row, point in enumerate(self.points):
            with within("points", row):
                check_each(point, along, of / along if self.order else of)


class SpeedPoints(PointLaw, frozen=True, tag_field="law", tag="speed_points"):
    """Speed linear between points, constant before the first and after the last; the value at the first is ``from``.

    The acceleration jumps at every point.

    Attributes:
        points: Instants and speeds, such as ``[[0 s, 0 rpm], [2 s, 300 rpm]]``.
        start: Value at the first point, ``from`` in files.
    """

    order: ClassVar[int] = 1
    points: list[tuple[Abscissa, Rate]]
    start: Level = 0.0

    def pieces(self) -> Sequence[Piece]:
        (t, v), s = self.points[0], float(self.start)
        pieces = [Piece(-math.inf, t, polynomial(t, s, v))]
        for (t0, v0), (t1, v1) in pairwise(self.points):
            pieces.append(Piece(t0, t1, polynomial(t0, s, v0, (v1 - v0) / (t1 - t0) / 2)))
            s += (v0 + v1) / 2 * (t1 - t0)
        t, v = self.points[-1]
        return [*pieces, Piece(t, math.inf, polynomial(t, s, v))]


class Steps(PointLaw, frozen=True, tag_field="law", tag="steps"):
    """Piecewise constant values, such as of a motor that is switched on and off: for efforts and forces.

    Each value holds from its instant to the next; the first also before its instant, the last for all later times.
    """

    may_jump: ClassVar[bool] = True

    def pieces(self) -> Sequence[Piece]:
        bounds = [-math.inf, *(float(t) for t, _ in self.points[1:]), math.inf]
        levels = [polynomial(0.0, float(value)) for _, value in self.points]
        return [Piece(start, end, level) for (start, end), level in zip(pairwise(bounds), levels, strict=True)]


class PiecewiseLinear(PointLaw, frozen=True, tag_field="law", tag="piecewise_linear"):
    """Straight lines through points, for efforts and forces, such as a turning-moment diagram; constant beyond them.

    Two points at one place are a jump. Motions take a ``spline`` or ``speed_points``: their speed must not jump.

    Attributes:
        points: Instants, or places, and values, such as ``[[0 deg, 0 N*m], [90 deg, 40 N*m], [90 deg, -10 N*m]]``.
    """

    may_jump: ClassVar[bool] = True
    repeats: ClassVar[bool] = True

    def require_continuous(self, along: Unit = SECOND) -> None:
        refuse_corners(self.points[0][0], along)

    def pieces(self) -> Sequence[Piece]:
        points = np.array(self.points, float)
        return linear_pieces(points[:, 0], points[:, 1])


class Spline(PointLaw, frozen=True, tag_field="law", tag="spline"):
    """Cubic spline through points, s'' continuous inside, with given speeds at its ends; constant speed beyond them.

    Attributes:
        speeds: At the first and the last point, such as ``[0 rad/s, 2 rad/s]``; 0 by default.
    """

    least: ClassVar[int] = 2
    speeds: tuple[Rate, Rate] = (0.0, 0.0)

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        super().check_units(of, along)
        check_speeds(self.speeds, of / along)

    def pieces(self) -> Sequence[Piece]:
        points = np.array(self.points, float)
        return spline_pieces(points[:, 0], points[:, 1], self.speeds)

    @property
    def ends(self) -> tuple[float, float]:
        return float(self.points[0][0]), float(self.points[-1][0])


class Table(MotionLaw, frozen=True, tag_field="law", tag="table"):
    """The spline through the rows of a CSV file: a heading such as ``t [s],theta [deg]``, then two numbers a row.

    Columns whose headings have no unit are notes. Loads may be ``linear`` between the rows, as ``piecewise_linear``.

    Attributes:
        file: The table, relative to the file that names it.
        column: Name in the heading of the values, such as ``theta``; without it the table has two columns of numbers,
            and the second is not called like another coordinate.
        speeds: At the first and the last row, and beyond them, such as ``[0 rad/s, 2 rad/s]``; 0 by default, which
            distorts a motion that does not rest there.
        interpolation: ``spline``, or of loads ``linear``; two rows at one place are then a jump.
    """

    file: str
    column: str | None = None
    speeds: tuple[Rate, Rate] = (0.0, 0.0)
    interpolation: Literal["spline", "linear"] = "spline"

    def check(self) -> None:
        with within("file"):
            msgspec.structs.force_setattr(self, "file", str(named_file(self.file)))
            self._table  # noqa: B018  which reads it

    @property
    def _table(self) -> MotionTable:
        from pinarm.input.csv_tables import read_table

        return read_table(Path(self.file), self.column, jumps=self.interpolation == "linear")

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        table = self._table
        values = f"'{table.heading}'" if self.column else "2"
        for column, written, wanted in zip(("1", values), table.units, (along, of), strict=True):
            if written.dimension != wanted.dimension:
                with within("file"):
                    message = f"column {column} of the table {Path(self.file).name} is in {written}"
                    raise UnitError(message, expected=f"a unit such as {wanted}")
        check_speeds(self.speeds, of / along)

    def check_follower(self, name: str, names: Collection[str]) -> None:
        heading = self._table.heading
        meant = [other for other in names if other != name for form in HEADINGS if form.format(other) == heading]
        if self.column is None and meant:
            with within("file"):
                raise InputError(
                    f"the table {Path(self.file).name} has values of '{meant[0]}', another coordinate than '{name}'",
                    expected=f"a heading such as {name}",
                    hint=f"column: {heading}, if it is meant",
                )

    def require_continuous(self, along: Unit = SECOND) -> None:
        if self.interpolation == "linear":
            refuse_corners(self.ends[0], along)

    def pieces(self) -> Sequence[Piece]:
        times, values = map(np.array, self._table.columns)
        if self.interpolation == "linear":
            return linear_pieces(times, values)
        return spline_pieces(times, values, self.speeds)

    @property
    def may_jump(self) -> bool:
        return self.interpolation == "linear"

    @property
    def ends(self) -> tuple[float, float]:
        times = self._table.columns[0]
        return float(times[0]), float(times[-1])


class ClampedSpline(Record, frozen=True):
    """Cubic spline s(x) through points, s'' continuous inside, with given slopes at both ends.

    Between the knots k and k + 1, with ``u = x - x_k``, ``s = c0 + c1 u + c2 u² + c3 u³``.

    Attributes:
        knots: x_k, ascending, shape (n,).
        coefficients: c0, c1, c2 and c3 of every interval, shape (4, n - 1).
    """

    knots: Array
    coefficients: Array

    @classmethod
    def through(cls, x: Array, y: Array, slopes: tuple[float, float]) -> ClampedSpline:
        """Return the spline through points, two at least, x ascending; both of shape (n,)."""
        from scipy.interpolate import CubicSpline

        return cls(x, CubicSpline(x, y, bc_type=tuple((1, float(slope)) for slope in slopes)).c[::-1].copy())

    def __call__(self, x: Array) -> tuple[Array, Array, Array]:
        """Return s, s' and s'', each with the shape of x; beyond the ends, those of the first and the last cubic."""
        interval = self.knots[1:-1].searchsorted(x, side="right")
        u = x - self.knots[interval]
        c0, c1, c2, c3 = self.coefficients[:, interval]
        return ((c3 * u + c2) * u + c1) * u + c0, (3.0 * c3 * u + 2.0 * c2) * u + c1, 6.0 * c3 * u + 2.0 * c2


def spline_pieces(times: Array, values: Array, speeds: tuple[float, float]) -> list[Piece]:
    """Return a clamped cubic spline with constant speed before and after it."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            spline = ClampedSpline.through(times, values, speeds)
        if not np.isfinite(spline.coefficients).all():
            raise ValueError
    except ValueError:
        raise InputError(
            "the values change by more than 1e308 in a unit of what they are given over",
            expected="smaller values, or points further apart",
        ) from None
    first, last = float(times[0]), float(times[-1])
    return [
        Piece(-math.inf, first, polynomial(first, float(values[0]), float(speeds[0]))),
        Piece(first, last, spline, tuple(times[1:-1].tolist())),
        Piece(last, math.inf, polynomial(last, float(values[-1]), float(speeds[1]))),
    ]


def linear_pieces(x: Array, y: Array) -> list[Piece]:
    """Return straight lines through points, x ascending, and constants beyond them; a piece from jump to jump."""
    bounds = [0, *(np.flatnonzero(np.diff(x) == 0.0) + 1).tolist(), len(x)]
    pieces = [Piece(-math.inf, float(x[0]), polynomial(0.0, float(y[0])))]
    for first, end in pairwise(bounds):
        t, values = x[first:end], y[first:end]
        if len(t) > 1:
            slopes, none = np.diff(values) / np.diff(t), np.zeros(len(t) - 1)
            lines = ClampedSpline(t, np.array([values[:-1], slopes, none, none]))
            pieces.append(Piece(float(t[0]), float(t[-1]), lines, tuple(t[1:-1].tolist())))
    return [*pieces, Piece(float(x[-1]), math.inf, polynomial(0.0, float(y[-1])))]


def refuse_corners(first: float, along: Unit) -> None:
    """Refuse straight lines between points as a motion."""
    raise InputError(
        f"the speed jumps at the points, the first at {first:.6g} {along}: no body can follow",
        expected="spline, or speed_points; straight lines are for loads",
    )


def check_speeds(speeds: tuple[float, float], of: Unit) -> None:
    """Check the units of speeds."""
    with within("speeds"):
        check_each(speeds, of, of)


def check_ascending(times: Sequence[float], least: int, *, jumps: bool = False) -> None:
    """Raise where there are too few points, or their instants do not increase, or where jumps are allowed decrease."""
    if len(times) < least:
        raise InputError(f"{len(times)} points are too few", expected=f"at least {least}")
    for row, (before, after) in enumerate(pairwise(times)):
        if not (after > before or (jumps and after == before)):
            raise InputError(
                f"the points do not ascend: {before:g}, then {after:g} (point {row + 2})",
                expected="each further on than the one before",
            )
