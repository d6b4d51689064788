"""A chain between two frames, against Pinocchio's placements, Jacobians and accelerations of both frames."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.geometry.chains import Chain, screw_of
from tests.mechanics.geometry.random_variants import random_variants

ROWS = 6


@pytest.fixture
def model(chain):
    """Joints that turn and slide about slanted axes, a branch, and frames away from joints."""
    built = pin.Model()
    generator = np.random.default_rng(3)
    parents = [0, 1, 2, 1, 4]
    for k, parent in enumerate(parents):
        axis = generator.normal(size=3)
        joint = [pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned][k % 2](axis / np.linalg.norm(axis))
        built.addJoint(parent, joint, pin.SE3.Random(), f"joint{k}")
    for name, joint in (("left", 3), ("right", 5), ("ground", 0)):
        built.addFrame(pin.Frame(name, joint, built.getFrameId("universe"), pin.SE3.Random(), pin.FrameType.OP_FRAME))
    return built


@pytest.mark.parametrize("ends", [("left", "right"), ("right", "left"), ("ground", "left")], ids="-".join)
def test_it_moves_as_one_frame_seen_from_the_other(model, ends):
    first, second = (model.getFrameId(name) for name in ends)
    chain = Chain.between(model, first, second)
    q, v = np.random.default_rng(5).normal(size=(2, model.nv, ROWS))
    placed = chain.placed(q, np.cos(q), np.sin(q))
    rates = placed.rates(v)
    data, local = model.createData(), pin.LOCAL
    for row in range(ROWS):
        pin.forwardKinematics(model, data, q[:, row], v[:, row], np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        between = data.oMf[first].actInv(data.oMf[second])
        assert placed.p[:, row] == pytest.approx(between.translation, abs=1e-13)
        axes = np.column_stack([np.broadcast_to(axis, (3, ROWS))[:, row] for axis in placed.axes])
        assert axes == pytest.approx(between.rotation, abs=1e-13)
        own, other = (pin.getFrameVelocity(model, data, frame, local) for frame in (first, second))
        twist = between.act(other) - own
        dp = twist.linear + np.cross(twist.angular, between.translation)
        found = [np.broadcast_to(x, (3, ROWS))[:, row] for x in rates]
        assert found[0] == pytest.approx(dp, abs=1e-12)
        assert found[1] == pytest.approx(twist.angular, abs=1e-12)
        for e in np.eye(3):
            along, about = placed.along(e[:, None]), placed.about(e[:, None])
            at = [{k: np.broadcast_to(x, ROWS)[row] for k, x in part.items()} for part in (along, about)]
            assert sum(at[0][k] * v[k, row] for k in at[0]) == pytest.approx(e @ dp, abs=1e-12)
            assert sum(at[1][k] * v[k, row] for k in at[1]) == pytest.approx(e @ twist.angular, abs=1e-12)


def test_accelerations_are_the_change_of_velocities(model, differentiate):
    """Along q(t) = q0 + v t all accelerations of joints are 0."""
    chain = Chain.between(model, model.getFrameId("left"), model.getFrameId("right"))
    start, v = np.random.default_rng(6).normal(size=(2, model.nv, 1))

    def rates(t):
        q = start + v * t
        return chain.placed(q, np.cos(q), np.sin(q)).rates(v)

    # differences of order 8 at h = 0.02 of numbers near 10
    assert rates(0.3)[2] == pytest.approx(differentiate(lambda t: rates(t)[0], 0.3), abs=1e-8)
    assert rates(0.3)[3] == pytest.approx(differentiate(lambda t: rates(t)[1], 0.3), abs=1e-8)


def test_other_joints_between_make_no_chain():
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.addFrame(pin.Frame("end", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    assert Chain.between(model, 0, model.getFrameId("end")) is None


def test_chains_of_variants_are_those_of_each_model_alone():
    pin.seed(2)
    variants, models = random_variants(np.random.default_rng(2), 6, 3)
    first, second, n = models[0].getFrameId("link 2"), models[0].getFrameId("link 5"), 4
    q, v = np.random.default_rng(3).normal(size=(2, 6, n, 3))
    flat, rates = q.reshape(6, -1), v.reshape(6, -1)
    placed = Chain.between(variants, first, second).repeated(n).placed(flat, np.cos(flat), np.sin(flat))
    found = [np.broadcast_to(x, (3, n * 3)).reshape(3, n, 3) for x in (placed.p, *placed.rates(rates))]
    for k, model in enumerate(models):
        own = Chain.between(model, first, second).placed(q[:, :, k], np.cos(q[:, :, k]), np.sin(q[:, :, k]))
        for one, other in zip(found, (own.p, *own.rates(v[:, :, k])), strict=True):
            np.testing.assert_allclose(one[:, :, k], np.broadcast_to(other, (3, n)), atol=1e-12)


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
