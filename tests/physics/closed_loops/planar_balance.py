"""Newton and Euler for bodies in the plane x-y, one by one: joint forces and drives for a known motion.

Points, forces and accelerations are complex numbers x + i y, one per instant. Wrenches are taken about the origin:
``[f_x, f_y, moment]``. Every unknown is the magnitude of a given wrench of one body on another; there are three
equations a body, so an isostatic mechanism has as many unknowns as equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Body:
    """A moving body: mass [kg], inertia about G [kg m^2], acceleration of G [m/s^2], G [m], angular acceleration."""

    mass: float
    inertia: float
    G: np.ndarray
    acceleration: np.ndarray
    alpha: np.ndarray | float = 0.0

    def momentum_rate(self) -> np.ndarray:
        """Rate of the momenta about the origin, shape (n, 3)."""
        rate = self.mass * self.acceleration
        return wrench(self.G, rate, self.inertia * np.asarray(self.alpha))


def wrench(point, force, moment=0.0) -> np.ndarray:
    """Wrench of a force at a point and of a moment, about the origin, shape (n, 3)."""
    point, force, moment = np.broadcast_arrays(point, force, moment)
    turned = (np.conj(point) * force).imag + moment
    return np.stack([force.real, force.imag, turned.real], axis=-1)


def solve(bodies, unknowns, loads=()):
    """Magnitudes of the unknown wrenches by name, each of shape (n,).

    Args:
        bodies: Name -> ``Body``.
        unknowns: Name -> (acting, acted on, unit wrench); a body that is not in ``bodies`` is the ground.
        loads: (acted on, wrench); ``(acting, acted on, wrench)`` where the reaction acts on another body.
    """
    names, order = list(unknowns), {body: 3 * k for k, body in enumerate(bodies)}
    count = max(len(np.atleast_1d(body.G)) for body in bodies.values())
    matrix, right = np.zeros((count, 3 * len(order), len(names))), np.zeros((count, 3 * len(order)))
    for body, start in order.items():
        right[:, start : start + 3] += bodies[body].momentum_rate()
    for acting, on, given in ((None, *load) if len(load) == 2 else load for load in loads):
        for body, sign in ((on, -1.0), (acting, 1.0)):
            if body in order:
                right[:, order[body] : order[body] + 3] += sign * given
    for column, (acting, on, unit) in enumerate(unknowns.values()):
        for body, sign in ((on, 1.0), (acting, -1.0)):
            if body in order:
                matrix[:, order[body] : order[body] + 3, column] += sign * unit
    found = np.linalg.solve(matrix, right[..., None])[..., 0]
    return {name: found[:, column] for column, name in enumerate(names)}


def pin_joint(name, acting, on, point):
    """Two unknowns ``name.x`` and ``name.y``: the force in a pin."""
    return {f"{name}.x": (acting, on, wrench(point, 1.0)), f"{name}.y": (acting, on, wrench(point, 1j))}


def weight(body: Body, g: float) -> np.ndarray:
    """Weight in gravity along -y."""
    return wrench(body.G, -1j * body.mass * g)
