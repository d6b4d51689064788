"""Where on a run a quantity is asked: an instant, a coordinate's value, an extreme; solved there, not interpolated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, distinct
from pinarm.engine.motion.outcome import SolvedMotion, on_interval
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, Key, within
from pinarm.input.yaml.schema import in_si
from pinarm.records import Record, replace
from pinarm.use.result.curve import (
    BESIDE,
    Curve,
    Endless,
    Peak,
    Span,
    Spots,
    crossings,
    highest,
    looked_at,
    zeros,
    zeros_of_angle,
)
from pinarm.use.result.measures import ZERO, natural_sizes

if TYPE_CHECKING:
    from pinarm.input.units import Unit

Place = str | Mapping[str, str | int | float]
"""A word such as ``max``, or an instant: ``{phi: 30 deg, side: left}``."""

Function = Callable[[Quantities], Array]
"""Quantities of n rows -> values of k functions there, shape (n, k), or (n,) of one function."""

_EXTREMES: dict[str, tuple[str, tuple[float, ...]]] = {
    "max": ("largest value", (1.0,)),
    "min": ("smallest value", (-1.0,)),
    "largest": ("largest size", (1.0, -1.0)),
}
"""Name of an extreme -> what it is, in words, and the signs with which values are searched."""

PLATEAU = 1e-12
"""Relative difference to an extreme below which a row of the table is the extreme: the first of them is."""

WAYS = 2.0 ** -np.arange(46.0, -1.0, -1.0)
"""Ways from a place at which it is looked how far a quantity is level, as parts of those to the ends of its interval,
ascending."""

DECIDED = 1e-6
"""Relative difference between an extreme among other instants and solved alone from which on rounding decides it."""

MARKS = ("steps", "knots", "jumps")
"""Methods of a motion that tell where it may bend or jump within intervals."""

SAME = 1e-9
"""Relative difference between two sides of an instant below which there is no jump to be asked about."""

PARTS, MOST_INTERVALS = 4, 100
"""Pieces, of 17 states each, of an interval at first, however many rows it has; one where there are more intervals, as
between bounces."""

STEPS_IN_PIECE, MOST_PIECES = 16, 256
"""Steps of an integrator, which are short where the motion changes quickly, from one cut of an interval to the next;
and such pieces of an interval at most."""

PIECES, PER_CUT = 600, 2
"""Pieces of 17 states that an integral or a percentile may take in halving, and those for each interval, step and point
of a law: a kink takes 70, and between two steps a motion is a polynomial. The error that is left is told."""

KEPT, TOGETHER = 20, 100_000
"""Sets of states that are kept, as several quantities begin with the same points; velocities of states that are solved
together at most, and five times of those that are kept."""

MOST_SWITCHES = 100
"""Places of a run at which formulas switch at most: of more, as of a sawtooth, each tooth is seen as it is."""

Spot = tuple[int, float]
"""An interval of the run and a value of its parameter within it."""


class NotReached(InputError):
    """A place that a run does not come to."""


def instant(at: Place) -> dict[str, str | int | float]:
    """Return the coordinate of an instant, and its value; empty for words."""
    keys = {} if isinstance(at, str) else at
    return {key: value for key, value in keys.items() if key not in ("side", "occurrence")}


def located(at: Mapping[str, str | int | float], quantities: Quantities) -> tuple[str, float]:
    """Return the coordinate of an instant, and its value [SI].

    Args:
        at: The instant.
        quantities: Those of a run; nothing has to be solved.

    Raises:
        InputError: It names no coordinate, or several; there is none of that name; or the value has another dimension.
    """
    named = instant(at)
    if len(named) != 1:
        raise InputError("an instant names one coordinate", expected="such as {t: 1.5 s, side: left}")
    ((along, text),) = named.items()
    with within(Key(along)):
        measured = quantities[along].unit
    with within(along):
        return along, in_si(text, measured)


class Lookup(Record, frozen=True):
    """A run that is asked for its states at places.

    Attributes:
        quantities: Those of its rows.
        motion: What the rows are states of; ``None`` where there is nothing between them, and each is an interval by
            itself.
    """

    unshown = ("quantities",)

    quantities: Quantities
    motion: SolvedMotion | None
    _kept: dict[tuple[int, bytes], Quantities] = {}
    _curves: dict[str, Curve] = {}
    _switches: dict[str, list[Array]] = {}

    @property
    def run(self) -> Trajectory:
        return self.quantities.trajectory

    @cached_property
    def intervals(self) -> list[tuple[float, float, slice]]:
        """Start, end and rows of the intervals."""
        if self.motion:
            return self.run.grid.intervals()
        return [(t, t, slice(k, k + 1)) for k, t in enumerate(self.run.grid.t.tolist())]

    @property
    def length(self) -> float:
        return sum(abs(end - start) for start, end, _ in self.intervals)

    @cached_property
    def _marks(self) -> dict[str, list[Array]]:
        """Ends of steps, points of laws and jumps of loads, interval by interval, each ascending."""
        known = {name: getattr(self.motion, name)() if self.motion else np.empty(0) for name in MARKS}
        return {
            name: [t[(t > min(start, end)) & (t < max(start, end))] for start, end, _ in self.intervals]
            for name, t in known.items()
        }

    @property
    def most_pieces(self) -> int:
        """Most pieces that an integral or a percentile may halve."""
        return PIECES + PER_CUT * (len(self.intervals) + sum(len(t) for parts in self._marks.values() for t in parts))

    @cached_property
    def _wide(self) -> list[int]:
        return [k for k, (start, end, _) in enumerate(self.intervals) if start != end]

    def _bounds(self, interval: int) -> Array:
        """Return where an interval is cut into its first pieces: evenly, and at ends of steps."""
        (start, end, _), ends = self.intervals[interval], self._marks["steps"][interval]
        pieces = min(-(-len(ends) // STEPS_IN_PIECE), MOST_PIECES)
        cuts = ends[np.arange(1, pieces) * len(ends) // pieces] if pieces > 1 else ends[:0]
        parts = PARTS if len(self._wide) <= MOST_INTERVALS else 1
        return distinct(np.append(np.linspace(min(start, end), max(start, end), parts + 1), cuts))

    # States and functions of them

    def quantities_at(self, interval: int, t: Array) -> Quantities:
        """Return the quantities at values of the parameter in one interval, shape (n,); the last ones are kept."""
        asked = interval, t.tobytes()
        if asked not in self._kept:
            states = self.quantities.of(self._rows_at(interval, t))
            if len(t) * self._width > 5 * TOGETHER // KEPT:
                return states
            if len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[asked] = states
        return self._kept[asked]

    @property
    def _width(self) -> int:
        return max(1, int(self.run.mechanism.model.nv))

    def _rows_at(self, interval: int, t: Array) -> Trajectory:
        if self.motion is None:
            return self.run.some(np.full(len(t), interval))
        return on_interval(self.motion, self.run.grid.cuts, interval, t)

    def heights(self, function: Function, spots: Spots) -> list[Array]:
        """Return functions of the quantities at places of intervals; states of one interval are solved together.

        Args:
            function: The functions.
            spots: Numbers of intervals, and places in each, shape (n,).
        """
        heights, numbers = [np.empty(0)] * len(spots), dict[int, list[int]]()
        for k, (interval, _) in enumerate(spots):
            numbers.setdefault(interval, []).append(k)
        for interval, own in numbers.items():
            t, back = np.unique(np.concatenate([spots[k][1] for k in own]), return_inverse=True)
            blocks = np.array_split(t, 1 + len(t) * self._width // TOGETHER)
            values = np.concatenate([function(self.quantities_at(interval, block)) for block in blocks])[back]
            ends = np.cumsum([len(spots[k][1]) for k in own])
            for k, part in zip(own, np.split(values, ends[:-1]), strict=True):
                heights[k] = part
        return heights

    def curve_of(self, name: str) -> Curve:
        """Return a quantity as a curve, which is kept."""
        if name not in self._curves:
            self._curves[name] = self.curve(lambda rows: np.asarray(rows[name].values, float), [name])
        return self._curves[name]

    def curve(self, function: Function, of: Sequence[str] = ()) -> Curve:
        """Return functions of the quantities as a curve.

        Args:
            function: The functions.
            of: The quantities of which they are functions, where these may be formulas.
        """
        rows, spots = function(self.quantities), self._points
        known = {interval: (t, f) for (interval, t), f in zip(spots, self.heights(function, spots), strict=True)}
        switches, spans = [self.switches(name) for name in of], list[Span]()
        for k in self._wide:
            here, own = np.concatenate([np.empty(0), *(each[k] for each in switches)]), self.intervals[k][2]
            t, f = self.run.grid.t[own], rows[own]
            if k in known:
                t, f = (np.concatenate(pair) for pair in zip((t, f), known[k], strict=True))
            f = f.reshape(len(t), -1) if len(t) else np.empty((0, rows.shape[-1] if rows.ndim > 1 else 1))
            finite = np.isfinite(f).all(axis=1)
            t, first = np.unique(t[finite], return_index=True)
            steps, knots, jumps = (self._marks[name][k] for name in MARKS)
            bounds, cuts = distinct(np.append(self._bounds(k), here)), distinct(np.concatenate([steps, knots, jumps]))
            spans.append(Span(k, bounds, cuts, distinct(np.append(jumps, here)), t, f[finite][first]))
        return Curve(lambda spots: self.heights(function, spots), spans)

    @cached_property
    def _points(self) -> list[tuple[int, Array]]:
        """Points of laws, and both sides of jumps: functions are known there as they are at rows."""
        points = list[tuple[int, Array]]()
        for k in self._wide:
            knots, jumps, ends = self._marks["knots"][k], self._marks["jumps"][k], self.intervals[k][:2]
            before = jumps - BESIDE * max(map(abs, ends))
            points.append((k, distinct(np.concatenate([knots, jumps, before]))))
        return [spot for spot in points if len(spot[1])]

    def switches(self, name: str) -> list[Array]:
        """Return where formulas behind a name go from one smooth part to another, interval by interval, ascending.

        They do as ``abs``, ``min``, ``%`` and comparisons do: where functions that are smooth change their signs. What
        lies between two such places may be narrow. None are returned where there are too many.
        """
        if name not in self._switches:
            places = [[np.empty(0)] for _ in self.intervals]
            with suppress(InputError):  # a name from a model with marks of formulas in it, or an infinite operand
                count = len(self.quantities.switches(name)) if self.motion is not None else 0
                for curve in (self.curve(partial(_switch, name=name, k=k)) for k in range(count)):
                    for interval in self._wide:
                        t, gaps = looked_at(curve, interval, self._rows_and_ends(interval), 0.0)
                        places[interval].append(np.array(crossings(curve, interval, t, gaps, 0.0)))
            switches = [distinct(np.concatenate(parts)) for parts in places]
            few = sum(map(len, switches)) <= MOST_SWITCHES
            self._switches[name] = switches if few else [np.empty(0)] * len(switches)
        return self._switches[name]

    def _rows_and_ends(self, interval: int) -> Array:
        start, end, rows = self.intervals[interval]
        return distinct(np.append(self.run.grid.t[rows], [start, end]))

    # Places
    def at(self, where: str | dict[str, str | int | float], name: str) -> Quantities:
        """Return the quantities of one row: the place that ``where`` names.

        Args:
            where: As in ``Expectation.at``, without ``all``.
            name: The quantity that is asked, of which an extreme or a jump is meant.

        Raises:
            InputError: The place does not exist, or it is ambiguous.
        """
        if where == "start":
            return self._row(0, float(self.run.grid.t[0]))
        if where == "end":
            return self._row(len(self.intervals) - 1, float(self.run.grid.t[-1]))
        if isinstance(where, str):
            return self.extreme(where, name)[1]
        return self._row(*self._instant(where, name))

    def value(self, where: str | dict[str, str | int | float], of: str, name: str) -> tuple[float, float]:
        """Return a quantity at a place [SI], and by how much it differs where rounding cannot tell that place from it.

        An extreme is known to ``PLATEAU``, and curves are level there: its place is known to the root of that.

        Args:
            where: As in ``at``.
            of: The quantity that an extreme is of.
            name: The quantity that is asked for.

        Raises:
            InputError: See ``at``.
        """
        if where in ("start", "end"):
            return float(self.at(where, of)[name].values[0]), 0.0
        if isinstance(where, str):
            peak, row = self.extreme(where, of)
            value, signs = float(row[name].values[0]), _EXTREMES[where][1]
            if name == of:
                return value, peak.error
            spot: Spot = peak.interval, peak.place

            def elsewhere(states: Quantities) -> Flags:
                return np.asarray(_height(states[of].values, signs) < peak.height - 2.0 * peak.error)

            return value, self.differs(spot, name, value, elsewhere)
        spot, (along, sought) = self._instant(where, name), located(where, self.quantities)
        value = float(self._row(*spot)[name].values[0])
        if along == self.run.parameter:
            return value, 0.0
        series = self.quantities[along]
        slack = PLATEAU * max(abs(sought), float(np.abs(series.values).max()), float(np.max(series.terms, initial=0.0)))
        apart = np.sin if self._is_told_to_half_a_turn(along, sought) else np.asarray
        return value, self.differs(
            spot, name, value, lambda states: np.abs(apart(states[along].values - sought)) > slack
        )

    def _instant(self, where: dict[str, str | int | float], name: str) -> Spot:
        along, value = located(where, self.quantities)
        spots = self._on_parameter(value) if along == self.run.parameter else self._crossings(along, value)
        return self._choose(spots, where, name, f"{along} = {where[along]}")

    def _row(self, interval: int, t: float) -> Quantities:
        return self.quantities_at(interval, np.array([t]))

    def _on_parameter(self, value: float) -> list[Spot]:
        spots = []
        for k, (start, end, _) in enumerate(self.intervals):
            slack = 1e-12 * abs(end - start)
            if min(start, end) - slack <= value <= max(start, end) + slack:
                spots.append((k, float(np.clip(value, min(start, end), max(start, end)))))
        return spots

    def _crossings(self, along: str, value: float) -> list[Spot]:
        curve, spots = self.curve_of(along), list[Spot]()
        find = zeros_of_angle if self._is_told_to_half_a_turn(along, value) else zeros
        for k, (start, end, _) in enumerate(self.intervals):
            spots += [(k, t) for t in find(curve, k, self.looked_at(along, k), value)[:: 1 if start <= end else -1]]
        return spots

    def looked_at(self, name: str, interval: int) -> Array:
        """Return the rows, ends and switches of an interval, at which it is looked for values of a quantity."""
        return distinct(np.append(self._rows_and_ends(interval), self.switches(name)[interval]))

    def _is_told_to_half_a_turn(self, along: str, value: float) -> bool:
        """Tell whether a value may be that of an angle that jumps from 180 to -180 deg."""
        series = self.quantities[along]
        sizes = np.abs([value, *series.values[series.known].tolist()])
        return series.unit is not None and series.unit.text == "rad" and bool(sizes.max() <= np.pi)

    def _choose(self, spots: list[Spot], where: dict[str, str | int | float], name: str, text: str) -> Spot:
        """Return the place that is meant among those found: by occurrence, then by side."""
        occurrence = where.get("occurrence", 1)
        if isinstance(occurrence, bool) or not isinstance(occurrence, int) or occurrence < 1:
            raise InputError(f"'{occurrence}' is no occurrence", expected="a whole number from 1")
        instants = sorted({round(t, 14) for _, t in spots}, key=lambda t: [round(s, 14) for _, s in spots].index(t))
        if not instants:
            raise NotReached(f"{text} is not reached in this run")
        if len(instants) > 1 and "occurrence" not in where:
            raise InputError(f"{text} is reached {len(instants)} times", expected=f"occurrence: 1 to {len(instants)}")
        if occurrence > len(instants):
            raise NotReached(f"{text} is reached {len(instants)} times only", expected=f"at most {len(instants)}")
        chosen = [spot for spot in spots if round(spot[1], 14) == instants[occurrence - 1]]
        side = where.get("side")
        if side not in (None, "left", "right"):
            raise InputError(f"there is no side '{side}'", expected="left or right")
        if side is None and len(chosen) > 1:
            left, right = (float(self._row(*spot)[name].values[0]) for spot in (chosen[0], chosen[-1]))
            if abs(left - right) > SAME * max(abs(left), abs(right)):
                raise InputError(
                    f"{name} jumps at {text}: {left:.9g} before, {right:.9g} after",
                    expected="side: left or side: right",
                    hint="such as {t: 1.5 s, side: left}, or 't=1.5 s, side=left' in a text",
                )
        return chosen[0 if side == "left" else -1]

    def extreme(self, which: str, name: str, slack: float = 0.0) -> tuple[Peak, Quantities]:
        """Return where a quantity is largest, smallest, or largest in size, and the quantities there.

        Args:
            which: ``max``, ``min`` or ``largest``.
            name: The quantity.
            slack: Difference of values that is rounding, where it is more than that of its terms: the first row is
                the extreme that is not passed by more.

        Raises:
            InputError: It has no such value, as it passes through infinity, or rounding decides what it is.
        """
        word, signs = _EXTREMES[which]
        lacks, series = f"{name} has no {word}", self.quantities[name]
        slack = max(slack, PLATEAU * float(np.max(series.terms, initial=0.0)))
        peak = self.highest_of(self.curve_of(name), series.values, signs, lacks, slack)
        row = self._row(peak.interval, peak.place)
        alone = float(_height(row[name].values, signs)[0])
        self._require_reproduced(peak, alone, row[name].unit, lacks)
        return replace(peak, error=peak.error + abs(peak.height - alone)), row

    def highest(self, function: Function, name: str, slack: float = 0.0) -> tuple[Quantities, float]:
        """Return the row at which a function of the quantities is largest, and by how much it may be more elsewhere.

        Args:
            function: Quantities of n rows -> values, shape (n,).
            name: What it is, for the message.
            slack: Difference of heights that is rounding: the first row is it that is not passed by more.

        Raises:
            InputError: It has no largest value, as it passes through infinity.
        """
        values, lacks = function(self.quantities), f"{name} has no largest value"
        peak = self.highest_of(self.curve(function), values, (1.0,), lacks, slack)
        return self._row(peak.interval, peak.place), peak.error

    def highest_of(self, curve: Curve, values: Array, signs: Sequence[float], lacks: str, slack: float) -> Peak:
        """Return the largest height of a curve.

        Args:
            curve: The curve.
            values: Its values at the rows, shape (n,).
            signs: Signs of its values, of which heights are the larger ones.
            lacks: That there is no largest value, in words.
            slack: Difference of heights that is rounding, where it is more than that of the largest.
        """
        heights = _height(values, signs)
        try:
            finite = heights[np.isfinite(heights)]
            if (endless := ~np.isfinite(heights) & (heights != -np.inf)).any() or not len(finite):
                raise Endless(float(self.run.grid.t[endless.argmax()]))
            slack = max(slack, PLATEAU * float(np.abs(finite).max()))
            best = int((heights >= finite.max() - slack).argmax())
            row = top = Peak(float(heights[best]), self._interval_of(best), float(self.run.grid.t[best]))
            for sign in signs:
                top = highest(curve, sign, top, slack)
        except Endless as pole:
            run = self.run
            raise InputError(
                f"{lacks}: it passes through infinity at {run.parameter} = {pole.place:.9g} {run.unit}, "
                "or through a peak there that is narrower than 1e-9 of the run",
                expected="a quantity that is finite everywhere, or its value at a place, or a percentage such as @ p95",
            ) from None
        below = max(top.height - row.height, 0.0)
        if below <= slack:
            return replace(row, error=max(below + slack, top.error))
        return replace(top, error=max(top.error, slack, PLATEAU * abs(top.height)))

    def _require_reproduced(self, peak: Peak, alone: float, unit: Unit | None, lacks: str) -> None:
        """Raise where the state of an extreme has another value when it is solved without others beside it.

        Next to singular positions rounding decides what accelerations and forces are.
        """
        off = abs(peak.height - alone) - DECIDED * max(abs(peak.height), abs(alone))
        if off > 0.0 and off > ZERO * natural_sizes(self.run)(unit):
            raise InputError(
                f"{lacks} that is known: rounding decides what it is at {self.run.parameter} = {peak.place:.9g} "
                f"{self.run.unit}, as next to a singular position",
                expected="its value at a place, or a percentage such as @ p95",
            )

    def _interval_of(self, row: int) -> int:
        return next(k for k, (_, _, rows) in enumerate(self.intervals) if rows.start <= row < rows.stop)

    def differs(self, spot: Spot, name: str, value: float, elsewhere: Callable[[Quantities], Flags]) -> float:
        """Return by how much a quantity differs beside a place as far as that cannot be told from it.

        Args:
            spot: The place.
            name: The quantity.
            value: Its value there.
            elsewhere: States -> which of them are at another place for certain.
        """
        (interval, place), (start, end, _) = spot, self.intervals[spot[0]]
        sides, apart = [] if self.motion is None else [side for side in (start, end) if side != place], 0.0
        for side in sides:
            forth = 1 if side > place else -1
            states = self.quantities_at(interval, (place + (side - place) * WAYS)[::forth])
            other, differences = elsewhere(states)[::forth], np.abs(states[name].values - value)[::forth]
            apart = max(apart, float(differences[: int(other.argmax()) + 1 if other.any() else None].max()))
        return apart


def _switch(rows: Quantities, name: str, k: int) -> Array:
    return rows.switches(name)[k]


def _height(values: Array, signs: Sequence[float]) -> Array:
    return np.asarray(np.max([sign * values.astype(float) for sign in signs], axis=0))
