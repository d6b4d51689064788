"""Pinocchio's model from a model file, built joint by joint: nothing is dropped, and no mesh file is opened.

A joint with several coordinates becomes a chain of simple joints, which has the same motion. A
floating joint ``J`` slides along its parent's axes (``J.x``, ``J.y``, ``J.z``), then turns as a ball joint ``J``; its
velocities are the rates of x, y, z, and the angular velocity in the link's own axes. A planar joint slides along two
axes (``J.x``, ``J.y``), then turns (``J.angle``), so that its turns are counted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from msgspec import field

from pinarm.arrays import Array
from pinarm.errors import ModelError, listed
from pinarm.input.xml_text import is_foreign, tree_of
from pinarm.input.yaml.schema import FARTHEST, HEAVIEST, LARGEST
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.forces.joint_forces import CREEP
from pinarm.mechanics.loading.model_tree import (
    LIGHTEST,
    Bounds,
    Mimic,
    Tree,
    TreeJoint,
    Z,
    check_unique,
    from_z,
    with_held,
)
from pinarm.mechanics.loading.urdf.reader import urdf_tree
from pinarm.records import ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.kinds import CouplingDefinition
    from pinarm.mechanics.loops.kinds import Loop

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
        gravity: Gravity field of the file [m/s^2], world axes, shape (3,); ``None`` where it gives none.
    """

    model: pin.Model
    xml: str
    forces: Mapping[str, ForceElement] = field(default_factory=dict)
    friction: Mapping[str, float] = field(default_factory=dict)
    mimics: tuple[Mimic, ...] = ()
    loops: Mapping[str, Loop] = field(default_factory=dict)
    couplings: Mapping[str, CouplingDefinition] = field(default_factory=dict)
    gravity: Array | None = None
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
    xml, tree = _read(xml, name)
    tree = _with_base(tree, base)
    if creep == np.inf:
        tree = replace(tree, joints=[replace(joint, friction=0.0) for joint in tree.joints])
    if tree.defects and defects == "refused":
        raise ModelError(tree.defects[0], hint="mend the model, or say 'defects: noted' in the mechanism file")
    model = _assembled(tree)
    _require_weighable(model)
    forces = _passive(model, tree, creep)
    notes = [
        *(f"{defect}; taken as written" for defect in tree.defects),
        *tree.notes,
        *_massless(model),
        *_said(tree, creep),
    ]
    sticking = {} if creep else {part.name: part.friction for part in _rubbing(tree) if part.kind != "ball"}
    return RobotModel(model, xml, forces, sticking, tree.mimics, tree.loops, tree.couplings, tree.gravity, tuple(notes))


def _read(xml: str, name: str) -> tuple[str, Tree]:
    root = tree_of(xml)
    if any(":" in element.tag or any(map(_is_undeclared, element.attrib)) for element in root.iter()):
        xml = ElementTree.tostring(_without_prefixes(tree_of(xml)), encoding="unicode")
    try:
        return xml, _within_reach(with_held(_within_reach(_tree(root, name))))
    except ArithmeticError as error:
        problem = f"a number that follows from the model is beyond all numbers ({error})"
        raise ModelError(problem, hint="sizes and masses below 1e50") from None


def _is_undeclared(name: str) -> bool:
    return is_foreign(name) and not name.startswith("xmlns:")


def _without_prefixes(root: ElementTree.Element) -> ElementTree.Element:
    """Remove elements and attributes of other formats, which may have prefixes that are not declared."""
    for element in root.iter():
        element[:] = [child for child in element if not is_foreign(child.tag)]
        for key in [key for key in element.attrib if is_foreign(key)]:
            del element.attrib[key]
    return root


def _within_reach(tree: Tree) -> Tree:
    """Return the tree if its frames and centres of mass are within ``FARTHEST``, its masses within ``HEAVIEST``.

    Moments of inertia and coefficients of joints are within ``LARGEST``.
    """
    ends = {name: getattr(loop, "between", ()) for name, loop in tree.loops.items()}
    frames = {frame: f"loop '{name}'" for name, tied in ends.items() for frame in tied}
    for joint in tree.joints:
        where = f"joint '{joint.name}'"
        for place in (joint.placement, joint.offset):
            _require_small(frames.get(joint.child, where), "distance", place.translation, FARTHEST, "m")
        for what in ("stiffness", "damping", "armature"):
            _require_small(where, what, getattr(joint, what), LARGEST, "")
    for name, body in tree.links.items():
        _require_small(f"link '{name}'", "centre of mass", body.lever, FARTHEST, "m")
        _require_small(f"link '{name}'", "mass", body.mass, HEAVIEST, "kg")
        _require_small(f"link '{name}'", "largest moment of inertia", body.inertia, LARGEST, "kg*m^2")
    return tree


def _require_small(where: str, what: str, values: Array | float, most: float, measured: str) -> None:
    size = float(np.abs(values).max())
    if size > most:
        raise ModelError(
            f"{where}: its {what} is {size:g} {measured}".rstrip(),
            expected=f"at most {most:g} {measured}".rstrip(),
            hint="check the exponent and the unit",
        )


def _tree(root: ElementTree.Element, name: str) -> Tree:
    if name and root.tag != "sdf":
        raise ModelError(f"the file is no SDF, of which one could ask for the model '{name}'", hint="no key 'model'")
    if root.tag == "mujoco":
        from pinarm.mechanics.loading.mjcf.reader import mjcf_tree  # not paid for by others

        return mjcf_tree(root)
    if root.tag == "sdf":
        from pinarm.mechanics.loading.sdf.reader import sdf_tree

        return sdf_tree(root, name)
    if root.tag != "robot":
        raise ModelError(
            f"the model begins with <{root.tag}>", expected="<robot> (URDF, xacro), <mujoco> (MJCF) or <sdf>"
        )
    return urdf_tree(root)


def _with_base(tree: Tree, base: Base | None) -> Tree:
    """Return the tree with its root fixed or floating.

    A root without mass that carries floating joints stands for the ground: what these carry is held, or floats already.
    """
    if base is None:
        return tree
    afloat = [joint.name for joint in tree.joints if joint.parent == tree.root and joint.kind == "floating"]
    if tree.links[tree.root].mass:
        afloat = []
    if base == "fixed":
        joints = (replace(joint, kind="fixed") if joint.name in afloat else joint for joint in tree.joints)
        return replace(tree, joints=tuple(joints))
    if afloat:
        if standing := _standing(tree):
            raise ModelError(
                f"base: floating: '{tree.root}' lets {listed('joint', afloat)} float already, and carries "
                f"{listed('joint', standing)} too",
                expected="a root without other joints",
                hint="without 'base: floating' the model is as its file has it",
            )
        return tree
    ground = "ground" if tree.root == "world" else "world"
    free = TreeJoint(BASE, "floating", ground, tree.root, pin.SE3.Identity(), made_for="base: floating")
    return replace(tree, links={ground: pin.Inertia.Zero(), **tree.links}, joints=(free, *tree.joints))


def _standing(tree: Tree) -> list[str]:
    first = dict[str, str]()
    heavy = dict[str, None]()
    for joint in tree.joints:
        first[joint.child] = first.get(joint.parent, joint.name)
        if joint.child in tree.links and tree.links[joint.child].mass:
            heavy[first[joint.child]] = None
    return [joint.name for joint in tree.joints if joint.name in heavy and joint.kind != "floating"]


def _assembled(tree: Tree) -> pin.Model:
    model = pin.Model()
    model.name = tree.name
    simple = [part for joint in tree.joints for part in _parts(joint)]
    check_unique(tree.root, simple)
    count = sum(3 if joint.kind == "ball" else 1 for joint in simple if joint.kind != "fixed")
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
    for joint in simple:
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


def _rubbing(tree: Tree) -> list[TreeJoint]:
    parts = (part for joint in tree.joints for part in _parts(joint))
    return [part for part in parts if part.friction and part.kind != "fixed"]


def _passive(model: pin.Model, tree: Tree, creep: float | None) -> dict[str, ForceElement]:
    """Return springs, damping and regularised friction of the joints as elements: Pinocchio does not apply them."""
    parts = {part.name: part for joint in tree.joints for part in _parts(joint)}
    of = [(parts[model.names[made.id]], made) for made in model.joints[1:]]
    if not any(joint.damping or joint.friction or joint.stiffness for joint, _ in of):
        return {}
    from pinarm.mechanics.forces.joint_forces import BallSpring, DryFriction, SpringDamper

    rows = [joint for joint, made in of for _ in range(made.nv)]
    damping, friction = (np.array([getattr(joint, key) for joint in rows]) for key in ("damping", "friction"))
    regularised = [creep is not None or joint.kind == "ball" for joint in rows]
    damped, rubbed = np.flatnonzero(damping), np.flatnonzero(friction * regularised)
    forces: dict[str, ForceElement] = {}
    if len(damped):
        none = np.zeros(len(damped))
        forces["joint damping"] = SpringDamper(damped, damped, none, damping[damped], none)
    if len(rubbed):
        forces["joint friction"] = DryFriction(rubbed, friction[rubbed], np.full(len(rubbed), creep or CREEP))
    sprung = [(joint, made) for joint, made in of if joint.stiffness]
    if single := [(made.idx_q, made.idx_v, joint.stiffness, joint.rest) for joint, made in sprung if made.nv == 1]:
        q, v, stiffness, rest = (np.array(values) for values in zip(*single, strict=True))
        forces["joint springs"] = SpringDamper(q, v, stiffness, np.zeros(len(v)), rest)
    balls = {
        f"spring of {joint.name}": BallSpring(made.idx_q, made.idx_v, joint.stiffness)
        for joint, made in sprung
        if made.nv == 3
    }
    return {**forces, **balls}


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


def _said(tree: Tree, creep: float | None) -> Iterator[str]:
    rubbed = [joint.name for joint in _rubbing(tree) if creep or joint.kind == "ball"]
    if rubbed:
        slow = creep or CREEP
        yield (
            f"dry friction F of {listed('joint', rubbed)} is regularised, F tanh(v / {slow:g}), v in rad/s or m/s: "
            f"a joint that ought to stick under a load creeps, with {slow:g} atanh(load / F)"
        )
    several = [joint for joint in tree.joints if joint.kind in ("ball", "planar", "floating")]
    if limited := [joint.name for joint in several if joint.bounds != Bounds()]:
        yield f"limits of {listed('joint', limited)} are not watched: they have several coordinates"


def file_suffix(xml: str) -> str:
    """Return the suffix of a file with this model text."""
    return {"mujoco": ".xml", "sdf": ".sdf"}.get(ElementTree.fromstring(xml).tag, ".urdf")
