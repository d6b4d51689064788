"""Random trees, and random variants of them, for tests of what has an axis of variants."""

import numpy as np
import pinocchio as pin

from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantFrame, VariantPlacement

JOINTS = (
    pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelPX, pin.JointModelPZ,
    lambda: pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
    lambda: pin.JointModelPrismaticUnaligned(np.array([0.0, 0.28, 0.96])),
)  # fmt: skip


def random_tree(rng: np.random.Generator, joints: int) -> pin.Model:
    """Return a tree with branches, joints of all kinds with one coordinate, and armatures.

    Joints are depth-first, as in all models: ``crba`` takes what lies beyond a joint to follow it.
    """
    model = pin.Model()
    for k in range(joints):
        parent, kind = int(rng.choice(list(model.supports[k]))), JOINTS[rng.integers(len(JOINTS))]
        joint = model.addJoint(parent, kind(), pin.SE3.Random(), f"joint {k}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"link {k}", joint, 0, pin.SE3.Random(), pin.FrameType.BODY))
    model.armature[:] = rng.uniform(0.0, 1.0, model.nv)
    model.gravity.linear = rng.normal(size=3)
    return model


def random_variants(rng: np.random.Generator, joints: int, count: int) -> tuple[ModelVariants, list[pin.Model]]:
    """Return variants of a random tree, some of whose bodies and placements vary, and the model of each alone."""
    first = random_tree(rng, joints)
    models = [first.copy() for _ in range(count)]
    bodies, moved = (sorted((rng.permutation(joints)[: rng.integers(1, joints + 1)] + 1).tolist()) for _ in range(2))
    for model in models:
        for joint in bodies:
            model.inertias[joint] = pin.Inertia.Random()
        for joint in moved:
            model.jointPlacements[joint] = pin.SE3.Random()
    parameters = [[model.inertias[joint].toDynamicParameters() for joint in bodies] for model in models]
    turns = [[model.jointPlacements[joint].rotation for joint in moved] for model in models]
    shifts = [[model.jointPlacements[joint].translation for joint in moved] for model in models]
    frames = [VariantFrame(frame.name, frame.type, frame.parentJoint, VariantPlacement.of(frame.placement))
              for frame in first.frames]  # fmt: skip
    return ModelVariants(first, frames, bodies, np.array(parameters), moved, np.array(turns),
                         np.array(shifts)), models  # fmt: skip
