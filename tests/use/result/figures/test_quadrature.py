"""Adaptive quadrature: against closed forms of polynomials, kinks, peaks and jumps, and against SciPy's."""

import math

import numpy as np
import pytest
from scipy.integrate import cubature

from pinarm.use.result.figures.quadrature import (
    GAUSS,
    KRONROD,
    NODES,
    PATIENCE,
    AllowedErrors,
    KnownValues,
    Panels,
    integrate,
)  # fmt: skip

ROUNDING = 1e-14
"""Of sums of some hundred terms of size 1."""


def integrals(f, low, high, relative=1e-10, absolute=1e-13, most=2000, known=()):
    """Return the integrals of functions ``f(t)``, shape (n, k), their bounds, and the numbers of points asked for.

    What is known of them are their values at points.
    """
    known = np.array(known)
    asked = []

    def at(t):
        asked.append(len(t))
        assert (np.diff(t) > 0.0).all()
        return f(t)

    bounds = np.array([low]), np.array([high])
    first = Panels.of(*bounds, f(Panels.points(*bounds)))
    width = first.values.shape[1]
    allowance = AllowedErrors(relative, absolute, 1.0, np.zeros(width))
    value, error = integrate(at, first, allowance, most, KnownValues(known, f(known).reshape(len(known), width)))
    return value, error, asked


class TestPanels:
    @pytest.mark.parametrize("degree", range(32))
    def test_kronrod_is_exact_to_degree_31(self, degree):
        exact = 0.0 if degree % 2 else 2.0 / (degree + 1)
        assert KRONROD @ NODES**degree == pytest.approx(exact, abs=ROUNDING)

    @pytest.mark.parametrize("degree", range(20))
    def test_gauss_is_exact_to_degree_19(self, degree):
        exact = 0.0 if degree % 2 else 2.0 / (degree + 1)
        assert GAUSS @ NODES**degree == pytest.approx(exact, abs=ROUNDING)


class TestSamples:
    """What known values tell of a narrow peak that no point of a panel sees."""

    @staticmethod
    def peak(width):
        return lambda t: 1.0 + np.exp(-(((t - 0.61803) / width) ** 2))[:, None], 2.0 + math.sqrt(math.pi) * width

    @pytest.mark.parametrize("width", [3e-3, 1e-3])
    def test_a_peak_that_they_see_is_integrated(self, width):
        f, exact = self.peak(width)
        assert integrals(f, -1.0, 1.0)[0] == pytest.approx([2.0], abs=1e-12)  # unseen
        value, error, _ = integrals(f, -1.0, 1.0, known=np.linspace(-1.0, 1.0, 2001))
        assert abs(value[0] - exact) <= error[0] + ROUNDING
        assert error[0] < 1e-9

    def test_what_they_confirm_takes_no_bisection(self):
        value, _, asked = integrals(
            lambda t: np.stack([np.exp(t), np.cos(t)], 1), -1.0, 2.0, known=np.linspace(-1, 2, 301)
        )
        assert value == pytest.approx([math.e**2 - 1 / math.e, math.sin(2) + math.sin(1)], rel=ROUNDING)
        assert not asked

    def test_what_they_cannot_resolve_ends(self):
        """One value apart from all others, as of noise or of a point."""
        noise = np.random.default_rng(3)
        known = np.linspace(-1.0, 1.0, 201)
        f = lambda t: np.ones((len(t), 1)) + (1e-3 * noise.normal(size=(len(t), 1)) if len(t) == 201 else 0.0)  # noqa: E731
        value, error, asked = integrals(f, -1.0, 1.0, known=known)
        assert value == pytest.approx([2.0], abs=1e-12)
        assert sum(asked) < 21 * 201 * 16
        assert error[0] < 1e-2

    def test_panels_that_are_out_tell_what_they_have_not_seen(self):
        f, exact = self.peak(1e-3)
        value, error, _ = integrals(f, -1.0, 1.0, most=2, known=np.linspace(-1.0, 1.0, 2001))
        assert abs(value[0] - exact) <= error[0]


class TestIntegrate:
    def test_smooth_functions_take_no_bisection(self):
        value, error, asked = integrals(lambda t: np.stack([np.exp(t), np.cos(t)], 1), -1.0, 2.0)
        assert value == pytest.approx([math.e**2 - 1 / math.e, math.sin(2) + math.sin(1)], rel=ROUNDING)
        assert not asked and (error < 1e-9).all()

    @pytest.mark.parametrize(
        ("f", "exact"),
        [
            (lambda t: abs(t - 0.3), 0.5 * (1.3**2 + 0.7**2)),
            (lambda t: np.sqrt(t + 1.0), 2.0 / 3.0 * 2.0**1.5),
            (lambda t: 1e-4 / (t**2 + 1e-8), 2.0 * math.atan(1e4)),
            (lambda t: (t > 0.2).astype(float), 0.8),
        ],
    )  # a kink, an infinite slope, a peak of width 1e-4, a jump
    def test_what_is_not_smooth_is_bisected_until_the_error_is_allowed(self, f, exact):
        value, error, asked = integrals(lambda t: f(t)[:, None], -1.0, 1.0)
        assert abs(value[0] - exact) <= error[0] + ROUNDING
        assert error[0] <= 1e-13 * 2.0 + 1e-10 * exact
        assert len(asked) <= 60

    @pytest.mark.parametrize(
        ("f", "exact", "beyond"),
        [
            (lambda t, p: np.cos(t) + (t > p), lambda p: math.sin(1.0) + 1.0 - p, 0.0),
            (lambda t, p: np.cos(t) + abs(t - p), lambda p: math.sin(1.0) + 0.5 * (p**2 + (1.0 - p) ** 2), 0.03),
            (lambda t, p: np.sqrt(abs(t - p)), lambda p: (p**1.5 + (1.0 - p) ** 1.5) / 1.5, 0.03),
        ],
    )
    def test_jumps_and_kinks_are_within_the_error_wherever_they_are(self, f, exact, beyond):
        """Jumps beside the ends of panels, which no node sees, too; of kinks, 99 of 100, and nearly."""
        random = np.random.default_rng(2)
        places = np.concatenate([random.uniform(0.0, 1.0, 150), 10.0 ** random.uniform(-6.0, -2.0, 50)])
        excess = []
        for p in places.tolist():
            value, error, _ = integrals(lambda t, p=p: f(t, p)[:, None], 0.0, 1.0, known=[0.0, 1.0])
            excess.append((abs(value[0] - exact(p)) - ROUNDING) / error[0])
        assert np.mean(np.array(excess) > 1.0) <= beyond

    def test_it_is_that_of_scipy(self):
        def f(t):
            return np.stack([np.abs(np.sin(7.0 * t)), np.sin(40.0 * t) ** 2], 1)

        value, error, _ = integrals(f, 0.0, 2.0)
        theirs = cubature(lambda t: f(t[:, 0]), [0.0], [2.0], rtol=1e-10, atol=2e-13)
        assert (abs(value - theirs.estimate) <= error + theirs.error + ROUNDING).all()

    def test_noise_ends_the_bisections(self):
        noise = np.random.default_rng(1)
        value, error, asked = integrals(lambda t: (1.0 + 1e-6 * noise.normal(size=len(t)))[:, None], 0.0, 1.0)
        assert value[0] == pytest.approx(1.0, abs=1e-6)
        assert 1e-9 < error[0] < 1e-5
        assert len(asked) <= PATIENCE + 1

    def test_it_ends_at_most_panels_and_says_what_error_is_left(self):
        _, error, asked = integrals(lambda t: np.sin(1e5 * t)[:, None] ** 2, 0.0, 1.0, most=64)
        assert error[0] > 1e-3
        assert sum(asked) <= 21 * 2 * 2 * 64


@pytest.mark.parametrize("most", [4, 2000])
def test_parts_of_a_short_interval_far_from_zero_have_points_that_differ(most):
    """A step within 1e-9 about 1000, of which there are 8796 numbers: it is known to some of them."""
    low, high = 1000.0, 1000.0 + 1e-9
    step = low + 0.3 * (high - low)
    (value,), (error,), _ = integrals(lambda t: (t > step)[:, None].astype(float), low, high, most=most)
    assert abs(value - (high - step)) <= error
    assert error < 0.1 * (high - low)


@pytest.mark.parametrize(("teeth", "power"), [(66.92891674401906, 3), (70.42252456449205, 2)])
def test_jumps_that_panels_do_not_suffice_for_are_no_poles(teeth, power):
    """``(n t mod 1)^p``: towards a jump one side falls and the other does not: together they look like a pole."""
    (value,), (error,) = integrals(lambda t: np.mod(teeth * t, 1.0)[:, None] ** power, 0.0, 1.0, most=200)[:2]
    whole, rest = divmod(teeth, 1.0)
    assert abs(value - (whole + rest ** (power + 1)) / (power + 1) / teeth) <= error < math.inf


def test_the_error_of_jumps_between_panels_does_not_hang_on_rounding():
    """Jumps from 0.64 to 1 at places where panels meet, and 2e-16 of noise: too few panels to enclose them all.

    Of 240 panels 14 cut the interval into eighths, and the others halve the 14 beside the jumps 8 times. A jump may
    hide beyond the outer nodes, in 0.22 % of the panel on either side of it.
    """
    told = []
    for seed in range(8):
        noise = np.random.default_rng(seed)

        def f(t, noise=noise):
            steps = np.where(np.mod(4.0 * t, 1.0) < 0.5, 0.64, 1.0)
            return (steps * (1.0 + 1e-16 * noise.normal(size=len(t))))[:, None]

        (value,), (error,), _ = integrals(f, 0.0, 1.0, most=240)
        assert abs(value - 0.82) <= error + ROUNDING
        told.append(error)
    assert max(told) <= 14 * 0.0022 * 0.36 * 0.125 / 2**7
    assert max(told) == pytest.approx(min(told), rel=1e-6)
