"""Steps of explicit Runge-Kutta methods: stages, error, step control, dense output.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd edition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.tableaus import Tableau

SAFETY, GAIN, SLOWEST, FASTEST = 0.8, 0.8, 1 / 3, 6.0
"""Safety factor, gain of the step controller, and bounds of the factor by which a step changes.
Measured on double pendulums at errors of 1e-4 to 1e-10: 14 % of the steps are refused and 10 to 13 % fewer evaluations
needed than with the 0.9 and 1 of Hairer, Norsett and Wanner, section II.4, by which 25 % are refused. More caution than
this saves no more, and loses where rounding is blown up."""

LOST, HUGE = 0.1, 1e300
"""Factor of the step after an error above ``HUGE`` or NaN."""

TINY = 1e-300
"""Smallest error in powers and quotients, which keeps them finite."""

PASSED = 1e12
"""Error assigned to a step that may have stepped over a piece of a load, so that it is rejected."""

SHORTEST = 16.0
"""Smallest step, in units in the last place of t: in shorter ones ``t + c h`` of some stage equals t."""

NOISE = 1e-6
"""Error of a step, relative to ``1 + |y|``, up to which amplified rounding near a singular position explains it."""

NOISELESS = 1e-8
"""Smallest trial step for the first step, relative to the duration: a state that is 0 but for rounding would give a
smaller one."""

HALVES = np.array([0.0, 0.5, 1.0])
"""Fractions of a step: start, middle, end."""

Rates = Callable[[Any, Array], Array]
"""``(t, y) -> slopes`` of states, which are projected onto the manifold in place; shapes (...), (..., n), (..., n)."""


def stages(rows: Sequence[tuple[Array, float]], rates: Rates, t: Any, h: Any, y: Array, slopes: Array) -> Array:
    """Compute further stages ``k_i = f(t + c_i h, y + h sum_j a_ij k_j)``; return the state of the last one.

    Args:
        rows: Weights ``a_ij`` over the earlier slopes, and time ``c_i``, of each stage.
        rates: f.
        t: Starts of the steps [s], shape (...).
        h: Lengths [s], shape (...).
        y: States at the starts, shape (..., n).
        slopes: The known slopes; those of the stages are written behind them, shape (..., s, n).
    """
    state, lengths = y, np.asarray(h)[..., None]
    for weights, c in rows:
        i = len(weights)
        state = y + lengths * (weights @ slopes[..., :i, :])
        slopes[..., i, :] = rates(t + c * h, state)
    return state


def error_of(tableau: Tableau, h: float, y: Array, new: Array, slopes: Array, scale: tuple[float, float]) -> float:
    """Return the error of a step; Hairer, Norsett, Wanner, section II.10, eq. (10.17).

    ``e = |h| rms(error @ k / scale)``; with a second estimate e3 of lower order it is
    ``e5^2 / sqrt(e5^2 + 0.01 e3^2)``, which has the order of the step.

    Args:
        tableau: The coefficients.
        h: Length of the step [s].
        y: State at its start, shape (n,).
        new: State at its end, shape (n,).
        slopes: Slopes at the stages, shape (s + 1, n).
        scale: Tolerance and size: an error of 1 is ``tolerance (size + max(|y|, |new|))``.
    """
    tolerance, size = scale
    errors = (tableau.error @ slopes) / (size + np.maximum(np.abs(y), np.abs(new)))
    first, *lower = map(float, np.vecdot(errors, errors))
    usual = first / max(math.sqrt(first + 0.01 * sum(lower)), TINY)
    return abs(h) / (tolerance * math.sqrt(len(y))) * (usual if first else math.sqrt(sum(lower)))


def growth(error: float, order: int, ceiling: float) -> float:
    """Return the factor of the next step after an accepted one: ``min(ceiling, 0.8 error^(-0.8 / order))``.

    A damped integral controller: Soderlind, Digital filters in adaptive time-stepping, ACM TOMS 29 (2003), section 2.
    """
    return float(min(ceiling, SAFETY * max(error, TINY) ** (-GAIN / order)))


def shrinkage(error: float, order: int) -> float:
    """Return the factor of the next try after a rejected step: ``max(1/3, 0.8 error^(-1 / order))``.

    After errors above ``HUGE`` or NaN it is ``LOST``.
    """
    return float(max(SLOWEST, SAFETY * max(error, TINY) ** (-1.0 / order))) if error < HUGE else LOST


def first_step(
    time: tuple[float, float], y: Array, slope: Array, rates: Rates, tolerance: float, order: int, size: float = 1.0
) -> float:
    """Return the first step of a motion [s], from the slopes at two states.

    With the norm ``|x| = rms(x / (tol (size + |y|)))``: ``h0 = 0.01 |y| / |f|``,
    ``d2 = |f(t + h0, y + h0 f) - f| / h0``, ``h1 = (0.01 / max(|f|, d2))^(1 / (order + 1))``, ``h = min(100 h0, h1)``.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.4.

    Args:
        time: First and last instant [s].
        y: Initial state, shape (n,).
        slope: Its slope, shape (n,).
        rates: f.
        tolerance: Error of a step, relative to ``size + |y|``.
        order: The error behaves like ``h^(order + 1)``.
        size: See ``Interval.size``.
    """
    (start, end), scale = time, tolerance * len(y) ** 0.5 * (size + np.abs(y))
    d0, d1 = (float(np.linalg.norm(x / scale)) for x in (y, slope))
    h0 = 1e-6 if min(d0, d1) < 1e-5 else 0.01 * d0 / d1
    h0 = min(max(h0, NOISELESS * (end - start)), end - start)
    steepest = max(d1, float(np.linalg.norm((rates(start + h0, y + h0 * slope) - slope) / scale)) / h0)
    h1 = max(1e-6, 1e-3 * h0) if steepest <= 1e-15 else (0.01 / steepest) ** (1.0 / (order + 1))
    return float(min(100.0 * h0, h1))


def along(t: float, h: float, y: Array, new: Array, slopes: Array) -> tuple[Array, Array]:
    """Return instants and states of a step, shapes (3,) and (3, n): its ends, and its middle.

    This is that of the cubic Hermite interpolant, ``(y + y_new) / 2 + h (k_0 - k_s) / 8``.
    """
    middle = 0.5 * (y + new) + 0.125 * h * (slopes[0] - slopes[-1])
    return t + h * HALVES, np.stack([y, middle, new])


def dense_terms(tableau: Tableau, rates: Rates, t: Array, h: Array, y: Array, slopes: Array) -> Array:
    """Return the terms r of polynomials over n steps, see ``DenseOutput``; Hairer, Norsett, Wanner, section II.6.

    ``r_0 = y_new - y``, ``r_1 = h k_0 - r_0``, ``r_2 = 2 r_0 - h (k_0 + k_s)``; the higher ones are ``h dense_d @ k``
    over all stages, those of ``dense_a`` included. Shape (n, d, nq + nv).
    """
    s = tableau.stages + 1
    known = np.empty((len(h), s + len(tableau.dense_c), y.shape[1]))
    known[:, :s] = slopes
    stages(tableau.dense_rows, rates, t, h, y, known)
    known *= h[:, None, None]
    change, first, last = tableau.b @ known[:, : s - 1], known[:, 0], known[:, s - 1]
    lowest = np.stack([change, first - change, 2 * change - first - last], axis=1)
    return np.concatenate([lowest, tableau.dense_d @ known], axis=1)
