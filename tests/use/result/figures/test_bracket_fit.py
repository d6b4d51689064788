"""Polynomials through the values of a curve: where its extremes and crossings are, and when not to ask them."""

import math

import numpy as np
import pytest

from pinarm.use.result.figures.bracket_fit import BracketFit


def fit(curve, low, high):
    return BracketFit(low, high, curve(BracketFit.places(low, high)))


def test_extremes_and_crossings_of_a_sine_are_known_to_rounding():
    found = fit(np.sin, 2.0, 8.0)
    assert found.is_resolved
    assert found.extremes == pytest.approx([1.5 * math.pi, 2.5 * math.pi], abs=1e-7)
    assert found.crossings() == pytest.approx([math.pi, 2 * math.pi], abs=1e-7)
    # the series of a sine of half the width w ends with the Bessel function J_17(w)
    assert found.at(np.linspace(2.0, 8.0, 50)) == pytest.approx(np.sin(np.linspace(2.0, 8.0, 50)), abs=1e-7)


def test_its_slope_is_that_of_the_curve():
    assert fit(np.exp, 0.0, 1.0).slope(0.3) == pytest.approx(math.exp(0.3), rel=1e-13)


def test_the_ends_are_places_and_exact():
    places = BracketFit.places(0.1, 0.3)
    assert (places[0], places[-1]) == (0.1, 0.3)


@pytest.mark.parametrize("curve", [np.abs, lambda t: np.maximum(t, 0.1), lambda t: np.sin(60 * t), np.zeros_like])
def test_kinks_waves_between_the_points_and_constants_are_not_resolved(curve):
    assert not fit(curve, -1.0, 1.1).is_resolved


def test_small_kinks_count_against_how_far_the_curve_varies():
    """As those between steps of an integrator: of 1e-12 they decide nothing, of 1e-4 they do."""
    bent = lambda size: lambda t: np.cos(t) + size * np.abs(t - 0.01)  # noqa: E731
    assert fit(bent(1e-12), -0.1, 0.1).is_resolved
    assert not fit(bent(1e-4), -0.1, 0.1).is_resolved
