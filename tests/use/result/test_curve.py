"""Numbers of curves: against closed forms of smooth curves, spikes, kinks, cusps, jumps and poles, and against
SciPy."""

import math
from collections.abc import Callable
from math import exp, pi, sin

import numpy as np
import pytest

from pinarm.arrays import Array
from pinarm.use.result import curve as curve_module
from pinarm.use.result.curve import (
    NODES,
    TO_COEFFICIENTS,
    WEIGHTS,
    Curve,
    Endless,
    Peak,
    Span,
    percentile,
    zeros_of_angle,
)
from pinarm.use.result.curve import zeros as zeros_of

ROUNDING = 1e-14
"""Of sums of some hundred terms of size 1."""


def curve_of(
    f: Callable[[Array], Array],
    low: float = 0.0,
    high: float = 1.0,
    parts: int = 4,
    known: Array | tuple[float, ...] = (),
) -> tuple[Curve, list[int]]:
    """Return functions ``f(t)``, shape (n,) or (n, k), as a curve, and the list of the numbers of points asked for."""
    asked = list[int]()

    def values(spots):
        asked.extend(len(t) for _, t in spots)
        return [f(t) for _, t in spots]

    rows, nothing = np.array(known), np.empty(0)
    width = f(np.array([low])).size
    span = Span(0, np.linspace(low, high, parts + 1), *(nothing,) * 2, rows, f(rows).reshape(len(rows), width))
    return Curve(values, [span]), asked


def test_polynomials_are_integrated_exactly_and_resolved_functions_known_to_rounding():
    for degree in range(17):
        assert WEIGHTS @ NODES**degree == pytest.approx(0.0 if degree % 2 else 2.0 / (degree + 1), abs=ROUNDING)
    coefficients = TO_COEFFICIENTS @ np.cos(5.0 * np.arccos(NODES))
    assert coefficients == pytest.approx(np.eye(17)[5], abs=ROUNDING)


# Integrals


def integrals(f, low, high, parts=1, known=(), most=2000):
    """Return the integrals of functions, their bounds, and the numbers of points asked for."""
    curve, asked = curve_of(f, low, high, parts, known)
    return *curve_module.integrals(curve, 1.0, most), asked


@pytest.mark.parametrize(
    ("f", "exact"),
    [
        (lambda t: abs(t - 0.3), 0.5 * (1.3**2 + 0.7**2)),
        (lambda t: np.sqrt(t + 1.0), 2.0 / 3.0 * 2.0**1.5),
        (lambda t: 1e-4 / (t**2 + 1e-8), 2.0 * math.atan(1e4)),
        (lambda t: (t > 0.2).astype(float), 0.8),
    ],
)  # a kink, an infinite slope, a peak of width 1e-4, a jump
def test_what_is_not_smooth_is_halved_until_the_error_is_allowed(f, exact):
    value, error, asked = integrals(f, -1.0, 1.0)
    assert abs(value[0] - exact) <= error[0] + ROUNDING
    assert error[0] <= 1e-13 * 2.0 + 1e-10 * exact
    assert sum(asked) <= 17 * 120 + 20


@pytest.mark.parametrize(
    ("f", "exact", "beyond"),
    [
        (lambda t, p: np.cos(t) + (t > p), lambda p: math.sin(1.0) + 1.0 - p, 0.0),
        (lambda t, p: np.cos(t) + abs(t - p), lambda p: math.sin(1.0) + 0.5 * (p**2 + (1.0 - p) ** 2), 0.03),
        (lambda t, p: np.sqrt(abs(t - p)), lambda p: (p**1.5 + (1.0 - p) ** 1.5) / 1.5, 0.03),
    ],
)
def test_jumps_and_kinks_are_within_the_error_wherever_they_are(f, exact, beyond):
    """Jumps beside the ends of pieces, too; of kinks, 97 of 100."""
    random = np.random.default_rng(2)
    places = np.concatenate([random.uniform(0.0, 1.0, 45), 10.0 ** random.uniform(-6.0, -2.0, 15)])
    excess = []
    for p in places.tolist():
        value, error, _ = integrals(lambda t, p=p: f(t, p), 0.0, 1.0, known=[0.0, 1.0])
        excess.append((abs(value[0] - exact(p)) - ROUNDING) / error[0])
    assert np.mean(np.array(excess) > 1.0) <= beyond


def test_noise_is_in_the_error():
    noise = np.random.default_rng(1)
    value, error, _ = integrals(lambda t: 1.0 + 1e-6 * noise.normal(size=len(t)), 0.0, 1.0)
    assert value[0] == pytest.approx(1.0, abs=1e-6)
    assert 1e-9 < error[0] < 1e-5


# Percentiles

DWELL = 0.3
"""Where a curve begins to rise that is 0 before."""

CLOSED_FORMS: list[tuple[str, Callable[[Array], Array], float, float]] = [
    ("rising", np.exp, 0.7, exp(0.7)),
    ("falling", lambda t: np.exp(-t), 0.7, exp(-0.3)),
    ("there and back", lambda t: np.sin(pi * t), 0.95, sin(0.95 * pi / 2)),
    ("many turns", lambda t: np.sin(40 * pi * t), 0.75, sin(pi / 4)),
    ("kink", lambda t: np.abs(t - 1 / 3), 0.5, 0.25),
    ("kink", lambda t: np.abs(t - 1 / 3), 0.9, 2 / 3 - 0.1),
    ("dwell", lambda t: np.maximum(t - DWELL, 0.0), 0.2, 0.0),
    ("dwell", lambda t: np.maximum(t - DWELL, 0.0), 0.8, 0.5),
    ("jump within", lambda t: np.where(t < 0.377, 1.0 + t, 5.0 + t), 0.9, 5.9),
    ("root", np.sqrt, 0.5, 0.5**0.5),
    ("least", lambda t: np.cos(3 * t), 0.0, float(np.cos(3.0))),
    ("least within", lambda t: (t - 0.5) ** 2, 0.0, 0.0),
    ("rest at last", lambda t: np.maximum(0.3 - t, 0.0) ** 2, 0.0, 0.0),
    ("largest", lambda t: np.cos(3 * t - 1), 1.0, 1.0),
]


@pytest.mark.parametrize(("name", "f", "share", "value"), CLOSED_FORMS)
def test_percentiles_are_those_of_closed_forms_within_their_errors(name, f, share, value):
    found, error = percentile(curve_of(f)[0], share, 2000)
    # rounding of values of the size of 1 to 6, and of the roots that end the lengths
    assert abs(found - value) <= error + 1e-13
    assert error < 1e-8


# Extremes


def highest(f, low=0.0, high=3.0):
    """Return the top of a function, looked into in four parts, and at how many places it was evaluated."""
    curve, asked = curve_of(f, low, high, known=np.linspace(low, high, 12))
    asked.clear()
    return curve_module.highest(curve, 1.0, Peak(float(f(np.array([1.5]))[0]), 0, 1.5), 1e-12), sum(asked)


@pytest.mark.parametrize(
    ("f", "value", "slack", "most"),
    [
        (lambda t: np.sin(t), 1.0, 1e-14, 100),  # four pieces of 17, and one more
        (lambda t: np.sin(40.0 * t) + 1e-2 * t, None, 1e-12, 1500),
        (lambda t: np.sin(t) + 5.0 / (1.0 + ((t - 0.5123) / 4e-3) ** 2), math.sin(0.5123) + 5.0, 1e-6, 1000),
        (lambda t: 1.0 / (1e-14 + (t - 0.7) ** 2), 1e14, 1e-2, 4000),
        (lambda t: -np.abs(np.sin(2.0 * t - 1.3)), 0.0, 1e-13, 4000),
        (lambda t: np.abs(t - 1.1), 1.9, 1e-14, 500),  # the kink is not where it is largest
        (lambda t: np.where(t < 1.234, t, t - 5.0), 1.234, 1e-12, 3200),
    ],
)
def test_the_largest_value_is_that_of_a_closed_form(f, value, slack, most):
    """The spike is narrower than the distance of the nodes; the one of 1e-7 is found by its flanks."""
    t = np.linspace(0.0, 3.0, 300_001)
    top, places = highest(f)
    expected = float(f(t).max()) if value is None else value
    assert abs(top.height - expected) <= max(slack * max(1.0, abs(expected)), 1e-6 if value is None else 0.0)
    assert places <= most


def test_a_cusp_is_told_with_what_its_place_leaves_open():
    """``-sqrt|t - 1.3|`` at a place that is known to 1e-14 is 1e-7 below its top."""
    top, _ = highest(lambda t: -np.sqrt(np.abs(t - 1.3)))
    assert -top.height <= 3.0 * top.error < 1e-4
    assert highest(np.sin)[0].error == 0.0


@pytest.mark.filterwarnings("ignore:divide by zero")
@pytest.mark.parametrize("place", [1.2345678, 0.75, 0.0, 2.9999])
@pytest.mark.parametrize(
    "f",
    [
        lambda x: 1.0 / x, lambda x: -1.0 / x, lambda x: np.abs(x) ** -0.5, lambda x: -np.log(np.abs(x)),
        lambda x: 2.0 + np.cos(x) + 1e-6 / np.abs(x),
    ],
)  # fmt: skip
def test_a_pole_has_no_largest_value_and_is_where_it_is(f, place):
    if place == 0.0 and f(np.array([1.0]))[0] == -1.0:
        return  # its pole is the lower end
    with pytest.raises(Endless) as caught:
        highest(lambda t: f(t - place))
    assert caught.value.place == pytest.approx(place, abs=1e-9)


def test_rounding_is_no_pole():
    """Values that are only noise, and ones with noise that grows towards a place as at a removable singularity."""
    noise = np.random.default_rng(1)
    assert 0.0 <= highest(lambda t: 1e-17 * np.abs(noise.standard_normal(len(t))))[0].height < 1e-16
    x = 1e-16
    assert highest(lambda t: 5.0 + x / (np.abs(t - 1.0) + 1e-15))[0].height < 5.2


# Zeros

ENDS = np.array([0.0, 1.0])


def zeros(f, places=ENDS, level=0.0, parts=4, *, angle=False):
    curve, _ = curve_of(f, parts=parts)
    return (zeros_of_angle if angle else zeros_of)(curve, 0, np.asarray(places), level)


def test_two_zeros_between_the_nodes_of_the_polynomial_are_found_by_the_extreme():
    """A parabola below zero on 2e-6 of the whole."""
    assert zeros(lambda t: (t - 0.3) ** 2 - 1e-12) == pytest.approx([0.3 - 1e-6, 0.3 + 1e-6], abs=1e-9)


@pytest.mark.parametrize(("swings", "level"), [(1, 0.25), (40, 0.3), (110, 0.9)])
def test_many_swings_between_two_places_are_all_seen(swings, level):
    """``sin(2 pi n t) = level`` twice in each of n swings, among 68 points."""
    first, turns = np.arcsin(level) / (2.0 * np.pi), np.arange(swings)
    exact = np.sort(np.concatenate([first % 1.0 + turns, (0.5 - first) % 1.0 + turns])) / swings
    assert zeros(lambda t: np.sin(2.0 * np.pi * swings * t), level=level) == pytest.approx(exact, abs=1e-13)


def test_what_touches_zero_is_one_place_a_kink_has_two_and_a_rest_its_ends():
    assert zeros(lambda t: (t - 0.3) ** 2) == pytest.approx([0.3], abs=1e-9)
    assert zeros(lambda t: np.abs(t - 0.4) - 0.1) == pytest.approx([0.3, 0.5], abs=1e-14)
    assert zeros(lambda t: 0.0 * t) == [0.0, 1.0]
    assert zeros(lambda t: np.cbrt(t - 0.3)) == pytest.approx([0.3], abs=1e-14)  # its slope is infinite


@pytest.mark.parametrize("f", [
    lambda t: np.angle(np.exp(1j * (2.0 + 3.0 * t))), lambda t: np.tan(1.0 + t),
    lambda t: np.where(t < 0.3, -1.0, 2.0),
])  # fmt: skip
def test_a_jump_over_zero_is_no_zero(f):
    """From 180 to -180 deg, at poles, and at a step."""
    assert zeros(f, np.linspace(0.0, 1.0, 8)) == []


@pytest.mark.parametrize("places", [2, 5, 40])
@pytest.mark.parametrize("value", [1.0, -np.pi, np.pi])
def test_an_angle_of_several_turns_is_where_it_is_however_few_places(places, value):
    """From -2 by 20 rad, counted and told between -180 and 180 deg, where half a turn is both of these."""
    t, turns = np.linspace(0.0, 1.0, places), 2.0 * np.pi * np.arange(-1, 4)
    counted = zeros(lambda t: -2.0 + 20.0 * t, t, value, angle=True)
    assert counted == pytest.approx([(value + 2.0) / 20.0] if value > -2.0 else [], abs=1e-14)
    every = (value + turns + 2.0) / 20.0
    around = zeros(lambda t: np.angle(np.exp(1j * (-2.0 + 20.0 * t))), t, value, angle=True)
    assert around == pytest.approx(every[(every >= 0.0) & (every <= 1.0)], abs=1e-9)
