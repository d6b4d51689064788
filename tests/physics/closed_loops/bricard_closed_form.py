"""Bricard's linkage on the edges of a cube, with its closure in closed form and its reduced law of motion.

From the cube the joints P0, P2, P4 turn by a, and P1, P3 by b, with ``(1 + sin a)(1 + sin b) = 1``. The curve is
followed by its parameter s with ``da/ds = cos b (1 + sin a)``, ``db/ds = -cos a (1 + sin b)``, which never vanish
together; ``M(s) s'' + M'(s) s'^2/2 + V'(s) = 0``. Rotation matrices only; derivatives of M and V by complex steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

EDGES = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0]])
"""Directions of the rods P0P1 .. P4P5 in the cube, shape (5, 3)."""
AXES = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]])
"""Axes of P0 .. P5 in the cube, shape (6, 3)."""
STEP = 1e-30
"""Of the complex differences: no smaller than that of doubles, and exact."""


def turn(axis, angle):
    """Rotation matrix, for complex angles too."""
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


@dataclass(frozen=True)
class Bricard:
    """Edge [m], mass of every rod [kg], side of its square section [m], gravity along -y [m/s^2]."""

    l: float = 1.0
    m: float = 1.0
    s: float = 0.1
    g: float = 9.81

    def places(self, q):
        """Ends and orientations of the five rods for the joint angles q, shape (5,)."""
        point, rotation, found = np.zeros(3), np.eye(3), []
        for k in range(5):
            rotation = rotation @ turn(AXES[k], q[k])
            found.append((point, rotation))
            point = point + rotation @ (self.l * EDGES[k])
        return found, point

    def gap(self, a, b):
        """How far the sixth joint is from closed: of the point P5 and of the axis, shape (6,)."""
        found, end = self.places((a, b, a, b, a))
        return np.concatenate([end - [0, 0, self.l], np.cross(AXES[5], found[-1][1] @ AXES[5])])

    def energies(self, a, b):
        """Twice the kinetic energy at ds/dt = 1, and the potential energy."""
        da, db = self.tangent(a, b)
        found, _ = self.places((a, b, a, b, a))
        velocity, omega, inertia, potential = np.zeros(3), np.zeros(3), 0.0, 0.0
        across, along = self.m * (self.l**2 + self.s**2) / 12, self.m * self.s**2 / 6
        for k, (point, rotation) in enumerate(found):
            omega = omega + rotation @ AXES[k] * (db if k % 2 else da)
            arm = rotation @ (self.l * EDGES[k])
            middle = velocity + np.cross(omega, arm / 2)
            spin = omega @ (rotation @ EDGES[k])
            inertia = inertia + self.m * middle @ middle + across * (omega @ omega - spin**2) + along * spin**2
            potential = potential + self.m * self.g * (point + arm / 2)[1]
            velocity = velocity + np.cross(omega, arm)
        return inertia, potential

    def tangent(self, a, b):
        """da/ds, db/ds."""
        return np.cos(b) * (1 + np.sin(a)), -np.cos(a) * (1 + np.sin(b))

    def motion(self, t, speed=0.0):
        """a, b, da/dt, db/dt at the instants t, from the cube with ds/dt = speed, integrated to 1e-13."""

        def rate(_, y):
            a, b, ds = y
            da, db = self.tangent(a, b)
            inertia, potential = self.energies(a + 1j * STEP * da, b + 1j * STEP * db)
            pull = potential.imag / STEP + 0.5 * inertia.imag / STEP * ds**2
            return da * ds, db * ds, -pull / inertia.real

        a, b, ds = solve_ivp(rate, (0.0, t[-1]), (0.0, 0.0, speed), "DOP853", t_eval=t, rtol=1e-13, atol=1e-14).y
        da, db = self.tangent(a, b)
        return a, b, da * ds, db * ds
