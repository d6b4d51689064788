"""The spanning tree of the joints of an SDF model, and the joints that close its loops.

Joints are taken in the order of the file, from the world outwards. A joint between links that both hang in the tree
already closes a loop; one that leads from a link to its own parent is turned round, and keeps its coordinate. A model
that no joint ties to the world floats.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING

import pinocchio as pin

from pinarm.errors import listed
from pinarm.mechanics.loading.model_tree import TreeJoint, depth_first
from pinarm.mechanics.loading.sdf.frames import WORLD
from pinarm.mechanics.loading.sdf.joints import SdfJoint

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.kinds import CouplingDefinition
    from pinarm.mechanics.loops.kinds import Loop

FREE = "root"
"""Name of the joint by which the first link of a model floats."""


@dataclass
class SpanningTree:
    """The tree while it grows.

    Attributes:
        links: Links that hang in it already, the world first.
        joints: Simple joints and frames, depth-first.
        hung: The joints of the file that they are made of.
        loops: Joints that close loops.
        couplings: Threads of the screws, by name of the joint.
        notes: What is modelled differently, in words.
    """

    links: dict[str, None] = field(default_factory=dict)
    joints: list[TreeJoint] = field(default_factory=list)
    hung: list[SdfJoint] = field(default_factory=list)
    loops: dict[str, Loop] = field(default_factory=dict)
    couplings: dict[str, CouplingDefinition] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def hang(self, joint: SdfJoint, placed: Mapping[str, pin.SE3]) -> str:
        """Hang a link in the tree by a joint that leads to it or from it; return the link."""
        outwards = joint.parent in self.links
        parent, child = (joint.parent, joint.child) if outwards else (joint.child, joint.parent)
        self.joints += joint.hung(parent, child, placed)
        self.links[child] = None
        self.hung.append(joint)
        if joint.lead:
            from pinarm.mechanics.couplings.screw import Screw

            self.couplings[joint.name] = Screw(joints=(joint.name, f"{joint.name}.slide"), lead=joint.lead)
        return child

    def free(self, link: str, place: pin.SE3, *, fixed: bool) -> None:
        """Let a link float in the world, or hold it."""
        floating = any(joint.kind == "floating" for joint in self.joints)
        name = f"{link}_free" if floating else FREE
        self.joints.append(TreeJoint(name, "fixed" if fixed else "floating", WORLD, link, place))


def spanning_tree(
    joints: Sequence[SdfJoint], places: Mapping[str, pin.SE3], stand: pin.SE3, *, fixed: bool
) -> SpanningTree:
    """Return the tree of joints, and loop joints for those that it does not need.

    Args:
        joints: Joints of the file.
        places: Placement of every link in the model, in the order of the file.
        stand: Placement of the model in the world.
        fixed: Whether the model does not move.

    Raises:
        ModelError: A universal joint whose axes are not at right angles closes a loop, or two parts of the tree have
            the same name.
    """
    tree, placed = SpanningTree(), {WORLD: stand.inverse(), **places}
    at: dict[str, list[tuple[bool, int]]] = {}
    for number, joint in enumerate(joints):
        at.setdefault(joint.parent, []).append((False, number))  # outwards comes first
        at.setdefault(joint.child, []).append((True, number))
    carried = {joint.child for joint in joints}
    for root in (WORLD, *(link for link in places if link not in carried), *places):
        if root in tree.links:
            continue
        if root != WORLD:
            tree.free(root, stand * places[root], fixed=fixed)
        tree.links[root] = None
        heapify(ready := [*at.get(root, ())])
        while ready:
            joint = joints[heappop(ready)[1]]
            if not {joint.parent, joint.child} <= tree.links.keys():
                for item in at[tree.hang(joint, placed)]:
                    heappush(ready, item)
    hung = {joint.name for joint in tree.hung}
    for joint in joints:
        if joint.name not in hung:
            frames, tree.loops[joint.name] = joint.closing(placed)
            tree.joints += frames
    tree.notes += _notes(tree, joints)
    tree.joints = [*depth_first(WORLD, tree.joints)]
    return tree


def _notes(tree: SpanningTree, joints: Sequence[SdfJoint]) -> Iterator[str]:
    """Yield what is to be said of loops, of threads, and of a model that floats."""
    if names := [*tree.loops]:
        yield f"closing loops of the tree of joints: {listed('joint', names)}"
    if active := [joint.name for joint in joints if joint.name in tree.loops and joint.active]:
        yield f"limits, damping, friction and springs of {listed('joint', active)}, closing loops, are not modelled"
    for joint in joints:
        yield from joint.notes
    if free := [joint.child for joint in tree.joints if joint.kind == "floating"]:
        yield f"no joint ties {listed('link', free)} to the world: the model floats; 'base: fixed' holds it"
