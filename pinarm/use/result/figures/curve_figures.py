"""Figures of a curve: one number of a quantity x(s) over a whole run of length L, with the error of its quadrature.

    mean      1/L ∫ x ds
    rms       (1/L ∫ x² ds)^(1/2)
    integral  ∫ x ds, with ds < 0 where s falls
    peak      largest |x|
    p95       the value below which x is for 95 % of L; any percentage from p0 to p100

s is the parameter of the run: the time, or the coordinate that is swept. Integrals are taken of the motion itself, not
of the rows of the table, by adaptive Gauss-Kronrod quadrature on every interval between the breakpoints of laws: exact
but for rounding where x is a polynomial of degree 31 or less there. Parts of an interval in which the rows do not lie
on the polynomials through the points of the quadrature are bisected: what the rows see an integral does not miss.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array, distinct
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.records import ValueRecord
from pinarm.use.result.figures.percentile import SmoothCurve, percentile
from pinarm.use.result.figures.quadrature import NODES, AllowedErrors, KnownValues, Panels, integrate
from pinarm.use.result.formula_switches import MISPLACED
from pinarm.use.result.row_lookup import Lookup

RELATIVE, ABSOLUTE = 1e-10, 1e-13
"""Errors at which an integral is good enough, relative to itself and to the integral of the size of what is summed."""

PANELS, PER_STEP, ROWS = 600, 2, 4
"""Panels of 21 states that the integrals of a run may take in bisections, those for each of its intervals and each step
of its integrator, and how many rows bring a further one: a kink takes 70, and between two steps a motion is a
polynomial. The error that is left is told."""

MOST_CUTS = 50
"""Places at most in an interval at which a quantity is infinite."""

ROUNDING = 4e-16
"""Of a sum of a few hundred terms, relative to their sum."""

_PERCENTILE = re.compile(r"p([0-9]{1,3}(?:\.[0-9]{1,3})?)")


class CurveFigure(ValueRecord, frozen=True):
    """A figure of a curve.

    Attributes:
        value: The figure [SI].
        error: Estimate of what the quadrature leaves of it [SI]; the error of the motion itself is not in it.
        unit: Its unit; ``None`` where it is not known.
    """

    value: float
    error: float
    unit: Unit | None


def is_figure(name: str) -> bool:
    """Tell whether a name is that of a figure: one of ``FIGURES``, or a percentage such as ``p95``."""
    return name in FIGURES or _percentage(name) is not None


def figure(run: Lookup, quantity: str, name: str) -> CurveFigure:
    """Return a figure of a quantity over a run.

    Args:
        run: The run.
        quantity: A quantity, a symbol or a formula.
        name: A name of ``FIGURES``, or a percentage such as ``p95``.

    Raises:
        InputError: The rows are not states of one motion, or the quantity is not finite everywhere.
    """
    if run.motion is None and name != "peak":
        raise stands_alone(run.run, quantity, name)
    share = _percentage(name)
    values = run.quantities[quantity].values
    if np.isnan(values).any() or (share is not None and np.isinf(values).any()):
        raise InputError(f"{quantity} is not finite everywhere: it has no {name}")
    value, error = FIGURES[name](run, quantity) if share is None else _percentile(run, quantity, share)
    if not np.isfinite(error):
        raise _without_end(run, quantity, name)
    return CurveFigure(float(value), float(error), figure_unit(run.quantities, quantity, name))


def _without_end(run: Lookup, quantity: str, name: str) -> InputError:
    """Return that the integral of a quantity, or of its square, is infinite, and where."""
    try:
        run.extreme("largest", quantity)
    except InputError as why:
        return InputError(f"{quantity} has no {name}, as its integral has no end: {why.message}", expected=why.expected)
    return InputError(f"{quantity} has no {name}, as its integral has no end", expected="a quantity that is finite")


def stands_alone(rows: Trajectory, quantity: str, name: str) -> InputError:
    """Return that a figure of a quantity is asked of rows that are states of no motion."""
    return InputError(
        f"{quantity} @ {name} is taken over a motion, and these rows stand alone",
        expected="@ peak (the largest amount), @ max, @ min, or a place such as @ row=1", hint=made_a_motion(rows),
    )  # fmt: skip


def made_a_motion(rows: Trajectory) -> str:
    """Return what makes recorded rows a motion, as a hint; empty of others."""
    return f'{rows.remedy} (in Python derivatives="spline"), with the positions alone' if rows.remedy else ""


def figure_unit(quantities: Quantities, quantity: str, name: str) -> Unit | None:
    """Return the unit of a figure: that of the quantity, times that of the parameter for ``integral``."""
    unit = quantities[quantity].unit
    return unit * quantities.trajectory.unit if unit is not None and name == "integral" else unit


def _percentage(name: str) -> float | None:
    matched = _PERCENTILE.fullmatch(name)
    share = float(matched[1]) if matched else None
    return share if share is not None and share <= 100.0 else None


def _length(run: Lookup) -> float:
    return sum(abs(end - start) for start, end, _ in run.intervals)


def integrals(
    run: Lookup, integrand: Callable[[Quantities], Array], least: float = 1.0, of: Sequence[str] = ()
) -> tuple[Array, Array]:
    """Return the integrals of several functions over a run, and their errors, both of shape (k,).

    Args:
        run: The run; its rows are states of one motion.
        integrand: Quantities of n rows -> values of the functions there, of the size of 1 or less, shape (n, k).
        least: Size of functions that are not to be told from 0.
        of: The quantities of which they are functions, where these may be formulas.
    """
    switches = [run.switches(name) for name in of]
    parts, left = [], PANELS + PER_STEP * (len(run.intervals) + sum(map(len, run.steps))) + len(run.run) // ROWS
    rows = integrand(run.quantities)
    for interval, (start, end, own) in enumerate(run.intervals):
        low, high = sorted((start, end))
        if low < high:
            curve = _Counted(partial(_evaluated, run, integrand, interval), left // (len(run.intervals) - interval))
            allowed = curve.left
            cuts = distinct(np.concatenate([run.bounds(interval), *(each[interval] for each in switches)])).tolist()
            bounds = distinct(np.append(np.linspace(low, high, 1 + run.parts_of_each), cuts))
            known = _known(run, integrand, interval, rows[own], run.short_steps(interval, bounds), cuts)
            parts += _integrals_between(curve, [low, high], bounds, known, least)
            left -= allowed - curve.left
    total, error = (np.sum(each, axis=0) for each in zip(*parts, strict=True))
    sizes = np.max(np.abs(rows), axis=0, where=np.isfinite(rows), initial=0.0)
    misplaced = MISPLACED * sum(float(np.abs(t).sum()) for each in switches for t in each)
    return total, error + ROUNDING * np.abs(total) + misplaced * sizes


def _known(
    run: Lookup, integrand: Callable[[Quantities], Array], interval: int, rows: Array, ends: Array,
    cuts: Sequence[float],
) -> KnownValues:  # fmt: skip
    """Return the values of functions at the rows of an interval, shape (n, k), and at ends of steps, shape (m,)."""
    t, first = np.unique(np.append(run.run.grid.t[run.intervals[interval][2]], ends), return_index=True)
    values = np.concatenate([rows, integrand(run.quantities_at(interval, ends))]) if len(ends) else rows
    return KnownValues(t, values[first], cuts)


class _Unbounded(Exception):
    """A function is infinite at a place."""

    def __init__(self, place: float) -> None:
        self.place = place


class _Counted(Struct, eq=False):
    """Functions that are evaluated a limited number of times.

    Attributes:
        at: Points, shape (n,) -> values, shape (n, k).
        left: Number of panels that may still be evaluated in bisections; less than 0 where they were taken before.
    """

    at: Callable[[Array], Array]
    left: int

    def __call__(self, t: Array) -> Array:
        """Return the values at points of panels."""
        self.left -= len(t) // len(NODES)
        return self.at(t)


def _evaluated(run: Lookup, integrand: Callable[[Quantities], Array], interval: int, t: Array) -> Array:
    """Return functions at points of an interval, shape (n, k).

    Raises:
        _Unbounded: One is infinite at a point.
    """
    blocks = run.blocks(t)
    values = np.concatenate([integrand(run.quantities_at(interval, block)) for block in blocks])
    if not (finite := np.isfinite(values).all(axis=1)).all():
        raise _Unbounded(float(t[(~finite).argmax()]))
    return values


def _integrals_between(
    at: _Counted, cuts: list[float], bounds: Array, known: KnownValues, least: float
) -> list[tuple[Array, Array]]:
    """Return the integrals of functions of size 1 between cuts, and their errors; where one is infinite, it is cut.

    Args:
        at: The functions.
        cuts: Where they are cut, ascending.
        bounds: Between which there is at least one panel each, ascending.
        known: What is known of them: the rows.
        least: As in ``integrals``.

    Raises:
        InputError: There is no end of such places.
    """
    allowed = at.left
    try:
        return [
            _integral_between(
                at, np.array([low, *bounds[(bounds > low) & (bounds < high)], high]), len(cuts) - 1 - part, known, least
            )
            for part, (low, high) in enumerate(pairwise(cuts))
        ]
    except _Unbounded as found:
        if len(cuts) > MOST_CUTS or found.place in cuts:
            raise InputError(
                f"it is not finite about {found.place:.9g}", expected="a quantity that is finite"
            ) from None
        at.left = allowed
        return _integrals_between(at, sorted([*cuts, found.place]), bounds, known, least)


def _integral_between(at: _Counted, bounds: Array, parts: int, known: KnownValues, least: float) -> tuple[Array, Array]:
    """Return the integrals of functions of size 1, and their errors, both of shape (k,).

    A function is not integrated to less than its own rounding.

    Args:
        at: The functions.
        bounds: Where panels begin and end, ascending, shape (m + 1,).
        parts: How many integrals share the panels that are left.
        known: What is known of them: the rows.
        least: As in ``integrals``.
    """
    low, high = float(bounds[0]), float(bounds[-1])
    low_of, high_of, clusters = bounds[:-1], bounds[1:], low + (high - low) * NEIGHBOURS
    points = Panels.points(low_of, high_of)
    values = at(np.concatenate([points, clusters.ravel()]))
    first = Panels.of(low_of, high_of, values[: len(points)])
    rounding = _rounding(values[len(points) :].reshape(*clusters.shape, -1))
    return integrate(at, first, AllowedErrors(RELATIVE, ABSOLUTE, least, rounding), at.left // parts, known)


def _rounding(values: Array) -> Array:
    """Return the rounding of functions over an interval, shape (k,): what points next to each other differ by.

    Third differences d of a smooth function over steps of 1e-7 of the interval vanish; of independent errors with the
    deviation s they have the median ``d² = 0.455 · 20 s²``, in which a jump of the function at a cluster has no part.

    Args:
        values: Of the functions at ``NEIGHBOURS``, shape (5, 4, k).
    """
    differences = np.diff(values, 3, axis=1)[:, 0]
    middle = np.sort(differences**2, axis=0)[len(differences) // 2]  # np.median imports numpy.ma
    return np.asarray(np.sqrt(middle / 9.1))


NEIGHBOURS = np.add.outer((0.1127, 0.3819, 0.5, 0.7236, 0.9472), 1e-7 * np.arange(-1.5, 2.0))
"""Points whose differences are rounding, as parts of an interval: five clusters of four, shape (5, 4)."""


def _moments(run: Lookup, quantity: str) -> tuple[Array, Array, float]:
    """Return the integrals of x/c and (x/c)², their errors, both of shape (2,), and c, the largest |x| of the rows.

    That may be one beside a pole, and all else small.
    """
    rows = np.abs(run.quantities[quantity].values)
    scale = float(rows[np.isfinite(rows)].max(initial=0.0)) or 1.0

    def powers(rows: Quantities) -> Array:
        x = rows[quantity].values / scale
        return np.stack([x, x * x], axis=1)

    total, error = integrals(run, powers, least=0.0, of=[quantity]) if _length(run) else np.zeros((2, 2))
    return total, error, scale


def _mean(run: Lookup, quantity: str) -> tuple[float, float]:
    (first, _), (error, _), scale = _moments(run, quantity)
    length = _length(run)
    return (scale * first / length, scale * error / length) if length else _single(run, quantity)


def _rms(run: Lookup, quantity: str) -> tuple[float, float]:
    (_, second), (_, error), scale = _moments(run, quantity)
    length = _length(run)
    if not length:
        value, _ = _single(run, quantity)
        return abs(value), 0.0
    root = (second / length) ** 0.5
    return scale * root, scale * (0.5 * error / length / root if root else (error / length) ** 0.5)


def rms_values(run: Lookup, quantities: Sequence[str], scales: Array) -> tuple[Array, Array]:
    """Return the rms values of several quantities by one quadrature, and their errors, both of shape (k,).

    Args:
        run: The run; its rows are states of one motion.
        quantities: Names, k of them.
        scales: What matters in each [SI], shape (k,): components of a vector have its size, beside which one that is
            only rounding is 0, and needs no more points.
    """
    length, scales = _length(run), np.where(scales > 0.0, scales, 1.0)

    def squares(rows: Quantities) -> Array:
        return np.stack([(rows[name].values / scale) ** 2 for name, scale in zip(quantities, scales, strict=True)], 1)

    total, error = (part / length for part in integrals(run, squares, of=quantities))
    root = np.sqrt(np.maximum(total, 0.0))
    return scales * root, scales * np.where(root**2 > error, 0.5 * error / np.maximum(root, 1e-300), np.sqrt(error))


def _integral(run: Lookup, quantity: str) -> tuple[float, float]:
    (first, _), (error, _), scale = _moments(run, quantity)
    t = run.run.grid.t
    return scale * first * float(np.sign(t[-1] - t[0])), scale * error


def _peak(run: Lookup, quantity: str) -> tuple[float, float]:
    row, error = run.extreme("largest", quantity)
    return abs(float(row[quantity].values[0])), error


def _single(run: Lookup, quantity: str) -> tuple[float, float]:
    return float(run.quantities[quantity].values[0]), 0.0


def _percentile(run: Lookup, quantity: str, share: float) -> tuple[float, float]:
    """Return the value below which x is for a share of the run [%], and its error."""
    if not _length(run):
        return _single(run, quantity)
    curves = [_curve(run, quantity, interval) for interval, (start, end, _) in enumerate(run.intervals) if start != end]
    value, error = percentile(curves, share / 100.0)
    return value, error + ROUNDING * abs(value)


def _curve(run: Lookup, quantity: str, interval: int) -> SmoothCurve:
    """Return a quantity in one interval, with what its rows tell."""
    start, end, own = run.intervals[interval]
    order = 1 if start < end else -1
    t, values = run.run.grid.t[own][::order], run.quantities[quantity].values[own][::order]
    at = partial(_values, run, quantity, interval)
    bounds = distinct(np.append(run.bounds(interval), run.switches(quantity)[interval])).tolist()
    return SmoothCurve(min(start, end), max(start, end), at, bounds, t, values)


def _values(run: Lookup, quantity: str, interval: int, t: Array) -> Array:
    return run.quantities_at(interval, t)[quantity].values


FIGURES: dict[str, Callable[[Lookup, str], tuple[float, float]]] = {
    "mean": _mean,
    "rms": _rms,
    "integral": _integral,
    "peak": _peak,
}
"""Name -> function that returns the figure and the error of its quadrature [SI]. Percentages are figures too."""
