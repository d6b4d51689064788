"""Equilibria and steady motions, and their dry friction: nothing accelerates while drives hold or turn coordinates.

With the rows W of the coordinates that drives hold or turn, and the rows H of slips, the forces balance where

    M a + nle - loads - H_slip^T f = G^T lam + W^T u + H_stuck^T f,    a = 0

has a solution lam, u, f. Newton's method moves along the velocities that G, W and joints that stick leave, with the
derivatives of the left side and of the forces on the right. Joints with dry friction that are at rest keep their place.

In a linearised motion joints that stick are held, and joints that slip have the slope of their law
``f = -(u/|u|) (mu(|u|) N + c(|u|))`` with the slip u = H v and the load N of the bearing, which depends on positions,
velocities, accelerations and the forces of constraints and friction (``mechanics.friction``). One that begins to slip
has no derivative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import STEP, Array, Flags, length
from pinarm.engine.constraints.closure import Closure, slides
from pinarm.engine.constraints.constraint_rows import ConstraintRows, Measured
from pinarm.engine.constraints.nullspace import Decomposition
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import weight_bounds
from pinarm.engine.friction.columns import friction_columns
from pinarm.engine.kinematics.assembly import OPEN, first_position
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.linear.derivatives import EquationDerivatives, complex_kept, equation_derivatives
from pinarm.engine.linear.linearisation import independent_joints
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.quantities.reactions import Reactions
from pinarm.errors import AssemblyError, DynamicsError, InputError
from pinarm.input.units import unit
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PairCoordinate
from pinarm.mechanics.forces.force_element import refusals
from pinarm.mechanics.friction.contact import FrictionContact, same_joint, sizes, slip_rows
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import format_configuration
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


AT_REST = 1e-9
"""Slip and its acceleration, relative to ``1 +`` the largest in SI, that are rounding of a joint at rest."""

AT_LIMIT = 1e-6
"""Part of its limit by which friction at rest has to be away from it, to be said to hold."""


class FrictionState(Record, frozen=True):
    """Friction at one state.

    Attributes:
        f: Friction along them [N*m or N], shape (k,).
        stuck: Which of them friction holds, shape (k,).
    """

    contacts: Sequence[FrictionContact]
    f: Array
    stuck: Flags

    @property
    def note(self) -> str:
        """Note on joints that stick; empty where none does."""
        names = dict.fromkeys(contact.name for contact, stuck in zip(self.contacts, self.stuck, strict=True) if stuck)
        return f"held by dry friction in the small motion: {', '.join(names)}" if names else ""


def at_rest(contacts: Sequence[FrictionContact], slips: Array, v: Array) -> Flags:
    """Return a mask of the contacts that stick if they are held, with dry friction and no slip, shape (k,)."""
    dry = np.array([any(contact.law.resting) for contact in contacts], dtype=bool)
    return np.asarray(dry & (sizes(contacts, slips) <= AT_REST * (1.0 + np.abs(v).max(initial=0.0))))


def friction_state(state: Trajectory) -> FrictionState:
    """Return the friction of a state, a table of one row with accelerations, multipliers and friction."""
    contacts, f = state.mechanism.frictions, state.friction[0]
    slips = slips_of(state, contacts)[0]
    stuck = at_rest(contacts, slips, state.v[0])
    here = Kinematics.at(state.mechanism.model, state.q[0], state.v[0])
    begun = np.array([contact.slip.row(here) @ state.a[0] + contact.slip.drift(here) for contact in contacts])
    limits = np.array(
        [
            contact.law.static_mu * load + contact.law.static_constant
            for contact, load in zip(contacts, _loads(state, contacts)[0], strict=True)
        ]
    )
    moves = np.abs(begun) > AT_REST * (1.0 + np.abs(state.a[0]).max(initial=0.0))
    for k in np.flatnonzero(stuck & (moves | (sizes(contacts, f) > (1.0 - AT_LIMIT) * limits))).tolist():
        raise DynamicsError(
            f"{contacts[k].name} begins to slip here: friction has a kink where it does not hold a joint at rest",
            expected=f"a load along it below {limits[k]:.6g} {contacts[k].effort}, or a velocity",
        )
    return FrictionState(contacts, f, stuck)


def slip_friction(run: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the friction of contacts that slip at n states, which may be complex steps, shape (n, k)."""
    slips, loads = slips_of(run, contacts), _loads(run, contacts)
    speeds = np.sqrt((slips * slips) @ same_joint(contacts).astype(float))
    friction = np.zeros_like(slips * loads)
    for k, contact in enumerate(contacts):
        if not any(contact.law.resting):
            friction[:, k] = -contact.law.viscous * slips[:, k]
            continue
        mu, constant = contact.law.slipping(speeds[:, k])
        friction[:, k] = -slips[:, k] / speeds[:, k] * (mu * loads[:, k] + constant)
    return friction


def friction_slopes(steps: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the slopes of the friction of contacts that slip, along imaginary steps, a row each; shape (k, n)."""
    with complex_kept():
        return np.asarray(np.imag(slip_friction(steps, contacts)).T / STEP)


def slips_of(run: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the slips u of k contacts at n states, shape (n, k)."""
    model = run.mechanism.model
    rows = ConstraintRows.of(model, [measured(contact) for contact in contacts])
    return np.asarray(np.matvec(rows.at(run.q).matrices, run.v))


def with_friction(run: Trajectory, friction: Array) -> Trajectory:
    """Return states with their friction, shape (n, k)."""
    return replace(run, columns={**run.columns, **friction_columns(run.mechanism.frictions, friction)})


def measured(contact: FrictionContact) -> Coordinate:
    """Return the slip of a contact as a coordinate."""
    if isinstance(contact.slip, LinearCoordinate | PairCoordinate):
        return contact.slip
    raise InputError(
        f"the linear analysis has no derivatives of the friction of {contact.name}",
        expected="friction of joints, threads, teeth or belts",
    )


def _loads(run: Trajectory, contacts: Sequence[FrictionContact]) -> Array:
    """Return the loads N of k bearings in units of their friction, shape (n, k); 0 of friction that has none."""
    loads = np.zeros((len(run), len(contacts)), run.q.dtype)
    if not any(contact.law.loaded for contact in contacts):
        return loads
    reactions, multipliers = Reactions(run, 0), run.lam
    lam = {name: multipliers[:, rows] for name, rows in run.closure.slices.items()}
    for k, contact in enumerate(contacts):
        if contact.law.loaded:
            wrench = contact.transmitted(reactions.links, reactions.joints, lam)
            normals = np.matvec(contact.bearing.parts, wrench[..., None, :])
            try:
                loads[:, k] = length(normals).sum(axis=-1) + contact.bearing.preload
            except FloatingPointError:
                raise InputError(
                    f"the friction of {contact.name} has a kink here: a normal force of its bearing is 0",
                    expected="a state in which the bearing is loaded, or friction without a load: constant",
                ) from None
    return loads


ZERO = 1e-9
"""Stiffness, relative to the terms that make it up, below which it is 0."""

BALANCED, POLISHED = 1e-12, 5
"""Largest generalised force left, relative to the terms that make it up, and steps that make it smaller yet."""

STRIDE, PUSH, ITERATIONS, SHORTEST = 0.5, 0.1, 100, 1e-6
"""Largest turn of a joint in one step [rad]; how far a stationary start is moved [rad or m]; steps at most; smallest
part of a step."""

LOOSE = 1e-12
"""Velocity of a joint, relative to that of an independent one, that is rounding of 0."""


class Driven(Record, frozen=True):
    """Coordinates that drives hold or turn.

    Attributes:
        values: Values of those that are held, which come first, shape (h,).
        rates: Rates of all, 0 of those that are held [rad/s or m/s], shape (k,).
    """

    names: Sequence[str]
    coordinates: Sequence[Coordinate]
    values: Array
    rates: Array

    @classmethod
    def of(cls, mechanism: Mechanism, held: Mapping[str, float], steady: Mapping[str, float]) -> Driven:
        """Return coordinates that drives hold at values, and others that they turn steadily."""
        names, rates = (*held, *steady), [*(0.0 for _ in held), *map(float, steady.values())]
        values = np.array([*map(float, held.values())])
        return cls(names, [mechanism.coordinate(name) for name in names], values, np.array(rates))

    @cached_property
    def held(self) -> PrescribedCoordinates:
        """The coordinates that keep their values."""
        h = len(self.values)
        return OPEN.holding(self.names[:h], self.coordinates[:h], self.values.tolist())


def acting(nv: int, coordinates: Sequence[Coordinate], efforts: Array) -> tuple[Array, Array]:
    """Return efforts along coordinates, shape (k, c): at joints, shape (nv, c), and along task coordinates."""
    tau, guides = np.zeros((nv, efforts.shape[1])), list[Array]()
    for coordinate, effort in zip(coordinates, efforts, strict=True):
        if isinstance(coordinate, LinearCoordinate):
            tau += np.multiply.outer(coordinate.weights, effort)
        else:
            guides.append(effort)
    return tau, np.array(guides).reshape(len(guides), efforts.shape[1])


class Forces(Record, frozen=True):
    """Forces at a configuration.

    Attributes:
        v: Velocity at which the drives turn, shape (nv,).
        rows: Rows of constraints, drives and slips that stick, shape (m, nv).
        free: Velocities that they leave, orthonormal, shape (nv, nu).
        demand: ``nle - loads``, shape (nv,).
        carried: Multipliers of the rows, shape (m,).
        f: Friction along all slips, shape (k,).
        left: What neither rows nor friction carry, shape (nv,).
    """

    v: Array
    rows: Array
    free: Array
    demand: Array
    carried: Array
    f: Array
    left: Array

    @property
    def terms(self) -> Array:
        """Sizes of what is demanded and of what rows carry, shape (nv,)."""
        return np.asarray(np.abs(self.demand) + np.abs(self.carried) @ np.abs(self.rows))


def state_row(mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array) -> Trajectory:
    """Return a state as a table of one row, at rest and without efforts."""
    grid, still = Grid(np.full(1, t), (t, float(np.nextafter(t, np.inf))), (0, 1)), np.zeros((1, len(v)))
    closure, lam = mechanism.closure, np.zeros((1, mechanism.closure.size))
    row = Trajectory(mechanism, ROW, unit("1"), grid, q[None], v[None], still, still, lam, closure, dynamics)
    return replace(row, separate=True)


class ForceBalance(Record, frozen=True):
    """The forces of one mechanism in which nothing accelerates, along the motions that loops and drives leave free.

    Attributes:
        dynamics: Its equation of motion with the loads of the run.
        contacts: Slips with friction; none where it has no part.
    """

    mechanism: Mechanism
    dynamics: Dynamics
    driven: Driven
    contacts: Sequence[FrictionContact] = ()

    @cached_property
    def closure(self) -> Closure:
        """Constraints of the mechanism, then the driven coordinates."""
        return self.mechanism.closure.with_guides(self.driven.names, self.driven.coordinates)

    @cached_property
    def turns(self) -> Array:
        """1 for velocities that turn, 0 for those that slide, shape (nv,)."""
        return np.where(slides(self.mechanism.model), 0.0, 1.0)

    def nearest(self, q: Array) -> Array:
        """Return the configuration near q with closed loops that takes the values held."""
        return assembled(self.mechanism.closure, self.driven.held, q, self.driven.values, 0.0)

    def begun(self, start: Array) -> Assembly:
        """Return the configuration that takes the values held, followed from a start; see ``first_position``."""
        assembly = first_position(self.mechanism.closure, self.driven.held, self.driven.values, 0.0, start)
        return replace(assembly, q=self.nearest(assembly.q))

    def basis(self, q: Array, like: Array | None = None) -> Array:
        """Return the free motions at q, shape (nv, nu): orthonormal, and turned to those of another configuration."""
        free = self.closure.split_at(q).free
        if not free.shape[1]:
            raise InputError("loops and held coordinates leave nothing free to balance", hint="kind: statics")
        if like is None or like.shape != free.shape:
            return free
        u, _, vt = np.linalg.svd(free.T @ like)
        return np.asarray(free @ u @ vt)

    def at(self, q: Array) -> Forces:
        """Return the forces at a configuration, shape (nq,)."""
        own, driven, rows = self.mechanism.closure.size, self.closure.size, self.closure.rows(self.closure.state(q))
        v = self._velocity(rows)
        slips = slip_rows(self.mechanism.model, self.contacts, q)
        stuck = at_rest(self.contacts, slips @ v, v)
        rows, slipping, f = np.vstack([rows, slips[stuck]]), slips[~stuck], np.zeros(len(stuck))
        split = Decomposition.of(rows, np.append(self.closure.reach, np.ones(len(rows) - driven)))
        demand = self.dynamics.inverse(0.0, q[None], v[None], np.zeros((1, len(v))))[0]
        sliding = [contact for contact, held in zip(self.contacts, stuck, strict=True) if not held]
        state = state_row(self.mechanism, self.dynamics, 0.0, q, v)
        for _ in range(ITERATIONS if sliding else 1):
            carried = split.multipliers(demand - slipping.T @ f[~stuck])
            f[stuck] = carried[driven:]
            if not sliding:
                break
            tau, lam = carried[own:driven] @ rows[own:driven], carried[None, :own]
            friction = slip_friction(with_friction(replace(state, lam=lam, tau=tau[None]), f[None]), sliding)[0]
            change, f[~stuck] = np.abs(friction - f[~stuck]).max(), friction
            if change <= 0.1 * BALANCED * np.abs(friction).max():
                break
        left = split.free @ ((demand - slipping.T @ f[~stuck]) @ split.free)
        return Forces(v, rows, split.free, demand, carried, f, left)

    def _velocity(self, rows: Array) -> Array:
        """Return the velocity at which the drives turn, all else still, shape (nv,)."""
        rates = self.driven.rates
        if not rates.any():
            return np.zeros(rows.shape[1])
        wanted = np.concatenate([np.zeros(len(rows) - len(rates)), rates])
        v = np.linalg.lstsq(rows, wanted, rcond=1e-12)[0]
        speed = np.abs(v).max()
        if np.abs(rows @ v - wanted).max() > 1e-9 * speed:
            raise InputError("loops, couplings and rates contradict each other", expected="fewer rates")
        v[np.abs(v) < 1e-12 * speed] = 0.0
        _, free = independent_joints(rows)
        loose = np.flatnonzero((v != 0.0) & (np.abs(free) > LOOSE).any(axis=1))
        if len(loose):
            names = ", ".join(coordinate_name(self.mechanism.model, index) for index in loose.tolist())
            raise InputError(
                f"the rates do not determine how fast {names} move",
                expected="a rate in steady, or a value in hold, for more coordinates",
            )
        return np.asarray(v)

    def slopes(self, q: Array, forces: Forces) -> EquationDerivatives:
        """Return the derivatives of the forces; those by q are the stiffness K."""
        slips = [measured(contact) for contact in self.contacts]
        rows: list[Measured] = [*self.closure.constraints, *slips]
        lam, still = np.concatenate([forces.carried[: self.closure.size], forces.f]), np.zeros_like(forces.v)
        return equation_derivatives(self.dynamics, rows, 0.0, q, forces.v, still, lam)

    def efforts(self, q: Array) -> tuple[Array, Array]:
        """Return the efforts of drives at joints, shape (nv,), and the multipliers, those of task coordinates last."""
        own, carried = self.mechanism.closure.size, self.at(q).carried
        tau, guides = acting(self.mechanism.model.nv, self.driven.coordinates, carried[own:, None])
        return tau[:, 0], np.append(carried[:own], guides)

    def solved(self, q: Array, start: str) -> tuple[Array, Forces]:
        """Return the configuration near q at which the forces balance, by Newton steps that make what is left smaller.

        A start at which no step does, such as an arm held level, is moved once the way that it would fall.
        """
        q, pushed = self.nearest(q), False
        forces = self.at(q)
        for _ in range(ITERATIONS):
            slopes = self.slopes(q, forces)
            if not np.isfinite(forces.demand).all() or not np.isfinite(slopes.force_q).all():
                where = format_configuration(self.mechanism.model, q)
                raise AssemblyError(
                    f"the loads are not finite where {where}{refusals(self.dynamics.forces, q)}",
                    expected="a start at which all loads are",
                    q=q,
                )
            shares = self._shares(q, forces, slopes)
            if (np.abs(shares) <= BALANCED).all():
                return self._polished(q, forces)
            nearer = self._nearer(q, forces, slopes, SHORTEST)
            if nearer is None and not pushed:
                pushed, fall = True, forces.free @ shares
                moved = self.nearest(pin.integrate(self.mechanism.model, q, -PUSH * fall / np.abs(shares).max()))
                nearer = moved, self.at(moved)
            if nearer is None:
                break
            q, forces = nearer
        raise self._unbalanced(q, forces, start)

    def _polished(self, q: Array, forces: Forces) -> tuple[Array, Forces]:
        """Return a solution after whole steps, as long as these make its residual smaller."""
        for _ in range(POLISHED):
            if (nearer := self._nearer(q, forces, self.slopes(q, forces), 1.0)) is None:
                break
            q, forces = nearer
        return q, forces

    def _nearer(
        self, q: Array, forces: Forces, slopes: EquationDerivatives, shortest: float
    ) -> tuple[Array, Forces] | None:
        """Return the configuration after a step or a part of it with less left; ``None`` without any."""
        free = forces.free
        diagonal, terms = np.diag(np.abs(free).T @ slopes.terms_q @ np.abs(free)), np.diag(slopes.terms_q)
        scale, sizes = (
            np.divide(1.0, np.sqrt(x), out=np.zeros_like(x), where=x > 0.0) for x in (diagonal, terms)
        )  # gives the terms of K the size 1
        u, s, vt = np.linalg.svd(scale[:, None] * (free.T @ slopes.force_q @ free) * scale)
        gain = np.divide(1.0, s, out=np.zeros_like(s), where=s > ZERO)
        step = -free @ (scale * (vt.T @ (gain * (u.T @ (scale * (free.T @ forces.left))))))
        part, turn = 1.0, float(np.abs(self.turns * step).max(initial=0.0))
        step *= min(1.0, STRIDE / max(turn, STRIDE))
        while part >= shortest:
            with suppress(AssemblyError):  # the loops do not close so far away
                trial = self.nearest(pin.integrate(self.mechanism.model, q, part * step))
                there = self.at(trial)
                if np.linalg.norm(sizes * there.left) < np.linalg.norm(sizes * forces.left):
                    return trial, there
            part *= 0.25
        return None

    def _shares(self, q: Array, forces: Forces, slopes: EquationDerivatives) -> Array:
        """Return the forces left relative to the terms that make them up, shape (nu,).

        Rounding of the coordinates takes part with K times their size, at least 1 rad or the mechanism's unit of
        length: of a coordinate that goes to 0 it would otherwise never end.
        """
        weights = weight_bounds(self.mechanism.model, slopes.mass)
        loads = self.dynamics.load_sizes(0.0, q, forces.v)
        reach = np.maximum(np.abs(q) if len(q) == len(forces.v) else 0.0, self.closure.scale)
        whole = np.abs(forces.free).T @ (weights + loads + forces.terms + slopes.terms_q @ reach)
        return np.asarray((forces.free.T @ forces.left) / np.maximum(whole, 1e-300))

    def _unbalanced(self, q: Array, forces: Forces, start: str) -> AssemblyError:
        model, left = self.mechanism.model, -forces.left
        worst = int(np.abs(left).argmax())
        measured_in = "N*m" if self.turns[worst] else "N"
        return AssemblyError(
            f"{start} leads to no equilibrium: a force of {left[worst]:.3g} {measured_in} is left on "
            f"{coordinate_name(model, worst)}",
            expected="a start near a configuration that balances; the closest one reached is "
            f"{format_configuration(model, q)}",
            hint="another start, or loads that can be balanced",
            start=start,
            q=q,
            residual=left,
        )


LASTING = 1e-7
"""Forces left after some of the motion, relative to their terms: rounding of configurations explains as much."""

SHARED = 1e-9
"""Effort of a drive in a self-stress of length 1 that is rounding."""

TURNED = 0.7, 2.1, 3.1
"""Angles [rad] by which the fastest joint turns on, at which a steady motion is still one: almost half a turn too."""


class SteadyState(Record, frozen=True):
    """A state in which nothing accelerates.

    Attributes:
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        efforts: Efforts u of the drives along their coordinates [N*m or N], shape (k,).
    """

    q: Array
    v: Array
    efforts: Array


def steady_state(balance: ForceBalance, q: Array) -> SteadyState:
    """Return the steady state near a configuration, shape (nq,)."""
    mechanism = balance.mechanism
    q, forces = balance.solved(q, "the start")
    _require_steady(mechanism, q, forces.v)
    _require_own_efforts(balance, q)
    stiffness = float(np.abs(balance.slopes(q, forces).force_q).sum())
    _require_lasting(balance, q, forces, LASTING * (float(forces.terms.sum()) + stiffness))
    return SteadyState(q, forces.v, forces.carried[mechanism.closure.size : balance.closure.size])


def advanced(mechanism: Mechanism, q: Array, v: Array) -> list[Array]:
    """Return configurations later in a steady motion, shape (nq,) each; none of one at rest."""
    speed = float(np.abs(v).max(initial=0.0))
    return [pin.integrate(mechanism.model, q, angle / speed * v) for angle in TURNED] if speed else []


def _require_own_efforts(balance: ForceBalance, q: Array) -> None:
    """Raise where drives may work against each other: their efforts, and so the small motion, are then undetermined."""
    stresses = balance.closure.split_at(q).stresses[balance.mechanism.closure.size :]
    shared = np.abs(stresses).max(axis=1, initial=0.0) > SHARED
    if shared.any():
        names = ", ".join(name for name, shares in zip(balance.driven.names, shared, strict=True) if shares)
        raise InputError(
            f"the load does not determine the efforts of {names}, on which the small motion depends",
            expected="coordinates in hold and steady that move independently of each other",
            hint="one of them left out, or a load of its effort in loads",
        )


def _require_lasting(balance: ForceBalance, q: Array, forces: Forces, most: float) -> None:
    """Raise where the forces do not balance later in the motion, with the same efforts, but for ``most``."""
    own, size = balance.mechanism.closure.size, balance.closure.size
    for later in advanced(balance.mechanism, q, forces.v):
        if reason := refusals(balance.dynamics.forces, later):
            raise DynamicsError(f"the motion is steady for a part of a turn only{reason}")
        then = balance.at(later)
        changed = np.abs(then.carried[own:size] - forces.carried[own:size]).max(initial=0.0)
        left, slower = np.abs(then.left).max(initial=0.0), np.abs(then.v - forces.v).max(initial=0.0)
        if max(left, changed) > most or slower > LASTING * np.abs(forces.v).max(initial=0.0):
            raise DynamicsError(
                "the motion is steady for an instant only: forces balance here, and no more as it goes on",
                hint="weights that turn about an axis which is not vertical, or joints that do not turn about one axis",
            )


def _require_steady(mechanism: Mechanism, q: Array, v: Array) -> None:
    """Raise where loops do not allow a velocity, or not without acceleration."""
    closure = mechanism.closure
    state = closure.state(q, v)
    rate, drift = closure.rows(state) @ v, closure.drift(state)
    speed = float(np.abs(v).max(initial=0.0))
    torn = (np.abs(rate) > 1e-9 * speed) | (np.abs(drift) > 1e-9 * speed**2)
    if torn.any():
        names = dict.fromkeys(owner.name for (owner, _), tears in zip(closure.owners(), torn, strict=True) if tears)
        raise DynamicsError(
            f"{', '.join(names)} does not stay closed at these velocities without acceleration",
            hint="a steady motion turns the mechanism as a whole, or links about axes of their own",
        )
