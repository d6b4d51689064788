"""Force elements: what acts on a mechanism besides gravity and its drives, one family a module."""

from __future__ import annotations

from pinarm.mechanics.forces.contract import ForceElement
from pinarm.mechanics.forces.joint import JointEffort, JointFriction, JointSpring, TorqueSpeed
from pinarm.mechanics.forces.point import PointSpring, Wrench

Force = JointSpring | JointEffort | JointFriction | TorqueSpeed | PointSpring | Wrench
"""Any force element. A new one is a module or class beside these and one entry here."""

__all__ = ["Force", "ForceElement"]
