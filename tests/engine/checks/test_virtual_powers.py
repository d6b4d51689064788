"""Virtual powers link by link with Pinocchio's Jacobians, and what the sizes of their terms tell."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.checks.balance import demanded_powers
from pinarm.mechanics.geometry.link_placements import moving
from pinarm.mechanics.geometry.vectors import lengths

COUNT, SHARP = 4, 1e-12
"""States, and rounding relative to the terms, over eight joints some metres apart."""


def chain(*joints: pin.JointModel) -> pin.Model:
    """Return a chain of links with bodies, which branches at every third joint."""
    model = pin.Model()
    for k, joint in enumerate(joints):
        parent = max(0, k - 1) if k % 3 == 2 else k
        model.addJoint(parent, joint, pin.SE3.Random(), f"joint {k}")
        model.appendBodyToJoint(k + 1, pin.Inertia.Random(), pin.SE3.Random())
    return model


@pytest.fixture
def moved():
    pin.seed(5)
    model = chain(pin.JointModelRX(), pin.JointModelFreeFlyer(), pin.JointModelPY(), pin.JointModelSpherical(),
                  pin.JointModelRZ(), pin.JointModelRY(), pin.JointModelPX(), pin.JointModelRZ())  # fmt: skip
    generator = np.random.default_rng(5)
    tangents, v, a = generator.normal(size=(3, COUNT, model.nv))
    q = np.array([pin.integrate(model, pin.neutral(model), tangent) for tangent in tangents])
    wrenches = generator.normal(size=(COUNT, model.njoints, 6))
    return model, q, v, a, wrenches


def test_powers_are_the_sum_over_all_links_of_their_wrenches_along_their_jacobians(moved):
    model, q, v, a, wrenches = moved
    motion = moving(model, q, v, a)
    links, twists, rates, _ = motion
    demands = links.demands(twists, rates)
    asked, terms, most = demanded_powers(motion, demands, wrenches, lengths(wrenches))
    data = model.createData()
    for row in range(COUNT):
        pin.computeJointJacobians(model, data, q[row])
        power, part = np.zeros(model.nv), np.zeros(model.nv)
        for link in range(1, model.njoints):
            jacobian = pin.getJointJacobian(model, data, link, pin.LOCAL_WORLD_ALIGNED)
            rotation = np.kron(np.eye(2), data.oMi[link].rotation)
            acting = [*(rotation @ demand for demand in demands[:, row, link]), -wrenches[row, link]]
            power += sum(jacobian.T @ wrench for wrench in acting)
            part += sum(np.abs(jacobian.T @ wrench) for wrench in acting)
        assert np.abs(asked[row] - power).max() < SHARP * part.max()
        assert (terms[row] >= part * (1.0 - SHARP)).all()
        speeds = lengths(twists[row])
        assert most[row] == pytest.approx((lengths(demands[:, row]).sum(axis=0) * speeds).sum(), rel=SHARP)
