"""Friction between two switches: the force element of joints that slip, and the conditions that end the stretch."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.complementarity import FrictionBalance, FrictionSolution
from pinarm.engine.friction.extremes import Extremes, extreme_frictions
from pinarm.engine.friction.response import SlipEquation
from pinarm.engine.friction.slip import Slip
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.errors import DynamicsError
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.friction.contact import (
    FrictionContact,
    same_joint,
    several,
    sizes,
    slip_rows,
    slip_rows_at,
    unit_vectors,
)
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.records import replace

REST = 1e-12
"""Slip that is rest, over the largest velocity in SI: rounding of a velocity that vanishes."""

INSTANT = 8.0 * float(np.finfo(float).eps)
"""Rounding of an instant, over the largest one: slips are as fast as they become in that time."""

NOTHING = 1e-12
"""Path, over the size that errors are relative to: friction that moves a joint no farther in the whole run is nothing.
Where the force that friction holds and its bound grow from 0 together, as in a gear without a load, they are compared
from there on."""

DISPLACED = 1e-14
"""Displacement, over the same size, that rounding leaves of configurations: so does the change of loads by it."""


@dataclass(frozen=True, eq=False)
class SlidingFriction(ForceElement):
    """Friction against slips that do not reverse, zero of joints that are stuck.

    Attributes:
        contacts: The k joints with friction.
        closure: Constraints, then coordinates that follow laws.
        dynamics: The equation of motion without this friction.
        prescribed: The coordinates that follow laws.
        slip: Directions, and groups that are stuck.
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
        """Return the laws and the response to friction in a state, shapes (nq,) and (nv,)."""
        return FrictionBalance(self.contacts, self.equation.at(t, q, v), sizes(self.contacts, self._slips(q, v)))

    def _slips(self, q: Array, v: Array) -> Array:
        return np.asarray(slip_rows_at(self.closure.model, self.contacts, q) @ v)

    def solution(self, t: float, q: Array, v: Array) -> FrictionSolution:
        """Return the friction in a state, of stuck joints too.

        Raises:
            DynamicsError: There is none, or more than one.
        """
        resting = np.zeros(len(self.contacts), dtype=bool)
        solution = self.balance(t, q, v).solve(self.directions(self._slips(q, v)), self.slip.stuck, resting)
        if solution is None:
            rubbing = (contact.name for contact, s in zip(self.contacts, self.direction, strict=True) if s)
            names = ", ".join(dict.fromkeys(rubbing))
            raise DynamicsError(
                f"at t = {t:.9g} s friction of {names} raises the load that it depends on without end: the joint jams",
                expected="a smaller mu, or a longer span of the guide", t=t, q=q,
            )  # fmt: skip
        return solution

    def solutions(self, t: Array, q: Array, v: Array) -> list[FrictionSolution]:
        """Return the friction in states of one interval."""
        if self.known is None:
            return [self.solution(*row) for row in zip(t, q, v, strict=True)]
        asked = [(self.span, *(x.tobytes() for x in row)) for row in zip(t, q, v, strict=True)]
        for row, state in enumerate(asked):
            if state not in self.known:
                self.known[state] = self.solution(float(t[row]), q[row], v[row])
        return [self.known[state] for state in asked]

    def extremes(
        self, t: Array, q: Array, v: Array, solutions: Sequence[FrictionSolution], unknown: Collection[int] = ()
    ) -> list[Extremes]:
        """Return the frictions at which shares of joints at rest are least or greatest, in states.

        Args:
            t: Instants [s], shape (n,).
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            solutions: The friction in these states; where it and the state stay, so do the extremes.
            unknown: Joints whose limits rigid bodies do not determine.
        """
        extremes, before = list[Extremes](), b""
        for instant, position, rate, solution in zip(t.tolist(), q, v, solutions, strict=True):
            state = b"".join(x.tobytes() for x in (position, rate, *solution))
            if state == before:
                extremes.append(extremes[-1])
                continue
            balance, directions = self.balance(instant, position, rate), self.directions(self._slips(position, rate))
            extremes.append(extreme_frictions(balance, directions, self.slip.stuck, solution.f, unknown))
            before = state
        return extremes

    def friction(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the friction of joints that slip [N*m or N], shape (.., k)."""
        flat_q, flat_v = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        if self.equation.loaded:
            instants = np.broadcast_to(t, q.shape[:-1]).ravel()
            friction = np.array([solution.f for solution in self.solutions(instants, flat_q, flat_v)])
        else:
            slips = np.matvec(slip_rows(self.closure.model, self.contacts, flat_q), flat_v)
            speeds = sizes(self.contacts, slips)
            laws = [contact.law.slipping(speed)[1] for contact, speed in zip(self.contacts, speeds.T, strict=True)]
            friction = -np.array(laws).T * self.directions(slips)
        slipping = sizes(self.contacts, self.direction) > 0.0
        return np.asarray(friction * slipping).reshape(*q.shape[:-1], len(self.contacts))

    def _rows(self, q: Array) -> Array:
        """Return J of the slips, shape (.., k, nv)."""
        rows = slip_rows(self.closure.model, self.contacts, q.reshape(-1, q.shape[-1]))
        return np.asarray(rows.reshape(*q.shape[:-1], *rows.shape[1:]))

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add ``J^T f`` of the joints that slip."""
        if self.direction.any():
            tau += np.vecmat(self.friction(t, q, v), self._rows(q))

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the heat, ``- f . u``."""
        if not self.direction.any():
            return np.zeros(q.shape[:-1])
        return np.asarray(-(self.friction(t, q, v) * np.matvec(self._rows(q), v)).sum(axis=-1))

    def laws(self) -> list[MotionLaw]:
        """Return the laws of the coordinates that follow some: reactions jump where they do."""
        return list(self.prescribed.laws)

    def on(self, start: float, end: float) -> SlidingFriction:
        """Return the element on an interval."""
        return replace(self, span=(start, end))


def resting_speed(slip: Slip, velocities: Array) -> Array:
    """Return the slips [rad/s or m/s] up to which k joints are at rest at velocities, shape (.., nv), as (.., k)."""
    return np.asarray(slip.rest + REST * np.abs(velocities).max(axis=-1, initial=0.0)[..., None])


def distance_from_rest(slip: Slip, parts: Indices, slips: Array, velocities: Array) -> Array:
    """Return ``s u`` of one slip with some slack, so that a slip that begins does not end at once, shape (n,).

    Of a slip with several components less ``|u| / 2``: it falls to 0 too where u has turned by 60 deg. Of a slip at
    rest it falls to 0 where the slip begins.

    Args:
        slip: Directions at first.
        parts: Numbers of the components of the slip.
        slips: Of all k components [rad/s or m/s], shape (n, k).
        velocities: Shape (n, nv).
    """
    own, slack = slips[:, parts], resting_speed(slip, velocities)[:, parts].max(axis=1)
    size, direction = np.linalg.norm(own, axis=1), np.array(slip.direction)[parts]
    if not direction.any():
        return np.asarray(slack - size)
    turned = 0.5 * size if len(parts) > 1 else 0.0
    return np.asarray(own @ direction - turned + slack)
