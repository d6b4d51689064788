"""Drives along some coordinates of a mechanism, its other joints being passive; the equations are in ``efforts``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.batch_jacobians import rows_of
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.constraints.nullspace_batch import free_motions
from pinarm.errors import DrivesError, DynamicsError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, driven_along

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

CARRIED = 1e-9
"""Largest part of a load that no drive carries, relative to the load: rounding leaves 1e-13."""

WEAK = 1e-9
"""Smallest singular value of S T, relative to the longest row of S, that still determines the drives' efforts."""


@dataclass(frozen=True, eq=False)
class SelectedDrives:
    """Drives along some coordinates; the other joints are passive.

    Attributes:
        joints: Coordinates of joints, and sums of them, that drives act along, by name.
        tasks: Other coordinates that drives act along, by name.
        own: Constraints of the mechanism.
        closure: The same, and the drives along task coordinates.
    """

    joints: Mapping[str, LinearCoordinate]
    tasks: Mapping[str, Coordinate]
    own: Closure
    closure: Closure

    @property
    def named(self) -> dict[str, Coordinate]:
        """What drives act along, by name: joints and sums of them first."""
        return {**self.joints, **self.tasks}

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        """Return what drives act along, by name."""
        return self.named

    @property
    def driven(self) -> Flags:
        """Joints that drives act on, alone or with others, shape (nv,)."""
        return driven_along(self.joints.values(), self.own.model.nv)

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the efforts of the drives and the multipliers.

        Where constraints are redundant the multipliers are the least ones that do it.

        Raises:
            DynamicsError: The efforts are not determined at a dead point.
            DrivesError: There are too many drives, or they cannot carry the load.
        """
        effort, good, k = np.empty((len(q), len(self.named))), np.empty(len(q), dtype=bool), len(self.joints)
        for places, free in free_motions(self.own, q):
            effort[places], good[places] = _carried(*self._system(q[places], demand[places], free))
        if not good.all():
            row = int(good.argmin())
            raise self._refusal(t[row], q[row : row + 1], demand[row : row + 1])
        weights = np.array([joint.weights for joint in self.joints.values()]).reshape(k, demand.shape[1])
        tau = effort[:, :k] @ weights
        return tau, Multipliers.least(self.closure, q, demand - tau, effort[:, k:])

    def _system(self, q: Array, demand: Array, free: Array) -> tuple[Array, Array, Array]:
        """Return ``(S T)^T``, shape (n, f, d), the load ``T^T demand``, shape (n, f), and the least singular value."""
        rows = rows_of(self.own.model, list(self.named.values()), q)
        least = WEAK * np.linalg.norm(rows, axis=2).max(axis=1, initial=0.0)
        return np.einsum("fnj,ndj->nfd", free, rows), np.einsum("fnj,nj->nf", free, demand), least

    def _refusal(self, t: float, q: Array, demand: Array) -> DynamicsError | DrivesError:
        """Return why the drives' efforts cannot be had at a configuration, q and demand being one row."""
        ((_, free),) = free_motions(self.own, q)
        (ways,), (load,), (least,) = self._system(q, demand, free)
        u, s, vt = np.linalg.svd(ways)
        names, freedom, r = list(self.named), len(load), int((s >= least).sum())
        if len(names) > freedom:
            return DrivesError(
                f"at {t:.9g} there are more drives than degrees of freedom, {len(names)} and {freedom}: "
                f"the efforts of {', '.join(names)} are not determined",
                expected=f"as many drives as degrees of freedom, {freedom}", hint="the others removed from drives",
            )  # fmt: skip
        if len(names) > r:
            shares = np.abs(vt[r:]).max(axis=0)
            weak = [name for name, share in zip(names, shares, strict=True) if share > 1e-6]
            return DynamicsError(
                f"at {t:.9g} the efforts of {', '.join(weak)} are not determined: the mechanism is at a dead point of "
                "these drives", expected="drives that can move the mechanism at every instant", t=t,
            )  # fmt: skip
        left = np.abs(load - ways @ (vt.T @ ((u[:, :r].T @ load) / s))).max()
        return DrivesError(
            f"at {t:.9g} the drives {', '.join(names)} leave a load of {left:.3g} N*m or N uncarried",
            expected=f"{freedom} drives, as many as the mechanism has degrees of freedom",
            hint="drives: names of the coordinates that motors act along",
        )


def _carried(ways: Array, load: Array, least: Array) -> tuple[Array, Array]:
    """Return the efforts that carry a load on the free motions, shape (n, d), and where they do, shape (n,).

    Args:
        ways: ``(S T)^T``, shape (n, f, d).
        load: ``T^T demand``, shape (n, f).
        least: Smallest singular value of the former that determines efforts, shape (n,).
    """
    u, s, vt = _singular_values(ways)
    with np.errstate(divide="ignore", invalid="ignore"):  # at dead points, which are refused
        effort = np.einsum("nrd,nr->nd", vt, np.einsum("nfr,nf->nr", u, load) / s)
        left = np.abs(load - np.einsum("nfd,nd->nf", ways, effort)).max(axis=1, initial=0.0)
        terms = np.abs(ways * effort[:, None]).max(axis=(1, 2), initial=0.0)
    short = left > CARRIED * np.maximum(terms, np.abs(load).max(axis=1, initial=0.0))
    return effort, (s >= least[:, None]).all(axis=1) & ~short & (ways.shape[2] <= ways.shape[1])


def _singular_values(ways: Array) -> tuple[Array, Array, Array]:
    """Return U, S and V^T of matrices, shape (n, f, d); of single numbers without the cost of a decomposition."""
    if ways.shape[1:] == (1, 1):
        return np.ones_like(ways), np.abs(ways[:, 0]), np.where(ways < 0.0, -1.0, 1.0)
    u, s, vt = np.linalg.svd(ways, full_matrices=False)
    return u, s, vt
