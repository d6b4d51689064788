"""The joints of MJCF bodies: where they are, how far they go, and the springs and dampers in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.mechanics.loading.mjcf.settings import (
    ACTUATOR,
    Attributes,
    Settings,
    known,
    number_in,
    numbers_in,
)
from pinarm.mechanics.loading.model_tree import Bounds, Kind, TreeJoint
from pinarm.mechanics.loading.values import direction, word
from pinarm.records import replace

KINDS: dict[str, Kind] = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}

COEFFICIENTS: dict[str, frozenset[str]] = {
    "stiffness": frozenset({"passive", "spring"}),
    "damping": frozenset({"passive", "damper"}),
    "frictionloss": frozenset({"frictionloss", "constraint"}),
    "armature": frozenset(),
}
"""Coefficients of joints, and the flags of the model that switch them off."""

POLYNOMIALS = ("stiffness", "damping")
"""Coefficients that may be followed by those of the second and the third power."""

UNSAID = ("auto", "true", "false")

Notes = dict[str, list[str]]
"""Feature that is not modelled -> names of the elements that have it."""


class BodyElement(NamedTuple):
    """An element of a body: its tag, its attributes with those of its class, the placement of its ``<frame>``."""

    tag: str
    attributes: Attributes
    frame: pin.SE3


def elements_of(settings: Settings, body: Element, childclass: str, *tags: str) -> Iterator[BodyElement]:
    """Yield the elements of some kinds that belong to a body itself, those in frames with the frame's placement.

    They come in the order of the file, in which the joints of a body follow each other.
    """
    waiting = [(child, pin.SE3.Identity(), childclass) for child in reversed(body)]
    while waiting:
        element, place, inherited = waiting.pop()
        if element.tag in tags:
            plain = element.tag in ("freejoint", "inertial")
            yield BodyElement(element.tag, element.attrib if plain else settings.attributes(element, inherited), place)
        elif element.tag == "frame":
            inner = place * settings.placement(element.attrib, f"a frame of body '{body.get('name', '')}'")
            within = element.get("childclass", inherited)
            waiting += [(child, inner, within) for child in reversed(element)]


def joint_chain(
    settings: Settings, joints: Sequence[BodyElement], parent: str, body: str, place: pin.SE3, notes: Notes
) -> Iterator[TreeJoint]:
    """Yield the joints of a body as a chain: each moves in the frame of the one before it.

    Args:
        joints: The ``<joint>`` elements of the body.
        place: Placement of the body in the parent link at the reference pose.
    """
    free = any(joint.tag == "freejoint" or joint.attributes.get("type") == "free" for joint in joints)
    if free and (len(joints) > 1 or parent != "world"):
        raise ModelError(f"body '{body}': a free joint stands alone, in a body of the world")
    for k, part in enumerate(joints):
        name = part.attributes.get("name") or (
            f"{body}_free" if free else f"{body}_joint{k + 1 if len(joints) > 1 else ''}"
        )
        child = body if k == len(joints) - 1 else f"{body}/{name}"
        kind = (
            "free" if part.tag == "freejoint" else word(part.attributes.get("type"), (*KINDS,), f"joint '{name}': type")
        )
        joint = _joint(settings, part, name, KINDS[kind], notes)
        made_for = name if child != body else ""
        yield replace(joint, parent=parent, child=child, placement=place * joint.placement, made_for=made_for)
        parent, place = child, pin.SE3.Identity()


def aligned(settings: Settings, joint: BodyElement) -> bool:
    """Return whether MuJoCo moves the frame of a free body without bodies on it to its inertia."""
    if joint.tag != "freejoint":
        return settings.aligns and joint.attributes.get("type") == "free"
    said = word(joint.attributes.get("align"), UNSAID, "freejoint: align")
    return settings.aligns if said == "auto" else said == "true"


def with_actuators(
    settings: Settings, model: Element, joints: Mapping[str, TreeJoint], notes: Notes
) -> dict[str, TreeJoint]:
    """Return the joints with the armature ``N^2 J`` and the damping ``N^2 d`` of their actuators, with the gear N."""
    completed = dict(joints)
    for element in model.findall(f"{ACTUATOR}/*"):
        attributes = settings.attributes(element, "", ACTUATOR)
        name = attributes.get("joint") or attributes.get("jointinparent")
        where = f"actuator '{attributes.get('name') or name or element.tag}'"
        armature, damping = (_coefficient(attributes, key, settings, where) for key in ("armature", "damping"))
        if name is None:
            if armature or damping:
                notes.setdefault("armature and damping beyond joints are not modelled", []).append(where)
            continue
        joint = completed[known(name, joints, "joint", where)]
        squared = number_in({"gear": (attributes.get("gear", "").split() or ["1"])[0]}, "gear", where) ** 2
        completed[name] = replace(
            joint, armature=joint.armature + squared * armature, damping=joint.damping + squared * damping
        )
    return completed


def _coefficient(attributes: Attributes, key: str, settings: Settings, where: str) -> float:
    """Return one of the ``COEFFICIENTS``; 0 where it is not given, or the model disables it."""
    count = max(len(attributes.get(key, "").split()), 1) if key in POLYNOMIALS else 1
    value, *higher = numbers_in(attributes, key, where, count, (0.0,))
    if any(higher):
        raise ModelError(
            f"{where}: {key}='{attributes[key][:60]}' is a polynomial, which is not read",
            expected="one number",
            hint=f"no {key} here, and 'forces:' in the mechanism file",
        )
    if value < 0.0:
        raise ModelError(f"{where}: its {key} is negative")
    return 0.0 if COEFFICIENTS[key] & settings.off else float(value)


def _joint(settings: Settings, part: BodyElement, name: str, kind: Kind, notes: Notes) -> TreeJoint:
    """Return a joint in its body frame, with the forces and limits of its attributes."""
    where, attributes = f"joint '{name}'", part.attributes
    stiffness, damping, friction, armature = (_coefficient(attributes, key, settings, where) for key in COEFFICIENTS)
    joint = TreeJoint(name, kind, "", "", pin.SE3.Identity(), stiffness=stiffness, damping=damping, friction=friction,
                      armature=armature)  # fmt: skip
    if "springdamper" in attributes and numbers_in(attributes, "springdamper", where, 2).any():
        raise ModelError(
            f"{where}: springdamper='{attributes['springdamper'][:60]}' is not read",
            expected="stiffness and damping of the joint",
            hint="with its inertia m: stiffness m / (T D)^2 and damping 2 m / T of the time constant T and the ratio D",
        )
    if kind == "floating":
        return joint
    anchor = pin.SE3(np.eye(3), part.frame.act(numbers_in(attributes, "pos", where, 3, (0.0, 0.0, 0.0))))
    joint = replace(joint, placement=anchor, offset=anchor.inverse())
    if kind == "ball":
        if attributes.get("range") and attributes.get("limited") != "false":
            notes.setdefault("the range of ball joints is not watched", []).append(name)
        return joint
    if attributes.get("range") and attributes.get("limited", "auto") == "auto" and not settings.limits_by_range:
        notes.setdefault("their range is no limit, as autolimits is false and limited is not said", []).append(name)
    axis = direction(numbers_in(attributes, "axis", where, 3, (0.0, 0.0, 1.0)), f"{where}: its axis")
    measured = _measured(settings, replace(joint, axis=part.frame.rotation @ axis), attributes, where)
    if measured.drawn:
        notes.setdefault("drawn at their ref, but begin at 0 where nothing is said", []).append(name)
    return measured


def _measured(settings: Settings, joint: TreeJoint, attributes: Attributes, where: str) -> TreeJoint:
    """Return a joint of one coordinate, completed by its reference, spring rest position and limits."""
    turns = joint.kind == "revolute"
    measure = settings.angle if turns else 1.0
    drawn, rest = (measure * number_in(attributes, key, where, 0.0) for key in ("ref", "springref"))
    lower, upper = measure * _range(attributes, "range", "limited", settings, where)
    effort = np.abs(_range(attributes, "actuatorfrcrange", "actuatorfrclimited", settings, where)).max()
    back = pin.SE3(pin.exp3(-drawn * joint.axis), np.zeros(3)) if turns else pin.SE3(np.eye(3), -drawn * joint.axis)
    bounds = Bounds(float(lower), float(upper), effort=float(effort))
    return replace(joint, offset=back * joint.offset, bounds=bounds, rest=rest, drawn=drawn)


def _range(attributes: Attributes, key: str, switch: str, settings: Settings, where: str) -> Array:
    """Return a range if it is a limit, otherwise an infinite one, shape (2,)."""
    limited = word(attributes.get(switch), UNSAID, f"{where}: {switch}")
    if limited == "true" and key not in attributes:
        raise ModelError(f"{where}: {switch}='true', and it has no {key}", expected=f"a {key}, or {switch}='false'")
    if key not in attributes or limited == "false" or (limited == "auto" and not settings.limits_by_range):
        return np.array([-np.inf, np.inf])
    lower, upper = numbers_in(attributes, key, where, 2)
    if lower == upper == 0.0 and limited == "auto":  # the format's own default
        return np.array([-np.inf, np.inf])
    if lower >= upper:
        raise ModelError(f"{where}: {key}='{attributes[key]}'", expected="the lower number first")
    return np.array([lower, upper])
