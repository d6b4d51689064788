"""What the rows of a table say of themselves: how well loops are closed, how regular positions are, and the way back.

A fixed, even choice of rows is looked at, so that the cost of large tables stays bounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
    conditions = [row.condition for row in found]
    if not np.isfinite(conditions).all():
        return figures
    figures["condition"] = max(conditions)
    return figures | {"return trip": _return_trip(run, rows, found)}


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

    @cached_property
    def free_mass(self) -> Array:
        """Return the mass matrix of the free motions, ``T^T M T``."""
        return np.asarray(self.split.free.T @ self.mass @ self.split.free)

    @property
    def condition(self) -> float:
        """Return the condition number of the mass matrix of the free motions; infinite where one has no mass."""
        return _condition(self.free_mass)


def _return_trip(run: Trajectory, rows: Indices, found: list[_Row]) -> float:
    still = np.zeros_like(run.a)

    def resistance(dynamics: Dynamics, part: slice) -> Array:
        here = rows[(rows >= part.start) & (rows < part.stop)]
        return dynamics.inverse(run.grid.t[here], run.q[here], run.v[here], still[here])

    bias = run.gather(resistance)
    error, size = 0.0, float(np.abs(run.a[rows]).max(initial=0.0))
    model = run.mechanism.model
    pull = run.mechanism.gravity * sum(inertia.mass for inertia in model.inertias) ** 0.5
    for row, one, resisting in zip(rows, found, bias, strict=True):
        supplied = run.tau[row] + one.guided
        back = one.split.solve(one.mass, supplied - resisting, one.right)
        error = max(error, float(np.abs(back - run.a[row]).max(initial=0.0)))
        free = one.split.free
        weights = pull * np.sqrt(np.maximum(np.diag(one.mass), 0.0))
        terms = np.abs(free).T @ (np.abs(supplied) + np.abs(resisting) + weights)
        given = free @ np.linalg.solve(one.free_mass, terms)
        size = max(size, float(np.abs(given).max(initial=0.0)))
    return error / size if size else 0.0


def _condition(mass: Array) -> float:
    """Return the condition number of a mass matrix scaled to a diagonal of ones, infinite where it is singular."""
    size = np.sqrt(np.maximum(np.diag(mass), 0.0))
    if not len(mass):
        return 1.0
    if (size == 0.0).any():
        return np.inf
    values = np.linalg.eigvalsh(mass / (size[:, None] * size))
    return float(values[-1] / values[0]) if values[0] > MASSLESS else np.inf
