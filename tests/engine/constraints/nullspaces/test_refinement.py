"""Multipliers of very different sizes against those that the forces were made of.

They are known to the rounding of the forces, 1e-16, times the condition of a pair of rows and the number of pairs:
1e-11 leaves room for a condition of 1e4, and is missed by far where the largest forces are 1e6 times larger.
"""

import numpy as np
import pytest

from pinarm.engine.constraints.nullspaces.dense_nullspace import RowDecomposition
from pinarm.engine.constraints.nullspaces.nullspace import MANY, RowDecompositions, split_rows
from pinarm.engine.constraints.nullspaces.sparse_nullspace import SparseRowDecomposition
from pinarm.engine.constraints.variant_closure import VariantDecomposition

GENERATOR = np.random.default_rng(3)
KINDS = {2: RowDecomposition, 10: RowDecomposition, 5 + MANY // 2: SparseRowDecomposition}
"""Numbers of linkages of two rows and two joints each, all on one crank, and how their rows are taken apart."""


def on_one_crank(states: int, pairs: int) -> np.ndarray:
    """Return G, shape (states, 2 pairs, 1 + 2 pairs): joint 0 is in all rows."""
    rows = np.zeros((states, 2 * pairs, 1 + 2 * pairs))
    rows[:, :, 0] = GENERATOR.uniform(0.5, 1.0, (states, 2 * pairs))
    for k in range(0, 2 * pairs, 2):
        rows[:, k : k + 2, k + 1 : k + 3] = np.eye(2) + 0.3 * GENERATOR.normal(size=(states, 2, 2))
    return rows


@pytest.mark.parametrize("pairs", KINDS)
@pytest.mark.parametrize("ratio", [1.0, 1e-6, 1e-12, 1e-15])
def test_each_is_known_to_its_own_rounding(ratio: float, pairs: int) -> None:
    rows = on_one_crank(4, pairs)
    exact = GENERATOR.uniform(1.0, 2.0, (4, 2 * pairs)) * np.repeat(np.geomspace(1.0, ratio, pairs), 2)
    force = np.vecmat(exact, rows)
    parts = RowDecompositions.of(rows).parts
    assert {type(split) for _, split in parts} == {KINDS[pairs]}
    found = RowDecompositions.of(rows).multipliers(force)
    assert found / exact == pytest.approx(np.ones_like(exact), abs=1e-11)
    assert split_rows(rows[0]).multipliers(force[0]) / exact[0] == pytest.approx(np.ones(2 * pairs), abs=1e-11)


def test_those_of_variants_are() -> None:
    rows = on_one_crank(6, 3).reshape(2, 3, 6, 7)
    exact = GENERATOR.uniform(1.0, 2.0, (2, 3, 6)) * np.repeat([1.0, 1e-6, 1e-12], 2)
    found = VariantDecomposition.of(list(range(6)), rows, np.ones(6)).multipliers(np.vecmat(exact, rows))
    assert found / exact == pytest.approx(np.ones_like(exact), abs=1e-11)


def test_several_free_motions_take_what_cannot_be_held() -> None:
    """Two cranks, of forces that are 1e12 apart, and a row between them."""
    rows = np.zeros((9, 10))
    rows[:4, :5], rows[4:8, 5:] = on_one_crank(1, 2)[0], on_one_crank(1, 2)[0]
    rows[8, [1, 6]] = 1.0, -0.5
    exact = np.concatenate([GENERATOR.uniform(1.0, 2.0, 4), 1e-12 * GENERATOR.uniform(1.0, 2.0, 5)])
    assert split_rows(rows).multipliers(exact @ rows) / exact == pytest.approx(np.ones(9), abs=1e-11)
    two = rows[:8].copy()
    two[0, 5] = 1e-3  # one group: the large forces, times 1e-3, are forces at a joint of the small ones too
    found = split_rows(two).multipliers(exact[:8] @ two)
    assert found[:4] / exact[:4] == pytest.approx(np.ones(4), abs=1e-11)
    assert found[4:] == pytest.approx(exact[4:8], abs=1e-18)  # rounding of 1e-3 at that joint


def test_what_multipliers_cannot_hold_is_left_in_the_sense_of_least_squares() -> None:
    rows, force = on_one_crank(1, 2)[0], GENERATOR.normal(size=5)
    assert split_rows(rows).multipliers(force) == pytest.approx(np.linalg.lstsq(rows.T, force)[0], abs=1e-13)


def test_no_forces_need_no_multipliers() -> None:
    assert split_rows(on_one_crank(1, 2)[0]).multipliers(np.zeros(5)) == pytest.approx(np.zeros(4), abs=0.0)
