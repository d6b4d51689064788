"""Extensions of URDF that close loops and couple joints.

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

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import pinocchio as pin

from pinarm.errors import ModelError, choices, listed
from pinarm.input.xml_text import check_names, meant_by
from pinarm.mechanics.loading.model_tree import Tree, TreeJoint, tied_frames
from pinarm.mechanics.loading.sdf.frames import MODEL, SDF, Frames, pose_of, text_of
from pinarm.mechanics.loading.sdf.joints import GEARBOX, Hinge, gear_of, is_active, joint_in
from pinarm.mechanics.loading.values import axis_of, number, placement_of, text_in
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.kinds import CouplingDefinition
    from pinarm.mechanics.loops.kinds import Loop

KINDS: Mapping[str, str] = {
    "fixed": "fixed",
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "planar": "planar",
    "spherical": "spherical",
}
"""Type of a ``<loop>`` or ``<loop_joint>`` -> kind of loop joint."""

ENDS = (("predecessor",), ("successor", "sucessor"))
"""Tags of the ends of a loop or coupling; exporters also write ``sucessor``."""

VERSION = (1, 7)
"""Version of SDF in whose meaning joints in ``<gazebo>`` are read: axes in the axes of the joint."""


def with_loops(tree: Tree, robot: Element) -> Tree:
    """Return a tree with the loops and couplings of a ``<robot>`` element."""
    closed = _Closed(tree)
    for element in robot.findall("loop"):
        ends = [_end(element, tags) for tags in ENDS]
        closed.close(element, [(_link(end), end.find("origin")) for end in ends])
    for element in robot.findall("loop_joint"):
        ends = [end for end in element if end.tag in ("link1", "link2")]  # Isaac's own example has two link1
        if len(ends) != 2:
            raise ModelError(f"{_where(element)}: it has {len(ends)} links", expected="<link1> and <link2>")
        closed.close(element, [(_link(end), end) for end in ends])
    for element in robot.findall("coupling"):
        closed.couple(element)
    for gazebo in robot.findall("gazebo"):
        for element in gazebo.findall("joint") if not gazebo.get("reference") else ():
            closed.add_joint_of_sdf(element)
    frames = {joint.child: pin.Inertia.Zero() for joint in closed.frames}
    return replace(
        tree,
        links={**tree.links, **frames},
        joints=(*tree.joints, *closed.frames),
        loops=closed.loops,
        couplings=closed.couplings,
        notes=(*tree.notes, *closed.notes()),
    )


@dataclass
class _Closed:
    """Loops and couplings of a tree while they are read."""

    tree: Tree
    frames: list[TreeJoint] = field(default_factory=list)
    loops: dict[str, Loop] = field(default_factory=dict)
    couplings: dict[str, CouplingDefinition] = field(default_factory=dict)
    idle: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def close(self, element: Element, ends: list[tuple[str, Element | None]]) -> None:
        from pinarm.mechanics.loops.lower_pairs import LOWER_KINDS, AxisDefinition

        where, type_name = _where(element), element.get("type", "")
        name = self._named(element)
        if type_name not in KINDS:
            expected, hint = choices(type_name, KINDS)
            raise ModelError(f"{where}: its type is '{type_name}'", expected=expected, hint=hint)
        places = [
            (self._known(link, where), placement_of(origin, f"{where}: origin in '{link}'")) for link, origin in ends
        ]
        frames, between = tied_frames(name, places)
        self.frames += frames
        kind = LOWER_KINDS[KINDS[type_name]]
        if issubclass(kind, AxisDefinition):
            x, y, z = axis_of(element.find("axis"), where).tolist()
            self.loops[name] = kind(between=between, axis=(x, y, z))  # type: ignore[assignment]  # one of Loop
        else:
            self.loops[name] = kind(between=between)  # type: ignore[assignment]

    def couple(self, element: Element) -> None:
        from pinarm.mechanics.couplings.kinds import WeightedSum

        where, name = _where(element), self._named(element)
        ways = [[*self._way(self._known(_link(_end(element, tags)), where))] for tags in ENDS]
        shared = {*ways[0]} & {*ways[1]}
        ratio = number(text_in(element.find("ratio"), "value"), f"{where}: ratio", 1.0)
        weights = [
            {joint: weight for joint in way if joint not in shared}
            for way, weight in zip(ways, (-ratio, 1.0), strict=True)
        ]
        if ratio == 0.0 or not all(weights):
            raise ModelError(f"{where}: it couples no two joints", expected="links on two branches, and a ratio but 0")
        self.couplings[name] = WeightedSum(weights={**weights[1], **weights[0]})

    def add_joint_of_sdf(self, element: Element) -> None:
        """Add a joint of SDF, which closes a loop, or a gearbox; one between links of Gazebo alone is passed over."""
        check_names(element, SDF)
        where, name, placed = _where(element), self._named(element), self._placed
        if strange := [link for end in ("parent", "child") if (link := text_of(element, end)) not in placed]:
            if meant_by(strange[0], placed):
                self._known(strange[0], where)
            self.foreign.append(name)
            return
        pose = pose_of(element, text_of(element, "child"), where)
        placing = {MODEL: (MODEL, pin.SE3.Identity()), **{link: (MODEL, place) for link, place in placed.items()}}
        frames = Frames({**placing, name: pose}, {link: link for link in placed})
        if element.get("type") == GEARBOX:
            hinges = [
                Hinge(joint.name, joint.parent, joint.child, placed[joint.parent].rotation @ joint.placement.rotation
                      @ joint.axis)
                for joint in self.tree.joints if joint.kind == "revolute"
            ]  # fmt: skip
            self.couplings[name] = gear_of(element, frames, VERSION, hinges)
            return
        joint = joint_in(element, frames, VERSION)
        made, self.loops[name] = joint.closing(placed)
        self.frames += made
        self.remarks += joint.notes
        self.idle += [name] if is_active(joint) else []

    def notes(self) -> Iterator[str]:
        if self.loops:
            yield f"closing loops of the tree of joints: {listed('joint', [*self.loops])}"
        if self.idle:
            names = listed("joint", self.idle)
            yield f"limits, damping, friction and springs of {names}, closing loops, are not modelled"
        if self.foreign:
            yield f"not read, as they join links that only Gazebo has: {listed('joint', self.foreign)}"
        yield from self.remarks

    def _named(self, element: Element) -> str:
        name = element.get("name", "")
        taken = {*self.loops, *self.couplings, *(joint.name for joint in self.tree.joints)}
        if not name or name in taken:
            raise ModelError(
                f"two joints have the name '{name}'" if name else f"a <{element.tag}> has no name",
                expected="a name of its own for each",
            )
        return name

    def _known(self, link: str, where: str) -> str:
        if link not in self.tree.links:
            expected, hint = choices(link, self.tree.links)
            raise ModelError(f"{where}: its link '{link}' does not exist", expected=expected, hint=hint)
        return link

    def _way(self, link: str) -> Iterator[str]:
        above = {joint.child: joint for joint in self.tree.joints}
        while (joint := above.get(link)) is not None:
            if joint.kind != "fixed":
                yield joint.name
            link = joint.parent

    @cached_property
    def _placed(self) -> dict[str, pin.SE3]:
        placed = {self.tree.root: pin.SE3.Identity()}
        for joint in self.tree.joints:
            placed[joint.child] = placed[joint.parent] * joint.placement * joint.offset
        return placed


def _end(element: Element, tags: tuple[str, ...]) -> Element:
    ends = [end for end in element if end.tag in tags]
    if len(ends) != 1:
        raise ModelError(f"{_where(element)}: it has {len(ends)} <{tags[0]}>", expected="one")
    return ends[0]


def _link(end: Element) -> str:
    """Return the link of an end; exporters also write it as ``name``."""
    return end.get("link") or end.get("name") or ""


def _where(element: Element) -> str:
    return f"<{element.tag}> '{element.get('name', '')}'"
