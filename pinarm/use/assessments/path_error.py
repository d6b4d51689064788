"""Error of a path: how far a point passes from points that it is to meet, one after the other.

With p(t) the path of the point over the run and w_i the wanted points, in their order, instants ``t_1 < t_2 < ...`` are
sought with the least ``Σ |p(t_i) - w_i|²``: first among samples by dynamic programming, then to rounding by Newton's
steps on ``(p - w_i) . p' = 0``. Where the instants are prescribed (``times``) there is nothing to seek. The errors are

    e_i = |p(t_i) - w_i|,    rms = (Σ e_i² / n)^(1/2),    peak = max e_i,    sum_of_squares = Σ e_i².

A run stays on the branch on which it was assembled, and ends with an error where it cannot, so that all points are met
on one branch. If two wanted points are nearest to one instant, the path does not meet them in their order: that is
refused.

Source: Norton, Design of Machinery, sections 3.6 and 5.10 (coupler curves; order and branch defects).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, Location, PinarmError, within
from pinarm.input.csv_tables import split_heading, table
from pinarm.input.numbers import decimal
from pinarm.input.roots import contained_file, root_of
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import InputStruct, Position, Time, current_folder
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Cell, Curve, Graph, Section, SectionTable

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

AXES = ("x", "y", "z")

MOST = 10_000
"""Points of a path at most."""


def read_points(wanted: Mapping[str, Sequence[float]] | str) -> tuple[list[str], Array]:
    """Return the axes of the points, and their coordinates [m], shape (n, axes).

    Args:
        wanted: Coordinates by axis [m], or a CSV file with the columns ``x [mm]`` and so on.

    Raises:
        InputError: An axis is unknown, lists have different lengths, or the file is no table of points; located.
    """
    columns = _columns(wanted) if isinstance(wanted, str) else {name: list(map(float, x)) for name, x in wanted.items()}
    for name in columns:
        if name not in AXES:
            with within(name):
                raise InputError(f"'{name}' is no axis", expected="x, y or z")
    lengths = {name: len(values) for name, values in columns.items()}
    if not columns or len(set(lengths.values())) > 1:
        counts = ", ".join(f"{count} of {name}" for name, count in lengths.items()) or "none"
        raise InputError(
            f"points need as many coordinates along every axis, and there are {counts}",
            expected="such as {x: [20 mm, 25 mm], y: [0 mm, 5 mm]}",
        )
    axes = [axis for axis in AXES if axis in columns]
    return axes, np.array([columns[axis] for axis in axes]).T


def _columns(name: str) -> dict[str, list[float]]:
    """Return the columns of a CSV file of points [m]."""
    folder = current_folder() or Path(name).absolute().parent
    path = contained_file((folder / name).absolute(), root_of(folder))
    heads, below = table(path, path.name)
    lines = list(below)
    if not 1 <= len(lines) <= MOST:
        raise InputError(f"the file {path.name} has {len(lines)} points", expected=f"1 to {MOST}")
    columns: dict[str, list[float]] = {}
    for place, cell in enumerate(heads):
        heading = split_heading(cell)
        axis, written = heading or (cell, None)
        if axis in AXES:
            factor = _factor(axis, written, Location(path.name, 1, 1, cell))
            columns[axis] = [factor * _number(row, place, Location(path.name, line)) for line, row in lines]
    if not columns:
        raise InputError(f"the file {path.name} has no column of points", expected="headings such as x [mm], y [mm]")
    return columns


def _factor(axis: str, written: str | None, place: Location) -> float:
    try:
        measured = unit(written or "")
    except PinarmError as error:
        raise error.at(place) from None
    if written is None or measured.dimension != unit("m").dimension:
        raise InputError(f"the column '{axis}' has no unit of a length", expected=f"{axis} [mm]").at(place)
    return measured.factor


def _number(row: Sequence[str], place: int, line: Location) -> float:
    cell = row[place] if place < len(row) else ""
    try:
        value = decimal(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"'{cell[:40]}' is no number", expected="a coordinate in every column").at(line)
    return value


METRE, SECOND, SQUARE = unit("m"), unit("s"), unit("m^2")
UNITS = {"rms": METRE, "peak": METRE, "sum_of_squares": SQUARE}

SAMPLES, FEW = 1440, 16
"""Instants at which the path is looked at, spread over its intervals by their lengths: a quarter of a degree of a turn;
and the least in each interval."""

STEPS, SETTLED = 30, 1e-9
"""Newton's steps from a sample, at most, and one, relative to the spacing of samples, that is the last: each doubles
the digits, and three are enough but where the path turns sharply or is near rest."""

AROUND = np.concatenate([-(2.0 ** -np.arange(16.0)), 2.0 ** -np.arange(16.0)])
"""Instants about a nearest one, in spacings of samples, at none of which the path should be nearer."""

PARABOLA = 2
"""Newton's steps on the parabola through three samples."""

ONE_INSTANT = 1e-9
"""Difference of instants, relative to the length of the run, below which they are one."""

ONE_PLACE, ROUNDING = 1e-12, 1e-14
"""Distance, relative to the size of the path, below which samples are at one place; and difference of errors that is
rounding."""

PLACE = 4e-15
"""Rounding of a place, relative to the farthest coordinate of the path."""

AGAIN = 3
"""Samples of the begin of a closed path that come again at its end: it begins one before that nearest to the first
point, to which the last point may be as near, and two samples are at a cut."""


class PathError(InputStruct, frozen=True):
    """How far a point passes from wanted points.

    Attributes:
        point: A link, or a point of it, whose origin is meant.
        wanted: Coordinates of the points in their order, by axis of the world: ``{x: [20 mm, 20 mm], y: [0, 5 mm]}``;
            or a CSV file with the columns ``x [mm]`` and so on. Axes that are left out do not count.
        times: At which instants the points are to be met, such as ``[0 s, 0.5 s, 1 s]``; the best ones in their order
            where they are left out.
    """

    point: str
    wanted: dict[str, Annotated[list[Position], msgspec.Meta(min_length=1, max_length=MOST)]] | str
    times: list[Time] | None = None

    def check(self) -> None:
        """Read the points, so that their mistakes are located in the file."""
        with within("wanted"):
            axes, points = read_points(self.wanted)
        if isinstance(self.wanted, str):
            msgspec.structs.force_setattr(self, "wanted", dict(zip(axes, points.T.tolist(), strict=True)))
        if self.times is not None:
            with within("times"):
                if len(self.times) != len(points):
                    raise InputError(f"there are {len(self.times)} times for {len(points)} points", expected="as many")

    def quantities(self, kind: str) -> list[str]:
        """Return the names of the point's coordinates, or of their rates, along the wanted axes."""
        axes, _ = read_points(self.wanted)
        return [f"point.{self.point}.{kind}.{axis}" for axis in axes]

    def requested(self, mechanism: Mechanism) -> list[str]:
        return [name for kind in ("position", "velocity", "acceleration") for name in self.quantities(kind)]

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        return UNITS

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        with within("point"):
            _ = [quantities[name] for name in self.quantities("position")]

    def evaluate(self, result: Result) -> Section:
        """Return the errors at all points: see ``Assessment``.

        Raises:
            InputError: The run is no motion in time, or it does not meet the points in their order.
        """
        run = result.lookup
        if run.motion is None or run.run.parameter != "t":
            raise InputError(
                "a path is followed by a motion in time", expected="a problem of kind kinematics, inverse or forward"
            )
        axes, wanted = read_points(self.wanted)
        path = _Path.of(run, self, wanted)
        met = path.met() if self.times is None else path.at_times(np.array([float(time) for time in self.times]))
        errors = np.linalg.norm(met.places - wanted, axis=1)
        squares, left = float(errors @ errors), met.left
        known = {
            "rms": float(np.linalg.norm(left)) / len(left) ** 0.5,
            "peak": float(left.max()),
            "sum_of_squares": float(2.0 * errors @ left + left @ left),
        }
        values = {"rms": (squares / len(errors)) ** 0.5, "peak": float(errors.max()), "sum_of_squares": squares}
        numbers = {name: Series(name, UNITS[name], np.array([value])) for name, value in values.items()}
        rows: list[tuple[Cell, ...]] = [
            (str(k), t, *w, *p, e)
            for k, (t, w, p, e) in enumerate(
                zip(met.t.tolist(), wanted.tolist(), met.places.tolist(), errors.tolist(), strict=True), start=1
            )
        ]
        columns = ("point", "met at", *(f"wanted {axis}" for axis in axes), *axes, "error")
        table = SectionTable("points", "Wanted points, and where the path passes them", columns,
                             (None, SECOND, *(METRE,) * (2 * len(axes) + 1)), rows)  # fmt: skip
        how = "in their order, at the best instants" if self.times is None else "at the prescribed instants"
        remarks = [
            f"error: rms {values['rms']:.6g} m, peak {values['peak']:.6g} m, {len(errors)} points, met {how}",
            f"distances are known to {known['peak']:.1e} m beside the error of the motion",
        ]
        return Section("path_error", f"Error of the path of {self.point}", [table], numbers, remarks,
                       _graphs(axes, path, wanted), known)  # fmt: skip


@dataclass(frozen=True)
class _Met:
    """Where a path meets points.

    Attributes:
        t: Instants, shape (n,).
        places: Places there [m], shape (n, axes).
        left: By how much their distances from the points may be wrong [m], shape (n,).
    """

    t: Array
    places: Array
    left: Array


@dataclass(frozen=True)
class _Path:
    """A path and the points that it is to meet.

    Attributes:
        run: The run.
        names: Quantities of the places, velocities and accelerations.
        wanted: The points [m], shape (n, axes).
        interval: Number of the interval of every sample, shape (samples,).
        t: Instants of the samples, shape (samples,).
        places: Places there [m], shape (samples, axes).
    """

    run: Lookup
    names: tuple[list[str], list[str], list[str]]
    wanted: Array
    interval: Array
    t: Array
    places: Array

    @classmethod
    def of(cls, run: Lookup, asked: PathError, wanted: Array) -> _Path:
        names = asked.quantities("position"), asked.quantities("velocity"), asked.quantities("acceleration")
        whole = run.run.grid.cuts[-1] - run.run.grid.cuts[0]
        interval, t, places = list[Array](), list[Array](), list[Array]()
        for number, (start, end, _) in enumerate(run.intervals):
            if end > start:
                at = np.linspace(start, end, FEW + round(SAMPLES * (end - start) / whole))
                interval.append(np.full(len(at), number))
                t.append(at)
                places.append(_stacked(run.quantities_at(number, at), names[0]))
        if not t:
            raise InputError("the run has no length: there is no path")
        return cls(run, names, wanted, np.concatenate(interval), np.concatenate(t), np.concatenate(places))

    def met(self) -> _Met:
        """Return the best instants in the order of the points.

        Raises:
            InputError: Two points are best met at one instant, or one after the other only in the other order.
        """
        t, places = self._refined(self._ordered())
        behind = np.roll(np.arange(len(t)), -1)
        others = np.linalg.norm(self.wanted[behind] - self.wanted, axis=1) > ONE_INSTANT
        length = self.run.run.grid.cuts[-1] - self.run.run.grid.cuts[0]
        ahead, instant = t[behind] - t, ONE_INSTANT * length
        if self._closed:
            ahead = (ahead + instant) % length - instant  # over the end, too
        else:
            others[-1] = False  # the first point does not come again
        wrong = others & (ahead <= instant)
        if self._closed and ahead.sum() > 1.5 * length:  # twice along the path, or more often
            wrong |= ahead == ahead.max()
        if wrong.any():
            k = int(wrong.argmax())
            raise InputError(
                f"the path does not meet the points {k + 1} and {behind[k] + 1} one after the other: both are nearest "
                f"to it at t = {t[k]:.6g} s",
                hint="another order of the points, other lengths, or a longer run",
            )
        return _Met(t, places, self._left(t, places))

    def _left(self, t: Array, places: Array) -> Array:
        """Return by how much the path may be nearer to the points about instants than at these [m], shape (n,).

        Nothing but rounding where Newton's steps have led to the nearest place; where they have not, as at rest, it is
        nearer at other instants, and may be nearer between these.
        """
        distances = np.linalg.norm(places - self.wanted, axis=1)
        left = np.full(len(t), ROUNDING * self._size + PLACE * float(np.abs(self.places).max()))
        for number, (start, end, _) in enumerate(self.run.intervals):
            here = np.flatnonzero((t >= start) & (t <= end))
            if start < end and len(here):
                spacing = np.diff(self.t[self.interval == number]).max()
                near = np.clip(t[here, None] + spacing * AROUND, start, end)
                at = self._states(number, near.ravel())[0].reshape(*near.shape, -1)
                around = np.linalg.norm(at - self.wanted[here, None], axis=2)
                nearer = distances[here] - around.min(axis=1)
                left[here] += np.where(nearer > left[here], 2.0 * nearer, 0.0)
        return left

    @cached_property
    def _size(self) -> float:
        return float(np.ptp(self.places, axis=0).max())

    @cached_property
    def _closed(self) -> bool:
        """Whether the path ends where it begins."""
        return float(np.linalg.norm(self.places[-1] - self.places[0])) <= 1e-6 * self._size

    def _ordered(self) -> Array:
        """Return the samples nearest to the points in their order, shape (n,).

        A path that closes may begin anywhere: every sample at which it is locally nearest to the first point is tried
        as its begin, and comes again at its end.
        """
        squares = self._squares()
        count = squares.shape[1]
        begins = [0, *(_local_minima(squares[0]) if self._closed else ())]
        along = np.arange(count + (AGAIN if self._closed else 0))
        choices = [(*_monotone(squares[:, (begin + along) % count]), begin) for begin in begins]
        _, rows, begin = min(choices, key=lambda choice: choice[0])
        return np.asarray((rows + begin) % count)

    def _squares(self) -> Array:
        """Return the squares of the distances of the points to the path about every sample [m²], shape (n, samples).

        About a sample that is nearer than both beside it the path is the parabola through all three: the distances of
        samples alone do not tell which of two passes of the path is the nearer one.
        """
        squares: Array = ((self.places - self.wanted[:, None, :]) ** 2).sum(axis=2)
        within = self.interval[2:] == self.interval[:-2]
        low = (squares[:, 1:-1] <= squares[:, :-2]) & (squares[:, 1:-1] <= squares[:, 2:]) & within
        points, rows = low.nonzero()
        before, middle, after = (self.places[rows + shift] for shift in range(3))
        off, slope, bend = middle - self.wanted[points], 0.5 * (after - before), after - 2.0 * middle + before
        s = np.zeros((len(rows), 1))
        for _ in range(PARABOLA):
            away, rate = off + s * (slope + 0.5 * s * bend), slope + s * bend
            rise = (rate * rate + away * bend).sum(axis=1, keepdims=True)
            step = (away * rate).sum(axis=1, keepdims=True) / np.where(rise > 0.0, rise, np.inf)
            s = np.clip(s - step, -1.0, 1.0)
        nearest = ((off + s * (slope + 0.5 * s * bend)) ** 2).sum(axis=1)
        squares[points, rows + 1] = np.minimum(squares[points, rows + 1], nearest)
        return squares

    def _refined(self, rows: Array) -> tuple[Array, Array]:
        """Return the instants near samples, shape (n,), at which the path is nearest, and its places there.

        They are sought from each sample and from those before and behind it: the nearest place may be behind the end of
        an interval, and at rest Newton's steps lead nowhere.
        """
        candidates = [(self.t[rows], self.places[rows])]
        candidates += [self._nearest(starts) for starts in (rows, self._apart(rows, -1), self._apart(rows, 1))]
        t, places = (np.stack(parts) for parts in zip(*candidates, strict=True))
        errors = np.linalg.norm(places - self.wanted, axis=2)
        best = (errors <= errors.min(axis=0) + ROUNDING * self._size).argmax(axis=0), np.arange(len(rows))
        return t[best], places[best]

    def _apart(self, rows: Array, way: int) -> Array:
        """Return the next samples before (way -1) or behind (1) some that are at another place, else these."""
        rows, back = np.unique(rows, return_inverse=True)
        count = len(self.t)
        next_ones = rows[:, None] + way * np.arange(1, count)
        far = np.linalg.norm(self.places[next_ones % count] - self.places[rows][:, None], axis=2)
        apart = (far > ONE_PLACE * self._size) & (self._closed | ((next_ones >= 0) & (next_ones < count)))
        return np.where(apart.any(axis=1), rows + way * (1 + apart.argmax(axis=1)), rows)[back] % count

    def _nearest(self, rows: Array) -> tuple[Array, Array]:
        """Return the instants near samples, within their intervals, at which the path is nearest, and its places."""
        t, places = self.t[rows].copy(), self.places[rows].copy()
        for number in np.unique(self.interval[rows]).tolist():
            here = np.flatnonzero(self.interval[rows] == number)
            start, end, _ = self.run.intervals[number]
            spacing = np.diff(self.t[self.interval == number]).max()
            low, high = np.maximum(t[here] - spacing, start), np.minimum(t[here] + spacing, end)
            for _ in range(STEPS):
                p, v, a = self._states(number, t[here])
                off = p - self.wanted[here]
                slope, bend = (off * v).sum(axis=1), (v * v).sum(axis=1) + (off * a).sum(axis=1)
                step = np.where(bend > 0.0, -slope / np.where(bend > 0.0, bend, 1.0), 0.0)
                before, t[here] = t[here], np.clip(t[here] + step, low, high)
                if np.abs(t[here] - before).max() <= SETTLED * spacing:
                    break
            places[here] = self._states(number, t[here])[0]
        return t, places

    def _states(self, number: int, t: Array) -> tuple[Array, Array, Array]:
        """Return places, velocities and accelerations at instants of an interval, each of shape (n, axes)."""
        order = t.argsort()
        rows = self.run.quantities_at(number, t[order])
        back = order.argsort()
        place, velocity, acceleration = (_stacked(rows, names)[back] for names in self.names)
        return place, velocity, acceleration

    def at_times(self, times: Array) -> _Met:
        """Return where the path is at prescribed instants.

        Raises:
            InputError: One is not in the run, or the path jumps there.
        """
        with within("times"):
            rows = [self.run.at({"t": f"{time!r} s"}, self.names[0][0]) for time in times.tolist()]
        places = np.concatenate([_stacked(row, self.names[0]) for row in rows])
        return _Met(times, places, np.full(len(times), PLACE * float(np.abs(self.places).max())))


def _stacked(rows: Quantities, names: list[str]) -> Array:
    return np.stack([rows[name].values for name in names], axis=1)


def _local_minima(values: Array) -> list[int]:
    """Return where values that close are not above their neighbours, a little before each."""
    low = (values <= np.roll(values, 1)) & (values <= np.roll(values, -1))
    return [(int(k) - 1) % len(values) for k in np.flatnonzero(low)]


def _monotone(squares: Array) -> tuple[float, Array]:
    """Return the least sum of one entry of every row, their columns not descending, and the columns.

    Args:
        squares: Shape (n, samples).
    """
    total, choices = squares[0], []
    for row in squares[1:]:
        least = np.minimum.accumulate(total)
        changed = np.concatenate([[True], least[1:] < least[:-1]])
        choices.append(np.maximum.accumulate(np.where(changed, np.arange(len(row)), 0)))
        total = least + row
    columns = [int(total.argmin())]
    for choice in reversed(choices):
        columns.append(int(choice[columns[-1]]))
    return float(total.min()), np.array(columns[::-1])


def _graphs(axes: list[str], path: _Path, wanted: Array) -> list[Graph]:
    """Return the path and the points in the plane of the two wanted axes along which the points spread most."""
    if len(axes) < 2:
        return []
    spread = np.ptp(np.concatenate([path.places, wanted]), axis=0)
    across, up = sorted(np.argsort(spread)[-2:].tolist())

    def curve(places: Array, label: str, *, points: bool) -> Curve:
        x, y = (Series(axes[k], METRE, places[:, k]) for k in (across, up))
        return Curve(x, y, label, points)

    curves = [curve(path.places, "path", points=False), curve(wanted, "wanted", points=True)]
    return [Graph("path", "Path, and the points wanted", curves, equal=True)]
