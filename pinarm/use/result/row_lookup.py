"""Where on a run a quantity is asked: an instant, a coordinate's value, an extreme; solved there, not interpolated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, distinct
from pinarm.engine.motion.outcome import SolvedMotion, on_interval
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import OPERATORS, Quantities
from pinarm.errors import InputError, PinarmError
from pinarm.input.yaml.schema import in_si
from pinarm.records import Record, replace
from pinarm.use.result.figures.bracket_fit import BracketFit
from pinarm.use.result.figures.crossings import crossings, crossings_of_angle
from pinarm.use.result.figures.peak_search import (
    MOST_PIECES,
    CurvePart,
    Endless,
    Peak,
    PeakSearch,
    Spots,
    bounded_below,
)
from pinarm.use.result.figures.quadrature import NODES
from pinarm.use.result.formula_switches import MISPLACED, switches
from pinarm.use.result.instant import instant, located
from pinarm.use.result.output_scales import ZERO, natural_sizes

if TYPE_CHECKING:
    from pinarm.input.units import Unit
    from pinarm.use.result.expectation import Expectation

_HEIGHTS: dict[str, Callable[[Array], Array]] = {
    "max": lambda x: x,
    "min": lambda x: -x,
    "largest": lambda x: np.abs(x),
}
"""Name of an extreme -> what is largest there."""

_EXTREMES = {"max": "largest value", "min": "smallest value", "largest": "largest size"}
"""Name of an extreme -> what it is, in words."""

PLATEAU = 1e-12
"""Relative difference to an extreme below which a row of the table is the extreme: the first of them is."""

NEARER, FARTHER = 2.0 ** -np.arange(46.0, 15.0, -1.0), 2.0 ** -np.arange(15.0, -1.0, -1.0)
"""Ways from an extreme at which it is looked how far it is level, as parts of those to the ends of its interval: the
far ones where it is level at all that are near."""

DECIDED = 1e-6
"""Relative difference between an extreme among other instants and solved alone from which on rounding decides it."""

SAME = 1e-9
"""Relative difference between two sides of an instant below which there is no jump to be asked about."""

MOST_RIVALS = 20
"""Rows beside the highest one that are refined at most: those that may rise most."""

PARTS = 4
"""In how many parts, of 17 states each, an interval is looked into, however many rows it has: a peak of a law's motion
that is narrower than the largest distance of such states, a 40th of the interval, and at no point of a law, may be
missed."""

STEPS_IN_PIECE = 16
"""Steps of an integrator, which are short where the motion changes quickly, from one cut of an interval to the next:
there is about a state for each of them, where the integrator took ten."""

SHORT = 0.025
"""Part of a piece below which a step of the integrator may lie between the points at which the piece is looked into."""

MOST_INTERVALS = 100
"""Intervals up to which they are; of more, as between bounces or passages of a profile, each is one part."""

MOST_JUMPS, BESIDE = 10_000, 1e-8
"""Jumps of loads up to which quantities are looked at on both sides of each, and how far before it, as a part of the
time since the one before."""

KEPT = 20
"""Sets of points whose states are kept: the integrals of several quantities begin with the same points."""

TOGETHER = 100_000
"""Velocities of states that are solved together at most, and five times of those that are kept."""

MOST_STATES = 20_000_000
"""Velocities of the states that are looked at between the points of laws at most, those for one integral."""

FITS = 1000
"""Curves between two places whose polynomials are kept: several numbers of one quantity look into the same ones."""

BAND_ENDS = (".effort.lower", ".effort.upper")
"""Last words of the ends of a band of efforts."""

Spot = tuple[int, float]
"""An interval of the run and a value of its parameter within it."""


class NotReached(InputError):
    """A place that a run does not come to."""


def unreached(quantities: Quantities, key: Sequence[Expectation]) -> list[str]:
    """Return a note on each place of an answer key that lies beyond all rows of a run.

    Entries that have another mistake are passed over: ``validate`` and ``check`` say what it is.
    """
    places: dict[str, list[str]] = {}
    for number, entry in enumerate(key, 1):
        for along, text in instant(entry.at).items():
            with suppress(PinarmError):
                rows = quantities[along]
                value, slack = in_si(text, rows.unit), 1e-12 * float(np.ptp(rows.values))
                if not rows.values.min() - slack <= value <= rows.values.max() + slack:
                    places.setdefault(f"{along} = {text}", []).append(str(number))
    return [f"{place} is not reached in this run; entry {', '.join(numbers)} of expect asks for it"
            for place, numbers in places.items()]  # fmt: skip


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
    _fits: dict[tuple[float, float, bytes], BracketFit] = {}
    _switches: dict[str, list[Array]] = {}

    @property
    def run(self) -> Trajectory:
        """The rows."""
        return self.quantities.trajectory

    @property
    def intervals(self) -> list[tuple[float, float, slice]]:
        """Start, end and rows of the intervals."""
        if self.motion:
            return self.run.grid.intervals()
        return [(t, t, slice(k, k + 1)) for k, t in enumerate(self.run.grid.t.tolist())]

    @cached_property
    def steps(self) -> list[Array]:
        """Where the steps of the integrator end, interval by interval, each ascending; empty of laws."""
        return self._within(self.motion.steps() if self.motion else np.empty(0))

    @cached_property
    def jumps(self) -> list[Array]:
        """Where loads jump, interval by interval, each ascending; none where these are many."""
        jumps = self.motion.jumps() if self.motion else np.empty(0)
        return self._within(jumps if len(jumps) <= MOST_JUMPS else jumps[:0])

    @cached_property
    def knots(self) -> list[Array]:
        """Points of the curves of laws, interval by interval, each ascending."""
        return self._within(self.motion.knots() if self.motion else np.empty(0))

    def _within(self, t: Array) -> list[Array]:
        """Return the instants that are within each interval."""
        return [t[(t > min(start, end)) & (t < max(start, end))] for start, end, _ in self.intervals]

    def cuts(self, interval: int) -> list[float]:
        """Return where an interval is cut into pieces that are looked into: ends of steps, as many in each piece."""
        ends = self.steps[interval]
        pieces = min(-(-len(ends) // STEPS_IN_PIECE), MOST_PIECES)
        return ends[np.arange(1, pieces) * len(ends) // pieces].tolist() if pieces > 1 else []

    def bounds(self, interval: int) -> list[float]:
        """Return where an interval is cut so that quantities are smooth between the cuts, and do not change much.

        Raises:
            InputError: Laws have more points than can be looked between.
        """
        points, most = sum(map(len, self.knots)), MOST_STATES // (len(NODES) * self._width)
        if points > most:
            raise InputError(f"laws and profiles have {points} points in this run: it cannot be looked between all",
                             expected=f"at most {most}, as in a shorter run")  # fmt: skip
        found: list[float] = distinct(
            np.concatenate([self.cuts(interval), self.jumps[interval], self.knots[interval]])
        ).tolist()
        return found

    def switches(self, name: str) -> list[Array]:
        """Return where formulas behind a name go from one smooth part to another, interval by interval, ascending."""
        if name not in self._switches:
            self._switches[name] = switches(self, name)
        return self._switches[name]

    def short_steps(self, interval: int, bounds: Sequence[float] | Array) -> Array:
        """Return where steps end that the points of a piece may lie beside, such as those through a short blow.

        Args:
            interval: The interval.
            bounds: Where it is cut into pieces, ends included, ascending.
        """
        ends, edges = self.steps[interval], np.asarray(bounds)
        piece = np.clip(np.searchsorted(edges, ends), 1, len(edges) - 1) - 1
        return ends[np.diff(ends, prepend=edges[0]) < SHORT * np.diff(edges)[piece]]

    def quantities_at(self, interval: int, t: Array) -> Quantities:
        """Return the quantities at values of the parameter in one interval, shape (n,); the last ones are kept."""
        asked = interval, t.tobytes()
        if asked not in self._kept:
            self._forget(len(t))
            self._kept[asked] = self.quantities.of(self._rows_at(interval, t))
        return self._kept[asked]

    @property
    def _width(self) -> int:
        return max(1, int(self.run.mechanism.model.nv))

    def _forget(self, more: int) -> None:
        """Forget the states that were asked for first, as far as there are too many with some more."""
        room = 5 * TOGETHER // self._width - more
        while self._kept and (len(self._kept) >= KEPT or sum(len(t) // 8 for _, t in self._kept) > room):
            del self._kept[next(iter(self._kept))]

    def announce(self, places: Spots) -> None:
        """Note intervals and values of the parameter, shape (n,), at each of which states are about to be asked for."""

    def _rows_at(self, interval: int, t: Array) -> Trajectory:
        if self.motion is None:
            return self.run.some(np.full(len(t), interval))
        return on_interval(self.motion, self.run.grid.cuts, interval, t)

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
            return self.extreme(where, name)[0]
        return self._row(*self._instant(where, name))

    def at_instant(self, where: dict[str, str | int | float], name: str) -> tuple[float, float]:
        """Return a quantity where another has a value [SI], and by how much rounding of that may move it.

        Args:
            where: The instant, as in ``at``.
            name: The quantity that is asked for.

        Raises:
            InputError: See ``at``.
        """
        spot, (along, sought) = self._instant(where, name), located(where, self.quantities)
        value = float(self._row(*spot)[name].values[0])
        if along == self.run.parameter:
            return value, 0.0
        series = self.quantities[along]
        slack = PLATEAU * max(abs(sought), float(np.abs(series.values).max()), float(np.max(series.terms, initial=0.0)))
        apart = np.sin if self._is_told_to_half_a_turn(along, sought) else np.asarray

        def elsewhere(states: Quantities) -> Flags:
            return np.abs(apart(states[along].values - sought)) > slack

        return value, self._differs(spot, name, value, elsewhere)

    def _instant(self, where: dict[str, str | int | float], name: str) -> Spot:
        """Return where a quantity has the value that ``where`` says; see ``at``."""
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
        """Return where a quantity takes a value, in order; intervals are looked into between the rows."""
        wide, spots = set(self._wide), list[Spot]()
        find = crossings_of_angle if self._is_told_to_half_a_turn(along, value) else crossings
        for interval, (start, end, rows) in enumerate(self.intervals):
            t = self.run.grid.t[rows]
            t = np.concatenate(
                [t[:0] if len(t) and t[0] == start else [start], t, [] if len(t) and t[-1] == end else [end]]
            )
            if len(changes := self.switches(along)[interval]):
                t = distinct(np.append(t, changes))[:: 1 if start <= end else -1]
            difference = partial(self._difference, along, value, interval)
            found = find(difference, t, self.parts_of_each if interval in wide else 0)
            spots += [(interval, t) for t in found]
        return spots

    def _is_told_to_half_a_turn(self, along: str, value: float) -> bool:
        """Tell whether a value may be that of an angle that jumps from 180 to -180 deg."""
        unit = self.quantities[along].unit
        return unit is not None and unit.text == "rad" and abs(value) <= np.pi

    def _difference(self, along: str, value: float, interval: int, t: Array) -> Array:
        return np.asarray(self.quantities_at(interval, t)[along].values - value)

    @cached_property
    def _wide(self) -> list[int]:
        """Numbers of the intervals that have a length."""
        return [k for k, (start, end, _) in enumerate(self.intervals) if start != end]

    @property
    def parts_of_each(self) -> int:
        """In how many parts an interval is looked into at least."""
        return PARTS if len(self._wide) <= MOST_INTERVALS else 1

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
                )
        return chosen[0 if side == "left" else -1]

    def extreme(self, which: str, name: str, slack: float = 0.0) -> tuple[Quantities, float]:
        """Return the row at which a quantity is largest, smallest, or largest in size, and by how much it may be more.

        Args:
            which: ``max``, ``min`` or ``largest``.
            name: The quantity.
            slack: Difference of values that is rounding, where it is more than that of its terms: the first row is
                the extreme that is not passed by more.

        Raises:
            InputError: It has no such value, as it passes through infinity, or rounding decides what it is.
        """
        peak, row = self._extreme(which, name, slack)
        return row, peak.error

    def at_extreme(self, which: str, of: str, name: str) -> tuple[float, float]:
        """Return a quantity where another is extreme [SI], and by how much it differs where that may be as extreme.

        An extreme is known to ``PLATEAU``, and curves are level there: its place is known to the root of that.

        Args:
            which: ``max``, ``min`` or ``largest``.
            of: The quantity that is extreme.
            name: The quantity that is asked for.

        Raises:
            InputError: See ``extreme``.
        """
        peak, row = self._extreme(which, of)
        value = float(row[name].values[0])

        def lower(states: Quantities) -> Flags:
            return np.asarray(_HEIGHTS[which](states[of].values) < peak.height - 2.0 * peak.error)

        return value, self._differs((peak.interval, peak.place), name, value, lower)

    def _differs(self, spot: Spot, name: str, value: float, elsewhere: Callable[[Quantities], Flags]) -> float:
        """Return by how much a quantity differs beside a place as far as that cannot be told from it.

        Args:
            spot: The place.
            name: The quantity.
            value: Its value there.
            elsewhere: States -> which of them are at another place for certain.
        """
        (interval, place), (start, end, _) = spot, self.intervals[spot[0]]
        apart, sides = 0.0, [] if self.motion is None else [side for side in (start, end) if side != place]
        for ways in (NEARER, FARTHER) if sides else ():
            places = [place + (side - place) * ways for side in sides]
            t = np.unique(np.concatenate(places))
            states = self.quantities_at(interval, t)
            other, differences, left = elsewhere(states), np.abs(states[name].values - value), list[float]()
            for side, own in zip(sides, (t.searchsorted(each) for each in places), strict=True):
                reached = int(other[own].argmax()) + 1 if other[own].any() else len(own)
                apart = max(apart, float(differences[own[:reached]].max()))
                left += [] if other[own].any() else [side]
            if not (sides := left):
                break
        return apart

    def _extreme(self, which: str, name: str, slack: float = 0.0) -> tuple[Peak, Quantities]:
        """Return an extreme, and its row; see ``extreme``."""
        places = self._rests if self._has_bands and not _plain(name) else []
        what = f"{name} has no {_EXTREMES[which]}"
        slack = max(slack, PLATEAU * float(np.max(self.quantities[name].terms, initial=0.0)))

        def height(rows: Quantities) -> Array:
            return _HEIGHTS[which](rows[name].values)

        cuts = self.switches(name)
        peak = self._with_error_of_cut(self._highest(height, places, what, slack, cuts), height, cuts)
        row = self._row(peak.interval, peak.place)
        self._require_reproduced(peak, float(_HEIGHTS[which](row[name].values)[0]), row[name].unit, what)
        return peak, row

    def _with_error_of_cut(self, peak: Peak, height: Callable[[Quantities], Array], cuts: Sequence[Array]) -> Peak:
        """Return a peak with what its height changes by within rounding of its place, where it is at a cut."""
        if peak.place not in cuts[peak.interval]:
            return peak
        low, high = sorted(self.intervals[peak.interval][:2])
        beside = np.clip(peak.place + MISPLACED * max(abs(low), abs(high)) * np.array([-1.0, 1.0]), low, high)
        (heights,) = self.heights(height, [(peak.interval, beside)])
        return replace(peak, error=max(peak.error, float(np.abs(heights - peak.height).max())))

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

    @property
    def _has_bands(self) -> bool:
        """Whether friction gives efforts a band where joints are at rest, for an instant too."""
        return any(name.endswith(BAND_ENDS) for name in self.run.columns)

    @cached_property
    def _rests(self) -> list[tuple[int, Array]]:
        """Intervals, and where in them joints with friction are at rest for an instant."""
        return [*enumerate(self.motion.rests())] if self.motion else []

    def highest(self, height: Callable[[Quantities], Array], name: str, slack: float = 0.0) -> tuple[Quantities, float]:
        """Return the row at which a function of the quantities is largest, and by how much it may be more elsewhere.

        Args:
            height: Quantities of n rows -> values, shape (n,).
            name: What it is, for the message.
            slack: Difference of heights that is rounding: the first row is it that is not passed by more.

        Raises:
            InputError: It has no largest value, as it passes through infinity.
        """
        peak = self._highest(height, [], f"{name} has no largest value", slack)
        return self._row(peak.interval, peak.place), peak.error

    def _highest(
        self, height: Callable[[Quantities], Array], places: Spots, lacks: str, slack: float = 0.0,
        cuts: Sequence[Array] = (),
    ) -> Peak:  # fmt: skip
        """Return the largest value of a function of the quantities.

        Args:
            height: As in ``highest``.
            places: Intervals and values of the parameter there at which it may jump, for an instant only.
            lacks: That there is none, in words.
            slack: Difference of heights that is rounding, where it is more than that of the largest.
            cuts: Where it goes from one smooth part to another, interval by interval.
        """
        try:
            return self._peak(height, [*places, *self._beside_jumps], slack, self._parts_between(cuts))
        except Endless as pole:
            run = self.run
            raise InputError(
                f"{lacks}: it passes through infinity at {run.parameter} = {pole.place:.9g} {run.unit}, "
                "or through a peak there that is narrower than 1e-9 of the run",
                expected="a quantity that is finite everywhere, or its value at a place, or a percentage such as @ p95",
            ) from None

    def _peak(self, height: Callable[[Quantities], Array], places: Spots, slack: float, parts: list[CurvePart]) -> Peak:
        """Return the largest value of a function of the quantities, which is looked for in parts; see ``highest``."""
        t = self.run.grid.t
        values = bounded_below(height(self.quantities), t)
        slack = max(slack, PLATEAU * float(np.abs(values).max()))
        best = int((values >= values.max() - slack).argmax())
        row = Peak(float(values[best]), self._interval_of(best), float(t[best]))
        self.announce([*places, *(part.places for part in parts)])
        search = PeakSearch(partial(self.heights, height), self._fit, slack)
        top = search.highest(search.at(row, places), parts)
        rivals = [
            rival for rival in _rivals(values, top.height + slack)
            if not search.knows(self._interval_of(rival), t[rival], values[rival]) and not self._is_beside(rival, top)
        ]  # fmt: skip
        top = search.highest(top, [piece for rival in rivals for piece in self._beside(rival)])
        top = search.highest(top, self._beside_knots(height, top.height + slack))
        below = max(top.height - row.height, 0.0)
        if below <= slack:
            return replace(row, error=below + slack)
        return replace(top, error=max(top.error, slack, PLATEAU * abs(top.height)))

    def _beside_knots(self, height: Callable[[Quantities], Array], top: float) -> list[CurvePart]:
        """Return the pieces between knots of laws, and ends of short steps, where heights may pass a top."""
        spots = [(interval, t) for interval, t in enumerate(self._points) if len(t)]
        pieces = []
        for (interval, t), heights in zip(spots, self.heights(height, spots), strict=True):
            low, high = (min(self.intervals[interval][:2]), max(self.intervals[interval][:2]))
            around = np.concatenate([[low], t, [high]])
            rivals = _rivals(bounded_below(heights, t), top)
            pieces += [CurvePart(interval, (float(around[k]), float(around[k + 2]))) for k in rivals]
        return pieces

    def heights(self, height: Callable[[Quantities], Array], spots: Spots) -> list[Array]:
        """Return a function of the quantities at places of intervals; states of one interval are solved together.

        Args:
            height: Quantities of n rows -> values, shape (n,).
            spots: Numbers of intervals, and places in each, shape (n,).
        """
        found = [np.empty(0)] * len(spots)
        numbers = dict[int, list[int]]()
        for k, (interval, _) in enumerate(spots):
            numbers.setdefault(interval, []).append(k)
        for interval, own in numbers.items():
            t, back = np.unique(np.concatenate([spots[k][1] for k in own]), return_inverse=True)
            values = np.concatenate([height(self.quantities_at(interval, block)) for block in self.blocks(t)])[back]
            ends = np.cumsum([len(spots[k][1]) for k in own])
            for k, part in zip(own, np.split(values, ends[:-1]), strict=True):
                found[k] = part
        return found

    def blocks(self, t: Array) -> list[Array]:
        """Return places, shape (n,), in blocks of which states are solved together."""
        return np.array_split(t, 1 + len(t) * self._width // TOGETHER)

    def _interval_of(self, row: int) -> int:
        return next(k for k, (_, _, rows) in enumerate(self.intervals) if rows.start <= row < rows.stop)

    def _beside(self, row: int) -> list[CurvePart]:
        """Return the pieces of intervals between the rows before and after one."""
        t = self.run.grid.t
        low, high = sorted((float(t[max(row - 1, 0)]), float(t[min(row + 1, len(t) - 1)])))
        pieces = []
        for interval, (start, end, _) in enumerate(self.intervals):
            bracket = max(low, min(start, end)), min(high, max(start, end))
            if bracket[0] <= bracket[1]:
                pieces.append(CurvePart(interval, bracket))
        return pieces

    def _is_beside(self, row: int, top: Peak) -> bool:
        """Tell whether a peak is between the rows before and after one, and has been looked for there."""
        return top.place != self.run.grid.t[row] and any(
            piece.interval == top.interval and piece.bracket[0] <= top.place <= piece.bracket[1]
            for piece in self._beside(row)
        )

    @cached_property
    def _beside_jumps(self) -> list[tuple[int, Array]]:
        """Intervals, and instants in them at which loads jump, and just before."""
        found = [(interval, t) for interval, t in enumerate(self.jumps) if len(t)]
        return [
            (interval, np.sort(np.concatenate([t, t - BESIDE * np.diff(t, prepend=self.intervals[interval][0])])))
            for interval, t in found
        ]

    @cached_property
    def _points(self) -> list[Array]:
        """Points of the curves of laws, and ends of steps between those of pieces, interval by interval, ascending."""
        found = list[Array]()
        for interval, (start, end, _) in enumerate(self.intervals):
            even = np.linspace(min(start, end), max(start, end), self.parts_of_each + 1)
            short = self.short_steps(interval, distinct(np.append(even, self.cuts(interval))))
            found.append(distinct(np.append(self.knots[interval], short)))
        return found

    @cached_property
    def parts(self) -> list[CurvePart]:
        """The pieces in which extremes are looked for beside those near rows."""
        pieces = []
        for interval in self._wide:
            start, end, _ = self.intervals[interval]
            cuts = distinct(np.concatenate([np.linspace(start, end, self.parts_of_each + 1), self.cuts(interval)]))
            pieces += [CurvePart(interval, (min(pair), max(pair))) for pair in pairwise(cuts.tolist())]
        return pieces

    def _parts_between(self, cuts: Sequence[Array]) -> list[CurvePart]:
        """Return the same, cut besides at places of each interval."""
        pieces = []
        for part in self.parts:
            (low, high), at = part.bracket, cuts[part.interval] if len(cuts) else ()
            within = [low, *(t for t in at if low < t < high), high]
            pieces += [CurvePart(part.interval, pair) for pair in pairwise(within)]
        return pieces

    def _fit(self, bracket: tuple[float, float], heights: Array) -> BracketFit:
        """Return the polynomial through heights at the nodes of a bracket; the last ones are kept."""
        curve = *bracket, heights.tobytes()
        if curve not in self._fits:
            if len(self._fits) >= FITS:
                self._fits.clear()
            self._fits[curve] = BracketFit(*bracket, heights)
        return self._fits[curve]


def _plain(name: str) -> bool:
    """Tell whether a name is that of a quantity with words, no symbol, formula or end of a band."""
    return "." in name and not set(name) & OPERATORS and not name.endswith(BAND_ENDS)


def _rivals(values: Array, top: float) -> list[int]:
    """Return the rows near which heights between the rows may be above a top, the most promising first.

    Between samples of a parabola its top is above them by an eighth of their second difference at most; half of it is
    allowed for.
    """
    if len(values) < 3:
        return [*range(len(values))]
    bend = np.abs(2.0 * values[1:-1] - values[:-2] - values[2:])
    reach = values + 0.5 * np.pad(bend, 1, mode="edge")
    around = np.pad(values, 1, constant_values=-np.inf)
    near = (values >= around[:-2]) & (values >= around[2:]) & (reach > top)
    rows = np.flatnonzero(near)
    order = rows[np.argsort(-reach[rows], kind="stable")]
    rivals: list[int] = order.tolist()
    return rivals[:MOST_RIVALS]
