"""Measured figures: arrays while they are computed, with a number for each variant; numbers in results."""

from __future__ import annotations

from collections.abc import Mapping

from pinarm.arrays import Array


def plain(figures: Mapping[str, Array | float]) -> dict[str, float]:
    """Return the figures of a single mechanism, shape (), as Python's numbers."""
    return {name: float(figure) for name, figure in figures.items()}
