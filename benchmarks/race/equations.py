"""Equations of motion for the references: by no engine, no recursion of bodies, and derivatives by complex steps.

The mass matrix M(q) is the sum of the bodies' Jacobians, squared; the motion follows from Hamilton's equations with
``p = M v``: ``q' = v``, ``p' = vᵀ (dM/dq) v / 2 - dV/dq + torques``. Where loops leave one freedom, the motion is that
of a point along the curve of closed positions: ``q' = w(q) s'``, ``m = wᵀ M w``, ``m s'' = -V' - m' s'^2 / 2``.
A body that flies has six coordinates: its place, and turns about x, y and z, in this order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.race.mechanisms import Linkage

STEP = 1e-30
"""Of the complex differences, which no subtraction spoils."""

Array = np.ndarray


def turn(axis: Array, angle: Array) -> Array:
    """Rotations about an axis, shape (..., 3, 3), for complex angles too."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    angle = np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)


class Equations:
    """Masses and potential of a linkage.

    Attributes:
        linkage: The numbers.
        extra: Number of coordinates before those of the joints: 6 for a body that flies.
    """

    def __init__(self, linkage: Linkage) -> None:
        self.linkage = linkage
        self.extra = 6 if linkage.flight else 0
        self.size = self.extra + len(linkage.hinged)

    def frames(self, q: Array) -> tuple[list[Array], list[Array], list[list[tuple[int, Array, Array | None]]]]:
        """Return rotations and origins of the bodies, and what moves each: (coordinate, axis, origin) all the way."""
        linkage, rotations, origins, movers = self.linkage, [], [], []
        for index, body in enumerate(linkage.bodies):
            if linkage.flight and not index:
                base, moved = self._flying(q)
                rotations.append(base)
                origins.append(q[..., :3])
                movers.append(moved)
                continue
            column = self.extra + index - bool(linkage.flight)
            above = body.parent >= 0
            outer = rotations[body.parent] if above else np.eye(3)
            origin = (
                origins[body.parent] + outer @ body.place if above else np.broadcast_to(body.place, (*q.shape[:-1], 3))
            )
            rotation = outer @ np.array(body.rotation) @ turn(np.array(body.axis), q[..., column])
            rotations.append(rotation)
            origins.append(origin)
            movers.append([*(movers[body.parent] if above else []), (column, rotation @ body.axis, origin)])
        return rotations, origins, movers

    def _flying(self, q: Array) -> tuple[Array, list[tuple[int, Array, Array | None]]]:
        """Return the rotation of the first body, and its six movers; those along an axis have no origin."""
        rotation: Array = np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3))
        moved: list[tuple[int, Array, Array | None]] = [(k, np.eye(3)[k], None) for k in range(3)]
        for k in range(3):
            moved.append((3 + k, rotation[..., :, k], q[..., :3]))
            rotation = rotation @ turn(np.eye(3)[k], q[..., 3 + k])
        return rotation, moved

    def mass(self, q: Array) -> Array:
        """Return M, shape (..., n, n)."""
        rotations, origins, movers = self.frames(q)
        total = np.zeros((*q.shape[:-1], self.size, self.size), q.dtype)
        for body, rotation, origin, moved in zip(self.linkage.bodies, rotations, origins, movers, strict=True):
            centre = origin + rotation @ body.com
            linear = np.zeros((*q.shape[:-1], self.size, 3), q.dtype)
            angular = np.zeros_like(linear)
            for column, axis, about in moved:
                linear[..., column, :] = axis if about is None else np.cross(axis, centre - about)
                angular[..., column, :] = 0.0 if about is None else axis
            inertia = rotation @ np.array(body.inertia) @ rotation.swapaxes(-1, -2)
            total += body.mass * linear @ linear.swapaxes(-1, -2) + angular @ inertia @ angular.swapaxes(-1, -2)
        return total

    def potential(self, q: Array) -> Array:
        """Return V, that of weights, springs and constant torques, shape (...)."""
        linkage, joints = self.linkage, q[..., self.extra :]
        rotations, origins, _ = self.frames(q)
        total = (0.5 * linkage.stiffness * joints**2 - linkage.torque * joints).sum(axis=-1)
        for body, rotation, origin in zip(linkage.bodies, rotations, origins, strict=True):
            total = total - body.mass * ((origin + rotation @ body.com) @ np.array(linkage.gravity))
        if spring := linkage.spring:
            apart = origins[spring.body] + rotations[spring.body] @ spring.point - spring.anchor
            total = total + 0.5 * spring.stiffness * (np.sqrt((apart**2).sum(axis=-1)) - spring.length) ** 2
        return total

    def rate(self, q: Array, p: Array) -> tuple[Array, Array]:
        """Return q' and p' of Hamilton's equations, shapes (..., n)."""
        near = q[..., None, :] + 1j * STEP * np.eye(self.size)
        slopes, pull = self.mass(near).imag / STEP, self.potential(near).imag / STEP
        v = np.linalg.solve(self.mass(q), p[..., None])[..., 0]
        damped = np.zeros_like(v)
        damped[..., self.extra :] = self.linkage.damping * v[..., self.extra :]
        return v, 0.5 * np.einsum("...i,...kij,...j->...k", v, slopes, v) - pull - damped

    def start(self) -> tuple[Array, Array]:
        """Return q and v at the start, shapes (n,)."""
        flight = self.linkage.flight
        v = np.concatenate([flight.linear, flight.angular, self.linkage.v]) if flight else self.linkage.v
        return np.concatenate([np.zeros(self.extra), self.linkage.q]), v

    def along(self, q: Array, speed: float, tangent: Callable[[Array], Array]) -> tuple[Array, float]:
        """Return q' and s'' of the motion along a curve with the tangent w(q); weights and springs act."""
        w = tangent(q)
        near = q + 1j * STEP * w
        slope = tangent(near)
        m = slope @ self.mass(near) @ slope
        pull = self.potential(near).imag / STEP + 0.5 * m.imag / STEP * speed**2
        return w * speed, -pull / m.real

    def gaps(self, q: Array) -> Array:
        """Return the rows of the velocities of planar loops' gaps, x and y, shape (2 loops, n)."""
        rotations, origins, movers = self.frames(q)
        rows = []
        for loop in self.linkage.loops:
            row = np.zeros((2, self.size), q.dtype)
            for sign, index, point in zip((1.0, -1.0), loop.bodies, loop.points, strict=True):
                place = origins[index] + rotations[index] @ point
                for column, axis, about in movers[index]:
                    row[:, column] += sign * np.cross(axis, place - about)[:2]
            rows.append(row)
        return np.concatenate(rows)


def crank_tangent(equations: Equations) -> Callable[[Array], Array]:
    """Return the tangent of the closed positions of planar loops by their first coordinate, ``w_0 = 1``."""

    def tangent(q: Array) -> Array:
        rows = equations.gaps(q)
        return np.concatenate([np.ones(1), -np.linalg.solve(rows[:, 1:], rows[:, 0])])

    return tangent


def bricard_tangent(q: Array) -> Array:
    """Return that of Bricard's linkage: P0, P2, P4 turn by a, P1, P3 by b, with ``(1 + sin a)(1 + sin b) = 1``."""
    a, b = q[0], q[1]
    da, db = np.cos(b) * (1 + np.sin(a)), -np.cos(a) * (1 + np.sin(b))
    return np.array([da, db, da, db, da])
