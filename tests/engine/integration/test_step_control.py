"""The law of step lengths: where it settles, within which bounds, alike for numbers and arrays."""

import math

import numpy as np
import pytest

from pinarm.engine.integration.step_control import FASTEST, LOST, SLOWEST, growth, shrinkage

ORDER = 8


def test_steps_settle_where_the_error_is_a_share_of_the_tolerance() -> None:
    """With an error ``c h^8`` the factor is 1 where ``0.8 e^(-0.1) = 1``: at ``e = 0.8^10``, whatever c."""
    for c in (1e-6, 1.0, 1e6):
        h = c ** (-1.0 / ORDER)
        for _ in range(200):
            h *= growth(c * h**ORDER, ORDER, FASTEST)
        assert c * h**ORDER == pytest.approx(0.8**10, rel=1e-9)


def test_a_refused_step_is_tried_where_its_error_would_be_well_below_the_tolerance() -> None:
    """An error ``c h^8`` of 3 becomes ``0.8^8``."""
    assert 3.0 * shrinkage(3.0, ORDER) ** ORDER == pytest.approx(0.8**8, rel=1e-12)


def test_steps_change_within_bounds() -> None:
    assert growth(0.0, ORDER, FASTEST) == FASTEST
    assert growth(0.0, ORDER, 1.0) == 1.0
    assert shrinkage(1e200, ORDER) == SLOWEST
    assert LOST < SLOWEST < 1.0 < FASTEST


def test_many_motions_are_each_as_alone() -> None:
    errors = np.array([0.0, 1e-9, 0.3, 1.0])
    ceilings = np.array([FASTEST, 1.0, FASTEST, FASTEST])
    together = growth(errors, ORDER, ceilings, np.minimum, np.maximum)
    alone = [growth(float(e), ORDER, float(c)) for e, c in zip(errors, ceilings, strict=True)]
    assert together == pytest.approx(alone, rel=1e-14)
    refused = np.array([1.1, 7.0, 1e40])
    assert shrinkage(refused, ORDER, np.maximum) == pytest.approx([shrinkage(float(e), ORDER) for e in refused])
    assert all(math.isfinite(x) for x in together)
