"""Reader of URDF models; it checks every number: common parsers read a NaN mass as 0 kg, or drop elements.

Source: the XML specifications of the ROS package ``urdf``. ``armature`` and the joint type ``spherical`` are
extensions, and so are these elements, which close loops and couple joints:

==============================  ========================================================================================
``<loop>`` of URDF+             a joint between an ``<origin>`` in the ``<predecessor>`` and one in the ``<successor>``
``<coupling>`` of URDF+         ``sum of q to the successor = ratio * sum of q to the predecessor``, each from the link
                                where their ways part
``<loop_joint>`` of Isaac Sim   a joint between a frame in ``<link1>`` and one in ``<link2>``
``<joint>`` in a ``<gazebo>``   a joint of SDF: it closes a loop where all joints of the tree are at 0; or a gearbox
==============================  ========================================================================================

Sources: M. Chignoli, J.-J. Slotine, P. Wensing, S. Kim, *URDF+: An Enhanced URDF for Robots with Kinematic Loops*,
2024, arXiv:2411.19753, and their parser; Isaac Sim, URDF importer, custom tags; SDFormat, extensions to URDF.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.errors import ModelError
from pinarm.input.xml_text import check_names, counted, format_names
from pinarm.mechanics.loading.model_tree import Bounds, Kind, Mimic, Tree, TreeJoint, depth_first
from pinarm.mechanics.loading.values import Part, X, axis_of, known, placement_of, text_in

KINDS: Mapping[str, Kind] = {
    "fixed": "fixed", "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "planar": "planar",
    "floating": "floating", "spherical": "ball",
}  # fmt: skip
"""URDF joint type -> kind; ``continuous`` is revolute without limits, ``spherical`` an extension of URDF."""

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

LOOPS: Mapping[str, str] = {
    **{kind: kind for kind in ("fixed", "revolute", "prismatic", "planar", "spherical")}, "continuous": "revolute",
}  # fmt: skip
"""Type of a ``<loop>`` or ``<loop_joint>`` -> kind of loop joint."""

ENDS = (("predecessor",), ("successor", "sucessor"))
"""Tags of the ends of a loop or coupling; exporters also write ``sucessor``."""


def urdf_tree(robot: Element) -> Tree:
    """Return the tree of a ``<robot>`` element.

    Joints are ordered depth-first, those of one link by name, as in Pinocchio's own reader.
    """
    unread, tree = check_names(robot, URDF), Tree(robot.get("name", ""))
    links = {name: _inertia(link.find("inertial"), f"link '{name}'", tree) for name, link in _named(robot, "link")}
    joints = {name: _joint(joint, name, links, tree) for name, joint in _named(robot, "joint")}
    ordered = [joints[name] for name in sorted(joints)]
    root = _root(links, ordered)
    tree.joints += depth_first(root, ordered)
    tree.links = {name: links[name] for name in (root, *(joint.child for joint in tree.joints))}
    if others := sum(any(child.tag != "joint" for child in part) or not len(part) for part in robot.findall("gazebo")):
        unread["<gazebo>"] = others
    if unread:
        tree.notes.append(f"not read: {counted(unread)}")
    _Extensions(tree).read(robot)
    return tree


def _named(robot: Element, tag: str) -> list[tuple[str, Element]]:
    elements = [(element.get("name", ""), element) for element in robot.findall(tag)]
    for name, count in Counter(name for name, _ in elements).items():
        if not name or count > 1:
            problem = f"two {tag}s have the name '{name}'" if name else f"a {tag} has no name"
            raise ModelError(problem, expected="a name of its own for each")
    return elements


def _inertia(inertial: Element | None, where: str, tree: Tree) -> pin.Inertia:
    if inertial is None:
        return pin.Inertia.Zero()
    element = inertial.find("inertia")
    said = Part.of(where, element, mass=text_in(inertial.find("mass"), "value"))
    place = placement_of(Part.of(f"{where}: origin of the inertia", inertial.find("origin")))
    mass = said.number("mass")
    if element is None:
        tree.notes.append(f"{where}: it has a mass but no <inertia>, and is taken for a point mass")
    return tree.body(mass, place, np.zeros((3, 3)) if element is None else said.moments(), where)


def _joint(joint: Element, name: str, links: Collection[str], tree: Tree) -> TreeJoint:
    where, type_name = f"joint '{name}'", joint.get("type", "")
    kind = KINDS[known(type_name, KINDS, f"{where}: its type is '{type_name}'")]
    parent, child = (
        known(link, links, f"{where}: its {end} link '{link}' does not exist")
        for end in ("parent", "child")
        for link in [text_in(joint.find(end), "link") or ""]
    )
    placement, mimic = placement_of(Part.of(f"{where}: origin", joint.find("origin"))), joint.find("mimic")
    if kind == "fixed":  # a joint that exporters lock often keeps its <mimic>
        tree.remark("fixed joints follow no other, though they have a <mimic>", *[name] * (mimic is not None))
        return TreeJoint(name, kind, parent, child, placement, X)
    if mimic is not None:
        if kind not in ("revolute", "prismatic"):
            raise ModelError(f"{where} mimics another, but is {type_name}", expected="a joint with one coordinate")
        said = Part.of(f"{where}: mimic", mimic)
        tree.mimics.append(
            Mimic(name, mimic.get("joint", ""), said.number("multiplier", 1.0), said.number("offset", 0.0))
        )
    said = Part.of(where, joint.find("limit"), joint.find("dynamics"))
    damping, friction, armature = (said.not_negative(key) for key in ("damping", "friction", "armature"))
    axis = X if kind in ("floating", "ball") else axis_of(joint.find("axis"), where)
    bounds = _bounds(said, name, tree, ranged=type_name in ("revolute", "prismatic"))
    return TreeJoint(
        name, kind, parent, child, placement, axis, bounds=bounds, damping=damping, friction=friction, armature=armature
    )


def _bounds(said: Part, name: str, tree: Tree, *, ranged: bool) -> Bounds:
    """Return the limits; an effort or velocity of 0 or less, or a range of 0, means unknown: exporters write it so."""
    unknown = "{} limits of 0 or less, or none, are taken for unknown"
    bounds = {key: said.number(key, 0.0) for key in ("lower", "upper", "effort", "velocity")}
    for key in ("effort", "velocity"):
        if bounds[key] <= 0.0:
            bounds[key] = np.inf
            tree.remark(unknown.format(key), *[name] * (key in said.texts))
    lower, upper = bounds["lower"], bounds["upper"]
    if ranged and lower > upper:
        tree.notes.append(
            f"{said.where}: its limits {lower:g} to {upper:g} are none: the lower one is above the upper one"
        )
    if ranged and lower == upper == 0.0:
        tree.remark(unknown.format("position"), name)
    if not ranged or lower > upper or lower == upper == 0.0:
        bounds |= {"lower": -np.inf, "upper": np.inf}
    return Bounds(**bounds)


def _root(links: Mapping[str, pin.Inertia], joints: Iterable[TreeJoint]) -> str:
    carried: dict[str, str] = {}
    for joint in joints:
        if (other := carried.setdefault(joint.child, joint.name)) != joint.name:
            raise ModelError(
                f"link '{joint.child}' is carried by two joints, '{other}' and '{joint.name}'",
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
    return roots[0]


class _Extensions:
    """Loops and couplings of a tree while they are read."""

    def __init__(self, tree: Tree) -> None:
        self.tree, self.links = tree, {*tree.links}
        self.names = {joint.name for joint in tree.joints}
        self.carriers = {joint.child: joint for joint in tree.joints}

    def read(self, robot: Element) -> None:
        for element in robot.findall("loop"):
            ends = [_end(element, tags) for tags in ENDS]
            self._close(element, [(end, end.find("origin")) for end in ends])
        for element in robot.findall("loop_joint"):
            ends = [end for end in element if end.tag in ("link1", "link2")]  # Isaac's own example has two link1
            if len(ends) != 2:
                raise ModelError(f"{_where(element)}: it has {len(ends)} links", expected="<link1> and <link2>")
            self._close(element, [(end, end) for end in ends])
        for element in robot.findall("coupling"):
            self._couple(element)
        if joints := [joint for part in robot.findall("gazebo[joint]") if not part.get("reference")
                      for joint in part.findall("joint")]:  # fmt: skip
            from pinarm.mechanics.loading.sdf import add_joints

            add_joints(self.tree, [joint for joint in joints if self._name(joint)])

    def _close(self, element: Element, ends: Iterable[tuple[Element, Element | None]]) -> None:
        where, type_name, name = _where(element), element.get("type", ""), self._name(element)
        kind = LOOPS[known(type_name, LOOPS, f"{where}: its type is '{type_name}'")]
        places = [
            (link, placement_of(Part.of(f"{where}: origin in '{link}'", origin)))
            for end, origin in ends
            for link in [self._link(end, where)]
        ]
        turns = kind not in ("fixed", "spherical")
        keys = {"axis": tuple(axis_of(element.find("axis"), where).tolist())} if turns else {}
        self.tree.close(name, kind, places, **keys)

    def _couple(self, element: Element) -> None:
        from pinarm.mechanics.couplings.kinds import WeightedSum

        where, name = _where(element), self._name(element)
        ways = [[*self._way(self._link(_end(element, tags), where))] for tags in ENDS]
        shared = {*ways[0]} & {*ways[1]}
        ratio = Part.of(where, ratio=text_in(element.find("ratio"), "value")).number("ratio", 1.0)
        below, above = (
            {joint: weight for joint in way if joint not in shared}
            for way, weight in zip(ways, (-ratio, 1.0), strict=True)
        )
        if not (ratio and below and above):
            raise ModelError(f"{where}: it couples no two joints", expected="links on two branches, and a ratio but 0")
        self.tree.couplings[name] = WeightedSum(weights={**above, **below})

    def _name(self, element: Element) -> str:
        if not (name := element.get("name", "")) or name in self.names:
            raise ModelError(
                f"two joints have the name '{name}'" if name else f"a <{element.tag}> has no name",
                expected="a name of its own for each",
            )
        self.names.add(name)
        return name

    def _link(self, end: Element, where: str) -> str:
        """Return the link of an end; exporters also write it as ``name``."""
        link = end.get("link") or end.get("name") or ""
        return known(link, self.links, f"{where}: its link '{link}' does not exist")

    def _way(self, link: str) -> Iterator[str]:
        while (joint := self.carriers.get(link)) is not None:
            if joint.kind != "fixed":
                yield joint.name
            link = joint.parent


def _end(element: Element, tags: tuple[str, ...]) -> Element:
    ends = [end for end in element if end.tag in tags]
    if len(ends) != 1:
        raise ModelError(f"{_where(element)}: it has {len(ends)} <{tags[0]}>", expected="one")
    return ends[0]


def _where(element: Element) -> str:
    return f"<{element.tag}> '{element.get('name', '')}'"
