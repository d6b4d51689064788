"""Energy that impacts on stops take, for each stop where rigid bodies determine it.

Of stops that are met at one instant and hold one motion, only what they take together is determined.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS, SplitRows, split_rows
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.motion.segmented.end_stops import CONTRADICTING, Contacts, Stop
from pinarm.engine.motion.trajectory import EventRecord

if TYPE_CHECKING:
    from pinarm.mechanics.friction.contact import FrictionContact

WORKLESS = 1e-9
"""Work of drives in impacts, relative to the energy that these take, that rounding leaves."""


class ImpactLoss(NamedTuple):
    """Energy that stops took in their impacts.

    Attributes:
        times: Instants [s].
        energy: Loss in the impacts [J].
        work: Work of drives of coordinates that follow laws in them [J].
    """

    times: tuple[float, ...] = ()
    energy: float = 0.0
    work: float = 0.0

    def remark(self, stops: Sequence[str]) -> str:
        """Return how often stops with given titles were hit, when first, and the energy that it took."""
        several, done = len(self.times) > 1, abs(self.work) > WORKLESS * self.energy
        work = f"; the drives of coordinates that follow laws do {self.work:.3g} J of work in them" if done else ""
        together = ", together: only the sum is determined" if len(stops) > 1 else ""
        return (
            f"{' and '.join(stops)}: {len(self.times)} impact{'s' if several else ''}, the first at t = "
            f"{self.times[0]:.6g} s, take{'' if several else 's'} {self.energy:.3g} J{together}{work}; they are "
            "impulses, whose forces are in no reaction"
        )


def _taken(contacts: Contacts, hits: Sequence[EventRecord]) -> Iterator[tuple[tuple[str, ...], float, float]]:
    """Yield titles of stops that were met at one instant, the energy that they took and the work of drives.

    An impulse L of a stop takes its product with the mean of the velocities before and after, ``-L n (v- + v+)/2``. It
    calls for impulses p of the laws' rows, whose velocities w' stay: they do the work ``p . w'``. A stop that is met
    where rounding already leads away from it has pushed nothing.
    """
    hit, met = hits[0], {event.name for event in hits}
    assert hit.before is not None
    stops = _pushing(contacts, hit, hit.before, met)
    for stop in contacts.bounds:
        if stop.name in met - {pushing.name for pushing in stops}:
            yield (stop.title,), 0.0, 0.0
    if not stops:
        return
    rows = contacts.guided
    mass, own = mass_matrix(rows.model, hit.q), rows.rows(rows.state(hit.q))
    normals = np.array([stop.row(hit.q) for stop in stops])
    split = split_rows(np.vstack([own, normals]), np.append(rows.reach, [stop.reach for stop in stops]))
    impulses = split.multipliers(mass @ (hit.v - hit.before))[len(own) :]
    rates = normals @ (hit.before + hit.v) / 2.0
    law = contacts.prescribed.on(hit.t, hit.t)(hit.t)[1]
    held = split_rows(own, rows.reach)
    for some in _together(split, len(own), rates):
        if any(stops[k].name in met for k in some):
            impulse = impulses[some] @ normals[some]
            change = solve(held, mass, impulse, np.zeros(len(own)))
            reactions = held.multipliers(mass @ change - impulse)[contacts.closure.size :]
            titles = tuple(stops[k].title for k in some)
            yield titles, -float(impulses[some] @ rates[some]), float(reactions @ law)


def _pushing(contacts: Contacts, hit: EventRecord, before: Array, met: set[str]) -> list[Stop]:
    """Return the stops that may have pushed: those that are met, or touched, and left no faster than asked for."""
    q, faster = hit.q, CONTRADICTING * float(np.abs(before).max(initial=0.0))
    touched = {*contacts.near(q), *(k for k, stop in enumerate(contacts.bounds) if stop.name in met)}

    def left(k: int) -> float:
        stop = contacts.bounds[k]
        rebound = max(-stop.restitution * stop.side * contacts.rate(k, q, before), 0.0)
        return stop.side * contacts.rate(k, q, hit.v) - rebound

    return [contacts.bounds[k] for k in sorted(touched) if left(k) <= faster]


def _together(split: SplitRows, own: int, rates: Array) -> list[list[int]]:
    """Return the stops that took energy, those together of which only the sum is determined.

    With the self-stresses z of the rows these are stops whose energies ``z n v`` are changed by one.

    Args:
        split: Rows of the constraints and laws, then of the stops.
        own: Number of the former.
        rates: ``n (v- + v+) / 2`` of the stops, shape (k,).
    """
    size = float(np.abs(rates).max(initial=0.0)) or 1.0
    shares = split.stresses[own:] * (rates / size)[:, None]
    tied = np.abs(shares @ np.linalg.pinv(shares, rcond=ACTS)) > ACTS
    tied |= np.eye(len(rates), dtype=bool)
    for _ in rates:
        tied = tied @ tied
    return [list(group) for group in dict.fromkeys(tuple(np.flatnonzero(row).tolist()) for row in tied)]


def impact_remarks(contacts: Contacts, events: Iterable[EventRecord]) -> list[str]:
    """Return for each stop how often it was hit, when first, and the energy that its impacts took.

    Impacts are impulses, without a duration: no force of theirs is among the reactions, as the remarks say. Drives that
    keep a coordinate on its law do work in them where it moves.
    """
    losses, hits = dict[tuple[str, ...], ImpactLoss](), (event for event in events if event.before is not None)
    for (t, _), at_once in groupby(hits, key=lambda hit: (hit.t, hit.v.tobytes())):
        for stops, energy, work in _taken(contacts, list(at_once)):
            loss = losses.get(stops, ImpactLoss())
            losses[stops] = ImpactLoss((*loss.times, t), loss.energy + energy, loss.work + work)
    return [loss.remark(stops) for stops, loss in losses.items()]


def frictionless_remarks(frictions: Sequence[FrictionContact], events: Iterable[EventRecord]) -> list[str]:
    """Return that impacts have no impulse of friction, where there are any and friction depends on loads.

    In an impact mu times the impulses of reactions would be of its size. Where a slip reverses meanwhile it depends on
    the course of the impact, of which a restitution tells nothing.
    """
    names = dict.fromkeys(friction.name for friction in frictions if friction.law.loaded)
    if not names or all(event.before is None for event in events):
        return []
    return [f"impacts are without the impulses of friction that their reactions would cause in {', '.join(names)}"]
