"""Rotor on a ball bearing A and a ring bearing B: forces of the bearings, and the two masses that balance it.

At constant speed w the momenta about O on the axis turn with the rotor: ``A + B = -w^2 U`` and
``z_A A + z_B B = -w^2 W`` in the rotor's axes x, y, with ``U = sum m r``, ``W = sum m z r`` over all masses;
weights are shared by A and B like any static load. Forces across the axis are complex numbers x + i y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rotor:
    """Mass [kg], U [kg m] and W [kg m^2] of the rotor alone, bearings and planes [m], radius of corrections [m]."""

    m: float = 12.0
    U: complex = 12.0 * 0.5e-3
    W: complex = 2e-4 - 1e-4j
    z_A: float = -0.2
    z_B: float = 0.2
    planes: tuple[float, float] = (-0.12, 0.12)
    radius: float = 0.08

    def rotating(self, w, masses=(0.0, 0.0), angles=(0.0, 0.0), axial_g=0.0):
        """Forces of A and B on the rotor in the rotor's axes [N], with correction masses in the planes.

        On a vertical shaft the weight acts beside the axis: a moment ``axial_g U`` that turns with the rotor too.
        """
        moments = [mass * self.radius * np.exp(1j * angle) for mass, angle in zip(masses, angles, strict=True)]
        first = self.U + sum(moments)
        second = self.W + sum(z * moment for z, moment in zip(self.planes, moments, strict=True))
        right = [-(w**2) * first, -(w**2) * second - axial_g * first]
        return tuple(np.linalg.solve([[1.0, 1.0], [self.z_A, self.z_B]], right))

    def constant(self, g, masses=(0.0, 0.0)):
        """Forces of A and B on the rotor in the ground's axes for gravity along -y [N], G being in the plane z = 0."""
        weights = [self.m * g, *(mass * g for mass in masses)]
        about = sum(z * weight for z, weight in zip((0.0, *self.planes), weights, strict=True))
        return tuple(np.linalg.solve([[1.0, 1.0], [self.z_A, self.z_B]], [1j * sum(weights), 1j * about]))

    def corrections(self):
        """Masses [kg] and angles [rad] in the two planes that make U and W vanish."""
        moments = np.linalg.solve([[1.0, 1.0], self.planes], [-self.U, -self.W])
        return abs(moments) / self.radius, np.angle(moments)
