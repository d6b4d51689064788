"""Laws made of other laws, and the union of them all."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.schema import Abscissa, Extent, Level, Model, check_unit
from pinarm.input.units import Unit
from pinarm.mechanics.laws.points import SpeedPoints, Spline, Table
from pinarm.mechanics.laws.rest_to_rest import Cycloidal, Polynomial, SCurve, Trapezoid
from pinarm.mechanics.laws.steady import Constant, ConstantAcceleration, ConstantSpeed, Harmonic
from pinarm.mechanics.motion import RENAMED, SECOND, MotionLaw, Piece, Values, polynomial


class Segment(Model, frozen=True):
    """A law for a while.

    Attributes:
        duration: How long [s].
        motion: The law, in a time of its own that begins at 0.
    """

    duration: Extent
    motion: Law


class Succession(MotionLaw, frozen=True, tag_field="law", tag="succession", rename=RENAMED):
    """Laws end to end: each begins where the one before has come to, and its speed must be that of the one before.

    After the last one the speed stays what it is.
    """

    segments: Annotated[list[Segment], msgspec.Meta(min_length=1)]
    start: Level = 0.0
    begin: Abscissa = 0.0

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        """Check every law; see ``MotionLaw.check_units``."""
        super().check_units(of, along)
        for row, segment in enumerate(self.segments):
            with within("segments", row, "duration"):
                check_unit(segment.duration, along)
            with within("segments", row, "motion"):
                segment.motion.check_units(of, along)

    def pieces(self) -> Sequence[Piece]:
        """Return the pieces of all the laws, moved in time and value."""
        t, s, v, found = float(self.begin), float(self.start), 0.0, [_rest_at(self.begin, self.start)]
        for number, segment in enumerate(self.segments):
            own = segment.motion.pieces()
            local = np.array([0.0])
            offset = s - float(own_piece(own, 0.0)(local)[0][0])
            speed = float(own_piece(own, 0.0)(local)[1][0])
            if abs(speed - v) > CONTINUOUS * max(abs(speed), abs(v)):
                raise InputError(f"the speed jumps from {v:.6g} to {speed:.6g} where segment {number + 1} begins")
            for piece in own:
                low, high = max(piece.start, 0.0), min(piece.end, segment.duration)
                if low < high:
                    found.append(Piece(t + low, t + high, _moved(piece.function, t, offset)))
            end = np.array([float(segment.duration)])
            values = found[-1].function(t + end)
            s, v, t = float(values[0][0]), float(values[1][0]), t + segment.duration
        return [*found, Piece(t, math.inf, polynomial(t, s, v))]


CONTINUOUS = 1e-9
"""Relative difference of speed that rounding explains where one law takes over from another."""


def _rest_at(end: float, value: float) -> Piece:
    return Piece(-math.inf, end, polynomial(0.0, value))


def own_piece(pieces: Sequence[Piece], t: float) -> Callable[[Array], Values]:
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
    | Spline
    | Table
    | Succession
)
"""Any law of motion."""
