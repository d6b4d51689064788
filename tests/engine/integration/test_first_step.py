"""The first step, by hand from the five lines of Hairer, Norsett and Wanner, section II.4."""

import numpy as np
import pytest

from pinarm.engine.integration.first_step import first_step


def test_of_a_decay_by_hand() -> None:
    """``y' = -3 y`` from 2 with a tolerance of 1e-8: errors are relative to ``3e-8``.

    d0 = 2/3e-8, d1 = 6/3e-8, h0 = 0.01/3; the slope after an Euler step of h0 differs by ``3 h0 6``, d2 = 18/3e-8.
    """
    y = np.array([2.0])
    h = first_step(0.0, 10.0, y, -3.0 * y, lambda t, y: -3.0 * y, 1e-8, 7)
    assert h == pytest.approx((0.01 / (18.0 / 3e-8)) ** (1.0 / 8.0), rel=1e-12)


def test_at_rest_it_is_short_and_never_longer_than_a_hundred_trials() -> None:
    y = np.zeros(2)
    h = first_step(0.0, 1.0, y, y, lambda t, y: np.zeros_like(y), 1e-8, 7)
    assert 0.0 < h <= 1e-4  # a trial of 1e-6, where nothing says how fast things change


def test_motions_get_steps_of_their_own() -> None:
    speeds = np.array([0.1, 1.0, 10.0])
    y = np.ones((3, 1))
    together = first_step(0.0, 10.0, y, -speeds[:, None] * y, lambda t, y: -speeds[:, None] * y, 1e-8, 7)
    for k, speed in enumerate(speeds):
        alone = first_step(0.0, 10.0, y[k], -speed * y[k], lambda t, y, s=speed: -s * y, 1e-8, 7)
        assert together[k] == pytest.approx(float(alone), rel=1e-12)
    assert (np.diff(together) < 0.0).all()
