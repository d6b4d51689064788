"""The tree of joints and bodies of a mechanism with its dimensions and masses as formulas of its arguments.

What a xacro file computes is followed through its expansion. Other models have numbers.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import sympy

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError, PinarmError
from pinarm.input.roots import contained_file, file_root, root_of
from pinarm.input.xacro.arithmetic import MARKS, Column, Rows
from pinarm.input.xacro.expander import Expander
from pinarm.mechanics.forces.joint_forces import SpringDamper
from pinarm.mechanics.joints import Joint
from pinarm.records import ValueRecord, replace

MOST = 6
"""Largest number of joints: formulas of more are longer than anybody reads, and take minutes."""

AXIAL = ("revolute", "continuous", "prismatic")
"""Kinds of joints whose motion is along or about one axis."""

DENOMINATOR = 1000
"""Largest denominator of a number that is written as a fraction, or as a fraction of pi."""

FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": operator.pow,
    "-x": operator.neg, "+x": operator.pos, "sin": sympy.sin, "cos": sympy.cos, "tan": sympy.tan, "asin": sympy.asin,
    "acos": sympy.acos, "atan": sympy.atan, "atan2": sympy.atan2, "sqrt": sympy.sqrt, "exp": sympy.exp,
    "pow": operator.pow, "hypot": lambda *sides: sympy.sqrt(sum(side**2 for side in sides)),
    "radians": lambda degrees: degrees * sympy.pi / 180,
}  # fmt: skip

Placement: TypeAlias = tuple[sympy.Matrix, sympy.Matrix]
"""Rotation, shape (3, 3), and position, shape (3, 1)."""

NOWHERE: Placement = (sympy.eye(3), sympy.zeros(3, 1))


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
        placement: In the frame behind the parent.
        axis: Shape (3, 1).
        turning: Whether it turns.
        damping: Viscous damping that the model gives it.
        bodies: What moves with it.
    """

    name: str
    parent: str
    placement: Placement
    axis: sympy.Matrix
    turning: bool
    damping: sympy.Expr
    bodies: tuple[Body, ...] = ()


class LetteredTree(ValueRecord, frozen=True):
    """The joints of a mechanism, each behind its parent, and the joint and placement of every link."""

    joints: tuple[AxialJoint, ...]
    links: Mapping[str, tuple[str, Placement]]


def letter(name: str) -> sympy.Symbol:
    """Return the symbol of a name."""
    return sympy.Symbol(name, real=True)


def exact(value: float) -> sympy.Expr:
    """Return a number as a fraction, or as a fraction of pi, where it is one to rounding."""
    for unit, factor in ((1.0, sympy.Integer(1)), (math.pi, sympy.pi)):
        fraction = sympy.Rational(value / unit).limit_denominator(DENOMINATOR)
        if abs(float(fraction) * unit - value) <= 4e-16 * abs(value):
            return fraction * factor
    return sympy.Float(value, 17)


def lettered_tree(mechanism: Mechanism) -> LetteredTree:
    """Return the tree of a mechanism, of formulas where its model is a xacro file with its own masses alone.

    Raises:
        InputError: A joint has more than one coordinate, or there are more than ``MOST``.
    """
    if len(mechanism.joints) > MOST:
        words = f"equations in letters of {len(mechanism.joints)} joints are too long"
        raise InputError(words, expected=f"at most {MOST}")
    if mechanism.balls or len(mechanism.joints) != mechanism.model.nv:
        raise InputError(
            "equations in letters are written of joints with one coordinate",
            expected="revolute, continuous and prismatic joints",
        )
    with suppress(PinarmError):
        if mechanism.source.robot.suffix == ".xacro" and not mechanism.payloads:
            reader = _UrdfReader(*_traced(mechanism))
            if reader.movable == {*mechanism.joints}:
                return reader.tree(mechanism)
    return _of_numbers(mechanism)


class TracedNumber(Column):
    """A number of an expansion, and the formula that gives it; ``None`` where it is not followed."""

    def __init__(self, rows: Rows, values: Array, formula: sympy.Expr | None) -> None:
        super().__init__(rows, values)
        self.formula = formula


class TracedRows(Rows):
    """The one row of a traced expansion."""

    def applied(self, function: Callable[..., Any], operands: Sequence[Any], name: str = "") -> Any:
        """Return the value of a function, of a float with its formula; see ``Rows``."""
        value, known = super().applied(function, operands, name), FUNCTIONS.get(name.removeprefix("math."))
        if not isinstance(value, Column):
            return value
        terms = [_formula(operand) for operand in operands]
        formula = known(*terms) if known and all(term is not None for term in terms) else None
        return TracedNumber(self, value.values, formula)


def _formula(operand: Any) -> sympy.Expr | None:
    if isinstance(operand, TracedNumber):
        return operand.formula
    return exact(float(operand)) if isinstance(operand, int | float) else None


def _traced(mechanism: Mechanism) -> tuple[str, dict[str, sympy.Expr]]:
    """Return the text of a xacro model with marks for numbers that follow from its arguments, and their formulas."""
    path, rows = mechanism.source.robot, TracedRows(1)
    numbers = {name: value for name, value in mechanism.arguments.items() if isinstance(value, int | float)}
    texts = {name: str(TracedNumber(rows, np.array([float(value)]), letter(name))) for name, value in numbers.items()}
    root = root_of(mechanism.source.folder / "mechanism.yaml")
    with file_root(None, mechanism.source.packages):
        xml = Expander(root, texts, rows).run(contained_file(path.absolute(), root), str(path)).xml
    formulas = {mark: _formula(rows.marked[mark]) for mark in MARKS.findall(xml)}
    values = {mark: exact(float(rows.marked[mark].values[0])) for mark in formulas}
    return xml, {mark: values[mark] if formula is None else formula for mark, formula in formulas.items()}


class _UrdfReader:
    def __init__(self, xml: str, formulas: Mapping[str, sympy.Expr]) -> None:
        root, self.formulas = ElementTree.fromstring(xml), formulas
        self.links = {str(link.get("name")): link for link in root.findall("link")}
        self.elements: list[Any] = root.findall("joint")
        self.movable = {joint.get("name") for joint in self.elements if joint.get("type") in AXIAL}
        self.joints: dict[str, AxialJoint] = {}
        self.places: dict[str, tuple[str, Placement]] = {}

    def tree(self, mechanism: Mechanism) -> LetteredTree:
        (root,) = self.links.keys() - {joint.find("child").get("link") for joint in self.elements}
        self._walk(root, "", NOWHERE)
        ordered = sorted(self.joints.values(), key=lambda joint: mechanism.joints[joint.name].index)
        return LetteredTree(tuple(ordered), self.places)

    def _walk(self, link: str, carrier: str, placement: Placement) -> None:
        """Add a link that is placed behind a joint, and all that hangs on it."""
        self.places[link] = carrier, placement
        if carrier and (inertial := self.links[link].find("inertial")) is not None:
            joint = self.joints[carrier]
            self.joints[carrier] = replace(joint, bodies=(*joint.bodies, self._body(inertial, placement)))
        for joint in self.elements:
            if joint.find("parent").get("link") != link:
                continue
            own, child = self._placed(joint.find("origin"), placement), joint.find("child").get("link")
            if joint.get("type") not in AXIAL:
                self._walk(child, carrier, own)
                continue
            name, axis, dynamics = joint.get("name"), joint.find("axis"), joint.find("dynamics")
            way = self._vector(axis.get("xyz") if axis is not None else None, "1 0 0")
            damping = self._number(dynamics.get("damping", "0")) if dynamics is not None else sympy.Integer(0)
            turning = joint.get("type") != "prismatic"
            self.joints[name] = AxialJoint(name, carrier, own, way / sympy.sqrt(way.dot(way)), turning, damping)
            self._walk(child, name, NOWHERE)

    def _number(self, text: str) -> sympy.Expr:
        formula = self.formulas.get(text.removeprefix("-"))
        if formula is None:
            return exact(float(text))
        return -formula if text[0] == "-" else formula

    def _vector(self, text: str | None, otherwise: str = "0 0 0") -> sympy.Matrix:
        return sympy.Matrix([self._number(word) for word in (text or otherwise).split()])

    def _placed(self, origin: Any, before: Placement) -> Placement:
        if origin is None:
            return before
        roll, pitch, yaw = self._vector(origin.get("rpy"))
        turn = before[0]
        for axis, angle in ((2, yaw), (1, pitch), (0, roll)):
            turn = turn * rotation(sympy.eye(3)[:, axis], angle)
        return turn, before[1] + before[0] * self._vector(origin.get("xyz"))

    def _body(self, inertial: Any, placement: Placement) -> Body:
        turn, centre = self._placed(inertial.find("origin"), placement)
        read = {name: self._number(value) for name, value in inertial.find("inertia").attrib.items()}
        inertia = sympy.Matrix(3, 3, lambda i, j: read.get(f"i{''.join(sorted('xyz'[i] + 'xyz'[j]))}", 0))
        return Body(self._number(inertial.find("mass").get("value")), centre, turn * inertia * turn.T)


def rotation(axis: sympy.Matrix, angle: Any) -> sympy.Matrix:
    """Return the rotation by an angle about a unit vector, shape (3, 3) (Rodrigues)."""
    x, y, z = axis
    cross = sympy.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return sympy.eye(3) + sympy.sin(angle) * cross + (1 - sympy.cos(angle)) * cross * cross


def _of_numbers(mechanism: Mechanism) -> LetteredTree:
    model, joints = mechanism.model, {joint.index: joint for joint in mechanism.joints.values()}
    names = {0: "", **{index: joint.name for index, joint in joints.items()}}
    places = {frame.name: (names[frame.parentJoint], _pose(frame.placement)) for frame in model.frames}
    damping = dict.fromkeys(range(model.nv), 0.0)
    for element in mechanism.forces.values():
        if isinstance(element, SpringDamper) and not element.stiffness.any():
            damping |= dict(zip(element.v.tolist(), element.damping.tolist(), strict=True))
    return LetteredTree(tuple(_axial(model, joints[k], damping[joints[k].v], names) for k in sorted(joints)), places)


def _axial(model: pin.Model, joint: Joint, damping: float, names: Mapping[int, str]) -> AxialJoint:
    kind, inertia = model.joints[joint.index], model.inertias[joint.index]
    data = kind.createData()
    kind.calc(data, pin.neutral(model)[kind.idx_q : kind.idx_q + kind.nq])
    motion = np.asarray(data.S).reshape(6)
    turning, parent = bool(np.any(motion[3:])), names[model.parents[joint.index]]
    body = Body(exact(inertia.mass), _matrix(inertia.lever), _matrix(inertia.inertia))
    axis, place = _matrix(motion[3:] if turning else motion[:3]), _pose(model.jointPlacements[joint.index])
    return AxialJoint(joint.name, parent, place, axis, turning, exact(damping), (body,))


def _pose(placement: pin.SE3) -> Placement:
    return _matrix(placement.rotation), _matrix(placement.translation)


def _matrix(values: Any) -> sympy.Matrix:
    numbers = np.asarray(values, float)
    numbers = np.where(np.abs(numbers) < 1e-15 * np.abs(numbers).max(initial=0.0), 0.0, numbers)
    return sympy.Matrix(np.atleast_2d(numbers.T).T.tolist()).applyfunc(lambda number: exact(float(number)))
