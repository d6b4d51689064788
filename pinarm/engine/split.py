"""The rows of G taken apart: what they determine, what they leave free, and which of them are redundant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinarm.arrays import Array

RANK = 1e-7
"""Singular value of G, its rows of length 1, relative to the largest, below which rows count as dependent: closed to
rounding, a redundant loop leaves 1e-12."""

VANISHED, SMALL = 1e-9, 1e-3
"""Length of a row of G, relative to the longest, that is 0 but for rounding: what holds a plane linkage in its plane
vanishes exactly where its axes are those of the world, and leaves 1e-16 where they are not. Where all rows vanish, as
those of a second bearing, they are compared with a lever of 1 mm."""


@dataclass(frozen=True, eq=False)
class Split:
    """The rows of G taken apart: what they determine, what they leave free, and which of them are redundant.

    With D the scaling that gives rows the length 1: ``D G = U S V^T``, cut at the rank r.

    Attributes:
        scale: Diagonal of D, shape (m,).
        left: U, shape (m, r).
        values: S, descending, shape (r,).
        right: V^T, shape (r, nv).
        free: T, a basis of the motions that the rows allow, ``G T = 0``, shape (nv, nv - r).
        rows: G itself, shape (m, nv).
    """

    scale: Array
    left: Array
    values: Array
    right: Array
    free: Array
    rows: Array

    @classmethod
    def of(cls, rows: Array, least: float = RANK) -> Split:
        """Return the parts of the rows G, shape (m, nv)."""
        return cls.each(rows[None], least)[0]

    @classmethod
    def each(cls, rows: Array, least: float = RANK) -> list[Split]:
        """Return the parts of the rows G at several configurations, shape (n, m, nv)."""
        m, nv = rows.shape[1:]
        if not m:
            nothing = np.ones(0), np.zeros((0, 0)), np.zeros(0), np.zeros((0, nv)), np.eye(nv)
            return [cls(*nothing, one) for one in rows]
        length = np.sqrt((rows * rows).sum(axis=2))
        longest = np.maximum(length.max(axis=1, keepdims=True), SMALL)
        scale = 1.0 / np.where(length > VANISHED * longest, length, 1.0)
        scaled, tall = rows * scale[:, :, None], None
        if m > nv:
            tall, scaled = np.linalg.qr(scaled)
        u, s, vt = np.linalg.svd(scaled)
        left = u if tall is None else tall @ u
        ranks = (s > least * np.maximum(s[:, :1], 1.0)).sum(axis=1).tolist()
        return [cls(scale[k], left[k, :, :r], s[k, :r], vt[k, :r], vt[k, r:].T, rows[k]) for k, r in enumerate(ranks)]

    @cached_property
    def redundant(self) -> Array:
        """N, a basis of the multipliers that do nothing, ``N^T D G = 0``, shape (m, m - r)."""
        return np.asarray(np.linalg.svd(self.left)[0][:, len(self.values) :])

    def particular(self, right: Array) -> Array:
        """Return the shortest x with ``G x = right`` in the sense of least squares, shape (nv,)."""
        return np.asarray(self.right.T @ ((self.left.T @ (self.scale * right)) / self.values))

    def multipliers(self, force: Array) -> Array:
        """Return the least lam with ``G^T lam = force`` in the sense of least squares, shape (m,)."""
        wanted = self.right @ force
        if len(self.scale) == len(self.values):
            return np.asarray(self.scale * (self.left @ (wanted / self.values)))
        q, r = np.linalg.qr(self.rows @ self.right.T)
        return np.asarray(q @ np.linalg.solve(r.T, wanted))

    def solve(self, mass: Array, force: Array, right: Array) -> Array:
        """Return the x that minimises ``x^T M x / 2 - force . x`` while ``G x = right``, shape (nv,).

        Gauss's principle: with the loads less the bias forces and ``right = -G' v`` it is the acceleration. M may be
        singular in directions that the rows hold.
        """
        x = self.particular(right)
        if self.free.shape[1]:
            x = x + self.free @ np.linalg.solve(self.free.T @ mass @ self.free, self.free.T @ (force - mass @ x))
        return x
