"""Frames seen from other frames of a tree, against Pinocchio's placements, Jacobians and accelerations of both."""

from itertools import permutations

import numpy as np
import pinocchio as pin

from pinarm.mechanics.geometry.frame_pairs import FramePairs

JOINTS = (
    pin.JointModelRX, pin.JointModelSpherical, pin.JointModelFreeFlyer, lambda: pin.JointModelHY(0.3), pin.JointModelPZ,
    lambda: pin.JointModelPrismaticUnaligned(np.array([0.6, 0.0, 0.8])), pin.JointModelSpherical, pin.JointModelRY,
)  # fmt: skip
PARENTS = (0, 1, 2, 3, 2, 5, 6, 7)
"""A stem of two joints with branches of two and four, joints of all kinds in both."""
STATES = 2


def tree() -> pin.Model:
    """Return the tree with a frame on every link."""
    pin.seed(4)
    model = pin.Model()
    for k, (parent, kind) in enumerate(zip(PARENTS, JOINTS, strict=True), 1):
        model.addJoint(parent, kind(), pin.SE3.Random(), f"joint {k}")
        model.addFrame(pin.Frame(f"frame {k}", k, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("ground", 0, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    return model


def states(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    q = np.array([pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)) for _ in range(STATES)])
    return q, rng.normal(size=(STATES, model.nv))


def by_pinocchio(model: pin.Model, first: int, second: int, q: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    """Return p, R, the linear and angular rows and the rates in frame 1, from both frames in the world."""
    data, world = model.createData(), pin.LOCAL_WORLD_ALIGNED
    pin.computeJointJacobians(model, data, q)
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.updateFramePlacements(model, data)
    (one, r1), (two, r2) = ((data.oMf[k].translation, data.oMf[k].rotation) for k in (first, second))
    j1, j2 = (pin.getFrameJacobian(model, data, k, world) for k in (first, second))
    way, back = two - one, r1.T
    linear, angular = back @ (j2[:3] - j1[:3] + pin.skew(way) @ j1[3:]), back @ (j2[3:] - j1[3:])
    (u1, u2), (a1, a2) = (
        [function(model, data, k, world) for k in (first, second)]
        for function in (pin.getFrameVelocity, pin.getFrameClassicalAcceleration)
    )
    w1, w2 = u1.angular, u2.angular
    slip = u2.linear - u1.linear - np.cross(w1, way)
    drift = a2.linear - a1.linear - np.cross(a1.angular, way) - np.cross(w1, np.cross(w1, way)) - 2 * np.cross(w1, slip)
    turning = a2.angular - a1.angular - np.cross(w1, w2)
    return [back @ way, back @ r2, linear, angular, back @ slip, back @ (w2 - w1), back @ drift, back @ turning]


def found(pairs: FramePairs, q: np.ndarray, v: np.ndarray) -> list[list[np.ndarray]]:
    """Return the same of the first pair, state by state."""
    motion = pairs.at_configurations(q)
    columns = np.zeros((2, 3, v.shape[-1], len(q)))
    for k, part in enumerate((motion.linear, motion.angular)):
        columns[k][:, pairs.velocities[:, 0]] = part[:, :, 0]
    rates = motion.rates(v.T)
    return [
        [motion.p[:, 0, k], motion.turn[:, :, 0, k], *columns[..., k], *(rate[:, 0, k] for rate in rates)]
        for k in range(len(q))
    ]


def test_they_move_as_pinocchio_says_of_both() -> None:
    model = tree()
    q, v = states(model)
    for first, second in permutations(range(model.nframes), 2):
        own = found(FramePairs.between(model, first, second), q, v)
        for k in range(STATES):
            for one, other in zip(own[k], by_pinocchio(model, first, second, q[k], v[k]), strict=True):
                np.testing.assert_allclose(one, other, atol=1e-12)  # sums of a dozen numbers up to 10
