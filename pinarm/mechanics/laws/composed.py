"""Laws made of other laws, and the union of them all."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Abscissa, Extent, InputStruct, Level, check_unit
from pinarm.mechanics.laws.interpolated import SpeedPoints, Spline, Steps, Table
from pinarm.mechanics.laws.motion_law import FILE_KEYS, SECOND, MotionLaw, Piece, Values, polynomial
from pinarm.mechanics.laws.rest_to_rest import Cycloidal, Polynomial, SCurve, Trapezoid
from pinarm.mechanics.laws.steady import Constant, ConstantAcceleration, ConstantSpeed, Harmonic


class Segment(InputStruct, frozen=True):
    """A law for a while.

    Attributes:
        duration: How long [s].
        motion: The law, in a time of its own that begins at 0.
    """

    duration: Extent
    motion: Law


class Succession(MotionLaw, frozen=True, tag_field="law", tag="succession", rename=FILE_KEYS):
    """Laws end to end: each begins where the one before has come to, and its speed must be that of the one before.

    A law whose own values begin at 0 counts from there; one that begins elsewhere has to begin there, as a constant
    has to stay there. After the last one the speed stays what it is.

    Attributes:
        segments: The laws.
        start: Value at the beginning; that of the first law where it is left out.
        begin: When the first one begins.
    """

    segments: Annotated[list[Segment], msgspec.Meta(min_length=1)]
    start: Level | None = None
    begin: Abscissa = 0.0

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        """Check every law; see ``MotionLaw.check_units``."""
        super().check_units(of, along)
        for row, segment in enumerate(self.segments):
            with within("segments", row, "duration"):
                check_unit(segment.duration, along)
            with within("segments", row, "motion"):
                segment.motion.check_units(of, along)

    def check(self) -> None:
        """Refuse laws that do not follow one another."""
        self.pieces()

    def pieces(self) -> Sequence[Piece]:
        """Return the pieces of all the laws, moved in time and value."""
        t, v, now = float(self.begin), 0.0, np.array([0.0])
        first = self.segments[0].motion.smooth_pieces
        s = float(piece_after(first, 0.0)(now)[0][0]) if self.start is None else float(self.start)
        found, size = [_rest_at(t, s)], abs(s)
        for row, segment in enumerate(self.segments):
            own = segment.motion.smooth_pieces
            value, speed = (float(part[0]) for part in piece_after(own, 0.0)(now)[:2])
            with within("segments", row, "motion"):
                if abs(speed - v) > CONTINUOUS * max(abs(speed), abs(v)):
                    raise InputError(f"the speed jumps from {v:.6g} to {speed:.6g} where segment {row + 1} begins")
                if value != 0.0 or isinstance(segment.motion, Constant):
                    _check_reached(value, s, size)
            for piece in own:
                low, high = max(piece.start, 0.0), min(piece.end, segment.duration)
                if low < high:
                    found.append(Piece(t + low, t + high, _moved(piece.function, t, s - value)))
            s, v = (float(part[0]) for part in found[-1].function(np.array([t + segment.duration]))[:2])
            t, size = t + segment.duration, max(size, abs(s))
        return [*found, Piece(t, math.inf, polynomial(t, s, v))]


CONTINUOUS = 1e-9
"""Relative difference of values and speeds that rounding explains where one law takes over from another."""


def _check_reached(value: float, reached: float, size: float) -> None:
    """Raise where a law begins elsewhere than at the value that those before it have come to.

    Raises:
        InputError: Says both.
    """
    if abs(value - reached) > CONTINUOUS * max(abs(value), size):
        raise InputError(
            f"the law begins at {value:.6g}, but those before it have come to {reached:.6g}",
            expected=f"one that begins at {reached:.6g}, or, unless it is constant, at 0 to count from there",
        )


def _rest_at(end: float, value: float) -> Piece:
    return Piece(-math.inf, end, polynomial(0.0, value))


def piece_after(pieces: Sequence[Piece], t: float) -> Callable[[Array], Values]:
    """Return the piece that holds just after an instant."""
    return next(piece.function for piece in pieces if t < piece.end)


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
    | Spline
    | Table
    | Succession
)
"""Any law of motion."""
