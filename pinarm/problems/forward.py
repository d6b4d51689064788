"""Forward dynamics: the loads are known, the law of motion is wanted."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import EnergyAccount, energy_balance
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import friction_columns
from pinarm.engine.kinematics.assembly import near_given
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.guards import acting_on_angles, between, require_turns, undetermined_rest
from pinarm.engine.motion.integrated_motion import IntegratedMotion, driven_by, event_columns, push_columns
from pinarm.engine.motion.segmented.end_stops import (
    Bound,
    Separation,
    frictionless_remarks,
    impact_remarks,
    opening_remarks,
    separations_of,
)
from pinarm.engine.motion.segmented.holding import shares_remarks
from pinarm.engine.motion.segmented.hybrid_motion import integrate_to_size
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.motion.segmented.segments import SegmentedMotion
from pinarm.engine.motion.systems import Initial
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import along
from pinarm.errors import DynamicsError, InputError, IntegrationError, Interrupted, Key, Place, nowhere
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Deferred, InputStruct, Level, Rate
from pinarm.mechanics.ball_joints import coordinate_name, indices_of, places_of
from pinarm.mechanics.laws import Motion
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.events import EndStop, Event, bounds_of, watches_of
from pinarm.problems.laws import laws_of, profile_remarks
from pinarm.problems.loads import LOADS, Force, bind_loads, schema_row
from pinarm.problems.time_grid import TimeGrid
from pinarm.problems.values import check_levels, check_rates, followers_of, rates_of_coordinates
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.control.controls import Controls
    from pinarm.engine.motion.outcome import Outcome
    from pinarm.mechanics.control.kinds import Control
else:  # imported where a file has controllers, see Forward.deferred
    Control = Any


class InitialState(InputStruct, frozen=True):
    """State at the first instant; what is not given is 0.

    Attributes:
        position: Joint -> coordinate; of a ball joint J the rotation vector, ``J.rotation.x`` and so on, or ``J.roll``,
            ``J.pitch``, ``J.yaw``; a floating joint J has ``J.x``, ``J.y``, ``J.z`` too.
        velocity: Joint, or another coordinate, as ``L.angle`` of a loop joint L, -> velocity; of a ball joint J
            ``J.angular_velocity.x`` and so on, in the link's own axes.
    """

    position: dict[str, Level] = {}
    velocity: dict[str, Rate] = {}


class Forward(InputStruct, frozen=True, tag_field="kind", tag="forward"):
    """Motion from an initial state under the mechanism's forces and the given loads; some coordinates may follow laws.

    Attributes:
        time: Instants of the table.
        initial: State at the first of them; what loops or laws determine follows from the rest.
        start: Rough joint coordinates at the first instant: they choose the branch of a loop where there are several.
        motion: Coordinate -> law over time, or over another one of these coordinates, for those that are prescribed;
            the efforts that this takes come out.
        loads: Applied forces, springs and dampers of this run.
        events: What to look for on the way, by name.
        end_stops: Joint -> the limits that it meets with an impact.
        control: Controllers of drives: see docs/control.md.
    """

    kind: ClassVar[str] = "forward"
    deferred: ClassVar[Deferred] = {**LOADS, "control": ("pinarm.mechanics.control.kinds", "Control")}
    time: TimeGrid
    initial: InitialState = msgspec.field(default_factory=InitialState)
    start: dict[str, Level] = {}
    motion: dict[str, Motion] = {}
    loads: dict[str, Force] = {}
    events: dict[str, Event] = {}
    end_stops: dict[str, EndStop] = {}
    control: list[Control] = []

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        mechanism = self._losing(mechanism)
        start = {**self.start, **self.initial.position}
        row = schema_row(mechanism, start, self.loads, "t", unit("s"), along(mechanism, self.motion))
        events = event_columns(self.events, (), 1)
        rest = friction_columns(mechanism.frictions, np.zeros((1, len(mechanism.frictions))))
        pushes = push_columns(mechanism, filter(mechanism.joints.__contains__, self.end_stops), np.zeros_like(row.v))
        row = self._controlled(mechanism, replace(row, columns={**rest, **pushes}))
        return replace(row, columns={**row.columns, **events})  # in the order of the motion, as saved rows have them

    def _controlled(self, mechanism: Mechanism, row: Trajectory) -> Trajectory:
        if not self.control and not mechanism.control:
            return row
        from pinarm.engine.motion.segmented.recorded_control import control_schema

        motion = laws_of(mechanism, self.motion, nowhere, (self.time.start, self.time.end))
        controls = self._controls(mechanism, row.dynamics, motion, nowhere)
        if controls is None:
            return row
        row = driven_by(controls, row)
        return replace(row, columns={**row.columns, **control_schema(controls, row.q, row.v)})

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> HybridSystem:
        mechanism = self._losing(mechanism)
        motion = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        dynamics = Dynamics.of(mechanism.model, bind_loads(mechanism, self.loads, place))
        controls = self._controls(mechanism, dynamics, motion, place)
        bounds: tuple[Bound | Separation, ...] = bounds_of(mechanism, self.end_stops, place)
        bounds = (*bounds, *separations_of(mechanism.closure))
        watches = watches_of(mechanism, self.events, self.time.start, place)
        for name in self.end_stops:
            if name in self.motion:
                with place("end_stops", Key(name)):
                    raise InputError(f"'{name}' follows a law", expected="end stops of free joints only")
        with place("motion"):
            prescribed = PrescribedCoordinates.some(mechanism, motion)
        initial = self.initial_state(mechanism, prescribed, place)
        with place("motion"):
            acting, span = controls.dynamics if controls else dynamics, (self.time.start, self.time.end)
            hybrid = HybridSystem(
                mechanism.closure, acting, prescribed, initial, span, bounds, watches,
                accuracy.integrator(), accuracy.max_steps, frictions=mechanism.frictions, controls=controls,
                max_events=accuracy.max_events,
            )  # fmt: skip
            hybrid.closed_system  # noqa: B018  refuses laws that contradict each other
        return hybrid

    def _losing(self, mechanism: Mechanism) -> Mechanism:
        if not self.control and not mechanism.control:
            return mechanism
        from pinarm.problems.control import with_gear_losses

        return with_gear_losses(mechanism, [*mechanism.control, *self.control])

    def _controls(
        self, mechanism: Mechanism, dynamics: Dynamics, motion: Mapping[str, MotionLaw], place: Place
    ) -> Controls | None:
        if not self.control and not mechanism.control:
            return None
        from pinarm.problems.control import bind_controls

        duration = self.time.end - self.time.start
        return bind_controls(mechanism, self.control, dynamics, motion, duration, place)

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: HybridSystem | None = None
    ) -> Outcome:
        hybrid = prepared or self.prepare(mechanism, accuracy, place)
        with place("initial"):
            q, v = hybrid.start
        mechanism = self._losing(mechanism)
        try:
            motion = integrate_to_size(hybrid, q, v)
        except (IntegrationError, Interrupted) as error:
            if error.partial is not None and error.partial.end <= self.time.instants()[0]:
                error.partial = None
            if error.partial is not None:
                reached = IntegratedMotion(mechanism, hybrid, error.partial)
                grid = hybrid.grid(self.time.instants(), error.partial.seams).until(error.partial.end)
                error.partial = replace(reached.outcome(grid), notes=tuple(error.partial.diagnose()))
            raise
        self._require_branch(mechanism, hybrid, motion)
        self._require_turns(mechanism, hybrid, motion)
        t, end = self.time.instants(), motion.end
        grid = hybrid.grid(t if end == t[-1] else np.array([*t[t < end], end]), motion.seams)
        integrated = IntegratedMotion(mechanism, hybrid, motion)
        whole = integrated.outcome(grid)
        accounts = [] if self.motion else EnergyAccount.each(motion)
        remarks = [
            *_changed(mechanism, hybrid.initial.given_rates(), v),
            *motion.remarks(),
            *_motors(hybrid, motion),
            *impact_remarks(hybrid.contacts, motion.events),
            *frictionless_remarks(mechanism.frictions, motion.events),
            *opening_remarks(hybrid.bounds, motion.events),
            *_rest(hybrid, motion),
            *profile_remarks(mechanism, self.motion),
        ]
        figures = {**motion.cost(), **motion.rounding}
        notes = *hybrid.assembly.notes, *remarks, *motion.diagnose()
        return replace(whole, figures=figures, measures=partial(energy_balance, *accounts), notes=notes)

    def _require_branch(self, mechanism: Mechanism, hybrid: HybridSystem, motion: SegmentedMotion) -> None:
        """Raise where rounding has chosen between motions that meet; the motion until then is kept."""
        rest = undetermined_rest(hybrid.contacts.guided, motion)
        if rest is None:
            return
        kept = self._until(rest.t, mechanism, hybrid, motion)
        raise IntegrationError(
            f"from t = {rest.t:.9g} s on the motion is not determined: it all but stops at "
            f"{rest.regularity:.1g} of its usual regularity, where several motions meet and rounding would choose one",
            expected="a motion that passes singular positions at some speed",
            hint="an end before that instant, or another start: beside the singular position, or with a velocity",
            partial=kept,
            t=rest.t,
        )

    def _require_turns(self, mechanism: Mechanism, hybrid: HybridSystem, motion: SegmentedMotion) -> None:
        """Raise where an angle along which something acts leaps; the motion until then is kept."""
        controllers, forces = hybrid.controls.controllers if hybrid.controls else (), hybrid.dynamics.forces
        acting = acting_on_angles(mechanism.constraints, forces, controllers, mechanism.coordinates)
        if not acting:
            return
        integrated = IntegratedMotion(mechanism, hybrid, motion)
        t = between(np.array([self.time.start, *integrated.steps()]))
        try:
            require_turns(mechanism.model, acting, t, integrated.positions(t))
        except DynamicsError as error:
            before = float(t[np.searchsorted(t, error.data["t"]) - 1])
            error.partial = self._until(before, mechanism, hybrid, motion)
            raise

    def _until(self, t: float, mechanism: Mechanism, hybrid: HybridSystem, motion: SegmentedMotion) -> Outcome | None:
        """Return the motion until an instant; ``None`` where that is its start."""
        if not t > self.time.start:
            return None
        grid = hybrid.grid(self.time.instants(), motion.seams).until(t)
        return IntegratedMotion(mechanism, hybrid, motion).outcome(grid)

    def initial_state(self, mechanism: Mechanism, prescribed: PrescribedCoordinates, place: Place) -> Initial:
        """Return the initial state of the mechanism, as it is given; see ``HybridSystem.begin``."""
        check_levels(mechanism, self.start, place, "start")
        check_levels(mechanism, self.initial.position, place, "initial", "position")
        check_rates(mechanism, self.initial.velocity, place, "initial", "velocity")
        for part, values in (("position", self.initial.position), ("velocity", self.initial.velocity)):
            for name in values:
                if name in self.motion:
                    with place("initial", part, Key(name)):
                        raise InputError(f"'{name}' follows a law", expected="initial values of free joints only")
        with place("initial"):
            return self._begun(mechanism, prescribed)

    def _begun(self, mechanism: Mechanism, prescribed: PrescribedCoordinates) -> Initial:
        start, joints, balls = {**self.start, **self.initial.position}, mechanism.joints, mechanism.balls
        others = rates_of_coordinates(mechanism, self.initial.velocity)
        own = {name: rate for name, rate in self.initial.velocity.items() if name not in others}
        positions, velocities = (
            tuple(dict.fromkeys(index for name in values for index in indices_of(name, joints, balls)))
            for values in (self.initial.position, own)
        )
        rates = tuple((mechanism.coordinate(name), float(rate)) for name, rate in others.items())
        followers = followers_of(mechanism, start, self.initial.velocity)
        grid = Grid.cover(np.array([self.time.start, self.time.end]), prescribed.laws)
        drawn = near_given(mechanism, start_configuration(mechanism, {}), [], prescribed, grid)
        near = near_given(mechanism, start_configuration(mechanism, start), [*start], prescribed, grid)
        v, places = np.zeros(mechanism.model.nv), places_of(joints, balls)
        v[[places[name] for name in own]] = [*own.values()]
        return Initial(near, v, positions, velocities, rates, followers, near if self.start else drawn)


def _rest(hybrid: HybridSystem, motion: SegmentedMotion) -> list[str]:
    remarks = shares_remarks(segment.holding for segment in motion.segments if segment.shares)
    if not hybrid.frictions:
        return remarks
    from pinarm.engine.motion.systems.frictional import remarks_on_rest

    return [*remarks, *remarks_on_rest(segment.system for segment in motion.segments)]


def _motors(hybrid: HybridSystem, motion: SegmentedMotion) -> list[str]:
    if hybrid.controls is None:
        return []
    from pinarm.engine.motion.segmented.recorded_control import motor_remarks

    return motor_remarks(motion)


def _changed(mechanism: Mechanism, values: Array, v: Array) -> list[str]:
    """Return notes on given velocities that loops do not allow; v are the velocities at the start."""
    changes = []
    if len(v) < len(values):  # laws and couplings have been eliminated: what contradicts them is refused
        return []
    for index in np.flatnonzero(np.abs(v - values) > CONSISTENT * np.maximum(1.0, np.abs(v))).tolist():
        joint = coordinate_name(mechanism.model, index)
        measured = mechanism.joints[joint].unit if joint in mechanism.joints else "rad"
        changes.append(f"{joint} has {v[index]:.6g} {measured}/s at the start where {values[index]:.6g} was given")
    return (
        [f"the loops do not allow the given velocities, the closest are taken: {', '.join(changes)}"] if changes else []
    )


CONSISTENT = 1e-9
"""Difference of given velocities to what loops allow that typed digits explain [rad/s or m/s], or relative to it."""
