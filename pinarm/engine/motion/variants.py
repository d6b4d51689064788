"""Motions of variants of a mechanism, free or prescribed: states with an axis of variants after the rows.

Each free motion of a tree takes the steps that it takes alone, which follow from its own errors. Dense output,
accelerations, energy and quantities are computed of all of them at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics, aba
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Acceleration, Interval
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.integration.solution import Solution
from pinarm.engine.kernel.tree import AGREEMENT, TreeFlow, variant_flows
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.variant_motion import VariantClosure, VariantMotion, VariantStates
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable, Prescription
from pinarm.engine.motion.segmented.hybrid_motion import MOST, MOST_ROUNDING
from pinarm.engine.motion.segmented.segments import OFFSET, REST, SMALL
from pinarm.engine.motion.standstill import lossy
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import Actuation, DriveAtEveryJoint
from pinarm.engine.statics.effort_distribution import UNIQUE, WEAK, SelectedDrives
from pinarm.errors import IntegrationError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, driven_along
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

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
        dynamics, (q, v) = self.dynamics, self.ensemble.states_in(self._steps, self._instants)
        a = _accelerations(dynamics, q, v)
        lam, still = Multipliers.known(np.zeros((*q.shape[:2], 0)), 0), np.zeros_like(v)
        rows = replace(self.run, grid=self._grid, mechanism=self.mechanism, q=q, v=v, a=a, tau=still, lam=lam,
                       closure=self.mechanism.closure, dynamics=dynamics)  # fmt: skip
        return rows, self.ensemble.arrived[self.chosen] & self._agree

    def at(self, near: Array) -> tuple[Trajectory, Flags]:
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
    if not isinstance(flow, TreeFlow) or flow.system.structure.laws:
        return None
    return flow if flat and isinstance(hybrid.method, Adaptive) else None


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


class Ensemble(Record, frozen=True):
    """The steps of b motions, each in an interval of its own, and their states in between.

    Attributes:
        solution: The steps of all motions, those of each one after the other.
        motion: The motion of each step, ascending, shape (steps,).
        arrived: Which motions have come to their ends, shape (b,).
    """

    solution: Solution
    motion: Indices
    arrived: Flags

    @classmethod
    def joined(cls, solutions: Sequence[Solution], arrived: Flags) -> Ensemble:
        """Return motions that have been integrated."""
        motion = np.arange(len(solutions)).repeat([len(one.steps) for one in solutions])
        intervals = [one.intervals[0] for one in solutions]
        whole, stepped = Solution(solutions[0].method, solutions[0].manifold, intervals), [x.steps for x in solutions]
        if len(motion):
            columns = (np.concatenate([getattr(x, of) for x in stepped if len(x)]) for of in ("times", "y", "slopes"))
            times, y, slopes = columns
            whole.steps.extend(times, y, slopes, motion, np.zeros((len(motion), 3), np.intp))
        return cls(whole, motion, arrived)

    @cached_property
    def counts(self) -> Indices:
        """Number of steps of each motion, shape (b,)."""
        return np.bincount(self.motion, minlength=len(self.arrived))

    @cached_property
    def firsts(self) -> Indices:
        """The first step of each motion, shape (b,)."""
        return np.cumsum(self.counts) - self.counts

    def located(self, motions: Indices, t: Array) -> Indices:
        """Return the steps of some motions in which instants are, of all or of each, shape (n,) or (n, m): (n, m)."""
        found = np.empty((len(t), len(motions)), dtype=np.intp)
        columns, starts = np.broadcast_to(t.reshape(len(t), -1), found.shape), self.solution.steps.t
        spans = zip(self.firsts[motions].tolist(), self.counts[motions].tolist(), strict=True)
        for column, (first, count) in enumerate(spans):
            found[:, column] = starts[first : first + count].searchsorted(columns[:, column], side="right")
        return np.clip(found - 1, 0, np.maximum(self.counts[motions] - 1, 0)) + self.firsts[motions]

    def states_in(self, step: Indices, t: Array) -> tuple[Array, Array]:
        """Return the states at instants in steps, both of shape (..): q of shape (.., nq) and v of shape (.., nv)."""
        q, v = self.solution.states_in(step.ravel(), t.ravel())
        return q.reshape(*step.shape, -1), v.reshape(*step.shape, -1)


@dataclass(frozen=True, eq=False)
class PrescribedVariants:
    """A prescribed motion in variants of its mechanism, which follow the same laws or each its own.

    Attributes:
        motion: The motion of the first variant.
        run: Its rows.
        mechanism: The variants.
        tables: What each of them follows at as many rows; the same object where that is the same.
    """

    motion: PrescribedMotion
    run: Trajectory
    mechanism: Mechanism
    tables: Sequence[PrescribedTable]

    @property
    def grids(self) -> list[Grid]:
        return [table.grid for table in self.tables]

    def some(self, mechanism: Mechanism, variants: Indices, grids: Sequence[Grid]) -> PrescribedVariants:
        """Return some of the variants, of which these are the mechanism, at other rows."""
        some = zip(variants.tolist(), grids, strict=True)
        return replace(self, mechanism=mechanism, tables=[replace(self.tables[k], grid=grid) for k, grid in some])

    def rows(self) -> tuple[Trajectory, Flags]:
        """Return the states with the efforts that they take, and which variants are on the branch, shape (k,).

        Raises:
            VariantsDiffer: Something is computed of one mechanism at a time.
        """
        if self._alike and (self._closure.model.in_place or self._open):
            run, every = self.run, np.ones(len(self.tables), dtype=bool)
            return self._solved(VariantStates(run.q[:, None], run.v[:, None], run.a[:, None], every))
        return self._solved(self._each_alone() if self._open else self._followed())

    def at(self, near: Array) -> tuple[Trajectory, Flags]:
        """Return the same at rows each of which is a state of its own, near configurations of shape (n, k, nq).

        Raises:
            VariantsDiffer: See ``rows``.
        """
        return self._solved(
            self._each_alone() if self._open else self._rated(self._followers.follow_near(self._laws, near))
        )

    @cached_property
    def _closure(self) -> VariantClosure:
        closure = self.mechanism.closure
        assert isinstance(closure, VariantClosure)
        return closure

    @cached_property
    def _alike(self) -> bool:
        return all(table is self.tables[0] for table in self.tables)

    @property
    def _open(self) -> bool:
        """Whether coordinates of joints determine the positions, whatever the lengths are."""
        followed = self.motion.prescription.motion.coordinates
        return not self._closure.size and all(isinstance(coordinate, LinearCoordinate) for coordinate in followed)

    def _each_alone(self) -> VariantStates:
        """Return the states of open chains, by the function that solves one of them."""
        found = [table.prescription.moving(table.grid, table.start) for table in self.tables]
        q, v, a = (np.stack([getattr(run, name) for run in found], axis=1) for name in ("q", "v", "a"))
        return VariantStates(q, v, a, np.ones(len(found), dtype=bool))

    def _followed(self) -> VariantStates:
        """Return the states by Newton's method, for all variants at once."""
        laws, first = self._laws, self.run.q
        tables = self.tables[:1] if self._alike else self.tables
        t = np.stack([table.grid.t for table in tables], axis=1)
        start = np.array([table.start for table in tables])
        near = first[:, None] if self._alike else self._followers.continued(t, laws, first, start)
        return self._rated(self._followers.follow(t, laws, near, start))

    @cached_property
    def _followers(self) -> VariantMotion:
        return VariantMotion.of(self._closure, _determined(self.tables[0]).prescribed, self.run.q[0])

    @cached_property
    def _laws(self) -> Array:
        """The prescribed coordinates and their two derivatives, shape (3, n, k or 1, d)."""
        tables = self.tables[:1] if self._alike else self.tables
        values = [[table.grid.evaluate(law) for law in table.prescription.motion.laws] for table in tables]
        return np.array(values).transpose(2, 3, 0, 1)

    def _rated(self, states: VariantStates) -> VariantStates:
        """Return states with the velocities and accelerations that are given for every row, where they are."""
        tables = self.tables[:1] if self._alike else self.tables
        rates = [table.prescription.rates for table in tables if table.prescription.rates is not None]
        if not rates:
            return states
        dw, ddw = np.array(rates).swapaxes(0, 1)
        v, a = self._followers.rates(states.q, dw, ddw)
        return states._replace(v=v, a=a)

    def _solved(self, states: VariantStates) -> tuple[Trajectory, Flags]:
        """Return states as rows with efforts."""
        closure, prescription = self._closure, self.motion.prescription
        if lossy(prescription.mechanism):
            raise VariantsDiffer("the directions of joints, on which the losses of gears depend")
        dynamics = Dynamics.of_variants(closure.model, prescription.dynamics.forces)
        drives = None if prescription.drives is None else _drives(prescription.drives, closure)
        q, v, a, sound = states
        grid = grid_of_variants(self.grids)
        lam = Multipliers.known(np.zeros((*q.shape[:2], closure.size)), closure.size)
        rows = replace(self.run, grid=grid, mechanism=self.mechanism, q=q, v=v, a=a, tau=np.zeros_like(v), lam=lam,
                       closure=closure, dynamics=dynamics)  # fmt: skip
        known = replace(prescription, mechanism=self.mechanism, dynamics=dynamics, drives=drives)
        return known.solved(rows, self.motion.pace), sound


def follows_alike(table: PrescribedTable, first: PrescribedTable) -> bool:
    """Tell whether a variant follows laws of the same coordinates at as many rows, between as many jumps."""
    names = [_names(one.prescription) for one in (table, first)]
    return names[0] is not None and names[0] == names[1] and table.grid.rows == first.grid.rows


def _names(prescription: Prescription) -> tuple[str, ...] | None:
    motion = prescription.motion
    return motion.prescribed.names if isinstance(motion, DeterminedMotion) else None


def _determined(table: PrescribedTable) -> DeterminedMotion:
    motion = table.prescription.motion
    assert isinstance(motion, DeterminedMotion)
    return motion


def _drives(drives: Actuation, closure: VariantClosure) -> Actuation:
    """Return the same drives on variants.

    Raises:
        VariantsDiffer: They share the load, act along task coordinates, or leave joints that mimic others.
    """
    if isinstance(drives, DriveAtEveryJoint):
        return DriveAtEveryJoint(closure)
    if not isinstance(drives, SelectedDrives) or drives.tasks or drives.distribution is not UNIQUE:
        raise VariantsDiffer("drives that share the load, act along task coordinates, or move joints that mimic others")
    return DrivesOfVariants(drives.joints, closure)


class DrivesOfVariants(Record, frozen=True):
    """Drives at joints of variants, as many as there are degrees of freedom; see ``SelectedDrives``.

    Attributes:
        joints: Coordinates of joints, and sums of them, that drives act along, by name.
        closure: The constraints of the variants.
    """

    joints: Mapping[str, LinearCoordinate]
    closure: VariantClosure

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        return self.joints

    @property
    def driven(self) -> Flags:
        return driven_along(self.joints.values(), self.closure.model.nv)

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the efforts and the multipliers, both from G taken apart once; NaN where they are not determined."""
        ((_, split),), weights = self.closure.splits(q).parts, np.array([one.weights for one in self.joints.values()])
        ways, load = np.einsum("nkjf,dj->nkfd", split.free, weights), np.einsum("nkjf,nkj->nkf", split.free, demand)
        ways = np.broadcast_to(ways, (*load.shape, len(weights))).reshape(-1, load.shape[-1], len(weights))
        least = np.full(len(ways), WEAK * np.linalg.norm(weights, axis=1).max())
        effort, good = UNIQUE.efforts(ways, load.reshape(len(ways), -1), least, np.zeros(len(ways)))
        tau = (np.where(good[:, None], effort, np.nan) @ weights).reshape(demand.shape)
        return tau, Multipliers.known(split.multipliers(demand - tau), self.closure.size)
