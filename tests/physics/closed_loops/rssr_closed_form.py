"""Spatial four-bar RSSR in closed form: crank about z at O, rocker about x at Q, coupler b between ball joints.

``A = a (cos th, sin th, 0)``, ``B = Q + c (0, -sin ph, cos ph)``; with ``D = Q - A`` the condition |B - A| = b is
``D_z cos ph - D_y sin ph = (b^2 - c^2 - |D|^2)/(2 c)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .periodic import rate


@dataclass(frozen=True)
class Rssr:
    """Lengths [m], masses [kg], radius of the coupler [m], gravity along -z [m/s^2]; ``branch`` 1 or -1."""

    a: float = 0.10
    b: float = 0.45
    c: float = 0.25
    Q: tuple[float, float, float] = (0.10, 0.40, 0.05)
    m2: float = 1.0
    m3: float = 2.0
    m4: float = 1.5
    rho: float = 0.015
    g: float = 9.81
    branch: int = 1

    def rocker(self, theta):
        """phi [rad]."""
        apart = np.array(self.Q) - self.crank_pin(theta)
        right = (self.b**2 - self.c**2 - (apart**2).sum(axis=-1)) / (2 * self.c)
        reach = np.hypot(apart[..., 1], apart[..., 2])
        return -np.arctan2(apart[..., 1], apart[..., 2]) + self.branch * np.arccos(right / reach)

    def crank_pin(self, theta):
        """A, shape (n, 3)."""
        return self.a * np.stack([np.cos(theta), np.sin(theta), np.zeros_like(theta)], axis=-1)

    def rocker_pin(self, theta):
        """B, shape (n, 3)."""
        phi = self.rocker(theta)
        return np.array(self.Q) + self.c * np.stack([np.zeros_like(phi), -np.sin(phi), np.cos(phi)], axis=-1)

    def coupler(self, theta):
        """Angles of the coupler about z and about its own y [rad]: its axis is (cos z cos y, sin z cos y, -sin y)."""
        u = (self.rocker_pin(theta) - self.crank_pin(theta)) / self.b
        return np.unwrap(np.arctan2(u[:, 1], u[:, 0])), -np.arcsin(u[:, 2])

    def turn(self, omega, samples=256):
        """theta, phi, phi', torques of crank and spin over one turn at the constant speed omega; spin is held at 0.

        The torques are those of virtual power: work on the crank is the change of energy, and the coupler's own moment
        of inertia gives the rest. All rates are those of Fourier series.
        """
        period = 2 * np.pi / omega
        theta = np.arange(samples) * 2 * np.pi / samples
        phi, pin_a, pin_b = self.rocker(theta), self.crank_pin(theta), self.rocker_pin(theta)
        middle, u, phd = 0.5 * (pin_a + pin_b), (pin_b - pin_a) / self.b, rate(phi, period)
        velocity, ud = rate(middle, period), rate(u, period)
        about_z, _ = self.coupler(theta)
        roll = rate(np.exp(1j * about_z), period) / (1j * np.exp(1j * about_z))
        axial = roll.real * u[:, 2]  # of the angular velocity along the coupler, while spin' = 0
        along, across = self.m3 * self.rho**2 / 2, self.m3 * (self.b**2 / 12 + self.rho**2 / 4)
        energy = (
            self.m2 * self.a**2 * omega**2 / 6 + self.m4 * self.c**2 * phd**2 / 6
            + 0.5 * self.m3 * (velocity**2).sum(axis=1) + 0.5 * across * (ud**2).sum(axis=1) + 0.5 * along * axial**2
            + self.g * (self.m3 * middle[:, 2] + self.m4 * 0.5 * (pin_b[:, 2] + self.Q[2]))
        )  # fmt: skip
        return theta, phi, phd, rate(energy, period) / omega, along * rate(axial, period)
