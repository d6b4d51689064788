"""Integrals and percentiles of functions of a run, from its curve."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.records import ValueRecord
from pinarm.use.result.curve import DEGREE, FLAT, Curve, Pieces

RELATIVE, ABSOLUTE = 1e-10, 1e-13
"""Errors at which an integral is good enough, relative to itself and to the integral of the size of what is summed."""

UNSEEN = 1e-6
"""Difference of a function of size 1 to its polynomial that the polynomial has not seen."""

PATIENCE, NOISE, SPREAD = 4, 1e-4, 0.5
"""Rounds within which the error of an integral has to be halved, where it is below this part of the integral of the
size of a function, and no piece has more than this part of it: what is not halved is rounding of the function."""

NARROW, ROUGH = 1e-9, 1e-3
"""Part of an interval from which on pieces are so narrow that there is a pole in the last ones; and part of the
integral of a piece from which on its error is a matter of chance: the integral bounds what the piece leaves."""

NEAR, FAR, FEWEST, DIVERGES = 1e-12, 1e-7, 4, 0.05
"""Distances from a place, as parts of the interval, between which a function may grow towards it; pieces on one side
that show it; power of the distance that integrals over ``[d, 2 d]`` fall with at least where they have a sum: 1 where a
function is finite, 1/2 of the inverse root, 0 of the inverse of the distance."""

SMALLEST = 1e-290
"""Integral below which there is nothing to be relative to."""

ENOUGH, ROUNDING, MOST, SHARE = 1e-10, 1e-13, 1024, 1e-12
"""Error of a polynomial for a percentile, relative to the range of the function; relative to the largest value; how
many pieces are halved at most; and the rounding of a share of the length."""


def integrals(curve: Curve, least: float, most: int) -> tuple[Array, Array]:
    """Return the integrals of the functions, and bounds of their errors, both of shape (k,).

    Halving ends where every error is allowed, no piece can be halved, halving no longer helps, or ``most`` pieces
    have been evaluated: the bounds then tell what is left, after a way down to the worst place of every function,
    which shows whether it has an integral there.

    Args:
        curve: The curve.
        least: Size of functions that are not to be told from 0 beside others.
        most: Number of pieces that are evaluated at most, the first ones left out.
    """
    pieces, before, length = curve.first(fine=True), list[Array](), sum(span.length for span in curve.spans)
    while True:
        errors, unseen = pieces.integral_errors, _unseen(pieces)
        total, error = pieces.integrals.sum(axis=0), errors.sum(axis=0) + errors.max(axis=0) + unseen.sum(axis=0)
        before.append((errors + unseen).sum(axis=0))
        sizes = np.maximum(pieces.sizes.sum(axis=0), max(least * length, SMALLEST))
        allowed = np.maximum(4.0 * length * curve.noise, ABSOLUTE * sizes) + RELATIVE * np.abs(total)
        poor = _poor(curve, pieces, errors + unseen, allowed, most // 2)
        if (error <= allowed).all() or _stalled(before, errors, error, allowed, NOISE * sizes):
            return total, error
        if not len(poor):
            return _left_over(curve, pieces, error > allowed)
        pieces, most = curve.refined(pieces, poor), most - 2 * len(poor)


def _poor(curve: Curve, pieces: Pieces, errors: Array, allowed: Array, most: int) -> Indices:
    """Return the pieces that have to be halved, as few as leave half of the allowed errors, ascending."""
    share = (errors / allowed).max(axis=1)
    order = share.argsort(kind="stable")
    worst = order[np.cumsum(share[order]) > 0.5]
    return np.sort(worst[curve.divisible(pieces)[worst]][-most:] if most > 0 else worst[:0])


def _left_over(curve: Curve, pieces: Pieces, poor: Flags) -> tuple[Array, Array]:
    """Return integrals, and bounds of their errors where halving ends: infinite where an integral has no end.

    Args:
        curve: The curve.
        pieces: The last ones.
        poor: Whose errors are not allowed, shape (k,).
    """
    for k in np.flatnonzero(poor).tolist():
        pieces = _way_down(curve, pieces, k)
    errors, values = pieces.integral_errors, pieces.integrals
    length = np.array([curve.span[number].length for number in pieces.interval.tolist()])
    width = (pieces.high - pieces.low) / length
    narrow = width <= min(2.0 * float(width.min()), NARROW)
    rough = (errors > ROUGH * np.abs(values)) & ((pieces.tail > 0.4 * pieces.head) | (pieces.tail < 0.02 * pieces.head))
    bounds = (errors + np.where(narrow[:, None] | rough, np.abs(values), 0.0)).sum(axis=0)
    left = np.where(poor, bounds, errors.sum(axis=0) + errors.max(axis=0)) + _unseen(pieces).sum(axis=0)
    for k in np.flatnonzero(poor).tolist() if narrow.any() else ():
        at = int(np.where(narrow, errors[:, k], 0.0).argmax())
        if _diverges(curve, pieces, k, at):
            left[k] = np.inf
    return values.sum(axis=0), left


def _way_down(curve: Curve, pieces: Pieces, k: int) -> Pieces:
    """Return the pieces halved towards where a function has its largest error, as far as that goes."""
    worst = int(pieces.integral_errors[:, k].argmax())
    while curve.divisible(pieces.some(np.array([worst])))[0]:
        low, high, number = pieces.low[worst], pieces.high[worst], pieces.interval[worst]
        pieces = curve.refined(pieces, np.array([worst]))
        parts = np.flatnonzero((pieces.interval == number) & (pieces.low >= low) & (pieces.high <= high))
        worst = int(parts[pieces.integral_errors[parts, k].argmax()])
    return pieces


def _diverges(curve: Curve, pieces: Pieces, k: int, at: int) -> bool:
    """Tell whether integrals of a function do not fall towards a piece, as far as a sum of them takes."""
    own = pieces.some(pieces.interval == pieces.interval[at])
    middle, width = 0.5 * (own.low + own.high), own.high - own.low
    place = 0.5 * float(pieces.low[at] + pieces.high[at])
    distance = np.abs(middle - place) / curve.span[int(pieces.interval[at])].length
    mean = np.abs(own.integrals[:, k]) / width
    near = (distance > NEAR) & (distance < FAR) & (mean > 0.0)
    for side in (near & (middle < place), near & (middle > place)):  # it may be finite on one of them, or jump
        if np.count_nonzero(side) >= FEWEST:
            power = np.polyfit(np.log(distance[side]), np.log(mean[side]), 1)[0]
            if power < DIVERGES - 1.0:
                return True
    return False


def _unseen(pieces: Pieces) -> Array:
    """Return the possible change of the integrals by known values off the polynomials, shape (m, k)."""
    return np.where(pieces.off > UNSEEN + DEGREE * pieces.tail, 2.0 * pieces.half * pieces.off, 0.0)


def _stalled(before: list[Array], errors: Array, error_bounds: Array, allowed: Array, small: Array) -> bool:
    """Tell whether the last rounds did not halve the errors that are not allowed, though all are small.

    Args:
        before: Sums of errors of every round, shape (k,) each.
        errors: Those of the pieces of the last one, shape (m, k).
        error_bounds: Estimates of the errors of the integrals, shape (k,).
        allowed: Errors that are, shape (k,).
        small: Errors that are small, shape (k,).
    """
    if len(before) <= PATIENCE or (before[-1] > small).any():
        return False
    spread = errors.max(axis=0) <= SPREAD * before[-1]
    return bool(((spread & (before[-1] >= 0.5 * before[-1 - PATIENCE])) | (error_bounds <= allowed)).all())


def percentile(curve: Curve, share: float) -> tuple[float, float]:
    """Return the value below which the first function is for a share of the length, and the error of the value.

    Of polynomials the length on which they are below a value is known from where they pass it, and with it the
    percentile, to the error of the polynomials: two functions that differ by e at most have percentiles that differ
    by e at most.

    Args:
        curve: The curve.
        share: Between 0 and 1.
    """
    pieces, halved = curve.first(fine=True), 0
    most = MOST + len(pieces)
    while True:
        error, width = pieces.error[:, 0], pieces.high - pieces.low
        f = pieces.f[:, :, 0]
        level = max(ENOUGH * float(np.ptp(f)), ROUNDING * float(np.abs(f).max()))
        poor = np.flatnonzero((error > level) & curve.divisible(pieces))
        halved += len(poor)
        if not len(poor) or halved > most:
            break
        pieces = curve.refined(pieces, poor)
    arcs, rough = _Arcs.of(pieces), float(error.max())
    unknown = float(width[error > level].sum() / width.sum())
    within = min(rough, level + arcs.between(share, unknown)) if unknown else min(rough, level)
    return arcs.percentile(share), within + arcs.between(share, SHARE)  # values may jump just at the share


class _Arcs(ValueRecord, frozen=True):
    """Polynomials between the places where they turn: each rises or falls from its one end to the other.

    Attributes:
        pieces: The pieces.
        piece: Which of them each arc is of, shape (n,).
        ends: Where arcs begin and end, shape (2, n).
        values: Those at the ends, shape (2, n).
    """

    pieces: Pieces
    piece: Indices
    ends: Array
    values: Array

    @classmethod
    def of(cls, pieces: Pieces) -> _Arcs:
        """Return the arcs of pieces."""
        turns = [
            np.concatenate([[low], pieces.extremes(k), [high]])
            for k, (low, high) in enumerate(zip(pieces.low, pieces.high, strict=True))
        ]
        piece = np.repeat(np.arange(len(pieces)), [len(t) - 1 for t in turns])
        ends = np.array([np.concatenate([t[side] for t in turns]) for side in (slice(-1), slice(1, None))])
        return cls(pieces, piece, ends, np.array([pieces.at(piece, t)[:, 0] for t in ends]))

    def below(self, value: float) -> float:
        """Return the length on which the polynomials are below a value."""
        from scipy.optimize.elementwise import find_root

        least, most = self.values.min(axis=0), self.values.max(axis=0)
        passing = (least < value) & (value <= most)
        length = np.where(most < value, self.ends[1] - self.ends[0], 0.0)
        (low, high), piece = self.ends[:, passing], self.piece[passing]
        if len(low):
            place = find_root(
                lambda t, k: self.pieces.at(k.astype(np.intp), t)[:, 0] - value, (low, high), args=(piece,)
            ).x
            length[passing] = np.where(self.values[1, passing] > self.values[0, passing], place - low, high - place)
        return float(length.sum())

    def between(self, share: float, unknown: float) -> float:
        """Return the difference of the percentiles of ``share + unknown`` and ``share - unknown``, within 0 and 1."""
        return self.percentile(min(share + unknown, 1.0)) - self.percentile(max(share - unknown, 0.0))

    def percentile(self, share: float) -> float:
        """Return the value below which the polynomials are for a share of their length."""
        from scipy.optimize import brentq

        low, high = float(self.values.min()), float(self.values.max())
        wanted = share * float((self.ends[1] - self.ends[0]).sum())
        if low == high or wanted <= 0.0 or self.below(high) <= wanted:
            return low if wanted <= 0.0 else high
        return float(brentq(lambda value: self.below(value) - wanted, low, high, xtol=1e-15 * (high - low), rtol=FLAT))
