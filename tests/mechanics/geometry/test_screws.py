"""The screw of a joint, read from Pinocchio."""

from types import SimpleNamespace

import numpy as np
import pytest

from pinarm.mechanics.geometry.screws import screw_of


@pytest.mark.parametrize("place", [-1, 0, 700])
def test_the_screw_of_a_joint_is_read_with_coordinates_up_to_its_own(place):
    """Pinocchio reads the coordinate at the joint's place in q, and does not look how many there are."""

    class Joint:
        nq = nv = 1
        idx_q = place

        def createData(self):
            return SimpleNamespace(S=np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0]))

        def calc(self, data, q):
            assert len(q) > place

    turns, axis = screw_of(Joint())
    assert turns
    assert axis.tolist() == [0.0, 1.0, 0.0]
