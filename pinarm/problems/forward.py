"""Forward dynamics: the loads are known, the law of motion is wanted."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import msgspec

from pinarm.engine.assembly import start_configuration
from pinarm.engine.balance import energy_balance
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.imposed import Imposed
from pinarm.engine.integrators import Solution, integrate
from pinarm.engine.masses import require_masses
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.systems import Initial, System, system_of
from pinarm.engine.trajectory import Trajectory
from pinarm.errors import InputError, IntegrationError, Interrupted, Key
from pinarm.input.schema import Level, Model, Rate
from pinarm.input.units import unit
from pinarm.mechanics.balls import indices_of, velocity
from pinarm.mechanics.forces import Force
from pinarm.mechanics.laws import Motion
from pinarm.mechanics.motion import Grid
from pinarm.problems.common import Accuracy, Place, TimeGrid, bind_loads, check_levels, check_rates, laws_of


class InitialState(Model, frozen=True):
    """State at the first instant; what is not given is 0.

    Attributes:
        position: Joint -> coordinate; of a ball joint J the rotation vector, ``J.rotation.x`` and so on, or ``J.roll``,
            ``J.pitch``, ``J.yaw``; a floating joint J has ``J.x``, ``J.y``, ``J.z`` too.
        velocity: Joint -> velocity; of a ball joint J ``J.angular_velocity.x`` and so on, in the link's own axes.
    """

    position: dict[str, Level] = {}
    velocity: dict[str, Rate] = {}


class Forward(Model, frozen=True, tag_field="kind", tag="forward"):
    """Motion from an initial state under the mechanism's forces and the given loads; some coordinates may follow laws.

    Attributes:
        time: Instants of the table.
        initial: State at the first of them; what loops or laws determine follows from the rest.
        start: Rough joint coordinates at the first instant: they choose the branch of a loop where there are several.
        motion: Coordinate -> law over time, or over another one of these coordinates, for those that are prescribed;
            the efforts that this takes come out.
        loads: Applied forces, springs and dampers of this run.
    """

    kind: ClassVar[str] = "forward"
    time: TimeGrid
    initial: InitialState = msgspec.field(default_factory=InitialState)
    start: dict[str, Level] = {}
    motion: dict[str, Motion] = {}
    loads: dict[str, Force] = {}

    def still(self, mechanism: Mechanism) -> Trajectory:
        """Return one row at the neutral configuration: enough to see which quantities there are."""
        return Trajectory.still(mechanism, "t", unit("s"))

    def prepare(self, mechanism: Mechanism, place: Place) -> tuple[Imposed, Dynamics, System, Initial]:
        """Check all names and units; return laws, equation of motion, what is integrated, and the initial state."""
        motion = laws_of(mechanism, self.motion, place, (self.time.start, self.time.end))
        dynamics = Dynamics.of(mechanism.model, bind_loads(mechanism, self.loads, place))
        initial = self._start(mechanism, place)
        with place("motion"):
            imposed = Imposed.some(mechanism, motion)
            system = system_of(mechanism.closure, dynamics, imposed, initial)
        return imposed, dynamics, system, initial

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the motion, with what its energy says of its accuracy.

        Raises:
            DynamicsError: Masses do not determine the accelerations.
            IntegrationError: The motion could not be followed to its end; ``partial`` holds it until then.
        """
        imposed, dynamics, system, initial = self.prepare(mechanism, place)
        laws = [*imposed.laws, *(law for force in dynamics.forces.values() for law in force.laws())]
        grid = Grid.cover(self.time.instants(), laws)
        spans = list(pairwise(grid.cuts))
        with place("initial"):
            begin = system.begin(initial, *spans[0])
        laid = mechanism.closure.with_guides(imposed.names, imposed.coordinates)
        require_masses(laid, begin[0] if len(begin[0]) == len(initial.q) else initial.q, spans[0][0])
        stretches = [system.stretch(dynamics, low, high) for low, high in spans]
        run = _Run(mechanism, dynamics, system)
        try:
            solution = integrate(
                stretches,
                system.manifold,
                *begin,
                tolerance=accuracy.tolerance,
                max_steps=accuracy.max_steps,
            )
        except (IntegrationError, Interrupted) as error:
            error.partial = run.until(error.partial, grid) if error.partial.steps else None
            raise
        return run.trajectory(solution, grid, self._figures(solution, run, spans))

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

    def _figures(self, solution: Solution, run: _Run, spans: list[tuple[float, float]]) -> dict[str, float]:
        """Return the cost of a run and, where no drive works, the balance of its energy."""
        cost = {
            "steps": float(len(solution.steps)),
            "evaluations": float(solution.evaluations),
            "rejected steps": float(solution.rejected),
        }
        if solution.floored:
            cost["steps at the noise floor"] = float(solution.floored)
        if self.motion:
            return cost
        local = [run.dynamics.on(low, high) for low, high in spans]
        return {**cost, **energy_balance(solution, local, run.system.whole)}


@dataclass(frozen=True, eq=False)
class _Run:
    """What turns an integrated solution into a trajectory of the mechanism."""

    mechanism: Mechanism
    dynamics: Dynamics
    system: System

    def trajectory(self, solution: Solution, grid: Grid, figures: dict[str, float]) -> Trajectory:
        """Return the solution at the instants of a grid; accelerations are those of the equation of motion there."""
        motion = self.system.complete(self.dynamics, grid, *solution.states(grid.t))
        return Trajectory(
            self.mechanism, "t", unit("s"), grid, motion.q, motion.v, motion.a, motion.tau, motion.lam,
            self.system.closure, self.dynamics,
            lambda other: self.trajectory(solution, other, {}), figures,
        )  # fmt: skip

    def until(self, solution: Solution, grid: Grid) -> Trajectory:
        """Return what was computed before an integration failed."""
        return self.trajectory(solution, grid.until(solution.end), {})
