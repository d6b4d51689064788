"""What bearings carry under friction: linear in it, but for multipliers whose wrenches have kinks.

Teeth press their wheels apart whichever flanks touch, and a strand of a belt that would be pushed is slack: such
wrenches are linear in their multiplier on both sides of a kink. With the distances ``g = g0 + G f`` of the multipliers
from their kinks, linear in the friction f as accelerations and multipliers are,

    w_i(f) = w0_i + sum_j W_ij f_j + sum_p |g_p(f)| K_ip        (1)

The signs of g are not assumed: they are part of the equations that are solved with (1).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags

if TYPE_CHECKING:
    from pinarm.mechanics.friction.bearing import Bearing

SIDES = 1e-12
"""Part of its terms by which a multiplier may be on the other side of a kink: there both sides have one wrench."""


@dataclass(frozen=True, eq=False)
class CarriedLoads:
    """The wrenches (1) of k bearings as functions of m frictions, with p kinks.

    Attributes:
        wrench: w0 [N, N*m], shape (k, 6).
        response: W, wrench i per friction j, shape (k, m, 6).
        distance: g0 [N*m or N], shape (p,).
        rate: G, shape (p, m).
        fold: K, wrench i per size of distance p, shape (k, p, 6).
    """

    wrench: Array
    response: Array
    distance: Array
    rate: Array
    fold: Array

    @classmethod
    def linear(cls, wrench: Array, response: Array) -> CarriedLoads:
        """Return loads without kinks."""
        k, m, _ = response.shape
        return cls(wrench, response, np.zeros(0), np.zeros((0, m)), np.zeros((k, 0, 6)))

    @property
    def constant(self) -> bool:
        """Whether friction changes no load."""
        return not self.response.any() and not (self.rate.any() and self.fold.any())

    @property
    def bent(self) -> bool:
        """Whether there are kinks that change a load."""
        return bool(self.fold.any())

    def at(self, f: Array) -> Array:
        """Return the wrenches under friction f, shape (k, 6)."""
        wrench = self.wrench + np.vecmat(f, self.response)
        return np.asarray(wrench + np.vecmat(np.abs(self.distances(f)), self.fold))

    def distances(self, f: Array) -> Array:
        """Return g under friction f, shape (p,)."""
        return np.asarray(self.distance + self.rate @ f)

    def slope(self, f: Array) -> Array:
        """Return the wrench i per friction j about friction f, shape (k, m, 6)."""
        return np.asarray(self.response + (np.sign(self.distances(f))[:, None] * self.rate).T @ self.fold)

    def far(self, f: Array) -> Array:
        """Return the wrenches per x at last, under friction ``x f`` with x without end, shape (k, 6)."""
        return np.asarray(np.vecmat(f, self.response) + np.vecmat(np.abs(self.rate @ f), self.fold))

    def crossings(self, f: Array, way: Array) -> Array:
        """Return the x at which multipliers pass kinks under friction ``f + x way``, shape (.,)."""
        rates = self.rate @ way
        return np.asarray(-self.distances(f)[rates != 0.0] / rates[rates != 0.0])

    def most(self, i: int, bearing: Bearing) -> Array:
        """Return the most by which each friction of size 1 can change the load N of bearing i, shape (m,).

        Between any two f that differ by x in friction j the mean slope of ``|g_p|`` is ``s_p G_pj`` with s_p from -1 to
        1, and w changes by ``x (W_ij + sum_p s_p G_pj K_ip)``. Its lengths are convex in s: largest where all s_p are 1
        or -1.
        """
        return bearing.most_with_either_sign(self.response[i], self.rate[..., None] * self.fold[i][:, None])

    def reduced(self, fixed: Array, ways: Array) -> CarriedLoads:
        """Return the wrenches as functions of x for ``f = fixed + ways x``, shapes (m,) and (m, n)."""
        wrench = self.wrench + np.vecmat(fixed, self.response)
        return CarriedLoads(wrench, ways.T @ self.response, self.distances(fixed), self.rate @ ways, self.fold)

    def pieces(self) -> Iterator[tuple[Array, CarriedLoads]]:
        """Yield all signs of g, shape (p,), with the loads that are linear where g has them."""
        for signs in product([1.0, -1.0], repeat=len(self.distance)):
            side = np.array(signs)
            wrench = self.wrench + np.vecmat(side * self.distance, self.fold)
            yield side, CarriedLoads.linear(wrench, self.response + (side[:, None] * self.rate).T @ self.fold)

    def on_side(self, side: Array, f: Array) -> bool:
        """Return whether g has given signs, shape (p,), under friction f, or vanishes."""
        slack = SIDES * (np.abs(self.distance) + np.abs(self.rate) @ np.abs(f))
        within: Flags = side * self.distances(f) >= -slack
        return bool(within.all())
