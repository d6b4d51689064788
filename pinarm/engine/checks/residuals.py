"""What the rows of a table say of themselves: how well loops are closed, how regular positions are, and the way back.

A fixed, even choice of rows is looked at, so that the cost of large tables stays bounded.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.figures import relative
from pinarm.engine.checks.free_masses import ConstrainedMasses, FreeMasses, MassMatrices, TreeMasses, TreeMassMatrices
from pinarm.engine.checks.sample import SAMPLE, sampled
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.records import Record

if TYPE_CHECKING:
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
    found = _Looked(run.looked_at(rows))
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
    alike = found.of_one_freedom()
    condition = np.max([measure.masses.condition for measure in alike], axis=0)
    if not np.isfinite(condition).all():
        return figures
    error, size = (np.array(each) for each in zip(*(measure.return_trip() for measure in alike), strict=True))
    return figures | {"condition": condition, "return trip": relative(error, size)}


class _Looked(Record, frozen=True):
    """What is looked at in n rows, under m constraints and g drives along task coordinates.

    Attributes:
        run: The rows.
    """

    run: Trajectory

    @cached_property
    def _rows(self) -> tuple[Array, Array]:
        """Gaps of constraints and task coordinates, shape (n, m + g), and their rows of G, shape (n, m + g, nv)."""
        return self.run.closure.at(self.run.q)

    @cached_property
    def own(self) -> Array:
        """G of the constraints, shape (n, m, nv)."""
        return self._rows[1][..., : self.run.mechanism.closure.size, :]

    @cached_property
    def drift(self) -> Array:
        """``G' v`` of the constraints, shape (n, m)."""
        return self.run.closure.drifts(self.run.q, self.run.v)[..., : self.run.mechanism.closure.size]

    @property
    def gaps(self) -> Array:
        """What is open of the loops, its rate and its acceleration, largest of each row, shape (n, 3)."""
        run, m = self.run, self.run.mechanism.closure.size
        parts = self._rows[0][..., :m], np.matvec(self.own, run.v), np.matvec(self.own, run.a) + self.drift
        return np.stack([np.abs(part).max(axis=-1, initial=0.0) for part in parts], axis=1)

    @property
    def guided(self) -> Array:
        """Loads of the drives along task coordinates, shape (n, nv)."""
        along = self.run.lam.along
        if not along.size:
            return np.zeros_like(self.run.v)
        others = np.zeros((*along.shape[:-1], self.run.mechanism.closure.size))
        return np.asarray(np.vecmat(np.concatenate([others, along], axis=-1), self._rows[1]))

    def of_one_freedom(self) -> list[_Alike]:
        """Return those with as many free motions together: at singular positions there are more."""
        run, q, guided = self.run, self.run.q, self.guided
        model, closure = run.mechanism.model, run.mechanism.closure
        mass, found = None if model.nv > MANY else run.dynamics.mass_matrices(q), []
        if not closure.size:
            whole = TreeMasses(model, q) if mass is None else TreeMassMatrices(mass)
            return [_Alike(run, whole, np.zeros_like(run.v), guided)]
        for some, split in closure.splits(q, self.own).parts:
            here = (
                ConstrainedMasses(model, q[some], split.free) if mass is None else MassMatrices(mass[some], split.free)
            )
            found.append(_Alike(run.looked_at(some), here, split.particular(-self.drift[some]), guided[some]))
        return found


class _Alike(Record, frozen=True):
    """Rows with f free motions each.

    Attributes:
        run: The rows.
        masses: Along their free motions.
        particular: The shortest accelerations that the constraints allow, shape (n, nv).
        guided: Loads of the drives along task coordinates, shape (n, nv).
    """

    run: Trajectory
    masses: FreeMasses
    particular: Array
    guided: Array

    def return_trip(self) -> tuple[Array, Array]:
        """Return the largest difference of accelerations, and the largest one that efforts and loads could give."""
        run, masses = self.run, self.masses
        t, q, v, still = run.grid.t, run.q, run.v, np.zeros_like(run.a)
        resisting = run.gather(lambda dynamics, part: dynamics.inverse(t[part], q[part], v[part], still[part]))
        supplied = run.tau + run.friction_loads + self.guided
        pull = run.mechanism.gravity * np.sqrt(LinkTree.of(run.mechanism.model).mass)
        levers = np.sqrt(np.maximum(masses.diagonal, 0.0))
        left = supplied - resisting - masses.times(self.particular)
        most = np.abs(supplied) + np.abs(resisting) + (pull + self._turning())[..., None] * levers
        back, given = masses.responses(left, most)
        return _largest(self.particular + back - run.a), np.maximum(_largest(run.a), _largest(given))

    def _turning(self) -> Array:
        """Return ``omega sqrt(2 T)``, shape (n, ..)."""
        v, (_, twists, _, _) = self.run.v, self.run.link_motion
        turning = twists[..., 3:]
        omega = np.sqrt((turning * turning).sum(axis=-1).max(axis=-1))
        return np.asarray(omega * np.sqrt(np.maximum(np.vecdot(v, self.masses.times(v)), 0.0)))


def _largest(x: Array) -> Array:
    """Return the largest size in all rows and velocities, shape (n, .., nv) to (..)."""
    return np.asarray(np.abs(x).max(axis=(0, -1), initial=0.0))
