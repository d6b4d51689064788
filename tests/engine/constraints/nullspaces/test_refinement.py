"""Multipliers of very different sizes against those that the forces were made of."""

import numpy as np
import pytest

from pinarm.engine.constraints.nullspaces.dense_nullspace import RowDecomposition
from pinarm.engine.constraints.nullspaces.independent_rows import IndependentRows
from pinarm.engine.constraints.nullspaces.nullspace import RowDecompositions, split_rows

GENERATOR = np.random.default_rng(3)
PAIRS = 10
"""Linkages of two rows and two joints each, all on one crank."""


def on_one_crank(states: int, pairs: int) -> np.ndarray:
    """Return G, shape (states, 2 pairs, 1 + 2 pairs): joint 0 is in all rows."""
    rows = np.zeros((states, 2 * pairs, 1 + 2 * pairs))
    rows[:, :, 0] = GENERATOR.uniform(0.5, 1.0, (states, 2 * pairs))
    for k in range(0, 2 * pairs, 2):
        rows[:, k : k + 2, k + 1 : k + 3] = np.eye(2) + 0.3 * GENERATOR.normal(size=(states, 2, 2))
    return rows


@pytest.mark.parametrize("pairs", [2, PAIRS])  # singular values, and orthogonal elimination of many rows
@pytest.mark.parametrize("ratio", [1.0, 1e-6, 1e-12, 1e-15])
def test_each_is_known_to_its_own_rounding(ratio: float, pairs: int) -> None:
    rows = on_one_crank(4, pairs)
    exact = GENERATOR.uniform(1.0, 2.0, (4, 2 * pairs)) * np.repeat(np.geomspace(1.0, ratio, pairs), 2)
    force = np.vecmat(exact, rows)
    parts = RowDecompositions.of(rows).parts
    assert {type(split) for _, split in parts} == {RowDecomposition if pairs == 2 else IndependentRows}
    found = RowDecompositions.of(rows).multipliers(force)
    assert found / exact == pytest.approx(np.ones_like(exact), abs=1e-11)
    assert split_rows(rows[0]).multipliers(force[0]) / exact[0] == pytest.approx(np.ones(2 * pairs), abs=1e-11)


def test_what_multipliers_cannot_hold_is_left_in_the_sense_of_least_squares() -> None:
    rows, force = on_one_crank(1, 2)[0], GENERATOR.normal(size=5)
    assert split_rows(rows).multipliers(force) == pytest.approx(np.linalg.lstsq(rows.T, force)[0], abs=1e-13)


def test_no_forces_need_no_multipliers() -> None:
    assert split_rows(on_one_crank(1, 2)[0]).multipliers(np.zeros(5)) == pytest.approx(np.zeros(4), abs=0.0)
