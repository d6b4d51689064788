"""Screws of joints, and which joints a sum of angles may be formed of."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.geometry.joint_axes import PARALLEL, check_parallel


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


@pytest.mark.parametrize("off", [0.5, 2.0])
def test_as_parallel_as_typed_right_angles_is_enough(off):
    model = arm([0, 0, 1], [np.sin(off * PARALLEL), 0, np.cos(off * PARALLEL)])
    if off < 1.0:
        check_parallel(model, {"0": 0, "1": 1})
    else:
        with pytest.raises(InputError, match="'0' and '1' are not parallel"):
            check_parallel(model, {"0": 0, "1": 1})
