"""Equilibria: the configurations at which weights and loads balance without any drive, and whether they are stable."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, ClassVar

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.assembly import Imposed, start_configuration
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.reduction import Reduction
from pinarm.engine.trajectory import Trajectory
from pinarm.errors import AssemblyError, InputError, Key
from pinarm.input.schema import Level, Model
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import METRE, LinearCoordinate
from pinarm.mechanics.forces import Force, ForceElement
from pinarm.mechanics.forces.joint import effort_unit
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.motion import Grid
from pinarm.problems.common import Accuracy, Place, bind_loads, check_levels, check_motion

BALANCED = 1e-13
"""Largest generalised force left, relative to the terms that make it up; Newton's method ends near 1e-16."""

ZERO = 1e-9
"""Stiffness, relative to the terms that make it up, below which it is 0: differences of loads leave up to 1e-12."""

MASSLESS = 1e-12
"""Smallest eigenvalue of M, scaled to a diagonal of ones, that is told from 0."""

SAME, SAME_FLAT = 1e-8, 1e-4
"""Distance below which two configurations are one, relative to ``1 + |q|`` [rad or m]: usually, and where a stiffness
of 0 leaves Newton's method with the cube root of ``BALANCED``."""

STRIDE, PUSH, ITERATIONS = 0.5, 0.1, 100
"""Largest turn of a joint in one step [rad]; how far a stationary start is moved [rad or m]; steps at most."""

STEP, LEVELS, ORDERS = 0.1237, 14, 5
"""Differences of loads: largest step [rad or m], no round number so that it hits no special position; how often it is
halved; columns of the extrapolation, up to order 10."""


class Equilibria(Model, frozen=True, tag_field="kind", tag="equilibria"):
    """Configurations at rest at which the generalised force of weights and loads vanishes; drives give none.

    With the potential energy U the force is ``f = -dU/dq``, the stiffness ``K = -df/dq``, and small motions about an
    equilibrium are those of ``M x'' + K x = 0``: stable if every ``w^2`` of ``K x = w^2 M x`` is positive, unstable if
    one is negative (or, under loads without a potential, not real), indifferent if one is 0 to rounding. Damping and
    friction have no part in it. In directions without mass there is no ``w^2``: the eigenvalues of K itself decide.

    Every start leads to the equilibrium that damped Newton steps reach; several may lead to one. It is meant for starts
    within about 0.5 rad of what is looked for, and finds unstable equilibria as well as stable ones.

    Attributes:
        starts: Rough joint coordinates, one map for each start; what is not given is 0. Where they contradict what is
            held the nearest configuration is taken that does not.
        hold: Coordinate -> value, for joint coordinates, or sums of them, that drives hold.
        loads: Applied constant forces and springs of this run.
    """

    kind: ClassVar[str] = "equilibria"
    starts: Annotated[list[dict[str, Level]], msgspec.Meta(min_length=1)]
    hold: dict[str, Level] = {}
    loads: dict[str, Force] = {}

    def parameter(self, mechanism: Mechanism) -> tuple[str, Unit]:
        """Return the name and unit of what runs along the rows."""
        return "row", unit("1")

    def prepare(self, mechanism: Mechanism, place: Place) -> tuple[Balance, list[Array]]:
        """Check all names and units; return the balance of forces, and the configuration of every start."""
        if len(mechanism.joints) < mechanism.model.nv:
            raise InputError("equilibria are found for joints with one coordinate only; this model has others")
        if mechanism.constraints:
            raise InputError("equilibria are found for open chains only; this mechanism has loops or couplings",
                             hint="kind: forward with damping, or kind: statics over a coordinate")  # fmt: skip
        held = {name: Constant(value=value) for name, value in self.hold.items()}
        check_motion(mechanism, held, lambda _, name: place("hold", name))
        with place("hold"):
            balance = Balance.of(mechanism, _constant(bind_loads(mechanism, self.loads, place), place), held)
        for index, start in enumerate(self.starts):
            check_levels(mechanism, start, partial(place, "starts", index))
            for name in start:
                if name in held:
                    with place("starts", index, Key(name)):
                        raise InputError(f"'{name}' is held", expected="starting values of the other joints")
        return balance, [balance.nearest(start_configuration(mechanism, start)) for start in self.starts]

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the equilibria, one a row in the order in which they are found.

        ``figures`` says how many there are and how many of them stable, and of each: how many starts led to it, its
        stability (1 stable, 0 indifferent, -1 unstable), and its ``w^2`` [rad^2/s^2] in ascending order.

        Raises:
            AssemblyError: A start leads to none; ``partial`` holds what the starts before it led to.
        """
        balance, starts = self.prepare(mechanism, place)
        found: list[Equilibrium] = []
        for index, q in enumerate(starts):
            with place("starts", index):
                try:
                    _merge(found, balance.equilibrium(q, f"starts[{index}]"), balance.turns)
                except AssemblyError as error:
                    error.partial = balance.trajectory(found) if found else None
                    raise
        return balance.trajectory(found)


def _constant(forces: dict[str, ForceElement], place: Place) -> dict[str, ForceElement]:
    for law in (law for force in forces.values() for law in force.laws()):
        if not isinstance(law, Constant):
            with place("loads"):
                raise InputError("a load that follows a law over time has no value at rest", hint="law: constant")
    return forces


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A configuration at which the forces balance.

    Attributes:
        q: Configuration [rad or m], shape (nq,).
        squares: ``w^2`` [rad^2/s^2], or where a direction has no mass eigenvalues of K, ascending; shape (nu,).
        stability: 1 stable, 0 indifferent, -1 unstable.
        massless: Whether a direction has no mass.
        starts: How many starts led to it.
    """

    q: Array
    squares: Array
    stability: int
    massless: bool
    starts: int = 1

    def figures(self, row: int) -> dict[str, float]:
        """Return its numbers by name."""
        kind = "stiffness" if self.massless else "w^2"
        larger = {f"equilibrium {row}: {kind} {k}": float(x) for k, x in enumerate(self.squares[1:], 2)}
        return {
            f"equilibrium {row}: starts": float(self.starts),
            f"equilibrium {row}: stability": float(self.stability),
            f"equilibrium {row}: smallest {kind}": float(self.squares[0]),
            **larger,
        }


def _merge(found: list[Equilibrium], new: Equilibrium, turns: Array) -> None:
    """Add an equilibrium, or count it where the same one has been found, full turns of joints apart."""
    for index, old in enumerate(found):
        apart = new.q - old.q
        apart -= turns * 2 * np.pi * np.round(apart / (2 * np.pi))
        tolerance = SAME if new.stability else SAME_FLAT
        if (np.abs(apart) <= tolerance * (1.0 + np.abs(new.q))).all():
            found[index] = replace(old, starts=old.starts + 1)
            return
    found.append(new)


@dataclass(frozen=True, eq=False)
class Balance:
    """The generalised force of one mechanism at rest, on the coordinates that are free.

    Attributes:
        mechanism: The mechanism; every joint has one coordinate.
        dynamics: Its equation of motion with the loads of the run.
        reduction: The free coordinates.
        rows: Weights of what is held, shape (k, nv).
        held: Its values [rad or m], shape (k,).
        turns: 1 for joints that turn, 0 for those that slide, shape (nv,).
    """

    mechanism: Mechanism
    dynamics: Dynamics
    reduction: Reduction
    rows: Array
    held: Array
    turns: Array

    @classmethod
    def of(cls, mechanism: Mechanism, forces: Mapping[str, ForceElement], held: Mapping[str, Constant]) -> Balance:
        """Return the balance of a mechanism under constant loads, some coordinates held.

        Raises:
            InputError: The held coordinates cannot be held, or nothing is free.
        """
        model = mechanism.model
        if len(held) >= model.nv:
            raise InputError("every coordinate is held: nothing is left to balance", hint="kind: statics")
        for name in held:
            if not isinstance(mechanism.coordinate(name), LinearCoordinate):
                raise InputError(f"'{name}' cannot be held while the mechanism looks for its balance",
                                 expected="coordinates of joints, or sums of them")  # fmt: skip
        imposed = Imposed.some(mechanism, held)
        rows = np.array([c.row(model, model.createData()) for c in imposed.coordinates]).reshape(-1, model.nv)
        return cls(
            mechanism, Dynamics.of(model, forces).on(0.0, 1.0), Reduction.of(model, rows, imposed.names), rows,
            np.array([float(law.value) for law in held.values()]),
            np.array([float(joint.unit != METRE) for joint in mechanism.joints.values()]),
        )  # fmt: skip

    def nearest(self, q: Array) -> Array:
        """Return the configuration nearest to q that takes the values held."""
        return self._whole(q + np.linalg.pinv(self.rows) @ (self.held - self.rows @ q))

    def _whole(self, q: Array) -> Array:
        return self.reduction.configuration(q[self.reduction.free_q], self.held)

    def force(self, q: Array) -> Array:
        """Return f = loads - weights on all coordinates [N*m or N], shape (nv,)."""
        model, data = self.dynamics.model, self.dynamics.data
        weights = np.asarray(pin.computeGeneralizedGravity(model, data, q))
        return np.asarray(self.dynamics.loads(0.0, q, np.zeros(model.nv)) - weights)

    def terms(self, q: Array) -> tuple[Array, Array, Array]:
        """Return K = -df/dq and what it and f are made of, for telling 0 from rounding.

        Returns:
            K, shape (nv, nv); sizes of its terms, shape (nv, nv); sizes of the terms of f at q, shape (nv,).
        """
        model, data = self.dynamics.model, self.dynamics.data
        stiffness = np.array(pin.computeGeneralizedGravityDerivatives(model, data, q)).reshape(model.nv, model.nv)
        size = _weight_terms(model, data, q)
        sizes = np.triu(np.outer(self.turns, size))  # a turn of the joint before moves what the one after lifts
        sizes += np.triu(sizes, 1).T
        for element in self.dynamics.forces.values():
            load = partial(_load, element)
            slopes = slope(load, q)
            stiffness -= slopes
            sizes += np.abs(slopes)
            size = size + np.abs(load(q[None])[0])
        return stiffness, sizes, size

    def equilibrium(self, q: Array, start: str) -> Equilibrium:
        """Return the equilibrium that damped Newton steps from q reach.

        Raises:
            AssemblyError: They reach none.
        """
        reach = np.maximum(np.abs(q), self.turns)
        closest = self._descend(q, reach)
        if not self._balanced(closest, reach):
            closest = self._descend(self._pushed(closest, reach), reach)
        if not self._balanced(closest, reach):
            raise self._unbalanced(closest, reach, start)
        return self._judged(self._descend(closest, reach, polish=True))

    def _descend(self, q: Array, reach: Array, *, polish: bool = False) -> Array:
        """Return where the scaled force can shrink no more: by damped steps, or to polish by a few undamped ones.

        With S the diagonal scaling that gives the terms of K the size 1, a step solves ``S K S y = S f`` in the sense
        of least squares, damped by Levenberg's term, which changes the step's direction only where it has to.
        """
        basis, damping = self.reduction.basis, 0.0
        for _ in range(5 if polish else ITERATIONS):
            if not polish and self._balanced(q, reach):
                break
            stiffness, sizes, _ = self.terms(q)
            diagonal = np.diag(np.abs(basis).T @ sizes @ np.abs(basis))
            scale = np.divide(1.0, np.sqrt(diagonal), out=np.zeros_like(diagonal), where=diagonal > 0.0)
            force = scale * (basis.T @ self.force(q))
            u, s, vt = np.linalg.svd(scale[:, None] * (basis.T @ stiffness @ basis) * scale)
            while damping < 1e6:
                gain = np.divide(s, s * s + damping, out=np.zeros_like(s), where=s > ZERO)
                trial = self._moved(q, scale * (vt.T @ (gain * (u.T @ force))))
                if np.linalg.norm(scale * (basis.T @ self.force(trial))) < np.linalg.norm(force):
                    q, damping = trial, damping / 10 if damping > 1e-6 else 0.0
                    break
                if polish:
                    return q
                damping = max(1e-3, 10 * damping)
            else:
                break
        return q

    def _moved(self, q: Array, step: Array) -> Array:
        """Return q after a step of the free coordinates, cut where a joint would turn too far."""
        whole = self.reduction.basis @ step
        return self._whole(q + whole * min(1.0, STRIDE / max(np.abs(self.turns * whole).max(), 1e-300)))

    def _shares(self, q: Array, reach: Array) -> Array:
        """Return the free forces relative to the terms that make them up, shape (nu,).

        Rounding of the coordinates takes part with K times their size, at least ``reach``: that of the start, or 1 rad.
        """
        basis = self.reduction.basis
        _, sizes, size = self.terms(q)
        whole = np.abs(basis).T @ (size + sizes @ np.maximum(np.abs(q), reach))
        return np.asarray((basis.T @ self.force(q)) / np.maximum(whole, 1e-300))

    def _balanced(self, q: Array, reach: Array) -> bool:
        return bool((np.abs(self._shares(q, reach)) <= BALANCED).all())

    def _pushed(self, q: Array, reach: Array) -> Array:
        """Return q moved the way it would fall: where no small step changes the force, such as an arm held level."""
        share = self._shares(q, reach)
        return self._whole(q + PUSH * self.reduction.basis @ share / np.abs(share).max())

    def _judged(self, q: Array) -> Equilibrium:
        """Return the equilibrium at q with its eigenvalues and their signs."""
        basis, model = self.reduction.basis, self.dynamics.model
        stiffness, sizes, _ = self.terms(q)
        upper = np.triu(pin.crba(model, self.dynamics.data, q).reshape(model.nv, model.nv))
        mass = basis.T @ (upper + np.triu(upper, 1).T) @ basis
        doubt = ZERO * (np.abs(basis).T @ sizes @ np.abs(basis))
        massless = _massless(mass)
        squares, modes = modes_of(basis.T @ stiffness @ basis, np.eye(len(mass)) if massless else mass, doubt)
        unsure = np.einsum("ik,ij,jk->k", np.abs(modes), doubt, np.abs(modes))
        falls = (squares.real < -unsure) | (np.abs(squares.imag) > unsure)
        stability = -1 if falls.any() else int((squares.real > unsure).all())
        return Equilibrium(q, np.sort(squares.real), stability, massless)

    def _unbalanced(self, q: Array, reach: Array, start: str) -> AssemblyError:
        joints = list(self.mechanism.joints.values())
        free = self.reduction.basis.T @ self.force(q)
        worst = int(np.abs(self._shares(q, reach)).argmax())
        joint = joints[int(self.reduction.free_v[worst])]
        closest = ", ".join(f"{joint.name} = {q[joint.q]:.6g} {joint.unit}" for joint in joints)
        return AssemblyError(
            f"{start} leads to no equilibrium: a force of {free[worst]:.3g} {effort_unit(joint)} is left on "
            f"{joint.name}",
            expected=f"a start near a configuration that balances; the closest one reached is {closest}",
            hint="another start, or loads that can be balanced",
            start=start, q=q, residual=free,
        )  # fmt: skip

    def trajectory(self, found: list[Equilibrium]) -> Trajectory:
        """Return the equilibria as rows from 1 on, each a stretch of its own: there is nothing between them."""
        numbers = np.arange(1.0, len(found) + 1.0)
        cuts = (0.5, *(float(number) + 0.5 for number in numbers))
        figures = {"equilibria": float(len(found)), "stable": float(sum(one.stability == 1 for one in found))}
        for row, one in enumerate(found, 1):
            figures |= one.figures(row)
        weightless = [row for row, one in enumerate(found, 1) if one.massless]
        notes = tuple(f"row {row}: a direction has no mass, so its stability is that of the stiffness alone"
                      for row in weightless)  # fmt: skip
        mechanism = replace(self.mechanism, notes=(*self.mechanism.notes, *notes))
        grid = Grid(numbers, cuts, tuple(range(len(found) + 1)))
        return self._at(mechanism, np.array([one.q for one in found]), figures, grid)

    def _at(self, mechanism: Mechanism, q: Array, figures: Mapping[str, float], grid: Grid) -> Trajectory:
        """Return the trajectory on a grid: all of a stretch is the row in its middle."""
        bounds = zip(grid.cuts, grid.cuts[1:], grid.rows, grid.rows[1:], strict=False)
        rows = [q[[round(0.5 * (start + end)) - 1] * (high - low)] for start, end, low, high in bounds]
        states = np.concatenate(rows)
        still = np.zeros_like(states)
        efforts = np.array([-self.force(state) for state in states]) @ (self.reduction.particular @ self.rows)
        return Trajectory(mechanism, "row", unit("1"), grid, states, still, still, efforts,
                          np.zeros((len(states), 0)), mechanism.closure, self.dynamics,
                          partial(self._again, mechanism, q), figures)  # fmt: skip

    def _again(self, mechanism: Mechanism, q: Array, grid: Grid) -> Trajectory:
        return self._at(mechanism, q, {}, grid)


def slope(load: Callable[[Array], Array], q: Array) -> Array:
    """Return the Jacobian of a load at q, by central differences extrapolated to step 0 (Ridders), shape (nv, nv).

    Of all steps and orders each entry takes the one with the smallest estimate of its error, truncation and rounding
    together: near 1e-13 of the load's terms where the load is smooth over about 1e-4 rad or m and more.

    Args:
        load: Configurations, shape (m, nv), to loads, shape (m, nv).
        q: Configuration, shape (nv,).
    """
    n = len(q)
    steps = STEP * 0.5 ** np.arange(LEVELS)[:, None, None]
    shifts = steps * np.eye(n)
    ahead, behind = (load((q + side * shifts).reshape(-1, n)).reshape(LEVELS, n, n) for side in (1.0, -1.0))
    column = (ahead - behind) / (2.0 * steps)
    rounding = np.finfo(float).eps * np.maximum(np.abs(ahead), np.abs(behind)) / steps
    best, least = column[-1], np.full((n, n), np.inf)
    for order in range(1, ORDERS):
        finer = column[1:] + (column[1:] - column[:-1]) / (4.0**order - 1.0)
        doubt = np.maximum(np.abs(finer - column[1:]), np.abs(finer - column[:-1])) + rounding[order:]
        chosen = doubt.argmin(axis=0)[None]
        value, error = (np.take_along_axis(x, chosen, axis=0)[0] for x in (finer, doubt))
        best, least = np.where(error < least, value, best), np.minimum(error, least)
        column = finer
    return np.asarray(best.T)


def modes_of(stiffness: Array, mass: Array, doubt: Array) -> tuple[Array, Array]:
    """Return the eigenvalues of ``K x = w^2 M x``, shape (n,), and x with ``x^H M x = 1`` as columns, shape (n, n).

    Where K is symmetric within ``doubt`` they are real; under loads without a potential they may be complex.
    """
    lower = np.linalg.cholesky(mass)
    inner = np.linalg.solve(lower, np.linalg.solve(lower, stiffness).T).T
    if (np.abs(stiffness - stiffness.T) <= doubt).all():
        squares, modes = np.linalg.eigh(0.5 * (inner + inner.T))
    else:
        squares, modes = np.linalg.eig(inner)
    return squares, np.linalg.solve(lower.T, modes)


def _massless(mass: Array) -> bool:
    size = np.sqrt(np.diag(mass))
    return bool((size == 0.0).any() or np.linalg.eigvalsh(mass / np.outer(size, size))[0] < MASSLESS)


def _load(element: ForceElement, q: Array) -> Array:
    tau = np.zeros_like(q)
    element.add_load(0.0, q, np.zeros_like(q), tau)
    return tau


def _weight_terms(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Return ``sum_b m_b |g| |dc_b/dq_i|`` over the centres of mass c_b [N*m or N], shape (nv,)."""
    pin.computeJointJacobians(model, data, q)
    total, gravity = np.zeros(model.nv), float(np.linalg.norm(model.gravity.linear))
    for joint in range(1, model.njoints):
        jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL).reshape(6, -1)
        inertia = model.inertias[joint]
        moved = jacobian[:3] - np.cross(inertia.lever, jacobian[3:].T).T
        total += inertia.mass * gravity * np.linalg.norm(moved, axis=0)
    return total
