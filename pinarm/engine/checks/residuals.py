"""What the rows of a table say of themselves: how well loops are closed, how regular positions are, and the way back.

A fixed, even choice of rows is looked at, so that the cost of large tables stays bounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.checks.sample import SAMPLE, sampled
from pinarm.engine.checks.singularity import nearest_singularity
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.masses import MASSLESS, NOTHING
from pinarm.engine.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import SolvedMotion


def residual_figures(run: Trajectory, motion: SolvedMotion | None = None, most: int = SAMPLE) -> dict[str, float]:
    """Return what the rows of a run are worth.

    Args:
        run: The table of states.
        motion: What they are states of: regularity is looked for between rows too where it is given.
        most: Largest number of rows that are looked at.

    Returns:
        ``closure``, ``closure rate`` and ``closure acceleration``: largest gap of a loop [m or rad], and of its two
        derivatives. ``regularity``: smallest singular value of the constraints' rows relative to the largest, of as
        many as are independent at any row, looked for between rows where it becomes small; 0 at a singular position.
        ``least regular at``: where that is.
        ``condition``: largest condition number of the mass matrix of the free motions, scaled to a diagonal of ones.
        ``return trip``: largest difference of the accelerations that the efforts give by forward dynamics to those of
        the table, relative to the largest acceleration that efforts and loads would give if none of them cancelled;
        weights count with the most that they can do, ``g sqrt(m M_kk)`` for the mass m of all bodies (Cauchy-Schwarz).
    """
    if run.no_efforts and not run.mechanism.closure.size:
        return {}
    rows = sampled(len(run), most)
    found = _Looked.at(run, rows)
    figures: dict[str, float] = {}
    if run.mechanism.closure.size:
        gaps = found.gaps.max(axis=0).tolist()
        figures.update(zip(("closure", "closure rate", "closure acceleration"), gaps, strict=True))
        if run.unknown:  # rates that are NaN
            figures = {name: gap for name, gap in figures.items() if not np.isnan(gap)}
        values = run.mechanism.closure.values_of(found.own)
        figures |= zip(("regularity", "least regular at"), nearest_singularity(run, motion, rows, values), strict=True)
    if run.no_efforts:
        return figures
    alike = found.of_one_freedom(run)
    condition = max(measure.condition for measure in alike)
    if not np.isfinite(condition):
        return figures
    error, size = (max(figure) for figure in zip(*(measure.return_trip(run) for measure in alike), strict=True))
    return figures | {"condition": condition, "return trip": error / size if size else 0.0}


@dataclass(frozen=True, eq=False)
class _Looked:
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
    own: Array
    right: Array
    guided: Array

    @classmethod
    def at(cls, run: Trajectory, rows: Indices) -> _Looked:
        """Return what belongs to rows of a run."""
        closure, m, q, v = run.closure, run.mechanism.closure.size, run.q[rows], run.v[rows]
        (gap, matrices), drift = closure.at(q), closure.drifts(q, v)
        own, guided = matrices[:, :m], np.einsum("nij,ni->nj", matrices[:, m:], run.lam.along[rows])
        rates = (np.einsum("nij,nj->ni", own, one[rows]) for one in (run.v, run.a))
        parts = gap[:, :m], next(rates), next(rates) + drift[:, :m]
        gaps = np.stack([np.abs(part).max(axis=1, initial=0.0) for part in parts], axis=1)
        return cls(rows, gaps, own, -drift[:, :m], guided)

    def of_one_freedom(self, run: Trajectory) -> list[_Alike]:
        """Return those with as many free motions together: at singular positions there are more."""
        mass, found = run.dynamics.mass_matrices(run.q[self.rows]), []
        for some, split in run.mechanism.closure.splits(run.q[self.rows], self.own).parts:
            free_mass = split.free.swapaxes(1, 2) @ mass[some] @ split.free
            particular = split.particular(self.right[some])
            found.append(_Alike(self.rows[some], split.free, mass[some], free_mass, particular, self.guided[some]))
        return found


@dataclass(frozen=True, eq=False)
class _Alike:
    """Rows with f free motions each.

    Attributes:
        rows: Their places in the run, shape (n,).
        free: T, bases of their free motions, shape (n, nv, f).
        mass: M, shape (n, nv, nv).
        free_mass: ``T^T M T``, shape (n, f, f).
        particular: The shortest accelerations that the constraints allow, shape (n, nv).
        guided: Loads of the drives along task coordinates, shape (n, nv).
    """

    rows: Indices
    free: Array
    mass: Array
    free_mass: Array
    particular: Array
    guided: Array

    @property
    def condition(self) -> float:
        """Return the largest condition number of T^T M T scaled to a diagonal of ones; infinite if one is singular.

        A motion may move no mass at some positions only, such as a light crank at the dead centre of its slider.
        """
        if not self.free_mass.shape[1]:
            return 1.0
        square = np.maximum(np.einsum("nii->ni", self.free_mass), 0.0)
        if (square <= NOTHING * square.max()).any():
            return np.inf
        size = np.sqrt(square)
        values = np.linalg.eigvalsh(self.free_mass / (size[:, :, None] * size[:, None]))
        return float((values[:, -1] / values[:, 0]).max()) if values[:, 0].min() > MASSLESS else np.inf

    def return_trip(self, run: Trajectory) -> tuple[float, float]:
        """Return the largest difference of accelerations, and the largest one that efforts and loads could give."""
        model, free, rows = run.mechanism.model, self.free, self.rows
        still = np.zeros_like(run.a)

        def resistance(dynamics: Dynamics, part: slice) -> Array:
            here = rows[(rows >= part.start) & (rows < part.stop)]
            return dynamics.inverse(run.grid.t[here], run.q[here], run.v[here], still[here])

        resisting, supplied = run.gather(resistance), run.tau[rows] + run.friction_loads[rows] + self.guided
        pull = run.mechanism.gravity * sum(inertia.mass for inertia in model.inertias) ** 0.5
        weights = pull * np.sqrt(np.maximum(np.einsum("nii->ni", self.mass), 0.0))
        moving = supplied - resisting - np.einsum("nij,nj->ni", self.mass, self.particular)
        most = np.abs(supplied) + np.abs(resisting) + weights
        loads = np.stack([np.einsum("nvf,nv->nf", free, moving), np.einsum("nvf,nv->nf", np.abs(free), most)], axis=2)
        back, given = np.moveaxis(free @ np.linalg.solve(self.free_mass, loads), 2, 0)
        error = np.abs(self.particular + back - run.a[rows]).max(initial=0.0)
        return float(error), float(max(np.abs(run.a[rows]).max(initial=0.0), np.abs(given).max(initial=0.0)))
