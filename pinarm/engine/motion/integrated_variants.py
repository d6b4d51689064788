"""Free motions of variants of a tree, integrated together: states with an axis of variants after the rows.

Each motion takes the steps that it takes alone, which follow from its own errors. Dense output, accelerations, energy
and quantities are computed of all of them at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.parallel import aba
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.ensemble import Ensemble
from pinarm.engine.integration.integrator import Acceleration, Interval
from pinarm.engine.integration.solution import Solution
from pinarm.engine.kernel.tree import AGREEMENT, TreeFlow
from pinarm.engine.kernel.tree_variants import variant_flows
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.segmented.hybrid_motion import MOST, MOST_ROUNDING
from pinarm.engine.motion.segmented.segments import OFFSET, REST, SMALL
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import IntegrationError
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.kernel.library import Flow
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.segmented.hybrid_system import HybridSystem


class FreeMotion(NamedTuple):
    """A free motion that is to be integrated.

    Attributes:
        q: Configuration at the start, shape (nq,).
        v: Velocity, shape (nv,).
        time: First and last instant [s].
        grid: Its rows.
    """

    q: Array
    v: Array
    time: tuple[float, float]
    grid: Grid


@dataclass(frozen=True, eq=False)
class IntegratedVariants:
    """Free motions of variants of a tree.

    Attributes:
        run: The rows of the first variant.
        motion: Its motion.
        mechanism: The variants.
        ensemble: Motions of these and others, without jumps and events.
        chosen: Which of the motions are theirs, shape (k,).
        grids: The rows of each of them, as many; the same object where they are the same.
    """

    run: Trajectory
    motion: IntegratedMotion
    mechanism: Mechanism
    ensemble: Ensemble
    chosen: Indices
    grids: Sequence[Grid]

    @classmethod
    def integrated(
        cls, run: Trajectory, motion: IntegratedMotion, mechanism: Mechanism, motions: Sequence[FreeMotion]
    ) -> IntegratedVariants:
        """Integrate motions of variants, given the rows and the motion of the first.

        Raises:
            VariantsDiffer: The motion of the first is not compiled.
        """
        flow = compiled(motion.hybrid)
        if flow is None:
            raise VariantsDiffer("the motion of a tree that is not compiled")
        ensemble = _integrated(motion.hybrid, *variant_flows(flow, mechanism.model), motions)
        grids = [each.grid for each in motions]
        return cls(run, motion, mechanism, ensemble, np.arange(len(motions)), grids)

    def some(self, mechanism: Mechanism, variants: Indices, grids: Sequence[Grid]) -> IntegratedVariants:
        """Return some of the variants, of which these are the mechanism, at other rows."""
        return replace(self, mechanism=mechanism, chosen=self.chosen[variants], grids=grids)

    def rows(self) -> tuple[Trajectory, Flags]:
        """Return the states, and which of them are sound, shape (k,)."""
        dynamics, (q, v) = self.dynamics, self.ensemble.states_in(self._steps, self._instants)
        a = _accelerations(dynamics, q, v)
        lam, still = Multipliers.known(np.zeros((*q.shape[:2], 0)), 0), np.zeros_like(v)
        rows = replace(self.run, grid=self._grid, mechanism=self.mechanism, q=q, v=v, a=a, tau=still, lam=lam,
                       closure=self.mechanism.closure, dynamics=dynamics)  # fmt: skip
        return rows, self.ensemble.arrived[self.chosen] & self._agree

    def at(self, near: Array) -> tuple[Trajectory, Flags]:
        """Return the states; they are found without states that are near."""
        return self.rows()

    @property
    def interpolated(self) -> Flags:
        """The steps of the motions within which rows are, shape (steps,)."""
        inside = self._steps[self._instants != self.ensemble.solution.steps.t[self._steps]]
        return np.bincount(inside, minlength=len(self.ensemble.motion)) > 0

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equation of motion of the variants."""
        hybrid = self.motion.hybrid
        return Dynamics.of_variants(self.mechanism.model, hybrid.dynamics.on(*hybrid.time).forces)

    @cached_property
    def _grid(self) -> Grid:
        return grid_of_variants(self.grids)

    @cached_property
    def _steps(self) -> Indices:
        """The steps in which the rows are, shape (n, k)."""
        return self.ensemble.located(self.chosen, self._grid.t)

    @property
    def _instants(self) -> Array:
        """The instants of the rows [s], shape (n, k)."""
        return np.broadcast_to(self._grid.t.reshape(len(self._grid.t), -1), self._steps.shape)

    @cached_property
    def _agree(self) -> Flags:
        """Of which motions Pinocchio's accelerations are those of the library, in a state of no special kind."""
        nv, count = self.mechanism.model.nv, len(self.chosen)
        state = np.sin(1.0 + 1.3 * np.arange(nv)), np.cos(2.0 + 2.9 * np.arange(nv))
        q, v = (np.broadcast_to(x, (1, count, nv)) for x in state)
        (expected,) = aba(self.dynamics.model, q, v, self.dynamics.loads(0.0, q, v))
        intervals = (self.ensemble.solution.intervals[k] for k in self.chosen)
        a = np.array([interval.acceleration(0.0, *state) for interval in intervals])
        return _close(a - expected, expected, (v * v).sum(axis=-1)[0], AGREEMENT)


def compiled(hybrid: HybridSystem) -> TreeFlow | None:
    """Return the motion of a free tree in compiled code.

    ``None`` where it is not, where efforts follow laws, or where steps are not those of a pair.
    """
    flow = hybrid.closed_system.interval(hybrid.dynamics, *hybrid.time).compiled
    flat = hybrid.closed_system.manifold.nq == hybrid.closed_system.manifold.nv
    lasting = isinstance(flow, TreeFlow) and not flow.system.structure.laws
    return flow if isinstance(flow, TreeFlow) and lasting and flat and hybrid.method.pair is not None else None


def _integrated(
    hybrid: HybridSystem, flows: Sequence[Flow], finite: Flags, motions: Sequence[FreeMotion]
) -> Ensemble:  # fmt: skip
    """Return motions whose errors are relative to their own sizes where these are small; see ``integrate_to_size``.

    Those so small that rounding of their accelerations may matter have not arrived: they are to be solved alone.
    """
    solutions, arrived = list[Solution](), finite.copy()
    for number, (flow, motion) in enumerate(zip(flows, motions, strict=True)):
        try:
            solutions.append(_alone(hybrid, flow, motion))
        except IntegrationError as error:
            solutions.append(error.partial)
            arrived[number] = False
    return Ensemble.joined(solutions, arrived)


def _alone(hybrid: HybridSystem, flow: Flow, motion: FreeMotion) -> Solution:
    """Return one motion.

    Raises:
        IntegrationError: It could not be followed to its end, or not to its own size.
    """
    size, most, manifold, method = hybrid.size, hybrid.max_steps, hybrid.closed_system.manifold, hybrid.method
    while True:
        interval = Interval(*motion.time, _acceleration(flow), size=size, compiled=flow)
        solution = integrate([interval], manifold, motion.q, motion.v, method, max_steps=most)
        if not 0.0 < solution.size < SMALL * size:
            break
        size, most = solution.size, min(most, MOST)
        if size * method.tolerance < MOST_ROUNDING:
            raise IntegrationError("the motion is as small as the rounding of accelerations", partial=solution)
    scale, moved = size + solution.size, solution.displacement
    if REST * scale < moved < OFFSET * scale:
        raise IntegrationError("the motion is small beside its coordinates", partial=solution)
    return solution


def _acceleration(flow: Flow) -> Acceleration:
    return lambda t, q, v: flow.slope(t, np.concatenate([q, v]))[len(q) :]


def _accelerations(dynamics: Dynamics, q: Array, v: Array) -> Array:
    """Return the accelerations of the equation of motion, shape (n, k, nv)."""
    return aba(dynamics.model, q, v, dynamics.loads(0.0, q, v))


def _close(apart: Array, expected: Array, more: Array | float, accuracy: float) -> Flags:
    """Return which vectors, shape (.., nv), are as small as accuracy times the size of others, and more."""
    return np.asarray(np.linalg.norm(apart, axis=-1) <= accuracy * (np.linalg.norm(expected, axis=-1) + more))


def grid_of_variants(grids: Sequence[Grid]) -> Grid:
    """Return the rows of variants as those of one grid: of all, shape (n,), or of each, shape (n, k)."""
    first = grids[0]
    alike = all(grid is first for grid in grids)
    return first if alike else replace(first, t=np.stack([grid.t for grid in grids], axis=1))
