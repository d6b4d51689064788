"""The kinematic tree of a model file of any format, from which Pinocchio's model is built."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin
from msgspec import Struct, field

from pinarm.arrays import Array, Flags
from pinarm.errors import ModelError, choices, listed
from pinarm.records import ValueRecord

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


class Tree(Struct):
    """Links and joints of a model file of any format, which a reader fills.

    Attributes:
        links: Inertia of every link about its own frame, 0 where none is given; the root first.
        joints: Joints, each behind that which carries it, with those that fix frames to links.
        gravity: Gravity field of the file [m/s^2], world axes, shape (3,); ``None`` where it gives none.
        loops: Joints that close loops, as a mechanism file has them.
        couplings: Couplings of joints, likewise.
        defects: Physically impossible values with which the model can still be built, in words.
        remarks: What is not modelled as the file has it -> names of the elements that have it.
    """

    name: str
    links: dict[str, pin.Inertia] = {}
    joints: list[TreeJoint] = []
    mimics: list[Mimic] = []
    gravity: Array | None = None
    loops: dict[str, Loop] = {}
    couplings: dict[str, CouplingDefinition] = {}
    defects: list[str] = []
    notes: list[str] = []
    remarks: dict[str, list[str]] = {}

    @property
    def root(self) -> str:
        return next(iter(self.links))

    def remark(self, what: str, *names: str) -> None:
        """Note a feature of some elements."""
        if names:
            self.remarks.setdefault(what, []).extend(names)

    def body(self, mass: float, place: pin.SE3, moments: Array, where: str) -> pin.Inertia:
        """Return an inertia about a link's frame; a negative mass is refused, impossible moments are a defect.

        Args:
            mass: Mass [kg].
            place: Centre of mass, and axes of the moments, in the link.
            moments: Inertia matrix about the centre of mass [kg*m^2], shape (3, 3).
        """
        if wrong := inertia_defect(moments):
            self.defects.append(f"{where}: {wrong}")
        return body_inertia(mass, place, moments, where)

    def add_frame(self, name: str, link: str, place: pin.SE3, made_for: str = "") -> None:
        """Fix a frame without mass to a link."""
        self.links[name] = pin.Inertia.Zero()
        self.joints.append(fixed_frame(name, link, place, made_for))

    def close(self, name: str, kind: str, ends: Iterable[tuple[str, pin.SE3]], **keys: object) -> None:
        """Close a loop between frames ``NAME_1`` and ``NAME_2`` at places in two links.

        Args:
            kind: Kind of a loop joint in a mechanism file.
            keys: Its keys there, such as ``axis``.
        """
        between = f"{name}_1", f"{name}_2"
        for frame, (link, place) in zip(between, ends, strict=True):
            self.add_frame(frame, link, place, name)
        self.tie(name, kind, between, **keys)

    def tie(self, name: str, kind: str, between: tuple[str, str], **keys: object) -> None:
        """Close a loop between two links or frames; see ``close``."""
        from pinarm.mechanics.loops.kinds import LOOP_KINDS  # not paid for by models without loops

        self.loops[name] = LOOP_KINDS[kind](between=between, **keys)

    def keep_known_mimics(self) -> None:
        """Keep the couplings whose leaders exist, the others are defects; refuse those that no mechanism can have."""
        kinds, leaders = {joint.name: joint.kind for joint in self.joints}, dict[str, str]()
        for mimic in self.mimics:
            if mimic.joint in leaders:
                raise ModelError(f"joint '{mimic.joint}' follows other joints twice", expected="one coupling a joint")
            leaders[mimic.joint] = mimic.of
        for follower, leader in leaders.items():
            if leader not in kinds:
                close = choices(leader, kinds)[1]
                meant = f"; '{close}' does" if close else ""
                self.defects.append(f"joint '{follower}' mimics '{leader}', which does not exist{meant}")
            elif kinds[leader] not in ("revolute", "prismatic"):
                problem = f"joint '{follower}' mimics '{leader}', which is {kinds[leader]}"
                raise ModelError(problem, expected="a leader with one coordinate")
            chain, joint = dict[str, None](), follower
            while joint in leaders and joint not in chain:
                chain[joint], joint = None, leaders[joint]
            if joint in chain:
                raise ModelError(f"joint '{follower}' mimics itself: {' -> '.join([*chain, joint])}")
        self.mimics = [mimic for mimic in self.mimics if mimic.of in kinds]


class MeshMass(ModelError):
    """A mass that only a mesh, or a compiler of shells, would tell."""


def fixed_frame(name: str, link: str, place: pin.SE3, made_for: str = "") -> TreeJoint:
    """Return the joint that fixes a frame, or a body that does not move, to a link."""
    return TreeJoint(f"{name}_fixed", "fixed", link, name, place, made_for=made_for)


def held(joint: TreeJoint, value: float) -> TreeJoint:
    """Return a joint fixed at its coordinate [rad or m]."""
    turned = pin.SE3(pin.exp3(joint.axis * value), np.zeros(3))
    moved = turned if joint.kind == "revolute" else pin.SE3(np.eye(3), joint.axis * value)
    place = joint.placement * moved * joint.offset
    return TreeJoint(joint.name, "fixed", joint.parent, joint.child, place, joint.axis)


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
    """Return an inertia about a link's frame; see ``Tree.body``."""
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
