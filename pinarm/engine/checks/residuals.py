"""What the rows of a table say of themselves: how well loops are closed, how regular positions are, and the way back.

A fixed, even choice of rows is looked at, so that the cost of large tables stays bounded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.checks.figures import relative
from pinarm.engine.checks.free_masses import ConstrainedMasses, FreeMasses, MassMatrices, TreeMasses, TreeMassMatrices
from pinarm.engine.checks.sample import SAMPLE, sampled
from pinarm.engine.constraints.nullspaces.nullspace import MANY
from pinarm.engine.constraints.sparse_matrices import first_rows, times, transposed_times
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.sparse_matrices import Matrices
    from pinarm.engine.motion.outcome import SolvedMotion


def residual_figures(run: Trajectory, motion: SolvedMotion | None = None, most: int = SAMPLE) -> dict[str, Any]:
    """Return what the rows of a run are worth.

    Args:
        run: The table of states.
        motion: What they are states of: regularity is looked for between rows too where it is given.
        most: Largest number of rows that are looked at.

    Returns:
        Of rows at which all constraints hold:
        ``closure``, ``closure rate`` and ``closure acceleration``: largest gap of a loop [m or rad], and of its two
        derivatives. ``regularity``: smallest singular value of the constraints' rows relative to the largest, of as
        many as are independent at any row, looked for between rows where it becomes small; 0 at a singular position.
        ``least regular at``: where that is. ``relative regularity``: the smallest singular value there relative to its
        largest value in the run.
        ``condition``: largest condition number of the mass matrix of the free motions, scaled to a diagonal of ones.
        ``return trip``: largest difference of the accelerations that the efforts give by forward dynamics to those of
        the table, relative to the largest acceleration that efforts and loads would give if none of them cancelled;
        weights count with the most that they can do, ``g sqrt(m M_kk)`` for the mass m of all bodies (Cauchy-Schwarz),
        and forces of a motion at constant rates, which cancel in a steady precession, with ``omega sqrt(2 T M_kk)`` for
        the largest angular velocity omega of a body and the kinetic energy T.
        The last two are arrays, of variants of shape (k,), NaN where M is singular.
    """
    if run.no_efforts and not run.mechanism.closure.size:
        return {}
    rows = sampled(len(run), most)
    if run.opened is not None:  # what is open is not to be closed
        rows = rows[~run.opened[rows]]
    if not len(rows):
        return {}
    found = _Looked.at(run, rows)
    figures: dict[str, Any] = {}
    if run.mechanism.closure.size:
        gaps = zip(("closure", "closure rate", "closure acceleration"), found.gaps.max(axis=0), strict=True)
        figures.update(gaps)
        if run.unknown:  # rates that are NaN
            figures = {name: gap for name, gap in figures.items() if not np.isnan(gap).any()}
        from pinarm.engine.checks.singularity import nearest_singularity

        values = run.mechanism.closure.values_of(found.own)
        nearest = nearest_singularity(run, motion, rows, values)
        figures |= {
            "regularity": nearest.regularity, "least regular at": nearest.at, "relative regularity": nearest.relative,
        }  # fmt: skip
    if run.no_efforts:
        return figures
    alike = found.of_one_freedom(run)
    condition = np.max([measure.masses.condition for measure in alike], axis=0)
    if not np.isfinite(condition).all():
        return figures
    trips = [measure.return_trip(run) for measure in alike]
    error, size = (np.array(each) for each in zip(*trips, strict=True))
    return figures | {"condition": condition, "return trip": relative(error, size)}


class _Looked(Record, frozen=True):
    """What is looked at in n rows, under m constraints and g drives along task coordinates.

    Attributes:
        rows: Their places in the run, shape (n,).
        gaps: What is open of the loops, its rate and its acceleration, largest of each row, shape (n, 3).
        own: G of the constraints, shape (n, m, nv).
        right: ``-G' v``, shape (n, m).
        guided: Loads of the drives along task coordinates, shape (n, nv).
    """

    rows: Indices
    gaps: Array
    own: Matrices
    right: Array
    guided: Array

    @classmethod
    def at(cls, run: Trajectory, rows: Indices) -> _Looked:
        """Return what belongs to rows of a run."""
        closure, m, q, v = run.closure, run.mechanism.closure.size, run.q[rows], run.v[rows]
        (gap, matrices), drift = closure.matrices(q), closure.drifts(q, v)
        along = run.lam.along[rows]
        guided = transposed_times(matrices, np.concatenate([np.zeros((*along.shape[:-1], m)), along], axis=-1))
        own, drift = first_rows(matrices, m), drift[..., :m]
        parts = gap[..., :m], times(own, v), times(own, run.a[rows]) + drift
        gaps = np.stack([np.abs(part).max(axis=-1, initial=0.0) for part in parts], axis=1)
        return cls(rows, gaps, own, -drift, guided)

    def of_one_freedom(self, run: Trajectory) -> list[_Alike]:
        """Return those with as many free motions together: at singular positions there are more."""
        q, model, closure = run.q[self.rows], run.mechanism.model, run.mechanism.closure
        mass, found = None if model.nv > MANY else run.dynamics.mass_matrices(q), []
        if not closure.size:
            whole = TreeMasses(model, q) if mass is None else TreeMassMatrices(mass)
            return [_Alike(self.rows, whole, np.zeros_like(run.v[self.rows]), self.guided)]
        for some, split in closure.splits(q, self.own).parts:
            here = (
                ConstrainedMasses(model, q[some], split.free) if mass is None else MassMatrices(mass[some], split.free)
            )
            found.append(_Alike(self.rows[some], here, split.particular(self.right[some]), self.guided[some]))
        return found


class _Alike(Record, frozen=True):
    """Rows with f free motions each.

    Attributes:
        rows: Their places in the run, shape (n,).
        masses: Along their free motions.
        particular: The shortest accelerations that the constraints allow, shape (n, nv).
        guided: Loads of the drives along task coordinates, shape (n, nv).
    """

    rows: Indices
    masses: FreeMasses
    particular: Array
    guided: Array

    def return_trip(self, run: Trajectory) -> tuple[Array, Array]:
        """Return the largest difference of accelerations, and the largest one that efforts and loads could give."""
        model, masses, rows = run.mechanism.model, self.masses, self.rows
        still = np.zeros_like(run.a)

        def resistance(dynamics: Dynamics, part: slice) -> Array:
            here = rows[(rows >= part.start) & (rows < part.stop)]
            return dynamics.inverse(run.grid.t[here], run.q[here], run.v[here], still[here])

        resisting, supplied = run.gather(resistance), run.tau[rows] + run.friction_loads[rows] + self.guided
        pull = run.mechanism.gravity * np.sqrt(LinkTree.of(model).masses.sum(axis=-1))
        levers = np.sqrt(np.maximum(masses.diagonal, 0.0))
        left = supplied - resisting - masses.times(self.particular)
        most = np.abs(supplied) + np.abs(resisting) + (pull + self._turning(run))[..., None] * levers
        back, given = masses.responses(left, most)
        return _largest(self.particular + back - run.a[rows]), np.maximum(_largest(run.a[rows]), _largest(given))

    def _turning(self, run: Trajectory) -> Array:
        """Return ``omega sqrt(2 T)``, shape (n, ..)."""
        v, (_, twists, _, _) = run.v[self.rows], run.link_motion_at(self.rows)
        omega = np.linalg.norm(twists[..., 3:], axis=-1).max(axis=-1)
        return np.asarray(omega * np.sqrt(np.maximum((v * self.masses.times(v)).sum(axis=-1), 0.0)))


def _largest(x: Array) -> Array:
    """Return the largest size in all rows and velocities, shape (n, .., nv) to (..)."""
    return np.asarray(np.abs(x).max(axis=(0, -1), initial=0.0))
