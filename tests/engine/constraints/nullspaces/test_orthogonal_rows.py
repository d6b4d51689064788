"""Rows made orthogonal at many states, against singular values and pseudo-inverses of each state by itself."""

import numpy as np
import pytest

from pinarm.engine.constraints.nullspaces.orthogonal_rows import OrthogonalRows, singular_values

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


@pytest.mark.parametrize("shape", [(0, 3), (1, 4), (2, 1), (2, 2), (2, 3), (3, 2), (3, 3)], ids=str)
def test_singular_values_are_those_of_each_state(shape: tuple[int, int]) -> None:
    """Also of rows that are parallel, alike but for 1e-9, of unlike lengths, or 0: to rounding of the largest."""
    rows = np.random.default_rng(6).normal(size=(*shape, 4, 5))
    if len(rows) == 2:
        first, other = np.moveaxis(rows, (0, 1, 2), (1, 2, 0))[:2]
        rows[:, :, 1] = first[0], -3.0 * first[0]
        rows[:, :, 2] = other[0], other[0] + 1e-9 * rows[1, :, 2]
        rows[0, :, 3] *= [1.0, 1e-8, 1e8, 1e-300, 0.0]
        rows[:, :, 0, 4] = 0.0
    found = singular_values(rows)
    assert found.shape == (4, 5, min(shape))
    for state in np.ndindex(4, 5):
        expected = np.linalg.svd(rows[..., *state], compute_uv=False)
        np.testing.assert_allclose(found[state], expected, rtol=0.0, atol=5e-14 * expected.max(initial=0.0))


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
