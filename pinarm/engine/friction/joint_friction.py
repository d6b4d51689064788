"""Joints that stick and slip: friction as a force between two switches, joints held at rest, and states after a switch.

Joints that friction holds are eliminated like coordinates that follow a constant law, so that they do not creep; joints
that slip have a friction of given direction. A switch is the instant at which a slip comes to rest, or at which the
friction that holds a joint reaches its bound.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import Decomposition
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix, solve
from pinarm.engine.friction.columns import Slip, SlipGroup
from pinarm.engine.friction.complementarity import (
    Extremes,
    FrictionBalance,
    FrictionSolution,
    companions,
    decided,
    directions_of,
    extreme_frictions,
)
from pinarm.engine.friction.slip_equation import SlipEquation, jammed
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.errors import DynamicsError
from pinarm.mechanics.ball_joints import coordinate_at
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.friction.contact import (
    FrictionContact,
    same_joint,
    several,
    sizes,
    slip_rows,
    unit_vectors,
)
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.records import AbstractRecord, replace

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

ALIKE = 1e-9
"""Difference from 1 of the cosine between motions that rounding leaves, and of slips that take place together."""

AT_BOUND = 1e-9
"""Part of its bound by which friction may fall short of it at the instant at which another one reaches its own: which
of the two comes first is rounding."""

INSTANTS = np.array([0.0, 0.0823, 0.2391, 0.3817, 0.5379, 0.6181, 0.7639, 0.9103, 1.0])
"""Parts of an interval at which laws are looked at for whether they rest: uneven, not to meet a period."""

TURNING = 1e-6
"""Slip above which one with several components has turned rather than come to rest, over what its acceleration makes in
the time since the last switch: the instant is known to the tolerance of the integration."""


class SlipSwitch(NamedTuple):
    """State after a switch, at which a joint comes to rest, turns its slip or breaks loose.

    Attributes:
        v: Velocity after the switch, shape (nv,).
        moving: Directions of the joints that slip, 0 of those at rest, shape (k,).
        broken: Directions of joints at rest that begin to slip in any case, shape (k,).
        yielding: Directions of joints whose friction is at its bound, shape (k,); see ``decided``.
    """

    v: Array
    moving: Array
    broken: Array
    yielding: Array


class JointFriction(AbstractRecord, ForceElement, frozen=True):
    """The joints with friction of one motion, some of which slip; as a force element, the friction of these.

    Attributes:
        rows: The constraints, then coordinates that follow laws.
        dynamics: The equation of motion without this friction.
        prescribed: Coordinates that follow laws, and those of joints that rest on stops.
        time: First and last instant of the run [s].
        span: Interval of time without jumps [s].
        slip: Directions of the joints that slip, and groups that are stuck.
        size: What errors of steps are relative to; see ``Interval.size``.
    """

    contacts: Sequence[FrictionContact]
    closure: Closure
    rows: Closure
    dynamics: Dynamics
    prescribed: PrescribedCoordinates
    time: tuple[float, float]
    span: tuple[float, float]
    slip: Slip
    size: float = 1.0

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
        dynamics = self.dynamics.on(*self.span)
        return SlipEquation(self.contacts, self.rows, dynamics, self.prescribed.on(*self.span))

    def balance(self, t: float, q: Array, v: Array) -> FrictionBalance:
        """Return the laws and the response to friction in a state, shapes (nq,) and (nv,)."""
        return FrictionBalance(self.contacts, self.equation.at(t, q, v), sizes(self.contacts, self.slips(q, v)))

    def slips(self, q: Array, v: Array) -> Array:
        """Return the slips [rad/s or m/s] in states, shapes (.., nq) and (.., nv), as an array of shape (.., k)."""
        return np.asarray(np.matvec(slip_rows(self.closure.model, self.contacts, q), v))

    def solution(self, t: float, q: Array, v: Array) -> FrictionSolution:
        """Return the friction in a state, of stuck joints too."""
        resting = np.zeros(len(self.contacts), dtype=bool)
        solution = self.balance(t, q, v).solve(self.directions(self.slips(q, v)), self.slip.stuck, resting)
        if solution is None:
            raise jammed(self.contacts, self.direction, f"at t = {t:.9g} s ", t=t, q=q)
        return solution

    def solutions(self, t: Array, q: Array, v: Array) -> list[FrictionSolution]:
        return [self.solution(*row) for row in zip(t.tolist(), q, v, strict=True)]

    def extremes(self, t: Array, q: Array, v: Array, solutions: Sequence[FrictionSolution]) -> list[Extremes]:
        stuck, directions = self.slip.stuck, self.directions(self.slips(q, v))
        rows = zip(t.tolist(), q, v, directions, solutions, strict=True)
        return [extreme_frictions(self.balance(*state), way, stuck, known.f) for *state, way, known in rows]

    def friction(self, t: Array | float, q: Array, v: Array) -> Array:
        flat_q, flat_v = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        if self.equation.loaded:
            instants = np.broadcast_to(t, q.shape[:-1]).ravel()
            friction = np.array([solution.f for solution in self.solutions(instants, flat_q, flat_v)])
        else:
            slips = self.slips(flat_q, flat_v)
            speeds = sizes(self.contacts, slips)
            laws = [contact.law.slipping(speed)[1] for contact, speed in zip(self.contacts, speeds.T, strict=True)]
            friction = -np.array(laws).T * self.directions(slips)
        slipping = sizes(self.contacts, self.direction) > 0.0
        return np.asarray(friction * slipping).reshape(*q.shape[:-1], len(self.contacts))

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add ``J^T f`` of the joints that slip."""
        if self.direction.any():
            tau += np.vecmat(self.friction(t, q, v), slip_rows(self.closure.model, self.contacts, q))

    def laws(self) -> list[MotionLaw]:
        return list(self.prescribed.laws)

    def on(self, start: float, end: float) -> JointFriction:
        return replace(self, span=(start, end))

    def start(self, q: Array, v: Array) -> Slip:
        """Return the slipping joints and the stuck groups from the start of the interval on."""
        slips, balance = self.slips(q, v), self.balance(self.span[0], q, v)
        fast = sizes(self.contacts, slips) > self.resting_speed(v, self._rest(balance))
        moving, none = unit_vectors(self.contacts, np.where(fast, slips, 0.0)), np.zeros(len(slips))
        return self.after(q, SlipSwitch(v, moving, none, none))

    def switch(self, q: Array, v: Array, index: int) -> SlipSwitch:
        """Return the state after the switch at which the interval begins.

        ``index`` is the number of the slip that comes to rest or has turned, or the complement of the number of the
        stuck group that breaks loose.
        """
        t, slips, none = self.span[0], self.slips(q, v), np.zeros(len(self.contacts))
        speeds, slipping = sizes(self.contacts, slips), sizes(self.contacts, self.direction) > 0.0
        balance, slow = self.balance(t, q, v), 2.0 * self.resting_speed(v)
        moving, pace = np.where(speeds > slow, self.directions(slips), 0.0), self._pace(balance) * (t - self.slip.begun)
        turned = slipping & several(self.contacts) & (speeds > np.maximum(TURNING * pace, slow))
        if index >= 0 and not turned[index]:
            same = same_joint(self.contacts)
            parts = np.flatnonzero(same[index]).tolist()
            ended = [i for part in parts for i in (part, *companions(balance.response, part))]
            moving[same[ended].any(axis=0)] = 0.0
            still = np.flatnonzero(slipping & (sizes(self.contacts, moving) == 0.0))
            return SlipSwitch(self._stopped(t, q, v, still), moving, none, none)
        if index >= 0:
            return SlipSwitch(v, unit_vectors(self.contacts, np.where(moving != 0.0, slips, 0.0)), none, none)
        solution = self.solution(t, q, v)
        signs = -np.sign(solution.held) * (np.abs(solution.held) >= solution.bounds * (1.0 - AT_BOUND))
        own = -np.sign(solution.held) * (np.arange(len(signs)) == ~index)
        broken, yielding = (directions_of(self.slip.stuck, some.tolist(), len(moving)) for some in (own, signs))
        return SlipSwitch(v, moving, broken, yielding)

    def after(self, q: Array, switch: SlipSwitch) -> Slip:
        """Return the slipping joints and the stuck groups after a switch, at which other stops may have held."""
        balance = self.balance(self.span[0], q, switch.v)
        try:
            slip = decided(balance, switch.moving, switch.broken, switch.yielding)
            held = [group.first for group in slip.stuck]
            slack = self._slack(q, switch.v, balance)[held].tolist() if held else []
            return replace(slip, begun=self.span[0], rest=self._rest(balance), slack=tuple(slack))
        except DynamicsError as error:
            error.message = f"at t = {self.span[0]:.9g} s: {error.message}"
            raise

    def resting_speed(self, velocities: Array, rest: Sequence[float] | None = None) -> Array:
        """Return the slips [rad/s or m/s] up to which joints are at rest at velocities, shape (.., nv), as (.., k)."""
        most = REST * np.abs(velocities).max(axis=-1, initial=0.0)[..., None]
        return np.asarray((self.slip.rest if rest is None else rest) + most)

    def distance_from_rest(self, parts: Indices, t: Array, q: Array, v: Array) -> Array:
        """Return ``s u`` of one slip with some slack, so that a slip that begins does not end at once, shape (n,).

        Of a slip with several components, of these numbers, less ``|u| / 2``: it falls to 0 too where u has turned by
        60 deg. Of a slip at rest it falls to 0 where the slip begins.
        """
        own, slack = self.slips(q, v)[:, parts], self.resting_speed(v)[:, parts].max(axis=1)
        size, direction = np.linalg.norm(own, axis=1), self.direction[parts]
        if not direction.any():
            return np.asarray(slack - size)
        turned = 0.5 * size if len(parts) > 1 else 0.0
        return np.asarray(own @ direction - turned + slack)

    def _pace(self, balance: FrictionBalance) -> Array:
        """Return the size of the terms of the slips' accelerations [rad/s^2 or m/s^2], of all components, (k,)."""
        response = balance.response
        most = np.abs(response.mobility) @ balance.limits(np.zeros(len(self.contacts)))
        return np.asarray(sizes(self.contacts, np.abs(response.acceleration) + most))

    def _rest(self, balance: FrictionBalance) -> tuple[float, ...]:
        """Return the slips that rounding of the instant of a switch leaves [rad/s or m/s], shape (k,)."""
        return tuple((INSTANT * max(map(abs, self.time)) * self._pace(balance)).tolist())

    def _slack(self, q: Array, v: Array, balance: FrictionBalance) -> Array:
        """Return the friction of each slip that rounding leaves, shape (k,); see ``NOTHING``."""
        moved = pin.integrate(self.closure.model, q, np.full(len(v), DISPLACED * self.size))
        other = self.balance(self.span[0], moved, v).response.acceleration
        unseen = NOTHING * self.size / (self.time[1] - self.time[0]) ** 2
        changed = np.abs(other - balance.response.acceleration) + unseen
        return np.asarray(changed / np.maximum(np.diag(balance.response.mobility), np.finfo(float).tiny))

    def _stopped(self, t: float, q: Array, v: Array, still: Indices) -> Array:
        """Return the velocity nearest to v in which some slips are at rest, shape (nv,)."""
        model, rows = self.closure.model, self.rows.rows(self.rows.state(q))
        target = np.concatenate([np.zeros(self.closure.size), self.prescribed.on(t, t)(t)[1], np.zeros(len(still))])
        split = Decomposition.of(np.vstack([rows, slip_rows(model, self.contacts, q)[still]]))
        mass = mass_matrix(model, q)
        return solve(split, mass, mass @ v, target)

    def with_stuck(self, q: Array) -> PrescribedCoordinates:
        """Return the coordinates that follow laws, and those of joints that friction holds at a configuration."""
        groups = self.slip.stuck
        coordinates, state = list(self._standing(groups, q)) if groups else [], self.closure.state(q)
        names = [f"{self.contacts[group.first].name}, stuck" for group in groups]
        return self.prescribed.holding(names, coordinates, [along.value(state) for along in coordinates])

    def _standing(self, groups: Sequence[SlipGroup], q: Array) -> Iterator[Coordinate]:
        """Yield coordinates that stand still if and only if groups do: of joints, or sums of joints."""
        free = self._possible_motions(q)
        slips = slip_rows(self.closure.model, self.contacts, q) @ free
        for group in groups:
            first, members = slips[group.first], list(group.members)
            apart = np.abs(slips[members] - np.outer(group.ratios[members], first)).max()
            if apart > ALIKE * np.abs(slips[members]).max():
                names = ", ".join(dict.fromkeys(self.contacts[i].name for i in members))
                raise DynamicsError(
                    f"friction holds {names} at one instant, and a law moves them against each other from then on",
                    expected="one of them at rest under friction while a law moves what they hold",
                )
            yield self._standing_coordinate(group, first, free)

    def _possible_motions(self, q: Array) -> Array:
        """Return a basis of the motions that constraints and laws at rest on the interval allow, shape (nv, m)."""
        laws, (start, end) = self.prescribed, self.span
        rates = [law.on(start, end)(start + (end - start) * INSTANTS)[1:] for law in laws.laws]
        resting = [k for k, rate in enumerate(rates) if not np.any(rate)]
        closure = self.closure.with_guides([laws.names[k] for k in resting], [laws.coordinates[k] for k in resting])
        return Decomposition.of(closure.rows(closure.state(q))).free

    def _standing_coordinate(self, group: SlipGroup, slip: Array, free: Array) -> Coordinate:
        contacts = [self.contacts[i] for i in group.members]
        for contact in contacts:
            if isinstance(contact.of, int) and not contact.part and contact.standing:
                return contact.standing
        sizes = np.linalg.norm(free, axis=1)
        cosines = np.abs(free @ slip) / np.maximum(sizes * np.linalg.norm(slip), np.finfo(float).tiny)
        best = int(np.where(cosines > 1.0 - ALIKE, sizes, 0.0).argmax())
        if cosines[best] >= 1.0 - ALIKE:
            return coordinate_at(self.closure.model, best)
        for contact in contacts:
            if contact.coupling and contact.standing:
                return contact.standing
        raise DynamicsError(
            f"no joint of the tree stands still where {self.contacts[group.first].name} sticks",
            expected="friction at joints of the tree, where the mechanism has several motions",
            hint="a model file in which it is a joint of the tree, and loops: that close at another joint",
        )
