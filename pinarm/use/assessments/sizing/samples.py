"""What instants leave unknown of a curve between them: how far it rises above all of them, and of its integral."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array


def rise_between(t: Array, values: Array) -> float:
    """Return by how much a curve may be above the largest of its values.

    From either end of a part of it the curve goes on no steeper than before: a concave one, as about a smooth peak,
    does so less and less. The less steep of two slopes counts, as one may be that of a jump.

    Args:
        t: Instants, ascending, shape (n,); twice where the curve may jump.
        values: Of the curve, shape (n,).
    """
    h, slopes = np.diff(t), _slopes(t, values)
    gentle = np.where(np.abs(slopes[1:]) < np.abs(slopes[:-1]), slopes[1:], slopes[:-1])
    ahead, behind = np.zeros_like(h), np.zeros_like(h)
    ahead[2:], behind[:-2] = gentle[:-1], -gentle[1:]
    reach = np.maximum(values[:-1] + h * ahead, values[1:] + h * behind)
    return float(reach.max(initial=values.max()) - values.max())


def left_of_trapezia(t: Array, values: Array) -> float:
    """Return what trapezia may leave of the integral of a curve.

    A part of the length h with the second derivative f'' is wrong by ``h³ f'' / 12``, and with a jump D by ``h D / 2``;
    with the second divided difference ``f'' / 2``, or ``D / (2 h²)``, the cube of h times it is no less than either.

    Args:
        t: Instants, ascending, shape (n,); twice where the curve may jump.
        values: Of the curve, shape (n,).
    """
    h, slopes = np.diff(t), _slopes(t, values)
    bends = np.zeros(len(t))
    both = (h[1:] > 0.0) & (h[:-1] > 0.0)
    bends[1:-1] = np.where(both, np.abs(np.diff(slopes)) / np.where(both, h[1:] + h[:-1], 1.0), 0.0)
    return float((h**3 * np.maximum(bends[:-1], bends[1:])).sum())


def _slopes(t: Array, values: Array) -> Array:
    """Return the slopes between instants, 0 where two are one, shape (n - 1,)."""
    h = np.diff(t)
    return np.divide(np.diff(values), h, out=np.zeros_like(h), where=h > 0.0)
