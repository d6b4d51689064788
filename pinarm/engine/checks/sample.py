"""Which rows of a table are checked: a fixed, even choice, so that the cost of large tables stays bounded."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Indices

SAMPLE = 64
"""Number of rows that are checked where not all are."""


def sampled(rows: int, most: int = SAMPLE) -> Indices:
    """Return the indices of the rows that are checked, ascending, shape (n,): all if there are no more than ``most``.

    Every check of a run takes the same, so that what one computes of them serves the others.
    """
    if rows <= most:
        return np.arange(rows)
    return np.linspace(0, rows - 1, most).astype(np.intp)
