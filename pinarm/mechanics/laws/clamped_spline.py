"""Cubic spline with given slopes at its ends."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.records import Record


class ClampedSpline(Record, frozen=True):
    """Cubic spline s(x) through points, s'' continuous inside, with given slopes at both ends.

    Between the knots k and k + 1, with ``u = x - x_k``, ``s = c0 + c1 u + c2 u² + c3 u³``. C. de Boor, *A Practical
    Guide to Splines*, chapter IV. Computed here since importing SciPy's takes twice as long as NumPy and Pinocchio.

    Attributes:
        knots: x_k, ascending, shape (n,).
        coefficients: c0, c1, c2 and c3 of every interval, shape (4, n - 1).
    """

    knots: Array
    coefficients: Array

    @classmethod
    def through(cls, x: Array, y: Array, slopes: tuple[float, float]) -> ClampedSpline:
        """Return the spline through points, two at least, x ascending; both of shape (n,)."""
        h = np.diff(x)
        chord = np.diff(y) / h
        slope = _slopes(h, chord, slopes)
        bend = (slope[:-1] + slope[1:] - 2.0 * chord) / h
        return cls(x, np.array([y[:-1], slope[:-1], (chord - slope[:-1]) / h - bend, bend / h]))

    def __call__(self, x: Array) -> tuple[Array, Array, Array]:
        """Return s, s' and s'', each with the shape of x; beyond the ends, those of the first and the last cubic."""
        interval = self.knots[1:-1].searchsorted(x, side="right")
        u = x - self.knots[interval]
        c0, c1, c2, c3 = self.coefficients[:, interval]
        return ((c3 * u + c2) * u + c1) * u + c0, (3.0 * c3 * u + 2.0 * c2) * u + c1, 6.0 * c3 * u + 2.0 * c2


def _slopes(h: Array, chord: Array, ends: tuple[float, float]) -> Array:
    """Return the slopes m at the knots, shape (n,), at which s'' is continuous.

    ``h_k m_{k-1} + 2 (h_{k-1} + h_k) m_k + h_{k-1} m_{k+1} = 3 (h_k d_{k-1} + h_{k-1} d_k)``, with the slopes d of the
    chords: eliminated from the first knot to the last and solved backwards, stable since the diagonal is dominant.

    Args:
        h: Lengths of the intervals, shape (n - 1,).
        chord: d, shape (n - 1,).
        ends: The first and the last slope.
    """
    right_sides = (3.0 * (h[1:] * chord[:-1] + h[:-1] * chord[1:])).tolist()
    lengths = h.tolist()
    solved, factors = [float(ends[0])], [0.0]  # m_k = solved_k - factors_k m_{k+1}
    for k, right in enumerate(right_sides):
        before, after = lengths[k], lengths[k + 1]
        pivot = 2.0 * (before + after) - after * factors[k]
        solved.append((right - after * solved[k]) / pivot)
        factors.append(before / pivot)
    slopes = [float(ends[1])]
    for value, factor in zip(solved[::-1], factors[::-1], strict=True):
        slopes.append(value - factor * slopes[-1])
    return np.array(slopes[::-1])
