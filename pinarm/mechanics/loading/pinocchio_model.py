"""Pinocchio's model from a model file, built joint by joint: nothing is dropped, and no mesh file is opened.

A joint with several coordinates becomes a chain of simple joints, which has the same motion. A
floating joint ``J`` slides along its parent's axes (``J.x``, ``J.y``, ``J.z``), then turns as a ball joint ``J``; its
velocities are the rates of x, y, z, and the angular velocity in the link's own axes. A planar joint slides along two
axes (``J.x``, ``J.y``), then turns (``J.angle``), so that its turns are counted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError, listed, several
from pinarm.input.xml_text import tree_of
from pinarm.input.yaml.schema import FARTHEST, HEAVIEST, LARGEST
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.forces.joint_forces import CREEP
from pinarm.mechanics.loading.model_tree import (
    LIGHTEST,
    Bounds,
    Tree,
    TreeJoint,
    Z,
    check_unique,
    from_z,
)
from pinarm.mechanics.loading.urdf import urdf_tree
from pinarm.records import ValueRecord, replace

BASE = "root"
"""Name of the joint that is added where ``base: floating`` frees a model that its file fixes to the ground."""

MOST = 10_000
"""Largest number of degrees of freedom: Pinocchio's model keeps the joints before and beyond every joint, of a chain
8 nv^2 bytes, here 0.8 GB."""

ALIGNED = 1e-15
"""Deviation from a coordinate axis that is rounding."""

Base = Literal["floating", "fixed"]
Defects = Literal["refused", "noted"]

SIMPLE = {
    "revolute": (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelRevoluteUnaligned),
    "prismatic": (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ, pin.JointModelPrismaticUnaligned),
}


class RobotModel(ValueRecord, frozen=True):
    """Pinocchio's model, with the content of the file that Pinocchio ignores.

    Attributes:
        model: Pinocchio's model; joints depth-first, limits that are not given are infinite.
        friction: Dry friction of joints with one coordinate, by name, which sticks [N*m or N].
    """

    model: pin.Model
    xml: str
    tree: Tree
    forces: Mapping[str, ForceElement] = {}
    friction: Mapping[str, float] = {}
    notes: tuple[str, ...] = ()


def build_model(
    xml: str, *, base: Base | None = None, defects: Defects = "refused", creep: float | None = None, name: str = ""
) -> RobotModel:
    """Build the model of a URDF, MJCF or SDF text.

    Args:
        base: Whether the root is fixed or floating; as in the file if ``None``.
        defects: Whether impossible inertias, and joints that mimic a missing one, are refused, or used and noted.
        creep: Velocity below which dry friction decreases that is to be regularised [rad/s or m/s]; ``None`` where it
            sticks. That of ball joints is regularised in any case. Infinite: there is no dry friction.
    """
    tree = _read(xml, name)
    if base is not None:
        _set_base(tree, base)
    if tree.defects and defects == "refused":
        raise ModelError(tree.defects[0], hint="mend the model, or say 'defects: noted' in the mechanism file")
    parts = [part for joint in tree.joints for part in _parts(joint)]
    model = _assembled(tree, parts)
    _require_weighable(model)
    moving = [*zip(_moving(parts), list(model.joints)[1:], strict=True)]
    rubbing = [part for part, _ in moving if part.friction and creep != np.inf]
    sticking = {} if creep else {part.name: part.friction for part in rubbing if part.kind != "ball"}
    regularised = {part.name: part.friction for part in rubbing if part.name not in sticking}
    tree.remark("closing loops of the tree of joints", *tree.loops)
    notes = (
        *(f"{defect}; taken as written" for defect in tree.defects), *tree.notes,
        *(f"{what}: {several(names)}" for what, names in tree.remarks.items()),
        *_massless(model), *_said(tree, regularised, creep or CREEP),
    )  # fmt: skip
    return RobotModel(model, xml, tree, _passive(moving, regularised, creep or CREEP), sticking, notes)


def _moving(parts: Iterable[TreeJoint]) -> list[TreeJoint]:
    return [part for part in parts if part.kind != "fixed"]


def _read(xml: str, name: str) -> Tree:
    try:
        tree = _tree(tree_of(xml), name)
        tree.keep_known_mimics()
        _require_reach(tree)
    except ArithmeticError as error:
        problem = f"a number that follows from the model is beyond all numbers ({error})"
        raise ModelError(problem, hint="sizes and masses below 1e50") from None
    return tree


def _require_reach(tree: Tree) -> None:
    """Raise where frames or centres of mass are beyond ``FARTHEST``, masses beyond ``HEAVIEST``, others ``LARGEST``."""
    for joint in tree.joints:
        where = f"joint '{joint.name}'"
        for place in (joint.placement, joint.offset):
            frame = f"loop '{joint.made_for}'" if joint.made_for in tree.loops else where
            _require_small(frame, "distance", place.homogeneous, FARTHEST, "m")
        for what in ("stiffness", "damping", "armature"):
            _require_small(where, what, getattr(joint, what), LARGEST, "")
    for name, body in tree.links.items():
        _require_small(f"link '{name}'", "centre of mass", body.lever, FARTHEST, "m")
        _require_small(f"link '{name}'", "mass", body.mass, HEAVIEST, "kg")
        _require_small(f"link '{name}'", "largest moment of inertia", body.inertia, LARGEST, "kg*m^2")


def _require_small(where: str, what: str, values: Array | float, most: float, measured: str) -> None:
    if not (size := float(np.abs(values).max())) <= most:  # or it is no number
        raise ModelError(
            f"{where}: its {what} is {size:g} {measured}".rstrip(),
            expected=f"at most {most:g} {measured}".rstrip(),
            hint="check the exponent and the unit",
        )


def _tree(root: Element, name: str) -> Tree:
    if name and root.tag != "sdf":
        raise ModelError(f"the file is no SDF, of which one could ask for the model '{name}'", hint="no key 'model'")
    if root.tag == "mujoco":
        from pinarm.mechanics.loading.mjcf import mjcf_tree  # not paid for by others

        return mjcf_tree(root)
    if root.tag == "sdf":
        from pinarm.mechanics.loading.sdf import sdf_tree

        return sdf_tree(root, name)
    if root.tag != "robot":
        raise ModelError(
            f"the model begins with <{root.tag}>", expected="<robot> (URDF, xacro), <mujoco> (MJCF) or <sdf>"
        )
    return urdf_tree(root)


def _set_base(tree: Tree, base: Base) -> None:
    """Fix the root of a tree, or let it float.

    A root without mass that carries floating joints alone stands for the ground: they are held, or float already.
    """
    stands = not tree.links[tree.root].mass
    afloat = [joint.name for joint in tree.joints if stands and joint.parent == tree.root and joint.kind == "floating"]
    if base == "fixed":
        tree.joints = [replace(joint, kind="fixed") if joint.name in afloat else joint for joint in tree.joints]
    elif not afloat:
        ground = "ground" if tree.root == "world" else "world"
        free = TreeJoint(BASE, "floating", ground, tree.root, pin.SE3.Identity(), made_for="base: floating")
        tree.links, tree.joints = {ground: pin.Inertia.Zero(), **tree.links}, [free, *tree.joints]
    elif others := [x.name for x in tree.joints if x.parent == tree.root and x.name not in afloat]:
        raise ModelError(
            f"base: floating: '{tree.root}' lets {listed('joint', afloat)} float already, and carries "
            f"{listed('joint', others)} too",
            expected="a root without other joints",
            hint="without 'base: floating' the model is as its file has it",
        )


def _assembled(tree: Tree, parts: list[TreeJoint]) -> pin.Model:
    model = pin.Model()
    model.name = tree.name
    check_unique(tree.root, parts)
    count = sum(3 if joint.kind == "ball" else 1 for joint in _moving(parts))
    if not count:
        raise ModelError(
            "the model has no joint that moves",
            expected="at least one joint that is not fixed",
            hint="base: floating in the mechanism file lets it move freely",
        )
    if count > MOST:
        raise ModelError(f"the model has {count} degrees of freedom", expected=f"at most {MOST}")
    frames = {tree.root: model.addFrame(pin.Frame(tree.root, 0, 0, pin.SE3.Identity(), pin.FrameType.BODY))}
    model.frames[frames[tree.root]].inertia = tree.links[tree.root]
    model.appendBodyToJoint(0, tree.links[tree.root], pin.SE3.Identity())
    for joint in parts:
        frame = _add(model, joint, frames[joint.parent])
        place = model.frames[frame].placement * joint.offset
        carrier = model.frames[frame].parentJoint
        kind = pin.FrameType.BODY if joint.child in tree.links else pin.FrameType.OP_FRAME
        frames[joint.child] = model.addFrame(pin.Frame(joint.child, carrier, frame, place, kind))
        if joint.child in tree.links:
            model.frames[frames[joint.child]].inertia = tree.links[joint.child]
            model.appendBodyToJoint(carrier, tree.links[joint.child], place)
    return model


def _add(model: pin.Model, joint: TreeJoint, before: int) -> int:
    """Add a simple joint to the link of a frame; return the frame of the joint."""
    parent = model.frames[before]
    place = parent.placement * joint.placement
    if joint.kind == "fixed":
        return int(model.addFrame(pin.Frame(joint.name, parent.parentJoint, before, place, pin.FrameType.FIXED_JOINT)))
    index = model.addJoint(parent.parentJoint, _joint_model(joint), place, joint.name)
    made, bounds = model.joints[index], joint.bounds
    for values, value in ((model.lowerPositionLimit, bounds.lower), (model.upperPositionLimit, bounds.upper)):
        values[made.idx_q : made.idx_q + made.nq] = value
    for values, value in (
        (model.velocityLimit, bounds.velocity),
        (model.effortLimit, bounds.effort),
        (model.armature, joint.armature),
        (model.damping, joint.damping),
    ):
        values[made.idx_v : made.idx_v + made.nv] = value
    return int(model.addJointFrame(index, before))


def _joint_model(joint: TreeJoint) -> pin.JointModel:
    if joint.kind == "ball":
        return pin.JointModelSpherical()
    *aligned, general = SIMPLE[joint.kind]
    for axis, made in zip(np.eye(3), aligned, strict=True):
        if np.abs(joint.axis - axis).max() < ALIGNED:
            return made()
    return general(joint.axis)


def _parts(joint: TreeJoint) -> Iterator[TreeJoint]:
    """Yield the simple joints that a joint is made of; the last carries its link."""
    if joint.kind not in ("planar", "floating"):
        yield joint
        return
    turn = joint.placement.rotation @ from_z(joint.axis) if joint.kind == "planar" else np.eye(3)
    place, parent = pin.SE3(turn, joint.placement.translation), joint.parent
    step = replace(joint, kind="prismatic", bounds=Bounds(), rest=0.0, offset=pin.SE3.Identity(), made_for=joint.name)
    for axis, letter in zip(np.eye(3), "xyz" if joint.kind == "floating" else "xy", strict=False):
        name = f"{joint.name}.{letter}"
        yield replace(step, name=name, parent=parent, child=f"{joint.name}/{letter}", placement=place, axis=axis)
        place, parent = pin.SE3.Identity(), f"{joint.name}/{letter}"
    drawn = pin.SE3(turn.T @ joint.placement.rotation, np.zeros(3))
    last = replace(step, parent=parent, child=joint.child, made_for=joint.made_for)
    if joint.kind == "floating":
        yield replace(last, kind="ball", placement=drawn, offset=joint.offset)
    else:
        yield replace(
            last, kind="revolute", name=f"{joint.name}.angle", placement=place, axis=Z, offset=drawn * joint.offset
        )


def _passive(
    moving: list[tuple[TreeJoint, pin.JointModel]], regularised: Mapping[str, float], creep: float
) -> dict[str, ForceElement]:
    """Return springs, damping and regularised friction of the joints as elements: Pinocchio does not apply them."""
    if not (regularised or any(part.damping or part.stiffness for part, _ in moving)):
        return {}
    from pinarm.mechanics.forces.joint_forces import BallSpring, DryFriction, SpringDamper

    rows = [part for part, joint in moving for _ in range(joint.nv)]
    damping = np.array([part.damping for part in rows])
    friction = np.array([regularised.get(part.name, 0.0) for part in rows])
    damped, rubbed = np.flatnonzero(damping), np.flatnonzero(friction)
    forces: dict[str, ForceElement] = {}
    if len(damped):
        none = np.zeros(len(damped))
        forces["joint damping"] = SpringDamper(damped, damped, none, damping[damped], none)
    if len(rubbed):
        forces["joint friction"] = DryFriction(rubbed, friction[rubbed], np.full(len(rubbed), creep))
    sprung = [(part, joint) for part, joint in moving if part.stiffness]
    if single := [(joint.idx_q, joint.idx_v, part.stiffness, part.rest) for part, joint in sprung if joint.nv == 1]:
        q, v, stiffness, rest = (np.array(values) for values in zip(*single, strict=True))
        forces["joint springs"] = SpringDamper(q, v, stiffness, np.zeros(len(v)), rest)
    for part, joint in sprung:
        if joint.nv == 3:
            forces[f"spring of {part.name}"] = BallSpring(joint.idx_q, joint.idx_v, part.stiffness)
    return forces


def _require_weighable(model: pin.Model) -> None:
    """Raise where a body beyond a joint is so light that sums of inertias lose its centre of mass.

    Pinocchio divides by the mass or by the rounding of 1, 2.2e-16, whichever is larger.
    """
    for name, body in zip(model.names, model.inertias, strict=True):
        if 0.0 < body.mass < LIGHTEST:
            raise ModelError(
                f"what joint '{name}' carries has a mass of {body.mass:.3g} kg",
                expected=f"0, or at least {LIGHTEST:g} kg",
                hint="check the exponent and the unit",
            )


def _massless(model: pin.Model) -> Iterator[str]:
    heavy = [bool(body.mass or body.inertia.any()) for body in model.inertias]
    idle = [not any(heavy[joint] for joint in model.subtrees[index]) for index in range(model.njoints)]
    names = [model.names[index] for index in range(1, model.njoints) if idle[index] and not idle[model.parents[index]]]
    if names:
        yield f"nothing beyond {listed('joint', names)} has a mass"


def _said(tree: Tree, regularised: Mapping[str, float], creep: float) -> Iterator[str]:
    if regularised:
        yield (
            f"dry friction F of {listed('joint', [*regularised])} is regularised, "
            f"F tanh(v / {creep:g}), v in rad/s or m/s: a joint that ought to stick under a load creeps, "
            f"with {creep:g} atanh(load / F)"
        )
    several_ways = [joint for joint in tree.joints if joint.kind in ("ball", "planar", "floating")]
    if limited := [joint.name for joint in several_ways if joint.bounds != Bounds()]:
        yield f"limits of {listed('joint', limited)} are not watched: they have several coordinates"


def file_suffix(xml: str) -> str:
    """Return the suffix of a file with this model text."""
    return {"mujoco": ".xml", "sdf": ".sdf"}.get(tree_of(xml).tag, ".urdf")
