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

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Time, check_unit
from pinarm.use.result.curve import looked_at, roots
from pinarm.use.result.curve_figures import CurveFigure
from pinarm.use.result.number_accuracy import output_scales
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Curve, Graph, Section, SectionTable, numbered

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

PLATEAU = 1e-12
"""Rounding of a value, relative to the terms that it sums."""

TOUCH = 4e-12
"""Distance of a top from a level, relative to the largest z, beyond which it does not only touch the level."""

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

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        value = quantities[self.of].unit
        times = dict.fromkeys(("rise_time", "peak_time", "settling_time"), SECOND)
        return {"overshoot": DIMENSIONLESS, **times, "initial": value, "final": value, "peak": value, "error": value}

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        with within("of"):
            value = quantities[self.of].unit
        for key, value_of_key in (("initial", self.initial), ("final", self.final)):
            if value_of_key is not None:
                with within(key):
                    check_unit(value_of_key, value or DIMENSIONLESS)
        if quantities.trajectory.parameter != "t":
            raise InputError("a step response is one over time", expected="a forward, inverse or recorded motion")

    def evaluate(self, result: Result) -> Section:
        """Return overshoot, rise and settling time: see ``Assessment``."""
        self.check_names(result.quantities, result.scenario)
        result.quantities.determined(self.of)
        step = _Step(self, result.lookup)
        wrong = result.errors[self.of] * output_scales(result)[self.of] if self.of in result.errors else 0.0
        results, units = step.numbers(self.band, step.doubt(wrong)), self.units(result.quantities)
        names = {"overshoot": "overshoot", "rise_time": "rise time", "peak_time": "time of the peak",
                 "settling_time": f"settling time to {100.0 * self.band:g} %", "initial": "first value",
                 "final": "final value", "peak": "peak", "error": "error at the end"}  # fmt: skip
        numbers = {name: CurveFigure(*results[name], units[name] or DIMENSIONLESS) for name in names}
        rows = [(names[name], x.value, str(units[name] or ""), x.error) for name, x in numbers.items()]
        title, columns = f"Step response of {self.of}", ("", "value", "unit", "error")
        table = SectionTable("response", title, columns, (None,) * 4, rows, row_unit=2)
        graph = Graph("response", title, [Curve(result.quantities["t"], result.quantities[self.of])])
        remarks = step.remarks(self, {name: x.value for name, x in numbers.items()})
        return Section("response", "Step response", [table], remarks=remarks, graphs=[graph], **numbered(numbers))


class _Step:
    """The response that is asked for of a run; ``z`` is its part of the step."""

    def __init__(self, asked: Response, run: Lookup) -> None:
        start, self.end = float(run.run.grid.cuts[0]), float(run.run.grid.cuts[-1])
        self.run, self.name, self.begin = run, asked.of, start if asked.begin is None else float(asked.begin)
        if not start <= self.begin < self.end:
            with within("begin"):
                raise InputError(f"the run does not come to {self.begin:.6g} s", expected="an instant before its end")
        self.initial, self.final = (
            float(run.at({"t": f"{at!r} s", "side": "left"}, asked.of)[asked.of].values[0] if value is None else value)
            for value, at in ((asked.initial, self.begin), (asked.final, self.end))
        )
        self.size, self.curve = self.final - self.initial, run.curve_of(asked.of).after(self.begin)
        if not self.size:
            raise InputError(
                f"'{asked.of}' ends where it begins, at {self.final:.6g}: there is no step",
                expected="a final value that differs",
                hint="final: the value that it should reach",
            )

    def doubt(self, error: float) -> float:
        """Return the error of z: the larger of its rounding and of twice the error of y, over the size of the step."""
        terms = np.max(self.run.quantities[self.name].terms, initial=max(abs(self.initial), abs(self.final)))
        return max(PLATEAU * float(terms), 2.0 * error) / abs(self.size)

    def numbers(self, band: float, doubt: float) -> dict[str, tuple[float, float]]:
        """Return the numbers of the section, and their errors [SI].

        Args:
            band: Half the width of the band in which it has settled.
            doubt: What z may be wrong by.
        """
        (peak, rise), (when, apart) = self._peak(doubt)
        moved = doubt + TOUCH * max(1.0, abs(peak))
        (low, off_low), (high, off_high) = (self._timed(1.0, part, moved, first=True) for part in (0.1, 0.9))
        sides = [self._timed(way, 1.0 - way * band, moved, first=False) for way in (1.0, -1.0)]
        settled, off = max(sides) if np.isfinite(sides).all() else (np.nan, 0.0)
        off = max([off, *(t + late - settled for t, late in sides if np.isfinite(settled))])
        left = self.final - float(self.run.at("end", self.name)[self.name].values[0])
        return {
            "overshoot": (max(peak - 1.0, 0.0), rise),
            "rise_time": (high - low, off_low + off_high),
            "peak_time": (when - self.begin, apart),
            "settling_time": (settled - self.begin, off),
            "initial": (self.initial, 0.0),
            "final": (self.final, 0.0),
            "peak": (self.initial + peak * self.size, rise * abs(self.size)),
            "error": (left, 0.0),
        }

    def _peak(self, doubt: float) -> tuple[tuple[float, float], tuple[float, float]]:
        t, sign = self.run.run.grid.t, float(np.sign(self.size))
        values = np.where(t >= self.begin, self.run.quantities[self.name].values, -sign * np.inf)
        lacks = f"{self.name} has no {'largest' if sign > 0.0 else 'smallest'} value"
        peak = self.run.highest_of(self.curve, values, (sign,), lacks, doubt * abs(self.size))
        rise, bend = max(peak.error / abs(self.size), doubt), 0.0
        if self.run.motion is None:
            beside = slice(max(peak.interval - 1, 0), peak.interval + 2)
            bend = 0.5 * float(np.abs(np.diff(values[beside], 2)).max(initial=0.0)) / abs(self.size)
            apart = float(np.ptp(t[beside]))
        else:
            apart = self.run.differs(
                (peak.interval, peak.place),
                "t",
                peak.place,
                lambda rows: sign * rows[self.name].values < peak.height - 2.0 * rise * abs(self.size),
            )
        part = (sign * peak.height - self.initial) / self.size
        return (part, max(rise, bend)), (peak.place, apart)

    def _timed(self, way: float, part: float, doubt: float, *, first: bool) -> tuple[float, float]:
        """Return where ``way (z - part)`` becomes positive, see ``_crossing``, and the error of that instant [s].

        Where it may come to none at all, the error is the length of the run.
        """
        t, apart = self._crossing(way, part, first=first)
        if np.isnan(t):
            return t, 0.0
        moved = [self._crossing(way, part + by, first=first)[0] for by in (-doubt, doubt)]
        off = float(np.abs(np.array(moved) - t).max())
        return t, self.end - self.begin if np.isnan(off) else off + apart

    def _crossing(self, way: float, part: float, *, first: bool) -> tuple[float, float]:
        """Return where ``way (z - part)`` becomes positive, for the first or for the last time [s]; NaN where never.

        With the distance of the rows where nothing is known between them.
        """
        level = self.initial + part * self.size
        owners, t, gaps = self._looked_at(level)
        positive = way * np.sign(self.size) * gaps >= 0.0
        if positive.all() or (first and positive[0]):
            return self.begin, 0.0
        rising = np.flatnonzero(positive[1:] & ~positive[:-1])
        if not len(rising) or (not first and not positive[-1]):
            return float("nan"), 0.0
        k = int(rising[0 if first else -1])
        low, high = float(t[k]), float(t[k + 1])
        if owners[k] != owners[k + 1]:
            return high, high - low
        return (float(roots(self.curve, int(owners[k]), t[[k]], t[[k + 1]], level)[0]) if gaps[k + 1] else high), 0.0

    def _looked_at(self, level: float) -> tuple[Indices, Array, Array]:
        """Return intervals, and instants in them between which y has a value once at most, and ``y - level`` there."""
        owners, instants, gaps = list[Indices](), list[Array](), list[Array]()
        for k, (start, end, _) in enumerate(self.run.intervals):
            if end > self.begin or start == end == self.begin:
                places = distinct(np.append(self.run.looked_at(self.name, k), max(start, self.begin)))
                t, of = looked_at(self.curve, k, places[places >= self.begin], level)
                owners.append(np.full(len(t), k))
                instants.append(t)
                gaps.append(of)
        return np.concatenate(owners), np.concatenate(instants), np.concatenate(gaps)

    def remarks(self, asked: Response, values: Mapping[str, float]) -> list[str]:
        """Return remarks on the numbers: resolution of the rows, assumed final value, unfinished response."""
        remarks = []
        if self.run.motion is None:
            apart = float(np.diff(self.run.run.grid.t).max(initial=0.0))
            known = f"times and the peak are those of rows, at most {apart:.3g} s apart"
            remarks.append(f"nothing is known between the rows: {known}")
        if asked.final is None:
            remarks.append("the final value is that at the end of the run")
        if np.isnan(values["settling_time"]):
            remarks.append(f"it has not settled to {100.0 * asked.band:g} % at the end of the run")
        if np.isnan(values["rise_time"]):
            remarks.append("it does not reach 90 % of the step")
        if values["peak_time"] == self.end - self.begin and values["overshoot"] > PLATEAU:
            remarks.append(
                "it is farthest beyond its final value at the end of the run, and may go on: overshoot, peak "
                "and settling time are those of the run so far"
            )
        return remarks
