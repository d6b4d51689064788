"""Measured figures: arrays while they are computed, with a number for each variant; numbers in results."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinarm.arrays import Array


def relative(residuals: Array, terms: Array) -> Array:
    """Return the largest residual of all rows relative to the largest term, shape (n, ..) to (..); 0 without terms."""
    worst, largest = residuals.max(axis=0, initial=0.0), terms.max(axis=0, initial=0.0)
    return np.asarray(np.divide(worst, largest, out=np.zeros(np.shape(largest)), where=largest != 0.0))


def plain(figures: Mapping[str, Array | float]) -> dict[str, float]:
    """Return the figures of a single mechanism, shape (), as Python's numbers."""
    return {name: float(figure) for name, figure in figures.items()}
