"""Prescribed motions of variants of a mechanism: positions, velocities and accelerations of all rows at once.

From configurations near the rows of every variant Newton's method leads to these: from row i of the first variant, or
where laws vary from a coarse continuation. The rows are one motion each, on the branch that the start chooses, if

- the first row is one step of a continuation away from the closed drawing, within the limits of joints;
- every row is near the one that velocity and acceleration predict from the row before, and moves as that predicts;
- the determinant of J keeps its sign, and its inverse about its size.

A variant of which one of these is not so is solved alone. Arrays have the shape (n, k, ..), rows and variants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import VariantClosure
from pinarm.engine.constraints.nullspace import RANK, VANISHED
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.continuation import NEAR, BatchClosing, Rates
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.newton import ITERATIONS, NewtonSolver
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.singular import on_branch
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable, Prescription
from pinarm.engine.motion.standstill import lossy
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.statics.actuation import WEAK, Actuation, DriveAtEveryJoint, SelectedDrives, least_efforts
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

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
        return self._solved(self._followers.follow_near(self._laws, near))

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
        return self._followers.follow(t, laws, near, start)

    @cached_property
    def _followers(self) -> VariantMotion:
        motion = self.tables[0].prescription.motion
        assert isinstance(motion, DeterminedMotion)
        if self.tables[0].prescription.rates is not None:
            raise VariantsDiffer("velocities that are given row by row")
        return VariantMotion.of(self._closure, motion.prescribed, self.run.q[0])

    @cached_property
    def _laws(self) -> Array:
        values = [[table.grid.evaluate(law) for law in table.prescription.motion.laws] for table in self._different]
        return np.array(values).transpose(2, 3, 0, 1)

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


STEPS = 12
"""Most steps from a row of the first variant: from an angle of 0.5 rad five or six."""

UNEVEN = 50.0
"""Largest ratio of the largest entry of J^-1 in a motion to its least: beyond it singular positions may be near, at
which rows are interpolated (``motion.singular_passage``)."""

COARSE = 0.25
"""Change of the first variant's coordinates between rows that are solved one after the other [rad or m]: a prediction
by velocity and acceleration errs by some hundredths of it, and of twice as fast a variant by a tenth."""

SAME = 1e-6
"""Difference of configurations of one branch, that were closed from different places [rad or m]: rounding only."""


class VariantStates(NamedTuple):
    """The states of k variants at n rows.

    Attributes:
        q: Configurations, shape (n, k, nq).
        v: Velocities, shape (n, k, nv).
        a: Accelerations, shape (n, k, nv).
        sound: Which variants are on the branch of their start all along, shape (k,).
    """

    q: Array
    v: Array
    a: Array
    sound: Flags


class VariantMotion(Record, frozen=True):
    """Motion of variants of a mechanism by prescribed coordinates.

    Attributes:
        solver: Newton's method on one variant, for the curved rows and the units of all variants.
        closing: Newton's method on all variants and the prescribed coordinates.
    """

    solver: NewtonSolver
    own: VariantClosure
    closing: BatchClosing

    @classmethod
    def of(cls, own: VariantClosure, prescribed: PrescribedCoordinates, q: Array) -> VariantMotion:
        """Return the motion, given a configuration of the first variant, shape (nq,).

        Raises:
            VariantsDiffer: Something cannot be had of many states, or the first variant is near a singular position.
        """
        solver, whole = NewtonSolver(own.first, prescribed), own.with_guides(prescribed.names, prescribed.coordinates)
        if not solver.sliding.all():
            raise VariantsDiffer("screws, whose turns are counted")
        closing = BatchClosing.of(whole, own.size, solver.whole.rows(solver.whole.state(q)))
        if closing is None:
            raise VariantsDiffer("a motion that begins near a singular position")
        return cls(solver, own, closing)

    def follow(self, t: Array, laws: Array, near: Array, start: Array) -> VariantStates:
        """Return the states.

        Args:
            t: The parameter at the rows, shape (n,), or (n, k) where it varies.
            laws: The prescribed coordinates and their two derivatives, shape (3, n, k or 1, d).
            near: Configurations near those of the rows, shape (n, k or 1, nq).
            start: Configurations of the drawing, or of the start, shape (k or 1, nq): they choose the branch.
        """
        with np.errstate(all="ignore"):  # of variants that are to be solved alone
            q, rates, sound = self._solved(laws, near)
            good = sound.all(axis=0) & _is_one_motion(t.reshape(len(t), -1), q, rates)
            first, begun = self._begun(start, laws)
            good &= begun & (np.abs(first - q[0]).max(axis=-1) <= SAME)
        return self._sound(q, rates, good)

    def follow_near(self, laws: Array, near: Array) -> VariantStates:
        """Return states each of its own, near configurations that are predicted from states of the motion."""
        with np.errstate(all="ignore"):
            q, rates, sound = self._solved(laws, near)
            good = sound & (np.abs(q - near).max(axis=-1) <= NEAR)
        return self._sound(q, rates, good.all(axis=0))

    def continued(self, t: Array, laws: Array, first: Array, start: Array) -> Array:
        """Return configurations near those of the rows, shape (n, k, nq), where variants follow laws of their own.

        Some of the rows are solved one after the other; their velocities and accelerations predict the rows between.

        Args:
            t: The parameter at the rows, shape (n, k or 1).
            laws: The prescribed coordinates and their two derivatives, shape (3, n, k or 1, d).
            first: Configurations of the first variant, shape (n, nq).
            start: See ``follow``.
        """
        most = float(np.abs(np.diff(first, axis=0)).max(initial=0.0))
        step = max(1, int(COARSE / max(most, 1e-300)))
        near = np.empty((len(first), len(self.own.model), first.shape[1]))
        with np.errstate(all="ignore"):
            near[0], _ = self._begun(start, laws)
            for row in range(0, len(first), step):
                q, rates, _ = self._solved(laws[:, row : row + 1], near[row : row + 1])
                h = (t[row + 1 : row + 1 + step] - t[row])[..., None]
                near[row + 1 : row + 1 + step] = q + h * (rates.v + 0.5 * h * rates.a)
        return near

    def _spread(self, x: Array) -> Array:
        return np.ascontiguousarray(np.broadcast_to(x, (len(x), len(self.own.model), x.shape[-1])))

    def _solved(self, laws: Array, near: Array) -> tuple[Array, Rates, Flags]:
        """Return configurations near given ones, their rates, and where they are closed, shape (n, k)."""
        (w, dw, ddw), closing = map(self._spread, laws), self.closing
        q, _, _, done = closing.solve(self._spread(near), w, STEPS)
        measured = closing.at(q)
        return q, closing.rates(measured, dw, ddw), done & closing.closed(measured, w)

    def _sound(self, q: Array, rates: Rates, good: Flags) -> VariantStates:
        """Return states; those of variants that are not good are the first's."""
        q, v, a = (np.where(good[:, None], x, x[:, :1]) for x in (q, rates.v, rates.a))
        return VariantStates(q, v, a, good & self.own.alike_in_size)

    def _begun(self, start: Array, laws: Array) -> tuple[Array, Flags]:
        """Return first positions, shape (k, nv), and where they are one step from closed drawings, within limits."""
        drawn, good = self._drawn(self._spread(start[None])[0])
        first, _, reached = self._solved(laws[:, :1], drawn[None])
        w, states = self._spread(laws[0, :1]), np.concatenate([drawn[None], first])
        change = self.closing.missing(self.closing.at(drawn[None]), w)[..., self.own.size :].repeat(2, axis=0)
        rates = self.closing.rates(self.closing.at(states), change, np.zeros_like(change))
        one_step = _is_one_motion(np.array([[0.0], [1.0]]), states, rates)
        model, given = self.own.first.model, {getattr(x, "joint", None) for x in self.solver.coordinates}
        judged = [k for k in range(model.nq) if k not in given]
        low, high = model.lowerPositionLimit[judged], model.upperPositionLimit[judged]
        within = ((states[..., judged] >= low) & (states[..., judged] <= high)).all(axis=(0, -1))
        return first[0], good & one_step & reached[0] & within

    def _drawn(self, q: Array) -> tuple[Array, Flags]:
        """Return where damped steps close the loops, shape (k, nv), and where every step made gaps smaller, (k,)."""
        solver, size, m = self.solver, np.full(len(q), np.inf), self.own.size
        good = np.ones(len(q), dtype=bool)
        allowed = self.closing.allowed(np.zeros(self.closing.rows.size - m))[:m]
        for _ in range(ITERATIONS):
            measured = self.closing.at(q[None])
            gaps = -measured.gaps[0][:, :m]
            closed = (np.abs(gaps) <= allowed).all(axis=-1)
            left = np.linalg.norm(gaps / solver.measure[:m], axis=-1)
            good &= closed | (left < size)
            if (closed | ~good).all():
                break
            rows = measured.matrices[0][:, :m]
            counts = np.linalg.norm(rows, axis=2, keepdims=True) > VANISHED * self.closing.rows.reach[:m, None]
            rows = rows * counts * (solver.scale / solver.measure[:m, None])
            step = np.matvec(np.linalg.pinv(rows, rcond=RANK), gaps / solver.measure[:m])
            turning = rows[:, solver.curved[:m]].any(axis=1)
            most = np.where(turning, np.abs(step), 0.0).max(axis=-1)
            step *= np.where(closed, 0.0, np.minimum(1.0, 0.5 / np.maximum(most, 1e-300)))[:, None]
            q, size = q + solver.scale * step, left
        return q, good & closed


def _is_one_motion(t: Array, q: Array, rates: Rates) -> Flags:
    """Tell in which variants each row follows from the one before, shape (k,), given the parameter, (n, k or 1)."""
    h, v, a = np.diff(t, axis=0)[..., None], rates.v, rates.a
    slope = v[:-1] + h * a[:-1]
    correction = np.abs(q[1:] - q[:-1] - 0.5 * h * (v[:-1] + slope)).max(axis=-1)
    near = (correction <= NEAR) & on_branch(h * (v[1:] - slope), correction) & (rates.sense[1:] == rates.sense[:-1])
    return np.asarray(near.all(axis=0) & (rates.size.max(axis=0) <= UNEVEN * rates.size.min(axis=0)))
