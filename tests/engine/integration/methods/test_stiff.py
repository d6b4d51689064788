"""Radau IIA on problems with a known slow motion, by a bounded number of accelerations."""

import numpy as np
import pytest

from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval, Manifold
from pinarm.engine.integration.methods.stiff import radau_of

LINE = Manifold(1, 1)


def drawn(stiffness, damping):
    """The acceleration of a mass that a spring and a damper draw along cos(t): Prothero and Robinson's problem."""
    return lambda t, q, v: -stiffness * (q - np.cos(t)) - damping * (v + np.sin(t)) - np.cos(t)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
@pytest.mark.parametrize(("stiffness", "damping"), [(1e6, 2e3), (1e9, 1e6), (1e4, 1e8)])
def test_steps_follow_the_slow_motion(stiffness, damping, tolerance):
    interval = Interval(0.0, 10.0, drawn(stiffness, damping))
    solution = integrate([interval], LINE, np.ones(1), np.zeros(1), radau_of(tolerance))
    t = np.linspace(0.0, 10.0, 301)
    assert np.abs(solution.states(t)[0][:, 0] - np.cos(t)).max() < 2.0 * tolerance
    assert solution.count.evaluations < 500  # an explicit method takes 1e4 and more


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
def test_a_fast_transient_costs_few_steps(tolerance):
    """The velocity decays within 1e-6 s to 0.3 m/s, that of the closed form with the slow decay of 1 / s."""
    interval = Interval(0.0, 2.0, lambda t, q, v: -1e6 * (v + q))
    solution = integrate([interval], LINE, np.ones(1), np.full(1, 0.3), radau_of(tolerance))
    fast, slow = np.roots([1.0, 1e6, 1e6])
    expected = ((0.3 - slow) * np.exp(2.0 * fast) - (0.3 - fast) * np.exp(2.0 * slow)) / (fast - slow)
    assert solution.states(np.array([2.0]))[0][0, 0] == pytest.approx(expected, abs=tolerance)
    assert solution.count.evaluations < 500


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-8])
@pytest.mark.parametrize("creep", [1e-3, 1e-5])
def test_dry_friction_that_sticks_is_passed_even_where_the_tolerance_is_wider_than_the_creep(creep, tolerance):
    """A mass of 1 kg on a belt of 0.5 m/s, on a spring of 10 N/m, under 3 N of friction: it sticks, slips, sticks."""
    interval = Interval(0.0, 5.0, lambda t, q, v: -10.0 * q - 3.0 * np.tanh((v - 0.5) / creep))
    solution = integrate([interval], LINE, np.zeros(1), np.zeros(1), radau_of(tolerance))
    assert solution.count.evaluations < 3000
