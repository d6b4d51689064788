"""Integration at constant energy, for long free motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pinarm.arrays import Array
from pinarm.engine.integration.integrator import Doubt
from pinarm.engine.integration.methods.explicit import Adaptive, AdaptiveStepper
from pinarm.errors import MethodError
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.integration.dense_output import DenseOutput
    from pinarm.engine.integration.integrator import Count, Energy, Interval, Manifold, Projection, Solution
    from pinarm.engine.integration.steps import StepTable

SLOW = 1e-2
"""Kinetic energy, over its largest value so far, below which velocities are not scaled: near standstill a small
velocity would have to compensate the whole error of the potential energy."""

SCALED = 1e-10
"""Part of the kinetic energy by which rounding may change velocities in a step however fine the tolerance."""

ULPS = tuple(2.0**-52 * ulp for ulp in range(-4, 5))
"""Relative changes of configurations that are rounding."""


@dataclass(frozen=True)
class Conserving:
    """Dormand-Prince 8(5,3) with velocities scaled to the initial energy after every accepted step.

    ``v <- v sqrt((E_0 - V(q)) / T(q, v))``: the change of v of least kinetic energy, which every loop allows because
    its rows are linear in v. Order 8, dense output of order 7 as of ``Adaptive``; the energy at the ends of
    steps is constant to rounding, however many there are. Source: Hairer, Lubich, Wanner, Geometric Numerical
    Integration, section IV.4.

    For runs over thousands of periods without dampers, drives and laws; it refuses those. It conserves the energy and
    nothing else: where a motion is so small that rounding of its energies is too much beside the kinetic one,
    velocities are left as they are, which is said. Other integrals and the phase have the errors of ``Adaptive``, of
    the tolerance per step, and the energy no longer measures them. Tolerances above 1e-6 give motions of the right
    energy with a wrong course.

    Chosen by measurement, on the double pendulum of two rods from (2.2, 1.0) rad (chaotic, to 30 rad/s; milliseconds a
    simulated second, in Python): Gauss-Legendre methods in (q, p), which are symplectic, of order 4, 6 and 8 take 28,
    46 and 27 to keep the energy within 5e-5, 1e-6 and 2e-5 of it, and lose it altogether at twice the step;
    compositions of the midpoint variational integrator of order 4 take 64 for 2e-4. This takes 3 at a tolerance of
    1e-9, for 1e-14.

    Attributes:
        tolerance: Local error per step, relative to ``size + |y|``, see ``Interval.size``; good values 1e-7 to 1e-12.
    """

    tolerance: float
    subdivisions = 4
    tangent = True
    pair = None

    @property
    def steps(self) -> Adaptive:
        """The method that takes the steps."""
        return Adaptive(self.tolerance)

    @property
    def name(self) -> str:
        """Name for messages."""
        return f"{self.steps.name} at constant energy"

    @property
    def order(self) -> int:
        """Order of the step."""
        return self.steps.order

    @property
    def remedy(self) -> str:
        """What to try where it fails."""
        return self.steps.remedy

    def prepare(self, intervals: Sequence[Interval], q: Array, v: Array) -> Sequence[Interval]:
        """Return the intervals with states projected onto the initial energy as well.

        Raises:
            MethodError: The energy is not constant.
        """
        if any(interval.energy is None for interval in intervals):
            raise MethodError(
                "the method conserving is for motions at constant energy: dampers, drives, loads over time and "
                "coordinates that follow laws exchange energy",
                hint="accuracy.method: dop853",
            )
        level = sum(intervals[0].energy(q, v)) if intervals[0].energy else 0.0
        return [replace(each, settle=_keeping(level, self.tolerance, each.energy, each.settle)) for each in intervals
                if each.energy]  # fmt: skip

    def stepper(self, manifold: Manifold, count: Count) -> AdaptiveStepper:
        """Return a stepper of this method."""
        return self.steps.stepper(manifold, count)

    def dense_output(self, interval: Interval, manifold: Manifold, steps: StepTable) -> DenseOutput:
        """Return the terms of the dense output."""
        return self.steps.dense_output(interval, manifold, steps)

    def diagnose(self, solution: Solution) -> list[Doubt]:
        """Return doubts where the stability limit, not the error, keeps steps short, or energies are rounding."""
        nq, energy = solution.manifold.nq, solution.intervals[0].energy
        states = [(y[:nq], y[nq:]) for y in solution.steps.y]
        doubts = self.steps.diagnose(solution)
        if energy and states:
            kinetic = max(energy(*state)[0] for state in states)
            rounding = _rounding(energy, *states[-1])
            if kinetic and not _is_resolved(kinetic, rounding, self.tolerance):
                text = (
                    f"conserving: rounding of the potential energy, {rounding:.1g} J, is too much beside the kinetic "
                    f"energy, {kinetic:.1g} J: the energy is not conserved better than by {self.steps.name}"
                )
                doubts.append(Doubt("conserving", kinetic, text))
        return doubts


def _rounding(energy: Energy, q: Array, v: Array) -> float:
    """Return what rounding leaves of the potential energy in a state [J]: its range over some ulps, at least one."""
    potential = [energy(q * (1.0 + part), v)[1] for part in ULPS]
    return max(max(potential) - min(potential), 2.0**-52 * abs(potential[0]))


def _is_resolved(kinetic: float, rounding: float, tolerance: float) -> bool:
    """Return whether rounding of the energies changes velocities by less than a step may."""
    return rounding < kinetic * max(tolerance, SCALED)


def _keeping(level: float, tolerance: float, energy: Energy, settle: Projection | None) -> Projection:
    """Return the projection onto the constraints and then onto the energy ``level`` [J]: ``v sqrt((E - V) / T)``."""
    largest, rounding = 0.0, -1.0

    def project(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        nonlocal largest, rounding
        if settle is not None:
            q, v = settle(t, q, v)
        kinetic, potential = energy(q, v)
        largest = max(largest, kinetic)
        wanted = level - potential
        if rounding < 0.0:
            rounding = _rounding(energy, q, v)
        if kinetic > SLOW * largest and _is_resolved(kinetic, rounding, tolerance) and wanted > 0.0:
            v = v * (wanted / kinetic) ** 0.5
        return q, v

    return project
