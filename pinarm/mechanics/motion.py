"""Laws of motion: a value with its first and second derivative, exact, over time or over a coordinate.

A law is a sequence of smooth pieces. At a jump of any derivative each side has its own piece, valid up to and including
the instant of the jump, so that "just before" and "just after" are both well-defined numbers.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.schema import Derivative, Level, Measured, Model, Rate, SecondRate, Time, quantity
from pinarm.input.units import Unit, unit

Values = tuple[Array, Array, Array]
"""s, s' and s'' at the same instants, each of shape (n,)."""

ROUNDING = 1e-12
"""Two sides of a piece's end that differ by less, relative to the law's size, are one value, computed twice."""


@dataclass(frozen=True)
class Piece:
    """A smooth stretch of a law.

    Attributes:
        start: First instant [s]; ``-inf`` where it has always been so.
        end: Last instant [s].
        function: Instants, shape (n,), to s, s', s''.
    """

    start: float
    end: float
    function: Callable[[Array], Values]


def polynomial(origin: float, *coefficients: float) -> Callable[[Array], Values]:
    """Return ``s(t) = sum_k c_k (t - origin)^k`` with its derivatives."""
    c = np.array(coefficients)
    dc = c[1:] * np.arange(1.0, len(c))
    ddc = dc[1:] * np.arange(1.0, len(dc))

    def function(t: Array) -> Values:
        x = np.asarray(t, float) - origin
        return _horner(c, x), _horner(dc, x), _horner(ddc, x)

    return function


def _horner(c: Array, x: Array) -> Array:
    total = np.zeros_like(x)
    for coefficient in c[::-1]:
        total = total * x + coefficient
    return total


class MotionLaw(Model):
    """Base of the laws: their fields say which derivative of the coordinate they measure, ``pieces`` what they do."""

    kind: ClassVar[str]

    @abstractmethod
    def pieces(self) -> Sequence[Piece]:
        """Return the smooth pieces, end to end, from ``-inf`` to ``inf``."""

    def check_units(self, of: Unit) -> None:
        """Check that every field was written in a unit that fits a law of quantities measured in ``of``.

        Raises:
            UnitError: A field has another dimension.
        """
        second = unit("s")
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            for mark in field.metadata:
                if isinstance(mark, Derivative) and isinstance(value, Measured):
                    value.check(of / second**mark.order)

    def breakpoints(self) -> list[float]:
        """Return the instants at which one piece meets the next [s]."""
        return [piece.start for piece in self.pieces()[1:]]

    def jumps(self) -> list[float]:
        """Return the breakpoints at which s, s' or s'' itself jumps, not only a higher derivative."""
        pieces = self.pieces()
        found = []
        for before, after in pairwise(pieces):
            instant = np.array([after.start])
            sides = np.array([before.function(instant), after.function(instant)])[:, :, 0]
            if (abs(sides[0] - sides[1]) > ROUNDING * abs(sides).max()).any():
                found.append(after.start)
        return found

    def on(self, start: float, end: float) -> Callable[[Array], Values]:
        """Return the smooth function that holds between two neighbouring breakpoints, both ends included."""
        middle = 0.5 * (start + end)
        for piece in self.pieces():
            if middle <= piece.end:
                return piece.function
        raise AssertionError("the pieces of a law reach to infinity")


def _rest_move_rest(begin: float, end: float, first: float, last: float, *moving: Piece) -> list[Piece]:
    return [Piece(-math.inf, begin, polynomial(0.0, first)), *moving, Piece(end, math.inf, polynomial(0.0, last))]


class Constant(MotionLaw):
    """``s = value``, at rest."""

    law: Literal["constant"] = "constant"
    value: Level

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""
        return [Piece(-math.inf, math.inf, polynomial(0.0, self.value))]


class ConstantSpeed(MotionLaw):
    """``s = from + speed (t - begin)``, for all t."""

    law: Literal["constant_speed"] = "constant_speed"
    start: Level = Field(alias="from", default=0.0)
    speed: Rate
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""
        return [Piece(-math.inf, math.inf, polynomial(self.begin, self.start, self.speed))]


class ConstantAcceleration(MotionLaw):
    """``s = from + speed (t - begin) + acceleration (t - begin)^2 / 2``, for all t."""

    law: Literal["constant_acceleration"] = "constant_acceleration"
    start: Level = Field(alias="from", default=0.0)
    speed: Rate = 0.0
    acceleration: SecondRate
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""
        function = polynomial(self.begin, self.start, self.speed, self.acceleration / 2)
        return [Piece(-math.inf, math.inf, function)]


class Trapezoid(MotionLaw):
    """From rest to rest with a trapezoid of speed; a triangle where the limit of speed is not reached or not given.

    Speeds up at ``acceleration`` to ``speed``, keeps it, slows down alike. The acceleration jumps four times (three for
    a triangle): torques jump with it, and flexible machines ring.
    """

    law: Literal["trapezoid"] = "trapezoid"
    start: Level = Field(alias="from")
    end: Level = Field(alias="to")
    acceleration: SecondRate
    speed: Rate | None = None
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return rest, speeding up, constant speed where there is any, slowing down, rest."""
        distance, limit = self.end - self.start, abs(self.acceleration)
        if distance == 0.0:
            return [Piece(-math.inf, math.inf, polynomial(0.0, self.start))]
        if limit == 0.0 or self.speed == 0.0:
            raise InputError("a trapezoid that goes somewhere needs an acceleration and a speed other than 0")
        a = math.copysign(limit, distance)
        peak = math.sqrt(abs(distance) * limit)
        top = math.copysign(min(peak, abs(self.speed)) if self.speed else peak, distance)
        t1 = self.begin + top / a
        plateau = max(0.0, distance / top - top / a)
        t2, t3 = t1 + plateau, t1 + plateau + top / a
        s1 = self.start + top * top / (2 * a)
        up = Piece(self.begin, t1, polynomial(self.begin, self.start, 0.0, a / 2))
        level = [Piece(t1, t2, polynomial(t1, s1, top))] if plateau * limit > ROUNDING * abs(top) else []
        down = Piece(t2, t3, polynomial(t3, self.end, 0.0, -a / 2))
        return _rest_move_rest(self.begin, t3, self.start, self.end, up, *level, down)


class Polynomial(MotionLaw):
    """From rest to rest along the polynomial of lowest degree whose derivatives vanish at both ends.

    With x = (t - begin)/duration: ``3 x^2 - 2 x^3`` (degree 3, the acceleration jumps at the ends),
    ``10 x^3 - 15 x^4 + 6 x^5`` (5, it does not), ``35 x^4 - 84 x^5 + 70 x^6 - 20 x^7`` (7, nor does the jerk).
    """

    law: Literal["polynomial"] = "polynomial"
    start: Level = Field(alias="from")
    end: Level = Field(alias="to")
    duration: Time = Field(gt=0)
    degree: Literal[3, 5, 7] = 5
    begin: Time = 0.0

    _SHAPES: ClassVar[dict[int, tuple[float, ...]]] = {
        3: (0, 0, 3, -2),
        5: (0, 0, 0, 10, -15, 6),
        7: (0, 0, 0, 0, 35, -84, 70, -20),
    }

    def pieces(self) -> Sequence[Piece]:
        """Return rest, motion, rest."""
        distance = self.end - self.start
        scaled = [distance * c / self.duration**k for k, c in enumerate(self._SHAPES[self.degree])]
        stop = self.begin + self.duration
        move = Piece(self.begin, stop, polynomial(self.begin, self.start, *scaled[1:]))
        return _rest_move_rest(self.begin, stop, self.start, self.end, move)


class Cycloidal(MotionLaw):
    """From rest to rest as a point of a rolling wheel: ``s = from + D (x - sin(2 pi x) / (2 pi))``.

    x = (t - begin)/duration and D = to - from. The acceleration is a sine and begins and ends at 0.
    """

    law: Literal["cycloidal"] = "cycloidal"
    start: Level = Field(alias="from")
    end: Level = Field(alias="to")
    duration: Time = Field(gt=0)
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return rest, motion, rest."""
        distance, duration, w = self.end - self.start, self.duration, 2 * math.pi / self.duration

        def function(t: Array) -> Values:
            x = w * (t - self.begin)
            s = self.start + distance / (2 * math.pi) * (x - np.sin(x))
            return s, distance / duration * (1 - np.cos(x)), distance / duration * w * np.sin(x)

        stop = self.begin + duration
        return _rest_move_rest(self.begin, stop, self.start, self.end, Piece(self.begin, stop, function))


class Harmonic(MotionLaw):
    """``s = mean + amplitude sin(pulsation (t - begin) + phase)``, for all t."""

    law: Literal["harmonic"] = "harmonic"
    mean: Level = 0.0
    amplitude: Level
    pulsation: quantity("rad/s")  # type: ignore[valid-type]
    phase: quantity("rad") = 0.0  # type: ignore[valid-type]
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""

        def function(t: Array) -> Values:
            x = self.pulsation * (t - self.begin) + self.phase
            s, c = self.amplitude * np.sin(x), self.amplitude * np.cos(x)
            return self.mean + s, self.pulsation * c, -(self.pulsation**2) * s

        return [Piece(-math.inf, math.inf, function)]


Law = Annotated[
    Constant | ConstantSpeed | ConstantAcceleration | Trapezoid | Polynomial | Cycloidal | Harmonic,
    Field(discriminator="law"),
]
"""Any law of motion. A new law is one class above and one entry here."""


@dataclass(frozen=True)
class Grid:
    """Instants at which a problem is solved, cut into stretches on which every law is smooth.

    An instant at which a law jumps stands twice: as the end of one stretch and as the start of the next.

    Attributes:
        t: Instants [s], or values of the coordinate swept, shape (n,).
        cuts: Bounds of the stretches, shape (m + 1,).
        rows: First row of each stretch, and n; shape (m + 1,).
    """

    t: Array
    cuts: tuple[float, ...]
    rows: tuple[int, ...]

    @classmethod
    def cover(cls, t: Array, laws: Iterable[MotionLaw]) -> Grid:
        """Return the grid of the given instants, with the jumps of the laws between the first and the last added."""
        first, last = float(t[0]), float(t[-1])
        inner = sorted({x for law in laws for x in law.jumps() if first < x < last})
        cuts = [first, *inner, last]
        parts = []
        for start, end in pairwise(cuts):
            inside = t[(t > start + ROUNDING * (last - first)) & (t < end - ROUNDING * (last - first))]
            parts.append(np.concatenate([[start], inside, [end]] if end > start else [[start]]))
        rows = np.cumsum([0, *(len(part) for part in parts)])
        return cls(np.concatenate(parts), tuple(cuts), tuple(int(row) for row in rows))

    def evaluate(self, law: MotionLaw) -> Values:
        """Return s, s', s'' of a law at every row, each side of a jump by its own piece."""
        parts = [self._on(law, stretch) for stretch in range(len(self.cuts) - 1)]
        s, ds, dds = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return s, ds, dds

    def _on(self, law: MotionLaw, stretch: int) -> Values:
        """Evaluate between two cuts; pieces may still meet there as long as s'' does not jump."""
        start, end = self.cuts[stretch], self.cuts[stretch + 1]
        t = self.t[self.rows[stretch] : self.rows[stretch + 1]]
        bounds = [start, *(x for x in law.breakpoints() if start < x < end), end]
        values = np.empty((3, len(t)))
        for low, high in pairwise(bounds):
            inside = (t >= low) & (t <= high)
            values[:, inside] = law.on(low, high)(t[inside])
        return values[0], values[1], values[2]
