"""Condition of masses along free motions, against what has to leave it as it is."""

import numpy as np
import pytest

from pinarm.engine.checks.residuals import condition_along

N, NV = 4, 5

ROUNDED = 1e-4
"""Relative: a basis that mixes coordinates whose units are a million apart loses half of the digits of ``T^T M T``."""


@pytest.fixture
def mass() -> np.ndarray:
    """Mass matrices of N states, whose coordinates have units a thousand times apart."""
    random = np.random.default_rng(2)
    root = random.normal(size=(N, NV, NV)) * 10.0 ** random.uniform(-3.0, 3.0, NV)[:, None]
    return root @ root.swapaxes(1, 2)


@pytest.mark.parametrize("freedom", [1, 3])
def test_neither_the_basis_nor_units_have_a_part_in_the_condition(freedom: int, mass: np.ndarray) -> None:
    random = np.random.default_rng(freedom)
    free, units = random.normal(size=(N, NV, freedom)), 10.0 ** random.uniform(-2.0, 2.0, NV)
    found = condition_along(mass, free)
    turned = condition_along(mass, free @ random.normal(size=(N, freedom, freedom)))
    measured = condition_along(mass * np.outer(units, units), free / units[:, None])
    assert turned == pytest.approx(found, rel=ROUNDED)
    assert measured == pytest.approx(found, rel=ROUNDED)


def test_a_motion_without_mass_has_none(mass: np.ndarray) -> None:
    mass[2, :, 1] = mass[2, 1] = 0.0
    assert np.isinf(condition_along(mass, np.broadcast_to(np.eye(NV)[:, :3], (N, NV, 3))))
