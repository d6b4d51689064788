"""The cubic spline with given slopes: against cubics, which it reproduces, and against SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pinarm.mechanics.laws.clamped_spline import ClampedSpline

ROUNDING = 1e-13
"""Of values near 1 over intervals of length 0.01 to 1, relative to the largest: a few operations each."""


def knots(count: int) -> np.ndarray:
    return np.cumsum(np.random.default_rng(count).uniform(0.01, 1.0, count))


class TestClampedSpline:
    @pytest.mark.parametrize("count", [2, 3, 4, 20])
    def test_a_cubic_is_reproduced(self, count):
        cubic = np.polynomial.Polynomial([0.3, -1.2, 0.7, 0.25])
        x = knots(count)
        spline = ClampedSpline.through(x, cubic(x), (cubic.deriv()(x[0]), cubic.deriv()(x[-1])))
        points = np.linspace(x[0] - 0.1, x[-1] + 0.1, 101)
        for order, values in enumerate(spline(points)):
            wanted = cubic.deriv(order)(points)
            scale = ROUNDING / np.diff(x).min() ** order  # a difference quotient loses what the interval is shorter
            assert abs(values - wanted).max() <= scale * abs(wanted).max()

    @pytest.mark.parametrize("count", [2, 3, 7, 300])
    def test_it_is_that_of_scipy(self, count):
        x = knots(count)
        y = np.random.default_rng(1).normal(size=count)
        ours = ClampedSpline.through(x, y, (0.4, -0.6))
        theirs = CubicSpline(x, y, bc_type=((1, 0.4), (1, -0.6)))
        points = np.sort(np.concatenate([x, np.random.default_rng(2).uniform(x[0] - 1.0, x[-1] + 1.0, 500)]))
        for order, values in enumerate(ours(points)):
            wanted = theirs(points, order)
            assert abs(values - wanted).max() <= ROUNDING * abs(wanted).max()

    def test_second_derivatives_are_continuous_inside(self):
        x = knots(9)
        spline = ClampedSpline.through(x, np.sin(x), (1.0, 0.0))
        inner = x[1:-1]
        _, _, before = spline(inner - 1e-9)
        _, _, at = spline(inner)
        assert abs(before - at).max() <= 1.1 * 1e-9 * 6.0 * abs(spline.coefficients[3]).max()  # s''' times the step

    def test_one_point_is_as_many(self):
        spline = ClampedSpline.through(knots(5), knots(5) ** 2, (0.0, 1.0))
        points = np.array([0.2, 0.9, 1.5])
        many = np.array(spline(points))
        assert (many == np.array([spline(np.array([t])) for t in points])[:, :, 0].T).all()
