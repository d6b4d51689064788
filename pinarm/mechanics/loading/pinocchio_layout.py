"""Conversion of states between the convention of ``pin.buildModelFromUrdf`` and that of pinarm.

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

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import LISTED, InputError, several
from pinarm.input.xml_text import tree_of
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.loading.model_tree import Tree
from pinarm.mechanics.loading.pinocchio_model import BASE
from pinarm.mechanics.loading.urdf import urdf_tree
from pinarm.mechanics.loading.urdf_writer import CHAINS
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.ball_joints import Ball

FREE_FLYER = "root_joint"
"""Name that Pinocchio gives to the joint of a floating base."""

FLOATING = (
    "q has the position and the quaternion x, y, z, w; v the velocity of the origin in the axes of the parent "
    "(Pinocchio: in its own) and the angular velocity in its own"
)
"""Convention of q and v of a free joint, in words."""

UNIT = 1e-8
"""Largest deviation of (cos, sin) and quaternions from the length 1: rounding of typed digits."""

SAME = 1e-12
"""Distance of two axes that is rounding."""

PARTS: Mapping[str, tuple[str, ...]] = {
    "Planar": (".x", ".y", ".angle"),
    "FreeFlyer": (".x", ".y", ".z"),
    "Spherical": (),
    **{kind: tuple(f".{ending}" for ending in endings) for kind, endings in CHAINS.items()},
}
"""Kind of Pinocchio's joint -> what the names of pinarm's joints with one coordinate for it have at their end; those of
any other kind have its own name."""

TYPES: Mapping[str, Callable[[], pin.JointModel]] = {
    "revolute": pin.JointModelRZ,
    "continuous": pin.JointModelRUBZ,
    "prismatic": pin.JointModelPZ,
    "planar": pin.JointModelPlanar,
    "floating": pin.JointModelFreeFlyer,
}
"""Type of a joint of URDF -> Pinocchio's joint; its axis does not matter for the layout."""

BALLS = ("FreeFlyer", "Spherical")
"""Kinds that have a ball joint of their own name here."""


class JointStates(Record, frozen=True):
    """Where the states of one joint stand, and how they differ.

    Attributes:
        way: ``continuous``, ``planar`` or ``floating``; ``same`` where they do not differ.
        p_q: Indices in Pinocchio's q.
        p_v: Indices in Pinocchio's v.
        axes: Axes of Pinocchio's position in those of pinarm's, shape (3, 3).
    """

    name: str
    way: str
    p_q: range
    p_v: range
    q: tuple[int, ...]
    v: tuple[int, ...]
    axes: Array

    def take(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q and v here from those of Pinocchio, rows of states; angles are from -pi to pi."""
        if self.way == "same":
            return q, v
        if self.way == "floating":
            turn = q[:, 3:]
            _require_unit(np.linalg.norm(turn, axis=1), f"the quaternion of '{self.name}'")
            linear = _turned(turn, v[:, :3]) @ self.axes.T
            return np.hstack([q[:, :3] @ self.axes.T, turn]), np.hstack([linear, v[:, 3:]])
        _require_unit(np.hypot(q[:, -2], q[:, -1]), f"(cos, sin) of '{self.name}'")
        angle = np.arctan2(q[:, -1:], q[:, -2:-1])
        return np.hstack([q[:, :-2], angle]), np.hstack([_in_plane(angle, v[:, :-1]), v[:, -1:]])

    def give(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q and v of Pinocchio from those here; cosine and sine know no turns."""
        if self.way == "same":
            return q, v
        if self.way == "floating":
            turn = q[:, 3:]
            _require_unit(np.linalg.norm(turn, axis=1), f"the quaternion of '{self.name}'")
            linear = _turned(turn * [-1.0, -1.0, -1.0, 1.0], v[:, :3] @ self.axes)
            return np.hstack([q[:, :3] @ self.axes, turn]), np.hstack([linear, v[:, 3:]])
        angle = q[:, -1:]
        position = np.hstack([q[:, :-1], np.cos(angle), np.sin(angle)])
        return position, np.hstack([_in_plane(-angle, v[:, :-1]), v[:, -1:]])


def _in_plane(angle: Array, v: Array) -> Array:
    """Return vectors of the plane turned by an angle, shapes (n, 1) and (n, 2); none of a joint that only turns."""
    c, s, x, y = np.cos(angle), np.sin(angle), v[:, :1], v[:, 1:2]
    return np.hstack([c * x - s * y, s * x + c * y])


class PinocchioLayout(Record, frozen=True):
    """Layout of a mechanism's states in the arrays of ``pin.buildModelFromUrdf``."""

    p_nq: int
    p_nv: int
    nq: int
    nv: int
    parts: tuple[JointStates, ...]

    @classmethod
    def of(cls, xml: str, model: pin.Model, joints: Mapping[str, Joint], balls: Mapping[str, Ball]) -> PinocchioLayout:
        """Compare a mechanism with the joints that ``pin.buildModelFromUrdf`` makes of the same text."""
        root = tree_of(xml)
        if root.tag != "robot":
            format = {"mujoco": "MJCF", "sdf": "SDF"}.get(root.tag, root.tag)
            raise InputError(
                f"the model is {format}, which pin.buildModelFromUrdf does not read", expected="URDF or xacro"
            )
        types = {joint.get("name", ""): joint.get("type", "") for joint in root.findall("joint")}
        if "spherical" in types.values():
            raise InputError(
                "the model has spherical joints, which pin.buildModelFromUrdf does not know",
                expected="types of URDF, or a mechanism of a pin.Model",
            )
        floats = BASE in balls and BASE not in types
        theirs = _their_model(urdf_tree(root), types, floats=floats)
        return cls.between(theirs, model, joints, balls, {FREE_FLYER: BASE} if floats else {})

    @classmethod
    def between(
        cls,
        theirs: pin.Model,
        model: pin.Model,
        joints: Mapping[str, Joint],
        balls: Mapping[str, Ball],
        renamed: Mapping[str, str] = MappingProxyType({}),
    ) -> PinocchioLayout:
        """Compare a mechanism with Pinocchio's model of the same joints.

        Args:
            renamed: Names there -> names here, where they differ.
        """
        names = [renamed.get(name, name) for name in theirs.names]
        parts = tuple(_part(theirs, k, names[k], model, joints, balls) for k in range(1, theirs.njoints))
        if theirs.nv != model.nv:
            raise InputError(f"the mechanism has {model.nv} velocities, and Pinocchio's reader makes {theirs.nv} of it")
        return cls(theirs.nq, theirs.nv, model.nq, model.nv, parts)

    def words(self) -> str:
        conventions = {
            "continuous": "q has the angle, turns counted (Pinocchio: cos, sin)",
            "planar": "q has x, y and the angle, v the velocity in the axes of the parent (Pinocchio: x, y, cos, sin, "
            "and the axes of what moves)",
            "floating": FLOATING,
        }
        named = {way: [part.name for part in self.parts if part.way == way] for way in conventions}
        return "; ".join(f"of {several(names, LISTED)} {conventions[way]}" for way, names in named.items() if names)

    def take(self, p_q: Array, p_v: Array) -> tuple[Array, Array]:
        """Return q, shape (n, nq), and v, shape (n, nv), from those of Pinocchio, shapes (n, p_nq) and (n, p_nv)."""
        q, v = np.zeros((len(p_q), self.nq)), np.zeros((len(p_q), self.nv))
        for part in self.parts:
            q[:, part.q], v[:, part.v] = part.take(p_q[:, part.p_q], p_v[:, part.p_v])
        return q, v

    def give(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q, shape (n, p_nq), and v, shape (n, p_nv), of Pinocchio."""
        p_q, p_v = np.zeros((len(q), self.p_nq)), np.zeros((len(q), self.p_nv))
        for part in self.parts:
            p_q[:, part.p_q], p_v[:, part.p_v] = part.give(q[:, part.q], v[:, part.v])
        return p_q, p_v


def _their_model(tree: Tree, types: Mapping[str, str], *, floats: bool) -> pin.Model:
    """Return the joints that Pinocchio's reader makes of a tree: the same ones in the same order, of its own types."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), FREE_FLYER) if floats else 0
    places = {tree.root: (root, pin.SE3.Identity())}
    for joint in tree.joints:
        index, place = places[joint.parent]
        place = place * joint.placement
        if joint.kind != "fixed":
            index = model.addJoint(index, TYPES[types[joint.name]](), place, joint.name)
            place = pin.SE3.Identity()
        places[joint.child] = index, place
    return model


def _part(
    theirs: pin.Model, index: int, name: str, model: pin.Model, joints: Mapping[str, Joint], balls: Mapping[str, Ball]
) -> JointStates:
    """Return the states of one of Pinocchio's joints, which has the name ``name`` here."""
    joint = theirs.joints[index]
    kind = joint.shortname().removeprefix("JointModel")
    named = [f"{name}{ending}" for ending in PARTS.get(kind, ("",))]
    if not set(named) <= joints.keys() or (kind in BALLS and name not in balls):
        raise InputError(
            f"Pinocchio's reader makes '{name}' a {joint.shortname()}, which it is not here",
            hint="the base as the model's text has it, fixed or floating",
        )
    ours = [joints[part] for part in named]
    q, v = [part.q for part in ours], [part.v for part in ours]
    if kind in BALLS:
        ball = balls[name]
        q, v = [*q, *range(ball.q, ball.q + 4)], [*v, *range(ball.v, ball.v + 3)]
    way, axes = {"FreeFlyer": "floating", "Planar": "planar"}.get(kind, "same"), np.eye(3)
    if way != "same":
        axes = model.jointPlacements[ours[0].index].rotation.T @ theirs.jointPlacements[index].rotation
    elif joint.nq == 2 * joint.nv:
        way = "continuous"
    if way == "planar" and np.abs(axes - np.eye(3)).max() > SAME:
        raise InputError(
            f"Pinocchio's reader takes no notice of the axis of the planar joint '{name}'",
            expected="planar joints whose axis is z",
        )
    places = range(joint.idx_q, joint.idx_q + joint.nq), range(joint.idx_v, joint.idx_v + joint.nv)
    return JointStates(name, way, *places, tuple(q), tuple(v), axes)


def _turned(quaternion: Array, vectors: Array) -> Array:
    """Return vectors turned by quaternions (x, y, z, w), shape (n, 3): ``c + 2 w (u x c) + 2 u x (u x c)``."""
    u, w = quaternion[:, :3], quaternion[:, 3:]
    t = 2.0 * np.cross(u, vectors)
    return np.asarray(vectors + w * t + np.cross(u, t))


def _require_unit(lengths: Array, what: str) -> None:
    """Raise an ``InputError`` with the first row where something has not the length 1."""
    for row in np.flatnonzero(~(np.abs(lengths - 1.0) <= UNIT))[:1]:
        raise InputError(
            f"row {row}: {what} has the length {lengths[row]:.6g}",
            expected="the length 1",
            hint="pin.normalize(model, q)",
        )
