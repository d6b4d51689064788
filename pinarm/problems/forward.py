"""Forward dynamics: the loads are known, the law of motion is wanted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import ClassVar

import msgspec
import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.equation import Dynamics
from pinarm.engine.dynamics.masses import require_masses
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.engine.kinematics.prescribed import Imposed
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.bifurcation import undetermined_rest
from pinarm.engine.motion.hybrid_motion import Journey, Known
from pinarm.engine.motion.segments import Course
from pinarm.engine.motion.systems import Initial
from pinarm.engine.motion.systems import Motion as Completed
from pinarm.engine.motion.trajectory import Happening, Series, Trajectory
from pinarm.engine.statics.actuation import actuation
from pinarm.errors import InputError, IntegrationError, Interrupted, Key
from pinarm.input.units import unit
from pinarm.input.yaml.schema import InputStruct, Level, Rate
from pinarm.mechanics.ball_joints import coordinate_name, indices_of, velocity
from pinarm.mechanics.forces import Force
from pinarm.mechanics.laws import Motion
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.common import Accuracy, Place, TimeGrid, bind_loads, check_levels, check_rates, laws_of, still
from pinarm.problems.events import EndStop, Event, bounds_of, watches_of

DEFAULT = Accuracy()

LOST = 1e-3
"""Energy that nothing accounts for, relative to the energy exchanged, from which on this is noted."""


class InitialState(InputStruct, frozen=True):
    """State at the first instant; what is not given is 0.

    Attributes:
        position: Joint -> coordinate; of a ball joint J the rotation vector, ``J.rotation.x`` and so on, or ``J.roll``,
            ``J.pitch``, ``J.yaw``; a floating joint J has ``J.x``, ``J.y``, ``J.z`` too.
        velocity: Joint -> velocity; of a ball joint J ``J.angular_velocity.x`` and so on, in the link's own axes.
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
    """

    kind: ClassVar[str] = "forward"
    time: TimeGrid
    initial: InitialState = msgspec.field(default_factory=InitialState)
    start: dict[str, Level] = {}
    motion: dict[str, Motion] = {}
    loads: dict[str, Force] = {}
    events: dict[str, Event] = {}
    end_stops: dict[str, EndStop] = {}

    def still(self, mechanism: Mechanism) -> Trajectory:
        """Return one row at the neutral configuration: enough to see which quantities there are."""
        row = still(mechanism, self.loads, "t", unit("s"), actuation(mechanism, [*self.motion], []).closure)
        return replace(row, further=further(self.events, [()], np.zeros(1, dtype=np.intp)))

    def prepare(self, mechanism: Mechanism, place: Place, accuracy: Accuracy = DEFAULT) -> Journey:
        """Check all names and units; return what is to be integrated."""
        motion = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        dynamics = Dynamics.of(mechanism.model, bind_loads(mechanism, self.loads, place))
        initial = self._start(mechanism, place)
        bounds = bounds_of(mechanism, self.end_stops, place)
        watches = watches_of(mechanism, self.events, place)
        for name in self.end_stops:
            if name in self.motion:
                with place("end_stops", Key(name)):
                    raise InputError(f"'{name}' follows a law", expected="end stops of free joints only")
        with place("motion"):
            imposed = Imposed.some(mechanism, motion)
            journey = Journey(
                mechanism.closure, dynamics, imposed, initial, (self.time.start, self.time.end), bounds, watches,
                accuracy.integrator(), accuracy.max_steps,
            )  # fmt: skip
            journey.system()
        return journey

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the motion, with what its energy says of its accuracy.

        Raises:
            DynamicsError: Masses do not determine the accelerations.
            IntegrationError: The motion could not be followed to its end, or is not determined from some instant on;
                ``partial`` holds it until then.
        """
        journey = self.prepare(mechanism, place, accuracy)
        with place("initial"):
            q, v = journey.begin(journey.initial)
        return self.followed(mechanism, journey, q, v)

    def followed(
        self, mechanism: Mechanism, journey: Journey, q: Array, v: Array, ahead: Known | None = None
    ) -> Trajectory:
        """Return the motion from an assembled state, whose first leg may be known; see ``solve``."""
        laid = self.require_masses(mechanism, journey, q[None])
        try:
            course = journey.travel(q, v, ahead)
        except (IntegrationError, Interrupted) as error:
            if error.partial is not None:
                grid = journey.grid(self.time.instants(), error.partial.seams).until(error.partial.end)
                doubts = tuple(error.partial.diagnose())
                error.partial = replace(_at(mechanism, journey, error.partial, self.events, grid), notes=doubts)
            raise
        self._require_branch(mechanism, journey, laid, course)
        t, end = self.time.instants(), course.end
        grid = journey.grid(t if end == t[-1] else np.array([*t[t < end], end]), course.seams)
        whole = _at(mechanism, journey, course, self.events, grid)
        energy = {} if self.motion else course.energy()
        notes = course.diagnose() or _lost(energy.get("energy", 0.0))
        return replace(whole, figures={**course.cost(), **energy}, notes=(*_changed(mechanism, journey, v), *notes))

    def require_masses(self, mechanism: Mechanism, journey: Journey, q: Array) -> Closure:
        """Return the constraints and the coordinates that follow laws, where masses determine the accelerations.

        Args:
            mechanism: What moves.
            journey: What is to be integrated.
            q: Configurations, shape (n, nq).

        Raises:
            DynamicsError: They do not.
        """
        laid = mechanism.closure.with_guides(journey.imposed.names, journey.imposed.coordinates)
        known = q.shape[1] == len(journey.initial.q)
        require_masses(laid, q if known else journey.initial.q[None], self.time.start)
        return laid

    def _require_branch(self, mechanism: Mechanism, journey: Journey, laid: Closure, course: Course) -> None:
        """Raise where rounding has chosen between motions that meet; the motion until then is kept."""
        rest = undetermined_rest(laid, course)
        if rest is None:
            return
        kept = None
        if rest.t > self.time.start:
            grid = journey.grid(self.time.instants(), course.seams).until(rest.t)
            kept = _at(mechanism, journey, course, self.events, grid)
        raise IntegrationError(
            f"from t = {rest.t:.9g} s on the motion is not determined: it all but stops at "
            f"{rest.regularity:.1g} of its usual regularity, where several motions meet and rounding would choose one",
            expected="a motion that passes singular positions at some speed",
            hint="an end before that instant, or another start: beside the singular position, or with a velocity",
            partial=kept, t=rest.t,
        )  # fmt: skip

    def _start(self, mechanism: Mechanism, place: Place) -> Initial:
        """Return the initial state of the mechanism."""
        check_levels(mechanism, self.start, place, "start")
        check_levels(mechanism, self.initial.position, place, "initial", "position")
        check_rates(mechanism, self.initial.velocity, place, "initial", "velocity")
        for part, values in (("position", self.initial.position), ("velocity", self.initial.velocity)):
            for name in values:
                if name in self.motion:
                    with place("initial", part, Key(name)):
                        raise InputError(f"'{name}' follows a law", expected="initial values of free joints only")
        with place("initial", "position"):
            q = start_configuration(mechanism, {**self.start, **self.initial.position})
        joints, balls = mechanism.joints, mechanism.balls
        v = velocity(mechanism.model, joints, balls, self.initial.velocity)
        positions, velocities = (
            tuple(dict.fromkeys(index for name in given for index in indices_of(name, joints, balls)))
            for given in (self.initial.position, self.initial.velocity)
        )
        return Initial(q, v, positions, velocities)


def _at(mechanism: Mechanism, journey: Journey, course: Course, events: Mapping[str, Event], grid: Grid) -> Trajectory:
    """Return a course at the instants of a grid; accelerations are those of the equation of motion there."""
    one, again = np.zeros(len(grid.t), dtype=np.intp), partial(_at, mechanism, journey, course, events)
    run = told(mechanism, journey, grid, course.complete(grid), again)
    happened = tuple(course.happenings)
    return replace(run, further=further(events, [happened], one), happenings=happened, positions=course.positions)


def told(
    mechanism: Mechanism, journey: Journey, grid: Grid, motion: Completed, again: Callable[[Grid], Trajectory]
) -> Trajectory:
    """Return the trajectory of a motion at the rows of a grid."""
    return Trajectory(
        mechanism, "t", unit("s"), grid, motion.q, motion.v, motion.a, motion.tau, motion.lam,
        journey.system().closure, journey.dynamics, again,
    )  # fmt: skip


def _changed(mechanism: Mechanism, journey: Journey, v: Array) -> list[str]:
    """Return what is to be said of given velocities that loops do not allow; v are those of the start."""
    given, told = journey.initial, []
    if len(v) < len(given.v):  # laws and couplings have been eliminated: what contradicts them is refused
        return []
    for index in given.velocities:
        if abs(v[index] - given.v[index]) > CONSISTENT * max(1.0, abs(v[index])):
            joint = coordinate_name(mechanism.model, index)
            measured = mechanism.joints[joint].unit if joint in mechanism.joints else "rad"
            told.append(f"{joint} has {v[index]:.6g} {measured}/s at the start where {given.v[index]:.6g} was given")
    return [f"the loops do not allow the given velocities, the closest are taken: {', '.join(told)}"] if told else []


CONSISTENT = 1e-9
"""Difference of given velocities to what loops allow that typed digits explain [rad/s or m/s], or relative to it."""


def _lost(energy: float) -> list[str]:
    """Return what is to be said of energy that nothing accounts for, relative to the energy exchanged."""
    if energy < LOST:
        return []
    return [f"energy: {energy:.2g} of what is exchanged is not accounted for: the motion is not that of the mechanism"]


def further(
    events: Mapping[str, Event], happenings: Sequence[Sequence[Happening]], motion: Indices
) -> dict[str, Series]:
    """Return when each event first took place, and how often, as quantities that are the same in all rows of a motion.

    Args:
        events: The events, by name.
        happenings: What took place, motion by motion.
        motion: Which motion each row belongs to, shape (n,).
    """
    found = {}
    for name in events:
        times = [[one.t for one in some if one.name == name] for some in happenings]
        first, count = (np.array(x)[motion] for x in ([[*x, np.nan][0] for x in times], [float(len(x)) for x in times]))
        found[f"event.{name}.time"] = Series(f"event.{name}.time", unit("s"), first)
        found[f"event.{name}.count"] = Series(f"event.{name}.count", unit("1"), count)
    return found
