"""Friction between the members of a coupling: what threads, teeth, belts and cams have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation, Kink
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.contact import quantity_of
from pinarm.mechanics.friction.law import FrictionLaw
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.records import replace


@dataclass(frozen=True, eq=False)
class CouplingContact(ABC):
    """A slip between the members of a coupling; see ``FrictionContact``.

    Attributes:
        name: ``coupling.C``.
        effort: Unit of the friction, N.
        coupling: What couples them.
        law: Of friction.
        bearing: Of what it carries, as the first component of a wrench.
        shared: See ``FrictionContact``.
    """

    name: str
    effort: Unit
    coupling: JointRelation
    law: FrictionLaw
    bearing: Bearing = field(repr=False)
    shared: bool = False

    @property
    def quantity(self) -> str:
        """``coupling.C.friction``."""
        return quantity_of(self.name)

    @property
    @abstractmethod
    def row_is_constant(self) -> bool:
        """Whether J is the same in all configurations."""

    @abstractmethod
    def row(self, state: Kinematics) -> Array:
        """Return J, shape (nv,)."""

    @abstractmethod
    def drift(self, state: Kinematics) -> float:
        """Return J' v."""

    @abstractmethod
    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        """Return what the friction, shape (n,), does to the members; see ``FrictionContact``."""

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return where these wrenches change their slope; see ``FrictionContact``."""
        return []

    def part(self, name: str, f: Array) -> Array:
        """Return what friction adds to a single force or moment of the coupling [N or N*m], shape (n,): nothing."""
        return np.zeros_like(f)

    @abstractmethod
    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        """Return what the bearing carries as the first component of a wrench, shape (n, 6)."""


@dataclass(frozen=True, eq=False)
class ConstantSlip(CouplingContact):
    """A slip whose row is constant, as of threads, teeth and belts, under the multiplier of the coupling.

    Attributes:
        slip: J, shape (nv,).
    """

    coupling: Coupling
    slip: Array = field(repr=False, kw_only=True)

    @property
    def coordinate(self) -> LinearCoordinate:
        """A sum of joint coordinates that stands still where the slip is 0, the largest weight 1."""
        return replace(self.coupling.coordinate, weights=self.slip / np.abs(self.slip).max())

    @property
    def row_is_constant(self) -> bool:
        return True

    def row(self, state: Kinematics) -> Array:
        return self.slip

    def drift(self, state: Kinematics) -> float:
        """Return 0: the row is constant."""
        return 0.0

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        return self.carried(lam)

    def carried(self, lam: dict[str, Array]) -> Array:
        """Return the same from the multipliers alone, shape (n, 6)."""
        multiplier = lam[self.coupling.name][:, :1]
        return np.concatenate([multiplier, np.zeros((len(multiplier), 5))], axis=1)
