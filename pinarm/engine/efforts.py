"""What the drives and the constraints must give so that a mechanism moves as it does: ``tau`` and ``lam``.

The equation of motion asks for ``S^T tau + G^T lam = M a + nle - loads``, with a row of S for every coordinate that a
drive acts along. With T a basis of the motions that the constraints allow, ``G T = 0``, the drives' part is
``(S T)^T tau = T^T (M a + nle - loads)``, whatever is redundant among the constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.closure import Closure, Split
from pinarm.engine.mechanism import Mechanism
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

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return tau at the joints, shape (n, nv), and lam, shape (n, m).

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

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return the demand itself."""
        return demand, np.zeros((len(demand), 0))


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

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return the efforts of the leaders, 0 for the followers, and the multipliers."""
        rows = self.closure.rows()
        lam: Array = np.linalg.solve(rows[:, self.followers].T, demand[:, self.followers].T).T
        tau = demand - lam @ rows
        tau[:, self.followers] = 0.0
        return tau, lam


@dataclass(frozen=True, eq=False)
class Nothing:
    """No drives and no forces at all: only the motion is wanted.

    Attributes:
        closure: Constraints of the mechanism.
    """

    closure: Closure

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return zeros."""
        return np.zeros_like(demand), np.zeros((len(demand), self.closure.size))


@dataclass(frozen=True, eq=False)
class NamedDrives:
    """Drives along some coordinates; the other joints are passive.

    Attributes:
        names: Names of the coordinates, those of joints first.
        joints: Weights of the drives at joints, or along sums of their coordinates, shape (k, nv).
        own: Constraints of the mechanism.
        closure: The same, and the drives along task coordinates.
    """

    names: tuple[str, ...]
    joints: Array
    own: Closure
    closure: Closure

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return the efforts of the drives and the multipliers.

        Where constraints are redundant the multipliers are the least ones that do it.

        Raises:
            InputError: The drives cannot carry the load, or there are more of them than the load determines.
        """
        tau, lam, k = np.zeros_like(demand), np.zeros((len(demand), self.closure.size)), len(self.joints)
        m = self.own.size
        for i in range(len(q)):
            self.closure.place(q[i])
            rows = self.closure.rows()
            split, drives = Split.of(rows[:m]), np.vstack([self.joints, rows[m:]])
            least = WEAK * float(np.linalg.norm(drives, axis=1).max(initial=0.0))
            effort = self._carried(t[i], split.free.T @ drives.T, split.free.T @ demand[i], least)
            tau[i], lam[i, m:] = effort[:k] @ self.joints, effort[k:]
            lam[i, :m] = split.multipliers(demand[i] - effort @ drives)
        return tau, lam

    def _carried(self, t: float, ways: Array, load: Array, least: float) -> Array:
        """Return the efforts that carry a load on the free motions, shape (k,); ``least`` bounds singular values."""
        u, s, vt = np.linalg.svd(ways)
        r = int((s >= least).sum())
        if len(self.names) > r:
            shares = np.abs(vt[r:]).max(axis=0)
            weak = [name for name, share in zip(self.names, shares, strict=True) if share > 1e-6]
            raise DynamicsError(
                f"at {t:.9g} the efforts of {', '.join(weak)} are not determined: "
                f"{len(self.names)} drives and {ways.shape[0]} degrees of freedom",
                expected="as many drives as the mechanism has degrees of freedom, none of them at a dead point", t=t,
            )  # fmt: skip
        effort = vt.T @ ((u[:, :r].T @ load) / s)
        left = float(np.abs(load - ways @ effort).max(initial=0.0))
        if left > CARRIED * max(float(np.abs(load).max(initial=0.0)), float(np.abs(ways * effort).max(initial=0.0))):
            raise InputError(
                f"at {t:.9g} the drives {', '.join(self.names)} leave a load of {left:.3g} N*m or N uncarried",
                expected=f"{ways.shape[0]} drives, as many as the mechanism has degrees of freedom",
                hint="drives: names of the coordinates that motors act along",
            )
        return np.asarray(effort)


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
    weights = np.array([one.weights for one in linear.values()]).reshape(-1, mechanism.model.nv)
    closure = mechanism.closure.with_guides(list(others), list(others.values()))
    return NamedDrives((*linear, *others), weights, mechanism.closure, closure)


def everywhere(mechanism: Mechanism) -> Actuation | None:
    """Return drives at every joint that mimics no other; ``None`` where loops or gears leave fewer joints to drive."""
    constraints, closure = mechanism.constraints, mechanism.closure
    if not constraints:
        return EveryJoint(closure)
    followers = {one.follower for one in constraints if isinstance(one, Coupling) and one.follower is not None}
    return EveryLeader(closure, np.array(sorted(followers))) if len(followers) == len(constraints) else None
