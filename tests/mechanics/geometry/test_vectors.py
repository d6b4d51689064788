"""Vector algebra on the first axis, against numpy's on the last one and SciPy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinarm.mechanics.geometry.vectors import combined, cross, crossed, direction, dot, rotation_vector

GENERATOR = np.random.default_rng(7)
A, B = GENERATOR.normal(size=(2, 3, 20))


def test_products_are_those_of_numpy() -> None:
    assert dot(A, B) == pytest.approx((A * B).sum(axis=0), rel=1e-14)
    assert cross(A, B) == pytest.approx(np.cross(A, B, axis=0), rel=1e-14)
    assert crossed(A.T, B.T) == pytest.approx(np.cross(A.T, B.T), rel=1e-14)


def test_one_vector_stands_for_all_configurations() -> None:
    one = A[:, :1]
    assert dot(one, B) == pytest.approx(one[:, 0] @ B, rel=1e-14)
    assert cross(one, B) == pytest.approx(np.cross(np.broadcast_to(one, B.shape), B, axis=0), rel=1e-14)


def test_a_direction_has_length_1_where_points_meet_too() -> None:
    some = A.copy()
    some[:, 3] = 0.0
    found = direction(some)
    assert np.linalg.norm(found, axis=0) == pytest.approx(np.ones(20), abs=1e-15)
    assert np.cross(found[:, 5], some[:, 5]) == pytest.approx(np.zeros(3), abs=1e-15)
    assert np.linalg.norm(direction(np.zeros(3))) == pytest.approx(1.0, abs=1e-15)


def test_components_along_axes_are_a_matrix_times_a_vector() -> None:
    axes = GENERATOR.normal(size=(3, 3, 20))
    weights = np.array([0.0, 1.0, -0.3])
    assert combined(axes, weights) == pytest.approx(np.einsum("k,kcn->cn", weights, axes), rel=1e-14)
    assert not combined(axes, np.zeros(3)).any()


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-4])
def test_the_rotation_vector_is_that_of_scipy(angle: float) -> None:
    unit = GENERATOR.normal(size=(20, 3))
    vectors = angle * unit / np.linalg.norm(unit, axis=1)[:, None]
    matrices = Rotation.from_rotvec(vectors).as_matrix()
    found = rotation_vector([matrices[:, :, k].T for k in range(3)])
    # near half a turn by its sine, 1e-4: 1e-16 / 1e-4 times pi
    assert found == pytest.approx(vectors.T, abs=1e-11)
    alone = rotation_vector([matrices[0, :, k] for k in range(3)])
    assert alone == pytest.approx(vectors[0], abs=1e-11)
