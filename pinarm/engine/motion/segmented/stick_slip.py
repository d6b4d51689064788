"""Forward motion with friction that sticks: groups held between two switches, and the state after a switch.

Joints that friction holds are eliminated like coordinates that follow a constant law, so that they do not creep; those
that slip have a friction of given direction. A switch is the instant at which a slip comes to rest, or at which the
friction that holds a joint reaches its bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import split_rows
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.friction.complementarity import FrictionBalance, companions, decided, directions_of, groups_of
from pinarm.engine.friction.sliding import (
    DISPLACED,
    INSTANT,
    NOTHING,
    SlidingFriction,
    distance_from_rest,
    resting_speed,
)
from pinarm.engine.friction.slip import Slip, SlipGroup
from pinarm.engine.integration.events import Watch
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.errors import DynamicsError
from pinarm.mechanics.ball_joints import coordinate_at
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.friction.contact import (
    FrictionContact,
    same_joint,
    several,
    sizes,
    slip_rows,
    slip_rows_at,
    unit_vectors,
)
from pinarm.mechanics.laws import Constant
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.segmented.end_stops import Bound
    from pinarm.engine.motion.systems.frictional import FrictionalSystem

ALIKE = 1e-9
"""Difference from 1 of the cosine between motions that rounding leaves, and of slips that take place together."""

AT_BOUND = 1e-9
"""Part of its bound by which friction may fall short of it at the instant at which another one reaches its own: which
of the two comes first is rounding."""

HOLDS = "friction at rest holds "
"""Beginning of what is decided of a joint with friction."""

INSTANTS = np.array([0.0, 0.0823, 0.2391, 0.3817, 0.5379, 0.6181, 0.7639, 0.9103, 1.0])
"""Parts of an interval at which laws are looked at for whether they rest: uneven, not to meet a period."""

TURNING = 1e-6
"""Slip above which one with several components has turned rather than come to rest, over what its acceleration makes in
the time since the last switch: the instant is known to the tolerance of the integration."""


class SlipSwitch(NamedTuple):
    """What changes where a joint comes to rest, turns its slip or breaks loose.

    Attributes:
        v: The velocity after it, shape (nv,).
        moving: Directions of the joints that slip, 0 of those at rest, shape (k,).
        broken: Those of joints at rest that begin to slip in any case, shape (k,).
        yielding: Those of joints whose friction is at its bound, shape (k,); see ``decided``.
    """

    v: Array
    moving: Array
    broken: Array
    yielding: Array


@dataclass(frozen=True, eq=False)
class StickSlip:
    """The joints with friction of one motion.

    Attributes:
        contacts: The k joints; none where no friction sticks.
        closure: Constraints of the mechanism.
        dynamics: The equation of motion without this friction.
        prescribed: Coordinates that follow laws, stops that are rested on included.
        stops: These stops.
        time: First and last instant of the run [s].
        size: What errors of steps are relative to; see ``Interval.size``.
    """

    contacts: Sequence[FrictionContact]
    closure: Closure
    dynamics: Dynamics
    prescribed: PrescribedCoordinates
    stops: Sequence[Bound] = ()
    time: tuple[float, float] = (0.0, 1.0)
    size: float = 1.0

    @cached_property
    def rows(self) -> Closure:
        return self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)

    def sliding(self, slip: Slip, span: tuple[float, float]) -> SlidingFriction:
        """Return the friction of what slips, on an interval of time without jumps."""
        return SlidingFriction(self.contacts, self.rows, self.dynamics, self.prescribed, slip, span)

    def slips(self, q: Array, v: Array) -> Array:
        """Return the slips [rad/s or m/s] in states, shapes (n, nq) and (n, nv), as an array of shape (n, k)."""
        return np.asarray(np.matvec(slip_rows(self.closure.model, self.contacts, q), v))

    def start(self, span: tuple[float, float], q: Array, v: Array) -> Slip:
        """Return what joints do from an instant on, the start of an interval without jumps.

        Raises:
            DynamicsError: Rigid bodies with friction do not determine it.
        """
        slips, balance = self.slips(q[None], v[None])[0], self._balance(span, q, v)
        fast = sizes(self.contacts, slips) > resting_speed(Slip(rest=self._rest(balance)), v)
        moving = unit_vectors(self.contacts, np.where(fast, slips, 0.0))
        return self.after(span, q, SlipSwitch(v, moving, np.zeros(len(moving)), np.zeros(len(moving))))

    def switch(self, span: tuple[float, float], q: Array, v: Array, slip: Slip, index: int) -> SlipSwitch:
        """Return what changes at a switch.

        Args:
            span: The interval from the instant of the switch on.
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            slip: What joints did until then.
            index: Which joint comes to rest, or has turned its slip, or which group of stuck joints breaks loose: the
                complement of its number.
        """
        sliding, slips = self.sliding(slip, span), self.slips(q[None], v[None])[0]
        speeds, slipping = sizes(self.contacts, slips), sizes(self.contacts, sliding.direction) > 0.0
        balance = sliding.balance(span[0], q, v)
        fast, pace = speeds > 2.0 * resting_speed(slip, v), self._pace(balance) * (span[0] - slip.begun)
        moving, none = np.where(fast, sliding.directions(slips), 0.0), np.zeros(len(speeds))
        turned = slipping & several(self.contacts) & (speeds > np.maximum(TURNING * pace, 2.0 * resting_speed(slip, v)))
        if index >= 0 and not turned[index]:
            same = same_joint(self.contacts)
            parts = np.flatnonzero(same[index]).tolist()
            ended = [i for part in parts for i in (part, *companions(balance.response, part))]
            moving[same[ended].any(axis=0)] = 0.0
            v = self._stopped(span[0], q, v, np.flatnonzero(slipping & (sizes(self.contacts, moving) == 0.0)))
            return SlipSwitch(v, moving, none, none)
        if index >= 0:
            return SlipSwitch(v, unit_vectors(self.contacts, np.where(moving != 0.0, slips, 0.0)), none, none)
        solution = sliding.solution(span[0], q, v)
        signs = -np.sign(solution.held) * (np.abs(solution.held) >= solution.bounds * (1.0 - AT_BOUND))
        own = -np.sign(solution.held) * (np.arange(len(signs)) == ~index)
        broken, yielding = (directions_of(slip.stuck, some.tolist(), len(moving)) for some in (own, signs))
        return SlipSwitch(v, moving, broken, yielding)

    def after(self, span: tuple[float, float], q: Array, switch: SlipSwitch) -> Slip:
        """Return what joints do from a switch on, which may be one that took place while other stops held.

        Raises:
            DynamicsError: Rigid bodies with friction do not determine it.
        """
        balance = self._balance(span, q, switch.v)
        try:
            slip = decided(balance, switch.moving, switch.broken, switch.yielding)
            held = [group.first for group in slip.stuck]
            slack = self._slack(span, q, switch.v, balance)[held].tolist() if held else []
            return replace(slip, begun=span[0], rest=self._rest(balance), slack=tuple(slack))
        except DynamicsError as error:
            error.message = f"at t = {span[0]:.9g} s: {error.message}"
            raise

    def could_hold(self, slip: Slip, span: tuple[float, float], index: int) -> Watch | None:
        """Return the margin by which friction at rest would hold a joint that turns back; ``None`` where it does.

        Args:
            slip: From the instant on at which it is at rest.
            span: Interval of time without jumps from then on.
            index: The joint.
        """
        if not slip.direction[index]:
            return None
        contact = self.contacts[index]

        def margin(t: Array, q: Array, v: Array) -> Array:
            return np.array([self._margin(slip, span, index, *state) for state in zip(t, q, v, strict=True)])

        return Watch(margin, -1, stops=True, loaded=True, what=HOLDS + contact.name, unit=str(contact.effort))

    def _margin(self, slip: Slip, span: tuple[float, float], index: int, t: float, q: Array, v: Array) -> float:
        """Return ``bound - |phi|`` of a joint, and those that move with it, if it were stuck in a state [N*m or N].

        NaN of a joint that others move, as a slide at a dead centre of its crank: friction cannot hold it alone.
        """
        balance = self.sliding(slip, span).balance(t, q, v)
        groups = groups_of(self.contacts, balance.response, companions(balance.response, index))
        if not groups:
            return math.nan
        [group] = groups
        others = np.array(slip.direction)
        others[list(group.members)] = 0.0
        solution = balance.solve(others, [*slip.stuck, group], np.zeros(len(others), dtype=bool))
        return float(solution.bounds[-1] - abs(solution.held[-1])) if solution else math.nan

    def begun(self, before: Slip, slip: Slip, span: tuple[float, float], q: Array) -> Array:
        """Return the direction of the acceleration that grows with the load beyond friction at a switch, shape (nv,).

        With T the motions that are left and d the directions of the slips J v that begin: ``T (T' M T)^-1 T' J' d``.
        """
        held, still = self.held(slip, span, q), {i for group in slip.stuck for i in group.members}
        broken = [i for group in before.stuck for i in group.members if i not in still]
        closure = self.closure.with_guides(held.names, held.coordinates)
        free, rows = split_rows(closure.rows(closure.state(q))).free, slip_rows_at(closure.model, self.contacts, q)
        along = free.T @ (np.array(slip.direction)[broken] @ rows[broken])
        mass = free.T @ mass_matrix(closure.model, q) @ free
        return np.asarray(free @ np.linalg.lstsq(mass, along)[0])

    def _balance(self, span: tuple[float, float], q: Array, v: Array) -> FrictionBalance:
        return self.sliding(Slip(), span).balance(span[0], q, v)

    def _pace(self, balance: FrictionBalance) -> Array:
        """Return the size of the terms of the slips' accelerations [rad/s^2 or m/s^2], of all components, (k,)."""
        response = balance.response
        most = np.abs(response.mobility) @ balance.limits(np.zeros(len(self.contacts)))
        return np.asarray(sizes(self.contacts, np.abs(response.acceleration) + most))

    def _rest(self, balance: FrictionBalance) -> tuple[float, ...]:
        """Return the slips that rounding of the instant of a switch leaves [rad/s or m/s], shape (k,)."""
        return tuple((INSTANT * max(map(abs, self.time)) * self._pace(balance)).tolist())

    def _slack(self, span: tuple[float, float], q: Array, v: Array, balance: FrictionBalance) -> Array:
        """Return the friction of each slip that rounding leaves, shape (k,); see ``NOTHING``."""
        moved = pin.integrate(self.closure.model, q, np.full(len(v), DISPLACED * self.size))
        changed = np.abs(self._balance(span, moved, v).response.acceleration - balance.response.acceleration)
        unseen = NOTHING * self.size / (self.time[1] - self.time[0]) ** 2
        return np.asarray((changed + unseen) / np.maximum(np.diag(balance.response.mobility), np.finfo(float).tiny))

    def _stopped(self, t: float, q: Array, v: Array, still: Indices) -> Array:
        """Return the velocity nearest to v in which some slips are at rest, shape (nv,)."""
        model, rows = self.closure.model, self.rows.rows(self.rows.state(q))
        target = np.concatenate([np.zeros(self.closure.size), self.prescribed.on(t, t)(t)[1], np.zeros(len(still))])
        split = split_rows(np.vstack([rows, slip_rows_at(model, self.contacts, q)[still]]))
        mass = mass_matrix(model, q)
        return solve(split, mass, mass @ v, target)

    def held(self, slip: Slip, span: tuple[float, float], q: Array) -> PrescribedCoordinates:
        """Return the coordinates that follow laws, and those of joints that friction holds at a configuration."""
        coordinates = list(self._standing(slip.stuck, span, q)) if slip.stuck else []
        state = self.closure.state(q)
        return PrescribedCoordinates(
            (*self.prescribed.names, *(f"{self.contacts[group.first].name}, stuck" for group in slip.stuck)),
            (*self.prescribed.coordinates, *coordinates),
            (*self.prescribed.laws, *(Constant(value=coordinate.value(state)) for coordinate in coordinates)),
        )

    def _standing(self, groups: Sequence[SlipGroup], span: tuple[float, float], q: Array) -> Iterator[Coordinate]:
        """Yield coordinates that stand still if and only if groups do: of joints, or sums of joints.

        Raises:
            DynamicsError: There is none of a group, or its members do not stand still together while a law moves.
        """
        free = self._possible_motions(span, q)
        slips = slip_rows_at(self.closure.model, self.contacts, q) @ free
        for group in groups:
            first, members = slips[group.first], list(group.members)
            apart = np.abs(slips[members] - np.outer(group.ratios, first)).max()
            if apart > ALIKE * np.abs(slips[members]).max():
                names = ", ".join(dict.fromkeys(self.contacts[i].name for i in members))
                raise DynamicsError(
                    f"friction holds {names} at one instant, and a law moves them against each other from then on",
                    expected="one of them at rest under friction while a law moves what they hold",
                )
            yield self._standing_coordinate(group, first, free)

    def _possible_motions(self, span: tuple[float, float], q: Array) -> Array:
        """Return a basis of the motions that constraints and laws at rest on an interval allow, shape (nv, m)."""
        prescribed, instants = self.prescribed, span[0] + (span[1] - span[0]) * INSTANTS
        laws = (law.on(*span)(instants) for law in prescribed.laws)
        resting = [k for k, (_, *rates) in enumerate(laws) if not np.any(rates)]
        closure = self.closure.with_guides(
            [prescribed.names[k] for k in resting], [prescribed.coordinates[k] for k in resting]
        )
        return split_rows(closure.rows(closure.state(q))).free

    def _standing_coordinate(self, group: SlipGroup, slip: Array, free: Array) -> Coordinate:
        """Return a coordinate that stands still if and only if a group does.

        ``slip`` is ``J T`` of its first member, shape (m,), with the possible motions T, shape (nv, m).
        """
        for contact in (self.contacts[i] for i in group.members):
            if isinstance(contact.of, int) and not contact.part and contact.standing:
                return contact.standing
        sizes = np.linalg.norm(free, axis=1)
        cosines = np.abs(free @ slip) / np.maximum(sizes * np.linalg.norm(slip), np.finfo(float).tiny)
        best = int(np.where(cosines > 1.0 - ALIKE, sizes, 0.0).argmax())
        if cosines[best] >= 1.0 - ALIKE:
            return coordinate_at(self.closure.model, best)
        for contact in (self.contacts[i] for i in group.members):
            if contact.by_multiplier and contact.standing:
                return contact.standing
        raise DynamicsError(
            f"no joint of the tree stands still where {self.contacts[group.first].name} sticks",
            expected="friction at joints of the tree, where the mechanism has several motions",
            hint="a model file in which it is a joint of the tree, and loops: that close at another joint",
        )

    def watches(self, slip: Slip, system: FrictionalSystem) -> list[tuple[int, Watch]]:
        """Return what ends a stretch of the motion: number of a joint whose slip ends, or complement of a group's."""
        watches, same = list[tuple[int, Watch]](), same_joint(self.contacts)
        held = {i for group in slip.stuck for i in group.members}
        if all(isinstance(law, Constant) for law in self.prescribed.laws):  # so all of them stand still
            held |= set(np.flatnonzero(sizes(self.contacts, np.array(slip.direction)) == 0.0).tolist())
        for i in (i for i in range(len(same)) if int(same[i].argmax()) == i):
            parts, contact = np.flatnonzero(same[i]), self.contacts[i]
            if not held.intersection(parts.tolist()):
                rests, unit = f"{contact.name} comes to rest", "m/s" if str(contact.effort) == "N" else "rad/s"
                gap = partial(self._distance_from_rest, slip, parts)
                watches.append((i, Watch(gap, -1, stops=True, what=rests, unit=unit)))
        for g, slack in enumerate(slip.slack):
            contact = self.contacts[slip.stuck[g].first]
            left, margin = _reserves(system, g, slack)
            watches.append((~g, Watch(left, -1, stops=True, loaded=True, margin=margin,
                                      what=HOLDS + contact.name, unit=str(contact.effort))))  # fmt: skip
        return watches

    def _distance_from_rest(self, slip: Slip, parts: Indices, t: Array, q: Array, v: Array) -> Array:
        return distance_from_rest(slip, parts, self.slips(q, v), v)


Reserve = Callable[[Array, Array, Array], Array]
"""Instants and states of a mechanism -> distance of the friction of a stuck group from its bound, shape (n,)."""


def _reserves(system: FrictionalSystem, group: int, slack: float) -> tuple[Reserve, Reserve]:
    """Return ``bound^2 - phi^2`` with some slack, which is smooth where phi vanishes, and ``bound - |phi|``."""

    def held(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        solutions = system.sliding_at(float(t[0]), float(t[-1])).solutions(t, q, v)
        return np.array([x.held[group] for x in solutions]), np.array([x.bounds[group] for x in solutions])

    def left(t: Array, q: Array, v: Array) -> Array:
        phi, bounds = held(t, q, v)
        return np.asarray(bounds**2 - phi**2 + slack**2)

    def margin(t: Array, q: Array, v: Array) -> Array:
        phi, bounds = held(t, q, v)
        return np.asarray(bounds - np.abs(phi))

    return left, margin
