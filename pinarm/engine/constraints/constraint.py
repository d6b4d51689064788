"""Constraints on the coordinates of a mechanism: loop joints, couplings, and guided coordinates."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, cast

import numpy as np

from pinarm.arrays import Array
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import Joint
from pinarm.records import Record


class Constraint(Protocol):
    """Rows of G that belong together, such as those of one joint."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def size(self) -> int:
        """Number m of rows."""

    @property
    def side(self) -> float:
        """Sense in which its multiplier can act, 1 or -1, as of a cam that only pushes; 0 where it holds both ways.

        A constraint with a side may open: its gap then has that sign.
        """

    def unit(self, row: int) -> Unit:
        """Return the unit of the gap in a row: m or rad."""

    def gap(self, state: Kinematics) -> Array:
        """Return what is not closed [m or rad], shape (m,)."""

    def rows(self, state: Kinematics) -> Array:
        """Return G, shape (m, nv)."""

    def drift(self, state: Kinematics) -> Array:
        """Return G' v, shape (m,)."""

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return what multipliers, shape (n, m), do to links: joint index -> [f; m] at the world's origin, (n, 6)."""


class GuidedCoordinate(Record, frozen=True):
    """A coordinate that is held to a value by a force along itself; the multiplier is that force.

    Attributes:
        name: Name of the coordinate.
    """

    name: str
    coordinate: Coordinate
    size: int = 1
    side: float = 0.0

    def unit(self, row: int) -> Unit:
        """Return the coordinate's unit."""
        return self.coordinate.unit

    def gap(self, state: Kinematics) -> Array:
        """Return the coordinate's value: what it is held to is the user's to subtract."""
        return np.array([self.coordinate.value(state)])

    def rows(self, state: Kinematics) -> Array:
        """Return its row."""
        return self.coordinate.row(state)[None]

    def drift(self, state: Kinematics) -> Array:
        """Return its drift."""
        return np.array([self.coordinate.drift(state)])

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return the force on the links whose points the coordinate measures."""
        return self.coordinate.wrenches(links, lam[:, 0])


class OneSidedConstraint(Constraint, Protocol):
    """A constraint of one row that pushes only, or pulls only, and opens where it would have to do the other."""

    @property
    def kind(self) -> str:
        """Its kind, as files call it."""

    @property
    def opens(self) -> str:
        """What happens where it opens, in words."""

    def push(self, q: Array, lam: Array) -> Array:
        """Return with what it acts [N, or N*m], negative against its sense; shape (n,).

        Args:
            q: Configurations, shape (n, nq).
            lam: Its multipliers, shape (n,).
        """

    def push_unit(self) -> Unit:
        """Return the unit of that."""

    def whereabouts(self, q: Array) -> str:
        """Return what tells a configuration, shape (nq,), apart for it, in words; may be empty."""


class JointTie(Constraint, Protocol):
    """What ties a joint without a body to a coordinate: that of a rotor, or one that counts turns."""

    @property
    def rotor(self) -> Joint:
        """The joint."""

    @property
    def coordinate(self) -> Coordinate:
        """What it moves as."""


def one_sided(constraints: Iterable[Constraint]) -> list[OneSidedConstraint]:
    """Return the constraints with a side."""
    return [cast("OneSidedConstraint", one) for one in constraints if one.side]


def joint_ties(constraints: Iterable[Constraint]) -> list[JointTie]:
    """Return the constraints that tie joints without a body."""
    return [cast("JointTie", one) for one in constraints if hasattr(one, "rotor")]
