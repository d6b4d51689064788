"""End stops of joints: impacts with restitution, and what rests on a stop afterwards.

An impact changes velocities by the impulses of the stop and of the constraints: v+ is the velocity nearest to v-,
measured by the masses, with ``n v+ = -e n v-`` at the stop that is hit and ``G v+ = w'`` at loops and prescribed
coordinates (Newton's law of restitution with Gauss's principle; Moreau, Unilateral contact and dry friction in finite
freedom dynamics, 1988). A restitution of 1 keeps the energy. Stops push only: those that would have to pull let go.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RowDecomposition
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.mechanics.coordinates import LinearCoordinate

RESTING = 1e-6
"""Velocity after an impact that is taken for rest [rad/s or m/s]: what is left to rise is 1e-13 m under gravity."""

SLACK = 1e-13
"""Gap that counts as contact, relative to ``1 + |limit|``: where loops are closed, positions are right to 1e-14."""


@dataclass(frozen=True)
class Bound:
    """One side of a joint's range.

    Attributes:
        name: For messages: the joint and the side.
        coordinate: The joint's coordinate.
        joint: Index of its velocity in v.
        limit: The coordinate's value at the stop [rad or m].
        side: 1 for a lower limit, -1 for an upper one: the way in which the stop pushes.
        restitution: e, velocity after an impact relative to that before, from 0 to 1.
    """

    name: str
    coordinate: LinearCoordinate
    joint: int
    limit: float
    side: float
    restitution: float

    @property
    def place(self) -> int:
        """Return the index of the coordinate in q."""
        return int(self.coordinate.places[self.joint])

    def gap(self, q: Array) -> Array:
        """Return the distance to the stop, negative beyond it, shape (...,)."""
        return np.asarray(self.side * (q[..., self.place] - self.limit))

    @property
    def slack(self) -> float:
        """Return the gap that counts as contact [rad or m]."""
        return SLACK * (1.0 + abs(self.limit))


@dataclass(frozen=True, eq=False)
class Contacts:
    """The stops of a mechanism.

    Attributes:
        closure: Constraints of the mechanism, without the prescribed coordinates.
        prescribed: Coordinates that follow laws.
        bounds: The stops.
    """

    closure: Closure
    prescribed: PrescribedCoordinates
    bounds: Sequence[Bound]

    def near(self, q: Array) -> list[int]:
        """Return the indices of the stops that a configuration touches."""
        return [k for k, bound in enumerate(self.bounds) if abs(bound.gap(q)) <= bound.slack]

    def impact(self, t: float, q: Array, v: Array, hit: Iterable[int]) -> Array:
        """Return the velocity after the stops ``hit`` were met with the velocity v, shape (nv,).

        What is slower afterwards than ``RESTING`` rests; other stops that are touched hold as long as they push.
        """
        touched, bounds = self.near(q), self.bounds
        back = {k: 0.0 for k in touched if abs(v[bounds[k].joint]) <= RESTING}
        for k in hit:
            rebound = -bounds[k].restitution * v[bounds[k].joint]
            back[k] = rebound if abs(rebound) > RESTING else 0.0
        return self._nearest(t, q, v, back)

    def _nearest(self, t: float, q: Array, v: Array, back: dict[int, float]) -> Array:
        """Return the velocity nearest to v with the given ones at stops, without those that would pull."""
        rows = self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)
        model = rows.model
        mass = mass_matrix(model, q)
        own = rows.rows(rows.state(q))
        target = np.concatenate([np.zeros(self.closure.size), self.prescribed.on(t, t)(t)[1]])
        while True:
            normals = np.eye(model.nv)[[self.bounds[k].joint for k in back]]
            split = RowDecomposition.of(np.vstack([own, normals]), np.append(rows.reach, np.ones(len(back))))
            after = solve(split, mass, mass @ v, np.concatenate([target, list(back.values())]))
            impulses = split.multipliers(mass @ (after - v))[len(own) :]
            pushes = {k: self.bounds[k].side * impulse for k, impulse in zip(back, impulses, strict=True)}
            pulling = [k for k, push in pushes.items() if push < 0.0 and back[k] == 0.0]
            if not pulling:
                return after
            del back[min(pulling, key=pushes.__getitem__)]


def impact_remarks(model: pin.Model, events: Iterable[EventRecord]) -> list[str]:
    """Return for each end stop how often it was hit, when first, and the kinetic energy that its impacts took.

    Impacts are impulses, without a duration: no force of theirs is among the reactions, which has to be said.
    """
    impacts = dict[str, list[EventRecord]]()
    for event in events:
        if event.before is not None:
            impacts.setdefault(event.name, []).append(event)
    return [
        f"end stop '{name}': {len(hits)} impact{'s' if len(hits) > 1 else ''}, the first at t = {hits[0].t:.6g} s, "
        f"take{'' if len(hits) > 1 else 's'} {sum(_lost(model, hit) for hit in hits):.3g} J; "
        "they are impulses, whose forces are in no reaction"
        for name, hits in impacts.items()
    ]


def _lost(model: pin.Model, hit: EventRecord) -> float:
    """Return the kinetic energy that an impact took [J]."""
    mass = mass_matrix(model, hit.q)
    assert hit.before is not None
    return float(hit.before @ mass @ hit.before - hit.v @ mass @ hit.v) / 2.0
