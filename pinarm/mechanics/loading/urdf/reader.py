"""Reader of URDF models; it checks every number: common parsers read a NaN mass as 0 kg, or drop elements.

Source: the XML specifications of the ROS package ``urdf``. ``armature``, the joint type ``spherical`` and the elements
that close loops (``loops``) are extensions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.errors import ModelError, choices, listed
from pinarm.input.xml_text import check_names, counted, format_names
from pinarm.mechanics.loading.model_tree import (
    Bounds,
    Kind,
    Mimic,
    Tree,
    TreeJoint,
    body_inertia,
    checked_mimics,
    depth_first,
    inertia_defect,
)
from pinarm.mechanics.loading.values import axis_of, not_negative, number, placement_of, symmetric, text_in
from pinarm.records import replace

KINDS: Mapping[str, Kind] = {
    "fixed": "fixed", "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "planar": "planar",
    "floating": "floating", "spherical": "ball",
}  # fmt: skip
"""URDF joint type -> kind; ``continuous`` is revolute without limits, ``spherical`` an extension of URDF."""

CLOSING = ("loop", "coupling", "loop_joint")
"""Elements of a robot that close loops or couple joints, beside joints in ``<gazebo>``."""

URDF = format_names(
    {
        "robot": "name version > link* joint* material- loop* coupling* loop_joint* gazebo-",
        "link": "name > inertial visual* collision-",
        "inertial": "> origin mass inertia",
        "mass": "value",
        "inertia": "ixx ixy ixz iyy iyz izz iyx izx izy",
        "origin": "xyz rpy quat_xyzw",
        "visual": "name > origin* geometry* material*",
        "geometry": "name > box* cylinder* sphere* capsule* mesh*",
        "box": "size",
        "cylinder": "radius length",
        "sphere": "radius",
        "capsule": "radius length",
        "mesh": "filename scale",
        "material": "name > color* texture-",
        "color": "rgba",
        "joint": "name type > origin parent child axis limit dynamics mimic calibration- safety_controller-",
        "parent": "link",
        "child": "link",
        "axis": "xyz",
        "limit": "lower upper effort velocity",
        "dynamics": "damping friction armature",
        "mimic": "joint multiplier offset",
        "loop": "name type > predecessor=end* successor=end* sucessor=end* axis",
        "coupling": "name > predecessor=end* successor=end* sucessor=end* ratio",
        "end": "link name > origin",
        "ratio": "value",
        "loop_joint": "name type > link1=linked* link2=linked* axis",
        "linked": "link xyz rpy quat_xyzw",
    }
)
"""Names of URDF; exporters also write ``sucessor``."""

TWINS = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
"""Moments below the diagonal, which may stand beside those above it."""


def urdf_tree(robot: Element) -> Tree:
    """Return the tree of a ``<robot>`` element.

    Joints are ordered depth-first, those of one link by name, as in Pinocchio's own reader.
    """
    unread = check_names(robot, URDF)
    defects: list[str] = []
    notes: list[str] = []
    links = {name: _inertia(link, f"link '{name}'", defects, notes) for name, link in _named(robot, "link").items()}
    elements = _named(robot, "joint")
    joints = {name: _joint(joint, name, links, notes) for name, joint in elements.items()}
    root, order = _ordered(links, joints)
    mimics, orphans = checked_mimics([*_mimics(elements)], {name: joint.kind for name, joint in joints.items()})
    notes += _unknown_limits(elements, joints)
    if locked := [name for name, joint in elements.items() if _is_fixed(joint) and joint.find("mimic") is not None]:
        notes.append(f"fixed joints follow no other, though they have a <mimic>: {listed('joint', locked)}")
    gazebo = [*robot.findall("gazebo")]
    if others := sum(any(child.tag != "joint" for child in part) or not len(part) for part in gazebo):
        unread["<gazebo>"] = others
    if unread:
        notes.append(f"not read: {counted(unread)}")
    bodies = {root: links[root], **{joint.child: links[joint.child] for joint in order}}
    tree = Tree(robot.get("name", ""), bodies, order, mimics, None, (*defects, *orphans), tuple(notes))
    if not any(robot.find(tag) is not None for tag in CLOSING) and all(part.find("joint") is None for part in gazebo):
        return tree
    from pinarm.mechanics.loading.urdf.loops import with_loops

    return with_loops(tree, robot)


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


def _inertia(link: Element, where: str, defects: list[str], notes: list[str]) -> pin.Inertia:
    inertial = link.find("inertial")
    if inertial is None:
        return pin.Inertia.Zero()
    mass = number(text_in(inertial.find("mass"), "value"), f"{where}: mass")
    place = placement_of(inertial.find("origin"), f"{where}: origin of the inertia")
    element = inertial.find("inertia")
    if element is None:
        notes.append(f"{where}: it has a mass but no <inertia>, and is taken for a point mass")
        return body_inertia(mass, place, np.zeros((3, 3)), where)
    diagonal = [number(element.get(key), f"{where}: {key}") for key in ("ixx", "iyy", "izz")]
    moments = symmetric(*diagonal, *(_product(element, key, twin, where) for twin, key in TWINS.items()))
    if wrong := inertia_defect(moments):
        defects.append(f"{where}: {wrong}")
    return body_inertia(mass, place, moments, where)


def _product(element: Element, key: str, twin: str, where: str) -> float:
    """Return a moment beside the diagonal; its twin, if there is one, is the same."""
    value = number(element.get(key), f"{where}: {key}", 0.0)
    if number(element.get(twin), f"{where}: {twin}", value) != value:
        raise ModelError(f"{where}: {twin} is not {key}", expected="a symmetric matrix of inertia")
    return value


def _joint(joint: Element, name: str, links: Mapping[str, Any], notes: list[str]) -> TreeJoint:
    where, type_name = f"joint '{name}'", joint.get("type", "")
    if type_name not in KINDS:
        expected, hint = choices(type_name, KINDS)
        raise ModelError(f"{where}: its type is '{type_name}'", expected=expected, hint=hint)
    parent, child = (_end(joint, end, where, links) for end in ("parent", "child"))
    placement = placement_of(joint.find("origin"), f"{where}: origin")
    x = np.array([1.0, 0.0, 0.0])
    plain = TreeJoint(name, KINDS[type_name], parent, child, placement, x)
    if plain.kind == "fixed":
        return plain
    passive = {
        key: not_negative(text_in(joint.find("dynamics"), key), f"{where}: its {key}")
        for key in ("damping", "friction", "armature")
    }
    axis = x if plain.kind in ("floating", "ball") else axis_of(joint.find("axis"), where)
    return replace(plain, axis=axis, bounds=_bounds(joint, where, notes), **passive)


def _end(joint: Element, end: str, where: str, links: Mapping[str, Any]) -> str:
    link = text_in(joint.find(end), "link") or ""
    if link not in links:
        expected, hint = choices(link, links)
        raise ModelError(f"{where}: its {end} link '{link}' does not exist", expected=expected, hint=hint)
    return link


def _bounds(joint: Element, where: str, notes: list[str]) -> Bounds:
    """Return the limits; an effort or velocity of 0 or less, or a range of 0, means unknown: exporters write it so."""
    limit = joint.find("limit")
    known = (number(text_in(limit, key), f"{where}: its limit of {key}", 0.0) for key in ("effort", "velocity"))
    effort, velocity = (most if most > 0.0 else np.inf for most in known)
    if joint.get("type") not in ("revolute", "prismatic"):
        return Bounds(effort=effort, velocity=velocity)
    lower, upper = (number(text_in(limit, key), f"{where}: {key} limit", 0.0) for key in ("lower", "upper"))
    if lower > upper:
        notes.append(f"{where}: its limits {lower:g} to {upper:g} are none: the lower one is above the upper one")
    if lower > upper or lower == upper == 0.0:
        lower, upper = -np.inf, np.inf
    return Bounds(lower, upper, velocity, effort)


def _unknown_limits(elements: Mapping[str, Element], joints: Mapping[str, TreeJoint]) -> Iterator[str]:
    missing: dict[str, list[str]] = {"position": [], "effort": [], "velocity": []}
    for name, joint in joints.items():
        limit = None if joint.kind == "fixed" else elements[name].find("limit")
        limits = [text_in(limit, key) for key in ("lower", "upper")]
        bounded = elements[name].get("type") in ("revolute", "prismatic")
        if bounded and joint.bounds.lower == -np.inf and all(float(text or 0) == 0.0 for text in limits):
            missing["position"].append(name)
        for key in ("effort", "velocity"):
            if text_in(limit, key) is not None and getattr(joint.bounds, key) == np.inf:
                missing[key].append(name)
    for key, names in missing.items():
        if names:
            yield f"{key} limits of 0 or less, or none, are taken for unknown: {listed('joint', names)}"


def _is_fixed(joint: Element) -> bool:
    return joint.get("type") == "fixed"


def _mimics(elements: Mapping[str, Element]) -> Iterator[Mimic]:
    for name, joint in elements.items():
        mimic, where = joint.find("mimic"), f"joint '{name}': mimic"
        if mimic is None or _is_fixed(joint):  # a joint that exporters lock often keeps its <mimic>
            continue
        if joint.get("type") not in ("revolute", "continuous", "prismatic"):
            raise ModelError(
                f"joint '{name}' mimics another, but is {joint.get('type')}", expected="a joint with one coordinate"
            )
        multiplier = number(mimic.get("multiplier"), f"{where}: multiplier", 1.0)
        offset = number(mimic.get("offset"), f"{where}: offset", 0.0)
        yield Mimic(name, mimic.get("joint", ""), multiplier, offset)


def _ordered(links: Mapping[str, Any], joints: Mapping[str, TreeJoint]) -> tuple[str, tuple[TreeJoint, ...]]:
    carried: dict[str, str] = {}
    for name in sorted(joints):
        if (other := carried.setdefault(child := joints[name].child, name)) != name:
            raise ModelError(
                f"link '{child}' is carried by two joints, '{other}' and '{name}'",
                expected="a tree: a loop is cut at one joint and closed by <loop>, or in the mechanism file",
            )
    if not links:
        raise ModelError(
            "the model has no link",
            expected="links and joints",
            hint="of a file with nothing but macros of xacro, one that includes and calls them",
        )
    roots = [name for name in links if name not in carried]
    if len(roots) != 1:
        raise ModelError(
            f"the model has {len(roots)} links that no joint carries{': ' if roots else ''}{', '.join(roots[:6])}",
            expected="one, from which all others hang",
        )
    return roots[0], depth_first(roots[0], [joints[name] for name in sorted(joints)])
