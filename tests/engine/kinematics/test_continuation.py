"""Predictions of rows ahead; the motions that they lead to are in ``loops/test_many_rows``."""

import numpy as np
import pytest

from pinarm.engine.kinematics.continuation import KNOWN, _predicted


@pytest.mark.parametrize("known", range(1, KNOWN + 1))
def test_a_polynomial_motion_is_predicted_exactly(known):
    """Accelerations at p instants, here at unequal distances, determine motions of degree p + 1, and none beyond."""
    t, h = np.array([0.31, 0.4, 0.57])[-known:], np.array([0.0, 0.1, 0.7, 2.0])
    exact = [np.polynomial.Polynomial(np.random.default_rng(k).normal(size=known + 2)) for k in range(2)]
    beyond = [motion + np.polynomial.Polynomial.basis(known + 2) for motion in exact]
    for motions, within in ((exact, True), (beyond, False)):
        q, v = (np.array([motion.deriv(order)(t[-1]) for motion in motions]) for order in (0, 1))
        a = np.array([motion.deriv(2)(t) for motion in motions]).T
        position, velocity = _predicted(h[:, None], q, v, t, a)
        wanted, rate = (np.array([motion.deriv(order)(t[-1] + h) for motion in motions]).T for order in (0, 1))
        assert (np.abs(position - wanted).max() < 1e-12 * np.abs(wanted).max()) == within
        assert (np.abs(velocity - rate).max() < 1e-12 * np.abs(rate).max()) == within
