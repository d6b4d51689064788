"""Error of a path: how far a point passes from points that it is to meet, one after the other.

With p(t) the path of the point over the run and w_i the wanted points, in their order, instants ``t_1 < t_2 < ...`` are
sought with the least ``Σ |p(t_i) - w_i|²``: first among chords between samples by dynamic programming, then to rounding
by the zeros of ``(p - w_i) . p'``. Where the instants are prescribed (``times``) there is nothing to seek. The errors
are

    e_i = |p(t_i) - w_i|,    rms = (Σ e_i² / n)^(1/2),    peak = max e_i,    sum_of_squares = Σ e_i².

A run stays on the branch on which it was assembled, and ends with an error where it cannot, so that all points are met
on one branch. If two wanted points are nearest to one instant, the path does not meet them in their order: that is
refused.

Source: Norton, Design of Machinery, sections 3.6 and 5.10 (coupler curves; order and branch defects).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, within
from pinarm.input.csv_tables import measured_columns
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import InputStruct, Position, Time, named_file
from pinarm.records import Record
from pinarm.use.result.curve_figures import CurveFigure
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Cell, Curve, Graph, Section, SectionTable, numbered

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

AXES = ("x", "y", "z")

MOST = 10_000
"""Points of a path at most."""


def read_points(wanted: Mapping[str, Sequence[float]] | str) -> tuple[list[str], Array]:
    """Return the axes of the points, and their coordinates [m], shape (n, axes).

    Args:
        wanted: Coordinates by axis [m], or a CSV file with the columns ``x [mm]`` and so on.
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
    path = named_file(name)
    points = measured_columns(path, dict.fromkeys(AXES, "mm"))
    if max(map(len, points.values())) > MOST:
        raise InputError(f"the file {path.name} has too many points", expected=f"1 to {MOST}")
    return points


METRE, SECOND, SQUARE = unit("m"), unit("s"), unit("m^2")
UNITS = {"rms": METRE, "peak": METRE, "sum_of_squares": SQUARE}

SAMPLES, FEW = 1440, 16
"""Instants at which the path is looked at, spread over its intervals by their lengths: a quarter of a degree of a turn;
and the least in each interval."""

AROUND = np.concatenate([-(2.0 ** -np.arange(16.0)), 2.0 ** -np.arange(16.0)])
"""Instants about a nearest one, in spacings of samples, at none of which the path should be nearer."""

ONE_INSTANT = 1e-9
"""Difference of instants, relative to the length of the run, below which they are one."""

ROUNDING = 1e-14
"""Difference of distances, relative to the size of the path, that is rounding."""

AGAIN = 3
"""Chords of the begin of a closed path that come again at its end: it begins one before that nearest to the first
point, to which the last point may be as near, and two are at a cut."""


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
        with within("wanted"):
            axes, points = read_points(self.wanted)
        if isinstance(self.wanted, str):
            msgspec.structs.force_setattr(self, "wanted", dict(zip(axes, points.T.tolist(), strict=True)))
        if self.times is not None:
            with within("times"):
                if len(self.times) != len(points):
                    raise InputError(f"there are {len(self.times)} times for {len(points)} points", expected="as many")

    def quantities(self, kind: str) -> list[str]:
        axes, _ = read_points(self.wanted)
        return [f"point.{self.point}.{kind}.{axis}" for axis in axes]

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        return UNITS

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        with within("point"):
            _ = [quantities[name] for name in self.quantities("position")]

    def evaluate(self, result: Result) -> Section:
        """Return the errors at all points: see ``Assessment``."""
        run = result.lookup
        if run.motion is None or run.run.parameter != "t":
            raise InputError(
                "a path is followed by a motion in time", expected="a problem of kind kinematics, inverse or forward"
            )
        axes, wanted = read_points(self.wanted)
        path = _Path.of(run, (self.quantities("position"), self.quantities("velocity")), wanted)
        t = path.met() if self.times is None else np.array([float(time) for time in self.times])
        places = path.refined[1] if self.times is None else path.at_times(t)
        errors, left = np.linalg.norm(places - wanted, axis=1), path.left(t, places, self.times is not None)
        squares = float(errors @ errors)
        rms, peak = (squares / len(errors)) ** 0.5, float(errors.max())
        numbers = {
            "rms": CurveFigure(rms, float(np.linalg.norm(left)) / len(left) ** 0.5, METRE),
            "peak": CurveFigure(peak, float(left.max()), METRE),
            "sum_of_squares": CurveFigure(squares, float(2.0 * errors @ left + left @ left), SQUARE),
        }
        lines = zip(t.tolist(), wanted.tolist(), places.tolist(), errors.tolist(), strict=True)
        rows: list[tuple[Cell, ...]] = [(str(k), time, *w, *p, e) for k, (time, w, p, e) in enumerate(lines, start=1)]
        columns = ("point", "met at", *(f"wanted {axis}" for axis in axes), *axes, "error")
        units = (None, SECOND, *(METRE,) * (2 * len(axes) + 1))
        table = SectionTable("points", "Wanted points, and where the path passes them", columns, units, rows)
        how = "in their order, at the best instants" if self.times is None else "at the prescribed instants"
        remarks = [
            f"error: rms {rms:.6g} m, peak {peak:.6g} m, {len(errors)} points, met {how}",
            f"distances are known to {numbers['peak'].error:.1e} m beside the error of the motion",
        ]
        graphs, title = _graphs(axes, path, wanted), f"Error of the path of {self.point}"
        return Section("path_error", title, [table], remarks=remarks, graphs=graphs, **numbered(numbers))


class _Path(Record, frozen=True):
    """A path and the points that it is to meet.

    Attributes:
        run: The run.
        names: Quantities of the places and velocities.
        wanted: The points [m], shape (n, axes).
        interval: Number of the interval of every sample, shape (samples,).
        t: Instants of the samples, shape (samples,).
        places: Places there [m], shape (samples, axes).
    """

    run: Lookup
    names: tuple[list[str], list[str]]
    wanted: Array
    interval: Indices
    t: Array
    places: Array

    @classmethod
    def of(cls, run: Lookup, names: tuple[list[str], list[str]], wanted: Array) -> _Path:
        whole = run.run.grid.cuts[-1] - run.run.grid.cuts[0]
        spots = [
            (number, np.linspace(start, end, FEW + round(SAMPLES * (end - start) / whole)))
            for number, (start, end, _) in enumerate(run.intervals)
            if end > start
        ]
        if not spots:
            raise InputError("the run has no length: there is no path")
        places = np.concatenate(run.heights(lambda rows: _stacked(rows, names[0]), spots))
        interval = np.repeat([number for number, _ in spots], [len(t) for _, t in spots])
        return cls(run, names, wanted, interval, np.concatenate([t for _, t in spots]), places)

    def met(self) -> Array:
        """Return the best instants in the order of the points, shape (n,)."""
        t = self.refined[0]
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
        return t

    @cached_property
    def _size(self) -> float:
        return float(np.ptp(self.places, axis=0).max())

    @cached_property
    def _closed(self) -> bool:
        """Whether the path ends where it begins."""
        return float(np.linalg.norm(self.places[-1] - self.places[0])) <= 1e-6 * self._size

    @cached_property
    def _chords(self) -> Indices:
        """The samples at which chords begin that end at the next sample, shape (chords,)."""
        return np.flatnonzero(self.interval[1:] == self.interval[:-1])

    def _ordered(self) -> Indices:
        """Return the chords nearest to the points in their order, shape (n,).

        A path that closes may begin anywhere: every chord that is locally nearest to the first point is tried as its
        begin, and comes again at its end.
        """
        squares = self._squares()
        count = squares.shape[1]
        begins = [0, *(_local_minima(squares[0]) if self._closed else ())]
        along = np.arange(count + (AGAIN if self._closed else 0))
        choices = [(*_monotone(squares[:, (begin + along) % count]), begin) for begin in begins]
        _, chords, begin = min(choices, key=lambda choice: choice[0])
        return np.asarray((chords + begin) % count)

    def _squares(self) -> Array:
        """Return the squares of the distances of the points from the chords [m²], shape (n, chords)."""
        low, way = self.places[self._chords], self.places[self._chords + 1] - self.places[self._chords]
        length, off = (way**2).sum(axis=1), self.wanted[:, None] - low
        share = np.clip((off * way).sum(axis=2) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        return np.asarray(((off - share[..., None] * way) ** 2).sum(axis=2))

    @cached_property
    def refined(self) -> tuple[Array, Array]:
        from scipy.optimize.elementwise import find_root

        count, shifts = len(self._chords), np.array([[0], [-1], [1]])
        chords = self._ordered() + shifts
        sample = self._chords[chords % count if self._closed else np.clip(chords, 0, count - 1)].ravel()
        point = np.tile(np.arange(len(self.wanted)), len(shifts))

        def slope(t: Array, at: Array) -> Array:
            p, v = self._states(self.interval[sample[at.astype(int)]], t)
            return np.asarray(((p - self.wanted[point[at.astype(int)]]) * v).sum(axis=1))

        low, high = self.t[sample], self.t[sample + 1]
        inside = find_root(slope, (low, high), args=(np.arange(len(sample)),)).x
        t = np.stack([np.where(np.isnan(inside), low, inside), low, high])
        places = np.stack([self._states(self.interval[sample], row)[0] for row in t])
        t, places = t.reshape(-1, len(self.wanted)), places.reshape(-1, *self.wanted.shape)
        errors = np.linalg.norm(places - self.wanted, axis=2)
        best = (errors <= errors.min(axis=0) + ROUNDING * self._size).argmax(axis=0), np.arange(len(self.wanted))
        return t[best], places[best]

    def _states(self, interval: Indices, t: Array) -> tuple[Array, Array]:
        """Return places and velocities at instants of intervals, each of shape (n, axes)."""
        spots = [(int(number), t[k : k + 1]) for k, number in enumerate(interval)]
        states = self.run.heights(lambda rows: _stacked(rows, [*self.names[0], *self.names[1]]), spots)
        place, velocity = np.split(np.concatenate(states), 2, axis=1)
        return place, velocity

    def left(self, t: Array, places: Array, prescribed: bool) -> Array:
        """Return by how much distances may be wrong: rounding, and how much nearer the path is about instants [m]."""
        left = np.full(len(t), ROUNDING * self._size + 4e-15 * float(np.abs(self.places).max()))
        for number, (start, end, _) in enumerate(self.run.intervals):
            here = np.flatnonzero((t >= start) & (t <= end))
            if start < end and len(here) and not prescribed:
                spacing = np.diff(self.t[self.interval == number]).max()
                near = np.clip(t[here, None] + spacing * AROUND, start, end)
                around = self._states(np.full(near.size, number), near.ravel())[0].reshape(*near.shape, -1)
                nearest = np.linalg.norm(around - self.wanted[here, None], axis=2).min(axis=1)
                nearer = np.linalg.norm(places[here] - self.wanted[here], axis=1) - nearest
                left[here] += np.where(nearer > left[here], 2.0 * nearer, 0.0)
        return left

    def at_times(self, times: Array) -> Array:
        """Return where the path is at prescribed instants."""
        with within("times"):
            rows = [self.run.at({"t": f"{time!r} s"}, self.names[0][0]) for time in times.tolist()]
        return np.concatenate([_stacked(row, self.names[0]) for row in rows])


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
