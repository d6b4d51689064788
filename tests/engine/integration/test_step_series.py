"""Series within a step are the polynomials whose values they are made of."""

import numpy as np
import pytest

from pinarm.engine.integration.step_series import FINE, fine_values, nodes, series_of


@pytest.mark.parametrize("parts", [2, 4])
def test_a_polynomial_of_the_degree_of_the_nodes_is_its_own_series(parts):
    weights = np.random.default_rng(parts).normal(size=(3, 2 * parts + 1))
    polynomials = [np.polynomial.Polynomial(row, domain=[0.0, 1.0]) for row in weights]
    values = np.array([polynomial(nodes(parts)) for polynomial in polynomials])
    exact = np.array([polynomial(np.linspace(0.0, 1.0, FINE)) for polynomial in polynomials])
    assert fine_values(values) == pytest.approx(exact, abs=1e-12)
    coefficients = [
        p.convert(kind=np.polynomial.Chebyshev, domain=[0.0, 1.0], window=[-1.0, 1.0]).coef for p in polynomials
    ]
    assert series_of(values) == pytest.approx(np.array(coefficients), abs=1e-12)
