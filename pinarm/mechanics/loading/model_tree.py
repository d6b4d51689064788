"""The kinematic tree of a model file of any format, from which Pinocchio's model is built."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin
from msgspec import field

from pinarm.arrays import Array, Flags
from pinarm.errors import ModelError, choices, listed
from pinarm.records import ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.kinds import CouplingDefinition
    from pinarm.mechanics.loops.kinds import Loop

Kind = Literal["fixed", "revolute", "prismatic", "ball", "planar", "floating"]

TRIANGLE = 1e-9
"""Relative violation of the triangle inequality of principal moments that is attributed to printed digits."""

NOTHING = 1e-25
"""Moment of inertia that is taken for rounding of 0 [kg*m^2]."""

LIGHTEST = 1e-14
"""Least mass of what a joint carries that is not 0 [kg]; a hundredth of it is the rounding of 1."""

Z = np.array([0.0, 0.0, 1.0])
"""Axis of joints whose axis has no meaning."""


class Bounds(ValueRecord, frozen=True):
    """Limits of a joint with one coordinate [rad or m], its speed and its effort; infinite where there is none."""

    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf


class TreeJoint(ValueRecord, frozen=True):
    """A joint with its child link.

    Attributes:
        placement: Placement of the joint frame in the parent link, at coordinate 0.
        axis: Unit vector in joint axes, shape (3,): of rotation or sliding, or normal to the plane.
        offset: Placement of the child link in the joint frame.
        damping: Viscous damping [N*m*s/rad or N*s/m], the same in all directions of the joint.
        friction: Dry friction [N*m or N], likewise.
        stiffness: Stiffness of a spring to the rest position [N*m/rad or N/m], likewise.
        rest: Coordinate at which that spring is free [rad or m]; 0 for joints with several coordinates.
        armature: Rotor inertia reflected to the joint [kg*m^2 or kg], the same in all directions.
        drawn: Coordinate of the reference pose of the model [rad or m].
    """

    name: str
    kind: Kind
    parent: str
    child: str
    placement: pin.SE3
    axis: Array = field(default_factory=lambda: Z)
    offset: pin.SE3 = field(default_factory=pin.SE3.Identity)
    bounds: Bounds = Bounds()
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    armature: float = 0.0
    drawn: float = 0.0
    made_for: str = ""


class Mimic(ValueRecord, frozen=True):
    """A joint that the model couples to another one: ``q = multiplier * q_of + offset``."""

    joint: str
    of: str
    multiplier: float
    offset: float


class Tree(ValueRecord, frozen=True):
    """Links and joints of a model file.

    Attributes:
        links: Inertia of every link about its own frame, 0 where none is given; the root first.
        gravity: Gravity field of the file [m/s^2], world axes, shape (3,); ``None`` where it gives none.
        defects: Physically impossible values with which the model can still be built, in words.
        held: Joint that is yet to be fixed, by ``with_held`` -> the coordinate at which it is held [rad or m].
    """

    name: str
    links: Mapping[str, pin.Inertia]
    joints: tuple[TreeJoint, ...]
    mimics: tuple[Mimic, ...] = ()
    gravity: Array | None = None
    defects: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    loops: Mapping[str, Loop] = field(default_factory=dict)
    couplings: Mapping[str, CouplingDefinition] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)

    @property
    def root(self) -> str:
        return next(iter(self.links))


def with_held(tree: Tree) -> Tree:
    """Return the tree, the joints that it holds fixed at their coordinates."""
    if not tree.held:
        return tree
    joints = (_held(joint, tree.held[joint.name]) if joint.name in tree.held else joint for joint in tree.joints)
    return replace(tree, joints=(*joints,), held={})


def _held(joint: TreeJoint, value: float) -> TreeJoint:
    turned = pin.SE3(pin.exp3(joint.axis * value), np.zeros(3))
    moved = turned if joint.kind == "revolute" else pin.SE3(np.eye(3), joint.axis * value)
    place = joint.placement * moved * joint.offset
    return TreeJoint(joint.name, "fixed", joint.parent, joint.child, place, joint.axis)


def fixed_frame(name: str, link: str, place: pin.SE3, made_for: str = "") -> TreeJoint:
    """Return the joint that fixes a frame to a link."""
    return TreeJoint(f"{name}_fixed", "fixed", link, name, place, made_for=made_for)


def tied_frames(name: str, ends: Iterable[tuple[str, pin.SE3]]) -> tuple[list[TreeJoint], tuple[str, str]]:
    """Return frames ``NAME_1`` and ``NAME_2`` of a joint that closes a loop, at places in two links; their names."""
    first, second = f"{name}_1", f"{name}_2"
    frames = [fixed_frame(frame, *end, made_for=name) for frame, end in zip((first, second), ends, strict=True)]
    return frames, (first, second)


def depth_first(root: str, joints: Sequence[TreeJoint]) -> tuple[TreeJoint, ...]:
    """Return joints with those beyond each right behind it, as Pinocchio's algorithms need them."""
    check_unique(root, joints)
    beyond: dict[str, list[TreeJoint]] = {}
    for joint in reversed(joints):
        beyond.setdefault(joint.parent, []).append(joint)
    ordered, waiting = list[TreeJoint](), beyond.get(root, [])
    while waiting:
        ordered.append(joint := waiting.pop())
        waiting += beyond.get(joint.child, [])
    if lost := sorted({joint.name for joint in joints} - {joint.name for joint in ordered}):
        raise ModelError(
            f"the {listed('joint', lost)} hang{'' if len(lost) > 1 else 's'} in a circle", expected="a tree"
        )
    return tuple(ordered)


def check_unique(root: str, joints: Iterable[TreeJoint]) -> None:
    """Refuse names that two parts of a tree have: those of links, frames and joints, of the file or made for it."""
    links, names = {root: f"the root, '{root}'"}, dict[str, str]()
    for joint in joints:
        part = f"a part of '{joint.made_for}'" if joint.made_for else ""
        _claim(links, joint.child, part or f"what joint '{joint.name}' carries", "parts of the model")
        _claim(names, joint.name, part or "a joint of the model", "joints")


def _claim(taken: dict[str, str], name: str, what: str, kind: str) -> None:
    if name in taken:
        raise ModelError(
            f"two {kind} have the name '{name}': {taken[name]}, and {what}",
            expected="a name of its own for each",
            hint="rename one of them",
        )
    taken[name] = what


def body_inertia(mass: float, place: pin.SE3, moments: Array, where: str) -> pin.Inertia:
    """Return an inertia about a link's frame; a negative mass is refused.

    Args:
        mass: Mass [kg].
        place: Centre of mass, and axes of the moments, in the link.
        moments: Inertia matrix about the centre of mass [kg*m^2], shape (3, 3).
    """
    if mass < 0.0:
        raise ModelError(f"{where}: the mass is negative ({mass:g} kg)")
    return inertia(mass, place.translation, place.rotation @ moments @ place.rotation.T)


def inertia(mass: float, centre: Array, moments: Array) -> pin.Inertia:
    """Return an inertia about a link's frame; Pinocchio's constructor refuses moments that are negative by rounding.

    Args:
        mass: Mass [kg].
        centre: Centre of mass in link axes [m], shape (3,).
        moments: Inertia matrix about the centre of mass, link axes [kg*m^2], shape (3, 3).
    """
    if not (math.isfinite(mass) and np.isfinite(moments).all()):
        raise ModelError("a mass, or a moment of inertia, is beyond all numbers", hint="sizes and masses below 1e50")
    body = pin.Inertia(mass, centre, np.zeros((3, 3)))
    below = np.tril(moments, -1)
    body.inertia = below + below.T + np.diag(np.diag(moments))  # turned moments are symmetric but for rounding
    return body


def inertia_defect(moments: Array) -> str:
    """Return why no body can have an inertia, in words; empty for a possible one.

    Possible are principal moments ``0 <= I_1 <= I_2 <= I_3 <= I_1 + I_2``.

    Args:
        moments: Inertia matrix about the centre of mass [kg*m^2], shape (3, 3).
    """
    principal, negative, unequal = _principal(moments)
    if negative:
        return f"a principal moment of inertia is negative ({principal[0]:g} kg*m^2)"
    if unequal:
        return (
            f"no body has principal moments of inertia {', '.join(f'{m:g}' for m in principal)} kg*m^2: "
            "each is at most the sum of the other two"
        )
    return ""


def impossible(moments: Array) -> Flags:
    """Return a mask of the inertias that no body can have, see ``inertia_defect``; shape (k, 3, 3) to (k,)."""
    _, negative, unequal = _principal(moments)
    return negative | unequal


def _principal(moments: Array) -> tuple[Array, Flags, Flags]:
    """Return principal moments, (.., 3), where one is negative, and where one exceeds the sum of the others, (..)."""
    principal = np.asarray(np.linalg.eigvalsh(moments), dtype=np.float64)
    slack = TRIANGLE * np.abs(principal).max(axis=-1) + NOTHING
    return principal, principal[..., 0] < -slack, principal[..., :2].sum(axis=-1) < principal[..., 2] - slack


def checked_mimics(mimics: Iterable[Mimic], joints: Mapping[str, Kind]) -> tuple[tuple[Mimic, ...], tuple[str, ...]]:
    """Return the couplings whose leaders exist, and a note on each of the others."""
    leaders = {mimic.joint: mimic.of for mimic in mimics}
    kept, orphans = [], []
    if twice := [joint for joint, count in Counter(mimic.joint for mimic in mimics).items() if count > 1]:
        raise ModelError(f"joint '{twice[0]}' follows other joints twice", expected="one coupling for each joint")
    for mimic in mimics:
        if mimic.of not in joints:
            close = choices(mimic.of, joints)[1]
            meant = f"; '{close}' does" if close else ""
            orphans.append(f"joint '{mimic.joint}' mimics '{mimic.of}', which does not exist{meant}")
            continue
        if joints[mimic.of] not in ("revolute", "prismatic"):
            raise ModelError(
                f"joint '{mimic.joint}' mimics '{mimic.of}', which is {joints[mimic.of]}",
                expected="a leader with one coordinate",
            )
        chain, last = {mimic.joint: None}, mimic.joint
        while (last := leaders.get(last, "")) and last not in chain:
            chain[last] = None
        if last:
            raise ModelError(f"joint '{mimic.joint}' mimics itself: {' -> '.join([*chain, last])}")
        kept.append(mimic)
    return tuple(kept), tuple(orphans)


def from_z(axis: Array) -> Array:
    """Return the smallest rotation that takes z to a unit vector, shape (3, 3); half a turn about x for -z.

    ``R = 1 + r [n] + (1 - axis_z) [n]^2`` with ``r n = z x axis``, accurate beside -z too.
    """
    w = np.cross(Z, axis)
    r = float(np.linalg.norm(w))
    if r < 1e-15:
        return np.diag([1.0, 1.0, 1.0] if axis[2] > 0.0 else [1.0, -1.0, -1.0])
    skew = pin.skew(w / r)
    return np.asarray(np.eye(3) + r * skew + (1.0 - axis[2]) * skew @ skew)
