"""Forward dynamics: the loads are known, the law of motion is wanted."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np

from pinarm.engine.assembly import start_configuration
from pinarm.engine.balance import energy_balance
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.integrators import Solution, Stretch, integrate
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.trajectory import Trajectory
from pinarm.errors import IntegrationError
from pinarm.input.schema import Level, Model, Rate
from pinarm.input.units import unit
from pinarm.mechanics.forces import Force
from pinarm.mechanics.motion import Grid
from pinarm.problems.common import Accuracy, Place, TimeGrid, bind_loads, check_levels


class InitialState(Model):
    """State at the first instant; what is not given is 0.

    Attributes:
        position: Joint -> coordinate.
        velocity: Joint -> velocity.
    """

    position: dict[str, Level] = {}
    velocity: dict[str, Rate] = {}


class Forward(Model):
    """Free motion from an initial state under the mechanism's forces and the given loads.

    Attributes:
        time: Instants of the table.
        initial: State at the first of them.
        loads: Applied forces, springs and dampers of this run.
    """

    kind: Literal["forward"]
    time: TimeGrid
    initial: InitialState = InitialState()
    loads: dict[str, Force] = {}

    def solve(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Trajectory:
        """Return the motion, with what its energy says of its accuracy.

        Raises:
            IntegrationError: The motion could not be followed to its end; ``partial`` holds it until then.
        """
        check_levels(mechanism, self.initial.position, place, "initial", "position")
        check_levels(mechanism, self.initial.velocity, place, "initial", "velocity", per=unit("s"))
        dynamics = Dynamics.of(mechanism.model, bind_loads(mechanism, self.loads, place))
        q = start_configuration(mechanism, self.initial.position)
        v = np.zeros(mechanism.model.nv)
        for name, value in self.initial.velocity.items():
            v[mechanism.joints[name].v] = value
        laws = [law for force in dynamics.forces for law in force.laws()]
        start, end = self.time.start, self.time.end
        inner = sorted({x for law in laws for x in law.breakpoints() if start < x < end})
        bounds = [start, *inner, end]
        parts = [dynamics.on(low, high) for low, high in pairwise(bounds)]
        spans = zip(pairwise(bounds), parts, strict=True)
        stretches = [Stretch(low, high, part.acceleration()) for (low, high), part in spans]
        grid = Grid.cover(self.time.instants(), laws)
        try:
            solution = integrate(stretches, dynamics.manifold, q, v, tolerance=accuracy.tolerance)
        except IntegrationError as error:
            error.partial = _until(error.partial, mechanism, dynamics, grid) if error.partial.steps else None
            raise
        return _trajectory(solution, mechanism, dynamics, grid, energy_balance(solution, parts))


def _trajectory(
    solution: Solution, mechanism: Mechanism, dynamics: Dynamics, grid: Grid, figures: dict[str, float]
) -> Trajectory:
    """Return the solution at the instants of a grid; accelerations are those of the equation of motion there."""
    q, v = solution.states(grid.t)
    idle = np.zeros_like(v)
    figures = {
        "steps": float(len(solution.steps)), "evaluations": float(solution.evaluations),
        "rejected steps": float(solution.rejected), **figures,
    }  # fmt: skip

    def again(other: Grid) -> Trajectory:
        return _trajectory(solution, mechanism, dynamics, other, {})

    draft = Trajectory(mechanism, "t", unit("s"), grid, q, v, idle, idle, dynamics, again)
    a = draft.gather(lambda local, rows: local.forward(grid.t[rows], q[rows], v[rows]))
    return Trajectory(mechanism, "t", unit("s"), grid, q, v, a, idle, dynamics, again, figures)


def _until(solution: Solution, mechanism: Mechanism, dynamics: Dynamics, grid: Grid) -> Trajectory:
    """Return what was computed before an integration failed."""
    t = grid.t[grid.t <= solution.end]
    return _trajectory(solution, mechanism, dynamics, Grid(t, (float(t[0]), solution.end), (0, len(t))), {})
