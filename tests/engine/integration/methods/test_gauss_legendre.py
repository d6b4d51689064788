"""Collocation at Gauss's nodes integrates powers as they are."""

import numpy as np
import pytest

from pinarm.engine.integration.methods.gauss_legendre import gauss, legendre


@pytest.mark.parametrize("s", [1, 2, 5, 16])
def test_powers_are_integrated_exactly(s: int) -> None:
    nodes = gauss(s)
    for k in range(2 * s):  # the weights, to twice the number of nodes
        assert nodes.b @ nodes.c**k == pytest.approx(1.0 / (k + 1), rel=1e-13)
    for k in range(s):
        assert nodes.a @ nodes.c**k == pytest.approx(nodes.c ** (k + 1) / (k + 1), abs=1e-14)


def test_two_nodes_are_those_of_hammer_and_hollingsworth() -> None:
    root = np.sqrt(3.0) / 6.0
    assert gauss(2).c == pytest.approx([0.5 - root, 0.5 + root], abs=1e-16)
    assert gauss(2).a == pytest.approx(np.array([[0.25, 0.25 - root], [0.25 + root, 0.25]]), abs=1e-15)


@pytest.mark.parametrize("s", [2, 5, 16])
def test_all_forms_of_the_polynomial_have_its_values(s: int) -> None:
    nodes, x = gauss(s), np.linspace(0.0, 1.0, 7)
    values, integrals = legendre(x, s)
    f = np.exp(nodes.c)
    series = nodes.series @ f
    polynomial = np.polynomial.Polynomial(nodes.powers @ series)
    assert polynomial(2.0 * x - 1.0) == pytest.approx(values @ series, rel=1e-10)
    primitive = polynomial.integ(lbnd=-1.0)
    assert integrals @ series == pytest.approx(0.5 * primitive(2.0 * x - 1.0), abs=1e-10)
    total = np.zeros_like(x)  # x (r_0 + (1 - x) (r_1 + x (r_2 + ...)))
    for k, term in reversed(list(enumerate(nodes.terms @ series))):
        total = (total + term) * (x if k % 2 == 0 else 1.0 - x)
    assert total == pytest.approx(integrals @ series, abs=1e-13)
