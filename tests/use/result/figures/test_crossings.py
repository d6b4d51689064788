"""Zeros of curves by hand: between few places, twice between two of them, touched, and at a kink."""

import numpy as np
import pytest

from pinarm.use.result.figures.crossings import crossings, crossings_of_angle

ENDS = np.array([0.0, 1.0])


@pytest.mark.parametrize("level", [0.25, 0.5, -0.999])
def test_a_curve_that_comes_and_goes_between_two_places(level):
    """``sin(2 pi t) = level`` twice, where both places are zeros of the sine."""
    found = crossings(lambda t: np.sin(2.0 * np.pi * t) - level, ENDS, 4)
    first = np.arcsin(level) / (2.0 * np.pi)
    assert found == pytest.approx(sorted([first % 1.0, 0.5 - first]), abs=1e-14)


def test_two_zeros_between_the_nodes_of_the_polynomial_are_found_by_the_extreme():
    """A parabola below zero on 2e-6 of the whole."""
    found = crossings(lambda t: (t - 0.3) ** 2 - 1e-12, ENDS, 4)
    assert found == pytest.approx([0.3 - 1e-6, 0.3 + 1e-6], abs=1e-9)


@pytest.mark.parametrize(("swings", "level"), [(40, 0.3), (100, -0.9), (110, 0.9)])
def test_many_swings_between_two_places_are_all_seen(swings, level):
    """``sin(2 pi n t) = level`` twice in each of n swings, among 68 points."""
    found = crossings(lambda t: np.sin(2.0 * np.pi * swings * t) - level, ENDS, 4)
    first = np.arcsin(level) / (2.0 * np.pi)
    turns = np.arange(swings)
    exact = np.sort(np.concatenate([first % 1.0 + turns, (0.5 - first) % 1.0 + turns])) / swings
    assert found == pytest.approx(exact, abs=1e-13)


def test_what_touches_zero_is_one_place():
    assert crossings(lambda t: (t - 0.3) ** 2, ENDS, 4) == pytest.approx([0.3], abs=1e-9)


def test_places_that_descend_give_zeros_that_do():
    found = crossings(lambda t: np.cos(3.0 * np.pi * t), ENDS[::-1], 4)
    assert found == pytest.approx([5.0 / 6.0, 0.5, 1.0 / 6.0], abs=1e-14)


def test_a_kink_is_bisected_and_a_rest_is_two_places():
    assert crossings(lambda t: np.abs(t - 0.4) - 0.1, ENDS, 4) == pytest.approx([0.3, 0.5], abs=1e-14)
    assert crossings(lambda t: 0.0 * t, ENDS, 4) == [0.0, 1.0]


@pytest.mark.parametrize("curve", [
    lambda t: np.angle(np.exp(1j * (2.0 + 3.0 * t))), lambda t: np.tan(1.0 + t),
    lambda t: np.where(t < 0.3, -1.0, 2.0),
])  # fmt: skip
@pytest.mark.parametrize("parts", [0, 4])
def test_a_jump_over_zero_is_no_zero(curve, parts):
    """From 180 to -180 deg, at poles, and at a step."""
    assert crossings(curve, np.linspace(0.0, 1.0, 8), parts) == []


def test_a_steep_zero_is_one():
    """A cube root, whose slope is infinite."""
    assert crossings(lambda t: np.cbrt(t - 0.3), ENDS, 4) == pytest.approx([0.3], abs=1e-14)


def test_an_end_that_is_reached_within_rounding_before_is_reached_once():
    """``x = 1 - (1 - t)^3`` is 1 but for rounding from 5e-6 before its end on, with its signs of the rounding."""
    noise = np.random.default_rng(1)
    found = crossings(lambda t: -((1.0 - t) ** 3) + np.where(t < 1.0, 1e-16 * noise.normal(size=len(t)), 0.0),
                      np.append(np.linspace(0.0, 0.9999, 20), [1.0 - 1e-6, 1.0]))  # fmt: skip
    assert found == [1.0]


def wrapped(angle):
    return np.angle(np.exp(1j * angle))


@pytest.mark.parametrize("places", [2, 3, 5, 40])
@pytest.mark.parametrize("value", [1.0, -np.pi, np.pi])
def test_an_angle_of_several_turns_is_where_it_is_however_few_places(places, value):
    """From -2 by 20 rad, counted and told between -180 and 180 deg, where half a turn is both of these."""
    t, turns = np.linspace(0.0, 1.0, places), 2.0 * np.pi * np.arange(-1, 4)
    counted = crossings_of_angle(lambda t: -2.0 + 20.0 * t - value, t, 4)
    assert counted == pytest.approx([(value + 2.0) / 20.0] if value > -2.0 else [], abs=1e-14)
    every = (value + turns + 2.0) / 20.0
    around = crossings_of_angle(lambda t: wrapped(-2.0 + 20.0 * t) - value, t, 4)
    assert around == pytest.approx(every[(every >= 0.0) & (every <= 1.0)], abs=1e-9)
    back = crossings_of_angle(lambda t: wrapped(-2.0 + 20.0 * t) - value, t[::-1], 4)
    assert back == pytest.approx(around[::-1], abs=1e-9)


def test_a_whole_turn_from_half_a_turn_ends_at_half_a_turn():
    """A counted angle from -180 to 180 deg is 180 deg at its end only."""
    assert crossings_of_angle(lambda t: 2.0 * np.pi * (t - 1.0), ENDS, 4) == [1.0]
