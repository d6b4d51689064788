"""Trees with every kind of joint, for tests of the compiled kernel."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from pinarm.engine.kernel.library import Flow
from pinarm.engine.kernel.tree import CompiledTree

SKEW = np.array([2.0, -1.0, 2.0]) / 3.0

CONTINUOUS = """<robot name="r"><link name="base"/><link name="l"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0.6 0 0.8"/></joint></robot>"""


def unbounded() -> pin.JointModel:
    """Return the joint with (cos, sin) about a skew axis: only a file makes it."""
    return pin.buildModelFromXML(CONTINUOUS).joints[1]


JOINTS: dict[str, Callable[[], pin.JointModel]] = {
    "RX": pin.JointModelRX, "RY": pin.JointModelRY, "RZ": pin.JointModelRZ,
    "RevoluteUnaligned": lambda: pin.JointModelRevoluteUnaligned(SKEW),
    "PX": pin.JointModelPX, "PY": pin.JointModelPY, "PZ": pin.JointModelPZ,
    "PrismaticUnaligned": lambda: pin.JointModelPrismaticUnaligned(SKEW),
    "HX": lambda: pin.JointModelHX(0.3), "HY": lambda: pin.JointModelHY(-0.2), "HZ": lambda: pin.JointModelHZ(0.1),
    "HelicalUnaligned": lambda: pin.JointModelHelicalUnaligned(SKEW, 0.4),
    "RUBX": pin.JointModelRUBX, "RUBY": pin.JointModelRUBY, "RUBZ": pin.JointModelRUBZ,
    "RevoluteUnboundedUnaligned": unbounded,
    "Spherical": pin.JointModelSpherical, "FreeFlyer": pin.JointModelFreeFlyer, "Planar": pin.JointModelPlanar,
    "Translation": pin.JointModelTranslation,
}  # fmt: skip
"""Every joint that the kernel knows, by Pinocchio's name without ``JointModel``."""

UNKNOWN: dict[str, Callable[[], pin.JointModel]] = {
    "SphericalZYX": pin.JointModelSphericalZYX,
    "Universal": lambda: pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])),
}


def tree(joints: list[str], seed: int, branching: bool = True) -> pin.Model:
    """Return a tree of joints with random bodies, placements, rotors and gravity."""
    random, model = np.random.default_rng(seed), pin.Model()
    pin.seed(seed)
    for name in joints:
        make = JOINTS.get(name) or UNKNOWN[name]
        parent = int(random.integers(model.njoints)) if branching else model.njoints - 1
        joint = model.addJoint(parent, make(), pin.SE3.Random(), f"{name}_{model.njoints}")
        body = pin.Inertia.Random()
        model.appendBodyToJoint(joint, body, pin.SE3.Random())
    model.armature = random.uniform(0.0, 0.5, model.nv)
    model.gravity = pin.Motion(random.normal(size=3) * 5.0, np.zeros(3))
    return model


def states(model: pin.Model, count: int, seed: int = 1) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return random states, some turns away from zero."""
    random = np.random.default_rng(seed)
    return [
        (pin.integrate(model, pin.neutral(model), random.normal(size=model.nv) * 3.0), random.normal(size=model.nv))
        for _ in range(count)
    ]


def compiled(model: pin.Model, steady: np.ndarray, changing: tuple = ()) -> Flow:
    """Return the free motion of a tree under steady and other loads, in compiled code."""
    tree, held = CompiledTree.of(model).under(steady, changing)
    return tree.flow(held)
