"""Functions of a run as Chebyshev polynomials on pieces of it, and their integrals, extremes, percentiles and zeros.

Each number begins with the same first pieces, and halves those in which the polynomials do not tell it: a number does
not depend on the numbers that were asked before. Places where the run may bend or jump, such as points of laws and ends
of steps, are where pieces are halved, if there are any inside. Values that are known elsewhere, such as rows, lie on
the polynomials, or their pieces are halved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array, Flags, Indices, distinct
from pinarm.errors import InputError
from pinarm.records import Record, ValueRecord, replace
from pinarm.use.result.pieces import DEGREE, FLAT, NODES, Pieces

Spots = Sequence[tuple[int, Array]]
"""Numbers of intervals, and places in each, shape (n,)."""

Values = Callable[[Spots], Sequence[Array]]
"""Places of intervals -> values of k functions there, shape (n, k) each, or (n,) of one function."""

NARROWEST, ULPS = 1e-13, 256.0
"""Part of an interval, and units in the last place of its ends, below which pieces are not halved: their points would
not differ."""

CLOSE = 0.02
"""Width of pieces over the distance of known values from which on the pieces are narrower than what these tell."""

GROWTH, AT_FIRST = 1.25, 0.4
"""Least growth of the last coefficients from a piece to its half at a pole, and from which part of the first ones: they
double at a simple pole, by how close a node happens to be to it; a jump leaves them, and a kink halves them."""

INHERITED = 0.5
"""Part of the error of a piece that is left in its halves at least, unless their coefficients fall: a spike that one
node is close to may be far from all nodes of a half."""

MOST_CUTS = 50
"""Places at most in an interval at which functions are infinite."""

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

NEIGHBOURS: Array = np.add.outer((0.1127, 0.3819, 0.5, 0.7236, 0.9472), 1e-7 * np.arange(-1.5, 2.0))
"""Points whose differences are rounding, as parts of an interval: five clusters of four, shape (5, 4)."""

HALVINGS, MOST_PIECES, MOST_KINKS = 6, 64, 4
"""Rounds of a search for the largest value in which 64 pieces are halved at most, those that may rise most; in later
rounds, towards kinks and poles, 4 pieces."""

BEGINS, ROUNDS, WINDOW, ENDLESS, RISES = 0.01, 14, 3, 0.5, 1e-3
"""How far from a pole, as a part of the interval, steps towards it begin; how many, each an eighth as far away; in how
many the rise of a function is compared with that before; part of a rise that follows it without end: 500 times at a
simple pole, all of it at a logarithm, a 500th at a kink; first rise, relative to the height, below which values grow by
their rounding."""

ENOUGH, ROUNDING, MOST = 1e-10, 1e-13, 1024
"""Error of a polynomial for a percentile, relative to the range of the function; relative to the largest value; and how
many pieces are halved at most."""

CROSSING_ROUNDS, CORRECTIONS = 5, 2
"""How often pieces are halved in which two zeros may be unseen; Newton's steps from the zero of a polynomial."""

TOUCHES, CONTINUOUS, ONE, BESIDE = 1e-12, 1e-4, 1e-4, 1e-9
"""Height of an extreme, relative to the largest value, at which a function touches zero; value at a change of sign,
relative to those beside it, below which it is 0 there and does not jump over 0; part of the whole within which zeros
are one where the function is 0 between them; and part from a place to those on both sides of it."""


class Endless(Exception):
    """A function has no largest value.

    Attributes:
        place: Where it grows without end.
    """

    def __init__(self, place: float) -> None:
        self.place = place


class Peak(ValueRecord, frozen=True):
    """A height of a function, and where it is.

    Attributes:
        height: The height.
        interval: Number of the interval.
        place: Where in it.
        error: By how much the function may be above it elsewhere.
    """

    height: float
    interval: int
    place: float
    error: float = 0.0


class Span(Record, frozen=True):
    """An interval of a run, ascending.

    Attributes:
        number: Its number.
        bounds: Where it is cut into the first pieces, ends included.
        points: Where functions may bend within the first pieces, such as points of laws; integrals are cut there.
        steps: Where they may bend a little, such as ends of steps.
        jumps: Places among bounds and points at which functions may jump: they are not evaluated there.
        sides: Places next to these on both sides.
        t: Where values are known, ascending, shape (n,).
        f: The values, shape (n, k).
    """

    number: int
    bounds: Array
    points: Array
    steps: Array
    jumps: Array
    sides: Array
    t: Array
    f: Array

    @cached_property
    def fine(self) -> Array:
        """Where it is cut for integrals."""
        return distinct(np.concatenate([self.bounds, self.points]))

    @cached_property
    def cuts(self) -> Array:
        """Where pieces are halved."""
        return distinct(np.concatenate([self.points, self.steps]))

    @cached_property
    def gaps(self) -> Array:
        """Distances of known values, shape (n,)."""
        return np.gradient(self.t) if len(self.t) > 1 else np.full(len(self.t), np.inf)

    @property
    def length(self) -> float:
        """Of the interval."""
        return float(self.bounds[-1] - self.bounds[0])

    def divisible(self, width: Array) -> Flags:
        """Return which pieces can be halved, by their widths."""
        ends = np.abs(self.bounds[[0, -1]]).max()
        return np.asarray(width > max(NARROWEST * self.length, ULPS * math.ulp(float(ends))))


class Curve(Struct, eq=False, dict=True):
    """Functions of a run.

    Attributes:
        values: Evaluates them.
        spans: The intervals that have a length.
    """

    values: Values
    spans: Sequence[Span]
    _kept: dict[tuple[int, float, float], Array] = {}
    _soft: dict[int, set[float]] = {}

    @cached_property
    def _span(self) -> dict[int, Span]:
        return {span.number: span for span in self.spans}

    def first(self, *, fine: bool) -> Pieces:
        """Return the pieces with which a number begins; finer ones are cut at all points where functions may bend."""
        ends = [(span.number, span.fine if fine else span.bounds) for span in self.spans]
        interval = np.repeat([number for number, _ in ends], [len(bounds) - 1 for _, bounds in ends])
        low, high = (np.concatenate([bounds[part] for _, bounds in ends]) for part in (slice(-1), slice(1, None)))
        return self.pieces(interval, low, high)

    def pieces(self, interval: Indices, low: Array, high: Array) -> Pieces:
        """Return the pieces between bounds, each of shape (m,); those with infinite values are cut there.

        Raises:
            InputError: There is no end of places with infinite values.
        """
        while True:
            f = self._evaluated(interval, low, high)
            infinite = np.asarray(~np.isfinite(f).all(axis=2))
            if not infinite.any():
                break
            interval, low, high = self._cut(interval, low, high, infinite)
        nothing = np.zeros((len(low), f.shape[2]))
        pieces = Pieces(interval, low, high, self._open(interval, low, high), f, nothing, nothing, nothing)
        return replace(pieces, off=self._off(pieces))

    def _evaluated(self, interval: Indices, low: Array, high: Array) -> Array:
        """Return the functions at the nodes of pieces, shape (m, 17, k)."""
        spots = [*map(self._places, interval.tolist(), low.tolist(), high.tolist())]
        keys = [(number, float(t[0]), float(t[-1])) for number, t in spots]
        lacking = {key: spot for key, spot in zip(keys, spots, strict=True) if key not in self._kept}
        for key, f in zip(lacking, self.values([*lacking.values()]) if lacking else (), strict=True):
            self._kept[key] = f.reshape(DEGREE + 1, -1)
        return np.array([self._kept[key] for key in keys])

    def _open(self, interval: Indices, low: Array, high: Array) -> Indices:
        """Return which pieces have an end at which functions may jump, as 1 or 0, shape (m,)."""
        ends = zip(interval.tolist(), low.tolist(), high.tolist(), strict=True)
        return np.array([self._may_jump(k, a) or self._may_jump(k, b) for k, a, b in ends], dtype=np.intp)

    def _places(self, interval: int, low: float, high: float) -> tuple[int, Array]:
        """Return where functions are evaluated on a piece."""
        is_open = self._may_jump(interval, low) or self._may_jump(interval, high)
        t = 0.5 * (low + high) + 0.5 * (high - low) * NODES[int(is_open)]
        if not is_open:
            t[0], t[-1] = low, high
        return interval, t

    def _may_jump(self, interval: int, place: float) -> bool:
        if interval not in self._soft:
            self._soft[interval] = set(self._span[interval].jumps.tolist())
        return place in self._soft[interval]

    def _cut(self, interval: Indices, low: Array, high: Array, infinite: Flags) -> tuple[Indices, Array, Array]:
        """Return bounds of pieces with further cuts: at the first infinite value of each piece that has any."""
        more, before = list[tuple[int, float, float]](), {number: {*places} for number, places in self._soft.items()}
        for k in np.flatnonzero(infinite.any(axis=1)).tolist():
            node, number = int(infinite[k].argmax()), int(interval[k])
            place = float(self._places(number, float(low[k]), float(high[k]))[1][node])
            if place in before[number] or len(before[number]) > MOST_CUTS + len(self._span[number].jumps):
                raise InputError(f"it is not finite about {place:.9g}", expected="a quantity that is finite")
            self._soft[number].add(place)
            more += [(number, place, float(high[k]))] if low[k] < place < high[k] else []
            high[k] = place if low[k] < place < high[k] else high[k]
        starts = [np.array([piece[part] for piece in more]) for part in range(3)]
        if not more:
            return interval, low, high
        interval, low, high = (np.concatenate(pair) for pair in zip((interval, low, high), starts, strict=True))
        order = np.lexsort((low, interval))
        return interval[order], low[order], high[order]

    def _off(self, pieces: Pieces) -> Array:
        """Return how far known values within pieces are from the polynomials at most, shape (m, k)."""
        off = np.zeros_like(pieces.tail)
        for number in distinct(pieces.interval).tolist():
            span, own = self._span[number], np.flatnonzero(pieces.interval == number)
            begin = np.searchsorted(span.t, pieces.low[own], "right")
            count = np.maximum(np.searchsorted(span.t, pieces.high[own], "left") - begin, 0)
            piece = np.repeat(own, count)
            known = np.arange(len(piece)) + np.repeat(begin - np.cumsum(count) + count, count)
            told = (pieces.high - pieces.low)[piece] > CLOSE * span.gaps[known]
            piece, known = piece[told], known[told]
            if len(piece):
                np.maximum.at(off, piece, np.abs(pieces.at(piece, span.t[known]) - span.f[known]))
        return off

    def divisible(self, pieces: Pieces) -> Flags:
        """Return which pieces can be halved, shape (m,)."""
        width, flags = pieces.high - pieces.low, np.zeros(len(pieces), bool)
        for number in distinct(pieces.interval).tolist():
            own = pieces.interval == number
            flags[own] = self._span[number].divisible(width[own])
        return flags

    def halves(self, pieces: Pieces) -> Pieces:
        """Return both parts of pieces, in the order of these: cut where functions may bend next to the middle."""
        middle = 0.5 * (pieces.low + pieces.high)
        for k, (number, low, high) in enumerate(zip(pieces.interval.tolist(), pieces.low, pieces.high, strict=True)):
            span = self._span[number]
            inside = span.cuts[np.searchsorted(span.cuts, low, "right") : np.searchsorted(span.cuts, high, "left")]
            inside = inside[span.divisible(inside - low) & span.divisible(high - inside)]
            if len(inside):
                middle[k] = inside[np.abs(inside - middle[k]).argmin()]
        low, high = np.stack([pieces.low, middle], 1).ravel(), np.stack([middle, pieces.high], 1).ravel()
        parts = self.pieces(pieces.interval.repeat(2), low, high)
        of = self._parents(pieces, parts)
        least = INHERITED * np.maximum(pieces.error, pieces.least)
        grown = GROWTH * np.where(pieces.grown > 0.0, pieces.grown, AT_FIRST * pieces.tail)
        return replace(parts, least=least[of], grown=grown[of])

    @staticmethod
    def _parents(pieces: Pieces, parts: Pieces) -> Indices:
        """Return which piece each part is of, shape (m,)."""
        inside = (parts.low[:, None] >= pieces.low) & (parts.high[:, None] <= pieces.high)
        return np.asarray((inside & (parts.interval[:, None] == pieces.interval)).argmax(axis=1))

    def refined(self, pieces: Pieces, poor: Indices) -> Pieces:
        """Return the pieces with some halved."""
        kept = np.ones(len(pieces), bool)
        kept[poor] = False
        return pieces.some(kept).joined(self.halves(pieces.some(poor)))

    @cached_property
    def noise(self) -> Array:
        """Rounding of the functions, shape (k,): what points next to each other differ by.

        Third differences d of a smooth function over steps of 1e-7 of an interval vanish; of independent errors with
        the deviation s they have the median ``d² = 0.455 · 20 s²``, in which a jump at a cluster has no part.
        """
        ends = np.cumsum([span.length for span in self.spans])
        places = [int(np.searchsorted(ends, part * ends[-1])) for part in NEIGHBOURS[:, 1]]
        spots = [(self.spans[k].number, self.spans[k].bounds[0] + self.spans[k].length * parts)
                 for k, parts in zip(places, NEIGHBOURS, strict=True)]  # fmt: skip
        values = np.array([f.reshape(len(t), -1) for f, (_, t) in zip(self.values(spots), spots, strict=True)])
        differences = np.diff(np.where(np.isfinite(values), values, 0.0), 3, axis=1)[:, 0]
        middle = np.sort(differences**2, axis=0)[len(differences) // 2]
        return np.asarray(np.sqrt(middle / 9.1))

    # Integrals

    def integrals(self, least: float, most: int) -> tuple[Array, Array]:
        """Return the integrals of the functions, and bounds of their errors, both of shape (k,).

        Halving ends where every error is allowed, no piece can be halved, halving no longer helps, or ``most`` pieces
        have been evaluated: the bounds then tell what is left, after a way down to the worst place of every function,
        which shows whether it has an integral there.

        Args:
            least: Size of functions that are not to be told from 0 beside others.
            most: Number of pieces that are evaluated at most, the first ones left out.
        """
        pieces, before, length = self.first(fine=True), list[Array](), sum(span.length for span in self.spans)
        while True:
            errors, unseen = pieces.integral_errors, _unseen(pieces)
            total, told = pieces.integrals.sum(axis=0), errors.sum(axis=0) + errors.max(axis=0) + unseen.sum(axis=0)
            before.append((errors + unseen).sum(axis=0))
            sizes = np.maximum(pieces.sizes.sum(axis=0), max(least * length, SMALLEST))
            allowed = np.maximum(4.0 * length * self.noise, ABSOLUTE * sizes) + RELATIVE * np.abs(total)
            poor = self._poor(pieces, errors + unseen, allowed, most // 2)
            if (told <= allowed).all() or _stalled(before, errors, told, allowed, NOISE * sizes):
                return total, told
            if not len(poor):
                return self._left_over(pieces, told > allowed)
            pieces, most = self.refined(pieces, poor), most - 2 * len(poor)

    def _poor(self, pieces: Pieces, errors: Array, allowed: Array, most: int) -> Indices:
        """Return the pieces that have to be halved, as few as leave half of the allowed errors, ascending."""
        share = (errors / allowed).max(axis=1)
        order = share.argsort(kind="stable")
        worst = order[np.cumsum(share[order]) > 0.5]
        return np.sort(worst[self.divisible(pieces)[worst]][-most:] if most > 0 else worst[:0])

    def _left_over(self, pieces: Pieces, poor: Flags) -> tuple[Array, Array]:
        """Return integrals, and bounds of their errors where halving ends: infinite where an integral has no end.

        Args:
            pieces: The last ones.
            poor: Whose errors are not allowed, shape (k,).
        """
        for k in np.flatnonzero(poor).tolist():
            pieces = self._way_down(pieces, k)
        errors, values = pieces.integral_errors, pieces.integrals
        length = np.array([self._span[number].length for number in pieces.interval.tolist()])
        width = (pieces.high - pieces.low) / length
        narrow = width <= min(2.0 * float(width.min()), NARROW)
        rough = (errors > ROUGH * np.abs(values)) & (
            (pieces.tail > 0.4 * pieces.head) | (pieces.tail < 0.02 * pieces.head)
        )
        bounds = (errors + np.where(narrow[:, None] | rough, np.abs(values), 0.0)).sum(axis=0)
        told = np.where(poor, bounds, errors.sum(axis=0) + errors.max(axis=0)) + _unseen(pieces).sum(axis=0)
        for k in np.flatnonzero(poor).tolist() if narrow.any() else ():
            at = int(np.where(narrow, errors[:, k], 0.0).argmax())
            if self._diverges(pieces, k, at):
                told[k] = np.inf
        return values.sum(axis=0), told

    def _way_down(self, pieces: Pieces, k: int) -> Pieces:
        """Return the pieces halved towards where a function has its largest error, as far as that goes."""
        worst = int(pieces.integral_errors[:, k].argmax())
        while self.divisible(pieces.some(np.array([worst])))[0]:
            low, high, number = pieces.low[worst], pieces.high[worst], pieces.interval[worst]
            pieces = self.refined(pieces, np.array([worst]))
            parts = np.flatnonzero((pieces.interval == number) & (pieces.low >= low) & (pieces.high <= high))
            worst = int(parts[pieces.integral_errors[parts, k].argmax()])
        return pieces

    def _diverges(self, pieces: Pieces, k: int, at: int) -> bool:
        """Tell whether integrals of a function do not fall towards a piece, as far as a sum of them takes."""
        own = pieces.some(pieces.interval == pieces.interval[at])
        middle, width = 0.5 * (own.low + own.high), own.high - own.low
        place = 0.5 * float(pieces.low[at] + pieces.high[at])
        distance = np.abs(middle - place) / self._span[int(pieces.interval[at])].length
        mean = np.abs(own.integrals[:, k]) / width
        near = (distance > NEAR) & (distance < FAR) & (mean > 0.0)
        for side in (near & (middle < place), near & (middle > place)):  # it may be finite on one of them, or jump
            if np.count_nonzero(side) >= FEWEST:
                power = np.polyfit(np.log(distance[side]), np.log(mean[side]), 1)[0]
                if power < DIVERGES - 1.0:
                    return True
        return False

    # Extremes

    def highest(self, sign: float, top: Peak, slack: float) -> Peak:
        """Return the largest value of the first function times a sign.

        Args:
            sign: 1, or -1 for the smallest value of the function.
            top: A value that is known.
            slack: Difference of heights that does not matter.

        Raises:
            Endless: There is none, as the function passes through infinity.
        """
        if not self.spans:
            return top
        pieces, rounds, left = self.first(fine=False), 0, 0.0
        top = self._highest_known(sign, top)
        top = self.higher(sign, top, [(span.number, span.sides) for span in self.spans if len(span.sides)])
        while len(pieces):
            top = self._top(sign, top, pieces)
            bounds = pieces.bounds(sign)[:, 0]
            rising = self._rising(sign, top, pieces, bounds, slack)
            wide = self.divisible(pieces.some(rising))
            narrow, rising = rising[~wide], rising[wide]
            if len(narrow):
                self._require_end(sign, top)
                left = max(left, *(_fall(sign * pieces.f[k, :, 0]) for k in narrow))
            rising = rising[np.argsort(-bounds[rising], kind="stable")][
                : MOST_PIECES if rounds < HALVINGS else MOST_KINKS
            ]
            pieces, rounds = (
                self.halves(pieces.some(np.sort(rising))) if len(rising) else pieces.some(rising),
                rounds + 1,
            )
        return replace(top, error=max(top.error, left))

    def _highest_known(self, sign: float, top: Peak) -> Peak:
        """Return the largest of the known values."""
        for span in self.spans:
            if len(span.t):
                k = int((sign * span.f[:, 0]).argmax())
                top = max(top, Peak(float(sign * span.f[k, 0]), span.number, float(span.t[k])), key=_height)
        return top

    def _top(self, sign: float, top: Peak, pieces: Pieces) -> Peak:
        """Return the largest value at nodes of pieces, and at extremes of polynomials that are the function."""
        heights = sign * pieces.f[:, :, 0]
        piece, node = divmod(int(heights.argmax()), DEGREE + 1)
        if heights[piece, node] > top.height:
            interval, t = self._places(int(pieces.interval[piece]), float(pieces.low[piece]), float(pieces.high[piece]))
            top = Peak(float(heights[piece, node]), interval, float(t[node]))
        may = pieces.resolved[:, 0] & (pieces.largest(sign)[:, 0] + 4.0 * pieces.error[:, 0] > top.height)
        spots = list[tuple[int, Array]]()
        for k in np.flatnonzero(may).tolist():
            turns = pieces.extremes(k)
            if len(turns):
                best = (sign * pieces.at(np.full(len(turns), k), turns)[:, 0]).argmax()
                spots.append((int(pieces.interval[k]), turns[[best]]))
        return self.higher(sign, top, spots)

    def higher(self, sign: float, top: Peak, spots: Spots) -> Peak:
        """Return the largest value at places of intervals, or one that is known."""
        for (interval, t), f in zip(spots, self.values(spots) if spots else (), strict=True):
            heights = sign * f.reshape(len(t), -1)[:, 0]
            k = int(heights.argmax())
            top = Peak(float(heights[k]), interval, float(t[k])) if heights[k] > top.height else top
        return top

    @staticmethod
    def _rising(sign: float, top: Peak, pieces: Pieces, bounds: Array, slack: float) -> Indices:
        """Return the pieces in which the function may be above a top, between the places that have been evaluated."""
        within = (pieces.interval == top.interval) & (pieces.low <= top.place) & (top.place <= pieces.high)
        blind = within & (bounds < top.height - slack)  # the polynomial does not tell what has been seen
        smooth = pieces.resolved[:, 0] | pieces.constant[:, 0]
        poles = pieces.is_singular[:, 0] & (pieces.tail[:, 0] > slack)
        return np.flatnonzero(blind | (~smooth & ((bounds > top.height + slack) | poles)))

    def _require_end(self, sign: float, top: Peak) -> None:
        """Raise where the function grows without end towards its highest place, from one side at least.

        Raises:
            Endless: It does.
        """
        span, least = self._span[top.interval], ULPS * math.ulp(top.place)
        ends = np.clip(top.place + BEGINS * span.length * np.array([-1.0, 1.0]), *span.bounds[[0, -1]])
        steps = [way * 8.0 ** -np.arange(1.0 + ROUNDS) for way in (ends - top.place).tolist() if abs(way) > least]
        spots = [(top.interval, top.place + step[np.abs(step) > least]) for step in steps]
        for f, (_, t) in zip(self.values(spots), spots, strict=True):
            if _grows(sign * f.reshape(len(t), -1)[:, 0]):
                cuts = [t for t in self._soft[top.interval] if abs(t - top.place) <= NARROW * span.length]
                raise Endless(min(cuts, key=lambda t: abs(t - top.place), default=top.place))

    # Percentiles

    def percentile(self, share: float) -> tuple[float, float]:
        """Return the value below which the first function is for a share of the length, and the error of the value.

        Of polynomials the length on which they are below a value is known from where they pass it, and with it the
        percentile, to the error of the polynomials: two functions that differ by e at most have percentiles that differ
        by e at most.

        Args:
            share: Between 0 and 1.
        """
        pieces, halved = self.first(fine=True), 0
        most = MOST + len(pieces)
        while True:
            error, width = pieces.error[:, 0], pieces.high - pieces.low
            f = pieces.f[:, :, 0]
            level = max(ENOUGH * float(np.ptp(f)), ROUNDING * float(np.abs(f).max()))
            poor = np.flatnonzero((error > level) & self.divisible(pieces))
            halved += len(poor)
            if not len(poor) or halved > most:
                break
            pieces = self.refined(pieces, poor)
        arcs, rough = _Arcs.of(pieces), float(error.max())
        value, unknown = arcs.percentile(share), float(width[error > level].sum() / width.sum())
        if not unknown:
            return value, min(rough, level)
        high, low = arcs.percentile(min(share + unknown, 1.0)), arcs.percentile(max(share - unknown, 0.0))
        return value, min(rough, level + high - low)

    # Zeros

    def zeros(self, number: int, places: Array, level: float) -> list[float]:
        """Return where the first function has a value in an interval, ascending; not where it jumps over the value.

        Args:
            number: The interval.
            places: Where it is looked at besides, ascending, both ends of the interval among them.
            level: The value.
        """
        return self._zeros(number, places, *self._looked_at(number, places, level), level)

    def zeros_of_angle(self, number: int, places: Array, level: float) -> list[float]:
        """Return where an angle has a value, also one that is told between -180 and 180 deg, and jumps at these.

        Where it changes by more than half a turn between places that are looked at, it may have jumped there, and the
        sine of the difference is looked at too, which does not jump. Of its zeros those count beside which the angle
        has the value: others are half a turn or whole turns away.

        Args:
            number: The interval.
            places: As in ``zeros``.
            level: The value [rad].
        """
        t, values = self._looked_at(number, places, level)
        found = self._zeros(number, places, t, values, level)
        if (np.abs(np.diff(values)) <= np.pi).all():
            return found
        sine = Curve(lambda spots: [np.sin(f.reshape(len(t), -1)[:, :1] - level) for f, (_, t) in
                                    zip(self.values(spots), spots, strict=True)],
                     [replace(span, f=np.sin(span.f - level)) for span in self.spans])  # fmt: skip
        low, high = float(places[0]), float(places[-1])
        near = BESIDE * (high - low) * np.array([-1.0, 0.0, 1.0])
        others = [place for place in sine.zeros(number, places, 0.0)
                  if np.abs(self._gaps(number, np.clip(place + near, low, high), level)).min() < 1.0]  # fmt: skip
        return sine._once(number, sorted({*found, *others}), set(found), high - low, TOUCHES, 0.0)

    def _gaps(self, number: int, t: Array, level: float) -> Array:
        """Return the first function less a value at places, shape (n,)."""
        (f,) = self.values([(number, t)])
        return np.asarray(f.reshape(len(t), -1)[:, 0] - level)

    def _looked_at(self, number: int, places: Array, level: float) -> tuple[Array, Array]:
        """Return places between which the function is taken to have the value once at most, and its gaps there."""
        known = dict(zip(places.tolist(), self._gaps(number, places, level).tolist(), strict=True))
        if number not in self._span:
            return _sorted(known)
        bounds, rounds = self._span[number].bounds, 0
        pieces = self.pieces(np.full(len(bounds) - 1, number), bounds[:-1], bounds[1:])
        pieces = replace(pieces, f=pieces.f - level)
        while len(pieces):
            pieces = pieces.some(~pieces.constant[:, 0])  # a rest, which has no zeros within
            size = max(map(abs, [*known.values(), *pieces.f[:, :, 0].ravel().tolist()]), default=0.0)
            for k in range(len(pieces)):
                t = self._places(number, float(pieces.low[k]), float(pieces.high[k]))[1]
                known = {**dict(zip(t.tolist(), pieces.f[k, :, 0].tolist(), strict=True)), **known}
            known |= self._turns(number, pieces, level, TOUCHES * size)
            unsure = np.flatnonzero(_may_cross_unseen(pieces))
            if rounds == CROSSING_ROUNDS or not len(unsure):
                break
            pieces = self.halves(replace(pieces, f=pieces.f + level).some(unsure))
            pieces, rounds = replace(pieces, f=pieces.f - level), rounds + 1
        return _sorted(known)

    def _turns(self, number: int, pieces: Pieces, level: float, slack: float) -> dict[float, float]:
        """Return places of extremes in resolved pieces, and the gaps there, 0 where the function touches the value."""
        turns = [pieces.extremes(k) for k in np.flatnonzero(pieces.resolved[:, 0]).tolist()]
        t = np.concatenate(turns) if turns else np.empty(0)
        gaps = self._gaps(number, t, level) if len(t) else t
        return dict(zip(t.tolist(), np.where(np.abs(gaps) > slack, gaps, 0.0).tolist(), strict=True))

    def _zeros(self, number: int, places: Array, t: Array, values: Array, level: float) -> list[float]:
        """Return where the gaps are zero between instants t, shape (n,), at which they have the values, shape (n,)."""
        found = list[float]()
        for k in np.flatnonzero((values == 0.0) | np.append(values[:-1] * values[1:] < 0.0, False)).tolist():
            if values[k] == 0.0:
                found.append(float(t[k]))
            else:
                place = self.root(number, float(t[k]), float(t[k + 1]), level)
                gap = float(np.abs(self._gaps(number, np.array([place]), level)[0]))
                found += [place] if gap <= CONTINUOUS * np.abs(values[k : k + 2]).max() else []
        slack = TOUCHES * float(np.abs(values).max(initial=0.0))
        known = {*places.tolist()} & {*t[values == 0.0].tolist()}
        return self._once(number, found, known, float(t[-1] - t[0]), slack, level)

    def _once(
        self, number: int, found: list[float], known: set[float], length: float, slack: float, level: float
    ) -> list[float]:
        """Return zeros, of which those that are one are told once: by one of the known ones, else by the first."""
        left = list[float]()
        for place in found:
            same = left and place - left[-1] <= ONE * length
            if same and abs(self._gaps(number, np.array([0.5 * (place + left[-1])]), level)[0]) <= slack:
                left[-1] = place if place in known and left[-1] not in known else left[-1]
            else:
                left.append(place)
        return left

    def root(self, number: int, low: float, high: float, level: float) -> float:
        """Return where the first function has a value between two places on whose sides it has opposite gaps."""
        fit = self.pieces(np.array([number]), np.array([low]), np.array([high])) if number in self._span else None
        if fit is not None and len(fit) == 1 and fit.resolved[0, 0]:
            fit = replace(fit, f=fit.f - level)
            places = fit.zeros(0)
            if len(places) and fit.slope(0, t := float(places[0])) != 0.0:
                for _ in range(CORRECTIONS):
                    t = min(max(t - float(self._gaps(number, np.array([t]), level)[0]) / fit.slope(0, t), low), high)
                return t
        from scipy.optimize import brentq

        gap = lambda t: float(self._gaps(number, np.array([t]), level)[0])  # noqa: E731
        return float(brentq(gap, low, high, xtol=4.0 * math.ulp(max(abs(low), abs(high))), rtol=FLAT))


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
        turns = [np.concatenate([[low], pieces.extremes(k), [high]])
                 for k, (low, high) in enumerate(zip(pieces.low, pieces.high, strict=True))]  # fmt: skip
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

    def percentile(self, share: float) -> float:
        """Return the value below which the polynomials are for a share of their length."""
        from scipy.optimize import brentq

        low, high = float(self.values.min()), float(self.values.max())
        wanted = share * float((self.ends[1] - self.ends[0]).sum())
        if low == high or wanted <= 0.0 or self.below(high) <= wanted:
            return low if wanted <= 0.0 else high
        return float(brentq(lambda value: self.below(value) - wanted, low, high, xtol=1e-15 * (high - low), rtol=FLAT))


def _height(peak: Peak) -> float:
    return peak.height


def _sorted(known: dict[float, float]) -> tuple[Array, Array]:
    t = np.array(sorted(known))
    return t, np.array([known[place] for place in t.tolist()])


def _unseen(pieces: Pieces) -> Array:
    """Return what known values off the polynomials may change in the integrals, shape (m, k)."""
    return np.where(pieces.off > UNSEEN + DEGREE * pieces.tail, 2.0 * pieces.half * pieces.off, 0.0)


def _stalled(before: list[Array], errors: Array, told: Array, allowed: Array, small: Array) -> bool:
    """Tell whether the last rounds did not halve the errors that are not allowed, though all are small.

    Args:
        before: Sums of errors of every round, shape (k,) each.
        errors: Those of the pieces of the last one, shape (m, k).
        told: Estimates of the errors of the integrals, shape (k,).
        allowed: Errors that are, shape (k,).
        small: Errors that are small, shape (k,).
    """
    if len(before) <= PATIENCE or (before[-1] > small).any():
        return False
    spread = errors.max(axis=0) <= SPREAD * before[-1]
    return bool(((spread & (before[-1] >= 0.5 * before[-1 - PATIENCE])) | (told <= allowed)).all())


def _fall(heights: Array) -> float:
    """Return by how much heights fall beside the largest, on the side of a jump that it is on."""
    peak = int(heights.argmax())
    beside = heights[[k for k in (peak - 2, peak + 2) if 0 <= k < len(heights)]]
    return float(heights[peak] - beside.max())


def _grows(heights: Array) -> bool:
    """Tell whether heights at places, each an eighth as far away as that before, grow without end."""
    rises = np.diff(heights[::WINDOW])
    if len(rises) < 2 or (np.diff(heights) <= 0.0).any() or rises[0] <= RISES * abs(heights[0]):
        return False
    return bool((rises[1:] > ENDLESS * rises[:-1]).all())


def _may_cross_unseen(pieces: Pieces) -> Flags:
    """Tell where a function may be zero twice between two nodes of a piece, whose extremes are not known."""
    f = pieces.f[:, :, 0]
    passing = (f.min(axis=1) <= 0.0) & (f.max(axis=1) >= 0.0)
    sign = np.where(f.mean(axis=1) > 0.0, -1.0, 1.0)
    bounds = np.where(sign > 0.0, pieces.bounds(1.0)[:, 0], pieces.bounds(-1.0)[:, 0])
    return np.asarray(~pieces.resolved[:, 0] & (passing | (bounds >= 0.0)))
