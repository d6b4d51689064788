"""Laws composed of other laws, and the union of all laws."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Abscissa, Extent, InputStruct, Level, check_unit
from pinarm.mechanics.laws.elementary import (
    Constant,
    ConstantAcceleration,
    ConstantSpeed,
    Cycloidal,
    Harmonic,
    Polynomial,
    SCurve,
    Trapezoid,
)
from pinarm.mechanics.laws.interpolated import PiecewiseLinear, SpeedPoints, Spline, Steps, Table
from pinarm.mechanics.laws.motion_law import FILE_KEYS, SECOND, MotionLaw, Piece, Values, polynomial


class Segment(InputStruct, frozen=True):
    """A law over a limited time.

    Attributes:
        duration: Duration [s].
        motion: The law, in its own time that begins at 0.
    """

    duration: Extent
    motion: Law


class Succession(MotionLaw, frozen=True, tag_field="law", tag="succession", rename=FILE_KEYS):
    """Laws end to end; value and speed are continuous where one takes over from another.

    A law whose own value begins at 0 is shifted to the value reached before it; any other law, and a constant, must
    begin at that value. After the last law the speed stays constant.

    Attributes:
        segments: The laws, each with its duration.
        start: Initial value, such as ``30 deg``; that of the first law where it is left out.
        begin: Time at which the first law begins [s], such as ``0.5 s``.
    """

    segments: Annotated[list[Segment], msgspec.Meta(min_length=1)]
    start: Level | None = None
    begin: Abscissa = 0.0

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        super().check_units(of, along)
        for row, segment in enumerate(self.segments):
            with within("segments", row, "duration"):
                check_unit(segment.duration, along)
            with within("segments", row, "motion"):
                segment.motion.check_units(of, along)

    def check_follower(self, name: str, names: Collection[str]) -> None:
        for row, segment in enumerate(self.segments):
            with within("segments", row, "motion"):
                segment.motion.check_follower(name, names)

    def check(self) -> None:
        """Refuse laws with a jump of value or speed between them."""
        self.pieces()

    def pieces(self) -> Sequence[Piece]:
        t, v, now = float(self.begin), 0.0, np.array([0.0])
        first = self.segments[0].motion.smooth_pieces
        s = float(piece_after(first, 0.0)(now)[0][0]) if self.start is None else float(self.start)
        pieces, size, fastest = [_rest_at(t, s)], abs(s), 0.0
        for row, segment in enumerate(self.segments):
            own = segment.motion.smooth_pieces
            value, speed = (float(part[0]) for part in piece_after(own, 0.0)(now)[:2])
            with within("segments", row, "motion"):
                speeds = piece_after(own, 0.0)(np.linspace(0.0, segment.duration, 9))[1]
                fastest = max(fastest, float(np.abs(speeds).max()))
                if abs(speed - v) > CONTINUOUS * fastest:
                    raise InputError(f"the speed jumps from {v:.6g} to {speed:.6g} where segment {row + 1} begins")
                if value != 0.0 or isinstance(segment.motion, Constant):
                    _check_reached(value, s, size)
            for piece in own:
                low, high = max(piece.start, 0.0), min(piece.end, segment.duration)
                if low < high:
                    knots = tuple(t + knot for knot in piece.knots if low < knot < high)
                    pieces.append(Piece(t + low, t + high, _moved(piece.function, t, s - value), knots))
            end, v = (float(part[0]) for part in _piece_until(own, segment.duration)(np.array([segment.duration]))[:2])
            s += end - value
            t, size = t + segment.duration, max(size, abs(s))
        return [*pieces, Piece(t, math.inf, polynomial(t, s, v))]


CONTINUOUS = 1e-9
"""Relative difference of values and speeds between consecutive laws that is attributed to rounding."""


def _check_reached(value: float, reached: float, size: float) -> None:
    """Raise where a law does not begin at the value that the laws before it reached."""
    if abs(value - reached) > CONTINUOUS * max(abs(value), size):
        raise InputError(
            f"the law begins at {value:.6g}, but the laws before it end at {reached:.6g}",
            expected=f"a law that begins at {reached:.6g}, or one, not constant, that begins at 0 and is added to it",
        )


def _rest_at(end: float, value: float) -> Piece:
    return Piece(-math.inf, end, polynomial(0.0, value))


def piece_after(pieces: Sequence[Piece], t: float) -> Callable[[Array], Values]:
    """Return the function of the piece that is valid just after t."""
    return next(piece.function for piece in pieces if t < piece.end)


def _piece_until(pieces: Sequence[Piece], t: float) -> Callable[[Array], Values]:
    return next(piece.function for piece in pieces if t <= piece.end)


def _moved(function: Callable[[Array], Values], origin: float, offset: float) -> Callable[[Array], Values]:
    def moved(t: Array) -> Values:
        s, ds, dds = function(np.asarray(t, float) - origin)
        return s + offset, ds, dds

    return moved


Law = (
    Constant
    | ConstantSpeed
    | ConstantAcceleration
    | Trapezoid
    | SCurve
    | Polynomial
    | Cycloidal
    | Harmonic
    | SpeedPoints
    | Steps
    | PiecewiseLinear
    | Spline
    | Table
    | Succession
)
"""Any law of motion."""
