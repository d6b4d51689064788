"""Independent rows taken apart by their directions, against singular values of each configuration by itself."""

import numpy as np
import pytest
from scipy.linalg import orth

from pinarm.engine.constraints.nullspaces.dense_nullspace import RANK, RowDecomposition
from pinarm.engine.constraints.nullspaces.independent_rows import SEVERAL, IndependentRows, inverse_of_triangular
from pinarm.engine.constraints.nullspaces.nullspace import RowDecompositions

N, NV = 5, SEVERAL + 4
ACTING = np.delete(np.arange(SEVERAL + 3), [0, 7, SEVERAL + 2])
"""Rows that are not 0, of three more."""

ROUNDING = 1e-11
"""Of solutions of about 10 by matrices of random numbers, whose condition is below 1e3."""


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture
def rows(generator: np.random.Generator) -> np.ndarray:
    found = np.zeros((N, SEVERAL + 3, NV))
    found[:, ACTING] = generator.normal(size=(N, SEVERAL, NV)) * 10.0 ** generator.uniform(-1.0, 1.0, (SEVERAL, 1))
    return found


def assert_same(parts: RowDecompositions, rows: np.ndarray, generator: np.random.Generator) -> None:
    """Compare parts with those of each configuration."""
    right, force = generator.normal(size=rows.shape[:2]), generator.normal(size=(len(rows), NV))
    seen = np.sort(np.concatenate([some for some, _ in parts.parts]))
    np.testing.assert_array_equal(seen, np.arange(len(rows)))
    for some, split in parts.parts:
        found = split.particular(right[some]), split.reached(right[some]), split.multipliers(force[some])
        for i, k in enumerate(some):
            other = RowDecomposition.of(rows[k])
            wanted = other.particular(right[k]), other.reached(right[k]), other.multipliers(force[k])
            for one, single in zip(found, wanted, strict=True):
                np.testing.assert_allclose(one[i], single, atol=ROUNDING * np.abs(single).max())
            assert split.rank == other.rank
            for basis, same in ((split.free[i], other.free), (orth(split.stresses[i]), orth(other.stresses))):
                assert basis.shape == same.shape
                np.testing.assert_allclose(basis @ basis.T, same @ same.T, atol=ROUNDING)
            np.testing.assert_allclose(split.scale[i], other.scale, rtol=1e-14)


def test_parts_are_those_of_singular_values(rows: np.ndarray, generator: np.random.Generator) -> None:
    parts = RowDecompositions.of(rows)
    ((_, split),) = parts.parts
    assert isinstance(split, IndependentRows)
    assert split.regularity == pytest.approx(min(RowDecomposition.of(each).regularity for each in rows), rel=1e-10)
    assert_same(parts, rows, generator)


@pytest.mark.parametrize("apart", [0.0, 1e-3 * RANK])
def test_a_row_that_repeats_others_is_told(rows: np.ndarray, generator: np.random.Generator, apart: float) -> None:
    """At one configuration only: this one has a rank of its own."""
    rows[2, ACTING[3]] = rows[2, ACTING[1]] - 2.0 * rows[2, ACTING[8]] + apart * rows[2, ACTING[3]]
    parts = RowDecompositions.of(rows)
    assert {split.rank: some.tolist() for some, split in parts.parts} == {SEVERAL - 1: [2], SEVERAL: [0, 1, 3, 4]}
    if not apart:  # what is cut off is felt beside singular values, and not in a closed form
        assert_same(parts, rows, generator)


def test_a_row_that_repeats_others_at_all_configurations_is_told(
    rows: np.ndarray, generator: np.random.Generator
) -> None:
    """None is left whose rows are independent, and none is there without configurations."""
    rows[:, ACTING[3]] = rows[:, ACTING[1]] - 2.0 * rows[:, ACTING[8]]
    parts = RowDecompositions.of(rows)
    assert [(some.tolist(), split.rank) for some, split in parts.parts] == [(list(range(N)), SEVERAL - 1)]
    assert_same(parts, rows, generator)
    assert not RowDecompositions.of(rows[:0]).parts


def test_a_row_that_vanishes_at_one_configuration_is_told(rows: np.ndarray, generator: np.random.Generator) -> None:
    rows[4, ACTING[5]] = 0.0
    parts = RowDecompositions.of(rows)
    assert {split.rank: some.tolist() for some, split in parts.parts} == {SEVERAL - 1: [4], SEVERAL: [0, 1, 2, 3]}
    assert_same(parts, rows, generator)


def test_few_rows_and_more_rows_than_motions_are_left_to_singular_values(generator: np.random.Generator) -> None:
    for m, nv in ((SEVERAL - 1, NV), (NV + 1, NV)):
        ((_, split),) = RowDecompositions.of(generator.normal(size=(2, m, nv))).parts
        assert isinstance(split, RowDecomposition)
        assert split.rank == min(m, nv)


def test_rows_that_depend_on_each_other_though_each_adds_a_direction_are_told() -> None:
    """Kahan's matrix: what each row adds to those before is as long as the first row, the least singular value 1e-9."""
    m = 30
    rows = np.eye(m) - np.tri(m, k=-1)
    ((_, split),) = RowDecompositions.of(rows[None]).parts
    assert split.rank == RowDecomposition.of(rows).rank == m - 1


def test_rows_are_taken_apart_by_singular_values_where_the_bound_does_not_tell(generator: np.random.Generator) -> None:
    """Kahan's matrix: its least singular value is 0.9 RANK of the largest, and its bound 0.6 RANK; beside another."""
    m = 23
    rows = np.stack([np.eye(m) - np.tri(m, k=-1), generator.normal(size=(m, m)) + 10.0 * np.eye(m)])
    parts = RowDecompositions.of(rows)
    assert {type(split): some.tolist() for some, split in parts.parts} == {RowDecomposition: [0], IndependentRows: [1]}
    right = generator.normal(size=rows.shape[:2])
    for some, split in parts.parts:
        if isinstance(split, IndependentRows):
            np.testing.assert_allclose(np.matvec(rows[some], split.particular(right[some])), right[some], atol=ROUNDING)


@pytest.mark.parametrize("r", [1, 2 * SEVERAL - 1, 2 * SEVERAL, 4 * SEVERAL + 3])
def test_triangular_matrices_are_inverted_by_halves(generator: np.random.Generator, r: int) -> None:
    """What ``R R^-1`` lacks is rounding of sums of r products."""
    matrix = np.triu(generator.normal(size=(3, r, r))) / r + np.eye(r)
    inverse = inverse_of_triangular(matrix)
    np.testing.assert_allclose(matrix @ inverse, np.broadcast_to(np.eye(r), (3, r, r)), atol=r * 1e-15)
    assert not np.tril(inverse, -1).any()
