"""Groups of rows against all of them taken apart together, and against each group alone."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from pinarm.engine.constraints.nullspaces.dense_nullspace import RowDecomposition
from pinarm.engine.constraints.nullspaces.nullspace import MANY, RowDecompositions, split_rows
from pinarm.engine.constraints.nullspaces.separate_rows import SeparateRows

GENERATOR = np.random.default_rng(7)
NV, FIRST, SECOND, ALONE = 9, [0, 3, 5, 7], [1, 2, 4, 8], 6
"""Joints that three rows tie, that two more and a copy of one of these tie, and that no row ties."""


def rows_of(states: int) -> np.ndarray:
    """Return G, shape (states, 6, NV): rows 0, 2, 4 of the first group and 1, 3, 5 of the second, 5 as 1."""
    rows = np.zeros((states, 6, NV))
    for k in (0, 2, 4):
        rows[:, k, FIRST] = GENERATOR.normal(size=(states, 4))
    for k in (1, 3):
        rows[:, k, SECOND] = GENERATOR.normal(size=(states, 4))
    rows[:, 5] = 2.0 * rows[:, 1]
    return rows


def test_they_say_what_all_rows_together_say() -> None:
    rows = rows_of(1)[0]
    split, whole = split_rows(rows), RowDecomposition.of(rows)
    assert isinstance(split, SeparateRows)
    assert split.rank == whole.rank == 5
    assert split.free @ split.free.T == pytest.approx(whole.free @ whole.free.T, abs=1e-12)
    right, force = rows @ GENERATOR.normal(size=NV), GENERATOR.normal(size=6) @ rows
    assert split.particular(right) == pytest.approx(whole.particular(right), abs=1e-12)
    assert split.multipliers(force) == pytest.approx(whole.multipliers(force), abs=1e-12)
    wrong = GENERATOR.normal(size=6)
    assert split.reached(wrong) == pytest.approx(whole.reached(wrong), abs=1e-12)
    assert np.abs(split.stresses_on(np.eye(6)).T @ whole.stresses) == pytest.approx(np.ones((1, 1)))
    assert 0.0 < whole.regularity <= 1.001 * split.regularity


def test_no_motion_is_one_of_two_groups() -> None:
    free = split_rows(rows_of(1)[0]).free
    groups = {tuple(np.flatnonzero([column[joints].any() for joints in (FIRST, SECOND, [ALONE])])) for column in free.T}
    assert groups == {(0,), (1,), (2,)}


@pytest.mark.parametrize("heavy", [1.0, 1e8, 1e16])
def test_multipliers_of_a_group_are_those_that_it_has_alone(heavy: float) -> None:
    rows, force = rows_of(1)[0], GENERATOR.normal(size=NV)
    alone = split_rows(rows[1::2][:, SECOND]).multipliers(force[SECOND])
    force[FIRST] *= heavy
    assert split_rows(rows).multipliers(force)[1::2] == pytest.approx(alone, rel=1e-13)


def test_states_in_which_different_groups_lose_a_rank_are_told_apart() -> None:
    rows = rows_of(5)
    rows[1, 2], rows[3, 3] = rows[1, 0], 3.0 * rows[3, 1]
    together = RowDecompositions.of(rows)
    assert sorted(places.tolist() for places, _ in together.parts) == [[0, 2, 4], [1], [3]]
    for places, split in together.parts:
        assert split.free.shape == (len(places), NV, NV - split.rank)
        assert np.abs(rows[places] @ split.free).max() < 1e-13
    force = np.vecmat(GENERATOR.normal(size=(5, 6)), rows)
    alone = [split_rows(rows[k]).multipliers(force[k]) for k in range(5)]
    assert together.multipliers(force) == pytest.approx(np.array(alone), abs=1e-12)


@pytest.mark.parametrize(("m", "nv"), [(0, 0), (0, 3), (2, 0), (2, 3)])
def test_there_may_be_no_rows_no_joints_and_nothing_tied(m: int, nv: int) -> None:
    split = split_rows(np.zeros((m, nv)))
    assert (split.rank, split.free.shape) == (0, (nv, nv))
    ((places, of_states),) = RowDecompositions.of(np.zeros((4, m, nv))).parts
    assert (len(places), of_states.free.shape) == (4, (4, nv, nv))


def test_rows_of_rounding_tie_nothing() -> None:
    rows = rows_of(1)[0]
    rows[0, SECOND[0]] = 1e-16
    split = split_rows(rows)
    assert isinstance(split, SeparateRows)
    assert len(split.groups) == 2


LINKAGES, CHAIN = 20, 2 * MANY
"""Linkages of two rows and three joints each, and a chain of rows that tie one joint to the next."""


def of_many_joints(states: int) -> list[csr_array]:
    """Return G, of shape (m, nv): the linkages, the chain, and a joint that no row ties."""
    found, order = [], GENERATOR.permutation(2 * LINKAGES + CHAIN)
    for _ in range(states):
        rows = np.zeros((2 * LINKAGES + CHAIN, 3 * LINKAGES + CHAIN + 2))
        for k in range(LINKAGES):
            rows[2 * k : 2 * k + 2, 3 * k : 3 * k + 3] = GENERATOR.normal(size=(2, 3))
        for k in range(CHAIN):
            rows[2 * LINKAGES + k, 3 * LINKAGES + k : 3 * LINKAGES + k + 2] = GENERATOR.uniform(1.0, 2.0, 2)
        found.append(csr_array(rows[order]))
    return found


def test_many_joints_are_taken_apart_in_the_same_groups() -> None:
    """Of the chain as sparse rows, of each linkage as few."""
    rows = of_many_joints(3)
    ((places, split),) = RowDecompositions.of_many_joints(rows, np.ones(rows[0].shape[0])).parts
    assert isinstance(split, SeparateRows)
    assert (len(places), split.rank) == (3, rows[0].shape[0])
    assert sorted(len(group.joints) for group in split.groups) == [3] * LINKAGES + [CHAIN + 1]
    dense = np.array([matrix.toarray() for matrix in rows])
    assert np.abs(dense @ split.free).max() < 1e-13
    lam = GENERATOR.normal(size=dense.shape[:2])
    assert split.multipliers(np.vecmat(lam, dense)) == pytest.approx(lam, abs=1e-10)
    alone = split_rows(dense[0])
    assert isinstance(alone, SeparateRows)
    assert alone.multipliers(lam[0] @ dense[0]) == pytest.approx(lam[0], abs=1e-10)
    assert dense[0] @ alone.particular(lam[0]) == pytest.approx(lam[0], abs=1e-10)
