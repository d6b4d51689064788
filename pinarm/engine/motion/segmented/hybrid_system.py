"""Smooth system between two events, one for each mode of contact and slip.

Between two events the same stops are rested on, the same one-sided constraints hold and the same joints slip: a
``Mode``. For each mode there is one system of smooth equations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import Decomposition, coupled_joints
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix, require_masses, solve
from pinarm.engine.friction.columns import Slip
from pinarm.engine.integration.integrator import Interval, Watch
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.kinematics.singular import running
from pinarm.engine.motion.segmented.end_stops import REST, Bound, Contacts, Held, Separation
from pinarm.engine.motion.segmented.holding import Holding
from pinarm.engine.motion.systems import Initial, System
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.couplings.coupling import cams_of
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid, MotionLaw
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.engine.control.controls import Controls
    from pinarm.engine.friction.joint_friction import JointFriction
    from pinarm.engine.integration.integrator import Method
    from pinarm.engine.motion.systems import CompletedStates
    from pinarm.engine.motion.systems.loop_system import LoopSystem
    from pinarm.mechanics.couplings.cam import CamCoupling
    from pinarm.mechanics.friction.contact import FrictionContact


UNMET = 1e-9
"""Part of a given rate that may be missed: rounding leaves 1e-14."""


class Mode(ValueRecord, frozen=True):
    """Stops on which joints rest, and slip of joints with friction, on a stretch of the motion."""

    held: Held = frozenset()
    slip: Slip = Slip()


class HybridSystem(Record, frozen=True):
    """A mechanism with forces, laws, end stops and events, to be integrated from an initial state.

    Attributes:
        dynamics: Its equation of motion with all the forces of the run, efforts of controllers included.
        time: First and last instant [s].
        bounds: End stops, and the one-sided constraints of the mechanism.
        watches: Events by name; their values are of states of the mechanism.
        max_steps: Number of steps after which to give up.
        size: Scale of errors of steps besides the states; see ``Interval.size``.
        controls: Controllers; ``None`` for none.
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
    _holding: dict[Held, Holding] = {}

    def of_size(self, size: float, max_steps: int) -> HybridSystem:
        """Return the system for a motion of another size.

        Contact with a stop is judged by it too, except in loops, whose positions are right to the size of their links.
        """
        bounds = self.bounds
        if not self.closure.size:
            bounds = tuple(replace(bound, size=size) if isinstance(bound, Bound) else bound for bound in bounds)
        return replace(self, size=size, bounds=bounds, max_steps=max_steps)

    def entered(self, q: Array, v: Array) -> HybridSystem:
        dynamics = self.dynamics.entered(q, v)
        return self if dynamics is self.dynamics else replace(self, dynamics=dynamics)

    @cached_property
    def separations(self) -> Held:
        return frozenset(k for k, bound in enumerate(self.bounds) if isinstance(bound, Separation))

    def holding(self, held: Held) -> Holding:
        """Return the equations while some stops are rested on; kept for all motions of the mechanism."""
        if held not in self._holding:
            self._holding[held] = Holding(self, held)
        return self._holding[held]

    @property
    def closed_system(self) -> LoopSystem:
        return self.holding(self.separations).system

    def friction(self, held: Held, t: float, slip: Slip = Slip()) -> JointFriction:  # noqa: B008  is frozen
        """Return the joints with friction from an instant on, while joints rest on the given stops."""
        from pinarm.engine.friction.joint_friction import JointFriction

        here = self.holding(held)
        closure, laws, span = here.closure, here.prescribed, self.span(t)
        rows = closure.with_guides(laws.names, laws.coordinates)
        return JointFriction(here.rubbing, closure, rows, self.dynamics, laws, self.time, span, slip, self.size)

    def stretch(self, mode: Mode, t: float, q: Array, v: Array) -> System:
        """Return the equations in a mode that begins in a state of the mechanism."""
        here = self.holding(mode.held)
        if not here.rubbing:
            return here.system
        from pinarm.engine.motion.systems.frictional import FrictionalSystem

        friction = self.friction(mode.held, t, mode.slip)
        inner = here.following(friction.with_stuck(q), replace(self.initial, q=q, v=v))
        return FrictionalSystem(friction, inner, here.stops, self.cuts)

    def span(self, t: float) -> tuple[float, float]:
        later = [cut for cut in self.cuts[1:] if cut > t]
        return t, later[0] if later else self.cuts[-1]

    def grid(self, t: Array, seams: Iterable[float] = ()) -> Grid:
        """Return the grid of given instants, cut where a law, a reference of a controller or the motion jumps."""
        sampled = self.controls.sampled if self.controls else ()
        followed = [law for controller in sampled for law in controller.references]
        return Grid.cover(t, [*self._laws, *followed], seams)

    @cached_property
    def cuts(self) -> tuple[float, ...]:
        """Return the bounds of the intervals on which all laws are smooth [s]."""
        return Grid.cover(np.array(self.time), self._laws).cuts

    @cached_property
    def knots(self) -> list[float]:
        """Instants at which steps have to end: a third derivative jumps, or a law turns back over pieces of loads [s].

        A longer step sees a law at a few instants only, which may all be where it rests.
        """
        knots = {knot for law in self._laws for knot in law.knots()}
        if self.profiled or any(force.in_pieces for force in self.dynamics.forces.values()):
            from pinarm.mechanics.laws.over_coordinate import reversals

            knots.update(t for law in self.prescribed.laws for t in reversals(law, *self.time))
        return sorted(knots)

    @property
    def _laws(self) -> list[MotionLaw]:
        return [*self.prescribed.laws, *(law for force in self.dynamics.forces.values() for law in force.laws())]

    @cached_property
    def contacts(self) -> Contacts:
        return Contacts(self.holding(frozenset()).closure, self.prescribed, self.bounds)

    @cached_property
    def start(self) -> tuple[Array, Array]:
        """The initial state of the mechanism, to be read only; see ``begin`` and ``require_masses``."""
        q, v = self.begin()
        self.require_masses(q[None])
        q.flags.writeable = v.flags.writeable = False
        return q, v

    def begin(self) -> tuple[Array, Array]:
        initial, here = replace(self.initial, q=self.assembly.q, drawn=None), self._at_start
        q, v = here.system.begin(initial, *self.cuts[:2])
        if initial.rates:
            v = self._velocity_with_rates(initial, here.closure, q)
            initial = replace(initial, q=q, v=v, velocities=tuple(range(len(v))))
            q, v = here.system.begin(initial, *self.cuts[:2])
        for follower in initial.followers:
            rotor, coordinate, state = follower.rotor, follower.coordinate, self.closure.state(q)
            q[rotor.q] = coordinate.value(state) if follower.position else q[rotor.q]
            v[rotor.v] = coordinate.row(state) @ v if follower.velocity else v[rotor.v]
        for bound in self.bounds:
            if bound.gap(q) < -bound.slack:
                raise InputError(bound.passed_at_start(q))
        return q, v

    def _velocity_with_rates(self, initial: Initial, closure: Closure, q: Array) -> Array:
        """Return the velocity nearest to the given one, by the masses, that has all given rates, shape (nv,)."""
        rows = closure.with_guides(self.prescribed.names, self.prescribed.coordinates)
        state, mass, (start, end) = rows.state(q), mass_matrix(closure.model, q), self.cuts[:2]
        rates = np.array([rate for _, rate in initial.rates])
        along = np.array([coordinate.row(state) for coordinate, _ in initial.rates])
        laws = self.prescribed.on(start, end)(start)[1]
        asked, right = np.vstack([rows.rows(state), along]), np.concatenate([np.zeros(closure.size), laws, rates])
        resting = np.flatnonzero(~coupled_joints(asked, right, initial.v)).tolist()
        known = sorted({*initial.velocities, *resting})
        split = Decomposition.of(np.vstack([asked, np.eye(closure.model.nv)[known]]))
        v = solve(split, mass, mass @ initial.v, np.concatenate([right, initial.v[known]]))
        left = np.abs(along @ v - rates)
        if left.max() > UNMET * np.abs(rates).max():
            raise InputError(
                f"the velocities that are given cannot be had at once: {left.max():.3g} of {rates[left.argmax()]:.6g} "
                "is left over",
                expected="velocities that loops, laws and each other allow",
            )
        return v

    @cached_property
    def assembly(self) -> Assembly:
        """The configuration of the initial state, the loops closed; of couplings alone as it is given."""
        initial, closure, (start, end) = self.initial, self._at_start.closure, self.cuts[:2]
        if self.prescribed.linear_in(closure):
            return Assembly(initial.q)
        from pinarm.engine.kinematics.assembly import first_position

        known, values = initial.known(self.prescribed, closure)
        w, drawn = self.prescribed.on(start, end)(start)[0], initial.q if initial.drawn is None else initial.drawn
        with running("t", unit("s")):
            return first_position(closure, known, np.array([*w, *values]), start, drawn, initial.q)

    @property
    def _at_start(self) -> Holding:
        """Equations in the initial state: with the one-sided constraints that given values do not open."""
        initial, held = self.initial, set(self.separations)
        for k in self.separations:
            row = self.bounds[k].row(initial.q)
            moved = set(np.flatnonzero(np.abs(row) > ROUNDING * np.abs(row).max()).tolist())
            rate = self.bounds[k].side * float(row @ initial.v)
            opens = moved <= set(initial.velocities) and rate > self.still(k, initial.v)
            if moved <= set(initial.positions) and (opens or self.bounds[k].gap(initial.q) > self.bounds[k].slack):
                held.discard(k)
        return self.holding(frozenset(held))

    def require_masses(self, q: Array) -> None:
        known = q.shape[1] == len(self.initial.q)
        require_masses(self.contacts.guided, q if known else self.initial.q[None], self.time[0])

    def intervals(self, system: System, spans: Iterable[tuple[float, float]]) -> list[Interval]:
        """Return the intervals of a system in spans of time [s] without jumps."""
        intervals = list[Interval]()
        for low, high in spans:
            knots = tuple(knot for knot in self.knots if low < knot < high)
            interval = replace(system.interval(self.dynamics, low, high), size=self.size, knots=knots)
            intervals.append(self.controls.interval(interval, system) if self.controls else interval)
        return intervals

    def still(self, k: int, v: Array) -> float:
        """Return the velocity along stop k that is none: rounding, or one that moves it by no gap in the whole run."""
        return self.bounds[k].slack / (self.time[1] - self.time[0]) + REST * float(np.abs(v).max(initial=0.0))

    def slip(self, held: Held, t: float, q: Array, v: Array) -> Slip:
        return self.friction(held, t).start(q, v) if self.holding(held).rubbing else Slip()

    def acceleration_without_friction(self, held: Held, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration of a state on some stops without friction, shape (nv,)."""
        return np.asarray(self.completed(self.holding(held).system, np.array([t]), q[None], v[None]).a[0])

    def completed(self, system: System, t: Array, q: Array, v: Array) -> CompletedStates:
        """Return states of one interval with their accelerations, efforts and multipliers."""
        span = (float(t[0]), float(t[-1]) if len(t) > 1 else self.span(float(t[0]))[1])
        complete = getattr(system, "tried", system.complete)
        states: CompletedStates = complete(self.dynamics, Grid(t, span, (0, len(t))), q, v)
        return states

    def tied(self, held: Held, touched: Held, q: Array) -> Held:
        """Return the stops that a configuration touches and that move only with those that hold, shape (nq,)."""
        others = sorted(touched - held - self.separations) if held else []
        return frozenset(k for k in others if self.contacts.ties(q, held, k))

    def require_loads(self, held: Held, t: float, q: Array) -> None:
        """Raise where the friction of a joint depends on how several stops share a load."""
        here = self.holding(held)
        if any(contact.law.loaded for contact in here.rubbing) and here.shares_at(q[None]):
            from pinarm.engine.friction.slip_equation import BearingReactions

            reactions = BearingReactions(here.rubbing, here.rows, self.dynamics.on(*self.span(t)))
            reactions.require_determined(here.rows.split_at(q), q)

    def pushes(self, held: Held, system: System, t: Array, q: Array, v: Array) -> dict[int, Array]:
        """Return the pushes of what is held, at states of one interval [N*m or N], shape (n,) each."""
        pushes = self.holding(held).least(self.completed(system, t, q, v))
        return dict(zip([*sorted(held - self.separations), *sorted(held & self.separations)], pushes.T, strict=True))

    def push(self, held: Held, system: System, k: int, t: Array, q: Array, v: Array) -> Array:
        return self.pushes(held, system, t, q, v)[k]

    @cached_property
    def profiled(self) -> list[CamCoupling]:
        """Cams whose profile is made of pieces."""
        return [cam for cam in cams_of(self.closure.constraints) if len(cam.profile.marks)]
