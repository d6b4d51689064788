"""Drives along some coordinates of a mechanism, its other joints being passive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import rows_of
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.statics.effort_distribution import ROUNDED, UNIQUE, EffortDistribution, weight_terms
from pinarm.errors import DrivesError, DynamicsError
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, driven_along
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

WEAK = 1e-9
"""Smallest singular value of S T, relative to the longest row of S, that still determines the drives' efforts."""


class SelectedDrives(Record, frozen=True):
    """Drives along some coordinates; the other joints are passive.

    Attributes:
        joints: Coordinates of joints, and sums of them, that drives act along, by name.
        tasks: Other coordinates that drives act along, by name.
        own: Constraints of the mechanism.
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
        """Return the same; see ``Actuation``."""
        return self.named

    @property
    def driven(self) -> Flags:
        """Joints that drives act on, alone or with others, shape (nv,)."""
        return driven_along(self.joints.values(), self.own.model.nv)

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the efforts of the drives and the multipliers, the least ones where constraints are redundant.

        Raises:
            DynamicsError: The efforts are not determined at a dead point.
            DrivesError: There are too many drives, or they cannot carry the load, or not within their limits.
        """
        states, k = demand.shape[:-1], len(self.joints)
        load = demand.reshape(-1, demand.shape[-1])
        flat = np.broadcast_to(q, (*states, q.shape[-1])).reshape(len(load), -1)
        effort, good = np.empty((len(flat), len(self.named))), np.empty(len(flat), dtype=bool)
        for places, free in self.own.free_motions(flat):
            effort[places], good[places] = self.distribution.efforts(*self._system(flat[places], load[places], free))
        if not good.all():
            row = int(good.argmin())
            raise self._refusal(t[row * len(q) // len(flat)], flat[row : row + 1], load[row : row + 1])
        weights = np.array([joint.weights for joint in self.joints.values()]).reshape(k, demand.shape[-1])
        tau, along = (effort[:, :k] @ weights).reshape(demand.shape), effort[:, k:].reshape(*states, -1)
        return tau, Multipliers.least(self.closure, q, demand - tau, along)

    def _system(self, q: Array, demand: Array, free: Array) -> tuple[Array, Array, Array, Array]:
        """Return ``(S T)^T``, the load ``T^T demand``, the least singular value and the rounding of the load.

        Shapes are (n, f, d), (n, f), (n,) and (n,); see ``EffortDistribution.efforts``.
        """
        rows = rows_of(self.own.model, list(self.named.values()), q)
        least = WEAK * np.linalg.norm(rows, axis=2).max(axis=1, initial=np.finfo(float).tiny)
        rounding = ROUNDED * np.einsum("fnj,nj->nf", np.abs(free), self._terms(q, demand, len(free)))
        ways, load = np.einsum("fnj,ndj->nfd", free, rows), np.einsum("fnj,nj->nf", free, demand)
        return ways, load, least, rounding.max(axis=1, initial=0.0)

    def _terms(self, q: Array, demand: Array, freedom: int) -> Array:
        """Return the sizes of the terms of each joint's demand [N*m or N], shape (n, nv).

        Weights that act along no joint, or cancel, leave a demand that is their rounding. As many drives as degrees of
        freedom carry that as well.
        """
        terms, model = np.abs(demand), self.own.model
        if len(self.named) >= freedom:
            return terms
        data = new_data(model)
        return np.asarray(terms + np.array([weight_terms(model, data, row) for row in q]))

    def _refusal(self, t: float, q: Array, demand: Array) -> DynamicsError | DrivesError:
        """Return why the drives' efforts cannot be had at a configuration, q and demand being one row."""
        ((_, free),) = self.own.free_motions(q)
        (ways,), (load,), (least,), (rounding,) = self._system(q, demand, free)
        model, moved = self.own.model, free[:, 0] / self.own.scale
        motions = {coordinate_name(model, k): moved[:, k] for k in range(model.nv)}
        return self.distribution.refusal(t, self.named, ways, load, float(least), float(rounding), motions)
