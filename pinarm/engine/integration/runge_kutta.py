"""Steps of explicit Runge-Kutta methods, of one state or of many: stages, error, step control, dense output.

Arrays have leading axes for the motions, ``(..., nq + nv)``. Source: Hairer, Norsett, Wanner, Solving Ordinary
Differential Equations I, 2nd edition.
"""

from __future__ import annotations

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


def error_of(tableau: Tableau, h: Any, y: Array, new: Array, slopes: Array, scale: tuple[float, float]) -> Array:
    """Return the errors of steps, shape (...); Hairer, Norsett, Wanner, section II.10, eq. (10.17).

    ``e = |h| rms(error @ k / scale)``; with a second estimate e3 of lower order it is
    ``e5^2 / sqrt(e5^2 + 0.01 e3^2)``, which has the order of the step.

    Args:
        tableau: The coefficients.
        h: Lengths of the steps [s], shape (...).
        y: States at their starts, shape (..., n).
        new: States at their ends, shape (..., n).
        slopes: Slopes at the stages, shape (..., s + 1, n).
        scale: Tolerance and size: an error of 1 is ``tolerance (size + max(|y|, |new|))``.
    """
    tolerance, size = scale
    errors = (tableau.error @ slopes) / (size + np.maximum(np.abs(y), np.abs(new)))[..., None, :]
    squares = np.vecdot(errors, errors)
    first, lower = squares[..., 0], squares[..., 1:].sum(axis=-1)
    usual = first / np.maximum(np.sqrt(first + 0.01 * lower), TINY)
    length = np.where(first == 0.0, np.sqrt(squares[..., -1]), usual)
    return np.asarray(np.abs(h) / (tolerance * y.shape[-1] ** 0.5) * length)


def growth(error: Any, order: int, ceiling: Any) -> Array:
    """Return the factor of the next step after an accepted one: ``min(ceiling, 0.8 error^(-0.8 / order))``.

    A damped integral controller: Soderlind, Digital filters in adaptive time-stepping, ACM TOMS 29 (2003), section 2.
    """
    return np.asarray(np.minimum(ceiling, SAFETY * np.maximum(error, TINY) ** (-GAIN / order)))


def shrinkage(error: Any, order: int) -> Array:
    """Return the factor of the next try after a rejected step: ``max(1/3, 0.8 error^(-1 / order))``.

    After errors above ``HUGE`` or NaN it is ``LOST``.
    """
    return np.where(error < HUGE, np.maximum(SLOWEST, SAFETY * np.maximum(error, TINY) ** (-1.0 / order)), LOST)


def first_step(
    time: tuple[Any, Any], y: Array, slope: Array, rates: Rates, tolerance: float, order: int, size: Any = 1.0
) -> Array:
    """Return the first steps of motions [s], shape (...), each from the slopes at two states.

    With the norm ``|x| = rms(x / (tol (size + |y|)))``: ``h0 = 0.01 |y| / |f|``,
    ``d2 = |f(t + h0, y + h0 f) - f| / h0``, ``h1 = (0.01 / max(|f|, d2))^(1 / (order + 1))``, ``h = min(100 h0, h1)``.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.4.

    Args:
        time: First and last instant [s], of all or of each motion.
        y: Initial states, shape (..., n).
        slope: Their slopes, shape (..., n).
        rates: f.
        tolerance: Error of a step, relative to ``size + |y|``.
        order: The error behaves like ``h^(order + 1)``.
        size: See ``Interval.size``; or of each motion, shape (..., 1).
    """
    (start, end), scale = time, tolerance * y.shape[-1] ** 0.5 * (size + np.abs(y))

    def norm(x: Array) -> Array:
        return np.asarray(np.sqrt(np.vecdot(x / scale, x / scale)))

    d0, d1 = norm(y), norm(slope)
    small = np.minimum(d0, d1) < 1e-5
    h0 = np.where(small, 1e-6, 0.01 * d0 / np.where(small, 1.0, d1))
    h0 = np.minimum(np.maximum(h0, NOISELESS * (end - start)), end - start)
    steepest = np.maximum(d1, norm(rates(start + h0, y + h0[..., None] * slope) - slope) / h0)
    at_rest = steepest <= 1e-15
    moving = (0.01 / np.where(at_rest, 1.0, steepest)) ** (1.0 / (order + 1))
    h1 = np.where(at_rest, np.maximum(1e-6, 1e-3 * h0), moving)
    return np.asarray(np.minimum(100.0 * h0, h1))


def along(t: Any, h: Any, y: Array, new: Array, slopes: Array) -> tuple[Array, Array]:
    """Return instants and states of steps: their ends, and the middle of the cubic Hermite interpolant.

    Shapes (..., 3) and (..., 3, n). The middle is ``(y + y_new) / 2 + h (k_0 - k_s) / 8``.
    """
    lengths = np.asarray(h)[..., None]
    middle = 0.5 * (y + new) + 0.125 * lengths * (slopes[..., 0, :] - slopes[..., -1, :])
    return np.asarray(t)[..., None] + lengths * HALVES, np.stack([y, middle, new], axis=-2)


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
