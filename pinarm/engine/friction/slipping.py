"""Friction of joints that slip, where it depends on reactions that depend on friction.

With directions s of the slips, coefficients mu and constants c of the laws, and the wrenches w that the bearings carry,
which are linear in the friction f but for kinks, as of teeth that change flanks (``carried_loads``), friction is a root
of

    f_i + s_i (mu_i N_i(w(f)) + c_i) = 0        (1)

N is a sum of lengths, so ``N(w + x) - N(w) <= most(x)``: where the matrix C of ``mu_i`` times the most by which
friction j can change N_i has a spectral radius below 1 the map ``f -> -s (mu N + c)`` contracts in a suitable norm and
(1) has exactly one root, on any sides of the kinks. Where it has not, (1) may have none, as of a drawer that jams, or
several; of one joint, N being convex between kinks, it has none where it is nowhere below the friction.
Where normal forces are along lines, as in a plane, N is a sum of absolute values and (1) is linear for each choice of
their signs and of sides of the kinks: all roots are those that have the signs that they are computed with.
Source: Banach's theorem; the paradox is Painleve's (Lecons sur le frottement, 1895).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.friction.carried_loads import CarriedLoads
from pinarm.errors import DynamicsError

if TYPE_CHECKING:
    from pinarm.mechanics.friction.contact import FrictionContact

CONTRACTING = 1.0 - 1e-9
"""Spectral radius of C from which on (1) is not known to have one root."""

SIGNS = 10
"""Number of normal forces and kinks up to which all their signs are tried."""

CONSISTENT, SAME = 1e-12, 1e-9
"""Part of its terms by which a normal force may miss its sign, and part by which two roots of (1) are one."""

SOLVED, ITERATIONS = 4e-16, 200
"""Residual of (1), relative to its terms, at which Newton's method ends, and its steps at most."""


@dataclass(frozen=True, eq=False)
class Slipping:
    """Joints that slip, and the equation (1) of their friction.

    Attributes:
        contacts: The k joints.
        direction: s: 1, -1, components of a unit vector where the slip has several, or 0 without friction here, (k,).
        mu: Shape (k,).
        constant: c [N*m or N], shape (k,).
        loads: What their bearings carry.
    """

    contacts: Sequence[FrictionContact]
    direction: Array
    mu: Array
    constant: Array
    loads: CarriedLoads

    @cached_property
    def _rubbing(self) -> list[int]:
        """Joints that slip and whose friction depends on their load."""
        some: list[int] = (self.mu * self.direction).nonzero()[0].tolist()
        return some

    @cached_property
    def _most(self) -> Array:
        """C of the joints that rub, its rows times |s|, shape (r, r)."""
        some, size = self._rubbing, self.mu * np.abs(self.direction)
        rows = [size[i] * self.loads.most(i, self.contacts[i].bearing)[some] for i in some]
        return np.array(rows).reshape(len(some), len(some))

    def contraction(self) -> float:
        """Return the spectral radius of C, its rows times |s|: below 1 there is exactly one root."""
        return float(np.abs(np.linalg.eigvals(self._most)).max(initial=0.0))

    @property
    def contracts(self) -> bool:
        """Whether C tells that there is exactly one root."""
        bound = float(self._most.sum(axis=1).max(initial=0.0))  # of the spectral radius, and much cheaper
        return bound < CONTRACTING or self.contraction() < CONTRACTING

    @cached_property
    def roots(self) -> list[Array] | None:
        """All roots f, shape (k,), where normal forces are along lines; ``None`` where they are not known."""
        kinks, found = len(self.loads.distance), list[Array]()
        if kinks > SIGNS:
            return None
        for side, loads in self.loads.pieces():
            if (some := self._roots_under(loads, SIGNS - kinks)) is None:
                return None
            found += [f for f in some if self.loads.on_side(side, f) and not _known(f, found)]
        return found

    def _roots_under(self, loads: CarriedLoads, most: int) -> list[Array] | None:
        """Return the roots under loads without kinks; ``None`` where they are not known.

        Args:
            loads: What the bearings carry.
            most: Number of normal forces whose signs are tried.
        """
        terms = [self.contacts[i].bearing.along_lines(np.vstack([loads.wrench[i], loads.response[i]]))
                 for i in self._rubbing]  # fmt: skip
        if any(term is None for term in terms) or sum(len(term) for term in terms if term is not None) > most:
            return None
        levers = np.zeros((len(self.mu), 0))
        for i in self._rubbing:
            own = np.zeros((len(self.mu), len(self.contacts[i].bearing.levers)))
            own[i] = self.mu[i] * self.contacts[i].bearing.levers
            levers = np.hstack([levers, own])
        normals = np.vstack([term for term in terms if term is not None])
        return self._roots_among(levers, normals[:, 0], normals[:, 1:])

    def _roots_among(self, levers: Array, loads: Array, response: Array) -> list[Array] | None:
        """Return the roots of ``f + s (levers |loads + response f| + c) = 0``, shapes (k, p), (p,) and (p, k).

        ``None`` where the equation is singular for a choice of signs: it may have infinitely many.
        """
        found, constant = list[Array](), self.constant.copy()
        for i in self._rubbing:
            constant[i] += self.mu[i] * self.contacts[i].bearing.preload
        for signs in product([1.0, -1.0], repeat=len(loads)):
            signed = self.direction[:, None] * levers * np.array(signs)
            matrix = np.eye(len(constant)) + signed @ response
            if np.linalg.cond(matrix) > 1.0 / SAME:
                return None
            f = np.linalg.solve(matrix, -signed @ loads - self.direction * constant)
            slack = CONSISTENT * (np.abs(loads) + np.abs(response) @ np.abs(f))
            if (signs * (loads + response @ f) >= -slack).all() and not _known(f, found):
                found.append(f)
        return found

    def require_one_root_here(self) -> bool:
        """Return whether (1) has a root for these loads, be it that it has several for others.

        Raises:
            DynamicsError: It has several, or that it has one is not known.
        """
        if not self.contracts and self.roots is not None and len(self.roots) < 2:
            return bool(self.roots)
        return self.require_one_root()

    def require_one_root(self) -> bool:
        """Return whether (1) has a root, which changes little with the loads.

        Raises:
            DynamicsError: It has several, or that it has one is not known.
        """
        if self.contracts:
            return True
        some = self._rubbing
        coupled = [i for i in some if self.loads.most(i, self.contacts[i].bearing)[some].any()]
        if len(coupled) == 1 and not self._dips(coupled[0]):
            return False
        names = " and ".join(dict.fromkeys(self.contacts[i].name for i in coupled))
        raise DynamicsError(
            f"the friction of {names} and the reactions that it depends on do not determine each other: "
            f"friction raises its own load {self.contraction():.3g} times; more than one motion is possible, or none",
            expected="friction that raises its load less than once",
            hint="a smaller mu, a longer span of a guide; of a worm or screw that locks itself: a drive, or friction, "
            "at the joint of the worm or the screw, above all where loads act there",
        )  # fmt: skip

    def _dips(self, i: int) -> bool:
        """Return whether ``h(x) = mu N(w) + c - x`` falls to 0 for a friction x > 0 of joint i, others constant."""
        others, way = -self.direction * self.constant, np.zeros(len(self.mu))
        others[i], way[i] = 0.0, -self.direction[i]
        if self.mu[i] * self.contacts[i].bearing.most(self.loads.far(way)[i]) < CONTRACTING:
            return True

        def h(x: float) -> float:
            return float(self.resistance(others + x * way)[i] - x)

        return least_of(h, self.loads.crossings(others, way)) <= 0.0

    def resistance(self, f: Array) -> Array:
        """Return ``mu N(w(f)) + c`` [N*m or N], shape (k,)."""
        wrench, resistance = self.loads.at(f), self.constant.copy()
        for i in self.mu.nonzero()[0].tolist():
            resistance[i] += self.mu[i] * self.contacts[i].bearing.load(wrench[i])
        return resistance

    def friction(self) -> Array:
        """Return the root f, shape (k,), of an equation that has one.

        Newton's method, and the contraction itself where it goes astray at a normal force that vanishes.
        """
        if not self.contracts and self.roots:
            return self.roots[0]
        f = -self.direction * self.resistance(np.zeros(len(self.mu)))
        left = self._left(f)
        for _ in range(ITERATIONS):
            if np.abs(left).max(initial=0.0) <= SOLVED * np.abs(f).max(initial=0.0):
                break
            better = f - np.linalg.solve(self._slope(f), left)
            if not np.abs(self._left(better)).max() < 0.5 * np.abs(left).max():
                better = f - left
            if np.array_equal(better, f):
                break
            f, left = better, self._left(better)
        return f

    def _left(self, f: Array) -> Array:
        return np.asarray(f + self.direction * self.resistance(f))

    def _slope(self, f: Array) -> Array:
        """Return the derivative of (1), shape (k, k)."""
        wrench, response, slope = self.loads.at(f), self.loads.slope(f), np.eye(len(f))
        for i, contact in enumerate(self.contacts):
            if self.mu[i] and self.direction[i]:
                slope[i] += self.direction[i] * self.mu[i] * response[i] @ contact.bearing.slope(wrench[i])
        return slope


def _known(f: Array, found: Sequence[Array]) -> bool:
    """Return whether a root is among those that are found."""
    return any(np.abs(f - one).max() <= SAME * np.abs(one).max() for one in found)


def least_of(h: Callable[[float], float], kinks: Array) -> float:
    """Return the least value of a function of ``x >= 0`` that is convex between kinks and grows at last."""
    ends = [0.0, *sorted(kinks[kinks > 0.0].tolist())]
    last, step = ends[-1], abs(h(ends[-1])) + 1.0
    while h(last + 2.0 * step) < h(last + step):
        step *= 2.0
    return min(_least_between(h, low, high) for low, high in pairwise([*ends, last + 2.0 * step]))


def _least_between(h: Callable[[float], float], low: float, high: float) -> float:
    """Return the least value of a convex function between two places, by bisection in three parts."""
    for _ in range(ITERATIONS):
        one, two = low + (high - low) / 3.0, high - (high - low) / 3.0
        low, high = (low, two) if h(one) < h(two) else (one, high)
    return h(low)
