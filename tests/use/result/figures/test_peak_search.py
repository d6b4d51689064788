"""Largest values by branch and bound: against closed forms of smooth curves, spikes, cusps, jumps and poles."""

import math
from itertools import pairwise

import numpy as np
import pytest

from pinarm.use.result.figures.bracket_fit import BracketFit
from pinarm.use.result.figures.peak_search import CurvePart, Endless, Peak, PeakSearch

LOW, HIGH = 0.0, 3.0


def search(curve):
    """Return the top of a curve from 0 to 3, looked into in four parts, and at how many places it was evaluated."""
    places = []

    def at(spots):
        places.extend(np.concatenate([t for _, t in spots]).tolist() if spots else [])
        return [curve(t) for _, t in spots]

    parts = [CurvePart(0, bracket) for bracket in pairwise(np.linspace(LOW, HIGH, 5).tolist())]
    start = Peak(-np.inf, 0, LOW)
    found = PeakSearch(at, lambda bracket, x: BracketFit(*bracket, x), 1e-12).highest(start, parts)
    return found, len(places)


@pytest.mark.parametrize(
    ("curve", "value", "slack", "most"),
    [
        (lambda t: np.sin(t), 1.0, 1e-14, 100),  # four pieces of 17, and one more
        (lambda t: np.sin(40.0 * t) + 1e-2 * t, None, 1e-12, 1500),
        (lambda t: np.sin(t) + 5.0 / (1.0 + ((t - 0.5123) / 4e-3) ** 2), math.sin(0.5123) + 5.0, 1e-6, 1000),
        (lambda t: 1.0 / (1e-14 + (t - 0.7) ** 2), 1e14, 1e-2, 4000),
        (lambda t: -np.abs(np.sin(2.0 * t - 1.3)), 0.0, 1e-13, 4000),
        (lambda t: np.abs(t - 1.1), 1.9, 1e-14, 500),  # the kink is not where it is largest
        (lambda t: np.where(t < 1.234, t, t - 5.0), 1.234, 1e-12, 2000),
    ],
)  # fmt: skip
def test_the_largest_value_is_that_of_a_closed_form(curve, value, slack, most):
    """The spike is narrower than the distance of the nodes; the one of 1e-7 is found by its flanks."""
    t = np.linspace(LOW, HIGH, 300_001)
    top, places = search(curve)
    expected = float(curve(t).max()) if value is None else value
    assert abs(top.height - expected) <= max(slack * max(1.0, abs(expected)), 1e-6 if value is None else 0.0)
    assert places <= most


def test_a_cusp_is_told_with_what_its_place_leaves_open():
    """``-sqrt|t - 1.3|`` at a place that is known to 1e-14 is 1e-7 below its top."""
    top, _ = search(lambda t: -np.sqrt(np.abs(t - 1.3)))
    assert -top.height <= 3.0 * top.error < 1e-6
    assert search(np.sin)[0].error == 0.0


@pytest.mark.filterwarnings("ignore:divide by zero")
@pytest.mark.parametrize("place", [1.2345678, 0.75, 0.0, 2.9999])
@pytest.mark.parametrize(
    "curve",
    [
        lambda x: 1.0 / x, lambda x: -1.0 / x, lambda x: 1.0 / np.abs(x), lambda x: x**-2.0,
        lambda x: np.abs(x) ** -0.5, lambda x: -np.log(np.abs(x)), lambda x: 2.0 + np.cos(x) + 1e-6 / np.abs(x),
    ],
)  # fmt: skip
def test_a_pole_has_no_largest_value_and_is_where_it_is(curve, place):
    if place == 0.0 and curve(np.array([1.0]))[0] == -1.0:
        return  # its pole is the lower end
    with pytest.raises(Endless) as caught:
        search(lambda t: curve(t - place))
    assert caught.value.place == pytest.approx(place, abs=1e-9)


@pytest.mark.filterwarnings("ignore:divide by zero")
def test_a_pole_below_is_none_above():
    assert search(lambda t: -((t - 1.1) ** -2.0))[0].height == pytest.approx(-(1.9**-2), rel=1e-14)
    assert search(lambda t: np.log(np.abs(t)))[0].height == pytest.approx(math.log(3.0), rel=1e-14)


def test_rounding_is_no_pole():
    """Values that are only noise, and ones with noise that grows towards a place as at a removable singularity."""
    noise = np.random.default_rng(1)
    assert 0.0 <= search(lambda t: 1e-17 * np.abs(noise.standard_normal(len(t))))[0].height < 1e-16
    x = 1e-16
    assert search(lambda t: 5.0 + x / (np.abs(t - 1.0) + 1e-15))[0].height < 5.2


UNSEEN = (0.318309886, 1.7724538, 2.5066)
"""Places of curves that no threshold was chosen by: 1/pi, the roots of pi and of 2 pi."""


@pytest.mark.parametrize("place", UNSEEN)
def test_other_curves_have_their_largest_values(place):
    """Powers of the distance are cusps; the tops of bells of 1/10 to 1/300 of the run are 1 but for their place."""
    for power in (0.25, 0.5, 1.0, 1.5):
        top, _ = search(lambda t, p=power: -(np.abs(t - place) ** p))
        assert -top.height <= 4.0 * top.error + 1e-12
    for width in (0.3, 0.1, 0.03, 0.01):
        assert search(lambda t, w=width: np.exp(-(((t - place) / w) ** 2)))[0].height == pytest.approx(1.0, abs=1e-6)
        assert search(lambda t, w=width: 1.0 / (1.0 + ((t - place) / w) ** 2))[0].height == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("place", UNSEEN)
@pytest.mark.parametrize(
    "curve",
    [lambda x: np.abs(x) ** -1.5, lambda x: np.abs(x) ** -3.0, lambda x: np.cos(x) / x,
     lambda x: -np.log(np.abs(x)) * (2.0 + np.sin(x))],
)  # fmt: skip
def test_other_poles_have_none(curve, place):
    with pytest.raises(Endless):
        search(lambda t: curve(t - place))
