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
        """Return the mode values of each case from which measures of modes are computed.

        Raises:
            InputError: There is no such mode or measure.
        """
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
    scaled = shapes / _sizes(shapes)
    doubtful = []
    for case, before, further in _way(cases, np.asarray(np.isfinite(values).any(axis=1))):
        own = values[before, order[before]]
        expected = own if further is None else 2.0 * own - values[further, order[further]]
        expected = np.where(np.isnan(expected), own, expected)
        mac = _assurance(scaled[before, order[before]], scaled[case])
        order[case] = _matched(expected, values[case], mac)
        agreed = mac[np.arange(len(own)), order[case]]
        doubtful += [(branch + 1, before, case) for branch in np.flatnonzero(agreed < UNCERTAIN).tolist()]
    return order, _words(doubtful)


def _sizes(shapes: Complex) -> Array:
    """Return the typical size of each coordinate, in whose units shapes are compared, shape (nv,)."""
    known = np.abs(np.nan_to_num(shapes)).reshape(-1, shapes.shape[-1])
    sizes = np.sqrt((known**2).mean(axis=0))
    return np.where(sizes > 0.0, sizes, 1.0)


def _way(cases: Cases, known: Flags) -> Iterator[tuple[int, int, int | None]]:
    """Yield cases in the order of their values, each with the known case beside it, and the one beyond in that line."""
    shape = [len(axis) for axis in cases.axes]
    sorts = [
        np.argsort(column.as_array, kind="stable") if column.is_numeric else np.arange(len(axis))
        for axis in cases.axes
        for column in axis.columns
    ]
    numbers = np.arange(len(cases)).reshape(shape)[np.ix_(*sorts)]
    for place in np.ndindex(*shape):
        line = next((axis for axis in reversed(range(len(shape))) if place[axis]), None)
        if line is None or not known[case := int(numbers[place])]:
            continue
        behind = [int(numbers[(*place[:line], k, *place[line + 1 :])]) for k in reversed(range(place[line]))]
        near = [other for other in behind if known[other]][:2]
        if near:
            even = len(near) == 2 and behind[:2] == near and _is_even(cases, line, case, *near)
            yield case, near[0], near[1] if even else None


def _is_even(cases: Cases, line: int, *three: int) -> bool:
    """Return whether the values of three cases along an axis have equal distances: a straight line goes on then."""
    column = cases.axes[line].columns[0]
    inner = int(np.prod([len(axis) for axis in cases.axes[line + 1 :]]))
    if not column.is_numeric:
        return False
    last, middle, first = (float(column.as_array[case // inner % len(cases.axes[line])]) for case in three)
    return bool(np.isclose(last - middle, middle - first, rtol=1e-6))


def _assurance(x: Complex, y: Complex) -> Array:
    """Return the MAC of shapes, of modes first, shape (modes, modes); NaN of modes that a case does not have."""
    sizes = np.linalg.norm(x, axis=1)[:, None] * np.linalg.norm(y, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.abs(x.conj() @ y.T) ** 2 / sizes**2)


def _matched(expected: Complex, values: Complex, mac: Array) -> Indices:
    """Return the mode of each branch: the matches of the least cost."""
    from scipy.optimize import linear_sum_assignment

    size = np.abs(expected)[:, None] + np.abs(values) + np.finfo(float).tiny
    cost = 2.0 * np.abs(expected[:, None] - values) / size + 1.0 - mac
    _, chosen = linear_sum_assignment(np.where(np.isnan(cost), APART, cost))
    return np.asarray(chosen)


def _words(doubtful: Sequence[tuple[int, int, int]]) -> list[str]:
    if not doubtful:
        return []
    places = [f"mode {branch} from case {before} to {case}" for branch, before, case in doubtful[:NAMED]]
    more = f" and {len(doubtful) - NAMED} more" if len(doubtful) > NAMED else ""
    return [
        f"branches of modes may be mistaken where shapes change by much: {', '.join(places)}{more}; "
        "more cases there tell"
    ]
