"""The friction of joints that slip in given directions, as a force element."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.balance import FrictionBalance, FrictionSolution
from pinarm.engine.friction.response import SlipEquation
from pinarm.engine.friction.slip import Slip
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.errors import DynamicsError
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.friction.contact import FrictionContact, slip_rows, slip_rows_at
from pinarm.mechanics.friction.slip_vectors import same_joint, several, sizes, unit_vectors
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.friction.extremes import Extremes


@dataclass(frozen=True, eq=False)
class SlidingFriction(ForceElement):
    """Friction against slips that do not reverse, zero of joints that are stuck.

    Attributes:
        contacts: The k joints with friction.
        closure: Constraints, then coordinates that follow laws.
        dynamics: The equation of motion without this friction.
        prescribed: The coordinates that follow laws.
        slip: Directions, and what is stuck.
        span: Interval of time on which no law jumps [s].
        known: Solutions in states that have been asked for, by these; ``None`` where they are not kept, as in an
            integration: efforts of controllers jump between two states that are the same.
    """

    contacts: Sequence[FrictionContact]
    closure: Closure
    dynamics: Dynamics
    prescribed: PrescribedCoordinates
    slip: Slip
    span: tuple[float, float]
    known: dict[tuple[object, ...], FrictionSolution] | None = field(default=None, repr=False)

    @cached_property
    def direction(self) -> Array:
        """Directions of the slips, of those with several components near the states, shape (k,)."""
        return np.array(self.slip.direction, float)

    def directions(self, slips: Array) -> Array:
        """Return the directions of slips, shape (.., k): constant, but for those with several components.

        These have the direction of the slip, or the opposite one where it has passed its rest within a step.
        """
        vectors = several(self.contacts)
        if not vectors.any():
            return self.direction + np.zeros(slips.shape)
        forwards = np.sign((slips * self.direction) @ same_joint(self.contacts).astype(float))
        return np.where(vectors, forwards * unit_vectors(self.contacts, slips), self.direction)

    @cached_property
    def equation(self) -> SlipEquation:
        """The equation of motion on the interval."""
        dynamics = self.dynamics.on(*self.span)
        return SlipEquation(self.contacts, self.closure, dynamics, self.prescribed.on(*self.span))

    def balance(self, t: float, q: Array, v: Array) -> FrictionBalance:
        """Return the laws and what friction does in a state, shapes (nq,) and (nv,)."""
        return self._balance(t, q, v, self._slips(q, v))

    def _balance(self, t: float, q: Array, v: Array, slips: Array) -> FrictionBalance:
        return FrictionBalance(self.contacts, self.equation.at(t, q, v), sizes(self.contacts, slips))

    def solution(self, t: float, q: Array, v: Array) -> FrictionSolution:
        """Return the friction in a state, of stuck joints too.

        Raises:
            DynamicsError: There is none, or more than one.
        """
        slips = self._slips(q, v)
        resting = np.zeros(len(self.contacts), dtype=bool)
        solution = self._balance(t, q, v, slips).solve(self.directions(slips), self.slip.stuck, resting)
        if solution is None:
            rubbing = (contact.name for contact, s in zip(self.contacts, self.direction, strict=True) if s)
            names = ", ".join(dict.fromkeys(rubbing))
            raise DynamicsError(
                f"at t = {t:.9g} s friction of {names} raises the load that it depends on without end: the joint jams",
                expected="a smaller mu, or a longer span of the guide", t=t, q=q,
            )  # fmt: skip
        return solution

    def solutions(self, t: Array, q: Array, v: Array) -> list[FrictionSolution]:
        """Return the friction in states of one interval: where nothing moves and no load changes, solved once."""
        if self.known is None:
            return self._solutions(t, q, v)
        asked = [(self.span, *(x.tobytes() for x in row)) for row in zip(t, q, v, strict=True)]
        new = [row for row, state in enumerate(asked) if state not in self.known]
        self.known.update(zip((asked[row] for row in new), self._solutions(t[new], q[new], v[new]), strict=True))
        return [self.known[state] for state in asked]

    def _solutions(self, t: Array, q: Array, v: Array) -> list[FrictionSolution]:
        if len(t) > 1 and (q == q[0]).all() and (v == v[0]).all() and self._lasts(t, q, v):
            return [self.solution(float(t[0]), q[0], v[0])] * len(t)
        return [self.solution(*row) for row in zip(t, q, v, strict=True)]

    def reserves(self, group: int, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return what holds a stuck group in states of one interval, and the most that can [N*m or N], shape (n,) each.

        Where nothing moves, friction follows the accelerations that loads would give; but where it depends on loads and
        some joints slip, several hold one motion, or loads have kinks, states are solved one by one.
        """
        stuck, loaded, same = self.slip.stuck, self.equation.loaded, bool((q == q[0]).all() and (v == v[0]).all())
        shared = loaded and (self.direction.any() or any(len(each.members) > 1 for each in stuck))
        balance = self.balance(float(t[0]), q[0], v[0])
        if not same or shared or (loaded and balance.response.loads.bent):
            solutions = self.solutions(t, q, v)
            return np.array([x.held[group] for x in solutions]), np.array([x.bounds[group] for x in solutions])
        alpha = self.equation.accelerations(t, q[0], v[0])
        if loaded:
            held, bounds = balance.stuck_alone(stuck, alpha, self.equation.carried(t, q[0], v[0]))
            return held[:, group], bounds[:, group]
        first, some = self.solution(float(t[0]), q[0], v[0]), [each.first for each in stuck]
        changed = (alpha - alpha[0])[:, some] @ balance.back(stuck).T
        held = first.held[group] - changed[:, list(stuck[group].members)] @ stuck[group].ratios
        return np.asarray(held), np.full(len(t), first.bounds[group])

    def extremes(
        self, t: Array, q: Array, v: Array, solutions: Sequence[FrictionSolution], unknown: Collection[int] = ()
    ) -> list[Extremes]:
        """Return the frictions at which what joints at rest share is least or greatest, by states.

        Args:
            t: Instants [s], shape (n,).
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            solutions: The friction in these states; where it is the same solution, so are the extremes.
            unknown: Joints whose limits rigid bodies do not determine.
        """
        from pinarm.engine.friction.extremes import extreme_frictions

        extremes: list[Extremes] = []
        for i, each in enumerate(solutions):
            if i and each is solutions[i - 1]:
                extremes.append(extremes[-1])
                continue
            balance, slips = self.balance(float(t[i]), q[i], v[i]), self._slips(q[i], v[i])
            extremes.append(extreme_frictions(balance, self.directions(slips), self.slip.stuck, each.f, unknown))
        return extremes

    def _slips(self, q: Array, v: Array) -> Array:
        return np.asarray(slip_rows_at(self.closure.model, self.contacts, q) @ v)

    def _lasts(self, t: Array, q: Array, v: Array) -> bool:
        """Return whether what drives and loads do is the same at all instants, the state being the same."""
        equation, forces = self.equation, self.equation.dynamics.forces.values()
        loads, targets = equation.dynamics.loads(t, q, v), [equation.targets(instant)[2] for instant in t]
        if not ((loads == loads[0]).all() and (np.array(targets) == targets[0]).all()):
            return False
        first, *others = ([force.wrenches(instant, q[0], v[0]) for force in forces] for instant in t)
        return all(
            np.array_equal(wrench, before[joint])
            for other in others
            for before, now in zip(first, other, strict=True)
            for joint, wrench in now.items()
        )

    def friction(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the friction of joints that slip [N*m or N], shape (.., k)."""
        flat_q, flat_v = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        if self.equation.loaded:
            instants = np.broadcast_to(t, q.shape[:-1]).ravel()
            friction = np.array([each.f for each in self.solutions(instants, flat_q, flat_v)])
        else:
            slips = np.matvec(slip_rows(self.closure.model, self.contacts, flat_q), flat_v)
            speeds = sizes(self.contacts, slips)
            laws = [contact.law.slipping(speed)[1] for contact, speed in zip(self.contacts, speeds.T, strict=True)]
            friction = -np.array(laws).T * self.directions(slips)
        slipping = sizes(self.contacts, self.direction) > 0.0
        return np.asarray(friction * slipping).reshape(*q.shape[:-1], len(self.contacts))

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add ``J^T f`` of the joints that slip."""
        if not self.direction.any():
            return
        rows = slip_rows(self.closure.model, self.contacts, q.reshape(-1, q.shape[-1]))
        tau += np.vecmat(self.friction(t, q, v), rows.reshape(*q.shape[:-1], *rows.shape[1:]))

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the heat, ``- f . u``."""
        if not self.direction.any():
            return np.zeros(q.shape[:-1])
        rows = slip_rows(self.closure.model, self.contacts, q.reshape(-1, q.shape[-1]))
        slips = np.matvec(rows.reshape(*q.shape[:-1], *rows.shape[1:]), v)
        return np.asarray(-(self.friction(t, q, v) * slips).sum(axis=-1))

    def laws(self) -> list[MotionLaw]:
        """Return the laws of the coordinates that follow some: reactions jump where they do."""
        return list(self.prescribed.laws)

    def on(self, start: float, end: float) -> SlidingFriction:
        """Return the element on an interval."""
        return replace(self, span=(start, end))
