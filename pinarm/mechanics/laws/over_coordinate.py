"""Laws over a coordinate instead of over time, such as cam profiles, alone or driven by a law over time.

With the profile f and the law w(t) of the driving coordinate:
``s = f(w)``, ``s' = f'(w) w'``, ``s'' = f'' w'^2 + f' w''``.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from pinarm.arrays import Array, distinct
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Extent, InputStruct, check_unit
from pinarm.mechanics.laws.kinds import CONTINUOUS, Law
from pinarm.mechanics.laws.motion_law import JUMP, MotionLaw, Piece, Values
from pinarm.records import ValueRecord

SAMPLES, MOST_SAMPLES = 4097, 2**20 + 1
"""Samples of a smooth piece of the driving law in the search for its reversals, at least and at most."""

EVERY = 8
"""Samples for each reversal that there are at least: sampled more coarsely a fast swing looks like a slow one."""

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Golden ratio: the parts that its multiples are beyond whole numbers do not repeat."""

TOLERANCES = {"xatol": 0.0, "xrtol": 4e-16, "fatol": 0.0, "frtol": 0.0}
"""Of changes of sign: they are found at rounding."""

ON_BREAKPOINT = 1e-12
"""Distance from a breakpoint, relative to the size of the breakpoints, below which a value is on it."""

MANY = 100_000
"""Largest number of points that a driven profile may pass: steps end there, and figures look between them."""


class Profile(ValueRecord, frozen=True):
    """A law f(w) over a coordinate w, repeated with a period if there is one.

    Attributes:
        period: Period [rad or m]; infinite where it does not repeat.
    """

    pieces: tuple[Piece, ...]
    period: float
    law: MotionLaw

    @classmethod
    def of(cls, law: MotionLaw, period: float | None = None) -> Profile:
        if period is None:
            return cls(tuple(law.smooth_pieces), math.inf, law)
        inside = [piece for piece in law.smooth_pieces if piece.end > 0.0 and piece.start < period]
        return cls(tuple(piece.between(0.0, period) for piece in inside), period, law)

    def __reduce__(self) -> tuple[Callable[..., Profile], tuple[MotionLaw, float | None]]:
        return Profile.of, (self.law, None if self.period == math.inf else self.period)

    def __call__(
        self, w: Array, toward: Array | float = 0.0, stretch: tuple[float, float] = (-math.inf, math.inf)
    ) -> Values:
        """Return f, f' and f'' at values w of the coordinate, each of the shape of w.

        Args:
            toward: Which side counts on a breakpoint: 1 for greater values, -1 for lesser ones.
            stretch: Values beyond it are those of the pieces at its ends, continued; see ``stretch``.
        """
        slack = ON_BREAKPOINT * np.maximum(1.0, np.abs(w))
        near = np.clip(np.asarray(w, float) + toward * slack, stretch[0] + slack, stretch[1] - slack)
        x = self._folded(near)
        values = np.empty((3, *x.shape))
        place = np.searchsorted([piece.end for piece in self.pieces[:-1]], x)
        x = x + (w - near)
        for index in distinct(place):
            inside = place == index
            values[:, inside] = self.pieces[index].function(x[inside])
        return values[0], values[1], values[2]

    def _folded(self, w: Array) -> Array:
        w = np.asarray(w, float)
        return w if self.period == math.inf else w - self.period * np.floor(w / self.period)

    @property
    def marks(self) -> Array:
        """Where pieces begin, and their knots, ascending; those of the first period where it repeats."""
        return np.array(sorted([*self.starts, *self.knots]))

    @property
    def knots(self) -> list[float]:
        return [knot for piece in self.pieces for knot in piece.knots]

    @property
    def starts(self) -> list[float]:
        return [piece.start for piece in self.pieces if math.isfinite(piece.start)]

    @cached_property
    def leaps(self) -> list[float]:
        """Where f itself jumps, ascending; those of the first period, from 0 on, where it repeats."""
        met = [*pairwise(self.pieces), *([(self.pieces[-1], self.pieces[0])] if self.period < math.inf else [])]
        return sorted(after.start for before, after in met if _leaps(before, after))

    def stretch(self, w: float, toward: float = 0.0) -> tuple[float, float]:
        """Return the jumps of f below and above a value of the coordinate, infinite where there are none.

        Args:
            toward: Which stretch counts on a jump: 1 for the one of greater values, -1 for that of lesser ones.
        """
        near, leaps = w + toward * ON_BREAKPOINT * max(1.0, abs(w)), np.array(self.leaps)
        if self.period < math.inf:
            turn = self.period * math.floor(near / self.period)
            leaps = np.concatenate([turn - self.period + leaps, turn + leaps, turn + self.period + leaps])
        below, above = leaps[leaps <= near], leaps[leaps > near]
        return float(below.max(initial=-math.inf)), float(above.min(initial=math.inf))

    def passed(self, places: Sequence[float] | Array, drive: MotionLaw, start: float, end: float) -> list[float]:
        """Return when a law over time passes places of the profile, in every period, between two instants [s]."""
        instants: list[float] = []
        for function, low, high in _pieces_between(drive, start, end):
            instants += self.crossings(places, function, low, high)
            if len(instants) > MANY:
                raise InputError("the profile's points are passed too often", expected="a shorter motion")
        return instants

    def crossings(
        self, places: Sequence[float] | Array, drive: Callable[[Array], Values], low: float, high: float
    ) -> list[float]:
        """Return when a smooth motion passes places of the profile, in every period, ascending [s]."""
        if not len(places):
            return []
        t, w = _one_way(drive, low, high)
        return _passages(drive, t, w, self._repeated(places, float(w.min()), float(w.max())))

    def _repeated(self, places: Sequence[float] | Array, low: float, high: float) -> Array:
        own = np.array(places)
        if self.period < math.inf and math.isfinite(low) and math.isfinite(high):
            with np.errstate(over="ignore", invalid="ignore"):
                first, last = np.floor(low / np.float64(self.period)), np.floor(high / np.float64(self.period))
                if not (last - first + 1) * len(own) <= MANY:
                    raise InputError(
                        f"the profile is passed {last - first:.3g} times, and has {len(own)} points",
                        expected=f"a shorter motion, that passes {MANY} points at most",
                    )
            own = (self.period * np.arange(first, last + 1)[:, None] + own).ravel()
        return own[(own > low) & (own < high)]

    def beside(self, middle: float, w: Array) -> Values:
        """Return f, f' and f'' at w by the piece at ``middle`` where w lies on it, otherwise by the piece at w."""
        turn = middle - float(self._folded(np.array(middle)))
        piece = self.pieces[int(np.searchsorted([piece.end for piece in self.pieces[:-1]], middle - turn))]
        x = np.asarray(w, float) - turn
        slack = ON_BREAKPOINT * max(1.0, *(abs(end) for end in (piece.start, piece.end, turn) if math.isfinite(end)))
        inside = (x >= piece.start - slack) & (x <= piece.end + slack)
        if inside.all():
            return piece.function(x)
        values = np.array(self(w))
        values[:, inside] = piece.function(x[inside])
        return values[0], values[1], values[2]

    def check_repeated(self, *, load: bool = False) -> None:
        if self.period == math.inf:
            return
        slack = ON_BREAKPOINT * self.period
        for place in self._of_law:
            if not -slack <= place <= self.period + slack:
                raise InputError(
                    f"the profile has a point at {place:.6g}, and repeats what it says from 0 to {self.period:.6g}",
                    expected="points from 0 to the period",
                )
        first = np.array(self.pieces[0].function(np.array([0.0])))[:, 0]
        last = np.array(self.pieces[-1].function(np.array([self.period])))[:, 0]
        size = np.max([piece.size() for piece in self.pieces], axis=0)
        looked_at = (() if self.law.may_jump else ("value",)) if load else ("value", "slope")
        for what, begin, end, scale in zip(looked_at, first, last, size, strict=False):
            if abs(end - begin) > CONTINUOUS * scale:
                raise InputError(
                    f"the profile does not close: its {what} is {begin:.6g} at 0 and {end:.6g} after a period",
                    expected="a profile that ends as it begins",
                )

    @property
    def _of_law(self) -> list[float]:
        """Where pieces of the law begin, and their knots, whether they are within the period or not."""
        pieces = self.law.smooth_pieces
        return [x for piece in pieces for x in (piece.start, *piece.knots) if math.isfinite(x)]


def _leaps(before: Piece, after: Piece) -> bool:
    left, right = before.function(np.array([before.end]))[0], after.function(np.array([after.start]))[0]
    return bool(abs(right - left)[0] > JUMP * max(before.size()[0], after.size()[0]))


class Driven(MotionLaw, frozen=True):
    """A law over time by its pieces, such as a profile along another law.

    Attributes:
        parts: The pieces.
    """

    parts: tuple[Any, ...]

    def pieces(self) -> Sequence[Piece]:
        return self.parts


class Over(InputStruct, frozen=True, tag_field="law", tag="over"):
    """The value of one coordinate as a function of another one that follows a law, such as of a cam and its follower.

    Attributes:
        of: The other coordinate; it has a law in the same motion.
        profile: The function. Where laws speak of time it has the other coordinate: ``duration: 90 deg``.
        period: After which the profile repeats, such as ``360 deg``: what it says from 0 to there holds for every
            turn. None where it does not repeat.
    """

    of: str
    profile: Law
    period: Extent | None = None

    def check(self) -> None:
        with within("period"):
            Profile.of(self.profile, self.period).check_repeated()

    def check_units(self, of: Unit, along: Unit) -> None:
        with within("profile"):
            self.profile.check_units(of, along)
        with within("period"):
            check_unit(self.period or 0.0, along)

    def check_follower(self, name: str, names: Collection[str]) -> None:
        with within("profile"):
            self.profile.check_follower(name, names)

    def along(self, drive: MotionLaw, start: float, end: float) -> MotionLaw:
        """Return the law over time ``s(t) = f(w(t))`` for the law w(t) of the other coordinate.

        Between ``start`` and ``end`` it has a piece for each passage of w through a breakpoint of f; outside of them it
        is valid as well, but not divided.

        Args:
            start: First instant [s].
            end: Last instant [s].
        """
        profile = Profile.of(self.profile, self.period)
        parts: list[Piece] = []
        for piece in drive.smooth_pieces:
            low, high = max(piece.start, start), min(piece.end, end)
            cuts, knots = (
                profile.crossings(places, piece.function, low, high) if low < high else []
                for places in (profile.starts, profile.knots)
            )
            if len(parts) + len(cuts) > MANY:
                raise InputError("the profile's breakpoints are passed too often", expected="a shorter motion")
            for first, last in pairwise([piece.start, *cuts, piece.end]):
                middle = 0.5 * (max(first, min(low, last)) + min(last, max(high, first)))
                own = knots[bisect_right(knots, first) : bisect_left(knots, last)]
                parts.append(Piece(first, last, _chained(profile, piece.function, middle), tuple(own)))
        return Driven(parts=tuple(parts))


def _chained(profile: Profile, drive: Callable[[Array], Values], middle: float) -> Callable[[Array], Values]:
    """Return ``f(w(t))`` with its derivatives, by the piece of f at the instant ``middle``."""
    between = float(drive(np.array([middle]))[0][0])

    def function(t: Array) -> Values:
        w, dw, ddw = drive(np.asarray(t, float))
        f, df, ddf = profile.beside(between, w)
        return f, df * dw, ddf * dw**2 + df * ddw

    return function


def _pieces_between(
    law: MotionLaw, start: float, end: float
) -> Iterator[tuple[Callable[[Array], Values], float, float]]:
    """Yield the functions of a law's pieces between two instants, and from when to when each holds."""
    for piece in law.smooth_pieces:
        low, high = max(piece.start, start), min(piece.end, end)
        if low < high:
            yield piece.function, low, high


def reversals(law: MotionLaw, start: float, end: float) -> list[float]:
    """Return the instants at which a law turns back within its pieces between two instants, ascending [s]."""
    instants: list[float] = []
    for function, low, high in _pieces_between(law, start, end):
        t, w = _one_way(function, low, high)
        way = np.diff(np.round(w / (ON_BREAKPOINT * float(np.abs(w).max()) or 1.0)))
        moves = np.flatnonzero(way)
        instants += t[moves[1:]][way[moves[:-1]] * way[moves[1:]] < 0.0].tolist()
    return instants


def _one_way(drive: Callable[[Array], Values], low: float, high: float) -> tuple[Array, Array]:
    """Return instants between which a smooth motion goes one way, ascending, and where it is then, both (n,)."""
    t, speed = _sampled(drive, low, high)
    back = np.flatnonzero(speed[:-1] * speed[1:] < 0.0)
    turns = _roots(lambda x, speed: drive(x)[1] - speed, t[back], t[back + 1], np.zeros(len(back)))
    t = np.sort(np.concatenate([t, turns]))
    return t, drive(t)[0]


def _sampled(drive: Callable[[Array], Values], low: float, high: float) -> tuple[Array, Array]:
    """Return instants, as many as a motion asks for that swings, and its speeds there, both (n,).

    They are apart by all distances, so that no swing looks slow.
    """
    samples = SAMPLES
    while samples <= MOST_SAMPLES:
        k = np.arange(samples - 1.0)
        inner = low + (high - low) * (k + (GOLDEN * k * k) % 1.0) / (samples - 1.0)
        t = np.array([low, *inner[1:], high])
        w, speed, _ = drive(t)
        rounding = ON_BREAKPOINT * max(float(np.abs(speed).max()), float(np.abs(w).max()) / (high - low))
        way = np.sign(speed) * (np.abs(speed) > rounding)
        if EVERY * np.count_nonzero(way[:-1] * way[1:] < 0.0) <= samples:
            return t, speed
        samples = 2 * samples - 1
    raise InputError(
        f"what a profile follows turns back more than {MOST_SAMPLES // EVERY} times", expected="a shorter motion"
    )


def _passages(drive: Callable[[Array], Values], t: Array, w: Array, places: Array) -> list[float]:
    """Return the instants at which a motion passes places, ascending; between instants t it goes one way."""
    slack = ON_BREAKPOINT * max(1.0, float(np.abs(places).max(initial=0.0)))
    brackets = []
    for place in places:
        side = np.where(np.abs(w - place) <= slack, 0.0, np.sign(w - place))
        off = np.flatnonzero(side)
        across = np.flatnonzero(side[off[:-1]] != side[off[1:]])
        brackets.append((np.full(len(across), place), t[off[across]], t[off[across + 1]]))
    if not brackets:
        return []
    passed, before, after = (np.concatenate(part) for part in zip(*brackets, strict=True))
    return sorted(_roots(lambda x, place: drive(x)[0] - place, before, after, passed).tolist())


def _roots(function: Callable[[Array, Array], Array], low: Array, high: Array, passed: Array) -> Array:
    """Return where a function of instants and places changes its sign within brackets, at rounding, shape (n,)."""
    if not len(low):
        return low
    from scipy.optimize.elementwise import find_root

    return np.asarray(find_root(function, (low, high), args=(passed,), tolerances=TOLERANCES).x)


Motion = Law | Over
"""The law of a coordinate: over time, or over another coordinate."""
