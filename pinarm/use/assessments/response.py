"""Step responses: overshoot, rise and settling time of a quantity on its way from a first to a final value.

With y_0 at the beginning, y_f at the end, and ``z = (y - y_0) / (y_f - y_0)``, which goes from 0 to 1:

- rise time: from where z first reaches 10 % to where it first reaches 90 %;
- overshoot: the largest z, less 1; 0 where z stays below 1;
- settling time: from the beginning to where z enters the band ``|z - 1| <= band`` for the last time.

Of rows between which nothing is known all times are those of rows: what is reached between two of them is told at the
later one.

The error of a time is what it changes by where the level is moved by what z may be wrong by: much where z passes it
slowly, and from one crossing to another where a top just touches it.

Source: Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, section 3.4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Time, check_unit
from pinarm.use.result.output_scales import output_scales
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Curve, Graph, Section, SectionTable

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

SAMPLES, PER_STEP, MOST = 4096, 4, 16_384
"""Instants at which the response is looked at: evenly over the run; within each step of the integrator, as steps are
short where the response changes quickly; and the most within all steps together, which have one each at least."""

NODES, ZOOMS = 17, 4
"""Instants about an extreme between samples, and how often they close in on it: to 8^-4 of the distance of samples."""

PLATEAU = 1e-12
"""Part of the step that a top has to be able to rise above the highest sample: less is rounding."""

FINE = 257
"""Instants about the highest one among which the peak is taken, twice: the second time about the highest of these."""

INSTANT = 4e-16
"""Rounding of an instant, relative to it."""

PARTS, REFINEMENTS = 32, 7
"""Parts into which a bracket of a crossing is divided, and how often: 32^-7 of the distance of samples is 3e-11."""

SECOND = unit("s")


class Response(InputStruct, frozen=True):
    """How a quantity goes from one value to another.

    Attributes:
        of: The quantity, or a formula of quantities.
        begin: Instant of the step, such as ``0.1 s``; the start of the run where it is left out.
        initial: Value that it starts from, such as ``0 deg``; that at the beginning where it is left out.
        final: Value that it goes to; that at the end of the run where it is left out.
        band: Half the width of the band in which it has settled, as a part of the step, such as ``0.05``.
    """

    of: str
    begin: Time | None = None
    initial: AnyQuantity | None = None
    final: AnyQuantity | None = None
    band: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.02

    def requested(self, mechanism: Mechanism) -> list[str]:
        """Return what it needs of a run: see ``Assessment``."""
        return [self.of]

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        """Return the numbers of the section: see ``Assessment``."""
        value = quantities[self.of].unit
        times = dict.fromkeys(("rise_time", "peak_time", "settling_time"), SECOND)
        return {"overshoot": DIMENSIONLESS, **times, "initial": value, "final": value, "peak": value, "error": value}

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        """Check the quantity, the units and the kind of run: see ``Assessment``."""
        with within("of"):
            value = quantities[self.of].unit
        for key, given in (("initial", self.initial), ("final", self.final)):
            if given is not None:
                with within(key):
                    check_unit(given, value or DIMENSIONLESS)
        if quantities.trajectory.parameter != "t":
            raise InputError("a step response is one over time", expected="a forward, inverse or recorded motion")

    def evaluate(self, result: Result) -> Section:
        """Return overshoot, rise and settling time: see ``Assessment``.

        Raises:
            InputError: There is no step, or the run does not come to what is asked.
        """
        self.check_names(result.quantities, result.scenario)
        result.quantities.determined(self.of)
        step = _Step.of(self, result.lookup)
        wrong = result.errors[self.of] * output_scales(result)[self.of] if self.of in result.errors else 0.0
        told, measured = step.numbers(self.band, step.doubt(wrong)), result.quantities[self.of].unit
        values, errors = ({name: pair[k] for name, pair in told.items()} for k in (0, 1))
        names = {"overshoot": "overshoot", "rise_time": "rise time", "peak_time": "time of the peak",
                 "settling_time": f"settling time to {100.0 * self.band:g} %", "initial": "first value",
                 "final": "final value", "peak": "peak", "error": "error at the end"}  # fmt: skip
        units = {**dict.fromkeys(names, measured), **self.units(result.quantities)}
        numbers = {name: Series(names[name], units[name] or DIMENSIONLESS, np.array([values[name]])) for name in names}
        rows = [(names[name], values[name], str(units[name] or ""), errors[name]) for name in names]
        table = SectionTable("response", f"Step response of {self.of}", ("", "value", "unit", "error"), (None,) * 4,
                             rows, row_unit=2)  # fmt: skip
        graph = Graph("response", f"Step response of {self.of}",
                      [Curve(result.quantities["t"], result.quantities[self.of])])  # fmt: skip
        return Section("response", "Step response", [table], numbers, step.remarks(self, values), [graph], errors)


class _Step:
    """A response on its way; ``z`` is its part of the step.

    Args:
        run: The run.
        of: The quantity.
        begin: When the step begins [s].
        bounds: First and final value.
        band: Half the width of the band in which it has settled.
    """

    def __init__(self, run: Lookup, of: str, begin: float, bounds: tuple[float, float], band: float) -> None:
        self.run, self.name, self.begin = run, of, begin
        self.initial, self.final = bounds
        self.end = float(run.run.grid.cuts[-1])
        if self.final == self.initial:
            raise InputError(f"'{of}' ends where it begins, at {self.final:.6g}: there is no step",
                             expected="a final value that differs",
                             hint="final: the value that it should reach")  # fmt: skip
        parts = [(k, self._instants(k, *ends)) for k, (*ends, _) in enumerate(run.intervals)
                 if ends[1] > begin or ends[0] == ends[1] == begin]  # fmt: skip
        self.owners = np.concatenate([np.full(len(t), k) for k, t in parts])
        self.t = np.concatenate([t for _, t in parts])
        self.z = self._everywhere(self.owners, self.t)
        for sign in (1.0, -1.0):
            self._add_tops(sign, band)

    @classmethod
    def of(cls, asked: Response, run: Lookup) -> _Step:
        """Return the response that is asked for."""
        begin = float(run.run.grid.cuts[0] if asked.begin is None else asked.begin)
        if not run.run.grid.cuts[0] <= begin < run.run.grid.cuts[-1]:
            with within("begin"):
                raise InputError(f"the run does not come to {begin:.6g} s", expected="an instant before its end")
        ends = run.run.grid.cuts[-1]
        bounds = [
            float(given)
            if given is not None
            else float(run.at({"t": f"{at!r} s", "side": "left"}, asked.of)[asked.of].values[0])
            for given, at in ((asked.initial, begin), (asked.final, ends))
        ]
        return cls(run, asked.of, begin, (bounds[0], bounds[1]), asked.band)

    def _instants(self, interval: int, start: float, end: float) -> Array:
        if start == end:
            return np.array([start])
        low = max(start, self.begin)
        count = max(int(np.ceil(SAMPLES * (end - low) / (self.end - self.begin))), 8)
        bends = np.concatenate([self.run.steps[interval], self.run.knots[interval]])
        ends = distinct(np.concatenate([[low, end], bends[(bends > low) & (bends < end)]]))
        parts = max(1, min(PER_STEP, MOST // self._steps))
        between = ends[:-1, None] + np.diff(ends)[:, None] * (np.arange(parts) / parts)
        return distinct(np.concatenate([np.linspace(low, end, count + 1), between.ravel()]))

    @cached_property
    def _steps(self) -> int:
        return 1 + sum(map(len, self.run.steps))

    def at(self, interval: int, t: Array) -> Array:
        """Return z at instants of one interval, shape (n,)."""
        return self._part(self.run.quantities_at(interval, t))

    def _part(self, rows: Quantities) -> Array:
        return np.asarray((rows[self.name].values - self.initial) / (self.final - self.initial))

    def _everywhere(self, owners: Array, t: Array) -> Array:
        """Return z at instants of intervals, shape (n,), those of one interval next to one another."""
        cuts = np.flatnonzero(np.diff(owners)) + 1
        spots = [(int(own[0]), part) for own, part in zip(np.split(owners, cuts), np.split(t, cuts), strict=True)]
        return np.concatenate(self.run.heights(self._part, spots))

    def _add_tops(self, sign: float, band: float) -> None:
        """Add those tops of ``sign z`` between samples that may be above a level below which the samples are.

        Between samples of a parabola its top is above them by an eighth of their second difference at most; half of it
        is allowed for.
        """
        z, changes = sign * self.z, self.owners[1:] != self.owners[:-1]
        first, last = np.append(True, changes), np.append(changes, True)
        bend = np.where(first | last, 0.0, np.abs(2.0 * z - np.roll(z, 1) - np.roll(z, -1)))
        bend = np.maximum(bend, np.maximum(first * np.roll(bend, -1), last * np.roll(bend, 1)))
        reach, levels = z + 0.5 * bend, [sign * level for level in (0.1, 0.9, 1.0 - band, 1.0 + band)]
        passing = np.any([(z < level) & (reach >= level) for level in levels], axis=0)
        if sign > 0.0:
            passing |= reach > z.max() + PLATEAU
        highest = (first | (z >= np.roll(z, 1))) & (last | (z >= np.roll(z, -1))) & ~(first & last)
        rows = np.flatnonzero(highest & passing)
        if len(rows):
            self._insert(
                self.owners[rows], self._tops(sign, rows, self.t[rows - ~first[rows]], self.t[rows + ~last[rows]])
            )

    def _tops(self, sign: float, rows: Indices, low: Array, high: Array) -> Array:
        """Return where ``sign z`` is highest about samples, between bounds, all of shape (n,)."""
        each, owners = np.arange(len(rows)), self.owners[rows].repeat(NODES)
        for _ in range(ZOOMS):
            t = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, NODES)
            best = (sign * self._everywhere(owners, t.ravel())).reshape(t.shape).argmax(axis=1)
            low, high = t[each, np.maximum(best - 1, 0)], t[each, np.minimum(best + 1, NODES - 1)]
        return np.asarray(t[each, best])

    def _insert(self, owners: Array, t: Array) -> None:
        """Take further instants, shape (n,), among the samples."""
        all_owners, all_t = np.append(self.owners, owners), np.append(self.t, t)
        order = np.lexsort((all_t, all_owners))
        self.z = np.append(self.z, self._everywhere(owners, t))[order]
        self.owners, self.t = all_owners[order], all_t[order]

    def doubt(self, error: float) -> float:
        """Return what z may be wrong by: rounding of its terms, or the error of y, y_0 and y_f where it is known."""
        terms = np.max(self.run.quantities[self.name].terms, initial=max(abs(self.initial), abs(self.final)))
        return max(PLATEAU * float(terms), 2.0 * error) / abs(self.final - self.initial)

    def numbers(self, band: float, doubt: float) -> dict[str, tuple[float, float]]:
        """Return the numbers of the section, and their errors [SI].

        Args:
            band: Half the width of the band in which it has settled.
            doubt: What z may be wrong by.
        """
        size = self.final - self.initial
        (peak, rise), (when, apart) = self._peak(doubt)
        (low, off_low), (high, off_high) = (
            self._timed(partial(np.add, -part), doubt, first=True) for part in (0.1, 0.9)
        )
        settled, off = self._timed(lambda z: band - np.abs(z - 1.0), doubt, first=False)
        left, rounding = (1.0 - float(self.z[-1])) * size, INSTANT * max(abs(self.initial), abs(self.final))
        return {
            "overshoot": (max(peak - 1.0, 0.0), max(rise, INSTANT * abs(peak))),
            "rise_time": (high - low, off_low + off_high), "peak_time": (when - self.begin, apart),
            "settling_time": (settled - self.begin, off), "initial": (self.initial, 0.0), "final": (self.final, 0.0),
            "peak": (self.initial + peak * size, rise * abs(size)), "error": (left, rounding),
        }  # fmt: skip

    def _peak(self, doubt: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the largest z and when it is, each with its error: so far away z may be as large."""
        top = int(self.z.argmax())
        first, last = self._bounds(top)
        beside = max(self.t[max(top - 1, 0)], first), min(self.t[min(top + 1, len(self.t) - 1)], last)
        found = [(self.t, self.z)]
        for _ in range(2):
            near = np.linspace(*beside, FINE)
            z = self.at(int(self.owners[top]), near)
            best = int(z.argmax())
            beside = near[max(best - 1, 0)], near[min(best + 1, FINE - 1)]
            found.append((near, z))
        peak, when, bend = float(z[best]), float(near[best]), float(np.abs(np.diff(z, 2)).max(initial=0.0))
        if self.run.motion is None:
            beside, bend = (self.t[max(top - 1, 0)], self.t[min(top + 1, len(self.t) - 1)]), self._bend(top)
        rise = max(0.5 * bend, doubt)
        t, heights = (np.concatenate(each) for each in zip(*found, strict=True))
        as_high = t[heights >= peak - 2.0 * rise]
        apart = float(np.abs(as_high - when).max()) + float(beside[1] - beside[0]) + INSTANT * abs(when)
        return (peak, rise), (when, apart)

    def _bend(self, row: int) -> float:
        return float(np.abs(np.diff(self.z[max(row - 1, 0) : row + 2], 2)).max(initial=0.0))

    def _bounds(self, place: int) -> tuple[float, float]:
        inside = self.t[self.owners == self.owners[place]]
        return float(inside[0]), float(inside[-1])

    def _timed(self, value: Callable[[Array], Array], doubt: float, *, first: bool) -> tuple[float, float]:
        """Return where a function of z becomes positive, see ``crossing``, and the error of that instant [s].

        Where it may come to none at all, the error is the length of the run.
        """
        t, apart = self.crossing(value, first=first)
        if np.isnan(t):
            return t, 0.0
        moved = [self.crossing(lambda z, by=by: value(z) + by, first=first)[0] for by in (-doubt, doubt)]  # type: ignore[misc]
        off = float(np.abs(np.array(moved) - t).max())
        return t, (self.end - self.begin if np.isnan(off) else off + apart) + INSTANT * abs(t)

    def crossing(self, value: Callable[[Array], Array], *, first: bool) -> tuple[float, float]:
        """Return where a function of z becomes positive, for the first or for the last time [s]; NaN where never.

        With the length of the last bracket.
        """
        positive = value(self.z) >= 0.0
        if positive.all() or (first and positive[0]):
            return self.begin, 0.0
        rising = np.flatnonzero(positive[1:] & ~positive[:-1])
        if not len(rising) or (not first and not positive[-1]):
            return float("nan"), 0.0
        k = int(rising[0 if first else -1])
        low, high, owner = float(self.t[k]), float(self.t[k + 1]), int(self.owners[k + 1])
        for _ in range(REFINEMENTS if owner == self.owners[k] else 0):
            t = np.linspace(low, high, PARTS + 1)
            there = np.flatnonzero(value(self.at(owner, t[1:])) >= 0.0)
            place = int(there[0]) + 1 if len(there) else PARTS
            low, high = float(t[place - 1]), float(t[place])
        return high, high - low

    def remarks(self, asked: Response, values: Mapping[str, float]) -> list[str]:
        """Return what to know of the numbers."""
        found = []
        if self.run.motion is None:
            apart = float(np.diff(self.t).max(initial=0.0))
            known = f"times and the peak are those of rows, at most {apart:.3g} s apart"
            found.append(f"nothing is known between the rows: {known}")
        if asked.final is None:
            found.append("the final value is that at the end of the run")
        if np.isnan(values["settling_time"]):
            found.append(f"it has not settled to {100.0 * asked.band:g} % at the end of the run")
        if np.isnan(values["rise_time"]):
            found.append("it does not reach 90 % of the step")
        if values["peak_time"] == self.end - self.begin and values["overshoot"] > PLATEAU:
            found.append("it is farthest beyond its final value at the end of the run, and may go on: overshoot, peak "
                         "and settling time are those of the run so far")  # fmt: skip
        return found
