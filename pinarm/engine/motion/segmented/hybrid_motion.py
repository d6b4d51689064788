"""Forward motion through impacts and contacts, as a hybrid system: segments of smooth motion, and events between them.

A segment is integrated until an event ends it: a joint reaches an end stop, a stop that a joint rests on pushes it no
longer, or an event of the user stops the run. At an impact the impulse changes the velocities; at a contact that closes
or opens a constraint is added or removed. Then the next segment begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.masses import require_masses
from pinarm.engine.dynamics.parallel import threads
from pinarm.engine.friction.slip import Slip
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.events import Watch, resolving_parts
from pinarm.engine.integration.integrator import Interval, Method, Solution, StepsOver
from pinarm.engine.integration.methods.explicit import FixedStep
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.segmented.end_stops import REST, Bound, Contacts, Held, Stop, pressed
from pinarm.engine.motion.segmented.segments import MotionSegment, SegmentedMotion
from pinarm.engine.motion.segmented.separations import OPENED, Separation
from pinarm.engine.motion.systems import Initial, System, system_of
from pinarm.engine.motion.trajectory import EventRecord
from pinarm.errors import InputError, IntegrationError, Interrupted, NumericsError
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.forces.force_element import ForceElement, refusals
from pinarm.mechanics.joints import format_configuration
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.engine.control.controls import Controls
    from pinarm.engine.integration.batch_solution import Ensemble
    from pinarm.engine.integration.integrator import Crossing
    from pinarm.engine.motion.segmented.stick_slip import StickSlip
    from pinarm.engine.motion.systems.system import CompletedStates
    from pinarm.mechanics.friction.contact import FrictionContact

CUT = 1e-14
"""Distance of an event from a jump of a load, or from the end of the run, over the instant, that is rounding."""

SLIGHT = 1e-9
"""Acceleration of what breaks loose, over that without friction, that may be rounding."""

FirstSegment = Callable[[], Solution]
"""Returns the first segment where it has been integrated already, or raises the error that ended it."""


class Mode(ValueRecord, frozen=True):
    """What holds joints on a stretch of the motion.

    Attributes:
        held: Stops on which joints rest.
        slip: What joints with friction do.
    """

    held: Held = frozenset()
    slip: Slip = Slip()


class HybridSystem(Record, frozen=True):
    """What is integrated: a mechanism with forces, laws, end stops and events.

    Attributes:
        closure: Constraints of the mechanism.
        dynamics: Its equation of motion with all the forces of the run.
        prescribed: Coordinates with laws.
        initial: The initial state.
        time: First and last instant [s].
        bounds: End stops, and the one-sided constraints of the mechanism.
        watches: Events by name; their values are of states of the mechanism.
        method: The integrator.
        max_steps: Number of steps after which to give up.
        size: What errors of steps are relative to besides the states; see ``Interval.size``.
        frictions: Joints with friction that sticks.
        controls: Controllers, whose efforts are among the loads of ``dynamics``; ``None`` for none.
    """

    closure: Closure
    dynamics: Dynamics
    prescribed: PrescribedCoordinates
    initial: Initial
    time: tuple[float, float]
    bounds: tuple[Bound | Separation, ...]
    watches: Mapping[str, Watch]
    method: Method
    max_steps: int
    size: float = 1.0
    frictions: tuple[FrictionContact, ...] = ()
    controls: Controls | None = None
    _systems: dict[Held, System] = {}

    def system(self, held: Held = frozenset()) -> System:
        """Return what is integrated while joints rest on the given stops.

        Raises:
            InputError: The prescribed coordinates cannot be prescribed independently.
        """
        if held not in self._systems:
            self._systems[held] = self._built(held, self._with_stops(held), self.initial)
        return self._systems[held]

    def _built(self, held: Held, prescribed: PrescribedCoordinates, initial: Initial) -> System:
        closure = self.closure_of(held)
        if any(isinstance(self.bounds[k], Bound) for k in held):
            from pinarm.engine.motion.systems.constrained import ConstrainedSystem

            return ConstrainedSystem.of(closure, self.dynamics, prescribed, initial.q)
        return system_of(closure, self.dynamics, prescribed, initial)

    @cached_property
    def separations(self) -> Held:
        """The one-sided constraints among the bounds."""
        return frozenset(k for k, bound in enumerate(self.bounds) if isinstance(bound, Separation))

    @property
    def closed_system(self) -> System:
        """What is integrated while all constraints hold."""
        return self.system(self.separations)

    def closure_of(self, held: Held) -> Closure:
        """Return the constraints that hold: those that always do, and the one-sided ones that are held."""
        if held >= self.separations:
            return self.closure
        opened = {self.bounds[k].name for k in self.separations - held}
        return Closure.of(self.closure.model, [one for one in self.closure.constraints if one.name not in opened])

    def _holding(self, held: Held) -> Flags:
        """Return which rows of the mechanism's constraints hold, shape (m,)."""
        found, slices = np.ones(self.closure.size, dtype=bool), self.closure.slices
        for k in self.separations - held:
            found[slices[self.bounds[k].name]] = False
        return found

    def _with_stops(self, held: Held) -> PrescribedCoordinates:
        """Return the coordinates that follow laws, and those of joints that rest on stops."""
        bounds = self._stops(held)
        return PrescribedCoordinates(
            (*self.prescribed.names, *(bound.name for bound in bounds)),
            (*self.prescribed.coordinates, *(bound.coordinate for bound in bounds)),
            (*self.prescribed.laws, *(Constant(value=bound.limit) for bound in bounds)),
        )

    def _stops(self, held: Held) -> list[Bound]:
        """Return the stops of joints among what is held."""
        return [bound for k in sorted(held) if isinstance(bound := self.bounds[k], Bound)]

    def friction(self, held: Held) -> StickSlip:
        """Return the joints with friction while joints rest on the given stops."""
        from pinarm.engine.motion.segmented.stick_slip import StickSlip

        return StickSlip(
            self.frictions,
            self.closure_of(held),
            self.dynamics,
            self._with_stops(held),
            self._stops(held),
            self.time,
            self.size,
        )

    def stretch(self, mode: Mode, t: float, q: Array, v: Array) -> System:
        """Return what is integrated in a mode that begins in a state of the mechanism."""
        if not self.frictions:
            return self.system(mode.held)
        from pinarm.engine.motion.systems.frictional import FrictionalSystem

        friction = self.friction(mode.held)
        held = friction.held(mode.slip, self._span(t), q)
        inner = self._built(mode.held, held, replace(self.initial, q=q, v=v))
        return FrictionalSystem(friction, mode.slip, inner, self.cuts)

    def _span(self, t: float) -> tuple[float, float]:
        """Return the interval without jumps from an instant on."""
        later = [cut for cut in self.cuts[1:] if cut > t]
        return t, later[0] if later else self.cuts[-1]

    def grid(self, t: Array, seams: Iterable[float] = ()) -> Grid:
        """Return the grid of given instants, cut where a law or the motion jumps."""
        laws = [*self.prescribed.laws, *(law for force in self.dynamics.forces.values() for law in force.laws())]
        return Grid.cover(t, laws, seams)

    def grid_of_each(self, t: Array) -> Grid:
        """Return the grid of given instants, each once: where a law jumps, the row is that just after the jump."""
        cuts, slack = np.array(self.cuts), ROUNDING * (t[-1] - t[0])
        return Grid(t, self.cuts, (0, *map(int, np.searchsorted(t, cuts[1:-1] - slack)), len(t)))

    @cached_property
    def cuts(self) -> tuple[float, ...]:
        """Return the bounds of the intervals on which all laws are smooth [s]."""
        return self.grid(np.array(self.time)).cuts

    @cached_property
    def contacts(self) -> Contacts:
        """Return the stops at work."""
        return Contacts(self.closure_of(frozenset()), self.prescribed, self.bounds)

    def begin(self, initial: Initial) -> tuple[Array, Array]:
        """Return an initial state of the mechanism, assembled.

        Raises:
            InputError: It contradicts itself, the laws, or a stop.
        """
        held = self._closed_at_start(initial)
        system, start = self.system(held), np.array(self.cuts[:1])
        whole_q, whole_v = system.whole(start, *(x[None] for x in system.begin(initial, *self.cuts[:2])))
        if initial.rates:
            from pinarm.engine.motion.initial_velocity import velocity_with_rates

            v = velocity_with_rates(initial, self.closure_of(held), self.prescribed, whole_q[0], self.cuts[:2])
            given = replace(initial, q=whole_q[0], v=v, velocities=tuple(range(len(v))))
            whole_q, whole_v = system.whole(start, *(x[None] for x in system.begin(given, *self.cuts[:2])))
        for follower in initial.followers:
            rotor, coordinate, state = follower.rotor, follower.coordinate, self.closure.state(whole_q[0])
            whole_q[0, rotor.q] = coordinate.value(state) if follower.position else whole_q[0, rotor.q]
            whole_v[0, rotor.v] = coordinate.row(state) @ whole_v[0] if follower.velocity else whole_v[0, rotor.v]
        for bound in self.bounds:
            if bound.gap(whole_q[0]) < -bound.slack:
                raise InputError(bound.passed_at_start(whole_q[0]))
        return whole_q[0], whole_v[0]

    def _closed_at_start(self, initial: Initial) -> Held:
        """Return the one-sided constraints that hold in an initial state: those that given values do not open.

        One is open where all joints that move it are given with a gap, or their velocities are such that it opens.
        """
        positions, found = set(initial.positions), set(self.separations)
        for k in self.separations:
            row = self.bounds[k].row(initial.q)
            moved = set(np.flatnonzero(np.abs(row) > ROUNDING * np.abs(row).max()).tolist())
            rate = self.bounds[k].side * float(row @ initial.v)
            opens = moved <= set(initial.velocities) and rate > self._still(k, initial.v)
            if moved <= positions and (opens or self.bounds[k].gap(initial.q) > self.bounds[k].slack):
                found.discard(k)
        return frozenset(found)

    @cached_property
    def start(self) -> tuple[Array, Array]:
        """The initial state of the mechanism, to be read only; see ``begin`` and ``require_masses``."""
        q, v = self.begin(self.initial)
        self.require_masses(q[None])
        q.flags.writeable = v.flags.writeable = False
        return q, v

    @cached_property
    def guided(self) -> Closure:
        """The constraints of the mechanism that always hold, then the coordinates that follow laws."""
        always = self.closure_of(frozenset())
        return always.with_guides(self.prescribed.names, self.prescribed.coordinates)

    def require_masses(self, q: Array) -> None:
        """Raise where masses do not determine the accelerations at configurations, shape (n, nq).

        Raises:
            DynamicsError: Names what moves without mass.
        """
        known = q.shape[1] == len(self.initial.q)
        require_masses(self.guided, q if known else self.initial.q[None], self.time[0])

    @cached_property
    def _intervals(self) -> list[Interval]:
        return self._smooth(self.system(), pairwise(self.cuts))

    def _smooth(self, system: System, spans: Iterable[tuple[float, float]]) -> list[Interval]:
        """Return what a system integrates in spans of time [s] without jumps."""
        found = [replace(system.interval(self.dynamics, *span), size=self.size) for span in spans]
        return [self.controls.interval(each, system) for each in found] if self.controls else found

    @property
    def batchable(self) -> bool:
        """Whether motions from several initial states can be integrated together."""
        if self.frictions or self.controls or self.separations:
            return False
        free = self.system().manifold.nv > 0  # what laws determine altogether takes no steps
        return free and self.method.pair is not None and all(interval.batch for interval in self._intervals)

    def integrate_together(self, q: Array, v: Array) -> Ensemble | None:
        """Return the first segments from many initial states that touch no stop, integrated together.

        Args:
            q: Configurations, shape (b, nq), assembled.
            v: Velocities, shape (b, nv).

        Returns:
            ``None`` where each has to be integrated by itself.
        """
        from pinarm.engine.integration.batch_driver import integrate_batch

        system, intervals, pair = self.system(), self._intervals, self.method.pair
        if pair is None or not self.batchable:
            return None
        watches = [
            _of_mechanism(one, system) for _, one in self._watched(Mode(), self.system(), self.time[0], q[0], v[0])
        ]
        return integrate_batch(
            intervals,
            system.manifold,
            *system.part(q, v),
            pair,
            max_steps=self.max_steps,
            watches=watches,
            steps_over=self._steps_over(system),
            threads=threads(),
        )

    def event_records(self, crossings: Sequence[Crossing]) -> list[EventRecord]:
        """Return the events of a segment that no stop has ended, in order of time."""
        system, names = self.system(), list(self.watches)
        found = [
            (crossing, *system.whole(np.array([crossing.t]), crossing.q[None], crossing.v[None]))
            for crossing in crossings
        ]
        return [EventRecord(names[one.watch], one.t, q[0], v[0]) for one, q, v in found]

    def integrate(self, q: Array, v: Array, first: FirstSegment | None = None) -> SegmentedMotion:
        """Return the motion from an initial state.

        Args:
            q: Configuration, shape (nq,), assembled.
            v: Velocity, shape (nv,).
            first: Gives the first segment where it has been integrated already.

        Raises:
            IntegrationError: It could not be followed to its end; ``partial`` is the motion until then.
            Interrupted: The user interrupted it; likewise.
        """
        if self.controls is None:
            return self._integrate(q, v, first)
        from pinarm.engine.motion.segmented.controlled_motion import recorded

        self.controls.begin(self.cuts[0], self.cuts[-1])
        try:
            return recorded(self.controls, self._integrate(q, v, first))
        except (IntegrationError, Interrupted) as error:
            if error.partial is not None:
                error.partial = recorded(self.controls, error.partial)
            raise

    def _integrate(self, q: Array, v: Array, first: FirstSegment | None) -> SegmentedMotion:
        motion, t = SegmentedMotion(self.dynamics), self.cuts[0]
        self._enter(t, q, v)
        if self.frictions:
            self.friction(self.separations).sliding(Slip(), self._span(t)).equation.require_determined(q)
        contacts = self.contacts
        if approached := [k for k in contacts.near(q) if self._approaches(k, q, v)]:
            v = self.contacts.impact(t, q, v, self._slow(approached, t, q, v))
        v, mode = self._settled(motion, t, q, v, self.mode(t, q, v), frozenset())
        while (end := self.integrate_segment(motion, mode, t, q, v, first)) is not None:
            motion.require_progress()
            t, q, v, first = self._on_cut(end.t), end.q, end.v, None
            if end.stops:
                break
            if met := self._met(mode.held, end):
                q, v = self._after_impact(mode.held, end, met)
                motion.events.extend(EventRecord(self.bounds[k].name, t, q, v, end.v) for k in met)
                end = replace(end, q=q)
            if t >= self.cuts[-1]:
                break
            if end.control is not None and self.controls:
                self.controls.switch(end.control)
            self._enter(t, q, v)
            before = mode.held
            following = self.following(mode, replace(end, t=t, v=v))
            v, mode = self._settled(motion, t, q, *following, frozenset() if met else before)
            opened = sorted((before & self.separations) - mode.held)
            motion.events.extend(EventRecord(self.bounds[k].name + OPENED, t, q, v) for k in opened)
        return motion

    def _on_cut(self, t: float) -> float:
        """Return an instant, or the cut from which only rounding tells it [s]: nothing is to be integrated between."""
        return next((cut for cut in self.cuts if 0.0 < cut - t <= CUT * max(abs(cut), abs(t))), t)

    def _settled(
        self, motion: SegmentedMotion, t: float, q: Array, v: Array, mode: Mode, before: Held
    ) -> tuple[Array, Mode]:
        """Return the velocity and the mode with joints at rest on stops that they begin to rest on.

        What is slow enough to rest there has been hit a last time.
        """
        begun = [k for k in sorted(mode.held - before) if abs(self.contacts.rate(k, q, v)) > self._still(k, v)]
        if not begun:
            return v, mode
        after = self.contacts.rest(t, q, v, mode.held)
        motion.events.extend(EventRecord(self.bounds[k].name, t, q, after, v) for k in begun)
        return self._settled(motion, t, q, after, self.mode(t, q, after, mode.held), before.union(begun))

    def _met(self, held: Held, end: SegmentEnd) -> list[int]:
        """Return the stops that are hit at the end of a segment, whatever ended it.

        Of several that are met at one instant a segment ends at one; the others are as near, or passed by rounding.
        """
        others = {*range(len(self.bounds))} - held - {end.hit}
        passed = {k for k in others if self.bounds[k].gap(end.q) <= self.bounds[k].slack}
        approached = {k for k in passed if self._approaches(k, end.q, end.v)}
        return sorted(approached if end.hit is None else approached | {end.hit})

    def _after_impact(self, held: Held, end: SegmentEnd, met: Sequence[int]) -> tuple[Array, Array]:
        """Return the state after stops were met: exactly on them, with the velocity after the impact."""
        t, q = end.t, end.q.copy()
        for bound in (self.bounds[k] for k in met):
            if isinstance(bound, Bound):
                q[bound.place] = bound.limit
        closing = self.separations.intersection(met)
        if closing:
            stops = self._with_stops(held)
            q = assembled(self.closure_of(held | closing), stops, q, stops.on(t, t)(t)[0], t)
        return q, self.contacts.impact(t, q, end.v, self._slow(met, t, q, end.v), held & self.separations)

    def _approaches(self, k: int, q: Array, v: Array) -> bool:
        """Tell whether a state moves towards a stop."""
        return self.bounds[k].side * self.contacts.rate(k, q, v) < -self._still(k, v)

    def _still(self, k: int, v: Array) -> float:
        """Return the velocity along a stop that is none: rounding, or what moves it by no gap in the whole run."""
        return self.bounds[k].slack / (self.time[1] - self.time[0]) + REST * float(np.abs(v).max(initial=0.0))

    def _slow(self, stops: Iterable[int], t: float, q: Array, v: Array) -> dict[int, float]:
        """Return the velocities up to which what touches stops rests on them [rad/s or m/s].

        With them it would rise by no gap under the accelerations that there are, ``u^2 / (2 a)``: which of them presses
        it back depends on what else is held.
        """
        found = {k: self._still(k, v) for k in stops}
        if any(abs(self.contacts.rate(k, q, v)) > still for k, still in found.items()):
            a = np.abs(self._free_acceleration(frozenset(), t, q, v)).max(initial=0.0)
            if self.frictions:
                slipping = self.stretch(Mode(frozenset(), self._slip(frozenset(), t, q, v)), t, q, v)
                a = max(a, np.abs(self._completed(slipping, np.array([t]), q[None], v[None]).a).max(initial=0.0))
            found = {k: max(still, float(2.0 * a * self.bounds[k].slack) ** 0.5) for k, still in found.items()}
        return found

    def _free_acceleration(self, held: Held, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration of a state on some stops without friction, shape (nv,)."""
        system, grid = self.system(held), Grid(np.array([t]), self._span(t), (0, 1))
        return np.asarray(system.complete(self.dynamics, grid, *system.part(q[None], v[None])).a[0])

    def _enter(self, t: float, q: Array, v: Array) -> None:
        """Let controllers act at the start of a segment."""
        if self.controls:
            self.controls.enter(t, q, v)

    def following(self, mode: Mode, end: SegmentEnd) -> tuple[Array, Mode]:
        """Return the velocity and the mode after the end of a segment that does not end the run."""
        t, q, v, index = end.t, end.q, end.v, end.slip
        if end.released is not None:
            return v, self._pressing(mode.held - {end.released}, t, q, v)
        if index is None:
            return v, self.mode(t, q, v, mode.held & self.separations)
        v, slip = self.friction(mode.held).switched(self._span(t), q, v, mode.slip, index)
        after, touched = Mode(mode.held, slip), self.at_rest(t, q, v) - mode.held
        if touched and index >= 0:  # a rebound so small that it ends where the stop is, but for rounding
            return v, self.mode(t, q, v, mode.held & self.separations)
        if entered := self._entered(after, touched, t, q, v):
            held = mode.held | entered
            return v, Mode(held, self._slip(held, t, q, v))

        def slips(held: Held) -> Slip:
            return self.friction(held).switched(self._span(t), q, v, mode.slip, index)[1]

        system, state = self.stretch(after, t, q, v), (np.array([t]), q[None], v[None])
        pulls = any(self.push(system, k, *state)[0] <= 0.0 for k in mode.held)
        return v, self._pressing(mode.held | touched, t, q, v, slips) if pulls else after

    def _entered(self, mode: Mode, touched: Held, t: float, q: Array, v: Array) -> Held:
        """Return the stops among those that are touched into which what breaks loose would go.

        Its acceleration may begin at 0; then that without friction has the sign in which it grows.
        """
        if not touched:
            return touched
        tendency = self._free_acceleration(mode.held, t, q, v)
        leaving = self._leaving(self.stretch(mode, t, q, v), touched, np.array([t]), q[None], v[None])
        slight = SLIGHT * float(np.abs(tendency).max())
        for k, away in leaving.items():
            if abs(away) <= slight:
                leaving[k] = self.bounds[k].side * self.bounds[k].acceleration(q, v, tendency)
        return frozenset(k for k, away in leaving.items() if away < 0.0)

    def _slip(self, held: Held, t: float, q: Array, v: Array) -> Slip:
        return self.friction(held).start(self._span(t), q, v) if self.frictions else Slip()

    def integrate_segment(
        self, motion: SegmentedMotion, mode: Mode, t: float, q: Array, v: Array, first: FirstSegment | None = None
    ) -> SegmentEnd | None:
        """Add a segment to the motion; return what ended it before the end of the run.

        Where something is held a segment ends with its interval: a load that jumps may set it in motion.
        """
        system, spans = self.stretch(mode, t, q, v), self._spans(mode, t)
        watched, acting = self._watched(mode, system, t, q, v), self._acting(system)
        if self.controls:
            watched += [(("control", index), watch) for index, watch in self.controls.watches(spans[0])]
            system = self.controls.around(system)
        intervals = self._smooth(system, spans)
        watches = [_of_mechanism(coordinate, system) for _, coordinate in watched]
        steps = self.max_steps - int(sum(motion.cost()[name] for name in ("steps", "rejected steps")))
        method = self.method if system.manifold.nv else self._standing(watches, spans)
        given, steps_over = (intervals, system.manifold, *system.part(q, v), method), self._steps_over(system)
        try:
            solution = first() if first else integrate(*given, max_steps=steps, watches=watches, steps_over=steps_over)
        except (IntegrationError, Interrupted) as error:
            if error.partial and error.partial.steps:
                motion.segments.append(MotionSegment(system, error.partial, acting, self._holding(mode.held)))
            error.partial = motion if motion.segments else None
            self._locate(error, system)
            if self.controls and isinstance(error, IntegrationError):
                error.hint = f"{self.controls.advice}, or {error.hint}"
            raise
        motion.segments.append(MotionSegment(system, solution, acting, self._holding(mode.held)))
        end = self._note_events(motion, solution, system, [key for key, _ in watched])
        if end is None and solution.end < self.cuts[-1]:
            q, v = (x[0] for x in system.whole(np.array([solution.end]), *solution.states(np.array([solution.end]))))
            end = SegmentEnd(solution.end, q, v)
        if self.controls:  # after all states in between have been asked for
            self._remember(system, solution)
        return end

    def _spans(self, mode: Mode, t: float) -> list[tuple[float, float]]:
        """Return the intervals of a segment from t [s] on: one where a load that jumps may change what holds joints."""
        spans = [(max(low, t), high) for low, high in pairwise(self.cuts) if high > t]
        alone = self.frictions or mode.held or (self.controls and self.controls.continuous)
        return spans[:1] if alone else spans

    def _remember(self, system: System, solution: Solution) -> None:
        """Keep the integrals of controllers at the end of a segment."""
        from pinarm.engine.control.controlled_system import ControlledSystem

        if self.controls and isinstance(system, ControlledSystem):
            _, v = solution.states(np.array([solution.end]))
            self.controls.remember(system.integrals(v)[0])

    def _standing(self, watches: Sequence[Watch], spans: Sequence[tuple[float, float]]) -> FixedStep:
        """Return the method where nothing is left to integrate: as few steps as show all crossings."""
        if not self.frictions:
            return FixedStep(self.time[1] - self.time[0])
        ((start, end),) = spans
        return FixedStep((end - start) / resolving_parts(watches, start, end, FixedStep.subdivisions))

    def _acting(self, system: System) -> Dynamics:
        """Return the equation of motion of a segment, with the friction of what slips."""
        return system.slowed(self.dynamics) if self.frictions else self.dynamics  # type: ignore[attr-defined]

    def _note_events(
        self, motion: SegmentedMotion, solution: Solution, system: System, keys: list[Key]
    ) -> SegmentEnd | None:
        """Add the events of the last segment to the motion; return the one that ended it."""
        end = None
        for crossing in solution.crossings:
            key, t = keys[crossing.watch], crossing.t
            q, v = (rows[0] for rows in system.whole(np.array([t]), crossing.q[None], crossing.v[None]))
            if isinstance(key, str):
                motion.events.append(EventRecord(key, t, q, v))
                end = SegmentEnd(t, q, v, stops=True) if self.watches[key].stops else None
            else:
                hit, released, slip, control = (key[1] if key[0] == cause else None for cause in CAUSES)
                end = SegmentEnd(t, q, v, hit, released, slip, control)
        return end

    def _locate(self, error: NumericsError, system: System) -> None:
        """Say in an error where the integration ended, joint by joint."""
        if "q" in error.data:
            state = (np.asarray(error.data[name])[None] for name in ("t", "q", "v"))
            error.data["q"], error.data["v"] = (x[0] for x in system.whole(*state))
            error.message += f", with {format_configuration(self.dynamics.model, error.data['q'])}"
            error.message += refusals(self.dynamics.forces, error.data["q"])

    def _steps_over(self, system: System) -> StepsOver | None:
        """Return whether a step in the integrated states may have gone past a piece of a load."""
        forces = [force for force in self.dynamics.forces.values() if force.in_pieces]
        pieces: list[ForceElement | JointRelation] = [*forces, *self._profiled]

        def steps_over(t: Array, q: Array, v: Array) -> bool:
            whole = system.whole(t, q, v)
            return any(one.passed(*whole) for one in pieces)

        return steps_over if pieces else None

    @cached_property
    def _profiled(self) -> list[JointRelation]:
        """Constraints whose rows are made of pieces, as cams are."""
        return [one for one in self.closure.constraints if isinstance(one, JointRelation) and one.in_pieces]

    def _watched(self, mode: Mode, system: System, t: float, q: Array, v: Array) -> list[tuple[Key, Watch]]:
        """Return the events, and what ends a segment: stops that are hit or let go, edges of loads, joints that stick.

        A joint that leaves its stop from rest does so slower than rounding at first: it is given some slack.
        """
        leaving = self.at_rest(t, q, v)
        found: list[tuple[Key, Watch]] = list(self.watches.items())
        for k, bound in enumerate(self.bounds):
            slack = 2.0 * bound.slack if k in leaving else 0.0
            if k in mode.held:
                found.append((("released", k), Watch(partial(self.push, system, k), -1, stops=True, loaded=True)))
            else:
                found.append((("hit", k), Watch(partial(_gap, bound, slack), -1, stops=True)))
        edges = [edge for force in self.dynamics.forces.values() for edge in force.edges()]
        edges += [edge for one in self._profiled for edge in one.edges()]
        found += [(("edge", k), Watch(edge, 0, stops=True)) for k, edge in enumerate(edges)]
        if self.frictions:
            switches = self.friction(mode.held).watches(mode.slip, system)  # type: ignore[arg-type]
            found += [(("slip", index), watch) for index, watch in switches]
        return found

    def push(self, system: System, k: int, t: Array, q: Array, v: Array) -> Array:
        """Return the push of a stop that is rested on, at states of one interval [N*m or N], shape (n,)."""
        motion, bound = self._completed(system, t, q, v), self.bounds[k]
        if isinstance(bound, Bound):
            return np.asarray(bound.side * motion.tau[:, bound.joint])
        return np.asarray(bound.side * np.asarray(motion.lam)[:, system.closure.slices[bound.name].start])

    def _completed(self, system: System, t: Array, q: Array, v: Array) -> CompletedStates:
        """Return states of one interval with their accelerations, efforts and multipliers."""
        span = (float(t[0]), float(t[-1]) if len(t) > 1 else self._span(float(t[0]))[1])
        complete = system.tried if self.frictions else system.complete  # type: ignore[attr-defined]
        found: CompletedStates = complete(self.dynamics, Grid(t, span, (0, len(t))), *system.part(q, v))
        return found

    def at_rest(self, t: float, q: Array, v: Array, held: Held = frozenset()) -> Held:
        """Return the stops that are touched without moving against or away from them.

        Args:
            t: The instant [s].
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            held: Stops that are touched, however well integrated states show it.
        """
        touched = {*self.contacts.near(q), *held}
        slow = self._slow(touched, t, q, v)
        return frozenset(k for k in touched if abs(self.contacts.rate(k, q, v)) <= slow[k])

    def mode(self, t: float, q: Array, v: Array, kept: Held = frozenset()) -> Mode:
        """Return the stops that a state at rest on them presses against, and what joints with friction begin to do.

        Args:
            t: The instant [s].
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            kept: See ``at_rest``.
        """
        return self._pressing(self.at_rest(t, q, v, kept), t, q, v)

    def _pressing(
        self, touched: Held, t: float, q: Array, v: Array, slips: Callable[[Held], Slip] | None = None
    ) -> Mode:
        """Return the mode in which those of the stops that are touched hold that a state at rest presses against.

        Args:
            touched: The stops.
            t: The instant [s].
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            slips: What joints with friction begin to do while some hold; where it is left out, what the state says.
        """
        modes: dict[Held, Mode] = {}

        def away(held: Held) -> dict[int, float]:
            mode = modes[held] = Mode(held, slips(held) if slips else self._slip(held, t, q, v))
            system, state = self.stretch(mode, t, q, v), (np.array([t]), q[None], v[None])
            pushes = {k: float(self.push(system, k, *state)[0]) for k in held}
            return pushes | self._leaving(system, touched - held, *state)

        held = pressed(touched, away) if touched else touched
        return modes[held] if held in modes else Mode(held, self._slip(held, t, q, v))

    def _leaving(self, system: System, stops: Held, t: Array, q: Array, v: Array) -> dict[int, float]:
        """Return the accelerations away from stops in one state [rad/s^2 or m/s^2]."""
        if not stops:
            return {}
        completed = self._completed(system, t, q, v)
        return {k: self.bounds[k].side * self.bounds[k].acceleration(q[0], v[0], completed.a[0]) for k in sorted(stops)}


Key = str | tuple[str, int]
"""Name of an event of the user, or what ends a segment: one of ``CAUSES``, or an ``edge``, and which one it is."""

CAUSES = ("hit", "released", "slip", "control")
"""Fields of ``SegmentEnd`` that tell why a segment ended."""


class SegmentEnd(Record, frozen=True):
    """What ended a segment.

    Attributes:
        t: When [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        hit: Stop that is hit.
        released: Stop that lets go.
        slip: Joint that comes to rest, or the complement of a group of stuck joints that breaks loose.
        control: Controller that changes its way; see ``Controls.watches``.
        stops: Whether the run ends.
    """

    t: float
    q: Array
    v: Array
    hit: int | None = None
    released: int | None = None
    slip: int | None = None
    control: int | None = None
    stops: bool = False


def _gap(bound: Stop, slack: float, t: Array, q: Array, v: Array) -> Array:
    return bound.gap(q) + slack


def _of_mechanism(watch: Watch, system: System) -> Watch:
    """Return the watch of integrated states."""
    return replace(watch, value=lambda t, q, v: watch.value(t, *system.whole(t, q, v)))
