import numpy as np
import pytest
from scipy.integrate import RK45
from scipy.integrate._ivp import dop853_coefficients as scipy_coefficients

from pinarm.engine.integration.integrator import interpolated
from pinarm.engine.integration.runge_kutta import DOP853, DOPRI5, RK4, middle


def test_coefficients_are_those_of_scipy_bit_for_bit():
    a, s = scipy_coefficients.A, 12
    assert np.array_equal(DOP853.a, a[:s, :s])
    assert np.array_equal(DOP853.b, scipy_coefficients.B)
    assert np.array_equal(DOP853.c, scipy_coefficients.C[:s])
    assert np.array_equal(DOP853.error, [scipy_coefficients.E5, scipy_coefficients.E3])
    assert np.array_equal(DOP853.dense_a, a[s + 1 :])
    assert np.array_equal(DOP853.dense_c, scipy_coefficients.C[s + 1 :])
    assert np.array_equal(DOP853.dense_d, scipy_coefficients.D)


def test_coefficients_of_the_pair_of_order_five_are_those_of_scipy():
    assert DOPRI5.a[:, :5] == pytest.approx(RK45.A, abs=1e-14)
    assert DOPRI5.b == pytest.approx(RK45.B, abs=1e-14)
    assert DOPRI5.c == pytest.approx(RK45.C, abs=1e-14)
    assert DOPRI5.error[0] == pytest.approx(-RK45.E, abs=1e-14)


@pytest.mark.parametrize("tableau", [DOP853, DOPRI5, RK4], ids=lambda one: one.name)
def test_methods_are_stable_up_to_the_limit_that_they_give_and_not_far_beyond(tableau):
    """R(z) = 1 + z b (1 - z a)^-1 1 on the negative real axis."""

    def growth(z):
        s = tableau.stages
        return abs(1 + z * tableau.b @ np.linalg.solve(np.eye(s) - z * tableau.a, np.ones(s)))

    assert max(growth(-x) for x in np.linspace(0.01, tableau.stability, 200)) <= 1.0
    assert growth(-1.06 * tableau.stability) > 1.0


def test_change_and_slope_in_the_middle_are_those_of_the_polynomial():
    y, terms, apart = np.zeros((3, 2)), np.random.default_rng(0).normal(size=(1, 7, 2)), 1e-5
    places = np.zeros(3, np.intp)
    before, here, after = interpolated(y, terms[places], 0.5 + apart * np.array([-1.0, 0.0, 1.0]))
    change, slope = middle(terms)
    assert change[0] == pytest.approx(here, abs=1e-14)
    assert slope[0] == pytest.approx((after - before) / (2.0 * apart), abs=1e-8)  # of differences
