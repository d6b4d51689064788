"""Laws of motion, one family in each module. A new law is a class in one of them and an entry in ``kinds.Law``."""

from __future__ import annotations

from pinarm.mechanics.laws.interpolated import PiecewiseLinear, SpeedPoints, Spline, Steps, Table
from pinarm.mechanics.laws.kinds import (
    Constant,
    ConstantAcceleration,
    ConstantSpeed,
    Cycloidal,
    Harmonic,
    Law,
    Polynomial,
    SCurve,
    Segment,
    Succession,
    Trapezoid,
)
from pinarm.mechanics.laws.over_coordinate import Motion, Over

__all__ = [
    "Constant", "ConstantAcceleration", "ConstantSpeed", "Cycloidal", "Harmonic", "Law", "Motion", "Over",
    "PiecewiseLinear", "Polynomial", "SCurve", "Segment", "SpeedPoints", "Spline", "Steps", "Succession",
    "Table", "Trapezoid",
]  # fmt: skip
