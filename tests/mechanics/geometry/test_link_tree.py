"""Trees of links as arrays, against Pinocchio's own path from link to link."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.geometry.link_placements import moving

AXIS = np.array([0.6, 0.0, 0.8])
JOINTS = {
    "revolute": pin.JointModelRZ, "revolute about any axis": lambda: pin.JointModelRevoluteUnaligned(AXIS),
    "prismatic": pin.JointModelPX, "prismatic along any axis": lambda: pin.JointModelPrismaticUnaligned(AXIS),
    "helical": lambda: pin.JointModelHY(0.3), "ball": pin.JointModelSpherical, "floating": pin.JointModelFreeFlyer,
}  # fmt: skip


def chain(*joints):
    """Return a tree in which each joint carries the next, and the first carries a branch."""
    pin.seed(1)
    model, parent = pin.Model(), 0
    model.appendBodyToJoint(0, pin.Inertia.Random(), pin.SE3.Identity())
    for number, joint in enumerate(joints):
        parent = model.addJoint(parent, JOINTS[joint](), pin.SE3.Random(), f"{joint} {number}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
    model.addJoint(1, pin.JointModelRY(), pin.SE3.Random(), "branch")
    return model


@pytest.mark.parametrize("joint", JOINTS)
def test_links_behind_any_joint_move_as_pinocchio_says(joint):
    model = chain(joint, "revolute", joint, "prismatic")
    generator = np.random.default_rng(2)
    v, a = generator.normal(size=(2, 3, model.nv))
    q = np.array([pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv)) for _ in v])
    links, twists, rates, columns = moving(model, q, v, a)
    data = model.createData()
    for row in range(len(q)):
        pin.forwardKinematics(model, data, q[row], v[row], a[row])
        for k in range(1, model.njoints):
            assert pin.SE3(links.turns[row, k], links.places[row, k]).isApprox(data.oMi[k], 1e-12)
            assert twists[row, k] == pytest.approx(data.v[k].vector, abs=1e-11)
            assert rates[row, k] == pytest.approx(data.a[k].vector, abs=1e-11)
        assert columns[row] == pytest.approx(pin.computeJointJacobians(model, data, q[row]), abs=1e-12)


def test_a_tree_far_from_the_origin_keeps_its_digits():
    """Twists are of link origins, not of the world's: Pinocchio's, link by link, lose none either."""
    model = chain("revolute", "revolute", "revolute")
    q, v, a = np.random.default_rng(4).normal(size=(3, 1, model.nv))
    _, near, nearby, _ = moving(model, q, v, a)
    far = model.copy()
    far.jointPlacements[1] = pin.SE3(model.jointPlacements[1].rotation, np.full(3, 1e9))
    _, twists, rates, _ = moving(far, q, v, a)
    assert twists == pytest.approx(near, abs=1e-13) and rates == pytest.approx(nearby, abs=1e-13)
