"""Branches of modes through the cases of a sweep: matched by eigenvalue and shape, not by their rank in each case.

A mode is followed from the case beside it, whose eigenvalues are continued in a straight line where two are known. The
cost of a match is the relative distance of the eigenvalues plus ``1 - MAC``, with the modal assurance criterion
``MAC = |x^H y|^2 / (x^H x  y^H y)``; the matches of all modes together have the least cost.

Source: Allemang, The modal assurance criterion: twenty years of use and abuse, Sound and Vibration 37 (2003).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Complex, Flags, Indices
from pinarm.engine.linear.linearisation import mode_measures
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.input.units import DIMENSIONLESS
from pinarm.problems.linear import MODE_UNITS
from pinarm.use.cases.case import Taken
from pinarm.use.result.vibrations import mode_shapes
from pinarm.use.study.sweep.axes import Cases

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

MEASURE = re.compile(r"mode\.([0-9]+)\.(\w+)")
"""Measure of a mode, such as ``mode.1.frequency``."""

ALL, MEASURES = "modes", ("frequency", "damped_frequency", "damping", "growth")
"""Result that asks for all modes, and their measures."""

RAW = "mode number "
"""Beginning of the names of columns that are the material of branches."""

UNCERTAIN = 0.5
"""MAC of a match below which a branch may go on as another one."""

APART = 3.0
"""Cost of a match of a mode with none: more than any of two modes."""

NAMED = 3
"""Uncertain places that a note names."""


@dataclass(frozen=True)
class ModeValues(Taken):
    """Eigenvalues and shapes of all modes of a case, with NaN for those it does not have; see ``Taken``.

    Attributes:
        modes: Largest number of modes.
        velocities: Number of joint velocities.
        asked: Measures of modes that the sweep is to have, such as ``mode.1.damping``.
    """

    modes: int
    velocities: int
    asked: tuple[str, ...]

    @classmethod
    def of(cls, quantities: Quantities, asked: Sequence[str]) -> ModeValues:
        """Return the mode values of each case from which measures of modes are computed."""
        modes = sum(name.startswith("mode.") and name.endswith(".frequency") for name in quantities.names())
        names = [f"mode.{k}.{name}" for k in range(1, modes + 1) for name in MEASURES]
        chosen = [name for text in asked for name in (names if text == ALL else [text])]
        for name in chosen:
            quantities[name]
        return cls(modes, quantities.trajectory.mechanism.model.nv, tuple(dict.fromkeys(chosen)))

    @property
    def width(self) -> int:
        """Numbers of a mode: eigenvalue and error, and its shape."""
        return 3 + 2 * self.velocities

    def columns(self) -> list[Series]:
        """Return the columns of the numbers, still empty."""
        count = self.modes * self.width
        return [Series(f"{RAW}{k}", DIMENSIONLESS, np.zeros(0)) for k in range(count)]

    def numbers(self, result: Result) -> list[tuple[float, float]]:
        values = np.asarray(result.arrays["eigenvalues"].values[0], complex)[: self.modes]
        table = np.full((self.modes, self.width), np.nan)
        errors = [float(result[f"mode.{k}.error"].values[0]) for k in range(1, len(values) + 1)]
        shapes = np.ascontiguousarray(mode_shapes(result)[:, : len(values)].T).view(float)
        table[: len(values)] = np.column_stack([values.real, values.imag, errors, shapes])
        return [(float(number), 0.0) for number in table.ravel()]

    def followed(self, cases: Cases, columns: Sequence[Series]) -> tuple[list[Series], list[str]]:
        """Return the columns with those of branches in place of their material, and notes on the branches."""
        raw = [series for series in columns if series.name.startswith(RAW)]
        others = [series for series in columns if not series.name.startswith(RAW)]
        table = np.array([series.values for series in raw]).T.reshape(-1, self.modes, self.width)
        values, shapes = table[..., 0] + 1j * table[..., 1], table[..., 3::2] + 1j * table[..., 4::2]
        order, notes = _branches(cases, values, shapes)
        values = np.take_along_axis(values, order, axis=1)
        errors = np.take_along_axis(table[..., 2], order, axis=1)
        measures = [series for name in self.asked if (series := _measure(name, values, errors)) is not None]
        return [*measures, *others], notes


def _measure(name: str, values: Complex, errors: Array) -> Series | None:
    """Return a measure of a branch in all cases; ``None`` of a branch that no case has."""
    match = MEASURE.fullmatch(name)
    assert match is not None
    branch, measure = int(match[1]) - 1, match[2]
    if np.isnan(values[:, branch]).all():
        return None
    return Series(name, MODE_UNITS[measure], mode_measures(values[:, branch], errors[:, branch])[measure])


def _branches(cases: Cases, values: Complex, shapes: Complex) -> tuple[Indices, list[str]]:
    """Return the mode of each case on each branch, shape (cases, modes), and notes."""
    order = np.tile(np.arange(values.shape[1]), (len(values), 1))
    if any(axis.drawn or len(axis.columns) > 1 for axis in cases.axes):
        return order, ["modes are numbered by frequency in each case: cases in no order have no branches"]
    sizes = np.sqrt((np.abs(np.nan_to_num(shapes)) ** 2).mean(axis=(0, 1)))  # in which units differ
    scaled, doubtful = shapes / np.where(sizes > 0.0, sizes, 1.0), list[str]()
    for case, before, further, ratio in _way(cases, np.asarray(np.isfinite(values).any(axis=1))):
        known = values[before, order[before]]
        expected = known + ratio * (known - values[further, order[further]])
        mac = _assurance(scaled[before, order[before]], scaled[case])
        order[case] = _matched(np.where(np.isnan(expected), known, expected), values[case], mac)
        uncertain = np.flatnonzero(mac[np.arange(len(known)), order[case]] < UNCERTAIN)
        doubtful += [f"mode {branch + 1} from case {before} to {case}" for branch in uncertain.tolist()]
    if not doubtful:
        return order, []
    places = ", ".join(doubtful[:NAMED]) + (f" and {len(doubtful) - NAMED} more" if len(doubtful) > NAMED else "")
    said = f"branches of modes may be mistaken where shapes change by much: {places}; more cases there tell"
    return order, [said]


def _way(cases: Cases, known: Flags) -> Iterator[tuple[int, int, int, float]]:
    """Yield cases in the order of their values, each with the known case beside it and the one beyond in that line.

    The last number is the distance from the case beside, relative to that between both; 0 where there is no distance.
    """
    columns = [axis.columns[0] for axis in cases.axes]
    orders = [np.argsort(x.as_array, kind="stable") if x.is_numeric else np.arange(len(x.values)) for x in columns]
    numbers = np.arange(len(cases)).reshape([len(axis) for axis in cases.axes])[np.ix_(*orders)]
    for place in np.ndindex(*numbers.shape):
        line = max((axis for axis, k in enumerate(place) if k), default=0)
        row = numbers[(*place[:line], slice(place[line] + 1), *place[line + 1 :])]
        behind = [k for k in reversed(range(place[line])) if known[row[k]]]
        if not behind or not known[row[-1]]:
            continue
        near, far, ratio = behind[0], behind[min(1, len(behind) - 1)], 0.0
        if columns[line].is_numeric and far != near:
            x = columns[line].as_array[orders[line]]
            ratio = float((x[place[line]] - x[near]) / (x[near] - x[far])) if x[near] != x[far] else 0.0
        yield int(row[-1]), int(row[near]), int(row[far]), ratio


def _assurance(x: Complex, y: Complex) -> Array:
    """Return the MAC of shapes, of modes first, shape (modes, modes); NaN of modes that a case does not have."""
    sizes = np.linalg.norm(x, axis=1)[:, None] * np.linalg.norm(y, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.abs(x.conj() @ y.T) ** 2 / sizes**2)


def _matched(expected: Complex, values: Complex, mac: Array) -> Indices:
    from scipy.optimize import linear_sum_assignment

    size = np.abs(expected)[:, None] + np.abs(values) + np.finfo(float).tiny
    cost = 2.0 * np.abs(expected[:, None] - values) / size + 1.0 - mac
    _, chosen = linear_sum_assignment(np.where(np.isnan(cost), APART, cost))
    return np.asarray(chosen)
