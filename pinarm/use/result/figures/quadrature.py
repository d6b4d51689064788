"""Adaptive Gauss-Kronrod quadrature of several functions at once, all points of a round of bisections in one call.

A rule of 21 points K, exact for polynomials of degree 31, holds one of 10 points G; ``|K - G|`` bounds the error of K
from far above. R. Piessens and others, *QUADPACK* (1983), dqk21.f.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import Record, replace

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

BARYCENTRIC: Array = 1.0 / np.prod(np.subtract.outer(NODES, NODES) + np.eye(len(NODES)), axis=1)
"""Weights of the polynomial through values at the nodes."""

EDGES: Array = BARYCENTRIC / np.subtract.outer((-1.0, 1.0), NODES)
EDGES /= EDGES.sum(axis=1, keepdims=True)
"""Values at the nodes -> those of the polynomial through them at both ends of a panel, shape (2, 21)."""

COEFFICIENTS: Array = np.linalg.inv(np.cos(np.outer(np.arccos(NODES), np.arange(len(NODES)))))
"""Values at the nodes -> coefficients of the Chebyshev polynomials that are equal to them there, shape (21, 21)."""

TAIL, HEAD = slice(17, 21), slice(6, 9)
"""Of the coefficients: the last ones, and those of degree 6 to 8."""

KINKS, KINK = (0.02, 0.4), 1.5
"""Last coefficients relative to those of degree 6 to 8 between which there may be a kink in a panel: its place decides
how near K and G are; and the error of K over half the width and the last coefficients, of which 99 % are less at kinks,
corners of roots and jumps, wherever they are. At poles and of rounding coefficients fall less."""

OUTER = 0.5 * float(1.0 - NODES[-1])
"""Part of a panel beyond the outer node at either end: K and G agree on a jump there, which none sees."""

NARROWEST, ULPS = 1e-13, 256.0
"""Part of an interval, and units in the last place of its ends, below which its parts are not bisected: their points
would not differ."""

PATIENCE, NOISE = 4, 1e-4
"""Rounds of bisections within which the error has to be halved, where it is below this, relative to the integral of the
size of a function: what they do not halve is rounding of the functions, not their shape."""

SPREAD = 0.5
"""Part of an error that one panel has at most where it is rounding: that at a pole is the error of the panel there."""

NARROW = 1e-9
"""Part of an interval from which on panels are so narrow that there is a pole in the last ones."""

SMALLEST = 1e-290
"""Integral below which there is nothing to be relative to."""

ROUGH = 1e-3
"""Part of the integral of a panel from which on its error is a matter of chance, as beside a pole: not the error bounds
what the panel leaves, but the integral."""

NEAR, FAR = 1e-12, 1e-7
"""Distances from a place, as parts of the interval, between which it is looked at how a function grows towards it."""

FEWEST = 4
"""Panels on one side there that it takes to see that."""

DIVERGES = 0.05
"""Power of the distance from a place that integrals over ``[d, 2 d]`` fall with towards it at least where they have a
sum: 1 where a function is finite, 1/2 of the inverse root, 0 of the inverse of the distance."""


UNSEEN = 1e-6
"""Difference of a function of size 1 to the polynomial through the points of a panel that the panel has not seen."""

EXPLAINED = 10.0
"""Differences that the error of an integral explains, over its root: a polynomial through 21 points errs by about the
root of the error of its integral."""

CLOSE = 0.25
"""Width of panels over the distance of known points from which on they are no wider than what the points tell."""


class KnownValues(Record, frozen=True):
    """Values of k functions that are known beforehand, at n points.

    Attributes:
        t: The points, ascending, shape (n,).
        f: The values there, shape (n, k).
        jumps: Bounds of panels at which functions may jump.
    """

    t: Array
    f: Array
    jumps: Sequence[float] = ()

    def between(self, bounds: Array) -> KnownValues:
        """Return those strictly between bounds, shape (m,), at which functions may jump, that are finite."""
        places = np.searchsorted(bounds, self.t)
        inside = (places > 0) & (places < len(bounds)) & ~np.isin(self.t, bounds) & np.isfinite(self.f).all(axis=1)
        return KnownValues(self.t[inside], self.f[inside])

    def at(self, t: float) -> Array:
        """Return the values at a place, shape (1, k); NaN where they are not known."""
        here = self.f[self.t == t]
        return here[:1] if len(here) else np.full((1, self.f.shape[1]), np.nan)


class Panels(Record, frozen=True):
    """Neighbouring parts of an interval, m of them, with the integrals of k functions over each.

    Attributes:
        low: Where each begins, ascending, shape (m,).
        high: Where each ends, shape (m,).
        values: Integrals, shape (m, k).
        errors: Bounds of their errors, shape (m, k).
        f: The functions at the nodes, shape (m, 21, k).
    """

    low: Array
    high: Array
    values: Array
    errors: Array
    f: Array

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
        errors = np.abs(kronrod - half * np.einsum("p,mpk->mk", GAUSS, f))
        return cls(low, high, kronrod, np.maximum(errors, KINK * half * _kinks(f)), f)

    def refined(self, at: Callable[[Array], Array], poor: Indices) -> Panels:
        """Return them with some bisected: those whose numbers are given, ascending."""
        low, high = self.low[poor], self.high[poor]
        middle = 0.5 * (low + high)
        lows, highs = (np.stack(pair, 1).ravel() for pair in ((low, middle), (middle, high)))
        parts, kept = Panels.of(lows, highs, at(self.points(lows, highs))), np.delete(np.arange(len(self.low)), poor)
        order = np.concatenate([self.low[kept], lows]).argsort()
        merged = (np.concatenate([own[kept], new])[order]
                  for own, new in ((self.low, parts.low), (self.high, parts.high), (self.values, parts.values),
                                   (self.errors, parts.errors), (self.f, parts.f)))  # fmt: skip
        return Panels(*merged)

    def unseen(self, known: KnownValues) -> tuple[Indices, Array]:
        """Return the panels with known values off the polynomials through their points, and by how much at most.

        Numbers of panels, ascending, shape (p,), and distances, shape (p, k). Those that are narrower than what the
        points tell are not among them.
        """
        if len(known.t) < 2:
            return np.zeros(0, np.intp), np.zeros((0, known.f.shape[1]))
        panel = np.clip(np.searchsorted(self.high, known.t), 0, len(self.high) - 1)
        width = self.high - self.low
        x = (2.0 * known.t - self.low[panel] - self.high[panel]) / width[panel]
        off = np.abs(_interpolated(x, self.f[panel]) - known.f)
        allowed = UNSEEN + EXPLAINED * np.sqrt(self.errors / width[:, None])
        gap = np.gradient(known.t)
        found = (off > allowed[panel]).any(axis=1) & (width[panel] > CLOSE * gap)
        numbers, places = np.unique(panel[found], return_inverse=True)
        most = np.zeros((len(numbers), off.shape[1]))
        np.maximum.at(most, places, off[found])
        return numbers, most

    def with_jumps(self, known: KnownValues) -> Panels:
        """Return them with larger errors where functions may jump at their ends."""
        return replace(self, errors=self.errors + self.jumps_at_ends(known))

    def jumps_at_ends(self, known: KnownValues) -> Array:
        """Return what jumps beyond the outer nodes of panels may change in their integrals, shape (m, k).

        The polynomials of two neighbours differ by a jump where they meet, and so do those at the ends of the interval
        from the values there.
        """
        edges, width = np.append(self.low, self.high[-1]), (self.high - self.low)[:, None]
        begin, end = np.einsum("ep,mpk->emk", EDGES, self.f)
        slack = UNSEEN + EXPLAINED * np.sqrt(self.errors / width)
        off = np.abs(np.concatenate([known.at(edges[0]), end]) - np.concatenate([begin, known.at(edges[-1])]))
        slacks = np.concatenate([slack, slack[-1:]]) + np.concatenate([slack[:1], slack])
        off = np.where(np.isfinite(off) & (off > slacks) & ~np.isin(edges, known.jumps)[:, None], off, 0.0)
        return np.asarray(OUTER * width * (off[1:] + off[:-1]))

    def poor(self, allowed: Array, most: int) -> Indices:
        """Return the numbers of those that have to be bisected, as few as leave half of the allowed error, ascending.

        Args:
            allowed: Error of every integral that is good enough, shape (k,), positive.
            most: How many may be: those with the largest errors.
        """
        share = (self.errors / allowed).max(axis=1)
        order = share.argsort(kind="stable")
        worst = order[np.cumsum(share[order]) > 0.5]
        return np.sort(worst[self._divisible[worst]][-most:] if most > 0 else worst[:0])

    @property
    def sizes(self) -> Array:
        """Integrals of the sizes of the functions, shape (k,): where they cancel, more than their integrals."""
        half = 0.5 * (self.high - self.low)
        return np.asarray(np.einsum("m,p,mpk->k", half, KRONROD, np.abs(self.f)))

    def deepened(self, at: Callable[[Array], Array], poor: Flags) -> Panels:
        """Return them bisected towards where each poor function has its largest error, as far as bisections go.

        Args:
            at: As in ``integrate``.
            poor: Which functions are.
        """
        panels = self
        for k in np.flatnonzero(poor).tolist():
            worst = int(panels.errors[:, k].argmax())
            while panels._divisible[worst]:
                panels = panels.refined(at, np.array([worst]))
                worst += int(panels.errors[worst + 1, k] > panels.errors[worst, k])
        return panels

    @property
    def _divisible(self) -> Flags:
        """Which panels can be bisected, shape (m,)."""
        begin, end = float(self.low[0]), float(self.high[-1])
        least = max(NARROWEST * (end - begin), ULPS * math.ulp(max(abs(begin), abs(end))))
        return np.asarray(self.high - self.low > least)

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
        unsure = least[:, None] | ((self.errors > ROUGH * np.abs(self.values)) & (_kinks(self.f) == 0.0))
        beside = self.errors + np.where(unsure, np.abs(self.values), 0.0)
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
        for side in (near & (middle < place), near & (middle > place)):  # it may be finite on one of them, or jump
            if np.count_nonzero(side) >= FEWEST:
                power = np.polyfit(np.log(distance[side]), np.log(mean[side]), 1)[0]
                if power < DIVERGES - 1.0:
                    return True
        return False


def _kinks(f: Array) -> Array:
    """Return the last coefficients of functions in panels that may have a kink there, and 0 in others, shape (m, k).

    Args:
        f: The functions at the nodes, shape (m, 21, k).
    """
    tail, head = (np.abs(np.einsum("np,mpk->mnk", COEFFICIENTS[part], f)).max(axis=1) for part in (TAIL, HEAD))
    return np.where((KINKS[0] * head < tail) & (tail < KINKS[1] * head), tail, 0.0)


def _interpolated(x: Array, f: Array) -> Array:
    """Return polynomials through values at the nodes, shape (n, 21, k), at places of [-1, 1], shape (n,): (n, k).

    The barycentric formula: J.-P. Berrut, L. N. Trefethen, *Barycentric Lagrange interpolation* (2004), equation 4.2.
    """
    apart = x[:, None] - NODES
    at_node = np.abs(apart).argmin(axis=1)
    parts = BARYCENTRIC / np.where(apart == 0.0, 1.0, apart)
    on = (apart == 0.0).any(axis=1)
    parts[on] = np.eye(len(NODES))[at_node[on]]
    return np.asarray(np.einsum("np,npk->nk", parts, f) / parts.sum(axis=1)[:, None])


class AllowedErrors(Record, frozen=True):
    """The errors of the integrals of k functions that are good enough: the largest of three.

    Attributes:
        relative: Relative to an integral.
        absolute: Relative to the integral of the size of a function, or of ``least`` where that is more.
        least: Size of functions that are not to be told from 0 beside others.
        rounding: Rounding of every function, shape (k,).
    """

    relative: float
    absolute: float
    least: float
    rounding: Array

    def of(self, panels: Panels, sizes: Array) -> Array:
        """Return the errors that are allowed, shape (k,), positive."""
        rounding = (panels.high[-1] - panels.low[0]) * self.rounding
        value = np.abs(panels.values.sum(axis=0))
        return np.asarray(np.maximum(rounding, self.absolute * sizes) + self.relative * value)

    def sizes(self, panels: Panels) -> Array:
        """Return what errors are relative to beside the integrals, shape (k,), positive."""
        length = float(panels.high[-1] - panels.low[0])
        return np.maximum(panels.sizes, max(self.least * length, SMALLEST))


def integrate(
    at: Callable[[Array], Array], first: Panels, allowance: AllowedErrors, most: int, known: KnownValues
) -> tuple[Array, Array]:
    """Return the integrals of k functions of size 1 over an interval, and bounds of their errors, both of shape (k,).

    Bisections end where every error is allowed, where no panel can be bisected, where they no longer help, or where
    ``most`` panels have been evaluated: the bounds then tell what is left, after a way down to the worst place of every
    function, which shows whether it has an integral there. Panels that do not agree with values which are known
    beforehand are bisected as well.

    Args:
        at: Points, ascending, shape (n,) -> values of the functions, shape (n, k).
        first: The panel of the whole interval.
        allowance: The errors that are allowed.
        most: Number of panels that are evaluated at most, those of all rounds together.
        known: What is known of the functions.
    """
    inside = known.between(np.append(first.low, first.high[-1]))
    panels, before, evaluated = first, list[Array](), 0
    while True:
        told = panels.with_jumps(known)
        value, error = told.values.sum(axis=0), told.told_errors
        before.append(told.errors.sum(axis=0))
        sizes, room = allowance.sizes(panels), max(0, (most - evaluated) // 2)
        allowed = allowance.of(panels, sizes)
        fine = bool((error <= allowed).all())
        poor = np.zeros(0, np.intp) if fine else told.poor(allowed, room)
        if not len(poor) or _noisy(before, told, allowed, NOISE * sizes):
            unseen, off = panels.unseen(inside)
            if not len(unseen) or not room:
                off = np.sum((panels.high - panels.low)[unseen, None] * off, axis=0)
                if fine or len(poor):
                    return value, error + off
                poles = panels.told_errors > allowed  # jumps at ends of panels are bounded, and have an integral
                panels = panels.deepened(at, poles)
                jumps = panels.jumps_at_ends(known).sum(axis=0)
                return panels.values.sum(axis=0), panels.left_over(poles) + jumps + off
            poor, before = unseen[:room], []
        panels, evaluated = panels.refined(at, poor), evaluated + 2 * len(poor)


def _noisy(errors: list[Array], panels: Panels, allowed: Array, small: Array) -> bool:
    """Tell whether the last rounds did not halve the errors that are not allowed, though all are small.

    Args:
        errors: Those of every round.
        panels: Those of the last one.
        allowed: Errors that are, shape (k,).
        small: Errors that are small, shape (k,).
    """
    if len(errors) <= PATIENCE or (errors[-1] > small).any():
        return False
    spread = panels.errors.max(axis=0) <= SPREAD * errors[-1]
    stalled = spread & (errors[-1] >= 0.5 * errors[-1 - PATIENCE])
    return bool((stalled | (panels.told_errors <= allowed)).all())
