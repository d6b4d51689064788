"""Where the pieces of a load meet, along a coordinate or a velocity: a step must not pass one of them unseen."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, distinct
from pinarm.records import Record

SLIVER = 1e-12
"""Width of a piece, relative to where it is, that rounding makes."""


class Pieces(Record, frozen=True):
    """The intervals of a coordinate or a velocity w on which a load is one smooth function of it.

    Attributes:
        bounds: Where one meets the next, ascending, shape (k,); those from 0 on of the first period where they repeat.
        period: After which they repeat; infinite where they do not.
    """

    bounds: Array
    period: float = math.inf

    def passed(self, w: Array) -> bool:
        """Return whether values go further than the narrowest piece among them is wide.

        Stages of a step that goes no further than that are in every piece that it touches, or next to it.

        Args:
            w: Values along a step, its ends included, shape (n,).
        """
        low, high = float(w.min()), float(w.max())
        if high - low > self.period:
            return True
        turn = 0.0 if self.period == math.inf else self.period * math.floor(low / self.period)
        first = np.searchsorted(self._bounds, low - turn, side="right")
        last = np.searchsorted(self._bounds, high - turn)
        return bool(first < last and high - low > self._widths[first : last + 1].min())

    @cached_property
    def _bounds(self) -> Array:
        """The bounds, those of two periods where they repeat, without slivers."""
        around = self.bounds
        if self.period < math.inf:
            around = np.concatenate([[0.0], around, self.period + np.array([0.0, *around]), [2.0 * self.period]])
        around = distinct(around)
        return around[np.diff(around, prepend=-math.inf) > SLIVER * (1.0 + np.abs(around))]

    @cached_property
    def _widths(self) -> Array:
        """How wide the pieces are below, between and above the bounds, shape (k + 1,)."""
        return np.diff(self._bounds, prepend=-math.inf, append=math.inf)
