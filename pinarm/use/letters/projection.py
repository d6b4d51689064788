"""Coordinates in letters, and Newton and Euler's equations projected on the joints.

For each joint i, ``sum_b z_i (m (a_b - g)) + w_i (I alpha + omega x I omega)``, z_i and w_i the velocity of the centre
of mass of body b and its angular velocity per unit of the joint's.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, TypeAlias

import sympy
from msgspec.structs import replace
from sympy.simplify.fu import TR8, TR9, TR10i

from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import Constraint, LinearCoordinate, PointCoordinate
from pinarm.mechanics.forces.along_coordinate import CoordinateEffort, CoordinateSpring, JointEffort, JointSpring
from pinarm.mechanics.forces.joint_forces import SpringDamper
from pinarm.mechanics.forces.points import Wrench
from pinarm.mechanics.joints import unit_vector
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import ValueRecord
from pinarm.use.letters.bodies import NOWHERE, AxialJoint, Body, LetteredTree, exact, letter, rotation

LARGEST = 24
"""Largest denominator of a fraction that is printed as one; others are printed as decimals."""


def shortest(formula: sympy.Expr) -> sympy.Expr:
    """Return the shortest of some ways to write a formula."""
    plain = sympy.expand(formula)
    if not plain.free_symbols:
        return plain
    reduced = _by_parameters(plain)
    ways = [plain, reduced, sympy.expand(TR8(plain)), TR10i(plain)]
    ways += [sympy.factor_terms(way) for way in ways] + [sympy.factor(reduced)]
    return min(ways, key=_length)


def _by_parameters(plain: sympy.Expr) -> sympy.Expr:
    """Return an expanded formula with the functions of angles that lengths and masses multiply as simplified sums."""
    parts = defaultdict[sympy.Expr, list[sympy.Expr]](list)
    for term in sympy.Add.make_args(plain):
        factor, angular = term.as_independent(sympy.sin, sympy.cos, sympy.tan, as_Add=False)
        number, parameters = factor.as_coeff_Mul()
        parts[parameters].append(number * angular)
    sums = {parameters: sympy.trigsimp(sympy.Add(*terms)) for parameters, terms in parts.items()}
    return sympy.Add(*(parameters * min(TR9(angular), angular, key=_length) for parameters, angular in sums.items()))


def _length(formula: sympy.Expr) -> tuple[int, int]:
    return formula.count_ops(), len(str(formula))


def compact(formula: sympy.Expr, seconds: Sequence[sympy.Symbol], rates: Sequence[sympy.Symbol]) -> sympy.Expr:
    """Return a formula that is linear in accelerations as a sum by these, products of velocities and the rest."""
    plain = sympy.expand(formula)
    terms = []
    for second in seconds:
        terms.append(shortest(plain.coeff(second, 1)) * second)
        plain = plain.coeff(second, 0)
    products = sympy.Poly(plain, *rates).terms() if rates else [((), plain)]
    for powers, coefficient in products:
        product = sympy.Mul(*(rate**power for rate, power in zip(rates, powers, strict=True)))
        terms.append(shortest(coefficient) * product)
    whole = sympy.Add(*terms)
    return min((whole, shortest(whole)), key=lambda way: way.count_ops())


def decimals(formula: sympy.Expr) -> sympy.Expr:
    """Return a formula whose fractions with large denominators are decimals."""
    long = {number: sympy.Float(number, 15) for number in formula.atoms(sympy.Rational) if number.q > LARGEST}
    return formula.xreplace(long)


def written(formula: sympy.Expr) -> str:
    """Return a formula as text that formulas of files can take."""
    return str(sympy.sstr(decimals(formula), full_prec=False))


Dots: TypeAlias = Mapping[sympy.Symbol, tuple[sympy.Symbol, str]]
"""Symbol of a velocity or an acceleration -> that of the position, and ``dot`` or ``ddot``."""

ACCENTS = {"dot": "\u02d9", "ddot": "\u00a8"}


def latex(formula: sympy.Expr, dots: Dots) -> str:
    """Return a formula in LaTeX, velocities and accelerations with dots."""
    names = {symbol: rf"\{mark}{{{sympy.latex(value)}}}" for symbol, (value, mark) in dots.items()}
    return str(sympy.latex(decimals(formula), symbol_names=names))


def mathml(formula: sympy.Expr, dots: Dots) -> str:
    """Return a formula in MathML, an element for each term: lines of a page break between them."""
    marks = {sympy.Symbol("DOTTED" + chr(ord("A") + k)): place for k, place in enumerate(dots.items())}
    placed = decimals(formula).xreplace({symbol: mark for mark, (symbol, _) in marks.items()})
    page = " ".join(_term(term, first=not k) for k, term in enumerate(placed.as_ordered_terms()))
    for mark, (_, (value, accent)) in marks.items():
        dotted = f'{_presentation(value)}<mstyle scriptlevel="0"><mtext>{ACCENTS[accent]}</mtext></mstyle>'
        page = page.replace(f"<mi>{mark}</mi>", f"<mover>{dotted}</mover>")
    return page


def _term(term: sympy.Expr, *, first: bool) -> str:
    minus = bool(term.could_extract_minus_sign())
    sign = "\u2212" if minus else "" if first else "+"
    content = _presentation(-term if minus else term)
    drawn = f"<mo>{sign}</mo><mtext>&#8201;</mtext>{content}" if sign else content
    return f'<math displaystyle="true">{drawn}</math>'


def _presentation(formula: sympy.Expr) -> str:
    from sympy.printing.mathml import mathml as printed

    return str(printed(formula, printer="presentation")).replace("<mo>&InvisibleTimes;</mo>", "<mtext>&#8201;</mtext>")


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


ONE = Constant(value=1.0)
"""The law of a load in the proof of its equations."""


class LetteredForce(ValueRecord, frozen=True):
    """A force in letters.

    Attributes:
        definition: What a file says of it, with the law ``ONE``.
        efforts: Joint -> its effort there.
        symbols: Symbol -> what it stands for, and its number; of a load as long as its law is 1.
    """

    definition: Any
    efforts: Mapping[str, sympy.Expr]
    symbols: Mapping[str, tuple[str, float]]


def lettered_forces(letters: Letters, loads: Mapping[str, Any]) -> list[LetteredForce]:
    """Return the forces of a mechanism, and loads beside them.

    Raises:
        InputError: A force is of a kind that is not written in letters.
    """
    mechanism = letters.mechanism
    forces = {**mechanism.description.forces, **loads}
    for name, element in mechanism.forces.items():
        if name not in forces and not (isinstance(element, SpringDamper) and not element.stiffness.any()):
            raise _unknown(name)
    if mechanism.frictions:
        raise _unknown("dry friction")
    return [_lettered(letters, name, force) for name, force in forces.items()]


def _unknown(name: str) -> InputError:
    expected = "springs and efforts of joints and of sums of joints, and forces along axes of the world"
    return InputError(f"the force '{name}' is not written in letters", expected=expected)


def joint_damping(letters: Letters) -> Mapping[str, sympy.Expr]:
    """Return the efforts of the damping that the model gives to joints."""
    rate = letters.coordinates.rate
    return {joint.name: -joint.damping * rate(letters.coordinates.joints[joint.name]) for joint in letters.tree.joints}


def _lettered(letters: Letters, name: str, force: Any) -> LetteredForce:
    match force:
        case JointSpring(joint=along) | CoordinateSpring(coordinate=along):
            return _spring(letters, name, force, along)
        case JointEffort(joint=along) | CoordinateEffort(coordinate=along):
            efforts = {joint: share * letter(name) for joint, share in letters.coordinates.shares(along).items()}
            acting = replace(force, effort=ONE, over=None, period=None, while_={}, start=None, end=None)
            return LetteredForce(acting, efforts, {name: (f"effort of the load {name} along {along}", 1.0)})
        case Wrench(axes="world") if not any(force.moment):
            return _force(letters, name, force)
    raise _unknown(name)


def _spring(letters: Letters, name: str, force: JointSpring | CoordinateSpring, along: str) -> LetteredForce:
    shares = letters.coordinates.shares(along)
    value = sum(share * letters.coordinates.joints[joint] for joint, share in shares.items())
    terms = (
        ("k", "stiffness", force.stiffness, value - exact(float(force.rest))),
        ("c", "damping", force.damping, letters.coordinates.rate(value)),
    )
    kept = [(f"{sign}_{name}", word, float(number), factor) for sign, word, number, factor in terms if number]
    pull = sympy.Add(*(letter(symbol) * factor for symbol, _, _, factor in kept))
    symbols = {symbol: (f"{word} of {name}", number) for symbol, word, number, _ in kept}
    return LetteredForce(force, {joint: -share * pull for joint, share in shares.items()}, symbols)


def _force(letters: Letters, name: str, force: Wrench) -> LetteredForce:
    point, path = letters.place(force.point)
    vector, symbols = sympy.zeros(3, 1), dict[str, tuple[str, float]]()
    for k, component in enumerate(force.force):
        if component:
            symbol = f"{name}_{'xyz'[k]}"
            vector[k] = letter(symbol)
            symbols[symbol] = f"component {'xyz'[k]} of the load {name} at {force.point}", float(component)
    efforts = {joint: letters.per_rate(joint, point).dot(vector) for joint in path}
    return LetteredForce(replace(force, factor=ONE), efforts, symbols)
