"""Laws in closed form: rest, constant speed and acceleration, oscillation, and motions from rest to rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Abscissa, Angle, Extent, Frequency, Level, Pulsation, Rate, SecondRate, ThirdRate
from pinarm.mechanics.laws.motion_law import (
    FILE_KEYS,
    ROUNDING,
    SECOND,
    MotionLaw,
    Piece,
    PowerSeries,
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
                "an oscillation is as fast as its pulsation or its frequency says",
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


def _rest_move_rest(begin: float, end: float, first: float, last: float, *moving: Piece) -> list[Piece]:
    return [Piece(-math.inf, begin, polynomial(0.0, first)), *moving, Piece(end, math.inf, polynomial(0.0, last))]


class Trapezoid(MotionLaw, frozen=True, tag_field="law", tag="trapezoid", rename=FILE_KEYS):
    """From rest to rest with a trapezoid of speed; a triangle where the limit of speed is not reached or not given.

    Speeds up at ``acceleration`` to ``speed``, keeps it, slows down alike. The acceleration jumps four times (three for
    a triangle): torques jump with it, and flexible machines ring.

    Attributes:
        start: First value, ``from`` in files.
        end: Last value, ``to`` in files.
        acceleration: Of speeding up and slowing down, such as ``2 rad/s^2``.
        speed: Limit of the speed; none where it is left out.
        begin: When it begins to move.
    """

    start: Level
    end: Level
    acceleration: SecondRate
    speed: Rate | None = None
    begin: Abscissa = 0.0

    def check(self) -> None:
        """Refuse limits that would never let it arrive."""
        if self.start != self.end and (self.acceleration == 0.0 or self.speed == 0.0):
            raise InputError("a trapezoid that goes somewhere needs an acceleration and a speed other than 0")

    def pieces(self) -> Sequence[Piece]:
        distance, limit = self.end - self.start, abs(self.acceleration)
        if distance == 0.0:
            return [Piece(-math.inf, math.inf, polynomial(0.0, self.start))]
        a = math.copysign(limit, distance)
        peak = math.sqrt(abs(distance)) * math.sqrt(limit)  # the product of small numbers may be 0
        top = math.copysign(min(peak, abs(self.speed)) if self.speed else peak, distance)
        t1 = self.begin + top / a
        plateau = max(0.0, distance / top - top / a)
        t2, t3 = t1 + plateau, t1 + plateau + top / a
        s1 = self.start + top * top / (2 * a)
        up = Piece(self.begin, t1, polynomial(self.begin, self.start, 0.0, a / 2))
        level = [Piece(t1, t2, polynomial(t1, s1, top))] if plateau * limit > ROUNDING * abs(top) else []
        down = Piece(t2, t3, polynomial(t3, self.end, 0.0, -a / 2))
        return _rest_move_rest(self.begin, t3, self.start, self.end, up, *level, down)


class Polynomial(MotionLaw, frozen=True, tag_field="law", tag="polynomial", rename=FILE_KEYS):
    """From rest to rest along the polynomial of lowest degree whose derivatives vanish at both ends.

    With x = (t - begin)/duration: ``3 x^2 - 2 x^3`` (degree 3, the acceleration jumps at the ends),
    ``10 x^3 - 15 x^4 + 6 x^5`` (5, it does not), ``35 x^4 - 84 x^5 + 70 x^6 - 20 x^7`` (7, nor does the jerk).

    Attributes:
        start: First value, ``from`` in files.
        end: Last value, ``to`` in files.
        duration: How long it moves.
        degree: Of the polynomial.
        begin: When it begins to move.
    """

    start: Level
    end: Level
    duration: Extent
    degree: Literal[3, 5, 7] = 5
    begin: Abscissa = 0.0

    _SHAPES: ClassVar[dict[int, tuple[float, ...]]] = {
        3: (0, 0, 3, -2),
        5: (0, 0, 0, 10, -15, 6),
        7: (0, 0, 0, 0, 35, -84, 70, -20),
    }

    def pieces(self) -> Sequence[Piece]:
        shape, stop = tuple(map(float, self._SHAPES[self.degree])), self.begin + self.duration
        function = PowerSeries(self.begin, shape, self.start, self.end - self.start, self.duration)
        move = Piece(self.begin, stop, function)
        return _rest_move_rest(self.begin, stop, self.start, self.end, move)


class Cycloidal(MotionLaw, frozen=True, tag_field="law", tag="cycloidal", rename=FILE_KEYS):
    """From rest to rest as a point of a rolling wheel: ``s = from + D (x - sin(2 pi x) / (2 pi))``.

    x = (t - begin)/duration and D = to - from. The acceleration is a sine and begins and ends at 0.

    Attributes:
        start: First value, ``from`` in files.
        end: Last value, ``to`` in files.
        duration: How long it moves.
        begin: When it begins to move.
    """

    start: Level
    end: Level
    duration: Extent
    begin: Abscissa = 0.0

    def pieces(self) -> Sequence[Piece]:
        wave, stop = (self.start - self.end) / (2 * math.pi), self.begin + self.duration
        function = Wave(self.start, wave, -1.0, 2 * math.pi / self.duration, 0.0, self.begin)
        return _rest_move_rest(self.begin, stop, self.start, self.end, Piece(self.begin, stop, function))


class SCurve(MotionLaw, frozen=True, tag_field="law", tag="s_curve", rename=FILE_KEYS):
    """From rest to rest with a bounded jerk: seven intervals of constant jerk, fewer where a limit is not reached.

    The acceleration is continuous. Limits of acceleration and speed that are left out do not bind.

    Attributes:
        start: First value, ``from`` in files.
        end: Last value, ``to`` in files.
        jerk: Rate of the acceleration, such as ``20 rad/s^3``.
        acceleration: Limit of the acceleration.
        speed: Limit of the speed.
        begin: When it begins to move.
    """

    start: Level
    end: Level
    jerk: ThirdRate
    acceleration: SecondRate | None = None
    speed: Rate | None = None
    begin: Abscissa = 0.0

    def check(self) -> None:
        """Refuse limits that would never let it arrive."""
        limits = (self.jerk, self.acceleration, self.speed)
        if self.start != self.end and any(limit == 0.0 for limit in limits):
            raise InputError("an s_curve that goes somewhere needs limits other than 0")

    def pieces(self) -> Sequence[Piece]:
        distance = self.end - self.start
        if distance == 0.0:
            return [Piece(-math.inf, math.inf, polynomial(0.0, self.start))]
        ramp, hold, cruise = self._durations(abs(distance))
        jerk = math.copysign(abs(self.jerk), distance)
        intervals = [(ramp, jerk), (hold, 0.0), (ramp, -jerk), (cruise, 0.0), (ramp, -jerk), (hold, 0.0), (ramp, jerk)]
        total = 4 * ramp + 2 * hold + cruise
        moving, t, state = [], self.begin, (self.start, 0.0, 0.0)
        for duration, j in intervals:
            if duration > ROUNDING * total:
                s, v, a = state
                function = polynomial(t, s, v, a / 2, j / 6)
                moving.append(Piece(t, t + duration, function))
                t += duration
                state = (
                    s + v * duration + a * duration**2 / 2 + j * duration**3 / 6,
                    v + a * duration + j * duration**2 / 2,
                    a + j * duration,
                )
        return _rest_move_rest(self.begin, t, self.start, self.end, *moving)

    def _durations(self, distance: float) -> tuple[float, float, float]:
        """Return how long the jerk, the full acceleration and the full speed last [s]."""
        j = abs(self.jerk)
        a = math.inf if self.acceleration is None else abs(self.acceleration)
        v = math.inf if self.speed is None else abs(self.speed)
        top = (distance / (2 * j)) ** (1 / 3) if a == math.inf or distance < 2 * a * (a / j) ** 2 else None
        peak = j * top**2 if top is not None else (-(a**2) / j + math.sqrt((a**2 / j) ** 2 + 4 * a * distance)) / 2
        v = min(v, peak)
        ramp = min(math.sqrt(v / j), a / j)
        hold = v / (j * ramp) - ramp
        return ramp, max(0.0, hold), max(0.0, distance / v - 2 * ramp - hold)
