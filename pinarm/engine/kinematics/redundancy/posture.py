"""The posture that a redundant mechanism keeps as near to as its path lets it, and the limits of its joints."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import Record

AT_LIMIT = 1e-9
"""Distance from a limit, relative to ``1 + |limit|`` [rad or m], below which a joint is at it."""


class Posture(Record, frozen=True):
    """A target q0 with weights w: ``sum_i (w_i (q_i - q0_i))^2`` is to be least, with q within limits.

    Attributes:
        target: q0 [rad or m]; 0 where the weight is, shape (nv,).
        weights: w; 0 of joints that nothing pulls, shape (nv,).
        lower: Lower limits [rad or m], infinite where there is none, shape (nv,).
        upper: Upper limits, likewise.
        places: Index in q of the coordinates that have a weight or a limit, by their index in v, shape (nv,).
        names: Names of the coordinates, in the order of v.
    """

    target: Array
    weights: Array
    lower: Array
    upper: Array
    places: Indices
    names: tuple[str, ...]

    @cached_property
    def pulled(self) -> Flags:
        """Which joints have a weight, shape (nv,)."""
        return np.asarray(self.weights > 0.0)

    @cached_property
    def limited(self) -> bool:
        """Whether any joint has a limit."""
        return bool(np.isfinite(self.lower).any() or np.isfinite(self.upper).any())

    def pull(self, q: Array) -> Array:
        """Return ``w (q - q0)``, the gradient of half the sum of squares over the coordinates ``w q``, shape (nv,)."""
        return np.asarray(self.weights * (self.positions(q) - self.target))

    def unit(self, scale: Array) -> Array:
        """Return the unit in which every coordinate is measured: 1/w, or a given scale without weight, shape (nv,)."""
        return np.where(self.pulled, 1.0 / np.where(self.pulled, self.weights, 1.0), scale)

    def positions(self, q: Array) -> Array:
        """Return the coordinates of configurations, shape (..., nq), in the order of v, shape (..., nv)."""
        return np.asarray(q[..., self.places])

    def margins(self, positions: Array) -> Array:
        """Return how far joints are within their limits, negative beyond them.

        Args:
            positions: Coordinates in the order of v, shape (..., nv).

        Returns:
            Lower and upper limits, infinite where there is none, shape (..., 2, nv).
        """
        return np.stack([positions - self.lower, self.upper - positions], axis=-2)

    def limit(self, joint: int, side: int) -> float:
        """Return the lower (0) or the upper (1) limit of a joint, by its index in v [rad or m]."""
        return float((self.lower, self.upper)[side][joint])

    @cached_property
    def slack(self) -> Array:
        """How near to a limit counts as at it [rad or m], shape (2, nv)."""
        limits = np.stack([self.lower, self.upper])
        return np.asarray(AT_LIMIT * (1.0 + np.where(np.isfinite(limits), np.abs(limits), 0.0)))
