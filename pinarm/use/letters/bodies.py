"""The tree of joints and bodies of a mechanism with its dimensions and masses as formulas."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import sympy

from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError
from pinarm.mechanics.forces.joint_forces import SpringDamper
from pinarm.mechanics.joints import Joint
from pinarm.records import ValueRecord, replace
from pinarm.use.letters.traced_model import TracedModel, exact, traced_model

MOST = 6
"""Largest number of joints: formulas of more are longer than anybody reads, and take minutes."""

AXIAL = ("revolute", "continuous", "prismatic")
"""Kinds of joints whose motion is along or about one axis."""


class Body(ValueRecord, frozen=True):
    """Mass, centre of mass and inertia of the body behind a joint.

    Attributes:
        mass: [kg].
        centre: Centre of mass in the frame behind the joint, shape (3, 1).
        inertia: About the centre of mass, along that frame's axes, shape (3, 3).
    """

    mass: sympy.Expr
    centre: sympy.Matrix
    inertia: sympy.Matrix


class AxialJoint(ValueRecord, frozen=True):
    """A joint about or along one axis.

    Attributes:
        name: Its name.
        parent: The joint before it; empty on the ground.
        placement: Rotation and position in the frame behind the parent.
        axis: Shape (3, 1).
        turning: Whether it turns.
        damping: Viscous damping that the model gives it.
        bodies: What moves with it.
    """

    name: str
    parent: str
    placement: tuple[sympy.Matrix, sympy.Matrix]
    axis: sympy.Matrix
    turning: bool
    damping: sympy.Expr
    bodies: tuple[Body, ...] = ()


class LetteredTree(ValueRecord, frozen=True):
    """The joints of a mechanism, each behind its parent, and where links are.

    Attributes:
        joints: The joints.
        links: Link -> the joint that it moves with, and rotation and position of its frame behind that joint.
    """

    joints: tuple[AxialJoint, ...]
    links: Mapping[str, tuple[str, tuple[sympy.Matrix, sympy.Matrix]]]


def lettered_tree(mechanism: Mechanism) -> LetteredTree:
    """Return the tree of a mechanism, of formulas where its model is a xacro or URDF file with its own masses alone.

    Raises:
        InputError: A joint has more than one coordinate, or there are more than ``MOST``.
    """
    if len(mechanism.joints) > MOST:
        raise InputError(
            f"equations in letters of {len(mechanism.joints)} joints are too long", expected=f"at most {MOST}"
        )
    if mechanism.balls or len(mechanism.joints) != mechanism.model.nv:
        raise InputError(
            "equations in letters are written of joints with one coordinate",
            expected="revolute, continuous and prismatic joints",
        )
    if mechanism.xml.lstrip().startswith("<mujoco") or mechanism.payloads or not _follows(mechanism):
        return _of_numbers(mechanism)
    return _UrdfReader(traced_model(mechanism)).tree(mechanism)


def _follows(mechanism: Mechanism) -> bool:
    """Return whether the movable joints of the text are those of the mechanism."""
    if mechanism.description.planar is not None:
        return False
    root = ElementTree.fromstring(mechanism.xml)
    movable = {joint.get("name") for joint in root.findall("joint") if joint.get("type") in AXIAL}
    return movable == {*mechanism.joints}


class _UrdfReader:
    """Reads joints and inertias of a URDF text with formulas."""

    def __init__(self, text: TracedModel) -> None:
        self.text, root = text, ElementTree.fromstring(text.xml)
        self.links = {str(link.get("name")): link for link in root.findall("link")}
        self.behind: dict[str, list[Any]] = {}
        for joint in root.findall("joint"):
            self.behind.setdefault(joint.find("parent").get("link"), []).append(joint)  # type: ignore[union-attr,arg-type]
        self.joints: dict[str, AxialJoint] = {}
        self.places: dict[str, tuple[str, tuple[sympy.Matrix, sympy.Matrix]]] = {}

    def tree(self, mechanism: Mechanism) -> LetteredTree:
        children = {joint.find("child").get("link") for joints in self.behind.values() for joint in joints}
        (root,) = (name for name in self.links if name not in children)
        self._walk(root, "", (sympy.eye(3), sympy.zeros(3, 1)))
        ordered = sorted(self.joints.values(), key=lambda joint: mechanism.joints[joint.name].index)
        return LetteredTree(tuple(ordered), self.places)

    def _walk(self, link: str, carrier: str, placement: tuple[sympy.Matrix, sympy.Matrix]) -> None:
        """Add a link that is placed behind a joint, and all that hangs on it."""
        self.places[link] = carrier, placement
        if carrier and (inertial := self.links[link].find("inertial")) is not None:
            joint = self.joints[carrier]
            self.joints[carrier] = replace(joint, bodies=(*joint.bodies, self._body(inertial, placement)))
        for joint in self.behind.get(link, ()):
            own, child = self._placed(joint.find("origin"), placement), joint.find("child").get("link")
            if joint.get("type") not in AXIAL:
                self._walk(child, carrier, own)
                continue
            name, element = joint.get("name"), joint.find("axis")
            axis = self.text.vector(element.get("xyz") if element is not None else None, "1 0 0")
            turning = joint.get("type") != "prismatic"
            direction, damping = axis / sympy.sqrt(axis.dot(axis)), self._damping(joint.find("dynamics"))
            self.joints[name] = AxialJoint(name, carrier, own, direction, turning, damping)
            self._walk(child, name, (sympy.eye(3), sympy.zeros(3, 1)))

    def _damping(self, dynamics: Any) -> sympy.Expr:
        return self.text.number(dynamics.get("damping", "0")) if dynamics is not None else sympy.Integer(0)

    def _placed(self, origin: Any, before: tuple[sympy.Matrix, sympy.Matrix]) -> tuple[sympy.Matrix, sympy.Matrix]:
        if origin is None:
            return before
        roll, pitch, yaw = self.text.vector(origin.get("rpy"))
        turn = rotation(sympy.Matrix([0, 0, 1]), yaw) * rotation(sympy.Matrix([0, 1, 0]), pitch)
        turn = turn * rotation(sympy.Matrix([1, 0, 0]), roll)
        return before[0] * turn, before[1] + before[0] * self.text.vector(origin.get("xyz"))

    def _body(self, inertial: Any, placement: tuple[sympy.Matrix, sympy.Matrix]) -> Body:
        turn, centre = self._placed(inertial.find("origin"), placement)
        read = {name: self.text.number(value) for name, value in inertial.find("inertia").attrib.items()}
        inertia = sympy.Matrix(3, 3, lambda i, j: read.get(f"i{''.join(sorted('xyz'[i] + 'xyz'[j]))}", 0))
        return Body(self.text.number(inertial.find("mass").get("value")), centre, turn * inertia * turn.T)


def rotation(axis: sympy.Matrix, angle: Any) -> sympy.Matrix:
    """Return the rotation by an angle about a unit vector, shape (3, 3) (Rodrigues)."""
    x, y, z = axis
    cross = sympy.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return sympy.eye(3) + sympy.sin(angle) * cross + (1 - sympy.cos(angle)) * cross * cross


def _of_numbers(mechanism: Mechanism) -> LetteredTree:
    """Return the tree with the numbers of Pinocchio's model."""
    model, joints = mechanism.model, {joint.index: joint for joint in mechanism.joints.values()}
    places = {}
    for frame in model.frames:
        carrier = joints[frame.parentJoint].name if frame.parentJoint else ""
        places[frame.name] = carrier, _pose(frame.placement)
    damping = dict.fromkeys(range(model.nv), 0.0)
    for element in mechanism.forces.values():
        if isinstance(element, SpringDamper) and not element.stiffness.any():
            damping |= dict(zip(element.v.tolist(), element.damping.tolist(), strict=True))
    return LetteredTree(tuple(_axial(model, joints[k], damping[joints[k].v], joints) for k in sorted(joints)), places)


def _axial(model: pin.Model, joint: Joint, damping: float, joints: Mapping[int, Joint]) -> AxialJoint:
    index = joint.index
    kind = model.joints[index]
    data = kind.createData()
    kind.calc(data, pin.neutral(model)[kind.idx_q : kind.idx_q + kind.nq])
    motion = np.asarray(data.S).reshape(6)
    turning, parent = bool(np.any(motion[3:])), model.parents[index]
    inertia = model.inertias[index]
    body = Body(exact(inertia.mass), _matrix(inertia.lever), _matrix(inertia.inertia))
    axis = _matrix(motion[3:] if turning else motion[:3])
    before = joints[parent].name if parent else ""
    return AxialJoint(joint.name, before, _pose(model.jointPlacements[index]), axis, turning, exact(damping), (body,))


def _pose(placement: pin.SE3) -> tuple[sympy.Matrix, sympy.Matrix]:
    return _matrix(placement.rotation), _matrix(placement.translation)


def _matrix(values: Any) -> sympy.Matrix:
    numbers = np.asarray(values, float)
    numbers = np.where(np.abs(numbers) < 1e-15 * np.abs(numbers).max(initial=0.0), 0.0, numbers)
    return sympy.Matrix(np.atleast_2d(numbers.T).T.tolist()).applyfunc(lambda number: exact(float(number)))
