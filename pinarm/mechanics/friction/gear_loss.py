"""Losses of a gear between a rotor and what it drives, as friction at the speed of the gear.

The gear transmits T from the rotor, whose coordinate is reflected to the driven side, to what it drives, both of the
velocity v. With the friction ``f = mu |T|`` against the mean of the two velocities, which are one, each side bears half
of it. The rotor gives ``T + f/2`` and the driven side gets ``T - f/2`` while the motor drives; with the signs turned
round while it is driven. The efficiency is the same in both directions of power,

    eta = (1 - mu/2) / (1 + mu/2),    mu = 2 (1 - eta) / (1 + eta)

At rest f is whatever holds the gear, up to ``mu |T|``: between ``eta tau`` and ``tau / eta`` of the motor hold a load
tau. A motor without torque is turned by any load: such a gear never locks.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.input.units import Unit, unit
from pinarm.mechanics.couplings.coupling import Kink
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.contact import quantity_of
from pinarm.mechanics.friction.law import FrictionLaw
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.rotors import GearedRotor


@dataclass(frozen=True, eq=False)
class GearLoss:
    """The friction in the gear of one drive; see ``FrictionContact``.

    Attributes:
        name: ``drive.D``.
        gear: What ties the rotor to what it drives.
        law: Of friction.
        bearing: Of the multiplier, as the first component of a wrench.
        shared: See ``FrictionContact``.
    """

    name: str
    gear: GearedRotor
    law: FrictionLaw
    bearing: Bearing = field(repr=False)
    shared: bool = False

    @classmethod
    def of(cls, drive: str, gear: GearedRotor, efficiency: float) -> GearLoss:
        """Return the friction of a gear with an efficiency eta, above 0 and below 1."""
        mu = 2.0 * (1.0 - efficiency) / (1.0 + efficiency)
        bearing = Bearing.thread(np.array([1.0, 0.0, 0.0]), 1.0)
        return cls(f"drive.{drive}", gear, FrictionLaw(mu, mu, 0.0, 0.0), bearing)

    @property
    def quantity(self) -> str:
        """``drive.D.friction``."""
        return quantity_of(self.name)

    @property
    def effort(self) -> Unit:
        return unit("N" if self.gear.coordinate.unit == METRE else "N*m")

    @property
    def row_is_constant(self) -> bool:
        return False

    def row(self, state: Kinematics) -> Array:
        row = 0.5 * np.asarray(self.gear.coordinate.row(state), dtype=np.float64)
        row[self.gear.rotor.v] += 0.5
        return row

    def drift(self, state: Kinematics) -> float:
        return 0.5 * self.gear.coordinate.drift(state)

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        """Return what the friction, shape (n,), does to the driven links; nothing where it acts as joint efforts."""
        return self.gear.coordinate.wrenches(links, 0.5 * f)

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return nothing: they are linear."""
        return []

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        found = np.zeros((len(joints), 6))
        found[:, 0] = lam[self.gear.name][:, 0]
        return found
