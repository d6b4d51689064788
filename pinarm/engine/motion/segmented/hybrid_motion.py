"""Forward motion through impacts and contacts: segments of smooth motion, and events between them.

A segment is integrated until an event ends it: a joint reaches an end stop, a stop that a joint rests on pushes it no
longer, friction holds or lets go, or an event of the user stops the run. After the ``Transitions`` at the event the
next segment begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise, takewhile

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.friction.slip import Slip
from pinarm.engine.integration.driver import integrate as integrate_smooth
from pinarm.engine.integration.events import ROUNDED, SAME_INSTANT, Watch
from pinarm.engine.integration.methods.explicit import FixedStep
from pinarm.engine.integration.solution import Solution
from pinarm.engine.integration.turns import Turn
from pinarm.engine.motion.segmented.end_stops import OPENED
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem, Mode
from pinarm.engine.motion.segmented.segment_ends import (
    CAUSES,
    Key,
    SegmentEnd,
    deciding,
    decision,
    of_mechanism,
    sensitivity,
    steps_over,
    watched,
)
from pinarm.engine.motion.segmented.segments import FINEST, OFFSET, REST, SMALL, MotionSegment, SegmentedMotion
from pinarm.engine.motion.segmented.transitions import Transitions
from pinarm.engine.motion.systems import System
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.errors import IntegrationError, Interrupted, NumericsError
from pinarm.mechanics.forces.force_element import refusals
from pinarm.mechanics.joints import format_configuration
from pinarm.records import Record, replace

CUT = 1e-14
"""Distance of an event from a jump of a load, or from the end of the run, over the instant, that is rounding."""

MOST = 20_000
"""Steps that a second integration may take: where rounding is as large as the motion, no step is short enough."""

MOST_ROUNDING = 1e-15
"""Largest error of a step in SI that is explained by rounding; what looks like more is a load with corners."""


def integrate(hybrid: HybridSystem, q: Array, v: Array) -> SegmentedMotion:
    """Return the motion from an initial state, assembled, shapes (nq,) and (nv,).

    Raises:
        IntegrationError: It could not be followed to its end; ``partial`` is the motion until then.
        Interrupted: The user interrupted it; likewise.
    """
    integration = _Integration(hybrid, Transitions(hybrid), SegmentedMotion(hybrid.dynamics))
    if hybrid.controls is None:
        return integration.follow(q, v)
    from pinarm.engine.motion.segmented.recorded_control import recorded

    hybrid.controls.begin(hybrid.cuts[0], hybrid.cuts[-1])
    try:
        return recorded(hybrid.controls, integration.follow(q, v))
    except (IntegrationError, Interrupted) as error:
        if error.partial is not None:
            error.partial = recorded(hybrid.controls, error.partial)
        raise


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
        while is_small(hybrid, motion.size) and motion.size > REST:
            hybrid = hybrid.of_size(motion.size, most)
            motion = integrate(hybrid, q, v)
        moved, scale = motion.displacement, hybrid.size + motion.size
        tolerance = max(hybrid.method.tolerance * moved / scale, FINEST)
        if is_offset(hybrid, moved, scale) and tolerance < hybrid.method.tolerance:
            method = replace(hybrid.method, tolerance=tolerance)
            motion = integrate(replace(hybrid, method=method, max_steps=most), q, v)
    except IntegrationError:
        pass
    return motion


def is_offset(hybrid: HybridSystem, moved: float, scale: float) -> bool:
    """Tell whether a displacement is small, but more than rounding, beside what errors of steps are relative to."""
    return hybrid.method.tolerance > 0.0 and REST * scale < moved < OFFSET * scale


def is_small(hybrid: HybridSystem, size: float) -> bool:
    """Tell whether a motion is small beside what the errors of its steps have been relative to."""
    return hybrid.method.tolerance > 0.0 and 0.0 < size < SMALL * hybrid.size


class _Integration(Record, frozen=True):
    """One motion while it is integrated; segments and events are added to ``motion``."""

    hybrid: HybridSystem
    transitions: Transitions
    motion: SegmentedMotion

    def follow(self, q: Array, v: Array) -> SegmentedMotion:
        """Return the motion from an initial state to its end; see ``integrate``."""
        hybrid, motion, transitions = self.hybrid, self.motion, self.transitions
        t, separations = hybrid.cuts[0], hybrid.separations
        self._enter(t, q, v)
        if hybrid.frictions:
            hybrid.friction(separations).sliding(Slip(), hybrid.span(t)).equation.require_determined(q)
        v = transitions.begun(motion, t, q, v)
        v, mode = transitions.settled(motion, t, q, v, transitions.mode(t, q, v), frozenset())
        while (end := self._segment(mode, t, q, v)) is not None:
            motion.require_progress(hybrid.cuts[-1], hybrid.max_events)
            t, q, v = self._on_cut(end.t), end.q, end.v
            if end.stops:
                break
            if met := transitions.met(mode.held, end):
                q, v = transitions.after_impact(motion, mode.held, end, met)
                motion.events.extend(EventRecord(hybrid.bounds[k].name, t, q, v, end.v) for k in met)
                end = replace(end, q=q)
            if t >= hybrid.cuts[-1]:
                break
            if end.control is not None and hybrid.controls:
                hybrid.controls.switch(end.control)
            self._enter(t, q, v)
            before = mode.held
            following = transitions.following(mode, replace(end, t=t, v=v))
            v, mode = transitions.settled(motion, t, q, *following, frozenset() if met else before)
            self._note_reversal(end, mode, t, q, v)
            opened = sorted((before & separations) - mode.held)
            motion.events.extend(EventRecord(hybrid.bounds[k].name + OPENED, t, q, v) for k in opened)
        return motion

    def _on_cut(self, t: float) -> float:
        """Return an instant, or the cut from which only rounding tells it [s]: nothing is to be integrated between."""
        return next((cut for cut in self.hybrid.cuts if 0.0 < cut - t <= CUT * max(abs(cut), abs(t))), t)

    def _enter(self, t: float, q: Array, v: Array) -> None:
        if self.hybrid.controls:
            self.hybrid.controls.enter(t, q, v)

    def _segment(self, mode: Mode, t: float, q: Array, v: Array) -> SegmentEnd | None:
        """Add a segment to the motion; return what ended it before the end of the run.

        Where something is held a segment ends with its interval: a load that jumps may set it in motion.
        """
        hybrid, controls = self.hybrid, self.hybrid.controls
        touched, spans = self.transitions.at_rest(t, q, v), self._spans(mode, t)
        tied = hybrid.tied(mode.held, touched, q)
        stops = hybrid.rested(mode.held | tied)
        shares = stops if stops and stops.are_open(q) else None
        system = hybrid.loaded(hybrid.stretch(mode, t, q, v), mode.held, shares, t, q)
        ends, acting = watched(hybrid, mode, system, touched, tied), hybrid.acting(system)
        ends = [(key, self._from_there(key, watch, t, q, v) if isinstance(key, str) else watch) for key, watch in ends]
        if controls:
            ends += [(("control", index), watch) for index, watch in controls.watches(spans[0])]
            system = controls.around(system)
        segment = partial(
            MotionSegment, system, dynamics=acting, holding=hybrid.holding(mode.held),
            rubbing=hybrid.rubs(mode.held), stops=stops, shares=shares,
        )  # fmt: skip
        watches = [of_mechanism(deciding(hybrid, watch), system) for _, watch in ends]
        try:
            solution = self._solution(system, spans, watches, q, v)
        except (IntegrationError, Interrupted) as error:
            if error.partial and error.partial.steps:
                self.motion.add(segment(solution=error.partial))
            error.partial = self.motion if self.motion.segments else None
            self._locate(error, system)
            if controls and isinstance(error, IntegrationError):
                error.hint = f"{controls.advice}, or {error.hint}"
            raise
        self.motion.add(segment(solution=solution))
        for index, turn in solution.nearest.items():
            key, watch = ends[index]
            self.motion.consider(decision(watch, turn, "" if watch.stops else str(key)))
        end = self._note_events(solution, system, [key for key, _ in ends])
        if end is None and solution.end < hybrid.cuts[-1]:
            q, v = (x[0] for x in system.whole(np.array([solution.end]), *solution.states(np.array([solution.end]))))
            end = SegmentEnd(solution.end, q, v)
        integrals = getattr(system, "integrals", None)
        if controls and integrals:  # after all states in between have been asked for
            controls.memory.integral = integrals(solution.states(np.array([solution.end]))[1])[0]
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
        before = float(watch.value(middle, *last.system.whole(middle, *last.solution.states(middle)))[0])
        passes = abs(before) > ROUNDED and (before >= 0.0) == (here >= 0.0)
        return watch if passes else replace(watch, begins=t)

    def _solution(
        self, system: System, spans: Sequence[tuple[float, float]], watches: Sequence[Watch], q: Array, v: Array
    ) -> Solution:
        """Return the states of a segment, until a watch ends it."""
        hybrid, work = self.hybrid, self.motion.work
        with_integrals = getattr(system, "with_integrals", None)
        q, v = with_integrals(q, v) if with_integrals else (q, v)
        return integrate_smooth(
            hybrid.intervals(system, spans),
            system.manifold,
            q,
            v,
            hybrid.method if system.manifold.nv else FixedStep(hybrid.time[1] - hybrid.time[0]),
            max_steps=hybrid.max_steps - work.steps - work.rejected,
            watches=watches,
            steps_over=steps_over(hybrid, system),
            begun_with=work.state_error,
        )

    def _spans(self, mode: Mode, t: float) -> list[tuple[float, float]]:
        """Return the intervals of a segment from t [s] on: one where a load that jumps may set held joints free."""
        spans = [(max(low, t), high) for low, high in pairwise(self.hybrid.cuts) if high > t]
        alone = self.hybrid.frictions or mode.held or (self.hybrid.controls and self.hybrid.controls.continuous)
        return spans[:1] if alone else spans

    def _note_events(self, solution: Solution, system: System, keys: list[Key]) -> SegmentEnd | None:
        """Add the events of the last segment to the motion; return the one that ended it."""
        end = None
        for crossing in solution.crossings:
            key, t = keys[crossing.watch], crossing.t
            q, v = (rows[0] for rows in system.whole(np.array([t]), crossing.q[None], crossing.v[None]))
            if isinstance(key, str):
                self.motion.events.append(EventRecord(key, t, q, v))
                end = SegmentEnd(t, q, v, stops=True) if self.hybrid.watches[key].stops else None
            else:
                hit, released, slip, control = (key[1] if key[0] == cause else None for cause in CAUSES)
                end = SegmentEnd(t, q, v, hit, released, slip, control)
        return end

    def _note_reversal(self, end: SegmentEnd, mode: Mode, t: float, q: Array, v: Array) -> None:
        """Note by how much friction fails to hold a joint that turns back in a state; nothing where none does."""
        if end.slip is None or not 0 <= end.slip < len(mode.slip.direction):
            return
        watch = self.hybrid.friction(mode.held).could_hold(mode.slip, self.hybrid.span(t), end.slip)
        if watch is None:
            return
        state, wrong = (np.array([t]), q[None], v[None]), self.motion.work.state_error
        margin = float(watch.value(*state)[0])
        if np.isnan(margin):
            return
        error = wrong * sensitivity(self.hybrid, watch.value, *state)
        self.motion.consider(decision(watch, Turn(0, t, 0.0, 1.0, margin, error, wrong, 0.0)))

    def _locate(self, error: NumericsError, system: System) -> None:
        """Say in an error where the integration ended, joint by joint."""
        if "q" in error.data:
            state = (np.asarray(error.data[name])[None] for name in ("t", "q", "v"))
            error.data["q"], error.data["v"] = (x[0] for x in system.whole(*state))
            error.message += f", with {format_configuration(self.hybrid.dynamics.model, error.data['q'])}"
            error.message += refusals(self.hybrid.dynamics.forces, error.data["q"])
