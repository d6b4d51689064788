import numpy as np
import pytest
from scipy.integrate import RK45
from scipy.integrate._ivp import dop853_coefficients as scipy_coefficients

from pinarm.engine.integration.integrator import interpolated
from pinarm.engine.integration.runge_kutta import DOP853, DOPRI5, RK4, dense_terms


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


@pytest.mark.parametrize("tableau", [DOP853, DOPRI5], ids=lambda one: one.name)
def test_the_last_term_is_the_defect_of_the_dense_output_in_the_middle_of_a_step(tableau):
    """``h (f(u) - u')`` with u' by differences, of ``y' = A y``, in a step that is much too long."""
    matrix, y, h = np.array([[0.0, 1.0], [-1.0, -2.5]]), np.array([[1.0, 0.5]]), 2.0
    slopes = []
    for row in [*tableau.a, tableau.b]:
        slopes.append((y[0] + h * sum(w * k for w, k in zip(row, slopes, strict=False))) @ matrix.T)
    here = np.zeros(1), np.array([h]), y, np.array([slopes])
    terms = dense_terms(tableau.examined, lambda t, y: y @ matrix.T, *here)
    apart, places = 1e-5, np.zeros(3, np.intp)
    before, middle, after = interpolated(y[places], terms[places, :-1], 0.5 + apart * np.array([-1.0, 0.0, 1.0]))
    defect = h * middle @ matrix.T - (after - before) / (2.0 * apart)
    assert np.abs(defect).max() > 1e-4
    assert terms[0, -1] == pytest.approx(defect, abs=1e-8)  # of differences
