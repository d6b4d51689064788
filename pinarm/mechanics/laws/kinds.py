"""The kinds of law: rest, constant speed, oscillation, motions from rest to rest, and laws in succession."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Collection, Sequence
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import (
    Abscissa,
    Angle,
    Extent,
    Frequency,
    InputStruct,
    Level,
    Pulsation,
    Rate,
    SecondRate,
    ThirdRate,
    check_unit,
)
from pinarm.mechanics.laws.interpolated import PiecewiseLinear, SpeedPoints, Spline, Steps, Table
from pinarm.mechanics.laws.motion_law import (
    FILE_KEYS,
    ROUNDING,
    SECOND,
    MotionLaw,
    Piece,
    PowerSeries,
    Values,
    Wave,
    polynomial,
)


class Constant(MotionLaw, frozen=True, tag_field="law", tag="constant", rename=FILE_KEYS):
    """``s = value``, at rest.

    Attributes:
        value: The value.
    """

    value: Level

    def pieces(self) -> Sequence[Piece]:
        return [Piece(-math.inf, math.inf, polynomial(0.0, self.value))]


class ConstantSpeed(MotionLaw, frozen=True, tag_field="law", tag="constant_speed", rename=FILE_KEYS):
    """``s = from + speed (t - begin)``, for all t.

    Attributes:
        speed: Rate of the value, such as ``300 rpm``.
        start: Value at ``begin``, ``from`` in files.
        begin: Instant at which the value is ``from``, such as ``0.5 s``.
    """

    speed: Rate
    start: Level = 0.0
    begin: Abscissa = 0.0

    def pieces(self) -> Sequence[Piece]:
        return [Piece(-math.inf, math.inf, polynomial(self.begin, self.start, self.speed))]


class ConstantAcceleration(MotionLaw, frozen=True, tag_field="law", tag="constant_acceleration", rename=FILE_KEYS):
    """``s = from + speed (t - begin) + acceleration (t - begin)^2 / 2``, for all t.

    Attributes:
        acceleration: Second rate of the value.
        start: Value at ``begin``, ``from`` in files.
        speed: Rate of the value at ``begin``.
        begin: Instant at which the value is ``from``, such as ``0.5 s``.
    """

    acceleration: SecondRate
    start: Level = 0.0
    speed: Rate = 0.0
    begin: Abscissa = 0.0

    def pieces(self) -> Sequence[Piece]:
        function = polynomial(self.begin, self.start, self.speed, self.acceleration / 2)
        return [Piece(-math.inf, math.inf, function)]


class Harmonic(MotionLaw, frozen=True, tag_field="law", tag="harmonic", rename=FILE_KEYS):
    """``s = mean + amplitude sin(pulsation (t - begin) + phase)``, for all t.

    Attributes:
        amplitude: Half of the range of the value.
        pulsation: Angular frequency, such as ``2 rad/s``; over an angle in rad/rad.
        frequency: In place of the pulsation, of which it is a 2 pi-th: cycles over time, such as ``2 Hz``.
        mean: Mean of the value.
        phase: Angle at ``begin``.
        begin: Instant at which the angle is ``phase``, such as ``0.5 s``.
    """

    amplitude: Level
    pulsation: Pulsation | None = None
    mean: Level = 0.0
    phase: Angle = 0.0
    begin: Abscissa = 0.0
    frequency: Frequency | None = None

    def check(self) -> None:
        if (self.pulsation is None) == (self.frequency is None):
            raise InputError(
                "an oscillation has either a pulsation or a frequency",
                expected="one of both, such as pulsation: 2 rad/s, or frequency: 2 Hz",
            )

    def check_units(self, of: Unit, along: Unit = SECOND) -> None:
        super().check_units(of, along)
        if self.frequency is not None and along != SECOND:
            with within("frequency"):
                raise InputError("a frequency counts cycles over time", hint="pulsation: 1 rad/rad")

    def pieces(self) -> Sequence[Piece]:
        pulsation = self.pulsation if self.pulsation is not None else 2.0 * math.pi * (self.frequency or 0.0)
        function = Wave(self.mean, self.amplitude, 0.0, pulsation, self.phase, self.begin)
        return [Piece(-math.inf, math.inf, function)]


class RestToRest(MotionLaw, frozen=True, kw_only=True, rename=FILE_KEYS):
    """A motion from rest to rest.

    Attributes:
        start: First value, ``from`` in files.
        end: Last value, ``to`` in files.
        begin: When it begins to move.
    """

    start: Level
    end: Level
    begin: Abscissa = 0.0

    @abstractmethod
    def moving(self) -> list[Piece]:
        """Return the pieces between rest and rest; none where it does not move."""

    def pieces(self) -> Sequence[Piece]:
        if not (moving := self.moving()):
            return [Piece(-math.inf, math.inf, polynomial(0.0, self.start))]
        before, after = (polynomial(0.0, rest) for rest in (self.start, self.end))
        return [Piece(-math.inf, moving[0].start, before), *moving, Piece(moving[-1].end, math.inf, after)]

    def phases(self, *phases: tuple[float, float, float]) -> list[Piece]:
        """Return pieces, from rest on, of durations with an acceleration at their beginning, and a constant jerk."""
        t, s, v, pieces = self.begin, self.start, 0.0, list[Piece]()
        total = sum(duration for duration, _, _ in phases)
        for h, a, j in phases:
            if h > ROUNDING * total:
                pieces.append(Piece(t, t + h, polynomial(t, s, v, a / 2, j / 6)))
                t, s, v = t + h, s + v * h + a * h**2 / 2 + j * h**3 / 6, v + a * h + j * h**2 / 2
        return pieces


class Trapezoid(RestToRest, frozen=True, kw_only=True, tag_field="law", tag="trapezoid"):
    """From rest to rest with a trapezoid of speed; a triangle where the limit of speed is not reached or not given.

    Speeds up at ``acceleration`` to ``speed``, keeps it, slows down alike. The acceleration jumps four times (three for
    a triangle): torques jump with it, and flexible machines ring.

    Attributes:
        acceleration: Of speeding up and slowing down, such as ``2 rad/s^2``.
        speed: Limit of the speed; none where it is left out.
    """

    acceleration: SecondRate
    speed: Rate | None = None

    def check(self) -> None:
        if self.start != self.end and (self.acceleration == 0.0 or self.speed == 0.0):
            raise InputError("a trapezoid that goes somewhere needs an acceleration and a speed other than 0")

    def moving(self) -> list[Piece]:
        distance, limit = self.end - self.start, abs(self.acceleration)
        if distance == 0.0:
            return []
        peak = math.sqrt(abs(distance)) * math.sqrt(limit)  # the product of small numbers may be 0
        top = min(peak, abs(self.speed)) if self.speed else peak
        a, rise = math.copysign(limit, distance), top / limit
        return self.phases((rise, a, 0.0), (max(0.0, abs(distance) / top - rise), 0.0, 0.0), (rise, -a, 0.0))


class Polynomial(RestToRest, frozen=True, kw_only=True, tag_field="law", tag="polynomial"):
    """From rest to rest along the polynomial of lowest degree whose derivatives vanish at both ends.

    With x = (t - begin)/duration: ``3 x^2 - 2 x^3`` (degree 3, the acceleration jumps at the ends),
    ``10 x^3 - 15 x^4 + 6 x^5`` (5, it does not), ``35 x^4 - 84 x^5 + 70 x^6 - 20 x^7`` (7, nor does the jerk).

    Attributes:
        duration: How long it moves.
        degree: Of the polynomial.
    """

    duration: Extent
    degree: Literal[3, 5, 7] = 5

    _SHAPES: ClassVar[dict[int, tuple[float, ...]]] = {
        3: (0.0, 0.0, 3.0, -2.0),
        5: (0.0, 0.0, 0.0, 10.0, -15.0, 6.0),
        7: (0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0),
    }

    def moving(self) -> list[Piece]:
        way = PowerSeries(self.begin, self._SHAPES[self.degree], self.start, self.end - self.start, self.duration)
        return [Piece(self.begin, self.begin + self.duration, way)]


class Cycloidal(RestToRest, frozen=True, kw_only=True, tag_field="law", tag="cycloidal"):
    """From rest to rest as a point of a rolling wheel: ``s = from + D (x - sin(2 pi x) / (2 pi))``.

    x = (t - begin)/duration and D = to - from. The acceleration is a sine and begins and ends at 0.

    Attributes:
        duration: How long it moves.
    """

    duration: Extent

    def moving(self) -> list[Piece]:
        wave = (self.start - self.end) / (2 * math.pi)
        function = Wave(self.start, wave, -1.0, 2 * math.pi / self.duration, 0.0, self.begin)
        return [Piece(self.begin, self.begin + self.duration, function)]


class SCurve(RestToRest, frozen=True, kw_only=True, tag_field="law", tag="s_curve"):
    """From rest to rest with a bounded jerk: seven intervals of constant jerk, fewer where a limit is not reached.

    The acceleration is continuous. Limits of acceleration and speed that are left out do not bind.

    Attributes:
        jerk: Rate of the acceleration, such as ``20 rad/s^3``.
        acceleration: Limit of the acceleration.
        speed: Limit of the speed.
    """

    jerk: ThirdRate
    acceleration: SecondRate | None = None
    speed: Rate | None = None

    def check(self) -> None:
        limits = (self.jerk, self.acceleration, self.speed)
        if self.start != self.end and any(limit == 0.0 for limit in limits):
            raise InputError("an s_curve that goes somewhere needs limits other than 0")

    def moving(self) -> list[Piece]:
        distance = self.end - self.start
        if distance == 0.0:
            return []
        ramp, hold, cruise = self._durations(abs(distance))
        j = math.copysign(abs(self.jerk), distance)
        a = j * ramp
        return self.phases(
            (ramp, 0.0, j), (hold, a, 0.0), (ramp, a, -j), (cruise, 0.0, 0.0),
            (ramp, 0.0, -j), (hold, -a, 0.0), (ramp, -a, j),
        )  # fmt: skip

    def _durations(self, distance: float) -> tuple[float, float, float]:
        """Return the durations of one phase of jerk, of full acceleration and of full speed [s]."""
        j = abs(self.jerk)
        a = math.inf if self.acceleration is None else abs(self.acceleration)
        v = math.inf if self.speed is None else abs(self.speed)
        top = (distance / (2 * j)) ** (1 / 3) if a == math.inf or distance < 2 * a * (a / j) ** 2 else None
        peak = j * top**2 if top is not None else (-(a**2) / j + math.sqrt((a**2 / j) ** 2 + 4 * a * distance)) / 2
        v = min(v, peak)
        ramp = min(math.sqrt(v / j), a / j)
        hold = v / (j * ramp) - ramp
        return ramp, max(0.0, hold), max(0.0, distance / v - 2 * ramp - hold)


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
        self.pieces()

    def pieces(self) -> Sequence[Piece]:
        t, v, now = float(self.begin), 0.0, np.array([0.0])
        first = self.segments[0].motion.smooth_pieces
        s = float(_piece_after(first, 0.0)(now)[0][0]) if self.start is None else float(self.start)
        pieces, size, fastest = [Piece(-math.inf, t, polynomial(0.0, s))], abs(s), 0.0
        for row, segment in enumerate(self.segments):
            own = segment.motion.smooth_pieces
            value, speed = (float(part[0]) for part in _piece_after(own, 0.0)(now)[:2])
            with within("segments", row, "motion"):
                speeds = _piece_after(own, 0.0)(np.linspace(0.0, segment.duration, 9))[1]
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
            last = segment.motion.on(segment.duration, segment.duration)(np.array([segment.duration]))
            end, v = (float(part[0]) for part in last[:2])
            s += end - value
            t, size = t + segment.duration, max(size, abs(s))
        return [*pieces, Piece(t, math.inf, polynomial(t, s, v))]


CONTINUOUS = 1e-9
"""Relative difference of values and speeds between consecutive laws that is attributed to rounding."""


def _check_reached(value: float, reached: float, size: float) -> None:
    if abs(value - reached) > CONTINUOUS * max(abs(value), size):
        raise InputError(
            f"the law begins at {value:.6g}, but the laws before it end at {reached:.6g}",
            expected=f"a law that begins at {reached:.6g}, or one, not constant, that begins at 0 and is added to it",
        )


def _piece_after(pieces: Sequence[Piece], t: float) -> Callable[[Array], Values]:
    """Return the function of the piece that is valid just after t."""
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
    | PiecewiseLinear
    | Spline
    | Table
    | Succession
)
"""Any law of motion."""
