"""The laws of motion that a file may give. A new law is one class and one entry in the union at the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, UnitError
from pinarm.input.roots import inside, root_of
from pinarm.input.schema import (
    Angle,
    Duration,
    Level,
    Measured,
    Model,
    Pulsation,
    Rate,
    SecondRate,
    ThirdRate,
    Time,
    folder_read,
)
from pinarm.input.units import Unit, unit
from pinarm.mechanics.motion import ROUNDING, MotionLaw, Piece, Values, polynomial

RENAMED = {"start": "from", "end": "to"}
"""Keys of files that are words of Python."""


def _rest_move_rest(begin: float, end: float, first: float, last: float, *moving: Piece) -> list[Piece]:
    return [Piece(-math.inf, begin, polynomial(0.0, first)), *moving, Piece(end, math.inf, polynomial(0.0, last))]


class Constant(MotionLaw, frozen=True, tag_field="law", tag="constant", rename=RENAMED):
    """``s = value``, at rest."""

    value: Level

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""
        return [Piece(-math.inf, math.inf, polynomial(0.0, self.value))]


class ConstantSpeed(MotionLaw, frozen=True, tag_field="law", tag="constant_speed", rename=RENAMED):
    """``s = from + speed (t - begin)``, for all t."""

    speed: Rate
    start: Level = 0.0
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""
        return [Piece(-math.inf, math.inf, polynomial(self.begin, self.start, self.speed))]


class ConstantAcceleration(MotionLaw, frozen=True, tag_field="law", tag="constant_acceleration", rename=RENAMED):
    """``s = from + speed (t - begin) + acceleration (t - begin)^2 / 2``, for all t."""

    acceleration: SecondRate
    start: Level = 0.0
    speed: Rate = 0.0
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""
        function = polynomial(self.begin, self.start, self.speed, self.acceleration / 2)
        return [Piece(-math.inf, math.inf, function)]


class Trapezoid(MotionLaw, frozen=True, tag_field="law", tag="trapezoid", rename=RENAMED):
    """From rest to rest with a trapezoid of speed; a triangle where the limit of speed is not reached or not given.

    Speeds up at ``acceleration`` to ``speed``, keeps it, slows down alike. The acceleration jumps four times (three for
    a triangle): torques jump with it, and flexible machines ring.
    """

    start: Level
    end: Level
    acceleration: SecondRate
    speed: Rate | None = None
    begin: Time = 0.0

    def check(self) -> None:
        """Refuse limits that would never let it arrive."""
        if self.start != self.end and (self.acceleration == 0.0 or self.speed == 0.0):
            raise InputError("a trapezoid that goes somewhere needs an acceleration and a speed other than 0")

    def pieces(self) -> Sequence[Piece]:
        """Return rest, speeding up, constant speed where there is any, slowing down, rest."""
        distance, limit = self.end - self.start, abs(self.acceleration)
        if distance == 0.0:
            return [Piece(-math.inf, math.inf, polynomial(0.0, self.start))]
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


class Polynomial(MotionLaw, frozen=True, tag_field="law", tag="polynomial", rename=RENAMED):
    """From rest to rest along the polynomial of lowest degree whose derivatives vanish at both ends.

    With x = (t - begin)/duration: ``3 x^2 - 2 x^3`` (degree 3, the acceleration jumps at the ends),
    ``10 x^3 - 15 x^4 + 6 x^5`` (5, it does not), ``35 x^4 - 84 x^5 + 70 x^6 - 20 x^7`` (7, nor does the jerk).
    """

    start: Level
    end: Level
    duration: Duration
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
        shape = polynomial(0.0, *self._SHAPES[self.degree])

        def function(t: Array) -> Values:
            s, ds, dds = shape((t - self.begin) / self.duration)
            rate = distance / self.duration
            return self.start + distance * s, rate * ds, rate / self.duration * dds

        stop = self.begin + self.duration
        move = Piece(self.begin, stop, function)
        return _rest_move_rest(self.begin, stop, self.start, self.end, move)


class Cycloidal(MotionLaw, frozen=True, tag_field="law", tag="cycloidal", rename=RENAMED):
    """From rest to rest as a point of a rolling wheel: ``s = from + D (x - sin(2 pi x) / (2 pi))``.

    x = (t - begin)/duration and D = to - from. The acceleration is a sine and begins and ends at 0.
    """

    start: Level
    end: Level
    duration: Duration
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


class Harmonic(MotionLaw, frozen=True, tag_field="law", tag="harmonic", rename=RENAMED):
    """``s = mean + amplitude sin(pulsation (t - begin) + phase)``, for all t."""

    amplitude: Level
    pulsation: Pulsation
    mean: Level = 0.0
    phase: Angle = 0.0
    begin: Time = 0.0

    def pieces(self) -> Sequence[Piece]:
        """Return the one piece."""

        def function(t: Array) -> Values:
            x = self.pulsation * (t - self.begin) + self.phase
            s, c = self.amplitude * np.sin(x), self.amplitude * np.cos(x)
            return self.mean + s, self.pulsation * c, -self.pulsation * (self.pulsation * s)

        return [Piece(-math.inf, math.inf, function)]


class SCurve(MotionLaw, frozen=True, tag_field="law", tag="s_curve", rename=RENAMED):
    """From rest to rest with a bounded jerk: seven stretches of constant jerk, fewer where a limit is not reached.

    The acceleration is continuous. Limits of acceleration and speed that are left out do not bind.
    """

    start: Level
    end: Level
    jerk: ThirdRate
    acceleration: SecondRate | None = None
    speed: Rate | None = None
    begin: Time = 0.0

    def check(self) -> None:
        """Refuse limits that would never let it arrive."""
        limits = (self.jerk, self.acceleration, self.speed)
        if self.start != self.end and any(limit == 0.0 for limit in limits):
            raise InputError("an s_curve that goes somewhere needs limits other than 0")

    def pieces(self) -> Sequence[Piece]:
        """Return rest, the stretches of constant jerk that take any time, rest."""
        distance = self.end - self.start
        if distance == 0.0:
            return [Piece(-math.inf, math.inf, polynomial(0.0, self.start))]
        ramp, hold, cruise = self._durations(abs(distance))
        jerk = math.copysign(abs(self.jerk), distance)
        stretches = [(ramp, jerk), (hold, 0.0), (ramp, -jerk), (cruise, 0.0), (ramp, -jerk), (hold, 0.0), (ramp, jerk)]
        total = 4 * ramp + 2 * hold + cruise
        moving, t, state = [], self.begin, (self.start, 0.0, 0.0)
        for duration, j in stretches:
            if duration > ROUNDING * total:
                s, v, a = state
                function = polynomial(t, s, v, a / 2, j / 6)
                moving.append(Piece(t, t + duration, function))
                t += duration
                state = (s + v * duration + a * duration**2 / 2 + j * duration**3 / 6,
                         v + a * duration + j * duration**2 / 2, a + j * duration)  # fmt: skip
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


class SpeedPoints(MotionLaw, frozen=True, tag_field="law", tag="speed_points", rename=RENAMED):
    """Speed linear between given instants, constant before the first and after the last; ``from`` at the first.

    The acceleration jumps at every point.
    """

    points: list[tuple[Time, Rate]]
    start: Level = 0.0

    def check(self) -> None:
        """Refuse instants that do not ascend, and too few of them."""
        check_ascending([t for t, _ in self.points], 1)

    def check_units(self, of: Unit) -> None:
        """Check the position and every speed; see ``MotionLaw.check_units``."""
        super().check_units(of)
        check_all([speed for _, speed in self.points], of / unit("s"))

    def pieces(self) -> Sequence[Piece]:
        """Return constant speed, a parabola between each two points, constant speed."""
        (t, v), s = self.points[0], float(self.start)
        found = [Piece(-math.inf, t, polynomial(t, s, v))]
        for (t0, v0), (t1, v1) in pairwise(self.points):
            found.append(Piece(t0, t1, polynomial(t0, s, v0, (v1 - v0) / (t1 - t0) / 2)))
            s += (v0 + v1) / 2 * (t1 - t0)
        t, v = self.points[-1]
        return [*found, Piece(t, math.inf, polynomial(t, s, v))]


class Spline(MotionLaw, frozen=True, tag_field="law", tag="spline", rename=RENAMED):
    """Cubic spline through points, s'' continuous inside, with given speeds at its ends; constant speed beyond them."""

    points: list[tuple[Time, Level]]
    speeds: tuple[Rate, Rate] = (0.0, 0.0)

    def check(self) -> None:
        """Refuse instants that do not ascend, and too few of them."""
        check_ascending([t for t, _ in self.points], 2)

    def check_units(self, of: Unit) -> None:
        """Check every point and the end speeds; see ``MotionLaw.check_units``."""
        check_all([value for _, value in self.points], of)
        check_all(list(self.speeds), of / unit("s"))

    def pieces(self) -> Sequence[Piece]:
        """Return constant speed, one piece for all cubics (only their third derivative jumps), constant speed."""
        points = np.array(self.points, float)
        return spline_pieces(points[:, 0], points[:, 1], self.speeds)


class Table(MotionLaw, frozen=True, tag_field="law", tag="table"):
    """The spline through the rows of a CSV file: a heading such as ``t [s],theta [deg]``, then two numbers a row."""

    file: str
    speeds: tuple[Rate, Rate] = (0.0, 0.0)

    def check(self) -> None:
        """Read the table, so that its mistakes are found with those of the file that names it."""
        folder = folder_read() or Path(self.file).absolute().parent
        path = inside((folder / self.file).absolute(), root_of(folder))
        msgspec.structs.force_setattr(self, "file", str(path))
        read_once(self.file)

    def check_units(self, of: Unit) -> None:
        """Check the column's unit and the end speeds; see ``MotionLaw.check_units``."""
        measured = read_once(self.file)[2]
        if measured.dimension != of.dimension:
            raise UnitError(f"the table {self.file} is in {measured}", expected=f"a unit such as {of}")
        check_all(list(self.speeds), of / unit("s"))

    def pieces(self) -> Sequence[Piece]:
        """Return constant speed, the spline, constant speed."""
        times, values, _ = read_once(self.file)
        return spline_pieces(np.array(times), np.array(values), self.speeds)


def read_once(path: str) -> tuple[tuple[float, ...], tuple[float, ...], Unit]:
    """Return the instants, values and unit of a table; it is read again only when the file has changed."""
    from pinarm.input.tables import read_table

    state = Path(path).stat()
    return read_table(path, (state.st_mtime_ns, state.st_size))


class Segment(Model, frozen=True):
    """A law for a while.

    Attributes:
        duration: How long [s].
        motion: The law, in a time of its own that begins at 0.
    """

    duration: Duration
    motion: Law


class Succession(MotionLaw, frozen=True, tag_field="law", tag="succession", rename=RENAMED):
    """Laws end to end: each begins where the one before has come to, and its speed must be that of the one before.

    After the last one the speed stays what it is.
    """

    segments: Annotated[list[Segment], msgspec.Meta(min_length=1)]
    start: Level = 0.0
    begin: Time = 0.0

    def check_units(self, of: Unit) -> None:
        """Check every law; see ``MotionLaw.check_units``."""
        super().check_units(of)
        for segment in self.segments:
            segment.motion.check_units(of)

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


def spline_pieces(times: Array, values: Array, speeds: tuple[float, float]) -> list[Piece]:
    """Return a clamped cubic spline with constant speed before and after it."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(times, values, bc_type=((1, float(speeds[0])), (1, float(speeds[1]))))

    def function(t: Array) -> Values:
        return spline(t), spline(t, 1), spline(t, 2)

    first, last = float(times[0]), float(times[-1])
    return [
        Piece(-math.inf, first, polynomial(first, float(values[0]), float(speeds[0]))),
        Piece(first, last, function),
        Piece(last, math.inf, polynomial(last, float(values[-1]), float(speeds[1]))),
    ]


def check_ascending(times: Sequence[float], least: int) -> None:
    """Raise where there are too few instants, or they do not ascend.

    Raises:
        InputError: Names the first that does not.
    """
    if len(times) < least:
        raise InputError(f"{len(times)} points are too few", expected=f"at least {least}")
    for row, (before, after) in enumerate(pairwise(times)):
        if not after > before:
            raise InputError(f"the instants do not ascend: {before:g} s, then {after:g} s (point {row + 2})")


def check_all(values: Sequence[float], expected: Unit) -> None:
    """Check the units that values were written in.

    Raises:
        UnitError: One has another dimension.
    """
    for value in values:
        if isinstance(value, Measured):
            value.check(expected)


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
