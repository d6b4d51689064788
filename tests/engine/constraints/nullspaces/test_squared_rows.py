"""Extreme singular values of regular rows against those of the whole decomposition."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from pinarm.engine.constraints.nullspaces import squared_rows
from pinarm.engine.constraints.nullspaces.dense_nullspace import acting_values
from pinarm.engine.constraints.nullspaces.squared_rows import (
    REGULAR,
    SEVERAL,
    SquaredRows,
    regular_values,
    regular_values_of_sparse,
)
from pinarm.engine.kernel.library import absence

compiled = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")


@pytest.fixture
def generator():
    return np.random.default_rng(4)


def chain(generator, n=3, m=60):
    """Return rows each of which shares velocities with the next three, shape (n, m, m + 3)."""
    rows = np.zeros((n, m, m + 3))
    for k in range(m):
        rows[:, k, k : k + 4] = generator.normal(size=(n, 4))
        rows[:, k, k] += 3.0
    return rows


def extremes(rows):
    values = np.linalg.svd(rows, compute_uv=False)
    return values[..., [0, -1]]


@compiled
def test_are_those_of_all(generator):
    rows = chain(generator)
    values, known = regular_values(rows)
    assert known.all()
    np.testing.assert_allclose(values[:, [0, -1]], extremes(rows), rtol=1e-10)
    assert (values[:, :-1] == values[:, :1]).all()


@compiled
def test_of_sparse_rows_are_the_same_and_rows_that_are_zero_have_none(generator):
    (rows,) = chain(generator, 1)
    padded = np.zeros((2 * len(rows), rows.shape[1]))
    padded[::2], padded[1, 0] = rows, 1e-18
    values = regular_values_of_sparse(csr_array(padded))
    assert len(values) == rows.shape[1]
    np.testing.assert_allclose(values[[0, len(rows) - 1]], extremes(rows), rtol=1e-10)
    assert not values[len(rows) :].any()


@compiled
@pytest.mark.parametrize("part", [4.0, 0.3])
def test_are_known_as_far_as_squares_tell(part, generator):
    """From 1e-3 of the largest on; nearer to a singular position, all singular values are computed."""
    rows = chain(generator, 1)
    rows[:, 30] *= part * REGULAR
    wanted = extremes(rows)
    clear = wanted[0, 1] > REGULAR * wanted[0, 0]
    assert clear == (part > 1.0)
    _, known = regular_values(rows)
    assert known[0] == clear
    found = acting_values(rows, np.ones(rows.shape[1:]))
    np.testing.assert_allclose(found[:, [0, -1]], wanted, rtol=1e-9)
    assert len(set(found[0].tolist())) == (2 if clear else rows.shape[1])


def test_rows_that_repeat_others_are_left_to_the_whole_decomposition(generator):
    rows = chain(generator)
    rows[:, 7] = 2.0 * rows[:, 6]
    assert not regular_values(rows)[1].any()
    assert regular_values_of_sparse(csr_array(rows[0])) is None


def test_rows_that_are_no_numbers_are_not_looked_at(generator):
    rows = chain(generator)
    rows[1, 5, 6] = np.nan
    assert not regular_values(rows)[1][1]


def test_few_rows_and_rows_that_share_all_velocities_are_left_too(generator):
    few, whole = chain(generator, m=SEVERAL - 1), generator.normal(size=(2, 60, 64))
    assert SquaredRows.of(whole) is None
    for rows in (few, whole):
        assert not regular_values(rows)[1].any()
        np.testing.assert_allclose(acting_values(rows, np.ones(rows.shape[1:])), np.linalg.svd(rows, compute_uv=False))


def test_without_the_library_all_are_computed(generator, monkeypatch):
    monkeypatch.setattr(squared_rows, "library", lambda: None)
    rows = chain(generator)
    np.testing.assert_allclose(acting_values(rows, np.ones(rows.shape[1:])), np.linalg.svd(rows, compute_uv=False))
    assert regular_values_of_sparse(csr_array(rows[0])) is None


def test_units_of_rows_and_columns_are_applied_to_rows_that_count(generator):
    """A row that is 0 in its own unit is none, at however many configurations; without rows there are no values."""
    rows, units = chain(generator, 4).reshape(2, 2, 60, 63), generator.uniform(0.3, 3.0, (60, 63))
    rows[:, :, 7], units[7] = 1e-12, 1e-9
    wanted = np.linalg.svd(np.delete(rows * units, 7, axis=2), compute_uv=False)
    found = acting_values(rows, units)
    assert found.shape == (2, 2, 60)
    np.testing.assert_allclose(found[..., [0, 58]], wanted[..., [0, -1]], rtol=1e-9)
    assert not found[..., 59].any()
    assert acting_values(rows[:, :, :0], units[:0]).shape == (2, 2, 0)


def test_rows_count_whatever_their_signs_are_and_wherever_they_act(generator):
    """Rows without positive or negative entries, which are 0 but at the first or the last configuration."""
    rows = chain(generator, 2, SEVERAL - 1)
    rows[:, 4:6], rows[:, 6:8] = -np.abs(rows[:, 4:6]), np.abs(rows[:, 6:8])
    rows[0, [4, 6]] = rows[1, [5, 7]] = 0.0
    found = acting_values(rows, np.ones(rows.shape[1:]))
    np.testing.assert_allclose(found, np.linalg.svd(rows, compute_uv=False), atol=1e-14 * found.max())
