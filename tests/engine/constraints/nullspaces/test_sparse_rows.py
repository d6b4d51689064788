"""G taken apart as a sparse matrix against its singular values."""

import numpy as np
import pytest
from scipy.linalg import orth
from scipy.sparse import csr_array

from pinarm.engine.constraints.nullspaces.dense_nullspace import RowDecomposition
from pinarm.engine.constraints.nullspaces.nullspace import MANY, RowDecompositions, singular_values, split_rows
from pinarm.engine.constraints.nullspaces.sparse_nullspace import (
    SparseRowDecomposition,
    damped,
    extreme_values,
    rank_is_clear,
)
from pinarm.engine.constraints.nullspaces.sparse_rows import BlockDecomposition

LOOPS = 70


def ring(generator, singular=0.0, shift=13):
    """Return rows of loops side by side, two of five independent, with columns in no order, shape (350, 141).

    Every loop shares a column with the next. The first has its rows in line but for ``singular``.
    """
    rows, order = np.zeros((5 * LOOPS, 2 * LOOPS + 1)), (shift * np.arange(2 * LOOPS + 1)) % (2 * LOOPS + 1)
    for k in range(LOOPS):
        base = np.array([[1.0, -1.0, 0.0], [0.3, 0.7, -1.0]]) + 0.01 * generator.normal(size=(2, 3))
        if not k and singular is not None and singular != 0.0:
            base[1] = base[0] + singular * base[1]
        columns = order[[2 * k, 2 * k + 1, 2 * k + 2]]
        rows[5 * k : 5 * k + 5, columns] = (
            generator.normal(size=(5, 2)) @ base if k % 3 else np.pad(base, [(0, 3), (0, 0)])
        )
    return rows


@pytest.fixture
def generator():
    return np.random.default_rng(2)


def test_parts_are_those_of_singular_values(generator):
    """The condition of these rows is 200, and of their combinations 1e3: rounding leaves 1e-13 of the inverse."""
    rows = ring(generator)
    assert rows.shape[1] > MANY
    own, other = split_rows(rows), RowDecomposition.of(rows)
    assert isinstance(own, SparseRowDecomposition)
    assert own.rank == other.rank == 2 * LOOPS
    assert own.regularity == pytest.approx(other.regularity, rel=1e-3)  # of Lanczos' method
    np.testing.assert_allclose(own.free @ own.free.T, other.free @ other.free.T, atol=1e-11)
    right, force = generator.normal(size=len(rows)), generator.normal(size=rows.shape[1])
    for name, given in (("particular", right), ("reached", right), ("multipliers", force)):
        wanted = getattr(other, name)(given)
        np.testing.assert_allclose(getattr(own, name)(given), wanted, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("reach", [1.0, 300.0])
def test_multipliers_that_do_nothing_are_those_of_the_dense_matrix(generator, reach):
    """Those of rows that are 0 too, and of rows that are short for their reach, which scale otherwise."""
    rows = ring(generator)
    rows[7] *= 1e-3
    own, other = split_rows(rows, reach), RowDecomposition.of(rows, reach)
    assert isinstance(own, SparseRowDecomposition)
    found, wanted = (orth(split.stresses_on(np.eye(len(rows)))) for split in (own, other))
    assert found.shape == wanted.shape == (len(rows), len(rows) - 2 * LOOPS)
    np.testing.assert_allclose(found @ found.T, wanted @ wanted.T, atol=1e-10)
    stresses = RowDecompositions.of(np.array([rows]), reach).stresses_on(np.eye(len(rows))[None])[0]
    np.testing.assert_allclose(np.linalg.norm(stresses, axis=0), 1.0)
    np.testing.assert_allclose(stresses.T @ rows, 0.0, atol=1e-12)


def test_few_multipliers_that_do_nothing_tell_what_all_add_to_functions(generator):
    """Two functions and their sum; one that follows from the motions, ``G x``, to which nothing is added."""
    rows = ring(generator)
    own, other = split_rows(rows), RowDecomposition.of(rows)
    two = generator.normal(size=(len(rows), 2))
    moving = rows @ generator.normal(size=rows.shape[1])
    functions = np.column_stack([two, two.sum(axis=1), moving])
    few = own.stresses_on(functions)
    assert few.shape == (len(rows), 2)
    np.testing.assert_allclose(np.linalg.norm(few, axis=0), 1.0)
    np.testing.assert_allclose(few.T @ rows, 0.0, atol=1e-12)
    added, wanted = (orth(functions.T @ stresses, 1e-10) for stresses in (few, other.stresses))
    np.testing.assert_allclose(added @ added.T, wanted @ wanted.T, atol=1e-10)
    assert own.stresses_on(moving[:, None]).shape[1] == 0
    nearly = moving + 1e-6 * two[:, 0]
    some = own.stresses_on(nearly[:, None])
    np.testing.assert_allclose(nearly @ some, 1e-6 * two[:, 0] @ some, rtol=1e-6)
    assert np.abs(nearly @ some) > 1e-8


@pytest.mark.parametrize("noise", [0.0, 1e-17, 1e-10])
@pytest.mark.parametrize("dependent", [False, True])
def test_extreme_singular_values_have_their_places_where_rows_are_rounding(generator, noise, dependent):
    """Of 120 columns that all rows determine, or all but one combination of them; beside rows of 1e-17 or 1e-10."""
    n = 120
    square = np.diag(generator.uniform(0.5, 2.0, n)) + np.diag(generator.uniform(0.1, 0.3, n - 1), 1)
    if dependent:
        square[40] = square[41] + square[39]
    rows = np.vstack([square[:60], noise * generator.normal(size=(30, n)), square[60:], square[3:9]])
    wanted, found = np.linalg.svd(rows, compute_uv=False), singular_values(rows)
    last = n - 2 if dependent else n - 1
    assert len(found) == n
    assert found[[0, last]] == pytest.approx(wanted[[0, last]], rel=1e-3)
    assert not found[last + 1 :].any()


def test_the_same_at_many_configurations_of_different_rank(generator):
    plain = ring(generator)
    less = plain.copy()
    less[5:10] = 0.0
    stack = np.array([plain, less, 2.0 * plain])
    force = generator.normal(size=(3, plain.shape[1]))
    found = RowDecompositions.of(stack)
    assert sorted((places.tolist(), split.rank) for places, split in found.parts) == [
        ([0, 2], 2 * LOOPS), ([1], 2 * LOOPS - 2)
    ]  # fmt: skip
    wanted = np.array([RowDecomposition.of(rows).multipliers(f) for rows, f in zip(stack, force, strict=True)])
    np.testing.assert_allclose(found.multipliers(force), wanted, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("singular", [1e-3, 1e-5, 1e-9, 1e-12])
def test_rank_near_a_singular_position(generator, singular):
    rows = ring(generator, singular)
    assert split_rows(rows).rank == RowDecomposition.of(rows).rank == 2 * LOOPS - (singular < 1e-8)


def test_a_singular_value_that_no_column_shows_alone():
    """A triangle without small entries on its diagonal that has a singular value of 1e-60."""
    n = MANY + 50
    rows = np.eye(n) - np.diag(np.full(n - 1, 2.5), 1)
    assert split_rows(rows).rank == RowDecomposition.of(rows).rank == n - 1


def test_lengths_and_angles_together(generator):
    """Multipliers are the least in their own units, rows being of any length."""
    rows = ring(generator) * 10.0 ** generator.uniform(-2.0, 2.0, size=(5 * LOOPS, 1))
    force = rows.T @ generator.normal(size=len(rows))
    wanted = np.linalg.lstsq(rows.T, force, rcond=1e-12)[0]
    np.testing.assert_allclose(split_rows(rows).multipliers(force), wanted, atol=1e-7 * np.abs(wanted).max())


def test_extreme_singular_values(generator):
    rows = ring(generator)
    values, wanted = extreme_values(csr_array(rows)), np.linalg.svd(rows, compute_uv=False)
    np.testing.assert_allclose(values[[0, 2 * LOOPS - 1]], wanted[[0, 2 * LOOPS - 1]], rtol=1e-3)
    assert not values[2 * LOOPS :].any()


@pytest.mark.parametrize("damping", [0.0, 1e-3, 0.1])
def test_damped_steps(generator, damping):
    rows = ring(generator)
    right = rows @ generator.normal(size=rows.shape[1])  # where rows contradict each other, their lengths count
    whole = np.vstack([rows, damping * np.eye(rows.shape[1])])
    wanted = np.linalg.lstsq(whole, np.append(right, np.zeros(rows.shape[1])), rcond=1e-7)[0]
    np.testing.assert_allclose(damped(rows, right, damping), wanted, atol=1e-8 * np.abs(wanted).max())


def test_work_grows_as_the_number_of_loops(generator):
    """Blocks of loops side by side stay as large as they are, however many there are."""
    sizes = []
    for count in (100, 400):
        rows = np.zeros((2 * count, 2 * count + 1))
        for k in range(count):
            rows[2 * k : 2 * k + 2, 2 * k : 2 * k + 3] = generator.normal(size=(2, 3))
        blocks = BlockDecomposition.of(csr_array(rows), 1e-7).blocks
        sizes.append(sum(b.determined.size + b.left.size + b.coupling.size for b in blocks))
    assert sizes[1] < 4.5 * sizes[0]


def test_a_singular_value_that_blocks_count_wrongly_is_noticed():
    """Then singular values decide."""
    for last, clear in ((1e-5, True), (1e-9, False)):
        rows = np.diag([*np.ones(MANY), last])
        blocks = BlockDecomposition.of(csr_array(rows), 1e-12)
        assert blocks.rank == MANY + 1
        assert rank_is_clear(blocks, 1.0) is clear


def test_rows_that_reach_from_block_to_block(generator):
    """More rows than columns, six columns wide: what a block leaves of them goes into the next."""
    rows = np.zeros((300, 140))
    for k, row in enumerate(rows):
        row[k * 134 // 299 :][:6] = generator.normal(size=6)
    own, other, right = split_rows(rows), RowDecomposition.of(rows), generator.normal(size=300)
    for name, given in (("particular", right), ("reached", right), ("multipliers", right[:140])):
        wanted = getattr(other, name)(given)
        np.testing.assert_allclose(getattr(own, name)(given), wanted, atol=1e-9 * np.abs(wanted).max())
