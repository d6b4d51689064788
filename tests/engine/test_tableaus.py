import dataclasses

import numpy as np
import pytest
from scipy.integrate._ivp import dop853_coefficients as scipy_coefficients

from pinarm.engine.tableaus import DOP853


def test_coefficients_are_those_of_scipy_bit_for_bit():
    a, s = scipy_coefficients.A, 12
    assert np.array_equal(DOP853.a, a[:s, :s])
    assert np.array_equal(DOP853.b, scipy_coefficients.B)
    assert np.array_equal(DOP853.c, scipy_coefficients.C[:s])
    assert np.array_equal(DOP853.error, [scipy_coefficients.E5, scipy_coefficients.E3])
    assert np.array_equal(DOP853.dense_a, a[s + 1 :])
    assert np.array_equal(DOP853.dense_c, scipy_coefficients.C[s + 1 :])
    assert np.array_equal(DOP853.dense_d, scipy_coefficients.D)


@pytest.mark.parametrize("power", range(8))
def test_quadrature_conditions_hold_up_to_order_eight(power):
    # sums of twelve terms of up to 6
    assert DOP853.b @ DOP853.c**power == pytest.approx(1 / (power + 1), abs=1e-14)


def test_quadrature_conditions_end_there():
    assert abs(DOP853.b @ DOP853.c**8 - 1 / 9) > 1e-6


@pytest.mark.parametrize("field", ["a", "b", "c", "error", "dense_a", "dense_c"])
def test_a_wrong_digit_is_found(field):
    tampered = getattr(DOP853, field).copy()
    place = tuple(0 if field == "error" else size - 1 for size in tampered.shape)
    place = (11, 3) if field == "a" else place
    tampered[place] += 1e-9
    with pytest.raises(ValueError, match=r"Dormand-Prince 8\(5,3\)"):
        dataclasses.replace(DOP853, **{field: tampered})


def test_an_implicit_tableau_is_refused():
    tampered = DOP853.a.copy()
    tampered[3, 3], tampered[3, 2] = 0.1, tampered[3, 2] - 0.1
    with pytest.raises(ValueError, match="a stage uses a later one"):
        dataclasses.replace(DOP853, a=tampered)


def test_it_knows_its_stages():
    assert (DOP853.stages, DOP853.order, DOP853.error_order) == (12, 8, 7)
