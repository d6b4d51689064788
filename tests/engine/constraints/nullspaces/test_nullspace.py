"""The parts of G, against SciPy's null space and the solution of the whole system of equations (KKT)."""

import numpy as np
import pytest
from scipy.linalg import null_space, orth

from pinarm.engine.constraints.nullspaces.dense_nullspace import acting_values, solved_positive
from pinarm.engine.constraints.nullspaces.nullspace import RowDecompositions, split_rows
from pinarm.engine.dynamics.equation import solve, solve_each

GENERATOR = np.random.default_rng(11)
NV = 7


def rows_of(rank: int, m: int) -> np.ndarray:
    """Return m rows of a rank, of lengths from 1e-3 to 1e3."""
    independent = GENERATOR.normal(size=(rank, NV))
    return 10.0 ** GENERATOR.uniform(-3, 3, m)[:, None] * (GENERATOR.normal(size=(m, rank)) @ independent)


def masses() -> np.ndarray:
    root = GENERATOR.normal(size=(NV, NV))
    return root @ root.T + np.eye(NV)


@pytest.mark.parametrize(("rank", "m"), [(3, 3), (3, 5), (7, 9), (0, 0)])
def test_free_motions_and_stresses_are_the_null_spaces(rank: int, m: int) -> None:
    rows = rows_of(rank, m) if m else np.zeros((0, NV))
    split = split_rows(rows)
    assert split.free.shape == (NV, NV - rank)
    if m:
        scaled = split.scale[:, None] * rows
        assert orth(split.free).shape[1] == NV - rank
        assert scaled @ split.free == pytest.approx(np.zeros((m, NV - rank)), abs=1e-13)
        assert split.stresses.shape == (m, m - rank)
        expected = null_space(scaled.T, rcond=1e-9)
        # the same space: projections agree
        found = orth(split.stresses / split.scale[:, None])
        assert found @ found.T == pytest.approx(expected @ expected.T, abs=1e-9)


@pytest.mark.parametrize(("rank", "m"), [(3, 3), (3, 5)])
def test_the_motion_is_that_of_the_whole_system_of_equations(rank: int, m: int) -> None:
    """``[M -G^T; G 0] [a; lam] = [f; r]``, solved in the sense of least squares, r in the range of G."""
    rows, mass, force = rows_of(rank, m), masses(), GENERATOR.normal(size=NV)
    right = rows @ GENERATOR.normal(size=NV)
    scale = 1.0 / np.linalg.norm(rows, axis=1)
    scaled = scale[:, None] * rows
    system = np.block([[mass, -scaled.T], [scaled, np.zeros((m, m))]])
    solution = np.linalg.lstsq(system, np.concatenate([force, scale * right]), rcond=1e-12)[0]
    assert solve(split_rows(rows), mass, force, right) == pytest.approx(solution[:NV], abs=1e-9)


@pytest.mark.parametrize("m", [3, 5])
def test_multipliers_are_the_least_that_hold_a_force(m: int) -> None:
    rows = rows_of(3, m)
    force = rows.T @ (GENERATOR.normal(size=m) / np.linalg.norm(rows, axis=1))
    least = np.linalg.lstsq(rows.T, force, rcond=1e-12)[0]
    assert split_rows(rows).multipliers(force) == pytest.approx(least, abs=1e-9 * np.abs(least).max())


def test_many_configurations_are_each_as_alone_whatever_their_rank() -> None:
    rows = np.array([rows_of(rank, 4) for rank in (4, 2, 4, 3, 2)])
    mass, force = np.array([masses() for _ in rows]), GENERATOR.normal(size=(5, NV))
    right = np.matvec(rows, GENERATOR.normal(size=(5, NV)))
    together = RowDecompositions.of(rows)
    assert sorted(len(k) for k, _ in together.parts) == [1, 2, 2]
    found = solve_each(together, mass, force, right)
    for k in range(5):
        assert found[k] == pytest.approx(solve(split_rows(rows[k]), mass[k], force[k], right[k]), abs=1e-10)


def test_a_right_hand_side_is_parted_into_what_some_motion_gives_and_what_contradicts_it() -> None:
    rows = rows_of(3, 5)
    split, right = split_rows(rows), GENERATOR.normal(size=5)
    reached = split.reached(right)
    assert rows @ split.particular(right) == pytest.approx(reached, abs=1e-9 * np.abs(right).max())
    assert split.reached(reached) == pytest.approx(reached, abs=1e-9)
    assert split.scale * (right - reached) @ split.left == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-9])
def test_rows_that_are_0_but_for_the_rounding_of_a_file_determine_nothing(tilt: float) -> None:
    """Two rows that determine, and one, of an angle, that a tilt leaves beside them; in 1 m and in 1 mm."""
    for extent in (1.0, 1e-3):
        rows, reach = np.vstack([extent * np.eye(3)[:2], [tilt, tilt, tilt]]), np.array([extent, extent, 1.0])
        split = split_rows(rows, reach)
        assert (split.rank, split.regularity) == (2, pytest.approx(1.0))
        assert np.abs(split.free[:, 0]) == pytest.approx([0.0, 0.0, 1.0])
        assert np.abs(split.multipliers(extent * np.array([1.0, 2.0, 0.0]))) == pytest.approx([1.0, 2.0, 0.0], abs=1e-5)
    assert split_rows(np.full((5, 1), tilt)).rank == 0


@pytest.mark.parametrize("light", [1e-6, 1e-20, 1e-40])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_masses_far_apart_keep_their_digits(light: float, order: tuple[int, int]) -> None:
    """A light body on a heavy one: with the light one first, the largest entry of its column is not on the diagonal."""
    m, b = np.array([[2.0, 0.6 * np.sqrt(light)], [0.6 * np.sqrt(light), light]]), np.array([3.0, 5.0 * np.sqrt(light)])
    exact = np.array([3.0 - 0.6 * 5.0, (2.0 * 5.0 - 0.6 * 3.0) / np.sqrt(light)]) / (2.0 - 0.36)  # Cramer's rule
    places = list(order)
    found = solved_positive(m[np.ix_(places, places)], b[places, None])[:, 0]
    assert found == pytest.approx(exact[places], rel=1e-14, abs=1e-15)


def test_a_motion_without_mass_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solved_positive(np.diag([1.0, 0.0]), np.ones((2, 1)))


def test_singular_values_are_those_of_rows_in_their_units() -> None:
    """A row that is 0 in its own unit is none, at however many configurations; without rows there are no values."""
    rows, units = GENERATOR.normal(size=(2, 2, 6, NV)), GENERATOR.uniform(0.3, 3.0, (6, NV))
    rows[:, :, 3], units[3] = 1e-12, 1e-9
    rows[:, :, 4] = -np.abs(rows[:, :, 4])
    found = acting_values(rows, units)
    assert found[..., :5] == pytest.approx(np.linalg.svd(np.delete(rows * units, 3, axis=2), compute_uv=False))
    assert not found[..., 5].any()
    assert acting_values(rows[:, :, :0], units[:0]).shape == (2, 2, 0)
