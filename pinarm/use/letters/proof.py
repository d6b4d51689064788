"""Equations in letters, evaluated at random states and compared with the numeric ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin
import sympy

from pinarm.arrays import Array
from pinarm.engine.kinematics.assembly import closed_generic
from pinarm.errors import DynamicsError, InputError
from pinarm.mechanics.forces.kinds import bound
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.use.letters.forces import LetteredForce
from pinarm.use.letters.projection import LetteredLoop, Letters
from pinarm.use.letters.traced_model import letter

STATES, AGREED = 5, 1e-12
"""Random states at which equations are compared, and the difference that is rounding, relative to the largest term."""

SAME_ROWS = 1e-9
"""Singular value of rows in letters beside the numeric ones, relative to the largest, that is 0."""


def require_same(plain: sympy.Expr, short: sympy.Expr) -> None:
    """Compare a formula with a shorter one at a random value of each symbol.

    Raises:
        DynamicsError: They differ by more than rounding of the terms.
    """
    terms = sympy.Add.make_args(sympy.expand(plain))
    symbols = sorted(plain.free_symbols | short.free_symbols, key=str)
    values = np.random.default_rng(1).uniform(0.5, 1.5, len(symbols))
    value, *sizes = sympy.lambdify(symbols, [short, *terms])(*values)
    if not abs(value - sum(sizes)) <= AGREED * (abs(value) + sum(map(abs, sizes))):
        raise DynamicsError("a shortened equation differs from what it was")


class Proof:
    """The numbers behind the symbols of one mechanism.

    Args:
        letters: Its symbolic mechanics.
        forces: Its forces.
    """

    def __init__(self, letters: Letters, forces: Sequence[LetteredForce]) -> None:
        self.letters, self.forces, self.mechanism = letters, forces, letters.mechanism
        self.numbers = {letter(name): value for name, value in self.mechanism.arguments.items()}
        self.numbers[letter("g")] = self.mechanism.gravity
        for force in forces:
            self.numbers |= {letter(symbol): number for symbol, (_, number) in force.symbols.items()}
        chosen = letters.coordinates.chosen
        self.moving = [symbol for c in chosen for symbol in (c.value, c.rate, c.second)]
        self.order = [self.mechanism.joints[name].v for name in letters.motions]

    def efforts(self, needed: Mapping[str, sympy.Expr]) -> float:
        """Return the largest difference of efforts from Pinocchio's RNEA and the forces, relative to the largest terms.

        Args:
            needed: Joint -> the effort that is needed there, without the forces of loops.

        Raises:
            DynamicsError: The difference exceeds rounding.
            InputError: All terms are 0.
        """
        function = sympy.lambdify([*self.numbers, *self.moving], [*needed.values()], "numpy", cse=True)
        random, model, worst = np.random.default_rng(0), self.mechanism.model, 0.0
        for _ in range(STATES):
            q = pin.integrate(model, pin.neutral(model), random.normal(size=model.nv))
            v, a = random.normal(size=(2, model.nv))
            inertial, load = pin.rnea(model, model.createData(), q, v, a), self._load(q, v)
            masses = np.abs(pin.crba(model, model.createData(), q)).max()
            scale = np.abs(inertial).max() + np.abs(load).max() + masses
            if not scale:
                raise InputError("no body has a mass here: equations have nothing to be compared with",
                                 expected="other masses than 0")  # fmt: skip
            values = function(*self.numbers.values(), *self._moving(q, v, a))
            difference = np.array(values, float) - (inertial - load)[self.order]
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
        function = sympy.lambdify([*self.numbers, *self.moving], [gaps, ways], "numpy", cse=True)
        opening, ways = function(*self.numbers.values(), *self._moving(q, still, still))
        own = np.zeros((len(gaps), model.nv))
        own[:, self.order] = ways
        small = SAME_ROWS * max(1.0, np.abs(rows).max())
        own_rank, rank, both = (np.linalg.matrix_rank(some, small) for some in (own, rows, np.vstack([own, rows])))
        if np.abs(opening).max() > small or not own_rank == rank == both:
            raise DynamicsError("the closure in letters differs from the numeric one")

    def _load(self, q: Array, v: Array) -> Array:
        mechanism, load = self.mechanism, np.zeros(self.mechanism.model.nv)
        elements = [element for name, element in mechanism.forces.items() if name not in mechanism.description.forces]
        for force in self.forces:
            elements.append(bound(force.definition, mechanism.model, mechanism.joints, mechanism.coordinates))
        for element in elements:
            element.on(0.0, 1.0).add_load(0.5, q, v, load)
        return load

    def _moving(self, q: Array, v: Array, a: Array) -> list[float]:
        state = Kinematics.at(self.mechanism.model, q, v)
        measured = [self.mechanism.coordinate(c.name) for c in self.letters.coordinates.chosen]
        rates = [(w.value(state), w.row(state) @ v, w.row(state) @ a + w.drift(state)) for w in measured]
        return [float(number) for some in rates for number in some]
