"""Screws of joints, and which joints a sum of angles may be formed of."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.geometry.joint_axes import PARALLEL, check_parallel, screw_of


def arm(*axes):
    """A chain of hinges about axes, each 1 m from the one before."""
    model = pin.Model()
    joint = 0
    for k, axis in enumerate(axes):
        axis = np.array(axis, float) / np.linalg.norm(axis)
        joint = model.addJoint(
            joint, pin.JointModelRevoluteUnaligned(axis), pin.SE3(np.eye(3), np.array([float(k > 0), 0.0, 0.0])), str(k)
        )
    return model


def test_hinges_of_a_plane_are_parallel_however_they_stand():
    check_parallel(arm([0, 1, 0], [0, 1, 0], [0, 1, 0]), {"0": 0, "1": 1, "2": 2})


@pytest.mark.parametrize("off", [0.5, 2.0])
def test_as_parallel_as_typed_right_angles_is_enough(off):
    model = arm([0, 0, 1], [np.sin(off * PARALLEL), 0, np.cos(off * PARALLEL)])
    if off < 1.0:
        check_parallel(model, {"0": 0, "1": 1})
    else:
        with pytest.raises(InputError, match="'0' and '1' are not parallel"):
            check_parallel(model, {"0": 0, "1": 1})


def test_axes_of_opposite_sense_are_told_as_such():
    with pytest.raises(InputError, match="'0' and '1' are opposite"):
        check_parallel(arm([0, 0, 1], [0, 0, -1]), {"0": 0, "1": 1})


def test_axes_that_are_parallel_as_drawn_only_are_refused():
    """The third is parallel to the first until the second, across both, turns."""
    with pytest.raises(InputError, match="'0' and '2' are not parallel"):
        check_parallel(arm([0, 0, 1], [1, 0, 0], [0, 0, 1]), {"0": 0, "2": 2})


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
