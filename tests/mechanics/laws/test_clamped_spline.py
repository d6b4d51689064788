"""The cubic spline with given slopes: against cubics, which it reproduces, and against SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pinarm.mechanics.laws.interpolated import ClampedSpline

ROUNDING = 1e-13
"""Of values near 1 over intervals of length 0.01 to 1, relative to the largest: a few operations each."""


def knots(count: int) -> np.ndarray:
    return np.cumsum(np.random.default_rng(count).uniform(0.01, 1.0, count))


class TestClampedSpline:
    @pytest.mark.parametrize("count", [2, 7])
    def test_it_is_that_of_scipy(self, count):
        x = knots(count)
        y = np.random.default_rng(1).normal(size=count)
        ours = ClampedSpline.through(x, y, (0.4, -0.6))
        theirs = CubicSpline(x, y, bc_type=((1, 0.4), (1, -0.6)))
        points = np.sort(np.concatenate([x, np.random.default_rng(2).uniform(x[0] - 1.0, x[-1] + 1.0, 500)]))
        for order, values in enumerate(ours(points)):
            wanted = theirs(points, order)
            assert abs(values - wanted).max() <= ROUNDING * abs(wanted).max()
