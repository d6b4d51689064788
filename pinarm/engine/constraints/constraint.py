"""What may tie the coordinates of a mechanism: loop joints, couplings, and coordinates that are guided."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinarm.arrays import Array
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements


class Constraint(Protocol):
    """Rows of G that belong together, such as those of one joint."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def size(self) -> int:
        """Number m of rows."""
        ...

    def unit(self, row: int) -> Unit:
        """Return the unit of the gap in a row: m or rad."""
        ...

    def gap(self, state: Kinematics) -> Array:
        """Return what is not closed [m or rad], shape (m,)."""
        ...

    def rows(self, state: Kinematics) -> Array:
        """Return G, shape (m, nv)."""
        ...

    def drift(self, state: Kinematics) -> Array:
        """Return G' v, shape (m,)."""
        ...

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return what multipliers, shape (n, m), do to links: joint index -> [f; m] at the world's origin, (n, 6)."""
        ...


@dataclass(frozen=True, eq=False)
class GuidedCoordinate:
    """A coordinate that is held to a value by a force along itself; the multiplier is that force.

    Attributes:
        name: Name of the coordinate.
        coordinate: The coordinate.
        size: One row.
    """

    name: str
    coordinate: Coordinate
    size: int = 1

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
