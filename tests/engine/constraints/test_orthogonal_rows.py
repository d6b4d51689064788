"""Rows made orthogonal at many states, against singular values and pseudo-inverses of each state by itself."""

import numpy as np
import pytest

from pinarm.engine.constraints.orthogonal_rows import (
    DeterminingRows,
    OrthogonalRows,
    independent_rows,
)

ROUNDING = 1e-11
"""Of matrices of random numbers, whose condition is below 1e3: some ten roundings of solutions of about 100."""

SHAPES = [(0, 3), (1, 1), (2, 3), (3, 3), (4, 7)]


@pytest.fixture(params=SHAPES, ids=str)
def rows(request: pytest.FixtureRequest) -> np.ndarray:
    """Rows at 4 times 5 states, shape (r, c, 4, 5)."""
    found = np.random.default_rng(2).normal(size=(*request.param, 4, 5))
    return found


def test_solutions_are_those_of_least_length(rows: np.ndarray) -> None:
    right = np.random.default_rng(3).normal(size=(len(rows), 4, 5))
    x = OrthogonalRows.of(rows).shortest(right)
    for i, k in np.ndindex(4, 5):
        np.testing.assert_allclose(x[:, i, k], np.linalg.pinv(rows[..., i, k]) @ right[:, i, k], atol=ROUNDING)


def test_basis_and_complement_span_everything(rows: np.ndarray) -> None:
    r, c = rows.shape[:2]
    orthogonal = OrthogonalRows.of(rows)
    complement = orthogonal.complement()
    assert complement.shape == (c - r, c, 4, 5)
    both = np.concatenate([orthogonal.basis, complement])
    for i, k in np.ndindex(4, 5):
        np.testing.assert_allclose(both[..., i, k] @ both[..., i, k].T, np.eye(c), atol=1e-14)
        np.testing.assert_allclose(complement[..., i, k] @ rows[..., i, k].T, np.zeros((c - r, r)), atol=1e-13)
        product = orthogonal.shares[..., i, k].T @ orthogonal.basis[..., i, k]
        np.testing.assert_allclose(product, rows[..., i, k], atol=1e-13)


def test_components_are_products_with_the_basis(rows: np.ndarray) -> None:
    x = np.random.default_rng(4).normal(size=(rows.shape[1], 4, 5))
    orthogonal = OrthogonalRows.of(rows)
    expected = np.einsum("rc..., c...->r...", orthogonal.basis, x)
    np.testing.assert_allclose(orthogonal.components(x), expected, atol=1e-14)


def test_nearly_parallel_rows_are_orthogonal_to_rounding() -> None:
    """One pass alone leaves 1e-16 times the condition."""
    rows = np.array([[[1.0], [0.0], [0.0]], [[1.0], [1e-7], [0.0]]])
    basis = OrthogonalRows.of(rows).basis[..., 0]
    np.testing.assert_allclose(basis @ basis.T, np.eye(2), atol=1e-14)


def test_a_state_does_not_depend_on_those_beside() -> None:
    rows, right = np.random.default_rng(5).normal(size=(2, 3, 9)), np.ones((2, 9))
    every, alone = OrthogonalRows.of(rows), OrthogonalRows.of(rows[..., 3:4])
    np.testing.assert_array_equal(every.complement()[..., 3], alone.complement()[..., 0])
    np.testing.assert_array_equal(every.shortest(right)[:, 3], alone.shortest(right[:, 3:4])[:, 0])


def test_dependent_rows_are_told_by_numbers_that_are_not_finite() -> None:
    rows = np.array([[[1.0, 1.0], [0.0, 0.0]], [[0.0, 1.0], [0.0, 1.0]]])
    with np.errstate(all="ignore"):
        x = OrthogonalRows.of(rows).shortest(np.ones((2, 2)))
    assert np.isfinite(x).all(axis=0).tolist() == [False, True]


def test_chosen_rows_are_independent_and_as_many_as_the_rank() -> None:
    """Three rows, two of which repeat others; the longest row is that which repeats."""
    rng = np.random.default_rng(8)
    base = rng.normal(size=(3, 5))
    matrix = np.vstack([base[:2], 40.0 * (base[0] - base[1]), base[2], 1e-12 * rng.normal(size=(1, 5))])
    chosen = independent_rows(matrix, 3)
    assert chosen == sorted(chosen) and 3 in chosen and 4 not in chosen
    assert np.linalg.matrix_rank(matrix[chosen]) == 3


class Matrices:
    """J at n states, shape (m, nv, n)."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def some(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return self.values[np.ix_(rows, columns)]


class TestDeterminingRows:
    """Two parts of two and three velocities, with one row more than is needed in the second."""

    GROUPS = np.array([0, 1, 0, 1, 1])
    OWNERS = np.array([0, 1, 1, 0, 1, 1])

    @pytest.fixture
    def values(self) -> np.ndarray:
        rng = np.random.default_rng(9)
        first = rng.normal(size=(6, 5)) * (self.OWNERS[:, None] == self.GROUPS)
        first[5] = first[1] - 2.0 * first[2]
        return first[:, :, None] + 1e-3 * rng.normal(size=(6, 5, 4)) * (first != 0.0)[:, :, None]

    def test_they_give_the_solution_of_each_state(self, values: np.ndarray) -> None:
        chosen = DeterminingRows.of(values[:, :, 0], self.GROUPS, np.ones(6))
        assert chosen is not None and sorted(map(len, chosen.rows)) == [2, 3]
        right, rows = np.random.default_rng(1).normal(size=(6, 4)), chosen.every
        motion = chosen.at(Matrices(values))
        for k in range(4):
            wanted = np.linalg.solve(values[rows, :, k], right[rows, k])
            np.testing.assert_allclose(motion.solve(right)[:, k], wanted, atol=ROUNDING)
        assert motion.served.all()

    def test_where_a_part_has_another_sense_or_is_nearly_singular_they_do_not_serve(self, values: np.ndarray) -> None:
        chosen = DeterminingRows.of(values[:, :, 0], self.GROUPS, np.ones(6))
        assert chosen is not None
        row, other = chosen.rows[1][:2]
        values[row, :, 1] *= -1.0
        values[row, :, 2] = values[other, :, 2] + 0.01 * values[row, :, 2]
        assert chosen.at(Matrices(values)).served.tolist() == [True, False, False, True]

    def test_a_part_with_too_few_rows_is_not_determined(self, values: np.ndarray) -> None:
        assert DeterminingRows.of(values[[0, 1, 2, 4], :, 0], self.GROUPS, np.ones(4)) is None
