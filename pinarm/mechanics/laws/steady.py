"""Laws that hold for all time: rest, constant speed, constant acceleration, oscillation."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pinarm.input.yaml.schema import Abscissa, Angle, Level, Pulsation, Rate, SecondRate
from pinarm.mechanics.laws.motion_law import FILE_KEYS, MotionLaw, Piece, Wave, polynomial


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
        mean: Mean of the value.
        phase: Angle at ``begin``.
        begin: Instant at which the angle is ``phase``, such as ``0.5 s``.
    """

    amplitude: Level
    pulsation: Pulsation
    mean: Level = 0.0
    phase: Angle = 0.0
    begin: Abscissa = 0.0

    def pieces(self) -> Sequence[Piece]:
        function = Wave(self.mean, self.amplitude, 0.0, self.pulsation, self.phase, self.begin)
        return [Piece(-math.inf, math.inf, function)]
