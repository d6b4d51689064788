"""Figures of a curve: one number of a quantity x(s) over a whole run of length L, with the error of its quadrature.

    mean      1/L ∫ x ds
    rms       (1/L ∫ x² ds)^(1/2)
    integral  ∫ x ds
    peak      largest |x|
    p95       the value below which x is for 95 % of L; any percentage from p0 to p100

s is the parameter of the run: the time, or the coordinate that is swept. Integrals are taken of the motion itself, not
of the rows of the table, by adaptive Gauss-Kronrod quadrature on every interval between the breakpoints of laws: exact
but for rounding where x is a polynomial of degree 31 or less there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.use.result.row_lookup import Lookup

RELATIVE, ABSOLUTE, MOST = 1e-10, 1e-13, 2000
"""Errors at which an integral is good enough, relative to itself and to the largest value times the length; and most
subdivisions of an interval, after which the error that is left is reported."""

FEW, NOISE = (16, 64), 1e-4
"""Subdivisions that are tried first; error, relative to the largest value times the length, below which one that more
of them do not halve is rounding of the quantity, not its shape."""

ROUNDING = 4e-16
"""Of a sum of a few hundred terms, relative to their sum."""

COARSEST, FINEST, SETTLED = 256, 2**15, 1e-7
"""Points of an interval for percentiles, at first and at most; change, relative to the range of x, at which doubling
their number ends."""

_PERCENTILE = re.compile(r"p([0-9]{1,3}(?:\.[0-9]{1,3})?)")


@dataclass(frozen=True)
class CurveFigure:
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
    if run.motion is None:
        raise InputError(
            f"{quantity} @ {name} is taken over a motion, and these rows stand alone",
            expected="@ max, @ min, @ largest, or a place such as @ row=1",
        )
    values = run.quantities[quantity].values
    if not np.isfinite(values).all():
        raise InputError(f"{quantity} is not finite everywhere: it has no {name}")
    share = _percentage(name)
    value, error = FIGURES[name](run, quantity) if share is None else _percentile(run, quantity, share)
    return CurveFigure(float(value), float(error), figure_unit(run.quantities, quantity, name))


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


def integrals(run: Lookup, integrand: Callable[[Quantities], Array]) -> tuple[Array, Array]:
    """Return the integrals of several functions over a run, and their errors, both of shape (k,).

    Args:
        run: The run; its rows are states of one motion.
        integrand: Quantities of n rows -> values of the functions there, of the size of 1 or less, shape (n, k).
    """
    parts = []
    for interval, (start, end, _) in enumerate(run.intervals):
        low, high = sorted((start, end))
        if low < high:
            rows = partial(run.quantities_at, interval)
            parts.append(_integral_between(_remembering(rows, integrand, low, high), low, high))
    total, error = (np.sum(of, axis=0) for of in zip(*parts, strict=True))
    return total, error + ROUNDING * np.abs(total)


def _integral_between(at: Callable[[Array], Array], low: float, high: float) -> tuple[Array, Array]:
    """Return the integrals of functions of size 1, and their errors, both of shape (k,).

    A function is not integrated to less than its own rounding: it is made smaller by as much as that is more than what
    is allowed.

    Args:
        at: Points, shape (n, 1) -> values of the functions, shape (n, k).
        low: Where the interval begins.
        high: Where it ends.
    """
    from scipy.integrate import cubature

    length = high - low
    scale = np.maximum(_rounding(at, low, high) / ABSOLUTE, 1.0)
    attempt = partial(cubature, lambda t: at(t) / scale, [low], [high], rtol=RELATIVE, atol=ABSOLUTE * length)
    part = _cubature(attempt, length)
    return part.estimate * scale, part.error * scale


def _rounding(at: Callable[[Array], Array], low: float, high: float) -> Array:
    """Return the rounding of functions over an interval, shape (k,): what points next to each other differ by.

    Third differences d of a smooth function over steps of 1e-7 of the interval vanish; of independent errors with the
    deviation s they have ``(d²) = 20 s²`` in the mean.
    """
    steps = NEIGHBOUR * np.arange(-1.5, 2.0)
    points = low + (high - low) * np.add.outer(CLUSTERS, steps)
    values = at(points.reshape(-1, 1)).reshape(*points.shape, -1)
    differences = np.diff(values, 3, axis=1)[:, 0]
    return np.asarray(np.sqrt((differences**2).mean(axis=0) / 20.0))


NEIGHBOUR, CLUSTERS = 1e-7, (0.1127, 0.3819, 0.5, 0.7236, 0.9472)
"""Distance of points whose differences are rounding, and where they are taken, as parts of an interval."""

NODE = 1e-13
"""Part of an interval within which points are one: Gauss's nodes are among those of Kronrod but for rounding."""


def _remembering(
    rows: Callable[[Array], Quantities], integrand: Callable[[Quantities], Array], low: float, high: float
) -> Callable[[Array], Array]:
    """Return the integrand over points, shape (n, 1), of an interval; it is computed once at each of them.

    SciPy's rule asks for the values at the same nodes several times, and each of them takes a solved state.
    """
    known = dict[int, Array]()

    def at(t: Array) -> Array:
        keys = np.round((t[:, 0] - low) / (NODE * (high - low))).astype(int).tolist()
        new = list({key: k for k, key in enumerate(keys) if key not in known}.values())
        if new:
            known.update(zip((keys[k] for k in new), integrand(rows(t[new, 0])), strict=True))
        return np.array([known[key] for key in keys])

    return at


def _cubature(attempt: Callable[..., Any], length: float) -> Any:
    """Return an integral with ever more subdivisions; with no more where they do not help against rounding.

    Args:
        attempt: ``max_subdivisions`` -> the integral, as ``scipy.integrate.cubature`` gives it.
        length: Of the interval.
    """
    part = attempt(max_subdivisions=FEW[0])
    for count in (*FEW[1:], MOST):
        if part.status == "converged":
            break
        before, part = part, attempt(max_subdivisions=count)
        small = (part.error <= NOISE * length).all()
        if small and (part.error >= 0.5 * before.error).any():
            break
    return part


def _moments(run: Lookup, quantity: str) -> tuple[Array, Array, float]:
    """Return the integrals of x/c and (x/c)², their errors, both of shape (2,), and c, the largest |x| of the rows."""
    scale = float(np.abs(run.quantities[quantity].values).max()) or 1.0

    def powers(rows: Quantities) -> Array:
        x = rows[quantity].values / scale
        return np.stack([x, x * x], axis=1)

    total, error = integrals(run, powers) if _length(run) else np.zeros((2, 2))
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

    total, error = (part / length for part in integrals(run, squares))
    root = np.sqrt(np.maximum(total, 0.0))
    return scales * root, scales * np.where(root**2 > error, 0.5 * error / np.maximum(root, 1e-300), np.sqrt(error))


def _integral(run: Lookup, quantity: str) -> tuple[float, float]:
    (first, _), (error, _), scale = _moments(run, quantity)
    return scale * first, scale * error


def _peak(run: Lookup, quantity: str) -> tuple[float, float]:
    value = abs(float(run.at("largest", quantity)[quantity].values[0]))
    return value, ROUNDING * value


def _single(run: Lookup, quantity: str) -> tuple[float, float]:
    return float(run.quantities[quantity].values[0]), 0.0


def _percentile(run: Lookup, quantity: str, share: float) -> tuple[float, float]:
    """Return the value below which x is for a share of the run [%], and its error.

    It is taken from samples at even distances, twice as many each time until it settles; the error is the last change.
    """
    points, before = COARSEST, _sampled_percentile(run, quantity, share, COARSEST)
    while True:
        points *= 2
        value = _sampled_percentile(run, quantity, share, points)
        error, spread = abs(value - before), float(np.ptp(run.quantities[quantity].values))
        if error <= SETTLED * spread or points >= FINEST:
            return value, error + ROUNDING * abs(value)
        before = value


def _sampled_percentile(run: Lookup, quantity: str, share: float, points: int) -> float:
    x, weights = [], []
    for interval, (start, end, _) in enumerate(run.intervals):
        t = start + (end - start) * (np.arange(points) + 0.5) / points
        x.append(run.quantities_at(interval, t)[quantity].values)
        weights.append(np.full(points, abs(end - start) / points))
    values, weight = np.concatenate(x), np.concatenate(weights)
    if not weight.any():
        return _single(run, quantity)[0]
    order = values.argsort()
    middle = (np.cumsum(weight[order]) - 0.5 * weight[order]) / weight.sum()
    return float(np.interp(share / 100.0, middle, values[order]))


FIGURES: dict[str, Callable[[Lookup, str], tuple[float, float]]] = {
    "mean": _mean,
    "rms": _rms,
    "integral": _integral,
    "peak": _peak,
}
"""Name -> function that returns the figure and the error of its quadrature [SI]. Percentages are figures too."""
