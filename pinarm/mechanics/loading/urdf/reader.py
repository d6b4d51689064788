"""Reader of URDF models; it checks every number: common parsers read a NaN mass as 0 kg, or drop elements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.errors import ModelError, choices, listed, several
from pinarm.input.numbers import is_decimal
from pinarm.input.xml_names import check_names, counted
from pinarm.mechanics.loading.model_tree import (
    Bounds,
    Kind,
    Mimic,
    Tree,
    TreeJoint,
    checked_mimics,
    inertia,
    inertia_defect,
)
from pinarm.mechanics.loading.urdf.elements import axis_of, number_of, placement_of
from pinarm.mechanics.loading.urdf.names import closes_loops, urdf_names
from pinarm.records import replace

KINDS: Mapping[str, Kind] = {
    "fixed": "fixed", "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "planar": "planar",
    "floating": "floating", "spherical": "ball",
}  # fmt: skip
"""URDF joint type -> kind; ``continuous`` is revolute without limits, ``spherical`` an extension of URDF."""

Element = ElementTree.Element


def urdf_tree(robot: Element) -> Tree:
    """Return the tree of a ``<robot>`` element.

    Joints are ordered depth-first, those of one link by name, as in Pinocchio's own reader.

    Raises:
        ModelError: A name is none of URDF, an element stands twice, the links and joints form no tree, or a mass, axis
            or other number is invalid.
    """
    unread = check_names(robot, urdf_names(robot))
    defects: list[str] = []
    notes: list[str] = []
    links = {name: _inertia(link, name, defects, notes) for name, link in _named(robot, "link").items()}
    elements = _named(robot, "joint")
    joints = {name: _joint(joint, name, links) for name, joint in elements.items()}
    root, order = _ordered(links, joints)
    mimics, orphans = checked_mimics([*_mimics(elements)], {name: joint.kind for name, joint in joints.items()})
    notes += _limit_notes(elements, joints)
    if locked := [name for name, joint in elements.items() if _is_fixed(joint) and joint.find("mimic") is not None]:
        notes.append(f"fixed joints follow no other, though they have a <mimic>: {listed('joint', locked)}")
    if any(float(spring.text or 0) for spring in robot.iter("springStiffness") if is_decimal(spring.text)):
        notes.append("springs that the model gives to its joints for Gazebo are not modelled")
    if geared := [*_geared(robot)]:
        notes.append(f"gears and rotors of transmissions are modelled as 'drives' only: {several(geared)}")
    if unread:
        notes.append(f"not read: {counted(unread)}")
    bodies = {root: links[root], **{joint.child: links[joint.child] for joint in order}}
    tree = Tree(robot.get("name", ""), bodies, order, mimics, None, (*defects, *orphans), tuple(notes))
    if not closes_loops(robot):
        return tree
    from pinarm.mechanics.loading.urdf.loops import with_loops

    return with_loops(tree, robot)


def _geared(robot: Element) -> Iterator[str]:
    """Yield the names of the transmissions with a gear ratio or a rotor inertia."""
    idle = {"mechanicalReduction": 1.0, "motorInertia": 0.0}
    for transmission in robot.findall("transmission"):
        if any(element.tag in idle and is_decimal(element.text) and abs(float(element.text or 0)) != idle[element.tag]
               for element in transmission.iter()):  # fmt: skip
            yield transmission.get("name", "without name")


def _named(robot: Element, tag: str) -> dict[str, Element]:
    elements: dict[str, Element] = {}
    for element in robot.findall(tag):
        name = element.get("name")
        if not name:
            raise ModelError(f"a {tag} has no name")
        if name in elements:
            raise ModelError(f"two {tag}s have the name '{name}'", expected="a name of its own for each")
        elements[name] = element
    return elements


def _inertia(link: Element, name: str, defects: list[str], notes: list[str]) -> pin.Inertia:
    where, inertial = f"link '{name}'", link.find("inertial")
    if inertial is None:
        return pin.Inertia.Zero()
    mass = number_of(inertial.find("mass"), "value", f"{where}: mass")
    if mass < 0.0:
        raise ModelError(f"{where}: the mass is negative ({mass:g} kg)")
    place = placement_of(inertial.find("origin"), f"{where}: origin of the inertia")
    element = inertial.find("inertia")
    if element is None:
        notes.append(f"{where}: it has a mass but no <inertia>, and is taken for a point mass")
        return inertia(mass, place.translation, np.zeros((3, 3)))
    xx, yy, zz = (number_of(element, key, f"{where}: {key}") for key in ("ixx", "iyy", "izz"))
    xy, xz, yz = (number_of(element, key, f"{where}: {key}", default=0.0) for key in ("ixy", "ixz", "iyz"))
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if wrong := inertia_defect(moments):
        defects.append(f"{where}: {wrong}")
    return inertia(mass, place.translation, place.rotation @ moments @ place.rotation.T)


def _joint(joint: Element, name: str, links: Mapping[str, Any]) -> TreeJoint:
    where, given = f"joint '{name}'", joint.get("type", "")
    if given not in KINDS:
        expected, hint = choices(given, KINDS)
        raise ModelError(f"{where}: its type is '{given}'", expected=expected, hint=hint)
    parent, child = (_end(joint, end, where, links) for end in ("parent", "child"))
    placement = placement_of(joint.find("origin"), f"{where}: origin")
    plain = TreeJoint(name, KINDS[given], parent, child, placement, np.array([1.0, 0.0, 0.0]))
    if plain.kind == "fixed":
        return plain
    damping, friction, armature = (
        _not_negative(joint.find("dynamics"), key, where) for key in ("damping", "friction", "armature")
    )
    axis = axis_of(joint.find("axis"), where)
    return replace(plain, axis=axis, bounds=_bounds(joint, where), damping=damping, friction=friction,
                   armature=armature)  # fmt: skip


def _end(joint: Element, end: str, where: str, links: Mapping[str, Any]) -> str:
    element = joint.find(end)
    link = element.get("link", "") if element is not None else ""
    if link not in links:
        expected, hint = choices(link, links)
        raise ModelError(f"{where}: its {end} link '{link}' does not exist", expected=expected, hint=hint)
    return link


def _bounds(joint: Element, where: str) -> Bounds:
    """Return the limits; an effort, velocity or range of 0 means unknown: exporters write it so."""
    limit = joint.find("limit")
    effort, velocity = (_not_negative(limit, key, where, "limit of ") or np.inf for key in ("effort", "velocity"))
    if joint.get("type") not in ("revolute", "prismatic"):
        return Bounds(effort=effort, velocity=velocity)
    lower, upper = (number_of(limit, key, f"{where}: {key} limit", default=0.0) for key in ("lower", "upper"))
    if lower > upper:
        raise ModelError(f"{where}: its limits are {lower:g} to {upper:g}", expected="the lower one first")
    if lower == upper == 0.0:
        lower, upper = -np.inf, np.inf
    return Bounds(lower, upper, velocity, effort)


def _limit_notes(elements: Mapping[str, Element], joints: Mapping[str, TreeJoint]) -> list[str]:
    """Return one note for each kind of limit that is 0 or missing."""
    missing: dict[str, list[str]] = {"position": [], "effort": [], "velocity": []}
    for name, joint in joints.items():
        limit = None if joint.kind == "fixed" else elements[name].find("limit")
        if elements[name].get("type") in ("revolute", "prismatic") and joint.bounds.lower == -np.inf:
            missing["position"].append(name)
        for key in ("effort", "velocity"):
            if limit is not None and limit.get(key) is not None and getattr(joint.bounds, key) == np.inf:
                missing[key].append(name)
    return [f"{key} limits of 0, or none, are taken for unknown: {listed('joint', names)}"
            for key, names in missing.items() if names]  # fmt: skip


def _is_fixed(joint: Element) -> bool:
    return joint.get("type") == "fixed"


def _mimics(elements: Mapping[str, Element]) -> Iterable[Mimic]:
    for name, joint in elements.items():
        mimic = joint.find("mimic")
        if mimic is None or _is_fixed(joint):  # a joint that exporters lock often keeps its <mimic>
            continue
        where = f"joint '{name}': mimic"
        if joint.get("type") not in ("revolute", "continuous", "prismatic"):
            raise ModelError(f"joint '{name}' mimics another, but is {joint.get('type')}",
                             expected="a joint with one coordinate")  # fmt: skip
        multiplier = number_of(mimic, "multiplier", f"{where}: multiplier", default=1.0)
        offset = number_of(mimic, "offset", f"{where}: offset", default=0.0)
        yield Mimic(name, mimic.get("joint", ""), multiplier, offset)


def _ordered(links: Mapping[str, Any], joints: Mapping[str, TreeJoint]) -> tuple[str, tuple[TreeJoint, ...]]:
    """Return the root, and the joints depth-first.

    Raises:
        ModelError: A link has two parents, there is not exactly one root, or joints form a cycle.
    """
    carried: dict[str, str] = {}
    below: dict[str, list[TreeJoint]] = {name: [] for name in links}
    for name in sorted(joints, reverse=True):
        joint = joints[name]
        if joint.child in carried:
            raise ModelError(
                f"link '{joint.child}' is carried by two joints, '{carried[joint.child]}' and '{name}'",
                expected="a tree: a loop is cut at one joint and closed by <loop>, or in the mechanism file",
            )
        carried[joint.child] = name
        below[joint.parent].append(joint)
    roots = [name for name in links if name not in carried]
    if len(roots) != 1:
        raise ModelError(
            f"the model has {len(roots)} links that no joint carries{': ' if roots else ''}{', '.join(roots[:6])}",
            expected="one, from which all others hang",
        )
    ordered, waiting = [], [*below[roots[0]]]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += below[joint.child]
    if len(ordered) < len(joints):
        lost = sorted(set(joints) - {joint.name for joint in ordered})
        verb = "hang" if len(lost) > 1 else "hangs"
        raise ModelError(f"the {listed('joint', lost)} {verb} in a circle", expected="a tree")
    return roots[0], tuple(ordered)


def _not_negative(element: Element | None, key: str, where: str, what: str = "") -> float:
    value = number_of(element, key, f"{where}: {what}{key}", default=0.0)
    if value < 0.0:
        raise ModelError(f"{where}: its {what}{key} is negative")
    return value
