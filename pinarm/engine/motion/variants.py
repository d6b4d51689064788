"""Prescribed motions of variants of a mechanism: states with an axis of variants after the rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import VariantClosure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.variant_motion import VariantMotion, VariantStates
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable, Prescription
from pinarm.engine.motion.standstill import lossy
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import WEAK, Actuation, DriveAtEveryJoint, SelectedDrives, least_efforts
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class PrescribedVariants:
    """A prescribed motion in variants of its mechanism, which follow the same laws or each its own.

    ``run`` are the rows of the motion of the first variant; ``tables`` what each variant follows at as many rows,
    the same object where that is the same.
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
        """Return states and mask as ``rows`` does, at separate states near configurations of shape (n, k, nq)."""
        if self._open:
            return self._solved(self._each_alone())
        return self._solved(self._rated(self._followers.follow_near(self._laws, near)))

    @cached_property
    def _closure(self) -> VariantClosure:
        closure = self.mechanism.closure
        assert isinstance(closure, VariantClosure)
        return closure

    @cached_property
    def _alike(self) -> bool:
        return all(table is self.tables[0] for table in self.tables)

    @property
    def _different(self) -> Sequence[PrescribedTable]:
        return self.tables[:1] if self._alike else self.tables

    @property
    def _open(self) -> bool:
        """Whether coordinates of joints determine the positions, whatever the lengths are."""
        followed = self.motion.prescription.motion.coordinates
        return not self._closure.size and all(isinstance(coordinate, LinearCoordinate) for coordinate in followed)

    def _each_alone(self) -> VariantStates:
        """Return the states of open chains, by the function that solves one of them."""
        motions = [table.prescription.moving(table.grid, table.start) for table in self.tables]
        q, v, a = (np.stack([getattr(run, name) for run in motions], axis=1) for name in ("q", "v", "a"))
        return VariantStates(q, v, a, np.ones(len(motions), dtype=bool))

    def _followed(self) -> VariantStates:
        """Return the states by Newton's method, for all variants at once."""
        laws, first = self._laws, self.run.q
        t = np.stack([table.grid.t for table in self._different], axis=1)
        start = np.array([table.start for table in self._different])
        near = first[:, None] if self._alike else self._followers.continued(t, laws, first, start)
        return self._rated(self._followers.follow(t, laws, near, start))

    @cached_property
    def _followers(self) -> VariantMotion:
        motion = self.tables[0].prescription.motion
        assert isinstance(motion, DeterminedMotion)
        return VariantMotion.of(self._closure, motion.prescribed, self.run.q[0])

    @cached_property
    def _laws(self) -> Array:
        values = [[table.grid.evaluate(law) for law in table.prescription.motion.laws] for table in self._different]
        return np.array(values).transpose(2, 3, 0, 1)

    def _rated(self, states: VariantStates) -> VariantStates:
        """Return states with the velocities and accelerations that are given for every row, where they are."""
        rates = [table.prescription.rates for table in self._different if table.prescription.rates is not None]
        if not rates:
            return states
        dw, ddw = np.array(rates).swapaxes(0, 1)
        v, a = self._followers.rates(states.q, dw, ddw)
        return states._replace(v=v, a=a)

    def _solved(self, solved: VariantStates) -> tuple[Trajectory, Flags]:
        closure, prescription = self._closure, self.motion.prescription
        if lossy(prescription.mechanism):
            raise VariantsDiffer("the directions of joints, on which the losses of gears depend")
        dynamics = Dynamics.of_variants(closure.model, prescription.dynamics.forces)
        drives = None if prescription.drives is None else _drives(prescription.drives, closure)
        q, v, a, sound = solved
        grid, times = self.grids[0], [grid.t for grid in self.grids]
        grid = grid if all(t is grid.t for t in times) else replace(grid, t=np.stack(times, axis=1))
        lam = np.zeros((*q.shape[:2], closure.size))
        states = {"q": q, "v": v, "a": a, "tau": np.zeros_like(v), "lam": lam}
        rows = replace(self.run, grid=grid, mechanism=self.mechanism, closure=closure, dynamics=dynamics, **states)
        known = replace(prescription, mechanism=self.mechanism, dynamics=dynamics, drives=drives)
        return known.solved(rows, self.motion.pace), sound


def follows_alike(table: PrescribedTable, first: PrescribedTable) -> bool:
    """Tell whether a variant follows laws of the same coordinates at as many rows, between as many jumps."""
    names = [_names(variant.prescription) for variant in (table, first)]
    return names[0] is not None and names[0] == names[1] and table.grid.rows == first.grid.rows


def _names(prescription: Prescription) -> tuple[str, ...] | None:
    motion = prescription.motion
    return motion.prescribed.names if isinstance(motion, DeterminedMotion) else None


def _drives(drives: Actuation, closure: VariantClosure) -> Actuation:
    """Return the drives under the constraints of the variants."""
    if isinstance(drives, DriveAtEveryJoint) and not drives.followers:
        return DriveAtEveryJoint(closure)
    if not isinstance(drives, SelectedDrives) or drives.tasks or drives.sharing is not None:
        raise VariantsDiffer("drives that share the load, act along task coordinates, or move joints that mimic others")
    return DrivesOfVariants(drives.joints, {}, closure, closure)


class DrivesOfVariants(SelectedDrives, frozen=True):
    """Drives at joints of variants, as many as there are degrees of freedom."""

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return the efforts and the multipliers, both from G taken apart once; NaN where they are not determined."""
        split = self.closure.split_at(q)
        weights = np.array([joint.weights for joint in self.joints.values()])
        ways, load = np.einsum("nkjf,dj->nkfd", split.free, weights), np.einsum("nkjf,nkj->nkf", split.free, demand)
        ways = np.broadcast_to(ways, (*load.shape, len(weights))).reshape(-1, load.shape[-1], len(weights))
        least = np.full(len(ways), WEAK * np.linalg.norm(weights, axis=1).max())
        effort, good = least_efforts(ways, load.reshape(len(ways), -1), least, np.zeros(len(ways)))
        good &= ways.shape[2] <= ways.shape[1]
        tau = (np.where(good[:, None], effort, np.nan) @ weights).reshape(demand.shape)
        return tau, split.multipliers(demand - tau)
