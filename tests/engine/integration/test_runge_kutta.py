"""Step control and first step of explicit methods: where steps settle, within which bounds."""

import numpy as np
import pytest

from pinarm.engine.integration.runge_kutta import FASTEST, HUGE, LOST, SLOWEST, first_step, growth, shrinkage

ORDER = 8


def test_steps_settle_where_the_error_is_a_share_of_the_tolerance():
    """With an error ``c h^8`` the factor is 1 where ``0.8 e^(-0.1) = 1``: at ``e = 0.8^10``, whatever c."""
    for c in (1e-6, 1.0, 1e6):
        h = c ** (-1.0 / ORDER)
        for _ in range(200):
            h *= growth(c * h**ORDER, ORDER, FASTEST)
        assert c * h**ORDER == pytest.approx(0.8**10, rel=1e-9)


def test_steps_change_within_bounds():
    assert [growth(0.0, ORDER, ceiling) for ceiling in (FASTEST, 1.0)] == [FASTEST, 1.0]
    assert [shrinkage(error, ORDER) for error in (1e200, 2.0 * HUGE, np.nan)] == [SLOWEST, LOST, LOST]


def test_the_first_step_of_a_decay_by_hand():
    """``y' = -3 y`` from 2 with a tolerance of 1e-8: errors are relative to ``3e-8``.

    d0 = 2/3e-8, d1 = 6/3e-8, h0 = 0.01/3; the slope after an Euler step of h0 differs by ``3 h0 6``, d2 = 18/3e-8.
    """
    y = np.array([2.0])
    h = first_step((0.0, 10.0), y, -3.0 * y, lambda t, y: -3.0 * y, 1e-8, 7)
    assert h == pytest.approx((0.01 / (18.0 / 3e-8)) ** (1.0 / 8.0), rel=1e-12)


def test_the_first_step_at_rest_is_short_and_never_longer_than_a_hundred_trials():
    y = np.zeros(2)
    h = first_step((0.0, 1.0), y, y, lambda t, y: np.zeros_like(y), 1e-8, 7)
    assert 0.0 < h <= 1e-4  # a trial of 1e-6, where nothing says how fast things change
