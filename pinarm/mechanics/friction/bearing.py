"""Bearings: which normal forces a joint's reaction makes, and on which levers their friction acts.

With a the joint's axis, F and M the force and the moment that the joint transmits, and an index n for what is normal to
the axis:

- One bearing carries F_n. Two, ``span`` apart and centred at the joint, carry ``F_n / 2 +- M_n x a / span``, which
  balances F_n and M_n; each has friction of its own.
- A joint that turns slips on the circumference of its journals, at ``radius``, and on its shoulder, which carries the
  axial force, at ``thrust_radius``.
- A joint that slides slips along its guides; a key at ``radius`` carries the moment about the axis, ``|M_a| / radius``.
- A cylindrical joint slips on the circumference of its journals, at ``radius``, and along them.
- A ball joint slips on its ball, of ``radius``, which carries F: the moment ``mu r F`` is against the angular velocity.

A journal has the moment ``mu r F_n`` of textbooks. F_n being the resultant, of normal force and friction together, a
dry journal with one line of contact has ``sin(atan mu)`` in place of mu: 0.5 % less at 0.1.

The joint of the tree is centred at the origin of its child, a loop joint at its second frame. A part of the reaction
for which there is no size has no friction.
"""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.records import Record

STRAIGHT = 1e-11
"""Part of a normal force across a line that rounding leaves of one along it."""


class Bearing(Record, frozen=True):
    """The load of one joint: ``N = sum_p lever_p |P_p w| + preload`` for the wrench ``w = [F; M]`` that it transmits.

    Attributes:
        levers: [m], or 1 for guides; shape (p,).
        parts: P, from wrenches to normal forces, shape (p, 3, 6).
        preload: [N*m or N].
    """

    levers: Array
    parts: Array
    preload: float = 0.0

    @classmethod
    def none(cls, preload: float = 0.0) -> Bearing:
        """Return what carries nothing but a preload."""
        return cls(np.zeros(0), np.zeros((0, 3, 6)), preload)

    @classmethod
    def journal(
        cls, axis: Array, radius: float, thrust_radius: float = 0.0, span: float = 0.0, preload: float = 0.0
    ) -> Bearing:
        """Return the bearings of a joint that turns; a size of 0 is one that is not given.

        Args:
            axis: Unit vector, shape (3,).
            radius: Of the journals [m].
            thrust_radius: Mean radius of the shoulder [m].
            span: Distance between two journals [m]; one journal where it is 0.
            preload: Normal force that is always there [N].
        """
        parts = _radial(axis, span)
        levers = [radius] * len(parts)
        if thrust_radius:
            thrust = np.zeros((3, 6))
            thrust[0, :3] = axis
            parts, levers = [*parts, thrust], [*levers, thrust_radius]
        return cls(np.array(levers), np.array(parts), radius * preload)

    @classmethod
    def guide(cls, axis: Array, radius: float = 0.0, span: float = 0.0, preload: float = 0.0) -> Bearing:
        """Return the guides of a joint that slides; see ``journal``.

        Args:
            axis: Unit vector, shape (3,).
            radius: Lever of the key that carries the moment about the axis [m].
            span: Distance between two guides [m]; one where it is 0.
            preload: Normal force that is always there [N].
        """
        parts = _radial(axis, span)
        if radius:
            key = np.zeros((3, 6))
            key[0, 3:] = axis / radius
            parts = [*parts, key]
        return cls(np.ones(len(parts)), np.array(parts), preload)

    @classmethod
    def ball(cls, radius: float, preload: float = 0.0) -> Bearing:
        """Return a ball in its socket, which slips at its radius [m] under the whole force."""
        return cls(np.array([radius]), np.eye(3, 6)[None], radius * preload)

    @classmethod
    def thread(cls, axis: Array, lever: float) -> Bearing:
        """Return the flanks of a thread, which carry the axial force times a lever."""
        part = np.zeros((1, 3, 6))
        part[0, 0, :3] = axis
        return cls(np.array([lever]), part)

    @classmethod
    def along(cls, lever: float) -> Bearing:
        """Return what carries a multiplier, the first component of a wrench, times a lever."""
        return cls.thread(np.eye(3)[0], lever)

    def load(self, wrench: Array) -> Array:
        """Return N of wrenches, shape (.., 6), as an array of shape (..)."""
        return np.asarray(self._normal(wrench) @ self.levers + self.preload)

    def slope(self, wrench: Array) -> Array:
        """Return the gradient of N, shape (.., 6); 0 of a normal force that vanishes."""
        normals = np.matvec(self.parts, wrench[..., None, :])
        size = np.sqrt((normals**2).sum(axis=-1))
        shares = np.divide(self.levers, size, out=np.zeros_like(size), where=size > 0.0)
        return np.asarray(np.einsum("...p,...pi,pij->...j", shares, normals, self.parts))

    def most(self, wrench: Array) -> Array:
        """Return the most by which adding wrenches, shape (.., 6), can change N, shape (..)."""
        return np.asarray(self._normal(wrench) @ self.levers)

    def most_with_either_sign(self, wrench: Array, others: Array) -> Array:
        """Return a bound of the most by which adding ``wrench + sum_p s_p others_p`` can change N, s_p being 1 or -1.

        Of vectors, ``|u + sum_p s_p k_p|^2 = |u|^2 + 2 sum_p s_p u . k_p + |sum_p s_p k_p|^2 <= |u|^2 + 2 sum_p
        |u . k_p| + (sum_p |k_p|)^2``, which is at most ``(|u| + sum_p |k_p|)^2``; of one k it is reached.

        Args:
            wrench: Shape (.., 6).
            others: Shape (p, .., 6).
        """
        normals = np.matvec(self.parts, wrench[..., None, :])
        added = np.matvec(self.parts, others[..., None, :])
        across, size = np.abs((normals * added).sum(axis=-1)).sum(axis=0), self._normal(others).sum(axis=0)
        return np.asarray(np.sqrt((normals**2).sum(axis=-1) + 2.0 * across + size**2) @ self.levers)

    def along_lines(self, wrenches: Array) -> Array | None:
        """Return normal forces with signs where those of k wrenches, shape (k, 6), are along one line in each part.

        Shape (p, k), linear in the wrenches, so that N of their sums is a sum of absolute values; ``None`` elsewhere.
        """
        normals = np.matvec(self.parts[:, None], wrenches)
        scale = np.sqrt((normals**2).sum(axis=-1)).max(axis=0, initial=0.0)
        _, sizes, lines = np.linalg.svd(normals / np.where(scale > 0.0, scale, 1.0)[:, None], full_matrices=False)
        if len(wrenches) > 1 and (sizes[:, 1] > STRAIGHT).any():
            return None
        return np.asarray(np.matvec(normals, lines[:, 0]))

    def _normal(self, wrench: Array) -> Array:
        """Return the normal forces [N], shape (.., p)."""
        return np.asarray(np.sqrt((np.matvec(self.parts, wrench[..., None, :]) ** 2).sum(axis=-1)))


def _radial(axis: Array, span: float) -> list[Array]:
    """Return the parts that carry what is normal to the axis: of one bearing, or of two."""
    across = np.eye(3) - np.outer(axis, axis)
    one = np.hstack([across, np.zeros((3, 3))])
    if not span:
        return [one]
    turned = np.cross(np.eye(3), axis).T  # M -> M x a
    two = np.hstack([np.zeros((3, 3)), turned / span])
    return [0.5 * one + two, 0.5 * one - two]
