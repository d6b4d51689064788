"""Efforts of drives, and multipliers: unique efforts, or the least weighted sum of squares within limits.

The equation of motion asks for ``S^T tau + G^T lam = M a + nle - loads``, with a row of S for every coordinate that a
drive acts along. With T a basis of the motions that the constraints allow, ``G T = 0``, the drives' part is ``A x = b``
with ``A = (S T)^T`` and ``b = T^T (M a + nle - loads)``, whatever is redundant among the constraints. With as many
drives as degrees of freedom the load determines x. With more, each row is the convex problem ``min sum_i (w_i x_i)^2``
subject to ``A x = b`` and ``l_i <= x_i <= u_i``. Without limits ``y = W x`` is the least solution of ``A W^-1 y = b``.
Where it goes beyond a limit, ``x = x_0 + W^-1 N z`` with N a basis of the null space of ``A W^-1``: the least z with x
within the limits is a least distance problem, which non-negative least squares solve (Lawson and Hanson, Solving Least
Squares Problems, ch. 23).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import BLOCK, Closure
from pinarm.engine.dynamics.equation import mass_matrices, weight_bounds
from pinarm.engine.kinematics.singular import instant
from pinarm.errors import DrivesError, DynamicsError, InputError, as_names
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, driven_along
from pinarm.mechanics.joints import effort_unit
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.coordinates import Constraint

CARRIED = 1e-9
"""Largest part of a load that no drive carries, relative to the load: rounding leaves 1e-13."""

ROUNDED = 1e-12
"""Part of the terms of a load that is taken for their rounding: 1e-16 of each, of terms that cancel or act across."""

ROUNDING = 1e-9
"""Part of a limit by which rounding may pass it: efforts carry their load to 1e-13 of it, far from dead points."""

WEAK = 1e-9
"""Smallest singular value of S T, relative to the longest row of S, that still determines the drives' efforts."""

Actuation: TypeAlias = "DriveAtEveryJoint | SelectedDrives"
"""The drives of a mechanism and the constraints that they work against: those of the mechanism, then drives along task
coordinates. ``efforts(t, q, demand)`` returns tau at the joints and the multipliers for ``M a + nle - loads``, shape
(n, nv); ``driven`` tells which joints drives act on, shape (nv,); ``coordinates(mechanism)`` what they act along."""


class DriveAtEveryJoint(Record, frozen=True):
    """A drive at every joint that mimics no other: it carries what those that mimic it demand, too.

    With f the followers, l the leaders, and W = (W_f W_l) the rows of the couplings,
    ``tau_l = demand_l - (W_f^-1 W_l)^T demand_f`` and ``lam = W_f^-T demand_f``.

    Attributes:
        closure: The couplings; none of an open chain.
        followers: Indices in v of the joints that mimic others, one of each row, shape (m,).
    """

    closure: Closure
    followers: tuple[int, ...] = ()

    @property
    def driven(self) -> Flags:
        driven = np.ones(self.closure.model.nv, dtype=bool)
        driven[list(self.followers)] = False
        return driven

    @cached_property
    def _weights(self) -> Array:
        """The rows W of the couplings, the same at all configurations, shape (m, nv)."""
        return self.closure.rows(self.closure.state(pin.neutral(self.closure.model)))

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return the efforts of the leaders, 0 for the followers, and the multipliers."""
        if not self.followers:
            return demand, np.zeros((*demand.shape[:-1], 0))
        rows, followers = self._weights, list(self.followers)
        lam = np.asarray(np.linalg.solve(rows[:, followers].T, demand[:, followers].T).T, dtype=np.float64)
        tau = demand - lam @ rows
        tau[:, followers] = 0.0
        return tau, lam

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        leaders = (name for name, joint in mechanism.joints.items() if joint.v not in self.followers)
        return {name: mechanism.coordinates[name] for name in leaders}


class SharedEfforts(Record, frozen=True):
    """Efforts with the least ``sum_i (w_i x_i)^2`` within limits.

    Attributes:
        weights: w of the d drives, positive, all ``w_i x_i`` in one unit, shape (d,).
        limits: Least and largest efforts l and u [N*m or N], infinite where there is none, shape (2, d).
    """

    weights: Array
    limits: Array

    def efforts(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        """Return the efforts; see ``least_efforts``."""
        effort, good = self._unlimited(ways, load, least, rounding)
        for row in np.flatnonzero(good & ~self._within(effort)):
            effort[row], good[row] = self._limited(ways[row], load[row], effort[row], rounding[row : row + 1])
        return np.clip(effort, *self.limits), good

    def _unlimited(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        scaled, good = least_efforts(ways / self.weights, load, np.zeros_like(least), rounding)
        if min(ways.shape[1:]):  # the weights do not decide what is a dead point
            good &= np.linalg.svd(ways, compute_uv=False)[:, -1] >= least
        return scaled / self.weights, good

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


def least_efforts(ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
    """Return the efforts with the least sum of squares that carry a load, shape (n, d), and in which rows they do.

    Args:
        ways: A, shape (n, f, d).
        load: b, shape (n, f).
        least: Smallest singular value of A that determines efforts, shape (n,).
        rounding: How large a part of b may be and still be its rounding, shape (n,).
    """
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


class SelectedDrives(Record, frozen=True):
    """Drives along some coordinates; the other joints are passive.

    Attributes:
        joints: Coordinates of joints, and sums of them, that drives act along, by name.
        tasks: Other coordinates that drives act along, by name.
        closure: The same, and the drives along task coordinates.
        sharing: How more drives than degrees of freedom share the load; ``None`` where these are refused.
    """

    joints: Mapping[str, LinearCoordinate]
    tasks: Mapping[str, Coordinate]
    own: Closure
    closure: Closure
    sharing: SharedEfforts | None = None

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
            effort[places], good[places] = self._carrying(*system)
        if not good.all():
            row = int(good.argmin())
            one, free = slice(row, row + 1), split.free[row : row + 1, :, : int(split.freedom[row])]
            raise self._refusal(float(t[row]), free[0], *self._system(q[one], demand[one], free, drives[one]))
        along = effort[:, k:]
        tau = np.vecmat(effort[:, :k], drives[:, :k])
        lam = split.multipliers(demand - tau - np.vecmat(along, rows[:, own:]))
        return tau, np.concatenate([lam, along], axis=1)

    def _carrying(self, ways: Array, load: Array, least: Array, rounding: Array) -> tuple[Array, Flags]:
        if self.sharing is not None:
            return self.sharing.efforts(ways, load, least, rounding)
        effort, good = least_efforts(ways, load, least, rounding)
        return effort, good & (ways.shape[2] <= ways.shape[1])

    def _system(self, q: Array, demand: Array, free: Array, drives: Array) -> tuple[Array, Array, Array, Array]:
        """Return ``(S T)^T``, the load ``T^T demand``, the least singular value and the rounding of the load."""
        model, terms = self.own.model, np.abs(demand)
        if len(self.named) < free.shape[-1]:
            terms = terms + weight_bounds(model, mass_matrices(model, q))
        least = WEAK * np.linalg.norm(drives, axis=2).max(axis=1, initial=np.finfo(float).tiny)
        rounding = ROUNDED * np.einsum("njf,nj->nf", np.abs(free), terms)
        ways, load = np.einsum("njf,ndj->nfd", free, drives), np.einsum("njf,nj->nf", free, demand)
        return ways, load, least, rounding.max(axis=1, initial=0.0)

    def _refusal(self, t: float, free: Array, *system: Array) -> DynamicsError | DrivesError:
        """Return why there are no efforts in one row; ``free`` are its free motions, shape (nv, f)."""
        (ways,), (load,), (least,), (rounding,) = system
        freedom, names = len(load), ", ".join(self.named)
        if self.sharing is None and len(self.named) > freedom:
            return DrivesError(
                f"at {instant(t)} there are more drives than degrees of freedom, {len(self.named)} and {freedom}: "
                f"the efforts of {names} are not determined",
                expected=f"as many drives as degrees of freedom, {freedom}",
                hint="the others removed from drives, or share: least_squares, bounded or weights, which choose among "
                "the efforts that carry the load",
            )
        if self.sharing is not None and self.sharing._unlimited(*system)[1][0]:
            limits = [
                f"{name} {low:.6g} to {high:.6g} {effort_unit(coordinate.unit)}"
                for (name, coordinate), low, high in zip(self.named.items(), *self.sharing.limits, strict=True)
                if np.isfinite([low, high]).any()
            ]
            return DrivesError(
                f"at {instant(t)} the drives {names} cannot carry the load within their limits ({', '.join(limits)})",
                expected="limits that the load keeps to at every instant, or more drives",
                hint="share: least_squares tells what the load takes without limits",
            )
        u, s, vt = np.linalg.svd(ways)
        r = int((s >= least).sum())
        uncarried = load - ways @ (vt[:r].T @ ((u[:, :r].T @ load) / s[:r]))
        left = np.abs(uncarried).max()
        too_few = len(self.named) < freedom and left > max(CARRIED * np.abs(load).max(), rounding)
        if min(len(self.named), freedom) > r and not too_few:
            shares = np.abs(vt[r:]).max(axis=0)
            weak = ", ".join(name for name, share in zip(self.named, shares, strict=True) if share > 1e-6)
            return DynamicsError(
                f"at {instant(t)} the efforts of {weak} are not determined: the mechanism is at a dead point of these "
                "drives",
                expected="drives that can move the mechanism at every instant",
                t=t,
            )
        lacking = coordinate_name(self.own.model, int(np.abs((free / self.own.scale[:, None]) @ uncarried).argmax()))
        return DrivesError(
            f"at {instant(t)} the drives {names} leave a load of {left:.3g} N*m or N uncarried: {lacking} "
            "moves while they rest",
            expected=f"{freedom} drives, as many as the mechanism has degrees of freedom",
            hint=f"drives: [{', '.join([*self.named, lacking])}{', ...' if len(self.named) + 1 < freedom else ''}]",
        )


def actuation(mechanism: Mechanism, drives: Sequence[str], prescribed: Sequence[str]) -> Actuation:
    """Return the drives of a run.

    Args:
        drives: Names of the coordinates that drives act along. Where none is named every joint of an open chain has
            a drive, but for those that mimic others, and a mechanism with loops one along every prescribed coordinate.
        prescribed: Names of the coordinates that follow laws.
    """
    if not drives and (every := everywhere(mechanism)) is not None:
        return every
    return along(mechanism, as_names(drives) or list(prescribed))


def along(mechanism: Mechanism, names: Collection[str]) -> Actuation:
    """Return drives along coordinates, and at no other joint."""
    if len(set(names)) < len(names):
        raise InputError(f"a drive is named twice in {', '.join(names)}", expected="one drive along each coordinate")
    named: dict[str, Coordinate] = {name: mechanism.coordinate(name) for name in names}
    linear = {name: along for name, along in named.items() if isinstance(along, LinearCoordinate)}
    others = {name: along for name, along in named.items() if name not in linear}
    closure = mechanism.closure.with_guides(list(others), list(others.values()))
    return SelectedDrives(linear, others, mechanism.closure, closure)


def everywhere(mechanism: Mechanism) -> Actuation | None:
    """Return drives at every joint that mimics no other; ``None`` where loops or gears leave fewer joints to drive."""
    followers = followers_of(mechanism.constraints)
    return None if followers is None else DriveAtEveryJoint(mechanism.closure, followers)


def followers_of(constraints: Sequence[Constraint]) -> tuple[int, ...] | None:
    """Return the joints that mimic others, one of each constraint; ``None`` where there are other constraints."""
    followers = {constraint.follower for constraint in constraints if constraint.follower is not None}
    return tuple(sorted(followers)) if len(followers) == len(constraints) else None
