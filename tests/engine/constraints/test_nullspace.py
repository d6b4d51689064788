"""The parts of G, against SciPy's null space and the solution of the whole system of equations (KKT)."""

import numpy as np
import pytest
from scipy.linalg import null_space, orth

from pinarm.engine.constraints.nullspace import Decomposition, solved_positive
from pinarm.engine.dynamics.equation import solve

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
    split = Decomposition.of(rows)
    assert split.free.shape == (NV, NV - rank)
    if m:
        scaled = rows / np.linalg.norm(rows, axis=1)[:, None]
        assert orth(split.free).shape[1] == NV - rank
        assert scaled @ split.free == pytest.approx(np.zeros((m, NV - rank)), abs=1e-13)
        assert split.stresses.shape == (m, m - rank)
        expected = null_space(scaled.T, rcond=1e-9)
        # the same space: projections agree
        found = orth(split.stresses * np.linalg.norm(rows, axis=1)[:, None])
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
    assert solve(Decomposition.of(rows), mass, force, right) == pytest.approx(solution[:NV], abs=1e-9)


@pytest.mark.parametrize("m", [3, 5])
def test_multipliers_are_the_least_that_hold_a_force(m: int) -> None:
    rows = rows_of(3, m)
    force = rows.T @ (GENERATOR.normal(size=m) / np.linalg.norm(rows, axis=1))
    least = np.linalg.lstsq(rows.T, force, rcond=1e-12)[0]
    assert Decomposition.of(rows).multipliers(force) == pytest.approx(least, abs=1e-9 * np.abs(least).max())


def test_a_right_hand_side_is_parted_into_what_some_motion_gives_and_what_contradicts_it() -> None:
    rows = rows_of(3, 5)
    split, right = Decomposition.of(rows), GENERATOR.normal(size=5)
    reached = split.reached(right)
    assert rows @ split.particular(right) == pytest.approx(reached, abs=1e-9 * np.abs(right).max())
    assert split.reached(reached) == pytest.approx(reached, abs=1e-9)
    scale = 1.0 / np.linalg.norm(rows, axis=1)
    assert (scale * (right - reached)) @ (scale[:, None] * rows) == pytest.approx(np.zeros(NV), abs=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-9])
def test_rows_that_are_0_but_for_the_rounding_of_a_file_determine_nothing(tilt: float) -> None:
    """Two rows that determine, and one, of an angle, that a tilt leaves beside them; in 1 m and in 1 mm."""
    for extent in (1.0, 1e-3):
        rows, reach = np.vstack([extent * np.eye(3)[:2], [tilt, tilt, tilt]]), np.array([extent, extent, 1.0])
        split = Decomposition.of(rows, reach)
        assert split.rank == 2
        assert np.abs(split.free[:, 0]) == pytest.approx([0.0, 0.0, 1.0])
        assert np.abs(split.multipliers(extent * np.array([1.0, 2.0, 0.0]))) == pytest.approx([1.0, 2.0, 0.0], abs=1e-5)
    assert Decomposition.of(np.full((5, 1), tilt)).rank == 0


@pytest.mark.parametrize("light", [1e-6, 1e-40])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_masses_far_apart_keep_their_digits(light: float, order: tuple[int, int]) -> None:
    """A light body on a heavy one: with the light one first, the largest entry of its column is not on the diagonal."""
    m, b = np.array([[2.0, 0.6 * np.sqrt(light)], [0.6 * np.sqrt(light), light]]), np.array([3.0, 5.0 * np.sqrt(light)])
    exact = np.array([3.0 - 0.6 * 5.0, (2.0 * 5.0 - 0.6 * 3.0) / np.sqrt(light)]) / (2.0 - 0.36)  # Cramer's rule
    places = list(order)
    found = solved_positive(m[np.ix_(places, places)], b[places, None])[:, 0]
    assert found == pytest.approx(exact[places], rel=1e-14, abs=1e-14)


def test_a_motion_without_mass_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solved_positive(np.diag([1.0, 0.0]), np.ones((2, 1)))


FIRST, SECOND, ALONE = [0, 3, 5], [1, 2, 4], 6
"""Joints that two rows tie, that two more and a copy of one of these tie, and that no row ties."""


def side_by_side(states: int) -> np.ndarray:
    """Return G, shape (states, 5, NV): rows 0, 2 of the first group and 1, 3, 4 of the second, 4 as 1."""
    rows = np.zeros((states, 5, NV))
    rows[:, 0::2][:, :2, FIRST] = GENERATOR.normal(size=(states, 2, 3))
    rows[:, 1::2][:, :, SECOND] = GENERATOR.normal(size=(states, 2, 3))
    rows[:, 4] = 2.0 * rows[:, 1]
    return rows


@pytest.mark.parametrize("heavy", [1.0, 1e16])
def test_multipliers_of_a_group_are_those_that_it_has_alone(heavy: float) -> None:
    rows, force = side_by_side(1)[0], GENERATOR.normal(size=NV)
    own = [1, 3, 4]
    alone = Decomposition.of(rows[own][:, SECOND]).multipliers(force[SECOND])
    force[FIRST] *= heavy
    split = Decomposition.of(rows)
    assert split.multipliers(force)[own] == pytest.approx(alone, rel=1e-13)
    assert split.rank == 4 and np.abs(rows @ split.free).max() < 1e-14
    groups = {tuple(column[joints].any() for joints in (FIRST, SECOND, [ALONE])) for column in split.free.T}
    assert groups == {(True, False, False), (False, True, False), (False, False, True)}


def on_one_crank(states: int, pairs: int) -> np.ndarray:
    """Return G of linkages of two rows and two joints, shape (states, 2 pairs, 1 + 2 pairs): joint 0 is in all."""
    rows = np.zeros((states, 2 * pairs, 1 + 2 * pairs))
    rows[:, :, 0] = GENERATOR.uniform(0.5, 1.0, (states, 2 * pairs))
    for k in range(0, 2 * pairs, 2):
        rows[:, k : k + 2, k + 1 : k + 3] = np.eye(2) + 0.3 * GENERATOR.normal(size=(states, 2, 2))
    return rows


@pytest.mark.parametrize("pairs", [2, 55])
@pytest.mark.parametrize("ratio", [1.0, 1e-2])
def test_multipliers_are_known_to_the_rounding_of_the_forces_at_their_joint(ratio: float, pairs: int) -> None:
    """1e-11 leaves room for a condition of 1e4, and is missed by far where the largest forces are 1e6 times larger."""
    rows = on_one_crank(4, pairs)
    exact = GENERATOR.uniform(1.0, 2.0, (4, 2 * pairs)) * np.repeat(np.geomspace(1.0, ratio, pairs), 2)
    force = np.vecmat(exact, rows)
    found = Decomposition.of(rows).multipliers(force)
    assert found / exact == pytest.approx(np.ones_like(exact), abs=1e-11)
    assert Decomposition.of(rows[0]).multipliers(force[0]) / exact[0] == pytest.approx(np.ones(2 * pairs), abs=1e-11)


def test_configurations_of_another_rank_have_what_they_have_alone() -> None:
    """Motions and stresses that exist at some configurations only are 0 at the others, behind their own."""
    rows, force, mass = side_by_side(3), GENERATOR.normal(size=(3, NV)), masses()
    rows[1, 2] = 3.0 * rows[1, 0]
    right, together = np.vecmat(GENERATOR.normal(size=(3, NV)), rows.swapaxes(1, 2)), Decomposition.of(rows)
    accelerations = solve(together, np.array([mass] * 3), force, right)
    assert together.freedom.tolist() == [3, 4, 3]
    for k in range(3):
        alone = Decomposition.of(rows[k])
        assert not together.free[k, :, alone.freedom :].any()
        assert accelerations[k] == pytest.approx(solve(alone, mass, force[k], right[k]), abs=1e-12)
        for name, given in (("multipliers", force), ("particular", right), ("reached", right)):
            assert getattr(together, name)(given)[k] == pytest.approx(getattr(alone, name)(given[k]), abs=1e-12)
        for name in ("free", "stresses"):
            basis, own = getattr(together, name)[k], getattr(alone, name)
            spans = [np.linalg.svd(x)[0][:, : own.shape[1]] for x in (basis[:, basis.any(axis=0)], own)]
            assert spans[0] @ spans[0].T == pytest.approx(spans[1] @ spans[1].T, abs=1e-12)
