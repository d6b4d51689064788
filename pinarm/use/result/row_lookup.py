"""Where on a run a quantity is asked: an instant, a coordinate's value, an extreme; solved there, not interpolated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.outcome import SolvedMotion, on_interval
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import OPERATORS, Quantities
from pinarm.errors import InputError, Key, PinarmError, within
from pinarm.input.yaml.schema import in_si
from pinarm.records import Record
from pinarm.use.result.figures.bracket_fit import BracketFit
from pinarm.use.result.figures.crossings import FLAT, POINTS, ROUNDS, crossings

if TYPE_CHECKING:
    from pinarm.use.result.expectation import Expectation

_HEIGHTS: dict[str, Callable[[Array], Array]] = {
    "max": lambda x: x,
    "min": lambda x: -x,
    "largest": lambda x: np.abs(x),
}
"""Name of an extreme -> what is largest there."""

PLATEAU = 1e-12
"""Relative difference to an extreme below which a row of the table is the extreme: the first of them is."""

SAME = 1e-9
"""Relative difference between two sides of an instant below which there is no jump to be asked about."""

MOST_RIVALS = 20
"""Rows beside the highest one that are refined at most: those that may rise most."""

FEW, PARTS = 200, 4
"""Rows of an interval below which it is looked into by itself, and in how many parts, of 17 states each."""

HALVINGS = 6
"""How often a part is halved where 17 states do not resolve the curve: it goes up and down in it, or has a kink."""

MOST_INTERVALS = 100
"""Intervals with few rows up to which they are; thousands, as between samples of controllers, are rows enough."""

KEPT = 20
"""Sets of points whose states are kept: the integrals of several quantities begin with the same points."""

FITS = 200
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
        for along, text in entry.instant().items():
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

    def quantities_at(self, interval: int, t: Array) -> Quantities:
        """Return the quantities at values of the parameter in one interval, shape (n,); the last ones are kept."""
        asked = interval, t.tobytes()
        if asked not in self._kept:
            if len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[asked] = self.quantities.of(self._rows_at(interval, t))
        return self._kept[asked]

    def announce(self, places: Sequence[tuple[int, Array]]) -> None:
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
            return self._extreme(where, name)
        keys = {key: value for key, value in where.items() if key not in ("side", "occurrence")}
        if len(keys) != 1:
            raise InputError("an instant names one coordinate", expected="such as {t: 1.5 s, side: left}")
        (along, text), *_ = keys.items()
        with within(Key(along)):
            measured = self.quantities[along].unit
        with within(along):
            value = in_si(text, measured)
        spots = self._on_parameter(value) if along == self.run.parameter else self._crossings(along, value)
        return self._choose(spots, where, name, f"{along} = {text}")

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
        """Return where a quantity takes a value, in order; intervals with few rows are looked into between these."""
        few = set(self._few)
        spots = []
        for interval, (start, end, rows) in enumerate(self.intervals):
            t = self.run.grid.t[rows]
            t = np.concatenate(
                [t[:0] if len(t) and t[0] == start else [start], t, [] if len(t) and t[-1] == end else [end]]
            )
            curve = partial(self._difference, along, value, interval)
            spots += [(interval, place) for place in crossings(curve, t, PARTS if interval in few else 0)]
        return spots

    def _difference(self, along: str, value: float, interval: int, t: Array) -> Array:
        return np.asarray(self.quantities_at(interval, t)[along].values - value)

    @cached_property
    def _few(self) -> list[int]:
        """Numbers of the intervals that have few rows; none where these are many intervals."""
        found = [k for k, (start, end, rows) in enumerate(self.intervals)
                 if start != end and rows.stop - rows.start < FEW]  # fmt: skip
        return found if len(found) <= MOST_INTERVALS else []

    def _choose(self, spots: list[Spot], where: dict[str, str | int | float], name: str, text: str) -> Quantities:
        """Return the row that is meant among those found: by occurrence, then by side."""
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
        sides = [self._row(*chosen[0]), self._row(*chosen[-1])]
        side = where.get("side")
        if side not in (None, "left", "right"):
            raise InputError(f"there is no side '{side}'", expected="left or right")
        if side is None and len(chosen) > 1:
            left, right = (float(rows[name].values[0]) for rows in sides)
            if abs(left - right) > SAME * max(abs(left), abs(right)):
                raise InputError(
                    f"{name} jumps at {text}: {left:.9g} before, {right:.9g} after",
                    expected="side: left or side: right",
                )
        return sides[0 if side == "left" else 1]

    def _extreme(self, which: str, name: str) -> Quantities:
        """Return the row at which a quantity is largest, smallest, or largest in size."""
        if not np.isfinite(self.quantities[name].values).all():
            raise InputError(f"{name} is not finite everywhere: it has no extreme")
        places = self._rests if self._has_bands and not _plain(name) else []
        return self.highest(lambda rows: _HEIGHTS[which](rows[name].values), places)

    @property
    def _has_bands(self) -> bool:
        """Whether friction gives efforts a band where joints are at rest, for an instant too."""
        return any(name.endswith(BAND_ENDS) for name in self.run.columns)

    @cached_property
    def _rests(self) -> list[tuple[int, Array]]:
        """Intervals, and where in them joints with friction are at rest for an instant."""
        from pinarm.engine.motion.prescribed_motion import PrescribedMotion

        return [*enumerate(self.motion.rests())] if isinstance(self.motion, PrescribedMotion) else []

    def highest(self, height: Callable[[Quantities], Array], places: Sequence[tuple[int, Array]] = ()) -> Quantities:
        """Return the row at which a function of the quantities is largest, refined between the samples.

        Args:
            height: Quantities of n rows -> finite values, shape (n,).
            places: Intervals and values of the parameter there at which it may jump, for an instant only.
        """
        run, values = self.run, height(self.quantities)
        slack = PLATEAU * float(np.abs(values).max())
        best = int((values >= values.max() - slack).argmax())
        brackets = []
        for row in (best, *_rivals(values, best, slack)):
            low, high = sorted((run.grid.t[max(row - 1, 0)], run.grid.t[min(row + 1, len(values) - 1)]))
            for interval, (start, end, _) in enumerate(self.intervals):
                bracket = float(max(low, min(start, end))), float(min(high, max(start, end)))
                if bracket[0] <= bracket[1]:
                    brackets.append((interval, bracket))
        parts = self._between_few_rows()
        known = [(interval, BracketFit.places(*bracket)) for interval, bracket in (*brackets, *parts)]
        self.announce([*places, *known])
        spots = [self._refined(interval, height, bracket) for interval, bracket in brackets]
        spots += [self._refined(interval, height, bracket, HALVINGS) for interval, bracket in parts]
        spots += [self._highest_of(interval, height, t) for interval, t in places]
        top, interval, t = max(spots, key=lambda spot: spot[0])
        if top <= values[best] + slack:
            interval = next(k for k, (_, _, rows) in enumerate(self.intervals) if rows.start <= best < rows.stop)
            t = float(run.grid.t[best])
        return self._row(interval, t)

    def _highest_of(self, interval: int, height: Callable[[Quantities], Array], t: Array) -> tuple[float, int, float]:
        """Return the largest height at values in one interval, the interval, and where it is."""
        heights = height(self.quantities_at(interval, t))
        peak = int(heights.argmax())
        return float(heights[peak]), interval, float(t[peak])

    def _between_few_rows(self) -> list[tuple[int, tuple[float, float]]]:
        """Return brackets in each interval that has few rows, which may pass an extreme between them."""
        brackets = []
        for interval in self._few:
            start, end, _ = self.intervals[interval]
            cuts = np.linspace(start, end, PARTS + 1)
            brackets += [(interval, (min(pair), max(pair))) for pair in pairwise(cuts.tolist())]
        return brackets

    def _refined(
        self, interval: int, height: Callable[[Quantities], Array], bracket: tuple[float, float], halvings: int = 0
    ) -> tuple[float, int, float]:
        """Return the largest height in a bracket of one interval, the interval, and where it is.

        Args:
            interval: Number of the interval.
            height: As in ``highest``.
            bracket: Where it begins and ends.
            halvings: How often it may be halved where the curve is not resolved.
        """
        t = BracketFit.places(*bracket)
        heights = height(self.quantities_at(interval, t))
        peak = int(heights.argmax())
        spot, top = float(t[peak]), float(heights[peak])
        if np.ptp(heights) <= FLAT * np.abs(heights).max():
            return top, interval, spot
        fit = self._fit(bracket, heights)
        if not fit.is_resolved:
            return self._halved(interval, height, bracket, halvings)
        places = fit.extremes
        if len(places):
            place = float(places[fit.at(places).argmax()])
            risen = float(height(self._row(interval, place))[0])
            if risen > top:
                spot, top = place, risen
        return top, interval, spot

    def _halved(
        self, interval: int, height: Callable[[Quantities], Array], bracket: tuple[float, float], halvings: int
    ) -> tuple[float, int, float]:
        """Return what ``_refined`` does, of a curve that a polynomial through 17 states does not follow."""
        if not halvings:
            return self._narrowed(interval, height, bracket)
        low, high = bracket
        halves = (low, 0.5 * (low + high)), (0.5 * (low + high), high)
        return max((self._refined(interval, height, half, halvings - 1) for half in halves), key=lambda spot: spot[0])

    def _fit(self, bracket: tuple[float, float], heights: Array) -> BracketFit:
        """Return the polynomial through heights at the nodes of a bracket; the last ones are kept."""
        curve = *bracket, heights.tobytes()
        if curve not in self._fits:
            if len(self._fits) >= FITS:
                self._fits.clear()
            self._fits[curve] = BracketFit(*bracket, heights)
        return self._fits[curve]

    def _narrowed(
        self, interval: int, height: Callable[[Quantities], Array], bracket: tuple[float, float]
    ) -> tuple[float, int, float]:
        """Return the largest height as ``_refined`` does, of a curve that has a kink."""
        (low, high), spot, top = bracket, bracket[0], -np.inf
        for _ in range(ROUNDS // 2):  # near a maximum only half of the digits of its place matter
            t = np.linspace(low, high, POINTS)
            heights = height(self.quantities_at(interval, t))
            peak = int(heights.argmax())
            if heights[peak] > top:
                spot, top = float(t[peak]), float(heights[peak])
            low, high = t[max(peak - 1, 0)], t[min(peak + 1, POINTS - 1)]
        return top, interval, spot


def _plain(name: str) -> bool:
    """Tell whether a name is that of a quantity with words, no symbol, formula or end of a band."""
    return "." in name and not set(name) & OPERATORS and not name.endswith(BAND_ENDS)


def _rivals(values: Array, best: int, slack: float) -> list[int]:
    """Return the rows near which heights between the rows may be above all rows, the most promising first.

    Between samples of a parabola its top is above them by an eighth of their second difference at most; half of it is
    allowed for.
    """
    if len(values) < 3:
        return []
    bend = np.abs(2.0 * values[1:-1] - values[:-2] - values[2:])
    reach = values + 0.5 * np.pad(bend, 1, mode="edge")
    around = np.pad(values, 1, constant_values=-np.inf)
    near = (values >= around[:-2]) & (values >= around[2:]) & (reach > values[best] + slack)
    rows = np.flatnonzero(near)
    order = rows[np.argsort(-reach[rows], kind="stable")]
    return [row for row in order.tolist() if row != best][:MOST_RIVALS]
