"""Coordinates in letters, and Newton and Euler's equations projected on the joints.

For each joint i, ``sum_b z_i (m (a_b - g)) + w_i (I alpha + omega x I omega)``, z_i and w_i the velocity of the centre
of mass of body b and its angular velocity per unit of the joint's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import sympy

from pinarm.engine.constraints.constraint_rows import Constraint
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import LinearCoordinate, PointCoordinate
from pinarm.mechanics.joints import unit_vector
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import ValueRecord
from pinarm.use.letters.bodies import NOWHERE, AxialJoint, Body, LetteredTree, exact, letter, rotation
from pinarm.use.letters.writing import shortest

POINTS = ("revolute", "spherical", "pin")
"""Kinds of loop joints that hold two points together and whose other rows vanish in a plane."""


class LetteredCoordinate(ValueRecord, frozen=True):
    """A coordinate of a mechanism, with the symbols of its value, its velocity and its acceleration."""

    name: str
    value: sympy.Symbol
    rate: sympy.Symbol
    second: sympy.Symbol


class LetteredCoordinates(ValueRecord, frozen=True):
    """Coordinates that equations are written in.

    Attributes:
        mechanism: The mechanism.
        chosen: As many as joints, and prescribed ones beside them.
        joints: Joint -> its coordinate as a formula of these.
    """

    mechanism: Mechanism
    chosen: tuple[LetteredCoordinate, ...]
    joints: Mapping[str, sympy.Expr]

    def shares(self, name: str) -> dict[str, sympy.Expr]:
        """Return the joints that a coordinate is a sum of, with their weights.

        Raises:
            InputError: It is another coordinate.
        """
        if isinstance(self.mechanism.coordinates.get(name), LinearCoordinate):
            return _weights(self.mechanism, name)
        raise InputError(f"a force along '{name}' is not written in letters", expected="a joint or a sum of joints")

    def rate(self, formula: Any) -> Any:
        """Return the derivative of a formula, or of each entry of a matrix, with respect to time."""
        pairs = [pair for c in self.chosen for pair in ((c.value, c.rate), (c.rate, c.second))]
        first, *others = (formula.diff(known) * rate for known, rate in pairs)
        return sum(others, first)


def named_symbols(mechanism: Mechanism) -> dict[str, str]:
    """Return quantity -> the symbol that the mechanism's file has for it."""
    return {formula.text: name for name, formula in reversed([*mechanism.symbols.items()])}


def lettered_coordinates(mechanism: Mechanism, prescribed: Iterable[str] = ()) -> LetteredCoordinates:
    """Return the coordinates of the joints; a sum of joint coordinates takes the place of the last joint in it."""
    symbols, order, sums = named_symbols(mechanism), [*mechanism.joints], dict[str, str]()
    for name, coordinate in mechanism.coordinates.items():
        if name not in mechanism.joints and isinstance(coordinate, LinearCoordinate) and coordinate.joint is None:
            sums.setdefault(max(_weights(mechanism, name), key=order.index), name)
    joints: dict[str, sympy.Expr] = {}
    chosen: list[LetteredCoordinate] = []
    for name in mechanism.joints:
        total = sums.get(name, name)
        chosen.append(_coordinate(total, "joint" if total == name else "coordinate", symbols))
        value: Any = chosen[-1].value
        if total != name:
            weights = _weights(mechanism, total)
            value = (value - sum(weights[other] * joints[other] for other in weights if other != name)) / weights[name]
        joints[name] = value
    others = (name for name in prescribed if name not in joints and name not in sums.values())
    chosen += [_coordinate(name, "coordinate", symbols) for name in others]
    return LetteredCoordinates(mechanism, tuple(chosen), joints)


def _weights(mechanism: Mechanism, name: str) -> dict[str, sympy.Expr]:
    weights: Sequence[float] = mechanism.coordinates[name].weights.tolist()  # type: ignore[union-attr]
    places = {joint.v: joint.name for joint in mechanism.joints.values()}
    return {places[v]: exact(weight) for v, weight in enumerate(weights) if weight}


def _coordinate(name: str, kind: str, symbols: Mapping[str, str]) -> LetteredCoordinate:
    plain = symbols.get(f"{kind}.{name}.position", re.sub(r"\W", "_", name))
    rate = symbols.get(f"{kind}.{name}.velocity", f"{plain}d")
    second = symbols.get(f"{kind}.{name}.acceleration", f"{plain}dd")
    return LetteredCoordinate(name, *map(letter, (plain, rate, second)))


class Motion(ValueRecord, frozen=True):
    """Placement of the frame behind a joint, and the joints that move the frame.

    Attributes:
        turn: Its rotation before the turns about the axis of the joint and of those before it that are parallel.
        axis: That axis, in the frame, shape (3, 1).
        angle: Sum of these turns.
        origin: Its origin in world axes, shape (3, 1).
        direction: Axis of the joint in world axes, shape (3, 1).
        path: The joints that move it, itself last.
    """

    turn: sympy.Matrix
    axis: sympy.Matrix
    angle: sympy.Expr
    origin: sympy.Matrix
    direction: sympy.Matrix
    path: tuple[str, ...]

    @cached_property
    def rotation(self) -> sympy.Matrix:
        return (self.turn * rotation(self.axis, self.angle)).applyfunc(sympy.sympify)


class LetteredLoop(ValueRecord, frozen=True):
    """A loop joint that holds two points together.

    Attributes:
        name: Its name.
        kept: Components of the gap, in world axes, that are not 0 in all positions.
        gaps: These components.
        forces: Symbols of the components of its force.
        rows: Joint -> velocity of the second point against the first per unit of the joint's, shape (3, 1).
        meaning: What the force is.
    """

    name: str
    kept: Sequence[int]
    gaps: Sequence[sympy.Expr]
    forces: Sequence[sympy.Symbol]
    rows: Mapping[str, sympy.Matrix]
    meaning: str

    def effort(self, joint: str) -> sympy.Expr:
        """Return the effort of its force at a joint."""
        return sympy.Add(*(force * self.rows[joint][k] for k, force in zip(self.kept, self.forces, strict=True)))


class Letters:
    """The symbolic mechanics of one mechanism.

    Args:
        mechanism: The mechanism.
        tree: Its joints and bodies.
        coordinates: What the equations are written in.
        prescribed: Names of coordinates whose symbols take the place of what they measure.
    """

    def __init__(
        self, mechanism: Mechanism, tree: LetteredTree, coordinates: LetteredCoordinates, prescribed: Sequence[str] = ()
    ) -> None:
        self.mechanism, self.tree, self.coordinates = mechanism, tree, coordinates
        self.prescribed = prescribed
        self.motions: dict[str, Motion] = {}
        for joint in tree.joints:
            self.motions[joint.name] = self._moved(joint)

    def _moved(self, joint: AxialJoint) -> Motion:
        before, (turn, place) = self.motions.get(joint.parent), joint.placement
        value = self.coordinates.joints[joint.name]
        outer, shift = (before.rotation, before.origin) if before else NOWHERE
        origin, rotated, path = shift + outer * place, outer * turn, (*(before.path if before else ()), joint.name)
        direction = rotated * joint.axis
        if not joint.turning:
            origin = self._prescribed(joint, origin + direction * value, rotated)
            return Motion(rotated, sympy.Matrix([0, 0, 1]), sympy.Integer(0), origin, direction, path)
        axis, angle = joint.axis, value
        for sense in (1, -1):
            if before and turn == sympy.eye(3) and joint.axis == sense * before.axis:
                rotated, axis, angle = before.turn, before.axis, sympy.expand(before.angle + sense * value)
                direction = rotated * joint.axis
        origin = self._prescribed(joint, origin, rotated * rotation(axis, angle))
        return Motion(rotated, axis, angle, origin, direction, path)

    def _prescribed(self, joint: AxialJoint, origin: sympy.Matrix, turn: sympy.Matrix) -> sympy.Matrix:
        """Return the origin of a frame with the symbols of prescribed coordinates of a point in it."""
        for c in self.coordinates.chosen:
            definition = self.mechanism.description.coordinates.get(c.name) if c.name in self.prescribed else None
            if isinstance(definition, PointCoordinate) and self.tree.links[definition.point][0] == joint.name:
                axis = sympy.Matrix([exact(float(x)) for x in unit_vector(definition.along)])
                point = origin + turn * self.tree.links[definition.point][1][1]
                origin = origin + axis * (c.value - axis.dot(point))
        return origin.applyfunc(sympy.expand)

    def place(self, link: str) -> tuple[sympy.Matrix, tuple[str, ...]]:
        """Return the origin of a link in world axes, shape (3, 1), and the joints that move it."""
        carrier, (_, place) = self.tree.links[link]
        if not carrier:
            return place, ()
        motion = self.motions[carrier]
        return motion.origin + motion.rotation * place, motion.path

    def per_rate(self, joint: str, point: sympy.Matrix) -> sympy.Matrix:
        """Return the velocity of a point beyond a joint per unit of the joint's, shape (3, 1)."""
        motion, turning = self.motions[joint], self._turning[joint]
        return motion.direction.cross(point - motion.origin) if turning else motion.direction

    @cached_property
    def _turning(self) -> dict[str, bool]:
        return {joint.name: joint.turning for joint in self.tree.joints}

    @cached_property
    def _rates(self) -> dict[str, sympy.Expr]:
        return {name: self.coordinates.rate(value) for name, value in self.coordinates.joints.items()}

    @cached_property
    def bodies_moving(self) -> list[tuple[Body, tuple[str, ...], sympy.Matrix, dict[str, sympy.Matrix], sympy.Matrix]]:
        """Bodies, the joints that move each, its centre, and in its frame its spins per joint and angular velocity."""
        moving = []
        for joint in self.tree.joints:
            motion = self.motions[joint.name]
            axes = {name: self.motions[name].direction for name in motion.path if self._turning[name]}
            spins = {name: _reduced(motion.rotation.T * axis) for name, axis in axes.items()}
            omega = sum((spin * self._rates[name] for name, spin in spins.items()), sympy.zeros(3, 1))
            for body in joint.bodies:
                centre = motion.origin + motion.rotation * body.centre
                moving.append((body, motion.path, centre, spins, _reduced(omega)))
        return moving

    def inertial_efforts(self) -> dict[str, sympy.Expr]:
        """Return the inertial and gravity efforts of each joint: ``(M a + nle)_i``."""
        efforts = dict.fromkeys(self.motions, sympy.Integer(0))
        for body, path, centre, spins, omega in self.bodies_moving:
            acceleration = self.coordinates.rate(self.coordinates.rate(centre)) - self._gravity
            moment = body.inertia * self.coordinates.rate(omega) + omega.cross(body.inertia * omega)
            for name in path:
                efforts[name] += body.mass * self.per_rate(name, centre).dot(acceleration)
                efforts[name] += spins[name].dot(moment) if name in spins else 0
        for name, joint in self.mechanism.joints.items():
            armature = float(self.mechanism.model.armature[joint.v])
            efforts[name] += exact(armature) * self.coordinates.rate(self._rates[name]) if armature else 0
        return efforts

    @cached_property
    def _gravity(self) -> sympy.Matrix:
        size, components = self.mechanism.gravity, self.mechanism.model.gravity.linear.tolist()
        return sympy.Matrix([letter("g") * exact(x / size) if size else sympy.Integer(0) for x in components])

    def energy(self) -> tuple[sympy.Expr, sympy.Expr]:
        """Return kinetic and potential energy."""
        kinetic = potential = sympy.Integer(0)
        for body, _, centre, _, omega in self.bodies_moving:
            velocity = self.coordinates.rate(centre)
            kinetic += (body.mass * velocity.dot(velocity) + omega.dot(body.inertia * omega)) / 2
            potential -= body.mass * self._gravity.dot(centre)
        return kinetic, potential

    def loops(self) -> list[LetteredLoop]:
        """Return the loops.

        Raises:
            InputError: One is of another kind than ``POINTS``.
        """
        return [self._loop(loop) for loop in self.mechanism.constraints]

    def _loop(self, loop: Constraint) -> LetteredLoop:
        if not isinstance(loop, LoopJoint) or loop.kind not in POINTS:
            expected = f"open chains, and loops of the kinds {', '.join(POINTS)}"
            raise InputError(f"'{loop.name}' is not written in letters", expected=expected)
        names = [self.mechanism.model.frames[frame].name for frame in (loop.first, loop.second)]
        (first, before), (second, behind) = map(self.place, names)
        gap, symbols = (second - first).applyfunc(shortest), named_symbols(self.mechanism)
        kept = [k for k in range(3) if gap[k] != 0]
        plain = [symbols.get(f"loop.{loop.name}.force.{'xyz'[k]}", f"{'XYZ'[k]}_{loop.name}") for k in kept]
        rows = {name: sympy.zeros(3, 1) for name in self.motions}
        for sense, point, path in ((-1, first, before), (1, second, behind)):
            for name in path:
                rows[name] += sense * self.per_rate(name, point)
        meaning = f"force of {names[0]} on {names[1]} in the loop {loop.name}"
        return LetteredLoop(loop.name, kept, [gap[k] for k in kept], [letter(name) for name in plain], rows, meaning)


def _reduced(vector: sympy.Matrix) -> sympy.Matrix:
    return vector.applyfunc(lambda entry: sympy.trigsimp(sympy.expand(entry)))
