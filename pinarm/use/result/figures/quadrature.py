"""Adaptive Gauss-Kronrod quadrature of several functions at once, all points of a round of bisections in one call.

A rule of 21 points K, exact for polynomials of degree 31, holds one of 10 points G; ``|K - G|`` bounds the error of K
from far above. R. Piessens and others, *QUADPACK* (1983), dqk21.f.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import Record

_HALF = (
    (0.995657163025808080735527280689003, 0.011694638867371874278064396062192, 0.0),
    (0.973906528517171720077964012084452, 0.032558162307964727478818972459390, 0.066671344308688137593568809893332),
    (0.930157491355708226001207180059508, 0.054755896574351996031381300244580, 0.0),
    (0.865063366688984510732096688423493, 0.075039674810919952767043140916190, 0.149451349150580593145863396957698),
    (0.780817726586416897063717578345042, 0.093125454583697605535065465083366, 0.0),
    (0.679409568299024406234327365114874, 0.109387158802297641899210590325805, 0.219086362515982043995534934228163),
    (0.562757134668604683339000099272694, 0.123491976262065851077958109831074, 0.0),
    (0.433395394129247190799265943165784, 0.134709217311473325928054001771707, 0.269266719309996355091226921569469),
    (0.294392862701460198131126603103866, 0.142775938577060080797094273138717, 0.0),
    (0.148874338981631210884826001129720, 0.147739104901338491374841515972068, 0.295524224714752870173815619188769),
)
"""Positive nodes, descending, and the weights of K and G there."""

_POSITIVE = np.array(_HALF)
NODES: Array = np.concatenate([-_POSITIVE[:, 0], [0.0], _POSITIVE[::-1, 0]])
KRONROD: Array = np.concatenate([_POSITIVE[:, 1], [0.149445554002916905664936468389821], _POSITIVE[::-1, 1]])
GAUSS: Array = np.concatenate([_POSITIVE[:, 2], [0.0], _POSITIVE[::-1, 2]])

NARROWEST = 1e-13
"""Part of an interval below which its parts are not bisected: their points would not differ."""

PATIENCE, NOISE = 4, 1e-4
"""Rounds of bisections within which the error has to be halved, where it is below this, relative to the largest value
times the length: what they do not halve is rounding of the functions, not their shape."""

SPREAD = 0.5
"""Part of an error that one panel has at most where it is rounding: that at a pole is the error of the panel there."""

NARROW = 1e-9
"""Part of an interval from which on panels are so narrow that there is a pole in the last ones."""

NEAR, FAR = 1e-12, 1e-7
"""Distances from a place, as parts of the interval, between which it is looked at how a function grows towards it."""

FEWEST = 6
"""Panels there that it takes to see that."""

DIVERGES = 0.05
"""Power of the distance from a place that integrals over ``[d, 2 d]`` fall with towards it at least where they have a
sum: 1 where a function is finite, 1/2 of the inverse root, 0 of the inverse of the distance."""


class Panels(Record, frozen=True):
    """Neighbouring parts of an interval, m of them, with the integrals of k functions over each.

    Attributes:
        low: Where each begins, ascending, shape (m,).
        high: Where each ends, shape (m,).
        values: Integrals, shape (m, k).
        errors: Bounds of their errors, shape (m, k).
    """

    low: Array
    high: Array
    values: Array
    errors: Array

    @staticmethod
    def points(low: Array, high: Array) -> Array:
        """Return where the functions have to be known between m pairs of bounds, ascending, shape (21 m,)."""
        return np.asarray((0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * NODES).ravel())

    @classmethod
    def of(cls, low: Array, high: Array, f: Array) -> Panels:
        """Return the panels between m pairs of bounds, the functions at their points given, shape (21 m, k)."""
        f = f.reshape(len(low), len(NODES), -1)
        half = 0.5 * (high - low)[:, None]
        kronrod = half * np.einsum("p,mpk->mk", KRONROD, f)
        return cls(low, high, kronrod, np.abs(kronrod - half * np.einsum("p,mpk->mk", GAUSS, f)))

    def refined(self, at: Callable[[Array], Array], poor: Indices) -> Panels:
        """Return them with some bisected: those whose numbers are given, ascending."""
        low, high = self.low[poor], self.high[poor]
        middle = 0.5 * (low + high)
        lows, highs = (np.stack(pair, 1).ravel() for pair in ((low, middle), (middle, high)))
        parts, kept = Panels.of(lows, highs, at(self.points(lows, highs))), np.delete(np.arange(len(self.low)), poor)
        order = np.concatenate([self.low[kept], lows]).argsort()
        merged = (np.concatenate([own[kept], new])[order]
                  for own, new in ((self.low, parts.low), (self.high, parts.high), (self.values, parts.values),
                                   (self.errors, parts.errors)))  # fmt: skip
        return Panels(*merged)

    def poor(self, allowed: Array, most: int) -> Indices:
        """Return the numbers of those that have to be bisected, as few as leave half of the allowed error, ascending.

        Args:
            allowed: Error of every integral that is good enough, shape (k,), positive.
            most: How many may be: those with the largest errors.
        """
        share = (self.errors / allowed).max(axis=1)
        order = share.argsort(kind="stable")
        worst = order[np.cumsum(share[order]) > 0.5]
        wide = self.high - self.low > NARROWEST * (self.high[-1] - self.low[0])
        return np.sort(worst[wide[worst]][-most:] if most > 0 else worst[:0])

    @property
    def told_errors(self) -> Array:
        """Estimates of the errors of all together, shape (k,).

        In a panel with a kink ``|K - G|`` is no bound: the worst panel counts twice.
        """
        return np.asarray(self.errors.sum(axis=0) + self.errors.max(axis=0))

    def left_over(self, poor: Flags) -> Array:
        """Return bounds of the errors where bisections end: larger at poles, and infinite where the sum has no end.

        Args:
            poor: Whose errors are not allowed, shape (k,).
        """
        width = (self.high - self.low) / (self.high[-1] - self.low[0])
        least = width <= min(2.0 * float(width.min()), NARROW)
        beside = self.errors + np.where(least[:, None], np.abs(self.values), 0.0)
        found = np.where(poor, beside.sum(axis=0), self.told_errors)
        for k in np.flatnonzero(poor).tolist() if least.any() else ():
            at = int(np.where(least, self.errors[:, k], 0.0).argmax())
            if self._grows(k, 0.5 * (self.low[at] + self.high[at])):
                found[k] = np.inf
        return found

    def _grows(self, k: int, place: float) -> bool:
        """Tell whether integrals of a function do not fall towards a place, as far as a sum of them takes."""
        middle, width = 0.5 * (self.low + self.high), self.high - self.low
        distance = np.abs(middle - place) / (self.high[-1] - self.low[0])
        mean = np.abs(self.values[:, k]) / width
        near = (distance > NEAR) & (distance < FAR) & (mean > 0.0)
        if np.count_nonzero(near) < FEWEST:
            return False
        power = np.polyfit(np.log(distance[near]), np.log(mean[near]), 1)[0]
        return bool(power < DIVERGES - 1.0)


def integrate(
    at: Callable[[Array], Array], first: Panels, relative: float, absolute: Array, most: int
) -> tuple[Array, Array]:
    """Return the integrals of k functions of size 1 over an interval, and bounds of their errors, both of shape (k,).

    Bisections end where every error is allowed, where no panel can be bisected, where they no longer help, or where
    ``most`` panels have been evaluated: the bounds then tell what is left.

    Args:
        at: Points, ascending, shape (n,) -> values of the functions, shape (n, k).
        first: The panel of the whole interval.
        relative: Allowed error relative to an integral.
        absolute: Allowed error of every integral beside that, shape (k,), positive.
        most: Number of panels that are evaluated at most, those of all rounds together.
    """
    panels, before, evaluated = first, list[Array](), 0
    while True:
        value, error = panels.values.sum(axis=0), panels.told_errors
        before.append(panels.errors.sum(axis=0))
        allowed = absolute + relative * np.abs(value)
        if (error <= allowed).all():
            return value, error
        poor = panels.poor(allowed, (most - evaluated) // 2)
        if not len(poor):
            return value, panels.left_over(error > allowed)
        if _noisy(before, panels, allowed):
            return value, error
        panels, evaluated = panels.refined(at, poor), evaluated + 2 * len(poor)


def _noisy(errors: list[Array], panels: Panels, allowed: Array) -> bool:
    """Tell whether the last rounds did not halve the errors that are not allowed, though all are small.

    Args:
        errors: Those of every round.
        panels: Those of the last one.
        allowed: Errors that are, shape (k,).
    """
    length = panels.high[-1] - panels.low[0]
    if len(errors) <= PATIENCE or (errors[-1] > NOISE * length).any():
        return False
    spread = panels.errors.max(axis=0) <= SPREAD * errors[-1]
    stalled = spread & (errors[-1] >= 0.5 * errors[-1 - PATIENCE])
    return bool((stalled | (panels.told_errors <= allowed)).all())
