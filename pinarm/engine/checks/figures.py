"""Measured figures, and the rows of a table that are checked."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from pinarm.arrays import Array, Indices

SAMPLE = 64
"""Number of rows that are checked where not all are."""


def relative(residuals: Array, terms: Array) -> Array:
    """Return the largest residual of all rows relative to the largest term, shape (n, ..) to (..); 0 without terms."""
    worst, largest = residuals.max(axis=0, initial=0.0), terms.max(axis=0, initial=0.0)
    return np.asarray(np.divide(worst, largest, out=np.zeros(np.shape(largest)), where=largest != 0.0))


def plain(figures: Mapping[str, Array | float]) -> dict[str, float]:
    """Return the figures of a single mechanism, shape (), as Python's numbers."""
    return {name: float(figure) for name, figure in figures.items()}


@lru_cache(maxsize=256)
def sampled(rows: int, most: int = SAMPLE) -> Indices:
    """Return the indices of the rows that are checked, ascending, shape (n,): all if there are no more than ``most``.

    Every check of a run takes the same, so that what one computes of them serves the others; to be read only.
    """
    places = np.arange(rows) if rows <= most else np.linspace(0, rows - 1, most).astype(np.intp)
    places.flags.writeable = False
    return places
