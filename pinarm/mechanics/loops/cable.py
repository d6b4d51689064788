"""A cable that does not stretch, of one mechanism."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import HeldCoordinate, PathLength
from pinarm.mechanics.geometry.kinematics import Kinematics


class CableLoop(HeldCoordinate, frozen=True, kw_only=True):
    """A cable of one mechanism: the constraint ``w(q) = length`` of its path, which can only be shorter.

    The multiplier lam pushes the points apart: the tension is ``-lam``.

    Attributes:
        coordinate: The length of its path.
        length: [m].
        opens: What happens where it opens, in words.
    """

    coordinate: PathLength
    length: float
    kind: str = "cable"
    side: float = -1.0
    opens: str = "it goes slack"

    @property
    def path(self) -> PathLength:
        return self.coordinate

    def gap(self, state: Kinematics) -> Array:
        return np.array([self.coordinate.value(state) - self.length])

    def push(self, q: Array, lam: Array) -> Array:
        return -lam

    def push_unit(self) -> Unit:
        return unit("N")

    def whereabouts(self, q: Array) -> str:
        """Return nothing: the instant tells."""
        return ""
