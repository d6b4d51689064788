"""The tree of joints of an SDF model, and the joints that close its loops.

Joints are taken in the order of the file, from the world outwards. A joint between links that both hang in the tree
already closes a loop; one that leads from a link to its own parent is turned round, and keeps its coordinate. A model
that no joint ties to the world floats.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.errors import listed
from pinarm.mechanics.loading.model_tree import Kind, TreeJoint, check_unique
from pinarm.mechanics.loading.sdf.joints import SdfJoint
from pinarm.mechanics.loading.sdf.poses import WORLD

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
        joints: Simple joints and frames in their order.
        hung: The joints of the file that they are made of.
        loops: Joints that close loops.
        couplings: Threads of the screws, by name of the joint.
        notes: What is modelled differently, in words.
    """

    links: dict[str, None] = field(default_factory=lambda: {WORLD: None})
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

    def close(self, joint: SdfJoint, placed: Mapping[str, pin.SE3]) -> None:
        """Add a loop joint, between frames on both of its links."""
        frames, self.loops[joint.name] = joint.closing(placed)
        self.joints += frames


def grown_tree(
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
    tree, waiting = SpanningTree(), _Waiting(joints, WORLD)
    placed = {WORLD: stand.inverse(), **places}
    carried = {joint.child for joint in joints}
    order = iter([*(link for link in places if link not in carried), *places])
    while True:
        while (joint := waiting.next(tree.links)) is not None:
            waiting.reach(tree.hang(joint, placed))
        loose = next((link for link in order if link not in tree.links), None)
        if loose is None:
            break
        name = FREE if not any(joint.kind == "floating" for joint in tree.joints) else f"{loose}_free"
        kind: Kind = "fixed" if fixed else "floating"
        tree.joints.append(TreeJoint(name, kind, WORLD, loose, stand * places[loose], np.array([0.0, 0.0, 1.0])))
        tree.links[loose] = None
        waiting.reach(loose)
    hung = {joint.name for joint in tree.hung}
    for joint in joints:
        if joint.name not in hung:
            tree.close(joint, placed)
    tree.notes += _notes(tree, joints)
    check_unique(WORLD, tree.joints)
    tree.joints = _depth_first(tree.joints)
    return tree


def _depth_first(joints: list[TreeJoint]) -> list[TreeJoint]:
    """Return the joints with those beyond each next to it, as Pinocchio's algorithms need them."""
    beyond: dict[str, list[TreeJoint]] = {}
    for joint in reversed(joints):
        beyond.setdefault(joint.parent, []).append(joint)
    ordered, waiting = list[TreeJoint](), [*beyond.get(WORLD, [])]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += beyond.get(joint.child, [])
    return ordered


class _Waiting:
    """Joints that may hang in a tree next: those of the links that have been reached, in the order of the file.

    Args:
        joints: All joints of the file.
        root: The link that is reached first.
    """

    def __init__(self, joints: Sequence[SdfJoint], root: str) -> None:
        self._joints = joints
        self._of: dict[str, tuple[list[int], list[int]]] = {}
        for number, joint in enumerate(joints):
            for end, link in enumerate((joint.parent, joint.child)):
                self._of.setdefault(link, ([], []))[end].append(number)
        self._ready: tuple[list[int], list[int]] = ([], [])
        self.reach(root)

    def reach(self, link: str) -> None:
        """Add the joints of a link: those that lead from it outwards, and those that lead to it inwards."""
        for ready, numbers in zip(self._ready, self._of.get(link, ([], [])), strict=True):
            for number in numbers:
                heappush(ready, number)

    def next(self, links: Container[str]) -> SdfJoint | None:
        """Return the first joint to a link that is not among those of the tree, outwards before inwards."""
        for ready in self._ready:
            while ready:
                joint = self._joints[heappop(ready)]
                if joint.parent not in links or joint.child not in links:
                    return joint
        return None


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
