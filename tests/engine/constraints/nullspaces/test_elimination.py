"""Elimination of many systems at once, against numpy's solution of each."""

import numpy as np
import pytest

from pinarm.engine.constraints.nullspaces.elimination import Elimination, Order, dense

N, M, NV = 5, 3, 6


def systems(seed: int) -> np.ndarray:
    """Return N matrices near each other, with zeros at the same places."""
    generator = np.random.default_rng(seed)
    first = generator.normal(size=(M, NV)) * (generator.uniform(size=(M, NV)) < 0.7)
    return first + 0.01 * generator.normal(size=(N, M, NV)) * (first != 0.0)


def sparse(matrices: np.ndarray) -> dict[int, dict[int, np.ndarray]]:
    return {i: {j: matrices[:, i, j] for j in range(NV) if matrices[:, i, j].any()} for i in range(M)}


@pytest.mark.parametrize("seed", range(5))
def test_unknowns_are_those_of_each_system_alone(seed: int) -> None:
    matrices, generator = systems(seed), np.random.default_rng(100 + seed)
    rows = sparse(matrices)
    assert dense(rows, (M, NV)) == pytest.approx(matrices[0])
    order = Order.of(matrices[0], M)
    b = generator.normal(size=(M, N))
    x = Elimination.of(rows, order).solve(dict(enumerate(b)))
    for k in range(N):
        expected = np.linalg.solve(matrices[k][:, list(order.columns)], b[:, k])
        assert [x[column][k] for column in order.columns] == pytest.approx(expected, rel=1e-9)


def test_dependent_rows_are_in_no_pair() -> None:
    matrix = np.array([[1.0, 2.0, 0.0], [2.0, 4.0, 0.0], [0.0, 0.0, 3.0]])
    order = Order.of(matrix, np.linalg.matrix_rank(matrix))
    assert len(order.rows) == 2
    assert 2 in order.rows


def test_there_are_no_more_pivots_than_rows_that_are_not_0() -> None:
    order = Order.of(np.array([[3.0, 1.0, 0.0], [0.0, 0.0, 0.0], [6.0, 2.0, 0.0]]), 3)
    assert (order.rows, order.columns) == ((0,), (0,))
    assert Order.of(np.zeros((0, 3)), 2).rows == ()


@pytest.mark.parametrize(("m", "columns", "filled"), [(5, 3, 1.0), (40, 30, 0.1), (60, 60, 0.05)])
def test_the_order_is_that_of_complete_pivoting(m: int, columns: int, filled: float) -> None:
    """The largest entry of all that is left of the whole matrix, its rows of length 1, one after the other."""
    generator = np.random.default_rng(m)
    matrix = generator.normal(size=(m, columns)) * (generator.random((m, columns)) < filled)
    matrix[m // 2] = 2.0 * matrix[0]
    rank = int(np.linalg.matrix_rank(matrix))
    order = Order.of(matrix, rank)
    length = np.linalg.norm(matrix, axis=1)
    left = matrix / np.where(length > 0.0, length, 1.0)[:, None]
    for row, column, pivot in zip(order.rows, order.columns, order.pivots, strict=True):
        assert abs(left[row, column]) >= (1.0 - 1e-12) * np.abs(left).max()
        assert pivot == pytest.approx(left[row, column] * length[row], rel=1e-9)
        left = left - np.outer(left[:, column] / left[row, column], left[row])
    assert np.abs(left).max() < 1e-12
    assert len(set(order.rows)) == len(set(order.columns)) == rank


def test_a_determinant_of_many_pivots_that_change_a_little_has_kept_its_size() -> None:
    """Of 300 equations of their own, each having lost 3 %; and where one of them has changed its sign."""
    order = Order.of(np.eye(300), 300)
    rows = {k: {k: np.array([0.97, 0.97])} for k in range(300)}
    rows[7] = {7: np.array([0.97, -0.97])}
    assert Elimination.of(rows, order).continued().tolist() == [True, False]


def test_a_determinant_that_changes_its_sign_is_another_branch() -> None:
    """``x cos q = 0`` at q on both sides of 90 deg, ordered at 0."""
    q = np.deg2rad([0.0, 60.0, 89.0, 91.0, 180.0])
    order = Order.of(np.array([[1.0]]), 1)
    eliminated = Elimination.of({0: {0: np.cos(q)}}, order)
    assert eliminated.continued().tolist() == [True, True, False, False, False]
    assert eliminated.sound().tolist() == [True, True, False, False, True]
