"""Zeros of curves by hand: between few places, twice between two of them, touched, and at a kink."""

import numpy as np
import pytest

from pinarm.use.result.figures.crossings import crossings

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


def test_what_touches_zero_is_one_place():
    assert crossings(lambda t: (t - 0.3) ** 2, ENDS, 4) == pytest.approx([0.3], abs=1e-9)


def test_places_that_descend_give_zeros_that_do():
    found = crossings(lambda t: np.cos(3.0 * np.pi * t), ENDS[::-1], 4)
    assert found == pytest.approx([5.0 / 6.0, 0.5, 1.0 / 6.0], abs=1e-14)


def test_a_kink_is_bisected_and_a_rest_is_two_places():
    assert crossings(lambda t: np.abs(t - 0.4) - 0.1, ENDS, 4) == pytest.approx([0.3, 0.5], abs=1e-14)
    assert crossings(lambda t: 0.0 * t, ENDS, 4) == [0.0, 1.0]
