"""A cable that does not stretch, of one mechanism."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import PathLength
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE
from pinarm.records import Record


class CableLoop(Record, frozen=True):
    """A cable of one mechanism: the constraint ``w(q) = length`` of its path, which can only be shorter.

    The multiplier lam pushes the points apart: the tension is ``-lam``.

    Attributes:
        name: Its name.
        path: Its path.
        length: [m].
        opens: What happens where it opens, in words.
    """

    name: str
    path: PathLength
    length: float
    kind: str = "cable"
    size: int = 1
    side: float = -1.0
    opens: str = "it goes slack"

    def unit(self, row: int) -> Unit:
        return METRE

    def gap(self, state: Kinematics) -> Array:
        return np.array([self.path.value(state) - self.length])

    def rows(self, state: Kinematics) -> Array:
        return self.path.row(state)[None]

    def drift(self, state: Kinematics) -> Array:
        return np.array([self.path.drift(state)])

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        return self.path.wrenches(links, lam[:, 0])

    def push(self, q: Array, lam: Array) -> Array:
        return -lam

    def push_unit(self) -> Unit:
        return unit("N")

    def whereabouts(self, q: Array) -> str:
        """Return nothing: the instant tells."""
        return ""
