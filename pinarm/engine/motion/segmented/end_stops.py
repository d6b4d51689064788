"""End stops of joints, and other stops: impacts with restitution, and what rests on a stop afterwards.

An impact changes velocities by the impulses of the stop and of the constraints: v+ is the velocity nearest to v-,
measured by the masses, with ``n v+ = -e n v-`` at the stop that is hit and ``G v+ = w'`` at loops and prescribed
coordinates (Newton's law of restitution with Gauss's principle; Moreau, Unilateral contact and dry friction in finite
freedom dynamics, 1988). A restitution of 1 keeps the energy. Stops push only: those that would have to pull let go.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspaces.nullspace import split_rows
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.mechanics.friction.contact import FrictionContact

RESTING = 1e-6
"""Velocity after an impact that is taken for rest [rad/s or m/s]: what is left to rise is 1e-13 m under gravity."""

WORKLESS = 1e-9
"""Work of drives in impacts, relative to the energy that these take, that rounding leaves."""

SLACK = 1e-13
"""Gap that counts as contact, relative to ``1 + |limit|``: where loops are closed, positions are right to 1e-14."""


class Stop(Protocol):
    """What a motion may meet with an impact, rest on, and leave."""

    @property
    def name(self) -> str:
        """For messages and events."""
        ...

    @property
    def title(self) -> str:
        """What it is, with its name."""
        ...

    @property
    def side(self) -> float:
        """Sense in which it pushes along its row, 1 or -1."""
        ...

    @property
    def restitution(self) -> float:
        """Velocity after an impact relative to that before, from 0 to 1."""
        ...

    @property
    def slack(self) -> float:
        """Return the gap that counts as contact."""
        ...

    @property
    def reach(self) -> float:
        """Length that its row can have."""
        ...

    def gap(self, q: Array) -> Array:
        """Return the distance to it, negative beyond it, shape (...,)."""
        ...

    def row(self, q: Array) -> Array:
        """Return the row of the coordinate that it bounds, shape (nv,)."""
        ...


class Bound(ValueRecord, frozen=True):
    """One side of a joint's range.

    Attributes:
        name: For messages: the joint and the side.
        coordinate: The joint's coordinate.
        joint: Index of its velocity in v.
        limit: The coordinate's value at the stop [rad or m].
        side: 1 for a lower limit, -1 for an upper one: the way in which the stop pushes.
        restitution: e, velocity after an impact relative to that before, from 0 to 1.
        reach: Length of its row.
    """

    name: str
    coordinate: LinearCoordinate
    joint: int
    limit: float
    side: float
    restitution: float
    reach: float = 1.0

    @property
    def title(self) -> str:
        """That it is an end stop, with its name."""
        return f"end stop '{self.name}'"

    def row(self, q: Array) -> Array:
        """Return the unit vector of the joint, shape (nv,)."""
        return self.coordinate.weights

    @property
    def place(self) -> int:
        """Return the index of the coordinate in q."""
        return int(self.coordinate.places[self.joint])

    def gap(self, q: Array) -> Array:
        """Return the distance to the stop, negative beyond it, shape (...,)."""
        return np.asarray(self.side * (q[..., self.place] - self.limit))

    def passed_at_start(self, q: Array) -> str:
        """Return what is wrong with a motion that begins at a configuration, shape (nq,), beyond the stop."""
        unit = self.coordinate.unit
        return f"the motion begins at {q[self.place]:.6g} {unit}, beyond the {self.title} at {self.limit:.6g} {unit}"

    @property
    def slack(self) -> float:
        """Return the gap that counts as contact [rad or m]."""
        return SLACK * (1.0 + abs(self.limit))


class Contacts(Record, frozen=True):
    """The stops of a mechanism.

    Attributes:
        closure: Constraints of the mechanism that always hold, without the prescribed coordinates.
        prescribed: Coordinates that follow laws.
        bounds: The stops.
    """

    closure: Closure
    prescribed: PrescribedCoordinates
    bounds: Sequence[Stop]

    def near(self, q: Array) -> list[int]:
        """Return the indices of the stops that a configuration touches."""
        return [k for k, bound in enumerate(self.bounds) if abs(bound.gap(q)) <= bound.slack]

    def rate(self, k: int, q: Array, v: Array) -> float:
        """Return the velocity along the row of a stop."""
        return float(self.bounds[k].row(q) @ v)

    def impact(self, t: float, q: Array, v: Array, hit: Iterable[int], held: Iterable[int] = ()) -> Array:
        """Return the velocity after the stops ``hit`` were met with the velocity v, shape (nv,).

        What is slower afterwards than ``RESTING`` rests; other stops that are touched hold as long as they push.

        Args:
            t: The instant [s].
            q: Configuration, shape (nq,).
            v: Velocity before, shape (nv,).
            hit: Stops that are met.
            held: Stops that are rested on already.
        """
        touched = {*self.near(q), *held}
        back = {k: 0.0 for k in sorted(touched) if k in held or abs(self.rate(k, q, v)) <= RESTING}
        for k in hit:
            rebound = -self.bounds[k].restitution * self.rate(k, q, v)
            back[k] = rebound if abs(rebound) > RESTING else 0.0
        return self._nearest(t, q, v, back)

    def energies(self, hits: Iterable[EventRecord]) -> tuple[float, float]:
        """Return the energy that impacts took, and the work that drives of coordinates on laws did in them [J].

        With the multipliers p of the laws' rows in ``M (v+ - v-) = G^T lam + P^T p + N^T Lam`` the work is ``p . w'``,
        as w' stays, and ``T(v-) - T(v+) + p . w'`` is taken: the impulses of the stops times their mean velocities.
        """
        taken = given = 0.0
        for hit in hits:
            assert hit.before is not None
            model, rows = (
                self.closure.model,
                self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates),
            )
            mass, own = mass_matrix(model, hit.q), rows.rows(rows.state(hit.q))
            touched = [stop for k, stop in enumerate(self.bounds) if stop.name == hit.name or k in self.near(hit.q)]
            normals = np.array([stop.row(hit.q) for stop in touched]).reshape(-1, model.nv)
            split = split_rows(np.vstack([own, normals]), np.append(rows.reach, [stop.reach for stop in touched]))
            impulses = split.multipliers(mass @ (hit.v - hit.before))[self.closure.size : len(own)]
            work = float(impulses @ self.prescribed.on(hit.t, hit.t)(hit.t)[1])
            taken += 0.5 * float(hit.before @ mass @ hit.before - hit.v @ mass @ hit.v) + work
            given += work
        return taken, given

    def _nearest(self, t: float, q: Array, v: Array, back: dict[int, float]) -> Array:
        """Return the velocity nearest to v with the given ones at stops, without those that would pull."""
        rows = self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)
        model = rows.model
        mass = mass_matrix(model, q)
        own = rows.rows(rows.state(q))
        target = np.concatenate([np.zeros(self.closure.size), self.prescribed.on(t, t)(t)[1]])
        while True:
            normals = np.array([self.bounds[k].row(q) for k in back]).reshape(-1, model.nv)
            reach = np.append(rows.reach, [self.bounds[k].reach for k in back])
            split = split_rows(np.vstack([own, normals]), reach)
            after = solve(split, mass, mass @ v, np.concatenate([target, list(back.values())]))
            impulses = split.multipliers(mass @ (after - v))[len(own) :]
            pushes = {k: self.bounds[k].side * impulse for k, impulse in zip(back, impulses, strict=True)}
            pulling = [k for k, push in pushes.items() if push < 0.0 and back[k] == 0.0]
            if not pulling:
                return after
            del back[min(pulling, key=pushes.__getitem__)]


def impact_remarks(contacts: Contacts, events: Iterable[EventRecord]) -> list[str]:
    """Return for each stop how often it was hit, when first, and the energy that its impacts took.

    Impacts are impulses, without a duration: no force of theirs is among the reactions, which has to be said. What
    keeps a coordinate on its law does work in them where it moves.
    """
    impacts, titles = dict[str, list[EventRecord]](), {stop.name: stop.title for stop in contacts.bounds}
    for event in events:
        if event.before is not None:
            impacts.setdefault(event.name, []).append(event)
    return [_impact_remark(titles[name], hits, *contacts.energies(hits)) for name, hits in impacts.items()]


def frictionless_remarks(frictions: Sequence[FrictionContact], events: Iterable[EventRecord]) -> list[str]:
    """Return that impacts have no impulse of friction, where there are any and friction depends on loads.

    In an impact mu times the impulses of reactions would be of its size. Where a slip reverses meanwhile it depends on
    the course of the impact, of which a restitution tells nothing.
    """
    names = dict.fromkeys(friction.name for friction in frictions if friction.law.loaded)
    if not names or all(event.before is None for event in events):
        return []
    return [f"impacts are without the impulses of friction that their reactions would cause in {', '.join(names)}"]


def _impact_remark(title: str, hits: Sequence[EventRecord], taken: float, given: float) -> str:
    several = len(hits) > 1
    done = abs(given) > WORKLESS * taken
    work = f"; the drives of coordinates that follow laws do {given:.3g} J of work in them" if done else ""
    return (
        f"{title}: {len(hits)} impact{'s' if several else ''}, the first at t = {hits[0].t:.6g} s, "
        f"take{'' if several else 's'} {taken:.3g} J{work}; they are impulses, whose forces are in no reaction"
    )
