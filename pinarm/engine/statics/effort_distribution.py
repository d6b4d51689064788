"""Efforts of drives that carry a load: unique ones, or the least weighted sum of squares within limits.

``A x = b`` with ``A = (S T)^T`` of ``actuation`` and ``b = T^T demand``. With as many drives as degrees of freedom the
load determines x. With more, each row is the convex problem ``min sum_i (w_i x_i)^2`` subject to ``A x = b`` and
``l_i <= x_i <= u_i``. Without limits ``y = W x`` is the least solution of ``A W^-1 y = b``. Where it goes beyond a
limit, ``x = x_0 + W^-1 N z`` with N a basis of the null space of ``A W^-1``: the least z with x within the limits is a
least distance problem, which non-negative least squares solve (Lawson and Hanson, Solving Least Squares Problems,
ch. 23).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import BLOCK, Closure
from pinarm.engine.kinematics.singular import instant
from pinarm.errors import DrivesError, DynamicsError
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, driven_along
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.mechanics.joints import effort_unit
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


CARRIED = 1e-9
"""Largest part of a load that no drive carries, relative to the load: rounding leaves 1e-13."""

ROUNDED = 1e-12
"""Part of the terms of a load that is taken for their rounding: 1e-16 of each, of terms that cancel or act across."""

ROUNDING = 1e-9
"""Part of a limit by which rounding may pass it: efforts carry their load to 1e-13 of it, far from dead points."""


class UniqueEfforts(ValueRecord, frozen=True):
    """The efforts that the load determines; more drives than degrees of freedom are refused."""

    def efforts(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        """Return the efforts [N*m or N], shape (n, d), and in which rows they are determined and carry the load.

        Args:
            ways: A, shape (n, f, d).
            load: b, shape (n, f).
            least: Smallest singular value of A that determines efforts, shape (n,).
            rounding: How large a part of b may be and still be its rounding, shape (n,).
        """
        effort, good = _least_efforts(ways, load, least, rounding)
        return effort, good & (ways.shape[2] <= ways.shape[1])

    def refusal(
        self, t: float, drives: Mapping[str, Coordinate], ways: Array, load: Array, least: float, rounding: float,
        motions: Mapping[str, Array],
    ) -> DynamicsError | DrivesError:  # fmt: skip
        """Return why there are no efforts in one row, shapes (f, d) and (f,).

        ``motions`` are the rates of coordinates in the free motions, by name, each of shape (f,).
        """
        freedom, names = len(load), ", ".join(drives)
        if len(drives) > freedom:
            return DrivesError(
                f"at {instant(t)} there are more drives than degrees of freedom, {len(drives)} and {freedom}: "
                f"the efforts of {names} are not determined",
                expected=f"as many drives as degrees of freedom, {freedom}",
                hint="the others removed from drives, or share: least_squares, bounded or weights, which choose among "
                "the efforts that carry the load",
            )
        return _undetermined(t, drives, ways, load, least, rounding, motions)


UNIQUE = UniqueEfforts()
"""The distribution where nothing is said of sharing."""


class SharedEfforts(Record, frozen=True):
    """Efforts with the least ``sum_i (w_i x_i)^2`` within limits.

    Attributes:
        weights: w of the d drives, positive, all ``w_i x_i`` in one unit, shape (d,).
        limits: Least and largest efforts l and u [N*m or N], infinite where there is none, shape (2, d).
    """

    weights: Array
    limits: Array

    def efforts(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        """Return the efforts; see ``UniqueEfforts``."""
        scaled, good = _least_efforts(ways / self.weights, load, np.zeros_like(least), rounding)
        effort = scaled / self.weights
        if min(ways.shape[1:]):  # the weights do not decide what is a dead point
            good &= np.linalg.svd(ways, compute_uv=False)[:, -1] >= least
        for row in np.flatnonzero(good & ~self._within(effort)):
            effort[row], good[row] = self._limited(ways[row], load[row], effort[row], rounding[row : row + 1])
        return np.clip(effort, *self.limits), good

    def _within(self, effort: Array) -> Flags:
        """Return a mask of the rows of efforts, shape (.., d), within the limits, but for rounding."""
        slack = ROUNDING * np.maximum(np.abs(self._finite).max(axis=0), np.abs(effort))
        return np.asarray(((effort >= self.limits[0] - slack) & (effort <= self.limits[1] + slack)).all(axis=-1))

    @property
    def _finite(self) -> Array:
        return np.where(np.isfinite(self.limits), self.limits, 0.0)

    def _limited(self, ways: Array, load: Array, unlimited: Array, rounding: Array) -> tuple[Array, bool]:
        """Return the efforts of a row in which those without limits, x_0, go beyond them, and whether they carry b."""
        free = np.linalg.svd(ways / self.weights)[2][min(ways.shape) :].T
        side = self._active(free, unlimited)
        held = np.select([side < 0.0, side > 0.0], [*self._finite], 0.0)
        left, inner = load - ways @ held, side == 0.0
        held[inner] = np.linalg.lstsq(ways[:, inner] / self.weights[inner], left)[0] / self.weights[inner]
        return held, bool(self._within(held) and _carried(ways[None], held[None], load[None], rounding)[0])

    def _active(self, free: Array, unlimited: Array) -> Array:
        """Return the active limits of drives, shape (d,): -1 at the least effort, 1 at the largest, 0 within.

        Arguments are N and x_0.

        The least y with ``G y >= h`` has ``G^T u = y`` with ``u >= 0`` of the active rows only. u is a multiple of the
        non-negative solution of ``[G^T; h^T] u = [0; 1]`` in the sense of least squares.
        """
        from scipy.optimize import nnls

        size = np.linalg.norm(self.weights * (np.abs(unlimited) + np.abs(self._finite).max(axis=0)))
        (lower, upper), (low, high) = (np.flatnonzero(row) for row in np.isfinite(self.limits)), self.limits
        g = np.concatenate([free[lower], -free[upper]])
        above, below = self.weights * (low - unlimited), self.weights * (unlimited - high)
        h = np.concatenate([above[lower], below[upper]]) / size
        u, _ = nnls(np.vstack([g.T, h]), np.append(np.zeros(free.shape[1]), 1.0))
        sides = np.zeros(len(unlimited))
        sides[lower] -= u[: len(lower)] > 0.0
        sides[upper] += u[len(lower) :] > 0.0
        return sides

    def refusal(
        self, t: float, drives: Mapping[str, Coordinate], ways: Array, load: Array, least: float, rounding: float,
        motions: Mapping[str, Array],
    ) -> DynamicsError | DrivesError:  # fmt: skip
        """Return why there are no efforts in one row; see ``UniqueEfforts``."""
        unlimited = SharedEfforts(self.weights, np.full_like(self.limits, np.inf) * np.array([[-1.0], [1.0]]))
        if not unlimited.efforts(ways[None], load[None], np.array([least]), np.array([rounding]))[1][0]:
            return _undetermined(t, drives, ways, load, least, rounding, motions)
        limits = [
            f"{name} {low:.6g} to {high:.6g} {effort_unit(coordinate)}"
            for (name, coordinate), low, high in zip(drives.items(), *self.limits, strict=True)
            if np.isfinite([low, high]).any()
        ]
        return DrivesError(
            f"at {instant(t)} the drives {', '.join(drives)} cannot carry the load within their limits "
            f"({', '.join(limits)})",
            expected="limits that the load keeps to at every instant, or more drives",
            hint="share: least_squares tells what the load takes without limits",
        )


EffortDistribution = UniqueEfforts | SharedEfforts
"""Rule for the efforts of d drives under a load on f free motions."""


def _undetermined(
    t: float, drives: Mapping[str, Coordinate], ways: Array, load: Array, least: float, rounding: float,
    motions: Mapping[str, Array],
) -> DynamicsError | DrivesError:  # fmt: skip
    """Return the error of drives at a dead point, or too few to carry the load; shapes (f, d) and (f,)."""
    u, s, vt = np.linalg.svd(ways)
    r, freedom = int((s >= least).sum()), len(load)
    uncarried = load - ways @ (vt[:r].T @ ((u[:, :r].T @ load) / s[:r]))
    left = np.abs(uncarried).max()
    too_few = len(drives) < freedom and left > max(CARRIED * np.abs(load).max(), rounding)
    if min(len(drives), freedom) > r and not too_few:
        shares = np.abs(vt[r:]).max(axis=0)
        weak = ", ".join(name for name, share in zip(drives, shares, strict=True) if share > 1e-6)
        return DynamicsError(
            f"at {instant(t)} the efforts of {weak} are not determined: the mechanism is at a dead point of these "
            "drives",
            expected="drives that can move the mechanism at every instant",
            t=t,
        )
    lacking = max(motions, key=lambda name: abs(float(motions[name] @ uncarried)))
    return DrivesError(
        f"at {instant(t)} the drives {', '.join(drives)} leave a load of {left:.3g} N*m or N uncarried: {lacking} "
        "moves while they rest",
        expected=f"{freedom} drives, as many as the mechanism has degrees of freedom",
        hint=f"drives: [{', '.join([*drives, lacking])}{', ...' if len(drives) + 1 < freedom else ''}]",
    )


def _least_efforts(ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
    """Return the efforts with the least sum of squares that carry a load, and in which rows they do."""
    if ways.shape[1:] == (1, 1):  # single numbers, without the cost of a decomposition
        u, s, vt = np.ones_like(ways), np.abs(ways[:, 0]), np.where(ways < 0.0, -1.0, 1.0)
    else:
        u, s, vt = np.linalg.svd(ways, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):  # at dead points, which are refused
        effort = np.zeros((len(load), ways.shape[2]))
        for _ in range(2):  # after the first time small efforts have rounding of the large ones
            left = load - np.einsum("nfd,nd->nf", ways, effort)
            effort += np.einsum("nrd,nr->nd", vt, np.einsum("nfr,nf->nr", u, left) / s)
        good = (s >= least[:, None]).all(axis=1) & _carried(ways, effort, load, rounding)
    return effort, good


def _carried(ways: Array, effort: Array, load: Array, rounding: Array) -> Flags:
    """Return in which rows efforts carry a load, but for rounding; shapes (n, f, d), (n, d), (n, f), (n,)."""
    left = np.abs(load - np.einsum("nfd,nd->nf", ways, effort)).max(axis=1, initial=0.0)
    terms = np.abs(ways * effort[:, None]).max(axis=(1, 2), initial=0.0)
    size = np.maximum(terms, np.abs(load).max(axis=1, initial=0.0))
    return np.asarray(~(left > np.maximum(CARRIED * size, rounding)))


def weight_terms(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Return ``sum_b m_b |g| |dc_b/dq_i|`` over the centres of mass c_b [N*m or N], shape (nv,)."""
    pin.computeJointJacobians(model, data, q)
    total, gravity = np.zeros(model.nv), float(np.linalg.norm(model.gravity.linear))
    for joint in range(1, model.njoints):
        jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL).reshape(6, -1)
        inertia = model.inertias[joint]
        moved = jacobian[:3] - np.cross(inertia.lever, jacobian[3:].T).T
        total += inertia.mass * gravity * np.linalg.norm(moved, axis=0)
    return total


WEAK = 1e-9
"""Smallest singular value of S T, relative to the longest row of S, that still determines the drives' efforts."""


class SelectedDrives(Record, frozen=True):
    """Drives along some coordinates; the other joints are passive.

    Attributes:
        joints: Coordinates of joints, and sums of them, that drives act along, by name.
        tasks: Other coordinates that drives act along, by name.
        closure: The same, and the drives along task coordinates.
        distribution: How their efforts follow from the load.
    """

    joints: Mapping[str, LinearCoordinate]
    tasks: Mapping[str, Coordinate]
    own: Closure
    closure: Closure
    distribution: EffortDistribution = UNIQUE

    @property
    def named(self) -> dict[str, Coordinate]:
        """Coordinates that drives act along, by name: joints and sums of them first."""
        return {**self.joints, **self.tasks}

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        return self.named

    @property
    def driven(self) -> Flags:
        return driven_along(self.joints.values(), self.own.model.nv)

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return the efforts of the drives and the multipliers, the least ones where constraints are redundant."""
        tau, lam = np.empty_like(demand), np.empty((len(q), self.closure.size))
        for start in range(0, len(q), BLOCK):
            some = slice(start, start + BLOCK)
            tau[some], lam[some] = self._efforts(t[some], q[some], demand[some])
        return tau, lam

    def _efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        own, k, rows = self.own.size, len(self.joints), self.closure.at(q)[1]
        split, effort, good = self.own.split(rows[:, :own]), np.empty((len(q), len(self.named))), np.empty(len(q), bool)
        drives = np.empty((len(q), len(self.named), demand.shape[1]))  # S
        drives[:, :k] = np.reshape([joint.weights for joint in self.joints.values()], (k, demand.shape[1]))
        drives[:, k:] = rows[:, own:]
        for places, free in split.by_freedom():
            system = self._system(q[places], demand[places], free, drives[places])
            effort[places], good[places] = self.distribution.efforts(*system)
        if not good.all():
            row = int(good.argmin())
            one, free = slice(row, row + 1), split.free[row : row + 1, :, : int(split.freedom[row])]
            raise self._refusal(float(t[row]), free[0], *self._system(q[one], demand[one], free, drives[one]))
        along = effort[:, k:]
        tau = np.vecmat(effort[:, :k], drives[:, :k])
        lam = split.multipliers(demand - tau - np.vecmat(along, rows[:, own:]))
        return tau, np.concatenate([lam, along], axis=1)

    def _system(self, q: Array, demand: Array, free: Array, drives: Array) -> tuple[Array, Array, Array, Array]:
        """Return ``(S T)^T``, the load ``T^T demand``, the least singular value and the rounding of the load."""
        least = WEAK * np.linalg.norm(drives, axis=2).max(axis=1, initial=np.finfo(float).tiny)
        rounding = ROUNDED * np.einsum("njf,nj->nf", np.abs(free), self._terms(q, demand, free.shape[-1]))
        ways, load = np.einsum("njf,ndj->nfd", free, drives), np.einsum("njf,nj->nf", free, demand)
        return ways, load, least, rounding.max(axis=1, initial=0.0)

    def _terms(self, q: Array, demand: Array, freedom: int) -> Array:
        """Return the sizes of the terms of each joint's demand [N*m or N], shape (n, nv)."""
        terms, model = np.abs(demand), self.own.model
        if len(self.named) >= freedom:
            return terms
        data = new_data(model)
        return np.asarray(terms + np.array([weight_terms(model, data, row) for row in q]))

    def _refusal(
        self, t: float, free: Array, ways: Array, load: Array, least: Array, rounding: Array
    ) -> DynamicsError | DrivesError:
        model, moved = self.own.model, free / self.own.scale[:, None]
        motions = {coordinate_name(model, k): moved[k] for k in range(model.nv)}
        return self.distribution.refusal(t, self.named, ways[0], load[0], float(least[0]), float(rounding[0]), motions)
