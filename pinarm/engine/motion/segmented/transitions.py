"""Transition at an event: the impact, the stops that are rested on afterwards, and the slip of joints with friction.

At an impact the impulse changes the velocities; at a contact that closes or opens a constraint is added or removed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.friction.slip import Slip
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.motion.segmented.end_stops import TIED, Bound, Held, pressed
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem, Mode
from pinarm.engine.motion.segmented.segment_ends import SegmentEnd
from pinarm.engine.motion.segmented.segments import SegmentedMotion
from pinarm.engine.motion.systems import System
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.errors import IntegrationError
from pinarm.records import Record

DEAD = 10.0
"""Free part of the row of a stop in loops, over the root of the tolerance, up to which it is at a dead point: from
there a motion turns within the tolerance of the size of its links."""

SLIGHT = 1e-9
"""Acceleration of a joint that breaks loose, over that without friction, that may be rounding."""


class Transitions(Record, frozen=True):
    """Changes of the motion of a mechanism by events."""

    hybrid: HybridSystem

    def begun(self, motion: SegmentedMotion, t: float, q: Array, v: Array) -> Array:
        """Return the velocity with which a motion begins that may move towards stops that it touches, shape (nv,)."""
        contacts, bounds = self.hybrid.contacts, self.hybrid.bounds
        approached = [k for k in contacts.near(q) if self._approaches(k, q, v)]
        after = contacts.impact(t, q, v, self._slow(approached, t, q, v)) if approached else v
        motion.events.extend(EventRecord(bounds[k].name, t, q, after, v) for k in approached)
        return after

    def met(self, held: Held, end: SegmentEnd) -> list[int]:
        """Return the stops that are hit at the end of a segment, whatever ended it.

        Of several that are met at one instant a segment ends at one; the others are as near, or passed by rounding.
        """
        bounds = self.hybrid.bounds
        others = {*range(len(bounds))} - held - {end.hit}
        passed = {k for k in others if bounds[k].gap(end.q) <= bounds[k].slack}
        approached = {k for k in passed if self._approaches(k, end.q, end.v)}
        return sorted(approached if end.hit is None else approached | {end.hit})

    def after_impact(
        self, motion: SegmentedMotion, held: Held, end: SegmentEnd, met: Sequence[int]
    ) -> tuple[Array, Array]:
        """Return the state after stops were met: exactly on them, with the velocity after the impact.

        Raises:
            IntegrationError: One is met where the motion turns, as at a dead point of a linkage: whether there is an
                impact, which turns the motion back, is below the accuracy of the integration.
        """
        hybrid, t, q = self.hybrid, end.t, end.q.copy()
        for bound in (hybrid.bounds[k] for k in met):
            if isinstance(bound, Bound):
                q[bound.place] = bound.limit
        closing = hybrid.separations.intersection(met)
        if closing:
            stops = hybrid.with_stops(held)
            q = assembled(hybrid.closure_of(held | closing), stops, q, stops.on(t, t)(t)[0], t)
        for k in met:
            self._require_clear(motion, k, held, end)
        return q, hybrid.contacts.impact(t, q, end.v, self._slow(met, t, q, end.v), held & hybrid.separations)

    def _require_clear(self, motion: SegmentedMotion, k: int, held: Held, end: SegmentEnd) -> None:
        """Raise where a motion at a dead point would turn before it is past a stop by more than the errors of steps."""
        hybrid, bound, error = self.hybrid, self.hybrid.bounds[k], self.hybrid.method.tolerance
        if not isinstance(bound, Bound) or hybrid.contacts.freedom(k, end.q) > DEAD * error**0.5:
            return
        speed, away = self._speed(k, end.q, end.v), min(self._accelerations_away(k, held, end.t, end.q, end.v))
        reach, unit = error * (hybrid.size + abs(bound.limit)), bound.coordinate.unit
        if away > 0.0 and speed**2 <= 2.0 * away * reach:
            raise IntegrationError(
                f"at t = {end.t:.9g} s the motion turns at the {bound.title}, to {speed**2 / (2.0 * away):.1g} {unit}: "
                "whether it meets it is below the accuracy of the integration",
                expected=f"a stop farther than {reach:.1g} {unit} from where the motion turns, as at a dead point",
                hint="move the stop, or leave it out",
                partial=motion, t=end.t,
            )  # fmt: skip

    def settled(
        self, motion: SegmentedMotion, t: float, q: Array, v: Array, mode: Mode, before: Held
    ) -> tuple[Array, Mode]:
        """Return the velocity and the mode with joints at rest on stops that they begin to rest on.

        A joint that is slow enough to rest there has hit the stop a last time.
        """
        hybrid, contacts = self.hybrid, self.hybrid.contacts
        begun = [k for k in sorted(mode.held - before) if abs(contacts.rate(k, q, v)) > hybrid.still(k, v)]
        if not begun:
            return v, mode
        after = contacts.rest(t, q, v, mode.held)
        motion.events.extend(EventRecord(hybrid.bounds[k].name, t, q, after, v) for k in begun)
        return self.settled(motion, t, q, after, self.mode(t, q, after, mode.held), before.union(begun))

    def _approaches(self, k: int, q: Array, v: Array) -> bool:
        return self._speed(k, q, v) < -self.hybrid.still(k, v)

    def _speed(self, k: int, q: Array, v: Array) -> float:
        """Return the velocity of a state away from a stop."""
        return self.hybrid.bounds[k].side * self.hybrid.contacts.rate(k, q, v)

    def _slow(self, stops: Iterable[int], t: float, q: Array, v: Array) -> dict[int, float]:
        """Return the velocities up to which a joint that touches stops rests on them [rad/s or m/s].

        With them it would rise by no gap under the accelerations along the stop that there are, ``u^2 / (2 a)``: which
        of them presses it back depends on what else is held.
        """
        slow = {k: self.hybrid.still(k, v) for k in stops}
        for k in (k for k, still in slow.items() if abs(self._speed(k, q, v)) > still):
            most = max(map(abs, self._accelerations_away(k, frozenset(slow) - {k}, t, q, v)))
            slow[k] = max(slow[k], (2.0 * most * self.hybrid.bounds[k].slack) ** 0.5)
        return slow

    def _accelerations_away(self, k: int, others: Held, t: float, q: Array, v: Array) -> list[float]:
        """Return the accelerations of a state away from a stop: without stops, and on others; with friction too."""
        hybrid, bound = self.hybrid, self.hybrid.bounds[k]
        accelerations = [hybrid.acceleration_without_friction(held, t, q, v) for held in {frozenset(), others}]
        if hybrid.frictions:
            slipping = hybrid.stretch(Mode(frozenset(), hybrid.slip(frozenset(), t, q, v)), t, q, v)
            accelerations.append(hybrid.completed(slipping, np.array([t]), q[None], v[None]).a[0])
        return [bound.side * bound.acceleration(q, v, a) for a in accelerations]

    def following(self, mode: Mode, end: SegmentEnd) -> tuple[Array, Mode]:
        """Return the velocity and the mode after the end of a segment that does not end the run."""
        hybrid, t, q, v, index = self.hybrid, end.t, end.q, end.v, end.slip
        if end.released is not None:
            tied = hybrid.tied(mode.held, self.at_rest(t, q, v), q)  # any of them may take over what it held
            return v, self._pressing((mode.held | tied) - {end.released}, t, q, v)
        if index is None:
            return v, self.mode(t, q, v, mode.held & hybrid.separations)
        friction, span = hybrid.friction(mode.held), hybrid.span(t)
        switch = friction.switch(span, q, v, mode.slip, index)
        v, touched = switch.v, self.at_rest(t, q, switch.v) - mode.held
        after = Mode(mode.held, friction.after(span, q, switch))
        if touched and index >= 0:  # a rebound so small that it ends where the stop is, but for rounding
            return v, self.mode(t, q, v, mode.held & hybrid.separations)

        def slips(held: Held) -> Slip:
            if (hybrid.rubs(held) != hybrid.rubs(mode.held)).any():
                return hybrid.slip(held, t, q, v)
            return hybrid.friction(held).after(span, q, switch)

        if entered := self._entered(mode.slip, after, touched, t, q, v):
            held = mode.held
            for k in sorted(entered):
                held |= hybrid.tied(held, frozenset({k}), q) ^ {k}
            return v, Mode(held, slips(held))

        system, state = hybrid.stretch(after, t, q, v), (np.array([t]), q[None], v[None])
        pulls = any(push[0] <= 0.0 for push in hybrid.pushes(mode.held, system, *state).values())
        return v, self._pressing(mode.held | touched, t, q, v, slips) if pulls else after

    def _entered(self, before: Slip, mode: Mode, touched: Held, t: float, q: Array, v: Array) -> Held:
        """Return the stops among those that are touched into which a joint that breaks loose would go.

        Its acceleration may begin at 0; then that counts which grows with the load beyond its friction.
        """
        if not touched:
            return touched
        leaving = self._leaving(self.hybrid.stretch(mode, t, q, v), touched, np.array([t]), q[None], v[None])
        begun = self.hybrid.friction(mode.held).begun(before, mode.slip, self.hybrid.span(t), q)
        slight = self._slight(mode.held, t, q, v)
        for k in (k for k, away in leaving.items() if abs(away) <= slight):
            bound = self.hybrid.bounds[k]
            away = bound.side * float(bound.row(q) @ begun)
            leaving[k] = away if abs(away) > TIED * float(np.abs(bound.row(q)) @ np.abs(begun)) else 0.0
        return frozenset(k for k, away in leaving.items() if away < 0.0)

    def _slight(self, held: Held, t: float, q: Array, v: Array) -> float:
        """Return the acceleration that may be rounding."""
        return SLIGHT * float(np.abs(self.hybrid.acceleration_without_friction(held, t, q, v)).max(initial=0.0))

    def at_rest(self, t: float, q: Array, v: Array, held: Held = frozenset()) -> Held:
        """Return the stops that a state touches without moving against or away from them.

        ``held`` are stops that are touched, however well integrated states show it.
        """
        slow = self._slow({*self.hybrid.contacts.near(q), *held}, t, q, v)
        return frozenset(k for k, least in slow.items() if abs(self._speed(k, q, v)) <= least)

    def mode(self, t: float, q: Array, v: Array, kept: Held = frozenset()) -> Mode:
        """Return the stops that a state at rest on them presses against, and the slip of joints with friction.

        For ``kept`` see ``at_rest``.
        """
        return self._pressing(self.at_rest(t, q, v, kept), t, q, v)

    def _pressing(
        self, touched: Held, t: float, q: Array, v: Array, slips: Callable[[Held], Slip] | None = None
    ) -> Mode:
        """Return the mode in which those of the stops that are touched hold that a state at rest presses against.

        ``slips`` returns the slip of joints while some stops hold; where it is left out, that of the state.
        """
        hybrid, modes = self.hybrid, dict[Held, Mode]()

        def away(held: Held) -> dict[int, float]:
            mode = modes[held] = Mode(held, slips(held) if slips else hybrid.slip(held, t, q, v))
            system, state = hybrid.stretch(mode, t, q, v), (np.array([t]), q[None], v[None])
            pushes = {k: float(push[0]) for k, push in hybrid.pushes(held, system, *state).items()}
            return pushes | self._leaving(system, touched - held, *state)

        slight = partial(self._slight, frozenset(), t, q, v)
        held = pressed(touched, away, partial(hybrid.contacts.ties, q), slight) if touched else touched
        return modes[held] if held in modes else Mode(held, hybrid.slip(held, t, q, v))

    def _leaving(self, system: System, stops: Held, t: Array, q: Array, v: Array) -> dict[int, float]:
        """Return the accelerations away from stops in one state [rad/s^2 or m/s^2]."""
        if not stops:
            return {}
        a, bounds = self.hybrid.completed(system, t, q, v).a[0], self.hybrid.bounds
        return {k: bounds[k].side * bounds[k].acceleration(q[0], v[0], a) for k in sorted(stops)}
