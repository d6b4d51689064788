"""What the drives and the constraints must give so that a mechanism moves as it does: ``tau`` and ``lam``.

The equation of motion asks for ``S^T tau + G^T lam = M a + nle - loads``, with a row of S for every coordinate that a
drive acts along. With T a basis of the motions that the constraints allow, ``G T = 0``, the drives' part is
``(S T)^T tau = T^T (M a + nle - loads)``, whatever is redundant among the constraints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.closure import Closure
from pinarm.engine.freedom import free_motions
from pinarm.engine.measures import rows_of
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.multipliers import Multipliers
from pinarm.errors import DynamicsError, InputError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings import Coupling

CARRIED = 1e-9
"""Largest part of a load that no drive carries, relative to the load: rounding leaves 1e-13."""

WEAK = 1e-9
"""Smallest singular value of S T, relative to the longest row of S, that still determines the drives' efforts."""


class Actuation(Protocol):
    """The drives of a mechanism and the constraints that they work against."""

    @property
    def closure(self) -> Closure:
        """Constraints with multipliers: those of the mechanism, then drives along task coordinates."""
        ...

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return tau at the joints, shape (n, nv), and the multipliers.

        Args:
            t: Instants, for messages, shape (n,).
            q: Configurations, shape (n, nq).
            demand: ``M a + nle - loads``, shape (n, nv).
        """
        ...


@dataclass(frozen=True, eq=False)
class EveryJoint:
    """A drive at every joint of an open chain: each joint's demand is its effort.

    Attributes:
        closure: No constraints.
    """

    closure: Closure

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the demand itself."""
        return demand, Multipliers.zero(len(demand), 0)


@dataclass(frozen=True, eq=False)
class EveryLeader:
    """A drive at every joint that mimics no other: it carries what those that mimic it demand, too.

    With f the followers, l the leaders, and W = (W_f W_l) the rows of the couplings,
    ``tau_l = demand_l - (W_f^-1 W_l)^T demand_f`` and ``lam = W_f^-T demand_f``.

    Attributes:
        closure: The couplings.
        followers: Indices in v of the joints that mimic others, one of each row, shape (m,).
    """

    closure: Closure
    followers: Indices

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the efforts of the leaders, 0 for the followers, and the multipliers."""
        rows = self.closure.rows()
        lam = np.asarray(np.linalg.solve(rows[:, self.followers].T, demand[:, self.followers].T).T, dtype=np.float64)
        tau = demand - lam @ rows
        tau[:, self.followers] = 0.0
        return tau, Multipliers.known(lam, self.closure.size)


@dataclass(frozen=True, eq=False)
class NamedDrives:
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
    def coordinates(self) -> dict[str, Coordinate]:
        """What drives act along, by name: joints and sums of them first."""
        return {**self.joints, **self.tasks}

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the efforts of the drives and the multipliers.

        Where constraints are redundant the multipliers are the least ones that do it.

        Raises:
            DynamicsError: The efforts are not determined: at a dead point, or as there are too many drives.
            InputError: The drives cannot carry the load.
        """
        effort, good, k = np.empty((len(q), len(self.coordinates))), np.empty(len(q), dtype=bool), len(self.joints)
        for places, free in free_motions(self.own, q):
            effort[places], good[places] = _carried(*self._system(q[places], demand[places], free))
        if not good.all():
            row = int(good.argmin())
            raise self._refusal(t[row], q[row : row + 1], demand[row : row + 1])
        weights = np.array([one.weights for one in self.joints.values()]).reshape(k, demand.shape[1])
        tau = effort[:, :k] @ weights
        return tau, Multipliers.least(self.closure, q, demand - tau, effort[:, k:])

    def _system(self, q: Array, demand: Array, free: Array) -> tuple[Array, Array, Array]:
        """Return ``(S T)^T``, shape (n, f, d), the load ``T^T demand``, shape (n, f), and the least singular value."""
        rows = rows_of(self.own.model, list(self.coordinates.values()), q)
        least = WEAK * np.linalg.norm(rows, axis=2).max(axis=1, initial=0.0)
        return np.einsum("fnj,ndj->nfd", free, rows), np.einsum("fnj,nj->nf", free, demand), least

    def _refusal(self, t: float, q: Array, demand: Array) -> DynamicsError | InputError:
        """Return why the drives' efforts cannot be had at a configuration, q and demand being one row."""
        ((_, free),) = free_motions(self.own, q)
        (ways,), (load,), (least,) = self._system(q, demand, free)
        u, s, vt = np.linalg.svd(ways)
        names, freedom, r = list(self.coordinates), len(load), int((s >= least).sum())
        if len(names) > r:
            shares = np.abs(vt[r:]).max(axis=0)
            weak = [name for name, share in zip(names, shares, strict=True) if share > 1e-6]
            return DynamicsError(
                f"at {t:.9g} the efforts of {', '.join(weak)} are not determined: "
                f"{len(names)} drives and {freedom} degrees of freedom",
                expected="as many drives as the mechanism has degrees of freedom, none of them at a dead point", t=t,
            )  # fmt: skip
        left = np.abs(load - ways @ (vt.T @ ((u[:, :r].T @ load) / s))).max()
        return InputError(
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


def actuation(mechanism: Mechanism, drives: Sequence[str], imposed: Sequence[str]) -> Actuation:
    """Return the drives of a run.

    Args:
        mechanism: The mechanism.
        drives: Names of the coordinates that drives act along. Where none is named every joint of an open chain has
            a drive, but for those that mimic others, and a mechanism with loops one along every imposed coordinate.
        imposed: Names of the coordinates that follow laws.

    Raises:
        InputError: A coordinate does not exist, or is named twice.
    """
    if not drives and (every := everywhere(mechanism)) is not None:
        return every
    names = list(drives) or list(imposed)
    if len(set(names)) < len(names):
        raise InputError(f"a drive is named twice in {', '.join(names)}", expected="one drive along each coordinate")
    found: dict[str, Coordinate] = {name: mechanism.coordinate(name) for name in names}
    linear = {name: one for name, one in found.items() if isinstance(one, LinearCoordinate)}
    others = {name: one for name, one in found.items() if name not in linear}
    closure = mechanism.closure.with_guides(list(others), list(others.values()))
    return NamedDrives(linear, others, mechanism.closure, closure)


def everywhere(mechanism: Mechanism) -> Actuation | None:
    """Return drives at every joint that mimics no other; ``None`` where loops or gears leave fewer joints to drive."""
    constraints, closure = mechanism.constraints, mechanism.closure
    if not constraints:
        return EveryJoint(closure)
    followers = {one.follower for one in constraints if isinstance(one, Coupling) and one.follower is not None}
    return EveryLeader(closure, np.array(sorted(followers))) if len(followers) == len(constraints) else None
