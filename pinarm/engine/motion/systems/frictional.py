"""Equations of motion with stick-slip: a stuck joint is held, a slipping one carries the friction as a load.

A stuck joint follows a constant law. Rows are completed with the friction of all joints, and with the extremes of their
shares where several joints at rest hold one motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.friction.complementarity import Extremes, FrictionSolution, filled, held_part, pushing_part
from pinarm.engine.friction.joint_friction import JointFriction
from pinarm.engine.integration.integrator import Watch
from pinarm.engine.motion.systems import CompletedStates, System, demand, efforts_of
from pinarm.errors import IntegrationError
from pinarm.mechanics.coordinates import driven_along
from pinarm.mechanics.friction.contact import same_joint, sizes, slip_rows
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Interval, Manifold
    from pinarm.engine.motion.segmented.end_stops import Bound

EXCEEDED = 1e-6
"""Part of its bound by which the friction of a row may exceed it: the row may stand at the switch."""

BEFORE = 1e-10
"""Time by which a last row is moved back where loads jump at its switch, as when flanks meet, over that of the run."""

ROUNDED = 1e-12
"""Load that friction leaves of what is asked for along a joint, over the terms, that is their rounding."""

FRICTION = "friction"
"""Name of the force element of joints that slip."""

HOLDS = "friction at rest holds "
"""Beginning of what is decided of a joint with friction."""

Reserve = Callable[[Array, Array, Array], Array]
"""Instants and states of a mechanism -> distance of the friction of a stuck group from its bound, shape (n,)."""


SolvedRows = tuple[slice, JointFriction, list[FrictionSolution]]
"""Some rows, what slips there, and the friction of all joints, row by row."""


class FrictionalSystem(Record, frozen=True):
    """Equations of motion while some joints with friction slip and others are stuck.

    Attributes:
        friction: The joints with friction, slipping and stuck.
        inner: The equations in which the stuck joints follow constant laws.
        cuts: Bounds of the intervals on which no law jumps [s].
    """

    friction: JointFriction
    inner: System
    stops: Sequence[Bound]
    cuts: Sequence[float]

    unshown = ("cuts",)

    @property
    def manifold(self) -> Manifold:
        return self.inner.manifold

    @property
    def closure(self) -> Closure:
        """Constraints with multipliers: those of the mechanism, then task coordinates that follow laws."""
        prescribed, others = self.friction.prescribed.linear_last()
        return self.friction.closure.with_guides(prescribed.names[:others], prescribed.coordinates[:others])

    def _sliding_at(self, start: float, end: float) -> JointFriction:
        """Return the friction on the interval that some instants lie in."""
        cuts = np.array(self.cuts)
        k = int(np.clip(np.searchsorted(cuts, 0.5 * (start + end), side="right") - 1, 0, len(cuts) - 2))
        return self.friction.on(float(cuts[k]), float(cuts[k + 1]))

    def acting(self, dynamics: Dynamics) -> Dynamics:
        """Return an equation of motion with the friction of what slips under its loads."""
        friction = replace(self.friction, dynamics=dynamics).on(*self.cuts[:2])
        return Dynamics.of(dynamics.model, {**dynamics.forces, FRICTION: friction})

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        return self.inner.interval(self.acting(dynamics), start, end)

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        return self.inner.whole(t, q, v)

    def watches(self) -> list[tuple[int, Watch]]:
        """Return the watches that end a stretch, by number of a slip that ends, or complement of a stuck group's."""
        friction, watches = self.friction, list[tuple[int, Watch]]()
        slip, same = friction.slip, same_joint(friction.contacts)
        held = {i for group in slip.stuck for i in group.members}
        if all(isinstance(law, Constant) for law in friction.prescribed.laws):  # so all of them stand still
            held |= set(np.flatnonzero(sizes(friction.contacts, friction.direction) == 0.0).tolist())
        for i in (i for i in range(len(same)) if int(same[i].argmax()) == i):
            parts, contact = np.flatnonzero(same[i]), friction.contacts[i]
            if not held.intersection(parts.tolist()):
                unit = "m/s" if str(contact.effort) == "N" else "rad/s"
                gap = partial(friction.distance_from_rest, parts)
                watches.append((i, Watch(gap, -1, stops=True, what=f"{contact.name} comes to rest", unit=unit)))
        for g, slack in enumerate(slip.slack):
            contact = friction.contacts[slip.stuck[g].first]
            left, margin = self._reserves(g, slack)
            watches.append((~g, Watch(left, -1, stops=True, loaded=True, margin=margin,
                                      what=HOLDS + contact.name, unit=str(contact.effort))))  # fmt: skip
        return watches

    def _reserves(self, group: int, slack: float) -> tuple[Reserve, Reserve]:
        """Return ``bound^2 - phi^2`` with some slack, which is smooth where phi vanishes, and ``bound - |phi|``."""

        def held(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
            solutions = self._sliding_at(float(t[0]), float(t[-1])).solutions(t, q, v)
            return np.array([x.held[group] for x in solutions]), np.array([x.bounds[group] for x in solutions])

        def left(t: Array, q: Array, v: Array) -> Array:
            phi, bounds = held(t, q, v)
            return np.asarray(bounds**2 - phi**2 + slack**2)

        def margin(t: Array, q: Array, v: Array) -> Array:
            phi, bounds = held(t, q, v)
            return np.asarray(bounds - np.abs(phi))

        return left, margin

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the motion with the friction of all joints, and with the efforts of what follows laws."""
        inner, solved = self._solved(dynamics, grid, q, v)
        if any(self._beyond(solutions[-1]).any() for _, _, solutions in solved[-1:] if solutions):
            back = BEFORE * (self.cuts[-1] - self.cuts[0]) * self.manifold.velocity(q[-1:], v[-1:])
            inner, solved = self._solved(dynamics, grid, np.vstack([q[:-1], q[-1:] - back]), v)
        extremes = list[Extremes]()
        for rows, local, solutions in solved:
            for solution, t in zip(solutions, grid.t[rows].tolist(), strict=True):
                self._require_within_bounds(solution, t)
            if self._open:
                extremes += local.extremes(grid.t[rows], inner.q[rows], inner.v[rows], solutions)
        needed = demand(dynamics, grid, inner.q, inner.v, inner.a)
        states, others = self._under(inner, needed, self._friction(solved)), []
        for friction, endless in filled(states.friction, extremes):
            other = self._under(inner, needed, friction)
            part = held_part(self.closure, states.lam, other.lam)
            for stop in self.stops:
                part = np.minimum(part, pushing_part(*(stop.side * x.tau[:, stop.joint] for x in (states, other))))
            within = states.friction + part[:, None] * (friction - states.friction)
            far = endless & (part == 1.0)  # a cable that goes slack there is an end
            others.append(replace(self._under(inner, needed, within), endless=far if far.any() else None))
        return replace(states, others=tuple(others))

    def tried(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return completed states in which the friction of a stuck joint may exceed its bound, as beyond a switch."""
        inner, solved = self._solved(dynamics, grid, q, v)
        needed = demand(dynamics, grid, inner.q, inner.v, inner.a)
        return self._under(inner, needed, self._friction(solved))

    def _solved(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> tuple[CompletedStates, list[SolvedRows]]:
        """Return the motion under the friction of what slips, and the friction of all joints."""
        slowed = self.acting(dynamics)
        inner, solved = self.inner.complete(slowed, grid, q, v), list[SolvedRows]()
        for rows, local in ((rows, local.forces[FRICTION]) for rows, local in parts(slowed, grid)):
            assert isinstance(local, JointFriction)
            solved.append((rows, local, local.solutions(grid.t[rows], inner.q[rows], inner.v[rows])))
        return inner, solved

    def _friction(self, solved: Sequence[SolvedRows]) -> Array:
        """Return the friction of all rows, shape (n, k)."""
        each = [solution.f for _, _, solutions in solved for solution in solutions]
        return np.array(each).reshape(-1, len(self.friction.contacts))

    @property
    def _open(self) -> bool:
        """Whether several joints at rest hold one motion, or laws and stops hold joints with friction at rest."""
        contacts, stuck = self.friction.contacts, self.friction.slip.stuck
        grouped = {i for group in stuck for i in group.members}
        still = np.flatnonzero(sizes(contacts, self.friction.direction) == 0.0)
        shares = any(len({contacts[i].name for i in group.members}) > 1 for group in stuck)
        return shares or not grouped.issuperset(still.tolist())

    def _under(self, states: CompletedStates, needed: Array, friction: Array) -> CompletedStates:
        """Return states with the efforts and multipliers under friction of all joints, shape (n, k)."""
        rows = slip_rows(self.friction.closure.model, self.friction.contacts, states.q)
        loads = np.vecmat(friction, rows)
        left = needed - loads
        left[np.abs(left) <= ROUNDED * (np.abs(needed) + np.abs(loads))] = 0.0  # friction carries it alone
        if not self.friction.closure.size:  # nor is there anything else to carry what nothing drives
            left[:, ~self._driven] = 0.0
        tau, lam = self._efforts(states.q, left)
        return replace(states, tau=tau, lam=lam, friction=friction)

    @cached_property
    def _driven(self) -> Flags:
        """Mask of the joints that follow laws or rest on stops, alone or with others, shape (nv,)."""
        return driven_along(self.friction.prescribed.coordinates, self.friction.closure.model.nv)

    def _require_within_bounds(self, solution: FrictionSolution, t: float) -> None:
        """Raise where a step has gone past the switch of a joint."""
        for group, over in zip(self.friction.slip.stuck, self._beyond(solution), strict=True):
            if over:
                raise IntegrationError(
                    f"at t = {t:.9g} s the friction that holds {self.friction.contacts[group.first].name} exceeds its "
                    "bound: a step has gone past the instant at which it breaks loose",
                    expected="steps short enough for the loads that act on joints at rest",
                    hint="accuracy.tolerance",
                )

    def _beyond(self, solution: FrictionSolution) -> Flags:
        """Return a mask of the stuck groups held by more than their largest friction, shape (g,)."""
        slack = 2.0 * np.array(self.friction.slip.slack)
        return np.asarray(np.abs(solution.held) > solution.bounds * (1.0 + EXCEEDED) + slack)

    def _efforts(self, q: Array, needed: Array) -> tuple[Array, Array]:
        prescribed, own = self.friction.prescribed.linear_last()[0], self.friction.closure
        if not prescribed.names and not own.size:
            return np.zeros_like(needed), np.zeros((len(q), 0))
        along = np.zeros((len(q), 0))
        if prescribed.names:
            rows = own.with_guides(prescribed.names, prescribed.coordinates)
            along = rows.split_at(q).multipliers(needed)[:, own.size :]
        return efforts_of(prescribed, self.closure, q, needed, along)


def remarks_on_rest(systems: Iterable[System]) -> list[str]:
    """Return remarks on joints that friction holds together: only the sum of their friction is determined."""
    together = dict[str, None]()
    for system in systems:
        inner = getattr(system, "inner", None)  # controllers wrap what friction makes of a motion
        frictional = system if isinstance(system, FrictionalSystem) else inner
        if not isinstance(frictional, FrictionalSystem):
            continue
        for group in frictional.friction.slip.stuck:
            names = dict.fromkeys(frictional.friction.contacts[i].name for i in group.members)
            if len(names) > 1:
                together[", ".join(names)] = None
    return [
        f"friction holds {names} together: only its sum is determined. They are taken to share it in proportion to "
        "what each can hold, and the forces between them follow from that; NAME.least and NAME.greatest are the ends"
        for names in together
    ]
