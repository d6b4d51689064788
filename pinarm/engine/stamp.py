"""What the rows of a table say of themselves: how well loops are closed, how regular positions are, and the way back.

A fixed, even choice of rows is looked at, so that the cost of large tables stays bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.closure import RANK, Split
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.masses import MASSLESS
from pinarm.engine.trajectory import Trajectory

SAMPLE = 64
"""Number of rows that are looked at."""


def table_figures(run: Trajectory, most: int = SAMPLE) -> dict[str, float]:
    """Return what the rows of a run are worth.

    Args:
        run: The motion.
        most: Largest number of rows that are looked at.

    Returns:
        ``closure``, ``closure rate`` and ``closure acceleration``: largest gap of a loop [m or rad], and of its two
        derivatives. ``regularity``: smallest singular value of the constraints' rows relative to the largest, of as
        many as are independent at any row; 0 at a singular position. ``least regular at``: where that is.
        ``condition``: largest condition number of the mass matrix of the free motions, scaled to a diagonal of ones.
        ``return trip``: largest difference of the accelerations that the efforts give by forward dynamics to those of
        the table, relative to the largest acceleration that efforts and loads would give if none of them cancelled;
        weights count with the most that they can do, ``g sqrt(m M_kk)`` for the mass m of all bodies (Cauchy-Schwarz).
    """
    if run.unasked and not run.mechanism.closure.size:
        return {}
    rows = np.linspace(0, len(run) - 1, min(len(run), most)).astype(np.intp)
    found = [_Row.of(run, int(row)) for row in rows]
    figures: dict[str, float] = {}
    if run.mechanism.closure.size:
        gaps = np.array([row.gaps for row in found]).max(axis=0)
        figures.update(zip(("closure", "closure rate", "closure acceleration"), map(float, gaps), strict=True))
        values = np.array([row.values for row in found])
        rank = max(int((values > RANK * values[:, :1]).sum(axis=1).max()), 1)
        regular = values[:, rank - 1] / values[:, 0]
        least = int(np.argmin(regular))
        figures |= {"regularity": float(regular[least]), "least regular at": float(run.grid.t[rows[least]])}
    if run.unasked:
        return figures
    alike = [_Alike.of(run, rows, found, some) for some in _of_one_freedom(found)]
    condition = max(one.condition for one in alike)
    if not np.isfinite(condition):
        return figures
    error, size = (max(figure) for figure in zip(*(one.return_trip(run) for one in alike), strict=True))
    return figures | {"condition": condition, "return trip": error / size if size else 0.0}


@dataclass(frozen=True, eq=False)
class _Row:
    """What belongs to one row.

    Attributes:
        gaps: What is open of the loops, its rate and its acceleration.
        values: Singular values of the constraints, descending.
        split: The rows of the constraints taken apart.
        mass: M, shape (nv, nv).
        right: ``-G' v``, shape (m,).
        guided: Load of the drives along task coordinates, shape (nv,).
    """

    gaps: tuple[float, float, float]
    values: Array
    split: Split
    mass: Array
    right: Array
    guided: Array

    @classmethod
    def of(cls, run: Trajectory, row: int) -> _Row:
        """Return what belongs to a row of a run."""
        closure, q, v, a = run.closure, run.q[row], run.v[row], run.a[row]
        m, nv = run.mechanism.closure.size, closure.model.nv
        upper = np.triu(pin.crba(closure.model, closure.data, q).reshape(nv, -1))
        mass = upper + upper.T - np.diag(np.diag(upper))
        if not closure.size:
            return cls((0.0, 0.0, 0.0), np.zeros(0), Split.of(np.zeros((0, nv))), mass, np.zeros(0), np.zeros(nv))
        closure.place(q)
        rows, gap = closure.rows(), closure.gap(q)
        drift = closure.drift(q, v)
        split, own = Split.of(rows[:m]), rows[:m]
        largest = (float(np.abs(part).max(initial=0.0)) for part in (gap[:m], own @ v, own @ a + drift[:m]))
        values = run.mechanism.closure.singular_values(q)
        guided = rows[m:].T @ run.lam.along[row]
        return cls((next(largest), next(largest), next(largest)), values, split, mass, -drift[:m], guided)


def _of_one_freedom(found: Sequence[_Row]) -> list[Indices]:
    """Return the rows, those with as many free motions together: at singular positions there are more."""
    freedoms = np.array([one.split.free.shape[1] for one in found])
    return [np.flatnonzero(freedoms == freedom) for freedom in set(freedoms.tolist())]


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

    @classmethod
    def of(cls, run: Trajectory, rows: Indices, found: Sequence[_Row], some: Indices) -> _Alike:
        """Return some of the rows that have been looked at."""
        here = [found[k] for k in some]
        free, mass = np.array([one.split.free for one in here]), np.array([one.mass for one in here])
        particular = np.array([one.split.particular(one.right) for one in here])
        free_mass = free.swapaxes(1, 2) @ mass @ free
        return cls(rows[some], free, mass, free_mass, particular, np.array([one.guided for one in here]))

    @property
    def condition(self) -> float:
        """Return the largest condition number of T^T M T scaled to a diagonal of ones; infinite if one is singular."""
        if not self.free_mass.shape[1]:
            return 1.0
        size = np.sqrt(np.maximum(np.einsum("nii->ni", self.free_mass), 0.0))
        if (size == 0.0).any():
            return np.inf
        values = np.linalg.eigvalsh(self.free_mass / (size[:, :, None] * size[:, None]))
        return float((values[:, -1] / values[:, 0]).max()) if values[:, 0].min() > MASSLESS else np.inf

    def return_trip(self, run: Trajectory) -> tuple[float, float]:
        """Return the largest difference of accelerations, and the largest one that efforts and loads could give."""
        model, free, rows = run.mechanism.model, self.free, self.rows
        still = np.zeros_like(run.a)

        def resistance(dynamics: Dynamics, part: slice) -> Array:
            here = rows[(rows >= part.start) & (rows < part.stop)]
            return dynamics.inverse(run.grid.t[here], run.q[here], run.v[here], still[here])

        resisting, supplied = run.gather(resistance), run.tau[rows] + self.guided
        pull = run.mechanism.gravity * sum(inertia.mass for inertia in model.inertias) ** 0.5
        weights = pull * np.sqrt(np.maximum(np.einsum("nii->ni", self.mass), 0.0))
        moving = supplied - resisting - np.einsum("nij,nj->ni", self.mass, self.particular)
        most = np.abs(supplied) + np.abs(resisting) + weights
        loads = np.stack([np.einsum("nvf,nv->nf", free, moving), np.einsum("nvf,nv->nf", np.abs(free), most)], axis=2)
        back, given = np.moveaxis(free @ np.linalg.solve(self.free_mass, loads), 2, 0)
        error = np.abs(self.particular + back - run.a[rows]).max(initial=0.0)
        return float(error), float(max(np.abs(run.a[rows]).max(initial=0.0), np.abs(given).max(initial=0.0)))
