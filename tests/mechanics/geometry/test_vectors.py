"""Vector algebra on the first axis, against numpy's on the last one and SciPy's rotations."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.geometry.vectors import direction, rotation_vector

GENERATOR = np.random.default_rng(7)
A, B = GENERATOR.normal(size=(2, 3, 20))


def test_a_direction_has_length_1_where_points_meet_too() -> None:
    some = A.copy()
    some[:, 3] = 0.0
    found = direction(some)
    assert np.linalg.norm(found, axis=0) == pytest.approx(np.ones(20), abs=1e-15)
    assert np.cross(found[:, 5], some[:, 5]) == pytest.approx(np.zeros(3), abs=1e-15)
    assert np.linalg.norm(direction(np.zeros(3))) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-4, 2.0, np.pi - 1e-7, np.pi, np.pi + 1e-9])
def test_the_rotation_vector_has_the_angle_and_the_axis_up_to_half_a_turn(angle: float) -> None:
    """Matrices by Rodrigues' formula about random axes, and about those of the frame; beyond half a turn the rest."""
    units = np.vstack([GENERATOR.normal(size=(20, 3)), np.eye(3), -np.eye(3)])
    units /= np.linalg.norm(units, axis=1)[:, None]
    skew = np.array([pin.skew(unit) for unit in units])
    matrices = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    exact = units * (angle if angle <= np.pi else angle - 2.0 * np.pi)
    many = rotation_vector([matrices[:, :, k].T for k in range(3)]).T
    single = [rotation_vector([matrix[:, k] for k in range(3)]) for matrix in matrices]
    for vector, alone, wanted in zip(many, single, exact, strict=True):
        for found in (vector, alone):
            sense = np.sign(found @ wanted) if angle == np.pi else 1.0  # both senses are the same rotation
            assert found == pytest.approx(sense * wanted, abs=1e-13)  # log3 of Pinocchio knows it to 4e-14
