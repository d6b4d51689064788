"""Limits of axes: those of the numbers, and no blown-up rounding."""

import numpy as np
import pytest

from pinarm.use.show.chart import Line, Panel, extent, limits


@pytest.mark.parametrize("values", [np.ones(3) + 1e-15 * np.arange(3), np.full(3, 1e-30), np.zeros(0), -np.ones(1)])
def test_rounding_is_not_blown_up(values: np.ndarray) -> None:
    low, high = limits(values)
    assert high - low >= 0.19


@pytest.mark.parametrize("size", [1e-12, 1.0])
def test_a_curve_of_any_size_has_an_axis_of_its_own(size: float) -> None:
    """A force of 10 to 20 pN is no constant: sizes depend on the unit."""
    assert limits(np.array([size, 2.0 * size]), 0.5) == pytest.approx((0.5 * size, 2.5 * size), rel=1e-12)


def test_the_extent_passes_over_gaps() -> None:
    line = Line(np.array([0.0, np.nan, 2.0]), np.array([1.0, np.nan, 5.0]))
    low, high = extent([line, Line(np.full(1, np.nan), np.full(1, np.nan))])
    assert (low.tolist(), high.tolist()) == ([0.0, 1.0], [2.0, 5.0])
    assert Panel([line], equal=True, margin=0.0).extent() == ((0.0, 2.0), (1.0, 5.0))
