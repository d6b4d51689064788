"""States as ``pin.buildModelFromUrdf`` has them, and as pinarm has them: the one from the other.

The joints come in the same order; three types of them have other coordinates. With p the position and R the orientation
of what moves, w its angular velocity in its own axes, and ' the transpose:

==============  ==================================================  ================================================
joint           Pinocchio                                           pinarm
==============  ==================================================  ================================================
``continuous``  q = (cos, sin) of the angle, v = its rate           q = the angle, turns counted, v = its rate
free-flyer      q = (p, quaternion), v = (``R' dp/dt``, w)          q = (p, quaternion), v = (``dp/dt``, w)
``planar``      q = (x, y, cos, sin), v = (``R' d(x, y)/dt``, w)    q = (x, y, angle), v = (``d(x, y)/dt``, w)
==============  ==================================================  ================================================

A free-flyer is the root of a model with ``base: floating`` (``root_joint`` there, ``root.x`` to ``root.z`` and ``root``
here), or a joint of the type ``floating``, whose p is along the joint's axes there and along those of the parent link
here. Joints that mimic others have coordinates of their own in both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import LISTED, InputError, several
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.loading.pinocchio_model import BASE
from pinarm.mechanics.loading.urdf.writer import CHAINS

if TYPE_CHECKING:
    from pinarm.mechanics.ball_joints import Ball

FREE_FLYER = "root_joint"
"""Name that Pinocchio gives to the joint of a floating base."""

FLOATING = ("q has the position and the quaternion x, y, z, w; v the velocity of the origin in the axes of the parent "
            "(Pinocchio: in its own) and the angular velocity in its own")  # fmt: skip
"""Which convention q and v of a joint have that moves freely."""

UNIT = 1e-8
"""How far (cos, sin) and quaternions may be from the length 1: typed digits explain as much."""

DEEPEST = 1000
"""Joints in a row that Pinocchio's reader is given: it calls itself for each, and ends the process where its stack is
full, at 3,700 of them with the usual 8 MB."""

SAME = 1e-12
"""Distance of two axes that is rounding."""


class JointStates(Protocol):
    """The states of one joint. ``p_q, p_v`` are rows as Pinocchio has them, ``q, v`` as pinarm has them."""

    def take(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write q and v, from Pinocchio's."""

    def give(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write Pinocchio's, from q and v."""


@dataclass(frozen=True)
class CopiedStates:
    """A joint whose coordinates and rates are the same in both.

    Attributes:
        p_q: Indices in Pinocchio's q.
        p_v: Indices in Pinocchio's v.
        q: Indices in q.
        v: Indices in v.
    """

    p_q: tuple[int, ...]
    p_v: tuple[int, ...]
    q: tuple[int, ...]
    v: tuple[int, ...]

    def take(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Copy coordinates and rates."""
        q[:, self.q], v[:, self.v] = p_q[:, self.p_q], p_v[:, self.p_v]

    def give(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Copy coordinates and rates."""
        p_q[:, self.p_q], p_v[:, self.p_v] = q[:, self.q], v[:, self.v]


@dataclass(frozen=True)
class ContinuousStates:
    """A joint that turns without limits; Pinocchio has the cosine and the sine of its angle.

    Attributes:
        name: Its name, for messages.
        p_q: Index of the cosine in Pinocchio's q, before the sine.
        p_v: Index of the rate in Pinocchio's v.
        q: Index of the angle in q.
        v: Index of its rate in v.
    """

    name: str
    p_q: int
    p_v: int
    q: int
    v: int

    def take(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write the angle, from -pi to pi.

        Raises:
            InputError: ``(cos, sin)`` has not the length 1.
        """
        cos, sin = p_q[:, self.p_q], p_q[:, self.p_q + 1]
        _require_unit(np.hypot(cos, sin), f"(cos, sin) of '{self.name}'")
        q[:, self.q], v[:, self.v] = np.arctan2(sin, cos), p_v[:, self.p_v]

    def give(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write cosine and sine, which know no turns."""
        p_q[:, self.p_q], p_q[:, self.p_q + 1] = np.cos(q[:, self.q]), np.sin(q[:, self.q])
        p_v[:, self.p_v] = v[:, self.v]


@dataclass(frozen=True)
class PlanarStates:
    """A joint that slides along two axes and turns about the third.

    Attributes:
        angle: Its angle, whose cosine and sine stand behind x and y in Pinocchio's q.
        p_q: Index of x in Pinocchio's q, before y.
        p_v: Index of Pinocchio's velocity, along the axes of what moves.
        x: The joint along x.
        y: The joint along y.
    """

    angle: ContinuousStates
    p_q: int
    p_v: int
    x: Joint
    y: Joint

    def take(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write x, y, the angle, and their rates."""
        self.angle.take(p_q, p_v, q, v)
        cos, sin = p_q[:, self.p_q + 2], p_q[:, self.p_q + 3]
        ahead, aside = p_v[:, self.p_v], p_v[:, self.p_v + 1]
        q[:, self.x.q], q[:, self.y.q] = p_q[:, self.p_q], p_q[:, self.p_q + 1]
        v[:, self.x.v], v[:, self.y.v] = cos * ahead - sin * aside, sin * ahead + cos * aside

    def give(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write x, y, cosine and sine, and the velocity along the axes of what moves."""
        self.angle.give(p_q, p_v, q, v)
        cos, sin = p_q[:, self.p_q + 2], p_q[:, self.p_q + 3]
        x, y = v[:, self.x.v], v[:, self.y.v]
        p_q[:, self.p_q], p_q[:, self.p_q + 1] = q[:, self.x.q], q[:, self.y.q]
        p_v[:, self.p_v], p_v[:, self.p_v + 1] = cos * x + sin * y, cos * y - sin * x


@dataclass(frozen=True, eq=False)
class FloatingStates:
    """A joint that moves freely: a free-flyer in Pinocchio.

    Attributes:
        p_q: Index of the position in Pinocchio's q, before the quaternion.
        p_v: Index of the velocity in Pinocchio's v, before the angular velocity.
        slides: The joints along x, y and z.
        ball: The ball joint beyond them.
        axes: Axes of Pinocchio's position in those of pinarm's, shape (3, 3).
    """

    p_q: int
    p_v: int
    slides: tuple[Joint, Joint, Joint]
    ball: Ball
    axes: Array

    def take(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write position, quaternion, the rate of the position, and the angular velocity.

        Raises:
            InputError: The quaternion has not the length 1.
        """
        quaternion = p_q[:, self.p_q + 3 : self.p_q + 7]
        _require_unit(np.linalg.norm(quaternion, axis=1), f"the quaternion of '{self.ball.name}'")
        at, rate = [joint.q for joint in self.slides], [joint.v for joint in self.slides]
        q[:, at] = p_q[:, self.p_q : self.p_q + 3] @ self.axes.T
        v[:, rate] = _turned(quaternion, p_v[:, self.p_v : self.p_v + 3]) @ self.axes.T
        self.ball.quaternion(q)[:], self.ball.vectors(v)[:] = quaternion, p_v[:, self.p_v + 3 : self.p_v + 6]

    def give(self, p_q: Array, p_v: Array, q: Array, v: Array) -> None:
        """Write position, quaternion, the velocity in the axes of what moves, and the angular velocity."""
        quaternion = self.ball.quaternion(q)
        _require_unit(np.linalg.norm(quaternion, axis=1), f"the quaternion of '{self.ball.name}'")
        at, rate = [joint.q for joint in self.slides], [joint.v for joint in self.slides]
        p_q[:, self.p_q : self.p_q + 3] = q[:, at] @ self.axes
        p_v[:, self.p_v : self.p_v + 3] = _turned(quaternion * [-1.0, -1.0, -1.0, 1.0], v[:, rate] @ self.axes)
        p_q[:, self.p_q + 3 : self.p_q + 7], p_v[:, self.p_v + 3 : self.p_v + 6] = quaternion, self.ball.vectors(v)


@dataclass(frozen=True, eq=False)
class PinocchioLayout:
    """How the states of a mechanism stand in the arrays of ``pin.buildModelFromUrdf``.

    Attributes:
        p_nq: Length of Pinocchio's q.
        p_nv: Length of Pinocchio's v.
        nq: Length of q.
        nv: Length of v.
        parts: The joints.
    """

    p_nq: int
    p_nv: int
    nq: int
    nv: int
    parts: tuple[JointStates, ...]

    @classmethod
    def of(cls, xml: str, model: pin.Model, joints: Mapping[str, Joint], balls: Mapping[str, Ball]) -> PinocchioLayout:
        """Compare a mechanism with what Pinocchio's reader makes of the joints in the same text.

        Args:
            xml: The URDF text.
            model: pinarm's model of it.
            joints: Its joints with one coordinate, by name.
            balls: Its ball joints, by name.

        Raises:
            InputError: The text is MJCF, or Pinocchio's reader refuses it or makes other joints of it.
        """
        root = ElementTree.fromstring(xml)
        if root.tag != "robot":
            raise InputError("the model is MJCF, which pin.buildModelFromUrdf does not read", expected="URDF or xacro")
        floats = BASE in balls and BASE not in {joint.get("name") for joint in root.findall("joint")}
        if any(joint.get("type") == "spherical" for joint in root.findall("joint")):
            raise InputError("the model has spherical joints, which pin.buildModelFromUrdf does not know",
                             expected="types of URDF, or a mechanism of a pin.Model")  # fmt: skip
        if (depth := _depth(root)) > DEEPEST:
            raise InputError(f"pin.buildModelFromUrdf goes from link to link: {depth} joints in a row are too deep",
                             expected=f"at most {DEEPEST} joints between the root and a link")  # fmt: skip
        free = [pin.JointModelFreeFlyer()] if floats else []
        try:
            theirs = pin.buildModelFromXML(_joints_alone(root), *free)
        except ValueError as error:
            raise InputError(f"pin.buildModelFromUrdf does not read the model: {error}") from None
        return cls.between(theirs, model, joints, balls, {FREE_FLYER: BASE} if floats else {})

    @classmethod
    def between(
        cls, theirs: pin.Model, model: pin.Model, joints: Mapping[str, Joint], balls: Mapping[str, Ball],
        renamed: Mapping[str, str] = MappingProxyType({}),
    ) -> PinocchioLayout:  # fmt: skip
        """Compare a mechanism with Pinocchio's model of the same joints.

        Args:
            theirs: Pinocchio's model.
            model: pinarm's model of it.
            joints: Its joints with one coordinate, by name.
            balls: Its ball joints, by name.
            renamed: Names there -> names here, where they differ.

        Raises:
            InputError: They have other joints.
        """
        names = [renamed.get(name, name) for name in theirs.names]
        parts = tuple(_part(theirs, k, names[k], model, joints, balls) for k in range(1, theirs.njoints))
        if theirs.nv != model.nv:
            raise InputError(f"the mechanism has {model.nv} velocities, and Pinocchio's reader makes {theirs.nv} of it")
        return cls(theirs.nq, theirs.nv, model.nq, model.nv, parts)

    def words(self) -> str:
        """Return which convention q and v have where Pinocchio has another one; empty where they are the same."""
        turning = [part.name for part in self.parts if isinstance(part, ContinuousStates)]
        flat = [part.angle.name for part in self.parts if isinstance(part, PlanarStates)]
        floating = [part.ball.name for part in self.parts if isinstance(part, FloatingStates)]
        told = (
            (turning, "q has the angle, turns counted (Pinocchio: cos, sin)"),
            (flat, "q has x, y and the angle, v the velocity in the axes of the parent (Pinocchio: x, y, cos, sin, and "
                   "the axes of what moves)"),
            (floating, FLOATING),
        )  # fmt: skip
        parts = [f"of {several(names, LISTED)} {what}" for names, what in told if names]
        return "; ".join(parts)

    def take(self, p_q: Array, p_v: Array) -> tuple[Array, Array]:
        """Return q, shape (n, nq), and v, shape (n, nv), from those of Pinocchio, shapes (n, p_nq) and (n, p_nv)."""
        q, v = np.zeros((len(p_q), self.nq)), np.zeros((len(p_q), self.nv))
        for part in self.parts:
            part.take(p_q, p_v, q, v)
        return q, v

    def give(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q, shape (n, p_nq), and v, shape (n, p_nv), of Pinocchio."""
        p_q, p_v = np.zeros((len(q), self.p_nq)), np.zeros((len(q), self.p_nv))
        for part in self.parts:
            part.give(p_q, p_v, q, v)
        return p_q, p_v


def _depth(root: ElementTree.Element) -> int:
    """Return the largest number of joints between the root of a URDF and one of its links."""
    ends = ((joint.find("parent"), joint.find("child")) for joint in root.findall("joint"))
    children: dict[str | None, list[str | None]] = {}
    for parent, child in ends:
        if parent is not None and child is not None:
            children.setdefault(parent.get("link"), []).append(child.get("link"))
    held, depth = {child for some in children.values() for child in some}, 0
    level = [child for parent, some in children.items() if parent not in held for child in some]
    while level:
        depth, level = depth + 1, [child for link in level for child in children.get(link, ())]
    return depth


def _joints_alone(root: ElementTree.Element) -> str:
    """Return the URDF text of links and joints alone, all with a limit.

    How states stand does not depend on anything else, of which the reader refuses more than pinarm, and writes to the
    terminal about it: joints without a limit, colours beyond 1.
    """
    robot = ElementTree.Element("robot", name="joints")
    for link in root.findall("link"):
        ElementTree.SubElement(robot, "link", name=link.get("name", ""))
    for joint in root.findall("joint"):
        copied = ElementTree.SubElement(robot, "joint", joint.attrib)
        copied.extend(child for child in joint if child.tag in ("parent", "child", "origin", "axis"))
        ElementTree.SubElement(copied, "limit", lower="-1", upper="1", effort="0", velocity="0")
    return ElementTree.tostring(robot, encoding="unicode")


PARTS: Mapping[str, tuple[str, ...]] = {
    "Planar": (".x", ".y", ".angle"), "FreeFlyer": (".x", ".y", ".z"), "Spherical": (),
    **{kind: tuple(f".{ending}" for ending in endings) for kind, endings in CHAINS.items()},
}  # fmt: skip
"""Kind of Pinocchio's joint -> what the names of pinarm's joints with one coordinate for it have at their end; those of
any other kind have its own name."""

BALLS = ("FreeFlyer", "Spherical")
"""Kinds that have a ball joint of their own name here."""


def _part(
    theirs: pin.Model, index: int, name: str, model: pin.Model, joints: Mapping[str, Joint], balls: Mapping[str, Ball]
) -> JointStates:
    """Return the states of one of Pinocchio's joints, which has the name ``name`` here.

    Raises:
        InputError: The mechanism has no such joint.
    """
    joint = theirs.joints[index]
    kind, p_q, p_v = joint.shortname().removeprefix("JointModel"), joint.idx_q, joint.idx_v
    named = [f"{name}{ending}" for ending in PARTS.get(kind, ("",))]
    if not set(named) <= joints.keys() or (kind in BALLS and name not in balls):
        raise InputError(f"Pinocchio's reader makes '{name}' a {joint.shortname()}, which it is not here",
                         hint="the base as the model's text has it, fixed or floating")  # fmt: skip
    ours = [joints[each] for each in named]
    if kind == "Spherical":
        ball = balls[name]
        return CopiedStates(_from(p_q, 4), _from(p_v, 3), _from(ball.q, 4), _from(ball.v, 3))
    if joint.nq == 2 * joint.nv:
        return ContinuousStates(name, p_q, p_v, ours[0].q, ours[0].v)
    if joint.nq == joint.nv:
        q, v = tuple(each.q for each in ours), tuple(each.v for each in ours)
        return CopiedStates(_from(p_q, joint.nq), _from(p_v, joint.nv), q, v)
    axes = model.jointPlacements[ours[0].index].rotation.T @ theirs.jointPlacements[index].rotation
    if kind == "FreeFlyer":
        return FloatingStates(p_q, p_v, (ours[0], ours[1], ours[2]), balls[name], axes)
    if np.abs(axes - np.eye(3)).max() > SAME:
        raise InputError(f"Pinocchio's reader takes no notice of the axis of the planar joint '{name}'",
                         expected="planar joints whose axis is z")  # fmt: skip
    return PlanarStates(ContinuousStates(name, p_q + 2, p_v + 2, ours[2].q, ours[2].v), p_q, p_v, ours[0], ours[1])


def _from(start: int, count: int) -> tuple[int, ...]:
    return tuple(range(start, start + count))


def _turned(quaternion: Array, vectors: Array) -> Array:
    """Return vectors turned by quaternions (x, y, z, w), shape (n, 3): ``c + 2 w (u x c) + 2 u x (u x c)``."""
    u, w = quaternion[:, :3], quaternion[:, 3:]
    t = 2.0 * np.cross(u, vectors)
    return np.asarray(vectors + w * t + np.cross(u, t))


def _require_unit(lengths: Array, what: str) -> None:
    """Raise where something has not the length 1.

    Raises:
        InputError: Says what, and in which row.
    """
    for row in np.flatnonzero(~(np.abs(lengths - 1.0) <= UNIT))[:1]:
        raise InputError(f"row {row}: {what} has the length {lengths[row]:.6g}", expected="the length 1",
                         hint="pin.normalize(model, q)")  # fmt: skip
