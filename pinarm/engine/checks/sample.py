"""Which rows of a table are checked: a fixed, even choice, so that the cost of large tables stays bounded."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pinarm.arrays import Indices

SAMPLE = 64
"""Number of rows that are checked where not all are."""


@lru_cache(maxsize=256)
def sampled(rows: int, most: int = SAMPLE) -> Indices:
    """Return the indices of the rows that are checked, ascending, shape (n,): all if there are no more than ``most``.

    Every check of a run takes the same, so that what one computes of them serves the others; to be read only.
    """
    found = np.arange(rows) if rows <= most else np.linspace(0, rows - 1, most).astype(np.intp)
    found.flags.writeable = False
    return found
