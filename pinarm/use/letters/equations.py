"""Equations of motion and of closure in letters, as a person would write them.

They are compared with the numeric equations at random states before anybody reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
import sympy

from pinarm.arrays import Array
from pinarm.engine.kinematics.assembly import closed_generic
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import DynamicsError, InputError
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.laws import Constant, ConstantSpeed
from pinarm.records import Record, ValueRecord
from pinarm.use.letters.bodies import exact, letter, lettered_tree
from pinarm.use.letters.projection import (
    LetteredCoordinates,
    LetteredForce,
    LetteredLoop,
    Letters,
    compact,
    joint_damping,
    latex,
    lettered_coordinates,
    lettered_forces,
    mathml,
    named_symbols,
    shortest,
    written,
)

if TYPE_CHECKING:
    from pinarm.use.facade import Scenario

AT_REST = ("statics", "equilibria")
"""Kinds of problems in which nothing moves."""


class Equation(ValueRecord, frozen=True):
    """An equation ``left = right``, and what it is of."""

    left: sympy.Expr
    right: sympy.Expr
    of: str


class Equations(Record, frozen=True):
    """Equations of a mechanism in letters.

    Attributes:
        title: Of which mechanism.
        symbols: What symbols stand for.
        closure: What closes the loops.
        motion: An equation for each joint or coordinate.
        momenta: Momenta that stay as they are.
        dots: Symbol of a velocity or an acceleration -> that of the position, and ``dot`` or ``ddot``.
        difference: Largest difference from the numeric equations, relative to the largest term.
    """

    title: str
    symbols: Mapping[str, str]
    closure: tuple[Equation, ...]
    motion: tuple[Equation, ...]
    momenta: tuple[Equation, ...]
    dots: Mapping[sympy.Symbol, tuple[sympy.Symbol, str]]
    difference: float

    def __str__(self) -> str:
        width = max(map(len, self.symbols), default=0)
        lines = [f"Equations of {self.title}", *(f"  {name:{width}}  {words}" for name, words in self.symbols.items())]
        for heading, equations in self.parts():
            lines += [heading, *(f"  {e.of}:  {written(e.left)} = {written(e.right)}" for e in equations)]
        lines.append(f"at {STATES} random states they differ from the numeric ones by {self.difference:.1e}")
        return "\n".join(lines)

    def _repr_latex_(self) -> str:
        rows = [f"{latex(e.left, self.dots)} &= {latex(e.right, self.dots)}" for _, some in self.parts() for e in some]
        return r"$\begin{aligned}" + r"\\ ".join(rows) + r"\end{aligned}$"

    def summary(self) -> dict[str, Any]:
        """Return them as plain data."""
        parts = {heading: [[e.of, written(e.left), written(e.right)] for e in some] for heading, some in self.parts()}
        return {"title": self.title, "symbols": dict(self.symbols), **parts, "difference": self.difference}

    def mathml(self, equation: Equation) -> str:
        """Return an equation for pages, in MathML whose lines break between terms."""
        return f"{mathml(equation.left, self.dots)} <math><mo>=</mo></math> {mathml(equation.right, self.dots)}"

    def parts(self) -> list[tuple[str, tuple[Equation, ...]]]:
        """Return headings with the equations below them."""
        parts = (("closure", self.closure), ("motion", self.motion), ("constant momenta", self.momenta))
        return [(heading, equations) for heading, equations in parts if equations]


class Question(ValueRecord, frozen=True):
    """Conditions of a scenario on the motion.

    Attributes:
        prescribed: Coordinates that laws prescribe.
        constant: Coordinate -> value and rate where a law keeps the rate constant; the value is ``None`` if it varies.
        driven: Joints that may carry an effort; ``None`` for all.
        at_rest: Whether nothing moves.
        loads: Forces beside those of the mechanism.
    """

    prescribed: tuple[str, ...] = ()
    constant: Mapping[str, tuple[float | None, float]] = {}
    driven: frozenset[str] | None = None
    at_rest: bool = False
    loads: Mapping[str, Any] = {}

    @classmethod
    def of(cls, scenario: Scenario) -> Question:
        problem: Any = scenario.problem
        laws, mechanism = getattr(problem, "motion", None) or {}, scenario.mechanism
        row = problem.schema_row(mechanism)
        for name in row.drives:
            if not isinstance(mechanism.coordinates[name], LinearCoordinate):
                raise InputError(f"the drive along '{name}' is not written in letters", expected="drives of joints")
        flags = None if row.driven is None else row.driven.tolist()
        driven = None if flags is None else frozenset(n for n, joint in mechanism.joints.items() if flags[joint.v])
        constant: dict[str, tuple[float | None, float]] = {}
        for name, law in laws.items():
            if isinstance(law, Constant | ConstantSpeed):
                constant[name] = (law.value, 0.0) if isinstance(law, Constant) else (None, float(law.speed))
        return cls(tuple(laws), constant, driven, problem.kind in AT_REST, getattr(problem, "loads", {}))

    def known(self, coordinates: LetteredCoordinates) -> dict[sympy.Symbol, sympy.Expr]:
        """Return symbols that are 0: of values, velocities and accelerations."""
        zeros: list[sympy.Symbol] = []
        for c in coordinates.chosen:
            value, rate = self.constant.get(c.name, (None, None))
            zeros += [c.value] if value == 0.0 else []
            zeros += [c.rate] if rate == 0.0 or self.at_rest else []
            zeros += [c.second] if rate is not None or self.at_rest else []
        return dict.fromkeys(zeros, sympy.Integer(0))


def equations_of(mechanism: Mechanism, question: Question, small: Mapping[str, float] | None = None) -> Equations:
    """Return the equations of a mechanism under what a scenario says.

    Args:
        mechanism: The mechanism.
        question: What the scenario says.
        small: Coordinate -> value [rad or m] about which the equations are linear, 0 for those left out; ``None`` for
            equations that are not linear.

    Raises:
        InputError: Something of the mechanism is not written in letters.
        DynamicsError: The equations differ from the numeric ones.
    """
    coordinates = lettered_coordinates(mechanism, question.prescribed)
    letters = Letters(mechanism, lettered_tree(mechanism), coordinates, question.prescribed)
    forces, loops = lettered_forces(letters, question.loads), letters.loops()
    needed = letters.inertial_efforts()
    for efforts in (joint_damping(letters), *(force.efforts for force in forces)):
        needed |= {joint: needed[joint] - effort for joint, effort in efforts.items()}
    proof = _Proof(letters, forces)
    difference = proof.efforts(needed)
    proof.loops(loops)
    form, zero = _Form(letters, question, small), sympy.Integer(0)
    closure = tuple(Equation(zero, form.reduced(gap), f"loop {loop.name}") for loop in loops for gap in loop.gaps)
    motion = form.motion({name: needed[name] - sum(loop.effort(name) for loop in loops) for name in needed})
    damped = any(joint.damping != 0 for joint in letters.tree.joints)
    momenta = form.momenta() if not (forces or loops or damped or small is not None) else ()
    meanings, dots = _meanings(letters, forces, loops), _dots(coordinates)
    return Equations(mechanism.title, meanings, closure, motion, momenta, dots, difference)


class _Form:
    """Form of the equations under the conditions of a scenario; ``small`` are values about which they are linear."""

    def __init__(self, letters: Letters, question: Question, small: Mapping[str, float] | None) -> None:
        self.letters, self.question, self.small = letters, question, small
        self.coordinates = letters.coordinates
        self.zeros = question.known(self.coordinates)

    def reduced(self, formula: sympy.Expr) -> sympy.Expr:
        """Return a formula without what is 0, linear in deviations where that is asked for."""
        return shortest(self._plain(formula))

    def _plain(self, formula: sympy.Expr) -> sympy.Expr:
        plain = sympy.sympify(formula).subs(self.zeros)
        if self.small is None:
            return plain
        size, values = sympy.Symbol("size"), {}
        for c in self.coordinates.chosen:
            values[c.value] = exact(self.small.get(c.name, 0.0)) + size * c.value
            values |= {c.rate: size * c.rate, c.second: size * c.second}
        moved = plain.subs(values, simultaneous=True)
        return moved.subs(size, 0) + moved.diff(size).subs(size, 0)

    def motion(self, needed: Mapping[str, sympy.Expr]) -> tuple[Equation, ...]:
        """Return the equation of each coordinate: of its joint, or along it where no other effort is in it."""
        efforts, equations = {name: self._effort(name) for name in needed}, []
        for c, name in zip(self.coordinates.chosen, self.letters.motions, strict=False):
            shares = {joint: value.diff(c.value) for joint, value in self.coordinates.joints.items()}
            if any(efforts[joint] != 0 for joint, share in shares.items() if share and joint != name):
                shares = {name: sympy.Integer(1)}
            left, right = (
                sympy.Add(*(share * terms[joint] for joint, share in shares.items())) for terms in (efforts, needed)
            )
            equations.append(Equation(left, self._by_rates(right), c.name if len(shares) > 1 else name))
        return tuple(equations)

    def _by_rates(self, formula: sympy.Expr) -> sympy.Expr:
        chosen, plain = self.coordinates.chosen, self._plain(formula)
        deviations = () if self.small is None else (c.value for c in chosen)
        short = compact(plain, [c.second for c in chosen], [*(c.rate for c in chosen), *deviations])
        _require_same(plain, short)
        return short

    def _effort(self, joint: str) -> sympy.Expr:
        """Return the symbol of the effort at a joint, 0 where nothing drives it."""
        if self.question.driven is not None and joint not in self.question.driven:
            return sympy.Integer(0)
        return letter(named_symbols(self.letters.mechanism).get(f"joint.{joint}.effort", f"tau_{joint}"))

    def momenta(self) -> tuple[Equation, ...]:
        """Return momenta of coordinates on which the energy does not depend, where nothing drives the mechanism."""
        if self.question.driven is None or self.question.driven:
            return ()
        kinetic, potential = self.letters.energy()
        equations, rates = [], [c.rate for c in self.coordinates.chosen]
        for c in self.coordinates.chosen:
            if not sympy.trigsimp(sympy.expand((kinetic - potential).diff(c.value))):
                momentum = compact(kinetic.diff(c.rate), rates, [])
                equations.append(Equation(letter(f"p_{c.value}"), momentum, c.name))
        return tuple(equations)


STATES, AGREED = 5, 1e-12
"""Random states at which equations are compared, and the difference that is rounding, relative to the largest term."""

SAME_ROWS = 1e-9
"""Singular value of rows in letters beside the numeric ones, relative to the largest, that is 0."""


def _require_same(plain: sympy.Expr, short: sympy.Expr) -> None:
    """Compare a formula with a shorter one at a random value of each symbol."""
    terms = sympy.Add.make_args(sympy.expand(plain))
    symbols = sorted(plain.free_symbols | short.free_symbols, key=str)
    values = np.random.default_rng(1).uniform(0.5, 1.5, len(symbols))
    value, *sizes = sympy.lambdify(symbols, [short, *terms])(*values)
    if not abs(value - sum(sizes)) <= AGREED * (abs(value) + sum(map(abs, sizes))):
        raise DynamicsError("a shortened equation differs from what it was")


class _Proof:
    def __init__(self, letters: Letters, forces: Sequence[LetteredForce]) -> None:
        self.letters, self.mechanism = letters, letters.mechanism
        self.numbers = {letter(name): value for name, value in self.mechanism.arguments.items()}
        self.numbers[letter("g")] = self.mechanism.gravity
        for force in forces:
            self.numbers |= {letter(symbol): number for symbol, (_, number) in force.symbols.items()}
        self.order = [self.mechanism.joints[name].v for name in letters.motions]
        model, known = self.mechanism, self.mechanism.description.forces
        self.elements = [element for name, element in model.forces.items() if name not in known]
        self.elements += [f.definition.bind(model.model, model.joints, model.coordinates) for f in forces]

    def efforts(self, needed: Mapping[str, sympy.Expr]) -> float:
        """Return the largest difference of efforts from Pinocchio's RNEA and the forces, relative to the largest terms.

        Args:
            needed: Joint -> the effort that is needed there, without the forces of loops.

        Raises:
            DynamicsError: The difference exceeds rounding.
            InputError: All terms are 0.
        """
        function, random, worst = self._function([*needed.values()]), np.random.default_rng(0), 0.0
        model = self.mechanism.model
        for _ in range(STATES):
            q = pin.integrate(model, pin.neutral(model), random.normal(size=model.nv))
            v, a = random.normal(size=(2, model.nv))
            inertial, load = pin.rnea(model, model.createData(), q, v, a), np.zeros(model.nv)
            for element in self.elements:
                element.on(0.0, 1.0).add_load(0.5, q, v, load)
            masses = np.abs(pin.crba(model, model.createData(), q)).max()
            scale = np.abs(inertial).max() + np.abs(load).max() + masses
            if not scale:
                words = "no body has a mass here: equations have nothing to be compared with"
                raise InputError(words, expected="other masses than 0")
            difference = np.array(function(q, v, a), float) - (inertial - load)[self.order]
            worst = max(worst, float(np.abs(difference).max() / scale))
        if not worst <= AGREED:
            raise DynamicsError(f"the equations in letters differ from the numeric ones by {worst:.1e}")
        return worst

    def loops(self, loops: Sequence[LetteredLoop]) -> None:
        """Check that loops close, and bind velocities, as the numeric ones in a closed position.

        Raises:
            DynamicsError: They do not.
        """
        if not loops:
            return
        model = self.mechanism.model
        q, still = closed_generic(self.mechanism, {}), np.zeros(model.nv)
        rows = self.mechanism.closure.rows(Kinematics.at(model, q))
        gaps = [gap for loop in loops for gap in loop.gaps]
        ways = [[loop.rows[name][k] for name in self.letters.motions] for loop in loops for k in loop.kept]
        opening, ways = self._function([gaps, ways])(q, still, still)
        own = np.zeros((len(gaps), model.nv))
        own[:, self.order] = ways
        small = SAME_ROWS * max(1.0, np.abs(rows).max())
        own_rank, rank, both = (np.linalg.matrix_rank(some, small) for some in (own, rows, np.vstack([own, rows])))
        if np.abs(opening).max() > small or not own_rank == rank == both:
            raise DynamicsError("the closure in letters differs from the numeric one")

    def _function(self, formulas: list[Any]) -> Callable[[Array, Array, Array], Any]:
        """Return the function of states q, v and a that evaluates formulas."""
        chosen = self.letters.coordinates.chosen
        moving = [symbol for c in chosen for symbol in (c.value, c.rate, c.second)]
        function = sympy.lambdify([*self.numbers, *moving], formulas, "numpy", cse=True)

        def evaluate(q: Array, v: Array, a: Array) -> Any:
            state = Kinematics.at(self.mechanism.model, q, v)
            measured = [self.mechanism.coordinate(c.name) for c in chosen]
            rates = [(w.value(state), w.row(state) @ v, w.row(state) @ a + w.drift(state)) for w in measured]
            return function(*self.numbers.values(), *(float(number) for some in rates for number in some))

        return evaluate


def _meanings(letters: Letters, forces: Sequence[LetteredForce], loops: Sequence[LetteredLoop]) -> dict[str, str]:
    meanings: dict[str, str] = {}
    for c in letters.coordinates.chosen:
        kind = "joint" if c.name in letters.mechanism.joints else "coordinate"
        meanings[str(c.value)] = f"{kind} {c.name}; velocity {c.rate}, acceleration {c.second}"
    for force in forces:
        meanings |= {symbol: words for symbol, (words, _) in force.symbols.items()}
    return meanings | {str(force): loop.meaning for loop in loops for force in loop.forces}


def _dots(coordinates: LetteredCoordinates) -> dict[sympy.Symbol, tuple[sympy.Symbol, str]]:
    dots: dict[sympy.Symbol, tuple[sympy.Symbol, str]] = {}
    for c in coordinates.chosen:
        dots |= {c.rate: (c.value, "dot"), c.second: (c.value, "ddot")}
    return dots
