"""Equilibria: configurations at which the forces of a mechanism at rest balance, from rough starts."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import SplitRows
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.mass_matrix import MASSLESS, mass_matrix
from pinarm.engine.kinematics.assembly import first_position
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.linear.derivatives import equation_derivatives, load_at_kink
from pinarm.engine.statics.effort_distribution import weight_terms
from pinarm.errors import AssemblyError, InputError, Key, within
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.forces.force_element import ForceElement, refusals
from pinarm.mechanics.joints import METRE, effort_unit, format_configuration
from pinarm.mechanics.laws import Constant
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

ZERO = 1e-9
"""Stiffness, relative to the terms that make it up, below which it is 0."""

BALANCED = 1e-13
"""Largest generalised force left, relative to the terms that make it up; Newton's method ends near 1e-16."""

SAME, SAME_FLAT = 1e-8, 1e-4
"""Distance below which two configurations are one, relative to ``1 + |q|`` [rad or m]: usually, and where a stiffness
of 0 leaves Newton's method with the cube root of ``BALANCED``."""

WIDENED, WIDEST = 2.0, 0.1
"""Ratio of the ways tried along a motion without stiffness, from ``SAME`` on, and the longest one, in rad or in
the unit of length of the mechanism: what balances that far balances anywhere."""

STRIDE, PUSH, ITERATIONS = 0.5, 0.1, 100
"""Largest turn of a joint in one step [rad]; how far a stationary start is moved [rad or m]; steps at most."""


class Modes(Record, frozen=True):
    """Small motions about an equilibrium, those of ``M x'' + K x = 0``.

    Attributes:
        squares: ``w^2`` of ``K x = w^2 M x`` [rad^2/s^2], ascending, shape (n,); NaN where a direction has no mass.
        stiffnesses: Eigenvalues of K, ascending, shape (n,).
        stability: 1 stable, 0 indifferent, -1 unstable; that of K alone where a direction has no mass; NaN where the
            forces do not balance.
        edge: Name of a load whose slope is another one to either side: then all of these are NaN; empty for none.
    """

    squares: Array
    stiffnesses: Array
    stability: float
    edge: str = ""

    @classmethod
    def unknown(cls, count: int, edge: str = "") -> Modes:
        """Return unknown modes in so many directions."""
        return cls(np.full(count, np.nan), np.full(count, np.nan), np.nan, edge)

    @classmethod
    def of(cls, stiffness: Array, mass: Array, doubt: Array) -> Modes:
        """Return the small motions.

        Args:
            stiffness: K, shape (n, n); not symmetric under loads without a potential.
            mass: M, shape (n, n).
            doubt: How large an entry of K may be and still be 0, shape (n, n).
        """
        unit, massless = np.eye(len(mass)), _massless(mass)
        springs, _ = _modes_of(stiffness, unit, doubt)
        squares, modes = _modes_of(stiffness, unit if massless else mass, doubt)
        unsure = np.einsum("ik,ij,jk->k", np.abs(modes), doubt, np.abs(modes))
        falls = (squares.real < -unsure) | (np.abs(squares.imag) > unsure)
        stability = -1.0 if falls.any() else float((squares.real > unsure).all())
        ascending = np.full(len(mass), np.nan) if massless else np.sort(squares.real)
        return cls(ascending, np.sort(springs.real), stability)


def _modes_of(stiffness: Array, mass: Array, doubt: Array) -> tuple[Array, Array]:
    """Return the eigenvalues of ``K x = w^2 M x``, shape (n,), and x with ``x^H M x = 1`` as columns, shape (n, n).

    Where K is symmetric within ``doubt`` they are real; under loads without a potential they may be complex.
    """
    from scipy.linalg import eig, eigh

    if (np.abs(stiffness - stiffness.T) <= doubt).all():
        squares, modes = eigh(0.5 * (stiffness + stiffness.T), mass)
    else:
        squares, modes = eig(stiffness, mass)
        modes = modes / np.sqrt(np.einsum("ik,ij,jk->k", modes.conj(), mass, modes).real)
    return squares, modes


def _massless(mass: Array) -> bool:
    size = np.sqrt(np.diag(mass))
    return bool((size == 0.0).any() or np.linalg.eigvalsh(mass / np.outer(size, size))[0] < MASSLESS)


class Equilibrium(Record, frozen=True):
    """A configuration at which the forces balance.

    Attributes:
        q: Configuration [rad or m], shape (nq,).
        modes: Small motions about it.
        starts: How many starts led to it.
        slack: How far it may be from where the forces balance, where a stiffness is 0 to rounding, [rad or m], shape
            (nv,); ``None`` where no stiffness is 0, or anything balances.
    """

    q: Array
    modes: Modes
    starts: int = 1
    slack: Array | None = None

    def is_at(self, q: Array, turns: Array) -> bool:
        """Tell whether a configuration is this one but for full turns; ``turns`` are 1 for joints that turn, else 0."""
        apart = q - self.q
        apart -= turns * 2 * np.pi * np.round(apart / (2 * np.pi))
        tolerance = SAME if self.modes.stability else SAME_FLAT
        return bool((np.abs(apart) <= tolerance * (1.0 + np.abs(q))).all())


class ForceBalance(Record, frozen=True):
    """The generalised force of one mechanism at rest, along the motions that loops and held coordinates leave free.

    Attributes:
        mechanism: The mechanism; every joint has one coordinate.
        dynamics: Its equation of motion with the loads of the run.
        held: Coordinates that are held, with their values: task coordinates first, then joints and sums of them.
        rows: Constraints of the mechanism, then one row for each held coordinate.
        closure: The same without joints and sums of them, whose multipliers are efforts at joints.
        turns: 1 for joints that turn, 0 for those that slide, shape (nv,).
    """

    mechanism: Mechanism
    dynamics: Dynamics
    held: PrescribedCoordinates
    rows: Closure
    closure: Closure
    turns: Array

    @classmethod
    def of(cls, mechanism: Mechanism, forces: Mapping[str, ForceElement], held: Mapping[str, float]) -> ForceBalance:
        """Return the balance of a mechanism under constant loads, some coordinates held.

        Raises:
            InputError: A held coordinate does not exist, or nothing is free.
        """
        model, coordinates = mechanism.model, []
        for name in held:
            with within(Key(name)):
                coordinates.append(mechanism.coordinate(name))
        if len(held) + int(mechanism.closure.ties) >= model.nv:
            raise InputError("every coordinate is held: nothing is left to balance", hint="kind: statics")
        laws = tuple(Constant(value=float(value)) for value in held.values())
        prescribed, others = PrescribedCoordinates(tuple(held), tuple(coordinates), laws).linear_last()
        own = mechanism.closure
        return cls(
            mechanism,
            Dynamics.of(model, forces).on(0.0, 1.0),
            prescribed,
            own.with_guides(prescribed.names, prescribed.coordinates),
            own.with_guides(prescribed.names[:others], prescribed.coordinates[:others]),
            np.array([float(joint.unit != METRE) for joint in mechanism.joints.values()]),
        )

    def nearest(self, q: Array) -> Array:
        """Return the configuration near q with closed loops that takes the values held.

        Raises:
            AssemblyError: There is none that Newton's method reaches.
        """
        return assembled(self.mechanism.closure, self.held, q, self._values, 0.0)

    def begun(self, start: Array) -> Assembly:
        """Return the configuration that takes the values held, followed from a start; see ``first_position``.

        Raises:
            AssemblyError: There is none.
            InputError: Several may be meant.
        """
        assembly = first_position(self.mechanism.closure, self.held, self._values, 0.0, start)
        return replace(assembly, q=self.nearest(assembly.q))

    @property
    def _values(self) -> Array:
        """The values held, shape (k,)."""
        return np.array([float(law.value) for law in self.held.laws if isinstance(law, Constant)])

    def split(self, q: Array) -> SplitRows:
        """Return the rows of what is held, taken apart at a configuration."""
        return self.rows.split_at(q)

    def basis(self, q: Array, like: Array | None = None) -> Array:
        """Return the free motions at q, shape (nv, nu): orthonormal, and turned to those of another configuration.

        Raises:
            InputError: There are none.
        """
        free = self.split(q).free
        if not free.shape[1]:
            raise InputError("loops and held coordinates leave nothing free to balance", hint="kind: statics")
        if like is None or like.shape != free.shape:
            return free
        u, _, vt = np.linalg.svd(free.T @ like)
        return np.asarray(free @ u @ vt)

    def force(self, q: Array) -> Array:
        """Return f = loads - weights at rest on all coordinates [N*m or N], shape (nv,)."""
        weights = np.asarray(pin.computeGeneralizedGravity(self.dynamics.model, self.dynamics.data, q))
        return np.asarray(self.dynamics.loads(0.0, q, np.zeros_like(q)) - weights)

    def terms(self, q: Array) -> tuple[Array, Array, Array]:
        """Return K = -df/dq, and the sizes of its terms and of those of f, which tell 0 from rounding.

        Rows that turn with q add to K: ``-d(G^T lam)/dq`` with ``f + G^T lam = 0``.
        """
        model, still, lam = self.dynamics.model, np.zeros_like(q), self.split(q).multipliers(-self.force(q))
        at = equation_derivatives(self.dynamics, self.rows.constraints, 0.0, q, still, still, lam)
        size = weight_terms(model, self.dynamics.data, q)
        sizes = np.triu(np.outer(self.turns, size))  # a turn of the joint before moves what the one after lifts
        sizes += np.triu(sizes, 1).T + at.terms_q
        return at.force_q, sizes, size + self.dynamics.load_sizes(0.0, q, still)

    def efforts(self, q: Array) -> tuple[Array, Array]:
        """Return tau at the joints that are held, shape (nv,), and the multipliers, shape (m,)."""
        lam, m = self.split(q).multipliers(-self.force(q)), self.closure.size
        weights = [along.weights for along in self.held.coordinates if isinstance(along, LinearCoordinate)]
        return lam[m:] @ np.array(weights).reshape(-1, len(self.turns)), lam[:m]

    def equilibrium(self, q: Array, start: str) -> Equilibrium:
        """Return the equilibrium that damped Newton steps from q reach.

        Raises:
            AssemblyError: They reach none, or a load is not a number where they begin.
        """
        reach = np.maximum(np.abs(q), self.closure.scale)
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
        basis, damping = self.basis(q), 0.0
        for _ in range(5 if polish else ITERATIONS):
            if not polish and self._balanced(q, reach):
                break
            slopes, sizes, _ = self.terms(q)
            if not np.isfinite(slopes).all():
                raise self._without_loads(q)
            diagonal = np.diag(np.abs(basis).T @ sizes @ np.abs(basis))
            scale = np.divide(1.0, np.sqrt(diagonal), out=np.zeros_like(diagonal), where=diagonal > 0.0)
            force = scale * (basis.T @ self.force(q))
            u, s, vt = np.linalg.svd(scale[:, None] * (basis.T @ slopes @ basis) * scale)
            while damping < 1e6:
                gain = np.divide(s, s * s + damping, out=np.zeros_like(s), where=s > ZERO)
                trial = self._moved(q, basis @ (scale * (vt.T @ (gain * (u.T @ force)))))
                turned = self.basis(trial, basis)
                if self._leads_on(scale, basis, force, turned, trial):
                    q, basis, damping = trial, turned, damping / 10 if damping > 1e-6 else 0.0
                    break
                if polish:
                    return q
                damping = max(1e-3, 10 * damping)
            else:
                break
        return q

    def _leads_on(self, scale: Array, basis: Array, force: Array, turned: Array, trial: Array) -> bool:
        """Tell whether a step shrinks the scaled force, or leads out of a singular position, which has more motions."""
        if turned.shape != basis.shape:
            return bool(turned.shape[1] < basis.shape[1])
        return bool(np.linalg.norm(scale * (turned.T @ self.force(trial))) < np.linalg.norm(force))

    def _moved(self, q: Array, step: Array) -> Array:
        """Return q after a step, cut where a joint would turn too far, and closed again."""
        return self.nearest(q + step * min(1.0, STRIDE / max(np.abs(self.turns * step).max(), 1e-300)))

    def _shares(self, q: Array, reach: Array) -> Array:
        """Return the free forces relative to the terms that make them up, shape (nu,).

        Rounding of the coordinates takes part with K times their size, at least ``reach``: that of the start, 1 rad, or
        the mechanism's unit of length. Of a coordinate that goes to 0 it would otherwise never end.
        """
        basis = self.basis(q)
        _, sizes, size = self.terms(q)
        whole = np.abs(basis).T @ (size + sizes @ np.maximum(np.abs(q), reach))
        return np.asarray((basis.T @ self.force(q)) / np.maximum(whole, 1e-300))

    def _balanced(self, q: Array, reach: Array) -> bool:
        return bool((np.abs(self._shares(q, reach)) <= BALANCED).all())

    def _pushed(self, q: Array, reach: Array) -> Array:
        """Return q moved the way it would fall: where no small step changes the force, such as an arm held level."""
        share = self._shares(q, reach)
        return self.nearest(q + PUSH * self.basis(q) @ share / np.abs(share).max())

    def _judged(self, q: Array) -> Equilibrium:
        """Return the equilibrium at q with its small motions."""
        basis = self.basis(q)
        slopes, sizes, _ = self.terms(q)
        if edge := load_at_kink(self.dynamics, 0.0, q, np.zeros_like(q), self.closure.scale, float(sizes.max())):
            return Equilibrium(q, Modes.unknown(basis.shape[1], edge))
        mass = basis.T @ mass_matrix(self.dynamics.model, q) @ basis
        doubt = ZERO * (np.abs(basis).T @ sizes @ np.abs(basis))
        inner = basis.T @ slopes @ basis
        modes = Modes.of(inner, mass, doubt)
        return Equilibrium(q, modes, slack=None if modes.stability else self._slack(q, basis, inner))

    def _slack(self, q: Array, basis: Array, stiffness: Array) -> Array | None:
        """Return the extent of balance to rounding along the weakest motion, shape (nv,); ``None`` where it is far.

        Where a stiffness vanishes, forces grow with the square or cube of the distance, and steps end far from 0.
        """
        way = basis @ np.linalg.svd(stiffness)[2][-1]
        way /= np.abs(way / self.closure.scale).max()
        reach, far = np.maximum(np.abs(q), self.closure.scale), SAME
        while self._balances_near(q, far * way, reach):
            far *= WIDENED
            if far > WIDEST:
                return None
        return np.asarray(np.abs(far * way))

    def _balances_near(self, q: Array, step: Array, reach: Array) -> bool:
        """Tell whether the forces balance a step away to either side, where loops close there."""
        for side in (1.0, -1.0):
            with suppress(AssemblyError):
                if self._balanced(self.nearest(q + side * step), reach):
                    return True
        return False

    def _without_loads(self, q: Array) -> AssemblyError:
        where = format_configuration(self.mechanism.model, q)
        return AssemblyError(
            f"the loads are not finite where {where}{refusals(self.dynamics.forces, q)}",
            expected="a start at which all loads are",
            q=q,
        )

    def _unbalanced(self, q: Array, reach: Array, start: str) -> AssemblyError:
        joints = list(self.mechanism.joints.values())
        basis = self.basis(q)
        free = basis @ (basis.T @ self.force(q))
        worst = int(np.abs(basis @ self._shares(q, reach)).argmax())
        joint = joints[worst]
        return AssemblyError(
            f"{start} leads to no equilibrium: a force of {free[worst]:.3g} {effort_unit(joint)} is left on "
            f"{joint.name}",
            expected="a start near a configuration that balances; the closest one reached is "
            f"{format_configuration(self.mechanism.model, q)}",
            hint="another start, or loads that can be balanced",
            start=start,
            q=q,
            residual=free,
        )
