"""Configurations with quaternions or (cos, sin) pairs in them."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.records import Record, ValueRecord

TURN = 0.5 * np.array([
    [0, 0, 0, -1], [0, 0, 1, 0], [0, -1, 0, 0],
    [0, 0, -1, 0], [0, 0, 0, -1], [1, 0, 0, 0],
    [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, -1],
    [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0],
])  # fmt: skip
"""Products of x, y, z, w with each component of an angular velocity to the quaternion's rate: half their product."""


class _Places(Record, frozen=True):
    """Where the numbers of joints are.

    Attributes:
        q: Those in q whose rates are velocities, shape (m,).
        v: Those velocities in v, shape (m,).
        balls: The first in q, and in v, of each quaternion.
    """

    q: Indices
    v: Indices
    balls: tuple[tuple[int, int], ...]


class ConfigurationSpace(ValueRecord, frozen=True):
    """Configurations with quaternions or (cos, sin) pairs in them.

    Attributes:
        model: Pinocchio's model.
        nq: Numbers in q.
        nv: Numbers in v.
    """

    model: pin.Model
    nq: int
    nv: int

    def velocity(self, q: Array, v: Array) -> Array:
        """Return q' = T(q) v."""
        if q.ndim == 1:
            return pin.tangentMap(self.model, q).dot(v)  # type: ignore[no-any-return]  # half the time of @
        if self._places is None:
            return np.array([pin.tangentMap(self.model, row) @ rate for row, rate in zip(q, v, strict=True)])
        rates = np.empty_like(q)
        rates[:, self._places.q] = v[:, self._places.v]
        for in_q, in_v in self._places.balls:
            products = q[:, in_q : in_q + 4, None] * v[:, None, in_v : in_v + 3]
            rates[:, in_q : in_q + 4] = products.reshape(len(q), 12) @ TURN
        return rates

    def project(self, q: Array) -> Array:
        """Return q with its quaternions and pairs at unit length."""
        if q.ndim == 1:
            return pin.normalize(self.model, q)  # type: ignore[no-any-return]
        if self._places is None:
            return np.array([pin.normalize(self.model, row) for row in q])
        found = q.copy()
        for in_q, _ in self._places.balls:
            ball = found[:, in_q : in_q + 4]
            ball /= np.sqrt((ball * ball).sum(axis=1, keepdims=True))
        return found

    @cached_property
    def _places(self) -> _Places | None:
        """Where the numbers of joints are; ``None`` where one is no ball and has more of them in q than in v."""
        q: list[int] = []
        v: list[int] = []
        balls = []
        for joint in self.model.joints.tolist()[1:]:
            if joint.nq == joint.nv:
                q += range(joint.idx_q, joint.idx_q + joint.nq)
                v += range(joint.idx_v, joint.idx_v + joint.nv)
            elif joint.shortname() == "JointModelSpherical":
                balls.append((joint.idx_q, joint.idx_v))
            else:
                return None
        return _Places(np.array(q, dtype=np.intp), np.array(v, dtype=np.intp), tuple(balls))
