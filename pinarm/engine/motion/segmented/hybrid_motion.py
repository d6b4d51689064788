"""Forward motion through impacts and contacts: segments of smooth motion, and the transitions at events between them.

A segment is integrated until an event ends it: a joint reaches an end stop, a stop that a joint rests on pushes it no
longer, friction holds or lets go, or an event of the user stops the run. At an impact an impulse changes the
velocities; at a contact that closes or opens a constraint is added or removed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import pairwise, takewhile
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.friction.columns import Slip
from pinarm.engine.integration.driver import integrate as integrate_smooth
from pinarm.engine.integration.events import ROUNDED, SAME_INSTANT
from pinarm.engine.integration.integrator import Solution, StepsOver, Turn, Watch
from pinarm.engine.integration.methods.explicit import FixedStep
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.motion.outcome import Decision
from pinarm.engine.motion.segmented.end_stops import OPENED, Bound, Held, pressed
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem, Mode
from pinarm.engine.motion.segmented.segments import FINEST, OFFSET, REST, SMALL, MotionSegment, SegmentedMotion
from pinarm.engine.motion.systems import System
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.errors import IntegrationError, Interrupted, NumericsError
from pinarm.mechanics.forces.force_element import refusals
from pinarm.mechanics.joints import RADIAN, format_configuration
from pinarm.records import Record, replace

CUT = 1e-14
"""Distance of an event from a jump of a load, or from the end of the run, over the instant, that is rounding."""

MOST = 20_000
"""Steps that a second integration may take: where rounding is as large as the motion, no step is short enough."""

DEAD = 10.0
"""Free part of the row of a stop in loops, over the root of the tolerance, up to which it is at a dead point: from
there a motion turns within the tolerance of the size of its links."""

SLIGHT = 1e-9
"""Acceleration of a joint that breaks loose, over that without friction, that may be rounding."""

Cause = tuple[str, int]
"""Cause of a segment end, with its number: ``hit`` and ``released`` stops, ``slip`` of a joint that comes to rest, or
the complement of a group of stuck joints that breaks loose, ``control`` of a controller, ``edge`` of a load."""

STOP: Cause = ("stop", -1)
"""An event of the user that ends the run."""

Margin = Callable[[Array, Array, Array], Array]
"""``(t, q, v) -> margins`` of n states of a mechanism, shape (n,)."""

APART = 10.0
"""Errors of steps within which a stop that moves only with others is not met."""

PART = 1e-6
"""Change of a state, over the size that errors are relative to, by which a sensitivity is measured: larger than the
rounding of loads, and so small that their curvature does not matter."""


def integrate_to_size(hybrid: HybridSystem, q: Array, v: Array) -> SegmentedMotion:
    """Return the motion from an initial state, its errors relative to its own size where that is much below 1 in SI.

    The error of a step is relative to ``size + |y|``: of an oscillation of 1e-12 m it would be as large as the motion
    at a tolerance of 1e-9. A small motion about a coordinate of 1 has a finer tolerance, as far as the rounding of the
    coordinate allows. Where no step is short enough, since rounding of accelerations is as large, the coarser motion is
    kept; ``SegmentedMotion.rounding`` tells how wrong it is. See ``integrate`` for arguments and errors.
    """
    motion = integrate(hybrid, q, v)
    most = min(hybrid.max_steps, MOST)
    try:
        while hybrid.method.tolerance > 0.0 and REST < motion.size < SMALL * hybrid.size:
            hybrid = hybrid.of_size(motion.size, most)
            motion = integrate(hybrid, q, v)
        moved, scale = motion.displacement, hybrid.size + motion.size
        tolerance = max(hybrid.method.tolerance * moved / scale, FINEST)
        if REST * scale < moved < OFFSET * scale and tolerance < hybrid.method.tolerance:
            method = replace(hybrid.method, tolerance=tolerance)
            motion = integrate(replace(hybrid, method=method, max_steps=most), q, v)
    except IntegrationError:
        pass
    return motion


def integrate(hybrid: HybridSystem, q: Array, v: Array) -> SegmentedMotion:
    """Return the motion from an initial state, assembled, shapes (nq,) and (nv,).

    Raises:
        IntegrationError: It could not be followed to its end; ``partial`` is the motion until then.
        Interrupted: The user interrupted it; likewise.
    """
    motion, controls = SegmentedMotion(hybrid.dynamics.recording()), hybrid.controls
    if controls is None:
        _Integration(hybrid, motion).follow(q, v)
        return motion
    from pinarm.engine.motion.segmented.recorded_control import recorded

    controls.begin(hybrid.cuts[0], hybrid.cuts[-1])
    try:
        _Integration(hybrid, motion).follow(q, v)
    except (IntegrationError, Interrupted) as error:
        error.partial = recorded(controls, error.partial) if error.partial else None
        raise
    return recorded(controls, motion)


class SegmentEnd(NamedTuple):
    """The end of a segment: instant [s], configuration, velocity, and what ended it."""

    t: float
    q: Array
    v: Array
    cause: Cause = ("", -1)


class _Integration(Record, frozen=True):
    """One motion while it is integrated; segments and events are added to ``motion``."""

    hybrid: HybridSystem
    motion: SegmentedMotion

    def follow(self, q: Array, v: Array) -> None:
        hybrid, motion, mode = self.hybrid, self.motion, Mode()
        if hybrid.frictions:
            hybrid.friction(hybrid.separations, hybrid.cuts[0]).equation.require_determined(q)
        end: SegmentEnd | None = SegmentEnd(hybrid.cuts[0], q, v)
        while end is not None and end.cause != STOP:
            motion.require_progress(hybrid.cuts[-1], hybrid.max_events)
            t, q, v, before = self._on_cut(end.t), end.q, end.v, mode.held
            if met := self._met(before, end):
                q, v = self._after_impact(before, end, met)
                motion.events.extend(EventRecord(hybrid.bounds[k].name, t, q, v, end.v) for k in met)
            if t >= hybrid.cuts[-1]:
                break
            if hybrid.controls:
                if end.cause[0] == "control":
                    hybrid.controls.switch(end.cause[1])
                hybrid.controls.enter(t, q, v)
            v, mode = self._settled(t, q, *self._following(mode, SegmentEnd(t, q, v, end.cause)),
                                    frozenset() if met else before)  # fmt: skip
            opened = sorted((before & hybrid.separations) - mode.held)
            motion.events.extend(EventRecord(hybrid.bounds[k].name + OPENED, t, q, v) for k in opened)
            end = self._segment(mode, t, q, v)

    def _on_cut(self, t: float) -> float:
        """Return an instant, or the cut from which only rounding tells it [s]: nothing is to be integrated between."""
        return next((cut for cut in self.hybrid.cuts if 0.0 < cut - t <= CUT * max(abs(cut), abs(t))), t)

    def _segment(self, mode: Mode, t: float, q: Array, v: Array) -> SegmentEnd | None:
        """Add a segment to the motion; return what ended it before the end of the run."""
        hybrid, controls = self.hybrid.entered(q, v), self.hybrid.controls
        self.motion.dynamics.note(t, hybrid.dynamics)
        touched, spans = self._at_rest(t, q, v), self._spans(mode, t)
        tied = hybrid.tied(mode.held, touched, q)
        hybrid.require_loads(mode.held | tied, t, q)
        system = hybrid.stretch(mode, t, q, v)
        ends = _watched(hybrid, mode, system, touched, tied)
        ends = [(key, self._from_there(key, watch, t, q, v) if isinstance(key, str) else watch) for key, watch in ends]
        if controls:
            ends += [(("control", index), watch) for index, watch in controls.watches(spans[0])]
            system = controls.around(system)
        segment = partial(MotionSegment, hybrid.holding(mode.held | tied), system)
        try:
            solution = self._solution(hybrid, system, spans, [watch for _, watch in ends], q, v)
        except (IntegrationError, Interrupted) as error:
            if error.partial and error.partial.steps:
                self.motion.add(segment(error.partial))
            error.partial = self.motion if self.motion.segments else None
            self._locate(error, system)
            if controls and isinstance(error, IntegrationError):
                error.hint = f"{controls.advice}, or {error.hint}"
            raise
        self.motion.add(segment(solution))
        for index, turn in solution.nearest.items():
            key, watch = ends[index]
            self.motion.consider(_decision(watch, turn, "" if watch.stops else str(key)))
        end = self._note_events(solution, system, [key for key, _ in ends])
        last = solution.states(np.array([solution.end]))
        if end is None and solution.end < hybrid.cuts[-1]:
            end = SegmentEnd(solution.end, *(x[0] for x in system.whole(np.array([solution.end]), *last)))
        integrals = getattr(system, "integrals", None)
        if controls and integrals:  # after all states in between have been asked for
            controls.integral = integrals(last[1])[0]
        return end

    def _from_there(self, name: str, watch: Watch, t: float, q: Array, v: Array) -> Watch:
        """Return the watch of an event in a segment that begins in a state.

        A value reached at the end of the segment before, or turned back from as at a stop, is not reached again in
        leaving it.
        """
        if not self.motion.segments:
            return watch
        last = self.motion.segments[-1]
        begun, end = float(last.solution.steps.t[-1]), last.solution.end
        slack = SAME_INSTANT * max(abs(end), float(last.solution.steps.h[-1]))
        latest = takewhile(lambda event: event.t >= end - slack, reversed(self.motion.events))
        if any(event.name == name for event in latest):
            return replace(watch, begins=t)
        if abs(here := float(watch.value(np.array([t]), q[None], v[None])[0])) > ROUNDED:
            return watch
        middle = np.array([0.5 * (begun + end)])
        before = float(watch.value(middle, *last.states(middle))[0])
        passes = abs(before) > ROUNDED and (before >= 0.0) == (here >= 0.0)
        return watch if passes else replace(watch, begins=t)

    def _solution(
        self, hybrid: HybridSystem, system: System, spans: Sequence[tuple[float, float]], watches: Sequence[Watch],
        q: Array, v: Array,
    ) -> Solution:  # fmt: skip
        work, mapped = self.motion.work, [_of_mechanism(_deciding(hybrid, watch), system) for watch in watches]
        with_integrals = getattr(system, "with_integrals", None)
        q, v = with_integrals(q, v) if with_integrals else (q, v)
        method = hybrid.method if system.manifold.nv else FixedStep(hybrid.time[1] - hybrid.time[0])
        return integrate_smooth(
            hybrid.intervals(system, spans), system.manifold, q, v, method, watches=mapped,
            max_steps=hybrid.max_steps - work.steps - work.rejected, steps_over=_steps_over(hybrid, system),
            begun_with=work.state_error,
        )  # fmt: skip

    def _spans(self, mode: Mode, t: float) -> list[tuple[float, float]]:
        """Return the intervals of a segment from t [s] on: one where a load that jumps may set held joints free."""
        spans = [(max(low, t), high) for low, high in pairwise(self.hybrid.cuts) if high > t]
        alone = self.hybrid.frictions or mode.held or (self.hybrid.controls and self.hybrid.controls.continuous)
        return spans[:1] if alone else spans

    def _note_events(self, solution: Solution, system: System, keys: list[str | Cause]) -> SegmentEnd | None:
        end = None
        for crossing in solution.crossings:
            key, t = keys[crossing.watch], crossing.t
            q, v = (rows[0] for rows in system.whole(np.array([t]), crossing.q[None], crossing.v[None]))
            if isinstance(key, str):
                self.motion.events.append(EventRecord(key, t, q, v))
                end = SegmentEnd(t, q, v, STOP) if self.hybrid.watches[key].stops else None
            else:
                end = SegmentEnd(t, q, v, key)
        return end

    def _locate(self, error: NumericsError, system: System) -> None:
        if "q" in error.data:
            state = (np.asarray(error.data[name])[None] for name in ("t", "q", "v"))
            error.data["q"], error.data["v"] = (x[0] for x in system.whole(*state))
            error.message += f", with {format_configuration(self.hybrid.dynamics.model, error.data['q'])}"
            error.message += refusals(self.hybrid.dynamics.forces, error.data["q"])

    def _met(self, held: Held, end: SegmentEnd) -> list[int]:
        """Return the stops hit at the end of a segment: it ends at one, others are as near but for rounding."""
        bounds, hit = self.hybrid.bounds, {end.cause[1]} if end.cause[0] == "hit" else set[int]()
        others = {*range(len(bounds))} - held - hit
        passed = (k for k in others if bounds[k].gap(end.q) <= bounds[k].slack)
        return sorted(hit.union(k for k in passed if self._approaches(k, end.q, end.v)))

    def _after_impact(self, held: Held, end: SegmentEnd, met: Sequence[int]) -> tuple[Array, Array]:
        """Return the state after stops were met: exactly on them, with the velocity after the impact."""
        hybrid, t, q = self.hybrid, end.t, end.q.copy()
        for bound in (hybrid.bounds[k] for k in met):
            if isinstance(bound, Bound):
                q[bound.place] = bound.limit
        closing = hybrid.separations.intersection(met)
        if closing:
            stops = hybrid.holding(held).prescribed
            q = assembled(hybrid.holding(held | closing).closure, stops, q, stops.on(t, t)(t)[0], t)
        for k in met:
            self._require_clear(k, held, end)
        return q, hybrid.contacts.impact(t, q, end.v, self._slow(met, t, q, end.v), held & hybrid.separations)

    def _require_clear(self, k: int, held: Held, end: SegmentEnd) -> None:
        """Raise where a motion at a dead point turns within the errors of steps of a stop."""
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
                partial=self.motion,
                t=end.t,
            )

    def _settled(self, t: float, q: Array, v: Array, mode: Mode, before: Held) -> tuple[Array, Mode]:
        """Return the velocity and the mode with joints at rest on stops that they begin to rest on."""
        hybrid, contacts = self.hybrid, self.hybrid.contacts
        begun = [k for k in sorted(mode.held - before) if abs(contacts.rate(k, q, v)) > hybrid.still(k, v)]
        if not begun:
            return v, mode
        after = contacts.rest(t, q, v, mode.held)
        self.motion.events.extend(EventRecord(hybrid.bounds[k].name, t, q, after, v) for k in begun)
        return self._settled(t, q, after, self._mode(t, q, after, mode.held), before.union(begun))

    def _approaches(self, k: int, q: Array, v: Array) -> bool:
        return self._speed(k, q, v) < -self.hybrid.still(k, v)

    def _speed(self, k: int, q: Array, v: Array) -> float:
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

    def _following(self, mode: Mode, end: SegmentEnd) -> tuple[Array, Mode]:
        """Return the velocity and the mode after a segment that does not end the run."""
        hybrid, (t, q, v, (kind, index)) = self.hybrid, end
        if kind == "released":
            tied = hybrid.tied(mode.held, self._at_rest(t, q, v), q)  # any of them may take over what it held
            return v, self._pressing((mode.held | tied) - {index}, t, q, v)
        if kind != "slip":
            return v, self._mode(t, q, v, mode.held & hybrid.separations)
        friction = hybrid.friction(mode.held, t, mode.slip)
        switch = friction.switch(q, v, index)
        v, touched = switch.v, self._at_rest(t, q, switch.v) - mode.held
        after = Mode(mode.held, friction.after(q, switch))
        if touched and index >= 0:  # a rebound so small that it ends where the stop is, but for rounding
            return v, self._mode(t, q, v, mode.held & hybrid.separations)

        def slips(held: Held) -> Slip:
            if (hybrid.holding(held).rubs != hybrid.holding(mode.held).rubs).any():
                return hybrid.slip(held, t, q, v)
            return hybrid.friction(held, t).after(q, switch)

        system, state = hybrid.stretch(after, t, q, v), (np.array([t]), q[None], v[None])
        pulls = any(push[0] <= 0.0 for push in hybrid.pushes(mode.held, system, *state).values())
        return v, self._pressing(mode.held | touched, t, q, v, slips) if pulls else after

    def _at_rest(self, t: float, q: Array, v: Array, held: Held = frozenset()) -> Held:
        """Return the stops that are touched, or held, without moving against or away from them."""
        slow = self._slow({*self.hybrid.contacts.near(q), *held}, t, q, v)
        return frozenset(k for k, least in slow.items() if abs(self._speed(k, q, v)) <= least)

    def _mode(self, t: float, q: Array, v: Array, kept: Held = frozenset()) -> Mode:
        return self._pressing(self._at_rest(t, q, v, kept), t, q, v)

    def _pressing(
        self, touched: Held, t: float, q: Array, v: Array, slips: Callable[[Held], Slip] | None = None
    ) -> Mode:
        """Return the mode in which those of the touched stops hold that a state at rest presses against."""
        hybrid, modes = self.hybrid, dict[Held, Mode]()

        def away(held: Held) -> dict[int, float]:
            mode = modes[held] = Mode(held, slips(held) if slips else hybrid.slip(held, t, q, v))
            system, state = hybrid.stretch(mode, t, q, v), (np.array([t]), q[None], v[None])
            pushes = {k: float(push[0]) for k, push in hybrid.pushes(held, system, *state).items()}
            return pushes | self._leaving(system, touched - held, *state)

        def slight() -> float:
            without = hybrid.acceleration_without_friction(frozenset(), t, q, v)
            return SLIGHT * float(np.abs(without).max(initial=0.0))

        held = pressed(touched, away, partial(hybrid.contacts.ties, q), slight) if touched else touched
        return modes[held] if held in modes else Mode(held, hybrid.slip(held, t, q, v))

    def _leaving(self, system: System, stops: Held, t: Array, q: Array, v: Array) -> dict[int, float]:
        if not stops:
            return {}
        a, bounds = self.hybrid.completed(system, t, q, v).a[0], self.hybrid.bounds
        return {k: bounds[k].side * bounds[k].acceleration(q[0], v[0], a) for k in sorted(stops)}


def _watched(
    hybrid: HybridSystem, mode: Mode, system: System, resting: Held, tied: Held = frozenset()
) -> list[tuple[str | Cause, Watch]]:
    """Return the events of the user, by name, and the ends of a segment, by their causes.

    ``resting`` are stops that are touched at rest: a joint that leaves its stop from rest does so slower than rounding
    at first, and is given some slack. ``tied`` ones of them move only with stops that hold, within the errors of steps.
    """
    watches: list[tuple[str | Cause, Watch]] = list(hybrid.watches.items())
    for k, bound in enumerate(hybrid.bounds):
        if k in mode.held:
            push, unit = partial(hybrid.push, mode.held, system, k), "N" if bound.unit != RADIAN else "N*m"
            holds = f"the {bound.title} holds"
            watches.append((("released", k), Watch(push, -1, stops=True, loaded=True, what=holds, unit=unit)))
            continue
        slack = 2.0 * bound.slack if k in resting else 0.0
        if k in tied and isinstance(bound, Bound):
            slack = APART * hybrid.method.tolerance * (hybrid.size + abs(bound.limit))
        begins = "" if k in resting else f"contact with the {bound.title} begins"
        gap = partial(_sum, bound.gap, slack)
        watches.append((("hit", k), Watch(gap, -1, stops=True, what=begins, unit=str(bound.unit))))
    edges = [edge for force in hybrid.dynamics.forces.values() for edge in force.edges()]
    edges += [edge for relation in hybrid.profiled for edge in relation.edges()]
    watches += [
        (("edge", k), Watch(edge.value, edge.direction, stops=True, counts=edge.counts)) for k, edge in enumerate(edges)
    ]
    if hybrid.holding(mode.held).rubbing:
        watches += [(("slip", index), watch) for index, watch in system.watches()]  # type: ignore[attr-defined]
    return watches


def _sum(gap: Callable[[Array], Array], slack: float, t: Array, q: Array, v: Array) -> Array:
    return gap(q) + slack


def _steps_over(hybrid: HybridSystem, system: System) -> StepsOver | None:
    forces = [force for force in hybrid.dynamics.forces.values() if force.in_pieces]
    cams = hybrid.profiled

    def passed(t: Array, q: Array, v: Array) -> bool:
        q, v = system.whole(t, q, v)
        return any(force.passed(q, v) for force in forces) or any(cam.passed(q) for cam in cams)

    return passed if forces or cams else None


def _of_mechanism(watch: Watch, system: System) -> Watch:
    functions = {name: getattr(watch, name) for name in ("value", "counts", "margin", "sensitivity")}
    return replace(watch, **{name: partial(_whole, system, of) if of else None for name, of in functions.items()})


def _whole(system: System, function: Callable[[Array, Array, Array], object], t: Array, q: Array, v: Array) -> object:
    return function(t, *system.whole(t, q, v))


def _deciding(hybrid: HybridSystem, watch: Watch) -> Watch:
    """Return a watch of a mechanism's states, with the sensitivity of its margin where it decides something."""
    if not watch.what:
        return watch
    return replace(watch, sensitivity=partial(_sensitivity, hybrid, watch.margin or watch.value))


def _sensitivity(hybrid: HybridSystem, margin: Margin, t: Array, q: Array, v: Array) -> float:
    """Return the change of a margin by errors of 1 in all coordinates and velocities of one state, added up.

    The errors are relative to ``size + |y|``, as those of steps are. Shapes (1,), (1, nq) and (1, nv).
    """
    model, n = hybrid.closure.model, hybrid.closure.model.nv
    moves = PART * np.diag(hybrid.size + (np.abs(q[0]) if model.nq == n else np.ones(n)))
    positions = [q[0], *(pin.integrate(model, q[0], move) for move in moves), *np.repeat(q, n, axis=0)]
    velocities = np.vstack([np.repeat(v, n + 1, axis=0), v + PART * np.diag(hybrid.size + np.abs(v[0]))])
    margins = margin(np.repeat(t, 2 * n + 1), np.array(positions), velocities)
    return float(np.abs(margins[1:] - margins[0]).sum()) / PART


def _decision(watch: Watch, turn: Turn, event: str = "") -> Decision:
    """Return the decision where a watched value turns.

    ``event`` is the name of an event that is only recorded there; empty for a watch that changes the motion.
    """
    passed = -turn.sign * turn.margin
    if watch.loaded:  # watched for its end
        return Decision(watch.what, turn.t, -passed, turn.error, watch.unit, passed < 0.0)
    touches = turn.is_open and watch.level is not None
    happens = watch.direction in (0, -turn.sign) if touches else passed > 0.0
    return Decision(watch.what, turn.t, passed, turn.error, watch.unit, happens, event)
