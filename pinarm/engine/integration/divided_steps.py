"""Dense output of embedded pairs, and shorter steps where it does not follow the motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.dense_output import DenseOutput
from pinarm.engine.integration.tableaus import Tableau

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Interval, Manifold

DEFECT, PARTS = 30.0, 8
"""Defect of the dense output in the middle of a step, over the tolerance, from which on steps of its eighth may take
its place: it is about 0.1, seldom above 3, and 1e4 beyond the limit of stability."""


def terms_of(
    tableau: Tableau, interval: Interval, manifold: Manifold, begin: Array, t: Array, h: Array, base: Array,
    known: Array,
) -> Array:  # fmt: skip
    """Return the terms r of polynomials over steps; Hairer, Norsett, Wanner, section II.6.

    ``r_0 = y_new - y``, ``r_1 = h k_0 - r_0``, ``r_2 = 2 r_0 - h (k_0 + k_s)``; the higher ones are ``h dense_d @ k``
    over all stages, those of ``dense_a`` included.

    Args:
        tableau: The coefficients.
        interval: The interval of the steps.
        manifold: The configuration space.
        begin: Starts of the accepted steps that they are, or are parts of [s], shape (n,).
        t: Starts of the steps [s], shape (n,).
        h: Lengths [s], shape (n,).
        base: States at the starts, shape (n, nq + nv).
        known: Slopes at the stages, shape (n, s + 1, nq + nv).

    Returns:
        Shape (n, d, nq + nv).
    """
    s = tableau.stages + 1
    slopes = np.empty((len(h), s + len(tableau.dense_c), base.shape[1]))
    slopes[:, :s] = known
    for k, (weights, c) in enumerate(zip(tableau.dense_a, tableau.dense_c, strict=True), s):
        y = base + h[:, None] * (weights[:k] @ slopes[:, :k])
        _, slopes[:, k] = _rates(interval, manifold, begin, t + c * h, y)
    slopes *= h[:, None, None]
    change, first, last = tableau.b @ slopes[:, : s - 1], slopes[:, 0], slopes[:, s - 1]
    lowest = np.stack([change, first - change, 2 * change - first - last], axis=1)
    return np.concatenate([lowest, tableau.dense_d @ slopes], axis=1)


def divided(
    tableau: Tableau, tolerance: float, interval: Interval, manifold: Manifold, t: Array, h: Array, y: Array,
    terms: Array,
) -> DenseOutput:  # fmt: skip
    """Return the dense output of n steps, of shorter steps in place of those whose own does not follow the motion.

    Once the fast part of a motion has died away a step may go far beyond the limit of stability before its end shows
    it: within, the stages blow up what is left of that part. It is seen in the defect ``h (f(u) - u')`` of the dense
    output u in the middle of the step. Beside a singular position rounding makes defects too, and shorter steps blow it
    up more: they have to come to the end of the step, whose error is known, closer than the defect.

    Args:
        tableau: The coefficients.
        tolerance: Local error per step, relative to ``size + |y|``.
        interval: The interval of the steps.
        manifold: The configuration space.
        t: Starts of the steps [s], shape (n,).
        h: Lengths [s], shape (n,).
        y: States [q, v] at the starts, shape (n, nq + nv).
        terms: Terms of ``Tableau.examined``, shape (n, d + 1, nq + nv).
    """
    output, defects = DenseOutput.whole(y, terms[:, :-1]), np.abs(terms[:, -1]).max(axis=1)
    poor = (defects > DEFECT * tolerance * (interval.size + np.abs(y).max(axis=1))).nonzero()[0]
    if not len(poor):
        return output
    parts, ends = _parts(tableau, interval, manifold, t[poor], h[poor], y[poor])
    apart = np.abs(ends - _projected(manifold, y[poor] + terms[poor, 0])).max(axis=1)
    each = output.split()
    for k, part, better in zip(poor.tolist(), parts.split(), apart < defects[poor], strict=True):
        each[k] = part if better else each[k]
    return DenseOutput.joined(each)


def _parts(
    tableau: Tableau, interval: Interval, manifold: Manifold, t: Array, h: Array, y: Array
) -> tuple[DenseOutput, Array]:
    """Return the dense output of n steps in equal parts, and the states at their ends, shape (n, nq + nv)."""
    (n, size), s, h = y.shape, tableau.stages, h / PARTS
    base, slopes = np.empty((n, PARTS, size)), np.empty((n, PARTS, s + 1, size))
    starts = t[:, None] + h[:, None] * np.arange(PARTS)
    y, slope = _rates(interval, manifold, t, t, y)
    for part in range(PARTS):
        base[:, part], slopes[:, part, 0] = y, slope
        begun, k = y, slopes[:, part]
        for i, (weights, c) in enumerate(zip([*tableau.a[1:], tableau.b], [*tableau.c[1:], 1.0], strict=True), 1):
            stage = begun + h[:, None] * (weights[:i] @ k[:, :i])
            y, k[:, i] = _rates(interval, manifold, t, starts[:, part] + c * h, stage)
        slope = k[:, s]
    flat = base.reshape(-1, size), slopes.reshape(-1, s + 1, size)
    terms = terms_of(tableau, interval, manifold, np.repeat(t, PARTS), starts.ravel(), np.repeat(h, PARTS), *flat)
    return DenseOutput(flat[0], terms, np.full(n, PARTS)), y


def _rates(interval: Interval, manifold: Manifold, begin: Array, t: Array, y: Array) -> tuple[Array, Array]:
    """Return projected states and their slopes, both of shape (n, nq + nv), in steps that begin at ``begin``."""
    y = _projected(manifold, y)
    if interval.compiled is not None:
        return y, interval.compiled.slopes(begin, t, y)
    q, v = y[:, : manifold.nq], y[:, manifold.nq :]
    return y, np.concatenate([manifold.velocity(q, v), interval.accelerations(begin, t, q, v)], axis=1)


def _projected(manifold: Manifold, y: Array) -> Array:
    return np.concatenate([manifold.project(y[:, : manifold.nq]), y[:, manifold.nq :]], axis=1)
