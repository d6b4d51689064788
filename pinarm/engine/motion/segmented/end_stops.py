"""Stops of a motion: end stops of joints and one-sided constraints, impacts with restitution, and contacts at rest.

An impact changes velocities by the impulses of the stop and of the constraints: v+ is the velocity nearest to v-,
measured by the masses, with ``n v+ = -e n v-`` at the stop that is hit and ``G v+ = w'`` at loops and prescribed
coordinates (Newton's law of restitution with Gauss's principle; Moreau, Unilateral contact and dry friction in finite
freedom dynamics, 1988). A restitution of 1 keeps the energy. Stops push only: what would have to be pulled leaves
faster than that, or lets go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.constraints.nullspace import Decomposition
from pinarm.engine.dynamics.equation import mass_matrix, solve
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Constraint, LinearCoordinate
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.motion.trajectory import EventRecord
    from pinarm.mechanics.friction.contact import FrictionContact

REST = 1e-12
"""Velocity of what touches a stop that is rest, over the largest one in SI: rounding of a velocity that vanishes."""

CONTRADICTING = 1e-9
"""Difference of a velocity after an impact from the one that a stop asks for, over the largest before, that is none of
rounding."""

TIED = 1e-9
"""Part of a stop's row that is rounding: with no more beside those of others its coordinate moves only with theirs."""

SLACK = 1e-13
"""Gap that counts as contact, relative to ``size + |limit|``: where loops are closed, positions are right to 1e-14."""

TOUCHING = 1e-11
"""Gap of a one-sided constraint that counts as contact, relative to the extent and the unit that suits it, or to 2 rad:
closed by Newton's method, it is right to 1e-14."""

OPENED = " opens"
"""End of the name of an event at which a constraint opens."""

Held = frozenset[int]
"""Numbers of the stops on which joints rest, and of the one-sided constraints that hold."""


class Bound(ValueRecord, frozen=True):
    """One side of a joint's range, met with a restitution from 0 to 1.

    ``side`` is 1 for a lower limit, -1 for an upper one: the way in which the stop pushes. ``joint`` is the index
    of its velocity in v, ``reach`` the length of its row, ``size`` that of the motion in SI, see
    ``HybridSystem.size``; in loops that of their lengths.
    """

    name: str
    coordinate: LinearCoordinate
    joint: int
    limit: float
    side: float
    restitution: float
    reach: float = 1.0
    size: float = 1.0

    @property
    def title(self) -> str:
        return f"end stop '{self.name}'"

    def row(self, q: Array) -> Array:
        return self.coordinate.weights

    def acceleration(self, q: Array, v: Array, a: Array) -> float:
        return float(a[self.joint])

    @property
    def unit(self) -> Unit:
        return self.coordinate.unit

    @property
    def place(self) -> int:
        return int(self.coordinate.places[self.joint])

    def gap(self, q: Array) -> Array:
        return np.asarray(self.side * (q[..., self.place] - self.limit))

    def passed_at_start(self, q: Array) -> str:
        unit = self.coordinate.unit
        return f"the motion begins at {q[self.place]:.6g} {unit}, beyond the {self.title} at {self.limit:.6g} {unit}"

    @property
    def slack(self) -> float:
        return SLACK * (self.size + abs(self.limit))


class Separation(Record, frozen=True):
    """A one-sided constraint, and a closure of it alone, as a stop that is met without rebound, and left."""

    unshown = ("closure",)

    constraint: Constraint
    closure: Closure
    restitution: float = 0.0

    @property
    def name(self) -> str:
        return self.constraint.name

    @property
    def title(self) -> str:
        return f"{self.constraint.kind} '{self.name}'"

    @property
    def side(self) -> float:
        return self.constraint.side

    @cached_property
    def slack(self) -> float:
        return float(TOUCHING * (self.closure.measure[0] + self.closure.reach[0]))

    @property
    def unit(self) -> Unit:
        return self.constraint.unit(0)

    @property
    def reach(self) -> float:
        """Length that its row can have."""
        return float(self.closure.reach[0])

    def gap(self, q: Array) -> Array:
        """Return by how much it is open at configurations, shape (..., nq), as an array of shape (...)."""
        gaps, _ = self.closure.at(q.reshape(-1, q.shape[-1]))
        return np.asarray(self.side * gaps[:, 0].reshape(q.shape[:-1]))

    def passed_at_start(self, q: Array) -> str:
        return f"at the start the {self.title} is passed by {-float(self.gap(q)):.6g} {self.unit}"

    def row(self, q: Array) -> Array:
        return np.asarray(self.closure.rows(self.closure.state(q))[0])

    def acceleration(self, q: Array, v: Array, a: Array) -> float:
        """Return the acceleration of its gap, but for the sign."""
        state = self.closure.state(q, v)
        return float(self.closure.rows(state)[0] @ a + self.closure.drift(state)[0])


Stop = Bound | Separation
"""An obstacle that a motion may meet with an impact, rest on, and leave."""


def separations_of(closure: Closure) -> tuple[Separation, ...]:
    """Return the one-sided constraints of a mechanism."""
    every = one_sided(closure.constraints)
    return tuple(Separation(constraint, Closure.of(closure.model, [constraint])) for constraint in every)


def opening_remarks(stops: Sequence[Stop], events: Iterable[EventRecord]) -> list[str]:
    """Return for each constraint that opened how often it did, when and where first."""
    events, remarks = list(events), []
    for stop in (stop for stop in stops if isinstance(stop, Separation)):
        if opened := [event for event in events if event.name == stop.name + OPENED]:
            first = opened[0]
            often = f", {len(opened)} times" if len(opened) > 1 else ""
            remarks.append(f"{stop.title}: {stop.constraint.opens}, first at t = {first.t:.6g} s{often}")
    return remarks


def pressed(
    touched: Iterable[int],
    away: Callable[[Held], Mapping[int, float]],
    ties: Callable[[Held, int], Mapping[int, float]],
    slight: Callable[[], float],
) -> Held:
    """Return the touched stops that push: none of them pulls, and the motion enters none of the others.

    This linear complementarity problem is solved by exchanging the first stop that contradicts itself (Murty, Note on a
    Bard-type scheme for solving the complementarity problem, 1974). A stop that moves only with pushing stops replaces
    the first of these that it would relieve (the criss-cross method of den Hertog, Roos and Terlaky, The linear
    complementarity problem, sufficient matrices, and the criss-cross method, 1993): only the sum of their pushes is
    determined. If sets recur by rounding or friction, stops that pull are released one by one.

    Args:
        touched: Indices of the touched stops.
        away: Stops that push -> their pushes, and the rates at which the motion leaves the others.
        ties: Stops that push, and another stop -> changes of its coordinate with theirs, each counted away from the
            stop; empty where it moves by itself as well.
        slight: Rate at which, by rounding, the motion may seem to enter a stop that moves only with others.
    """
    known, seen, first = sorted(touched), set[Held](), frozenset[int]()
    for k in known:
        first |= frozenset() if ties(first, k) else {k}
    held = first
    while held not in seen:
        seen.add(held)
        leaving = away(held)
        moving = {k: ties(held, k) for k in known if k not in held and leaving[k] < 0.0}
        wrong = [
            k
            for k in known
            if (k in held and leaving[k] <= 0.0) or (k in moving and (not moving[k] or leaving[k] < -slight()))
        ]
        if not wrong:
            return held
        relieved = [k for k, with_it in sorted(moving.get(wrong[0], {}).items()) if with_it > TIED]
        held ^= {wrong[0], *relieved[:1]}
    held = first
    while held and min((leaving := away(held))[k] for k in held) <= 0.0:
        held -= {min(held, key=leaving.__getitem__)}
    return held


class Contacts(Record, frozen=True):
    """The stops of a mechanism, beside constraints that always hold and coordinates that follow laws."""

    closure: Closure
    prescribed: PrescribedCoordinates
    bounds: Sequence[Stop]

    @cached_property
    def guided(self) -> Closure:
        return self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)

    def near(self, q: Array) -> list[int]:
        return [k for k, bound in enumerate(self.bounds) if abs(bound.gap(q)) <= bound.slack]

    def rate(self, k: int, q: Array, v: Array) -> float:
        return float(self.bounds[k].row(q) @ v)

    def freedom(self, k: int, q: Array) -> float:
        """Return the freedom that loops and laws leave to a stop's row: 1 for all of it, 0 at a dead point; no unit.

        ``(n a / n M^-1 n)^(1/2)`` of the row n: as a force, n gives the mechanism the accelerations ``a``, and its
        bodies without loops ``M^-1 n``.
        """
        rows, row = self.guided, self.bounds[k].row(q)
        mass, split = mass_matrix(rows.model, q), Decomposition.of(rows.rows(rows.state(q)), rows.reach)
        left = float(row @ solve(split, mass, row, np.zeros(rows.size)))
        return float((max(left, 0.0) / float(row @ np.linalg.lstsq(mass, row)[0])) ** 0.5)

    def impact(self, t: float, q: Array, v: Array, hit: Mapping[int, float], held: Iterable[int] = ()) -> Array:
        """Return the velocity after stops were met with the velocity v, shape (nv,).

        Other stops that are touched, or ``held`` already, hold as long as they push. ``hit`` has for each stop
        that is met the velocity up to which a rebound is none [rad/s or m/s].
        """
        back = dict.fromkeys(sorted({*self.near(q), *held}), 0.0)
        for k, least in hit.items():
            rebound = -self.bounds[k].restitution * self.rate(k, q, v)
            back[k] = rebound if abs(rebound) > least else 0.0
        return self._nearest(t, q, v, back)

    def ties(self, q: Array, held: Held, k: int) -> dict[int, float]:
        """Return by how much the coordinate of stop k changes with those of others; see ``pressed``."""
        if not held:
            return {}
        rows, others = self.guided, sorted(held)
        normals = np.array([self.bounds[k].side * self.bounds[k].row(q) for k in [k, *others]])
        every, reach = np.vstack([rows.rows(rows.state(q)), normals[1:]]), [self.bounds[k].reach for k in others]
        parts = Decomposition.of(every, np.append(rows.reach, reach)).multipliers(normals[0])
        if np.abs(normals[0] - parts @ every).max() > TIED * np.abs(normals[0]).max():
            return {}
        return dict(zip(others, parts[rows.size :].tolist(), strict=True))

    def _nearest(self, t: float, q: Array, v: Array, back: Mapping[int, float]) -> Array:
        """Return the velocity nearest to v that is at least the given one away from stops, which push only."""
        velocities, size = dict[Held, Array](), float(np.abs(v).max(initial=0.0))

        def away(pushing: Held) -> dict[int, float]:
            after, impulses = self._given(t, q, v, {k: back[k] for k in sorted(pushing)})
            velocities[pushing] = after
            left = {k: self.bounds[k].side * (self.rate(k, q, after) - back[k]) for k in back}
            return left | {k: self.bounds[k].side * impulse for k, impulse in impulses.items()}

        held = pressed(back, away, partial(self.ties, q), lambda: CONTRADICTING * size)
        left = away(held)
        if any(back.values()) and any(left[k] < -CONTRADICTING * size for k in back if k not in held):
            return self._nearest(t, q, v, dict.fromkeys(back, 0.0))
        return velocities[held]

    def rest(self, t: float, q: Array, v: Array, held: Held) -> Array:
        """Return the velocity nearest to v with which stops are rested on, shape (nv,)."""
        return self._given(t, q, v, dict.fromkeys(sorted(held), 0.0))[0]

    def _given(self, t: float, q: Array, v: Array, back: Mapping[int, float]) -> tuple[Array, dict[int, float]]:
        """Return the velocity nearest to v with given ones along the rows of stops, and the impulses of these."""
        rows, mass = self.guided, mass_matrix(self.guided.model, q)
        own = rows.rows(rows.state(q))
        normals = np.array([self.bounds[k].row(q) for k in back]).reshape(-1, rows.model.nv)
        split = Decomposition.of(np.vstack([own, normals]), np.append(rows.reach, [self.bounds[k].reach for k in back]))
        target = [np.zeros(self.closure.size), self.prescribed.on(t, t)(t)[1], np.array([*back.values()])]
        after = solve(split, mass, mass @ v, np.concatenate(target))
        return after, dict(zip(back, split.multipliers(mass @ (after - v))[len(own) :].tolist(), strict=True))


def impact_remarks(contacts: Contacts, events: Iterable[EventRecord]) -> list[str]:
    """Return for each stop how often it was hit, when first, and the energy that its impacts took.

    Of stops that are hit at one instant it is what they take together. Impacts are impulses, without a duration: no
    force of theirs is among the reactions.
    """
    impacts: dict[tuple[str, ...], list[EventRecord]] = {}
    titles = {stop.name: stop.title for stop in contacts.bounds}
    hits = (event for event in events if event.before is not None)
    for _, at_once in groupby(hits, key=lambda hit: (hit.t, hit.v.tobytes())):
        first, *others = at_once
        impacts.setdefault(tuple(titles[hit.name] for hit in (first, *others)), []).append(first)
    return [
        _impact_remark(stops, first, sum(_energy(contacts, hit) for hit in (first, *others)), 1 + len(others))
        for stops, (first, *others) in impacts.items()
    ]


def _energy(contacts: Contacts, hit: EventRecord) -> float:
    """Return the energy that stops take in an impact [J]: that of the mechanism, and the work of drives that keep laws.

    Their impulses p, of the work ``p . w'``, are among those of the rows, which change the momentum: ``G^T p + N^T L =
    M (v+ - v-)``.
    """
    q, rows = hit.q, contacts.guided
    assert hit.before is not None
    own, stops = rows.rows(rows.state(q)), [stop for stop in contacts.bounds if stop.name == hit.name]
    stops += [contacts.bounds[k] for k in contacts.near(q) if contacts.bounds[k].name != hit.name]
    split = Decomposition.of(
        np.vstack([own, *(stop.row(q) for stop in stops)]), np.append(rows.reach, [stop.reach for stop in stops])
    )
    change = mass_matrix(rows.model, q) @ (hit.v - hit.before)
    law = contacts.prescribed.on(hit.t, hit.t)(hit.t)[1]
    work = split.multipliers(change)[contacts.closure.size : len(own)] @ law
    return float(work - 0.5 * (hit.before + hit.v) @ change)


def _impact_remark(stops: Sequence[str], first: EventRecord, energy: float, count: int) -> str:
    return (
        f"{' and '.join(stops)}: {count} impact{'s' if count > 1 else ''}, the first at t = {first.t:.6g} s, "
        f"take{'' if count > 1 else 's'} {max(energy, 0.0):.3g} J{', together' if len(stops) > 1 else ''}; they are "
        "impulses, whose forces are in no reaction"
    )


def frictionless_remarks(frictions: Sequence[FrictionContact], events: Iterable[EventRecord]) -> list[str]:
    """Return a remark that impacts omit impulses of friction, if a run has impacts and friction that depends on loads.

    Such an impulse would be mu times the impulses of the reactions. If a slip reverses during the impact, the impulse
    depends on the course of the impact, which a restitution does not give.
    """
    names = dict.fromkeys(friction.name for friction in frictions if friction.law.loaded)
    if not names or all(event.before is None for event in events):
        return []
    return [f"impacts are without the impulses of friction that their reactions would cause in {', '.join(names)}"]
