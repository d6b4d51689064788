"""Efforts of more drives than degrees of freedom: those with the least weighted sum of squares, within limits.

Each row is the convex problem ``min sum_i (w_i x_i)^2`` subject to ``A x = b`` and ``|x_i| <= l_i``. Without limits
``y = W x`` is the least solution of ``A W^-1 y = b``. Where it goes beyond a limit, ``x = x_0 + W^-1 N z`` with N a
basis of the null space of ``A W^-1``: the least z with x within the limits is a least distance problem, which
non-negative least squares solve (Lawson and Hanson, Solving Least Squares Problems, ch. 23).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.kinematics.abscissa import instant
from pinarm.engine.statics.effort_distribution import carried, least_efforts, undetermined
from pinarm.errors import DrivesError, DynamicsError
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.forces.joint_definitions import effort_unit

ROUNDING = 1e-9
"""Part of a limit by which rounding may pass it: efforts carry their load to 1e-13 of it, far from dead points."""


@dataclass(frozen=True, eq=False)
class SharedEfforts:
    """Efforts with the least ``sum_i (w_i x_i)^2`` within limits; see ``EffortDistribution``.

    Attributes:
        weights: w of the d drives, positive, all ``w_i x_i`` in one unit, shape (d,).
        limits: Largest efforts l [N*m or N], positive, infinite where there is none, shape (d,).
    """

    weights: Array
    limits: Array

    def efforts(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        """Return the efforts; see ``EffortDistribution``."""
        f, d = ways.shape[1:]
        scaled, good = least_efforts(ways / self.weights, load, np.zeros_like(least), rounding)
        effort = scaled / self.weights
        if min(f, d):  # the weights do not decide what is a dead point
            good &= np.linalg.svd(ways, compute_uv=False)[:, -1] >= least
        for row in np.flatnonzero(good & (np.abs(effort) > self.limits * (1.0 + ROUNDING)).any(axis=1)):
            effort[row], good[row] = self._limited(ways[row], load[row], effort[row], rounding[row])
        return np.clip(effort, -self.limits, self.limits), good

    def _limited(self, ways: Array, load: Array, unlimited: Array, rounding: float) -> tuple[Array, bool]:
        """Return the efforts of a row in which those without limits go beyond them, and whether they carry the load.

        Args:
            ways: A, shape (f, d).
            load: b, shape (f,).
            unlimited: x_0, shape (d,).
            rounding: See ``EffortDistribution``.
        """
        free = np.linalg.svd(ways / self.weights)[2][min(ways.shape) :].T
        side = self._active(free, unlimited)
        held = np.where(side == 0.0, 0.0, side * np.where(np.isfinite(self.limits), self.limits, 0.0))
        left, inner = load - ways @ held, side == 0.0
        rest = np.linalg.lstsq(ways[:, inner] / self.weights[inner], left)[0] / self.weights[inner]
        held[inner] = rest
        within = (np.abs(held) <= self.limits * (1.0 + ROUNDING)).all()
        return held, bool(within and carried(ways[None], held[None], load[None], np.array([rounding]))[0])

    def _active(self, free: Array, unlimited: Array) -> Array:
        """Return which drives are at their limits: 1 or -1, 0 of others, shape (d,).

        The least y with ``G y >= h`` has ``G^T u = y`` with ``u >= 0`` of the active rows only. u is a multiple of the
        non-negative solution of ``[G^T; h^T] u = [0; 1]`` in the sense of least squares.

        Args:
            free: N, shape (d, k).
            unlimited: x_0, shape (d,).
        """
        from scipy.optimize import nnls

        size = np.linalg.norm(self.weights * unlimited)
        bounded = np.flatnonzero(np.isfinite(self.limits))
        g = np.concatenate([free[bounded], -free[bounded]])  # above -l, and below l
        above, below = (self.weights * (side * unlimited - self.limits) for side in (-1.0, 1.0))
        h = np.concatenate([above[bounded], below[bounded]]) / size
        u, _ = nnls(np.vstack([g.T, h]), np.append(np.zeros(free.shape[1]), 1.0))
        lower, upper = np.split(u > 0.0, 2)
        found = np.zeros(len(self.limits))
        found[bounded] = upper.astype(float) - lower
        return found

    def refusal(
        self, t: float, drives: Mapping[str, Coordinate], ways: Array, load: Array, least: float, rounding: float,
        motions: Mapping[str, Array],
    ) -> DynamicsError | DrivesError:  # fmt: skip
        """Return why there are no efforts in one row; see ``EffortDistribution``."""
        _, good = SharedEfforts(self.weights, np.full_like(self.limits, np.inf)).efforts(
            ways[None], load[None], np.array([least]), np.array([rounding])
        )
        if not good[0]:
            return undetermined(t, drives, ways, load, least, rounding, motions)
        limits = [f"{name} {limit:.6g} {effort_unit(coordinate)}"
                  for (name, coordinate), limit in zip(drives.items(), self.limits, strict=True)
                  if np.isfinite(limit)]  # fmt: skip
        return DrivesError(
            f"at {instant(t)} the drives {', '.join(drives)} cannot carry the load within their limits "
            f"({', '.join(limits)}): it takes at least {self._least_factor(ways, load):.6g} times these limits",
            expected="limits that the load keeps to at every instant, or more drives",
            hint="share: least_squares tells what the load takes without limits",
        )

    def _least_factor(self, ways: Array, load: Array) -> float:
        """Return the least s for which a load is carried with ``|x_i| <= s l_i``, by linear programming."""
        from scipy.optimize import linprog

        bounded = np.isfinite(self.limits)
        unit = np.where(bounded, self.limits, 1.0)
        scale = max(float(np.abs(load).max()), 1e-300)
        own = np.diag(bounded.astype(float))[bounded]
        above, below = (np.column_stack([side * own, -np.ones(len(own))]) for side in (1.0, -1.0))
        cost = np.append(np.zeros(len(unit)), 1.0)
        found = linprog(cost, np.vstack([above, below]), np.zeros(2 * len(own)),
                        np.column_stack([ways * unit / scale, np.zeros(len(load))]), load / scale,
                        [(None, None)] * len(unit) + [(0.0, None)])  # fmt: skip
        return float(found.fun) if found.success else float("nan")
