"""Buffers of a model's own size against Pinocchio's: equal to the last bit, as it is the same code that fills them.

An algorithm that misses a buffer writes to memory that is not its own. Each tree therefore is computed by a process of
its own, whose death is a failed test.
"""

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.geometry import kinematics

KINDS = (
    "JointModelRX",
    "JointModelRevoluteUnaligned",
    "JointModelPY",
    "JointModelPrismaticUnaligned",
    "JointModelRUBZ",
    "JointModelHelicalUnaligned",
    "JointModelSpherical",
    "JointModelPlanar",
    "JointModelTranslation",
    "JointModelFreeFlyer",
    "JointModelSphericalZYX",
    "JointModelUniversal",
)
SKEW = np.array([2.0, -3.0, 6.0]) / 7.0


def joint_model(name):
    if name == "JointModelUniversal":
        return pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    if name == "JointModelHelicalUnaligned":
        return pin.JointModelHelicalUnaligned(SKEW, 0.1)
    return getattr(pin, name)(SKEW) if name.endswith("Unaligned") else getattr(pin, name)()


def tree(kinds, branching):
    """Return a tree with the kinds of joints, ``branching`` of them on each."""
    generator, model = np.random.default_rng(3), pin.Model()
    children = {}
    for k in range(1, len(kinds) + 1):
        children.setdefault((k - 1) // branching, []).append(k)

    def grow(parent, carrier):
        for k in children.get(parent, ()):
            place = pin.SE3(pin.exp3(generator.normal(size=3)), generator.normal(size=3))
            joint = model.addJoint(carrier, joint_model(kinds[k - 1]), place, f"joint{k}")
            model.addJointFrame(joint)
            model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
            model.addFrame(pin.Frame(f"end{k}", joint, place, pin.FrameType.OP_FRAME))
            grow(k, joint)

    grow(0, 0)
    model.armature[:] = generator.uniform(0.0, 0.1, model.nv)
    return model


def state(model):
    generator = np.random.default_rng(5)
    q = pin.integrate(model, pin.neutral(model), generator.uniform(-1.0, 1.0, model.nv))
    return q, generator.normal(size=model.nv), generator.normal(size=model.nv)


def computed(model, data):
    """Return what all algorithms compute that buffers of a model's own size are given to, by their names."""
    q, v, a = state(model)
    push = pin.StdVec_Force()
    push.extend([pin.Force(np.arange(6.0) + k) for k in range(model.njoints)])
    found = {
        "rnea": pin.rnea(model, data, q, v, a),
        "rnea under forces": pin.rnea(model, data, q, v, a, push),
        "f": [each.vector for each in data.f],
        "nonLinearEffects": pin.nonLinearEffects(model, data, q, v),
        "computeGeneralizedGravity": pin.computeGeneralizedGravity(model, data, q),
        "aba": pin.aba(model, data, q, v, a),
        "computeKineticEnergy": pin.computeKineticEnergy(model, data, q, v),
        "computePotentialEnergy": pin.computePotentialEnergy(model, data, q),
        "computeMechanicalEnergy": pin.computeMechanicalEnergy(model, data, q, v),
        "computeJointJacobian": pin.computeJointJacobian(model, data, q, model.njoints - 1),
        "computeFrameJacobian": pin.computeFrameJacobian(model, data, q, model.nframes - 1),
        "computeJointJacobians": pin.computeJointJacobians(model, data, q).copy(),
    }
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    found["a"], found["oMi"] = [each.vector for each in data.a], [each.homogeneous for each in data.oMi]
    found["updateFramePlacement"] = pin.updateFramePlacement(model, data, model.nframes - 1).homogeneous
    for axes in (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED):
        found[f"getJointJacobian {axes}"] = [
            pin.getJointJacobian(model, data, joint, axes).copy() for joint in range(1, model.njoints)
        ]
        for name in ("getFrameJacobian", "getFrameVelocity", "getFrameAcceleration", "getFrameClassicalAcceleration"):
            values = [getattr(pin, name)(model, data, frame, axes) for frame in range(model.nframes)]
            found[f"{name} {axes}"] = [getattr(value, "vector", value) for value in values]
    pin.framesForwardKinematics(model, data, q)
    found["oMf"] = [each.homogeneous for each in data.oMf]
    found["crba"] = np.triu(pin.crba(model, data, q).reshape(model.nv, -1))
    return found


def compare(kinds, branching):
    kinematics.WIDE = 0
    model = tree(kinds, branching)
    own = kinematics.with_masses(model, kinematics.new_data(model))
    lean, full = computed(model, own), computed(model, model.createData())
    for name, value in full.items():
        np.testing.assert_array_equal(np.asarray(lean[name]), np.asarray(value), err_msg=name)


def run(code):
    """Return what code prints with the names of this module, in a process of its own."""
    code = f"import sys; sys.path[:0] = {[*sys.path, '.']!r}; from test_pinocchio_data import *; {code}"
    done = subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize("branching", [2, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 5))])
def test_same_as_pinocchios(branching):
    kinds = [KINDS[(5 * k + branching) % len(KINDS)] for k in range(2 * len(KINDS))]
    run(f"compare({kinds!r}, {branching})")


def size():
    """Print how much memory the buffers of 2,000 links take [MB]."""
    model = tree(["JointModelRX"] * 2000, 2)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    data = kinematics.new_data(model)
    assert len(data.joints) == 2001
    print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)


def test_size():
    """They take 9 kB a link; each matrix of nv^2 would take 32 MB more, ``createData`` 400 GB."""
    assert float(run("size()")) < 40.0
