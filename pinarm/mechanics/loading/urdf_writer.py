"""A ``pin.Model`` as URDF text, which the reader of URDF loads like any other.

The numbers have all their digits. A joint keeps its name; those with several angles or ways become chains of simple
ones, which have the same coordinates:

=======================  =============================================================================
Pinocchio's joint        URDF
=======================  =============================================================================
R*, P*, RUB*             ``revolute``, ``prismatic``, ``continuous``
FreeFlyer, Planar        ``floating``, ``planar``
Spherical                ``spherical``, a type that pinarm's reader knows beside those of URDF
SphericalZYX J           ``continuous`` J.z, J.y, J.x
Translation J            ``prismatic`` J.x, J.y, J.z
Universal J              ``continuous`` J.1, J.2
=======================  =============================================================================

What a joint carries is one link, with all the mass of it. Frames are links without mass, fixed to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.mechanics.ball_joints import roll_pitch_yaw

Element = ElementTree.Element

CHAINS = {"SphericalZYX": ("z", "y", "x"), "Translation": ("x", "y", "z"), "Universal": ("1", "2")}
"""Kind of joint -> endings of the names of the simple joints that it is a chain of."""

WHOLE = {"FreeFlyer": "floating", "Planar": "planar", "Spherical": "spherical"}
"""Kind of joint -> type in URDF."""

REFUSED = {
    "Composite": "its joints have no names of their own: add them one by one",
    "Mimic": "add it as a joint of its own, and say 'couplings' with kind: gear",
    "Helical": "add a revolute and a prismatic joint, and say 'couplings' with kind: screw",
    "Ellipsoid": "there is no such joint here",
}
"""Kind of joint -> what to do in its place."""

HELICAL = ("HX", "HY", "HZ")

UNLIMITED = 1e100
"""Limits beyond it are those of models that have none: the largest double, or infinity."""


def written(model: pin.Model) -> tuple[str, tuple[str, ...]]:
    """Return a model as URDF text, and what of it is not in the text, in words."""
    if model.njoints < 2:
        raise ModelError("the model has no joint", expected="a pin.Model with one joint at least")
    links = _links(model)
    robot = ElementTree.Element("robot", name=model.name or "model")
    for joint in range(model.njoints):
        add_link(robot, links[joint], model.inertias[joint] if joint else None)
    for joint in range(1, model.njoints):
        _add_joint(robot, model, joint, links)
    taken = {*links}
    for frame in list(model.frames)[1:]:
        joint = frame.parentJoint
        if frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT) or frame.name == links[joint]:
            continue
        if frame.name in taken:
            raise ModelError(f"two frames have the name '{frame.name}'", expected="a name of its own for each")
        taken.add(frame.name)
        add_link(robot, frame.name)
        add_joint(robot, f"{frame.name}_fixed", "fixed", links[joint], frame.name, frame.placement)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode") + "\n", tuple(_notes(model))


def add_link(robot: Element, name: str, body: pin.Inertia | None = None) -> None:
    """Add a link to a ``<robot>``, with its inertia about its own frame."""
    link = ElementTree.SubElement(robot, "link", name=name)
    if body is None or not (body.mass or np.any(body.inertia)):
        return
    inertial, moments = ElementTree.SubElement(link, "inertial"), body.inertia
    ElementTree.SubElement(inertial, "origin", xyz=_text(body.lever))
    ElementTree.SubElement(inertial, "mass", value=repr(float(body.mass)))
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": repr(float(moments[i, j])) for i in range(3) for j in range(i, 3)}
    ElementTree.SubElement(inertial, "inertia", entries)


def add_joint(robot: Element, name: str, kind: str, parent: str, child: str, place: pin.SE3) -> Element:
    """Add a joint to a ``<robot>``, which has a placement in its parent link."""
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    angles = roll_pitch_yaw(pin.Quaternion(place.rotation).normalized().coeffs())  # keeps all digits at any pitch
    ElementTree.SubElement(joint, "origin", xyz=_text(place.translation), rpy=_text(angles))
    return joint


def add_axis(joint: Element, axis: Array) -> None:
    """Add the axis of a joint, shape (3,)."""
    ElementTree.SubElement(joint, "axis", xyz=_text(axis))


def _links(model: pin.Model) -> list[str]:
    """Return the name of the link of every joint: that of a body's frame at the joint, or the joint's with _link."""
    bodies: list[list[str]] = [[] for _ in range(model.njoints)]
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.placement.isIdentity(0.0):
            bodies[frame.parentJoint].append(str(frame.name))
    links: list[str] = []
    for joint, names in enumerate(bodies):
        base = f"{model.names[joint]}_link" if joint else "universe"
        links.append(next((name for name in names if name not in links), base))
    return links


def _add_joint(robot: Element, model: pin.Model, index: int, links: list[str]) -> None:
    joint, name, place = model.joints[index], model.names[index], model.jointPlacements[index]
    kind, parent = joint.shortname().removeprefix("JointModel"), links[model.parents[index]]
    if advice := REFUSED.get("Helical" if kind in HELICAL else kind.removesuffix("Unaligned")):
        raise ModelError(f"the joint '{name}' is a {joint.shortname()}, which is not taken over", hint=advice)
    if kind in WHOLE:
        whole = add_joint(robot, name, WHOLE[kind], parent, links[index], place)
        add_axis(whole, np.array([0.0, 0.0, 1.0]))
        _add_dynamics(whole, model, range(joint.idx_v, joint.idx_v + joint.nv), name)
        return
    names = [f"{name}.{ending}" for ending in CHAINS[kind]] if kind in CHAINS else [name]
    ends = [*(f"{part}/link" for part in names[:-1]), links[index]]
    for k, (part, screw, child) in enumerate(zip(names, _screws(model, joint), ends, strict=True)):
        if child != links[index]:
            add_link(robot, child)
        turns, ranged = bool(screw[3:].any()), kind in CHAINS or joint.nq == joint.nv  # else cosine and sine
        limits = _limits(model, joint.idx_q + k if ranged else None, joint.idx_v + k)
        type_name = "prismatic" if not turns else "revolute" if "lower" in limits else "continuous"
        simple = add_joint(robot, part, type_name, parent, child, place)
        add_axis(simple, screw[3:] if turns else screw[:3])
        if limits:
            ElementTree.SubElement(simple, "limit", {key: repr(value) for key, value in limits.items()})
        _add_dynamics(simple, model, range(joint.idx_v + k, joint.idx_v + k + 1), part)
        parent, place = child, pin.SE3.Identity()


def _screws(model: pin.Model, joint: pin.JointModel) -> Array:
    """Return the columns of S at the zero position, shape (coordinates, 6)."""
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    return np.asarray(data.S).reshape(6, -1).T


def _limits(model: pin.Model, q: int | None, v: int) -> dict[str, float]:
    """Return the limits of a joint with one coordinate, by their names in URDF."""
    limits: dict[str, float] = {}
    if q is not None:
        low, high = float(model.lowerPositionLimit[q]), float(model.upperPositionLimit[q])
        if min(abs(low), abs(high)) < UNLIMITED:
            most = float(np.finfo(float).max)
            limits |= {"lower": max(low, -most), "upper": min(high, most)}
    for key, values in (("effort", model.upperEffortLimit), ("velocity", model.upperVelocityLimit)):
        if 0.0 < values[v] < UNLIMITED:
            limits[key] = float(values[v])
    return limits


def _add_dynamics(element: Element, model: pin.Model, places: range, name: str) -> None:
    values: dict[str, float] = {}
    for key, limits in (
        ("damping", model.damping),
        ("friction", model.upperDryFrictionLimit),
        ("armature", model.armature),
    ):
        some = {float(limits[k]) for k in places}
        if len(some) > 1:
            raise ModelError(
                f"the joint '{name}' has another {key} in each direction",
                expected="the same in all, or joints with one coordinate",
            )
        if (value := some.pop()) and value < UNLIMITED:
            values[key] = value
    if values:
        ElementTree.SubElement(element, "dynamics", {key: repr(value) for key, value in values.items()})


def _notes(model: pin.Model) -> Iterator[str]:
    if np.any(model.rotorInertia):
        yield "rotor inertias and gear ratios of the pin.Model, which Pinocchio's dynamics leaves out, are not taken"
    if len(model.referenceConfigurations):
        yield "reference configurations of the pin.Model are not taken"
    if np.any(model.lowerDryFrictionLimit + model.upperDryFrictionLimit):
        yield "dry friction of the pin.Model is taken in both directions as its upper limit says"


def _text(vector: Array) -> str:
    return " ".join(repr(float(part) + 0.0) for part in vector)
