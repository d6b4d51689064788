"""What instants leave of curves: of sines, kinks and jumps in closed form, at random instants."""

import numpy as np
import pytest

from pinarm.use.assessments.sizing.samples import left_of_trapezia, rise_between


@pytest.mark.parametrize("seed", range(3))
def test_a_curve_is_no_higher_than_they_say(seed: int) -> None:
    random = np.random.default_rng(seed)
    t, rate, phase = np.sort(random.uniform(0.0, 2.0, 400)), random.uniform(2.0, 9.0), random.uniform(0.0, 6.0)
    values = np.sin(rate * t + phase)
    tops = (np.pi * (0.5 + 2.0 * np.arange(-1, 5)) - phase) / rate
    inside = ((tops > t[0]) & (tops < t[-1])).any()
    exact = 1.0 if inside else values.max()
    rise = rise_between(t, values)
    assert exact - values.max() <= rise + 1e-14
    assert rise < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_trapezia_leave_no_more_of_an_integral_than_they_say(seed: int) -> None:
    random = np.random.default_rng(seed)
    t, place = np.linspace(0.0, 1.0, 200), random.uniform(0.1, 0.9)
    for values, exact in (
        (np.sin(5.0 * t), (1.0 - np.cos(5.0)) / 5.0),
        (abs(t - place), 0.5 * (place**2 + (1.0 - place) ** 2)),
        ((t > place).astype(float), 1.0 - place),
    ):
        left = left_of_trapezia(t, values)
        assert abs(np.trapezoid(values, t) - exact) <= left + 1e-14
        assert left < 1e-2


def test_a_jump_between_two_instants_that_are_one_leaves_nothing() -> None:
    t, values = np.array([0.0, 1.0, 1.0, 2.0]), np.array([1.0, 1.0, 5.0, 5.0])
    assert rise_between(t, values) == left_of_trapezia(t, values) == 0.0
