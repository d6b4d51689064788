"""Constraints that push only, or pull only, as what may be met and left: cams closed by a force, and cables.

While one holds it is a constraint like any other. Where its multiplier would change sign it opens, and its row is left
out; where its gap closes again an impact without rebound makes it hold, as an end stop does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint import OneSidedConstraint, one_sided
from pinarm.engine.motion.segmented.end_stops import Stop
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.input.units import Unit
from pinarm.records import Record

TOUCHING = 1e-11
"""Gap that counts as contact, relative to the extent and the unit that suits it, or to 2 rad: closed by Newton's
method, it is right to 1e-14."""

OPENED = " opens"
"""End of the name of an event at which a constraint opens."""


class Separation(Record, frozen=True):
    """A one-sided constraint as what a motion may meet and leave; see ``end_stops.Stop``.

    Attributes:
        constraint: The constraint.
        closure: The same, alone.
        restitution: 0: it does not rebound.
    """

    unshown = ("closure",)

    constraint: OneSidedConstraint
    closure: Closure
    restitution: float = 0.0

    @property
    def name(self) -> str:
        """Its name."""
        return self.constraint.name

    @property
    def title(self) -> str:
        """Its kind and name."""
        return f"{self.constraint.kind} '{self.name}'"

    @property
    def side(self) -> float:
        """Sense in which it acts, and sign of its gap where it is open."""
        return self.constraint.side

    @cached_property
    def slack(self) -> float:
        """The gap that counts as contact [m or rad]."""
        return float(TOUCHING * (self.closure.measure[0] + self.closure.reach[0]))

    @property
    def unit(self) -> Unit:
        """Unit of the gap."""
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
        """Return what is wrong with a motion that begins at a configuration, shape (nq,), in which it is overdrawn."""
        return f"at the start the {self.title} is passed by {-float(self.gap(q)):.6g} {self.constraint.unit(0)}"

    def row(self, q: Array) -> Array:
        """Return its row of G, shape (nv,)."""
        return np.asarray(self.closure.rows(self.closure.state(q))[0])

    def acceleration(self, q: Array, v: Array, a: Array) -> float:
        """Return that of its gap, but for the sign."""
        state = self.closure.state(q, v)
        return float(self.closure.rows(state)[0] @ a + self.closure.drift(state)[0])


def separations_of(closure: Closure) -> tuple[Separation, ...]:
    """Return the one-sided constraints of a mechanism."""
    return tuple(Separation(one, Closure.of(closure.model, [one])) for one in one_sided(closure.constraints))


def opening_remarks(stops: Sequence[Stop], events: Iterable[EventRecord]) -> list[str]:
    """Return for each constraint that opened how often it did, when and where first."""
    events, remarks = list(events), []
    for one in (stop for stop in stops if isinstance(stop, Separation)):
        if opened := [event for event in events if event.name == one.name + OPENED]:
            first = opened[0]
            where = ", ".join(filter(None, (f"t = {first.t:.6g} s", one.constraint.whereabouts(first.q))))
            often = f", {len(opened)} times" if len(opened) > 1 else ""
            remarks.append(f"{one.title}: {one.constraint.opens}, first at {where}{often}")
    return remarks
