"""Figures of a quantity x(s) over a whole run of length L, each with the error of its quadrature.

    mean      1/L ∫ x ds
    rms       (1/L ∫ x² ds)^(1/2)
    integral  ∫ x ds, with ds < 0 where s falls
    peak      largest |x|
    p95       the value below which x is for 95 % of L; any percentage from p0 to p100

s is the parameter of the run: the time, or the coordinate that is swept. Integrals are taken of the motion itself, not
of the rows of the table.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.records import ValueRecord
from pinarm.use.result.curve import Endless, percentile
from pinarm.use.result.curve import integrals as integrals_of
from pinarm.use.result.row_lookup import Lookup

FIGURES = ("mean", "rms", "integral", "peak")
"""Names of figures; percentages are figures too."""

ROUNDING = 4e-16
"""Of a sum of a few hundred terms, relative to their sum."""

_PERCENTILE = re.compile(r"p([0-9]{1,3}(?:\.[0-9]{1,3})?)")


class CurveFigure(ValueRecord, frozen=True):
    """A figure of a curve.

    Attributes:
        value: The figure [SI].
        error: Estimate of what the quadrature leaves of it [SI]; the error of the motion itself is not in it.
        unit: Its unit; ``None`` where it is not known.
        doubt: Why it is one choice of many; empty where it is determined.
    """

    value: float
    error: float
    unit: Unit | None
    doubt: str = ""


def is_figure(name: str) -> bool:
    """Tell whether a name is that of a figure: one of ``FIGURES``, or a percentage such as ``p95``."""
    return name in FIGURES or _percentage(name) is not None


def _percentage(name: str) -> float | None:
    matched = _PERCENTILE.fullmatch(name)
    share = float(matched[1]) if matched else None
    return share if share is not None and share <= 100.0 else None


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
    share, values = _percentage(name), run.quantities[quantity].values
    if np.isnan(values).any() or (share is not None and np.isinf(values).any()):
        raise InputError(f"{quantity} is not finite everywhere: it has no {name}")
    try:
        if name == "peak":
            value, error = run.value("largest", quantity, quantity)
            value = abs(value)
        elif not run.length:
            value, error = {"rms": abs(float(values[0])), "integral": 0.0}.get(name, float(values[0])), 0.0
        elif share is None:
            value, error = _of_integrals(run, quantity, name)
        else:
            value, error = percentile(run.curve_of(quantity), share / 100.0, run.most_pieces)
            error += ROUNDING * abs(value)
    except Endless as pole:
        raise InputError(f"{quantity} has no {name}: {pole.message}", expected=pole.expected) from None
    if not np.isfinite(error):
        hint = f"'{quantity} @ largest' tells where it is infinite"
        raise InputError(f"{quantity} has no {name}, as its integral has no end", hint=hint)
    return CurveFigure(float(value), float(error), figure_unit(run.quantities, quantity, name))


def stands_alone(rows: Trajectory, quantity: str, name: str) -> InputError:
    """Return the error for a figure of a quantity over rows that are separate states, no motion."""
    return InputError(
        f"{quantity} @ {name} is taken over a motion, and these rows stand alone",
        expected="@ peak (the largest amount), @ max, @ min, or a place such as @ row=1",
        hint=made_a_motion(rows),
    )


def made_a_motion(rows: Trajectory) -> str:
    """Return a hint that makes recorded rows a motion; empty for other rows."""
    return f'{rows.remedy} (in Python derivatives="spline"), with the positions alone' if rows.remedy else ""


def figure_unit(quantities: Quantities, quantity: str, name: str) -> Unit | None:
    """Return the unit of a figure: that of the quantity, times that of the parameter for ``integral``."""
    unit = quantities[quantity].unit
    return unit * quantities.trajectory.unit if unit is not None and name == "integral" else unit


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
    total, error = integrals_of(run.curve(integrand, of), least, run.most_pieces)
    return total, error + ROUNDING * np.abs(total)


def _of_integrals(run: Lookup, quantity: str, name: str) -> tuple[float, float]:
    """Return mean, rms or integral, and its error, by the integrals of x/c and (x/c)².

    c is the largest of the sizes of x in the rows. That may be one beside a pole, and all else small.
    """
    rows, t = np.abs(run.quantities[quantity].values), run.run.grid.t
    scale = float(rows[np.isfinite(rows)].max(initial=0.0)) or 1.0

    def powers(rows: Quantities) -> Array:
        x = rows[quantity].values / scale
        return np.stack([x, x * x], axis=1)

    total, error = integrals(run, powers, least=0.0, of=[quantity])
    if name == "rms":
        root, left = (float(total[1]) / run.length) ** 0.5, float(error[1]) / run.length
        return scale * root, scale * (0.5 * left / root if root else left**0.5)
    per = float(np.sign(t[-1] - t[0])) if name == "integral" else 1.0 / run.length
    return scale * float(total[0]) * per, scale * float(error[0]) * abs(per)


def rms_values(run: Lookup, quantities: Sequence[str], scales: Array) -> tuple[Array, Array]:
    """Return the rms values of several quantities by one quadrature, and their errors, both of shape (k,).

    Args:
        run: The run; its rows are states of one motion.
        quantities: Names, k of them.
        scales: What matters in each [SI], shape (k,): components of a vector have its size, beside which one that is
            only rounding is 0, and needs no more points.
    """
    scales = np.where(scales > 0.0, scales, 1.0)

    def squares(rows: Quantities) -> Array:
        return np.stack([(rows[name].values / scale) ** 2 for name, scale in zip(quantities, scales, strict=True)], 1)

    total, error = (part / run.length for part in integrals(run, squares, of=quantities))
    root = np.sqrt(np.maximum(total, 0.0))
    return scales * root, scales * np.where(root**2 > error, 0.5 * error / np.maximum(root, 1e-300), np.sqrt(error))
