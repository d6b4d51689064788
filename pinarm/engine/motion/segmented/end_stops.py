"""End stops of joints, and other stops: impacts with restitution, and what rests on a stop afterwards.

An impact changes velocities by the impulses of the stop and of the constraints: v+ is the velocity nearest to v-,
measured by the masses, with ``n v+ = -e n v-`` at the stop that is hit and ``G v+ = w'`` at loops and prescribed
coordinates (Newton's law of restitution with Gauss's principle; Moreau, Unilateral contact and dry friction in finite
freedom dynamics, 1988). A restitution of 1 keeps the energy. Stops push only: what would have to be pulled leaves
faster than that, or lets go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
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

REST = 1e-12
"""Velocity of what touches a stop that is rest, over the largest one in SI: rounding of a velocity that vanishes."""

CONTRADICTING = 1e-9
"""Velocity after an impact beyond the one that a stop asks for, over the largest before, that is none of rounding."""

WORKLESS = 1e-9
"""Work of drives in impacts, relative to the energy that these take, that rounding leaves."""

SLACK = 1e-13
"""Gap that counts as contact, relative to ``1 + |limit|``: where loops are closed, positions are right to 1e-14."""


Held = frozenset[int]
"""Numbers of the stops on which joints rest, and of the one-sided constraints that hold."""


def pressed(touched: Iterable[int], away: Callable[[Held], Mapping[int, float]]) -> Held:
    """Return which of several stops that are touched push: none that does pulls, and none that does not is entered.

    The solution of a linear complementarity problem, of which there is one where the masses tell the motion of every
    stop from those of the others: found by exchanging the first stop that contradicts itself (Murty, Note on a
    Bard-type scheme for solving the complementarity problem, 1974). Where rounding or friction let sets come again,
    stops that pull are let go one by one.

    Args:
        touched: The stops.
        away: Stops that push -> of these what they push, of the others how fast the motion leaves them.
    """
    held, known, seen = frozenset(touched), sorted(touched), set[Held]()
    while held not in seen:
        seen.add(held)
        found = away(held)
        wrong = [k for k in known if (found[k] <= 0.0 if k in held else found[k] < 0.0)]
        if not wrong:
            return held
        held ^= {wrong[0]}
    held = frozenset(known)
    while held and min((found := away(held))[k] for k in held) <= 0.0:
        held -= {min(held, key=found.__getitem__)}
    return held


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

    def acceleration(self, q: Array, v: Array, a: Array) -> float:
        """Return that of the coordinate that it bounds, in one state, shapes (nq,), (nv,) and (nv,)."""
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

    def acceleration(self, q: Array, v: Array, a: Array) -> float:
        """Return that of the joint."""
        return float(a[self.joint])

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

    def freedom(self, k: int, q: Array) -> float:
        """Return how much of the row of a stop the loops and laws leave free, 1 for all of it, 0 at a dead point.

        With the row n, and the accelerations ``a`` that it gives as a force to the mechanism and ``M^-1 n`` to its
        bodies without loops, ``(n a / n M^-1 n)^(1/2)``: a number without a unit.
        """
        rows, row = self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates), self.bounds[k].row(q)
        mass, split = mass_matrix(rows.model, q), split_rows(rows.rows(rows.state(q)), rows.reach)
        left = float(row @ solve(split, mass, row, np.zeros(rows.size)))
        return float((max(left, 0.0) / float(row @ np.linalg.lstsq(mass, row)[0])) ** 0.5)

    def impact(self, t: float, q: Array, v: Array, hit: Mapping[int, float], held: Iterable[int] = ()) -> Array:
        """Return the velocity after stops were met with the velocity v, shape (nv,).

        Other stops that are touched hold as long as they push.

        Args:
            t: The instant [s].
            q: Configuration, shape (nq,).
            v: Velocity before, shape (nv,).
            hit: Stops that are met, and for each the velocity up to which a rebound is none [rad/s or m/s].
            held: Stops that are rested on already.
        """
        back = dict.fromkeys(sorted({*self.near(q), *held}), 0.0)
        for k, least in hit.items():
            rebound = -self.bounds[k].restitution * self.rate(k, q, v)
            back[k] = rebound if abs(rebound) > least else 0.0
        return self._nearest(t, q, v, back)

    def energies(self, hits: Iterable[EventRecord]) -> tuple[float, float]:
        """Return the energy that impacts took, and the work that drives of coordinates on laws did in them [J].

        An impulse L of a stop takes its product with the mean of the velocities before and after, ``-L n (v- + v+)/2``.
        It calls for impulses p of the laws' rows, whose velocities w' stay: they do the work ``p . w'``.
        """
        taken = given = 0.0
        for hit in hits:
            assert hit.before is not None
            rows = self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)
            mass, own = mass_matrix(rows.model, hit.q), rows.rows(rows.state(hit.q))
            touched = [stop for k, stop in enumerate(self.bounds) if stop.name == hit.name or k in self.near(hit.q)]
            normals = np.array([stop.row(hit.q) for stop in touched])
            split = split_rows(np.vstack([own, normals]), np.append(rows.reach, [stop.reach for stop in touched]))
            place = [stop.name for stop in touched].index(hit.name)
            impulse = normals[place] * split.multipliers(mass @ (hit.v - hit.before))[len(own) + place]
            taken -= float(impulse @ (hit.before + hit.v)) / 2.0
            held = split_rows(own, rows.reach)
            change = solve(held, mass, impulse, np.zeros(len(own)))
            reactions = held.multipliers(mass @ change - impulse)[self.closure.size :]
            given += float(reactions @ self.prescribed.on(hit.t, hit.t)(hit.t)[1])
        return taken, given

    def _nearest(self, t: float, q: Array, v: Array, back: Mapping[int, float]) -> Array:
        """Return the velocity nearest to v that is at least the given one away from stops, which push only."""
        found: dict[Held, Array] = {}

        def away(pushing: Held) -> dict[int, float]:
            after, impulses = self._given(t, q, v, {k: back[k] for k in sorted(pushing)})
            found[pushing] = after
            left = {k: self.bounds[k].side * (self.rate(k, q, after) - back[k]) for k in back}
            faster = CONTRADICTING * float(np.abs(v).max(initial=0.0))  # than asked for: others that are tied to it are
            pushes = {k: -1.0 if left[k] > faster else self.bounds[k].side * impulse for k, impulse in impulses.items()}
            return left | pushes

        return found[pressed(back, away)]

    def rest(self, t: float, q: Array, v: Array, held: Held) -> Array:
        """Return the velocity nearest to v with which stops are rested on, shape (nv,)."""
        return self._given(t, q, v, dict.fromkeys(sorted(held), 0.0))[0]

    def _given(self, t: float, q: Array, v: Array, back: Mapping[int, float]) -> tuple[Array, dict[int, float]]:
        """Return the velocity nearest to v with given ones along the rows of stops, and the impulses of these."""
        rows = self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)
        model, own = rows.model, rows.rows(rows.state(q))
        mass = mass_matrix(model, q)
        normals = np.array([self.bounds[k].row(q) for k in back]).reshape(-1, model.nv)
        split = split_rows(np.vstack([own, normals]), np.append(rows.reach, [self.bounds[k].reach for k in back]))
        target = [np.zeros(self.closure.size), self.prescribed.on(t, t)(t)[1], np.array([*back.values()])]
        after = solve(split, mass, mass @ v, np.concatenate(target))
        return after, dict(zip(back, split.multipliers(mass @ (after - v))[len(own) :].tolist(), strict=True))


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
