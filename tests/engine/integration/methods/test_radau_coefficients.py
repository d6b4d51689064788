"""Radau IIA methods: the published coefficients of order 5, and the conditions of order of all."""

import numpy as np
import pytest

from pinarm.engine.integration.methods.stiff import radau


def test_three_stages_are_those_of_hairer_and_wanner() -> None:
    """Solving Ordinary Differential Equations II, table IV.5.6."""
    r = np.sqrt(6.0)
    c = [(4 - r) / 10, (4 + r) / 10, 1.0]
    a = [
        [(88 - 7 * r) / 360, (296 - 169 * r) / 1800, (-2 + 3 * r) / 225],
        [(296 + 169 * r) / 1800, (88 + 7 * r) / 360, (-2 - 3 * r) / 225],
        [(16 - r) / 36, (16 + r) / 36, 1 / 9],
    ]
    assert radau(3).c == pytest.approx(c, abs=1e-14)
    assert radau(3).a == pytest.approx(np.array(a), abs=1e-14)
    # of the inverse of a: 3.6378..., eq. (IV.8.14)
    assert radau(3).eigenvalues[0] == pytest.approx(3.0 + 3.0 ** (2 / 3) - 3.0 ** (1 / 3), rel=1e-13)
