"""What a motion with impacts, contacts and friction is integrated of: the mechanism, and what holds it on a stretch.

Between two events the same stops are rested on, the same one-sided constraints hold and the same joints slip: a
``Mode``. For each mode there is one system of smooth equations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import split_rows
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.masses import require_masses
from pinarm.engine.friction.slip import Slip
from pinarm.engine.integration.events import Watch
from pinarm.engine.integration.integrator import Interval, Method
from pinarm.engine.kinematics.abscissa import running
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.motion.segmented.end_stops import REST, Bound, Contacts, Held
from pinarm.engine.motion.segmented.separations import Separation
from pinarm.engine.motion.segmented.stop_shares import StopShares
from pinarm.engine.motion.systems import Initial, System, system_of
from pinarm.errors import DynamicsError, InputError
from pinarm.input.units import unit
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid, MotionLaw
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.engine.control.controls import Controls
    from pinarm.engine.motion.segmented.stick_slip import StickSlip
    from pinarm.engine.motion.systems.system import CompletedStates
    from pinarm.mechanics.friction.contact import FrictionContact


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
        max_events: Number of impacts, switches and other changes of contact after which to give up.
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
    max_events: int = 10_000
    _systems: dict[Held, System] = {}
    _shares: dict[Held, StopShares] = {}

    def of_size(self, size: float, max_steps: int) -> HybridSystem:
        """Return the same for a motion of another size.

        What touches a stop is told by it as well, but in loops, whose positions are right to the size of their links.
        """
        bounds = self.bounds if self.closure.size else tuple(
            replace(bound, size=size) if isinstance(bound, Bound) else bound for bound in self.bounds)  # fmt: skip
        return replace(self, size=size, bounds=bounds, max_steps=max_steps)

    def beginning(self, initial: Initial) -> HybridSystem:
        """Return the same with another initial state."""
        return replace(self, initial=initial, _systems={}, _shares={})

    def system(self, held: Held = frozenset()) -> System:
        """Return what is integrated while joints rest on the given stops.

        Raises:
            InputError: The prescribed coordinates cannot be prescribed independently.
        """
        if held not in self._systems:
            self._systems[held] = self._built(held, self.with_stops(held), self.initial)
        return self._systems[held]

    def _built(self, held: Held, prescribed: PrescribedCoordinates, initial: Initial) -> System:
        closure = self.closure_of(held)
        if any(isinstance(self.bounds[k], Bound) for k in held):
            from pinarm.engine.motion.systems.loop_system import LoopSystem

            return LoopSystem.of(closure, self.dynamics, prescribed, initial.q)
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

    def holding(self, held: Held) -> Flags:
        """Return which rows of the mechanism's constraints hold, shape (m,)."""
        found, slices = np.ones(self.closure.size, dtype=bool), self.closure.slices
        for k in self.separations - held:
            found[slices[self.bounds[k].name]] = False
        return found

    def with_stops(self, held: Held) -> PrescribedCoordinates:
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
            self.rubbing(held),
            self.closure_of(held),
            self.dynamics,
            self.with_stops(held),
            self._stops(held),
            self.time,
            self.size,
        )

    def rubs(self, held: Held) -> Flags:
        """Return which frictions there are, shape (k,): not that of a cam that is open, whose follower flies."""
        opened = {f"coupling.{self.bounds[k].name}" for k in self.separations - held}
        return np.array([contact.name not in opened for contact in self.frictions], dtype=bool)

    def rubbing(self, held: Held) -> tuple[FrictionContact, ...]:
        """Return the frictions that there are."""
        return tuple(each for each, rubs in zip(self.frictions, self.rubs(held).tolist(), strict=True) if rubs)

    def stretch(self, mode: Mode, t: float, q: Array, v: Array) -> System:
        """Return what is integrated in a mode that begins in a state of the mechanism."""
        if not self.rubbing(mode.held):
            return self.system(mode.held)
        from pinarm.engine.motion.systems.frictional import FrictionalSystem

        friction = self.friction(mode.held)
        held = friction.held(mode.slip, self.span(t), q)
        inner = self._built(mode.held, held, replace(self.initial, q=q, v=v))
        return FrictionalSystem(friction, mode.slip, inner, self.cuts)

    def span(self, t: float) -> tuple[float, float]:
        """Return the interval without jumps from an instant on [s]."""
        later = [cut for cut in self.cuts[1:] if cut > t]
        return t, later[0] if later else self.cuts[-1]

    def grid(self, t: Array, seams: Iterable[float] = ()) -> Grid:
        """Return the grid of given instants, cut where a law or the motion jumps.

        What sampled controllers follow cuts it too, though it acts on the motion at samples only.
        """
        followed = self.controls.sampled_references if self.controls else []
        return Grid.cover(t, [*self._laws, *followed], seams)

    def grid_of_each(self, t: Array) -> Grid:
        """Return the grid of given instants, each once: where a law jumps, the row is that just after the jump."""
        cuts, slack = np.array(self.cuts), ROUNDING * (t[-1] - t[0])
        return Grid(t, self.cuts, (0, *map(int, np.searchsorted(t, cuts[1:-1] - slack)), len(t)))

    @cached_property
    def cuts(self) -> tuple[float, ...]:
        """Return the bounds of the intervals on which all laws are smooth [s]."""
        return Grid.cover(np.array(self.time), self._laws).cuts

    @cached_property
    def knots(self) -> list[float]:
        """Instants at which steps have to end: a third derivative jumps, or what passes pieces of loads turns back [s].

        A step sees a law at a few instants only: where it rests but for one point of a table, the stages of a longer
        step, and of a finer one beside it, may all lie where it rests. Likewise where a law swings past pieces of a
        load and back within a step; between its reversals the ends of a step tell what it passes.
        """
        found = {knot for law in self._laws for knot in law.knots()}
        if self.profiled or any(force.in_pieces for force in self.dynamics.forces.values()):
            from pinarm.mechanics.laws.over_coordinate import reversals

            found.update(t for law in self.prescribed.laws for t in reversals(law, *self.time))
        return sorted(found)

    @property
    def _laws(self) -> list[MotionLaw]:
        """The laws of coordinates and loads."""
        return [*self.prescribed.laws, *(law for force in self.dynamics.forces.values() for law in force.laws())]

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
        assembly = self.assembly if initial is self.initial else self._assembled(initial)
        initial = replace(initial, q=assembly.q, drawn=None)
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

    @cached_property
    def assembly(self) -> Assembly:
        """The first position of the mechanism; see ``first_position``."""
        return self._assembled(self.initial)

    def _assembled(self, initial: Initial) -> Assembly:
        """Return the configuration of an initial state, the loops closed; of couplings alone as it is given."""
        closure, (start, end) = self.closure_of(self._closed_at_start(initial)), self.cuts[:2]
        if self.prescribed.linear_in(closure):
            return Assembly(initial.q)
        from pinarm.engine.kinematics.assembly import first_position

        known, values = initial.known(self.prescribed, closure)
        w, drawn = self.prescribed.on(start, end)(start)[0], initial.q if initial.drawn is None else initial.drawn
        with running("t", unit("s")):
            return first_position(closure, known, np.array([*w, *values]), start, drawn, initial.q)

    def _closed_at_start(self, initial: Initial) -> Held:
        """Return the one-sided constraints that hold in an initial state: those that given values do not open.

        One is open where all joints that move it are given with a gap, or their velocities are such that it opens.
        """
        positions, found = set(initial.positions), set(self.separations)
        for k in self.separations:
            row = self.bounds[k].row(initial.q)
            moved = set(np.flatnonzero(np.abs(row) > ROUNDING * np.abs(row).max()).tolist())
            rate = self.bounds[k].side * float(row @ initial.v)
            opens = moved <= set(initial.velocities) and rate > self.still(k, initial.v)
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

    def intervals(self, system: System, spans: Iterable[tuple[float, float]]) -> list[Interval]:
        """Return what a system integrates in spans of time [s] without jumps."""
        found = [
            replace(
                system.interval(self.dynamics, low, high), size=self.size,
                knots=tuple(knot for knot in self.knots if low < knot < high),
            )
            for low, high in spans
        ]  # fmt: skip
        return [self.controls.interval(each, system) for each in found] if self.controls else found

    @cached_property
    def free_intervals(self) -> list[Interval]:
        """What is integrated from the first instant to the last one while nothing is held."""
        return self.intervals(self.system(), pairwise(self.cuts))

    def still(self, k: int, v: Array) -> float:
        """Return the velocity along stop k that is none: rounding, or what moves it by no gap in the whole run."""
        return self.bounds[k].slack / (self.time[1] - self.time[0]) + REST * float(np.abs(v).max(initial=0.0))

    def slip(self, held: Held, t: float, q: Array, v: Array) -> Slip:
        """Return what joints with friction begin to do in a state on given stops."""
        return self.friction(held).start(self.span(t), q, v) if self.rubbing(held) else Slip()

    def acceleration_without_friction(self, held: Held, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration of a state on some stops without friction, shape (nv,)."""
        system, grid = self.system(held), Grid(np.array([t]), self.span(t), (0, 1))
        return np.asarray(system.complete(self.dynamics, grid, q[None], v[None]).a[0])

    def acting(self, system: System) -> Dynamics:
        """Return the equation of motion of what is integrated, with the friction of what slips."""
        slowed = getattr(system, "slowed", None)
        return slowed(self.dynamics) if slowed else self.dynamics

    def completed(self, system: System, t: Array, q: Array, v: Array) -> CompletedStates:
        """Return states of one interval with their accelerations, efforts and multipliers."""
        span = (float(t[0]), float(t[-1]) if len(t) > 1 else self.span(float(t[0]))[1])
        complete = getattr(system, "tried", system.complete)
        found: CompletedStates = complete(self.dynamics, Grid(t, span, (0, len(t))), q, v)
        return found

    def shares(self, held: Held) -> StopShares:
        """Return what shares loads while joints rest on the given stops."""
        if held not in self._shares:
            closure, separations = self.closure_of(held), [self.bounds[k] for k in sorted(held & self.separations)]
            stops = self._stops(held)
            self._shares[held] = StopShares.of(closure, self.with_stops(held), stops, separations)
        return self._shares[held]

    def tied(self, held: Held, touched: Held, q: Array) -> Held:
        """Return the stops that a configuration touches and that move only with those that hold, shape (nq,)."""
        others = sorted(touched - held - self.separations) if held else []
        return frozenset(k for k in others if self.contacts.ties(q, held, k))

    def rested(self, held: Held) -> StopShares | None:
        """Return the stops that joints rest on, with what shares loads with them; ``None`` without any."""
        return None if held <= self.separations else self.shares(held)

    def loaded(self, system: System, held: Held, shares: StopShares | None, t: float, q: Array) -> System:
        """Return what is integrated while several stops share what loads joints with friction.

        Raises:
            DynamicsError: The friction that moves or holds a joint depends on how they share it.
        """
        contacts = self.rubbing(held)
        if not (shares and any(one.law.loaded for one in contacts)):
            return system
        from pinarm.engine.friction.response import BearingReactions

        rows = shares.rows
        reactions = BearingReactions(contacts, rows, self.dynamics.on(*self.span(t)))
        some = [one.name for one in reactions.undetermined(split_rows(rows.rows(rows.state(q))), q)]
        unknown = frozenset(k for k, one in enumerate(contacts) if one.name in some)
        try:
            return system.knowing(unknown)  # type: ignore[attr-defined, no-any-return]
        except DynamicsError as error:
            error.message = f"at t = {t:.9g} s: {error.message}"
            raise

    def pushes(self, held: Held, system: System, t: Array, q: Array, v: Array) -> dict[int, Array]:
        """Return the pushes of what is held, at states of one interval [N*m or N], shape (n,) each."""
        shares, stops = self.shares(held), sorted(held - self.separations)
        found = shares.least(self.completed(system, t, q, v))
        return dict(zip([*stops, *sorted(held & self.separations)], found.T, strict=True))

    def push(self, held: Held, system: System, k: int, t: Array, q: Array, v: Array) -> Array:
        """Return the push of one that is held; see ``pushes``."""
        return self.pushes(held, system, t, q, v)[k]

    @cached_property
    def profiled(self) -> list[JointRelation]:
        """Constraints whose rows are made of pieces, as cams are."""
        return [one for one in self.closure.constraints if isinstance(one, JointRelation) and one.in_pieces]
