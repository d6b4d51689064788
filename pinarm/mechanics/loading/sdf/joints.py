"""The ``<joint>`` elements of SDF: what each is in a tree, and the loop joint that it is where it closes a loop.

A universal joint is two revolute joints in a row, ``NAME.axis`` and ``NAME.axis2``. A screw is a slide ``NAME.slide``
and a revolute joint ``NAME``, tied by a coupling of its lead. A gearbox moves no link, and couples two joints on one
body: with theta_1 the angle from the reference body to the parent about ``<axis>``, and theta_2 that from the reference
body to the child about ``<axis2>``, ``theta_2 = -gearbox_ratio theta_1``.

The tree takes joints in the order of the file, from the world outwards. A joint between links that both hang in the
tree already closes a loop; one that leads from a link to its own parent is turned round, and keeps its coordinate. A
model that no joint ties to the world floats.

Source: SDFormat 1.12, specification of joint, gearbox_reference_body and gearbox_ratio.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError, choices, listed
from pinarm.mechanics.loading.model_tree import Bounds, Kind, Mimic, TreeJoint, depth_first, tied_frames
from pinarm.mechanics.loading.sdf.frames import MODEL, WORLD, Frames, is_true, number_in, text_of
from pinarm.mechanics.loading.values import direction, numbers
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.kinds import CouplingDefinition, Gear
    from pinarm.mechanics.loops.kinds import Loop

GEARBOX = "gearbox"
"""Type of the joints that move no link, and couple others."""

LIMITLESS = 1e15
"""Limit from which on there is none: the format's own default is 1e16."""

INFINITE = ("inf", "+inf", "-inf")
"""Words for no limit."""

SQUARE = 1e-6
"""Cosine of the angle between two axes up to which they are at right angles: digits that a file prints."""

ALONG = 1e-6
"""Sine of the angle between an axis of a gearbox and that of a joint up to which they are one: printed digits."""

SECOND = ".axis2"
"""End of the name of the second joint of a universal one."""

Step = tuple[str, Kind, str]
_CROSS: tuple[Step, ...] = ((".axis", "revolute", "axis"), (SECOND, "revolute", "axis2"))
KINDS: Mapping[str, tuple[Step, ...]] = {
    "fixed": (("", "fixed", ""),), "ball": (("", "ball", ""),), "revolute": (("", "revolute", "axis"),),
    "continuous": (("", "revolute", "axis"),), "prismatic": (("", "prismatic", "axis"),),
    "universal": _CROSS, "revolute2": _CROSS, "screw": ((".slide", "prismatic", ""), ("", "revolute", "axis")),
}  # fmt: skip
"""SDF joint type -> its simple joints from parent to child: end of the name, kind, element with axis and limits."""


@dataclass(frozen=True)
class SdfJoint:
    """A joint of an SDF file.

    Attributes:
        steps: Its simple joints from the parent to the child, each with its axis in the joint's axes.
        lead: Way per turn of a screw, positive for a right-handed thread [m]; 0 of other joints.
    """

    name: str
    kind: str
    parent: str
    child: str
    place: pin.SE3
    steps: tuple[TreeJoint, ...]
    lead: float = 0.0
    mimics: tuple[Mimic, ...] = ()
    notes: tuple[str, ...] = ()

    def hung(self, parent: str, child: str, placed: Mapping[str, pin.SE3]) -> list[TreeJoint]:
        """Return its simple joints between two links of a tree, of which ``parent`` is nearer to the root.

        Where the tree leads from the joint's child to its parent they follow each other in the opposite order, with
        opposite axes: coordinates stay those of the file.

        ``placed`` has the placement of every link in the model.
        """
        outwards = parent == self.parent
        steps = self.steps if outwards else [replace(step, axis=-step.axis) for step in reversed(self.steps)]
        ends = [parent, *(f"{self.name}/{number}" for number in range(1, len(steps))), child]
        places = [placed[parent].actInv(self.place), *[pin.SE3.Identity()] * (len(steps) - 1)]
        hung = [
            replace(step, parent=ends[k], child=ends[k + 1], placement=place, made_for=self.name)
            for k, (step, place) in enumerate(zip(steps, places, strict=True))
        ]
        return [*hung[:-1], replace(hung[-1], offset=self.place.actInv(placed[child]), made_for="")]

    def closing(self, placed: Mapping[str, pin.SE3]) -> tuple[list[TreeJoint], Loop]:
        """Return the frames and the loop joint that it is where it closes a loop."""
        ends = ((link, placed[link].actInv(self.place)) for link in (self.parent, self.child))
        frames, between = tied_frames(self.name, ends)
        return frames, self._loop(between)

    def _loop(self, between: tuple[str, str]) -> Loop:
        from pinarm.mechanics.loops.kinds import Universal
        from pinarm.mechanics.loops.lower_pairs import Fixed, Helical, Prismatic, Revolute, Spherical

        axes = [tuple(step.axis.tolist()) for step in self.steps]
        if self.kind == "fixed":
            return Fixed(between=between)
        if self.kind == "ball":
            return Spherical(between=between)
        if self.kind == "prismatic":
            return Prismatic(between=between, axis=axes[0])
        if self.kind == "screw":
            return Helical(between=between, axis=axes[-1], lead=self.lead)
        if len(axes) == 1:
            return Revolute(between=between, axis=axes[0])
        if abs(self.steps[0].axis @ self.steps[1].axis) > SQUARE:
            raise ModelError(
                f"joint '{self.name}': it closes a loop, and its axes are not at right angles",
                expected="axes at right angles, or another joint of the loop that closes it",
            )
        return Universal(between=between, axes=(axes[0], axes[1]))


def joint_in(joint: Element, frames: Frames, version: tuple[int, int]) -> SdfJoint:
    """Return the joint of an element that is no gearbox.

    Args:
        joint: The ``<joint>``.
        frames: Frames of the model, the joint's own among them.
    """
    name, kind_name = str(joint.get("name")), joint.get("type", "")
    where = f"joint '{name}'"
    if kind_name not in KINDS:
        expected, hint = choices(kind_name, [*KINDS, GEARBOX])
        raise ModelError(f"{where}: a joint of type '{kind_name}' is not read", expected=expected, hint=hint)
    place = frames.placement(name, where)
    parent, child = (_end_of(joint, end, frames, where) for end in ("parent", "child"))
    if parent == child:
        raise ModelError(f"{where}: it joins '{child}' to itself")
    steps, notes = [], list[str]()
    for end, kind, tag in KINDS[kind_name]:
        step = TreeJoint(name + end, kind, parent, child, pin.SE3.Identity())
        if kind not in ("fixed", "ball"):
            step = replace(step, axis=_axis_in(joint.find(tag or "axis"), place, frames, version, where))
        if tag:
            step = _moving(step, joint.find(tag), where, notes, limited=kind_name != "continuous")
        steps.append(step)
    lead = _lead(joint, where, notes) if kind_name == "screw" else 0.0
    mimics = [_mimic(joint.find(tag), name + end, where) for end, _, tag in KINDS[kind_name] if tag]
    return SdfJoint(
        name, kind_name, parent, child, place, tuple(steps), lead, tuple(filter(None, mimics)), tuple(notes)
    )


def _end_of(joint: Element, end: str, frames: Frames, where: str) -> str:
    name = text_of(joint, end)
    return WORLD if name == WORLD and end != "child" else frames.link(name, f"{where}: {end}")


def _axis_in(axis: Element | None, place: pin.SE3, frames: Frames, version: tuple[int, int], where: str) -> Array:
    """Return an axis in the axes of a joint, shape (3,): as it says, before version 1.5 in those of the model."""
    element = None if axis is None else axis.find("xyz")
    xyz = numbers((element.text or "") if element is not None else None, 3, f"{where}: axis", (0.0, 0.0, 1.0))
    named = element.get("expressed_in", "") if element is not None else ""
    key = "use_parent_model_frame"
    if version < (1, 5) or is_true(text_of(axis, key), f"{where}: {key}"):
        named = named or MODEL
    turn = place.rotation.T @ frames.placement(named, f"{where}: axis").rotation if named else np.eye(3)
    return np.asarray(turn @ direction(xyz, f"{where}: its axis"))


def _moving(plain: TreeJoint, axis: Element | None, where: str, notes: list[str], *, limited: bool) -> TreeJoint:
    """Return a simple joint with the limits, damping, friction and spring of an ``<axis>``."""
    bounds = _bounds(axis, where, notes) if limited else Bounds()
    effort, speed = (_limit(axis, key, -1.0, where) for key in ("effort", "velocity"))
    damping, friction, stiffness = (
        number_in(axis, f"dynamics/{key}", 0.0, where) for key in ("damping", "friction", "spring_stiffness")
    )
    if min(damping, friction, stiffness) < 0.0:
        raise ModelError(f"{where}: its damping, friction or stiffness is negative")
    most = {"effort": effort if effort >= 0.0 else np.inf, "velocity": speed if speed >= 0.0 else np.inf}
    return replace(
        plain,
        damping=damping,
        friction=friction,
        stiffness=stiffness,
        bounds=replace(bounds, **most),
        rest=number_in(axis, "dynamics/spring_reference", 0.0, where),
    )


def _bounds(axis: Element | None, where: str, notes: list[str]) -> Bounds:
    lower, upper = _limit(axis, "lower", -np.inf, where), _limit(axis, "upper", np.inf, where)
    if lower > upper or lower >= LIMITLESS or upper <= -LIMITLESS:
        notes.append(f"{where}: its limits {lower:g} to {upper:g} are none: the lower one is above the upper one")
        return Bounds()
    return Bounds(lower if lower > -LIMITLESS else -np.inf, upper if upper < LIMITLESS else np.inf)


def _limit(axis: Element | None, key: str, default: float, where: str) -> float:
    """Return a number in ``<limit>``, which may be infinite; the default where there is none."""
    text = text_of(axis, f"limit/{key}")
    return float(text) if text.lower() in INFINITE else number_in(axis, f"limit/{key}", default, where)


def _lead(joint: Element, where: str, notes: list[str]) -> float:
    """Return the way per turn of a screw [m]; where the file has it as rad/m it is noted."""
    for tag in ("screw_thread_pitch", "thread_pitch"):
        if not text_of(joint, tag):
            continue
        pitch = number_in(joint, tag, 0.0, where)
        if pitch == 0.0:
            raise ModelError(f"{where}: its {tag} is 0", expected="a number other than 0")
        if tag == "screw_thread_pitch":
            return pitch
        lead = -2.0 * np.pi / pitch
        notes.append(
            f"{where}: its thread_pitch is read as Gazebo does, in rad/m and positive for a left-handed "
            f"thread: {lead:g} m per turn; 'screw_thread_pitch' has one meaning"
        )
        return lead
    raise ModelError(f"{where}: a screw without a pitch", expected="<screw_thread_pitch>, in metres per turn")


def _mimic(axis: Element | None, name: str, where: str) -> Mimic | None:
    """Return the mimic relation of a joint, ``q = multiplier (q_of - reference) + offset``; ``None`` without one."""
    element = None if axis is None else axis.find("mimic")
    if element is None:
        return None
    multiplier, offset, reference = (
        number_in(element, key, x, f"{where}: mimic")
        for key, x in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
    )
    second = SECOND if element.get("axis") == "axis2" else ""
    return Mimic(name, element.get("joint", "") + second, multiplier, offset - multiplier * reference)


class Hinge(NamedTuple):
    """A revolute joint of the tree, whose ``child`` turns against its ``parent``; its axis in the axes of the model."""

    name: str
    parent: str
    child: str
    axis: Array


def gear_of(joint: Element, frames: Frames, version: tuple[int, int], hinges: Iterable[Hinge]) -> Gear:
    """Return the gear that a gearbox is; see ``joint_in``."""
    from pinarm.mechanics.couplings.kinds import Gear

    where = f"joint '{joint.get('name')}'"
    place = frames.placement(str(joint.get("name")), where)
    base = _end_of(joint, "gearbox_reference_body", frames, where)
    ratio = number_in(joint, "gearbox_ratio", 1.0, where)
    if ratio == 0.0:
        raise ModelError(f"{where}: its gearbox_ratio is 0", expected="a number other than 0")
    first = joint.find("axis")
    second = joint.find("axis2") if joint.find("axis2") is not None else first
    known = [*hinges]
    (driver, sense), (follower, other) = (
        _hinge(known, base, _end_of(joint, end, frames, where),
               place.rotation @ _axis_in(axis, place, frames, version, where), where)
        for end, axis in (("parent", first), ("child", second))
    )  # fmt: skip
    return Gear(joints=(driver, follower), ratio=-sense * other * ratio)


def _hinge(hinges: Iterable[Hinge], base: str, link: str, axis: Array, where: str) -> tuple[str, float]:
    """Return the joint between a body and a link about an axis, and the sign of its coordinate about it."""
    for hinge in hinges:
        ends = hinge.parent, hinge.child
        if {*ends} == {base, link} and np.linalg.norm(np.cross(hinge.axis, axis)) < ALONG:
            return hinge.name, float(np.sign(hinge.axis @ axis)) * (1.0 if ends == (base, link) else -1.0)
    raise ModelError(
        f"{where}: no revolute joint of the tree turns '{link}' against '{base}' about the gearbox's axis",
        expected="one between its gearbox_reference_body and each of its links",
        hint="without it, a coupling of the mechanism file: couplings: {kind: gear}",
    )


FREE = "root"
"""Name of the joint by which the first link of a model floats."""


@dataclass
class SpanningTree:
    """The tree while it grows.

    Attributes:
        joints: Simple joints and frames, depth-first.
    """

    links: dict[str, None] = field(default_factory=dict)
    joints: list[TreeJoint] = field(default_factory=list)
    hung: list[SdfJoint] = field(default_factory=list)
    loops: dict[str, Loop] = field(default_factory=dict)
    couplings: dict[str, CouplingDefinition] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def spanning_tree(
    joints: Sequence[SdfJoint], places: Mapping[str, pin.SE3], stand: pin.SE3, *, fixed: bool
) -> SpanningTree:
    """Return the tree of joints, and loop joints for those that it does not need."""
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
            name = f"{root}_free" if any(joint.kind == "floating" for joint in tree.joints) else FREE
            kind: Kind = "fixed" if fixed else "floating"
            tree.joints.append(TreeJoint(name, kind, WORLD, root, stand * places[root]))
        tree.links[root] = None
        heapify(ready := [*at.get(root, ())])
        while ready:
            joint = joints[heappop(ready)[1]]
            if {joint.parent, joint.child} <= tree.links.keys():
                continue
            ends = joint.parent, joint.child
            parent, child = ends if joint.parent in tree.links else ends[::-1]
            tree.joints += joint.hung(parent, child, placed)
            tree.links[child] = None
            tree.hung.append(joint)
            for item in at[child]:
                heappush(ready, item)
    tree.couplings |= _threads(tree.hung)
    hung = {joint.name for joint in tree.hung}
    for joint in joints:
        if joint.name not in hung:
            frames, tree.loops[joint.name] = joint.closing(placed)
            tree.joints += frames
    tree.notes += _notes(tree, joints)
    tree.joints = [*depth_first(WORLD, tree.joints)]
    return tree


def _threads(joints: Sequence[SdfJoint]) -> dict[str, CouplingDefinition]:
    if not any(joint.lead for joint in joints):
        return {}
    from pinarm.mechanics.couplings.kinds import Screw

    return {
        joint.name: Screw(joints=(joint.name, f"{joint.name}.slide"), lead=joint.lead) for joint in joints if joint.lead
    }


def is_active(joint: SdfJoint) -> bool:
    """Return whether a joint has more than a motion: limits, damping, friction, a spring, or a joint to follow."""
    steps = joint.steps
    return bool(joint.mimics) or any(x.bounds != Bounds() or x.damping or x.friction or x.stiffness for x in steps)


def _notes(tree: SpanningTree, joints: Sequence[SdfJoint]) -> Iterator[str]:
    if names := [*tree.loops]:
        yield f"closing loops of the tree of joints: {listed('joint', names)}"
    if active := [joint.name for joint in joints if joint.name in tree.loops and is_active(joint)]:
        yield f"limits, damping, friction and springs of {listed('joint', active)}, closing loops, are not modelled"
    for joint in joints:
        yield from joint.notes
    if free := [joint.child for joint in tree.joints if joint.kind == "floating"]:
        yield f"no joint ties {listed('link', free)} to the world: the model floats; 'base: fixed' holds it"
