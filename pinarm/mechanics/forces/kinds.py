"""The kinds of force element."""

from __future__ import annotations

from pinarm.mechanics.forces.along_coordinate import (
    CoordinateEffort,
    CoordinateSpring,
    JointEffort,
    JointSpring,
    RegularisedFriction,
    TorqueSpeed,
)
from pinarm.mechanics.forces.bushing import Bushing
from pinarm.mechanics.forces.points import ElasticCable, PointSpring, Wrench

Force = (
    JointSpring
    | JointEffort
    | RegularisedFriction
    | TorqueSpeed
    | PointSpring
    | ElasticCable
    | Bushing
    | Wrench
    | CoordinateSpring
    | CoordinateEffort
)
"""Any force element. A new one is a module or class beside these and one entry here."""
