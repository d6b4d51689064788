"""Slider-crank O A B in closed form: crank r, rod L, piston along x at the height e, crank balanced.

``sin psi = (e - r sin theta)/L`` (psi, angle of the rod from x), ``x = r cos theta + L cos psi``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .planar_balance import Body, pin_joint, solve, wrench


@dataclass(frozen=True)
class SliderCrank:
    """Lengths [m], masses [kg], inertias about O and G3 [kg m^2]; G3 at l_G from A."""

    r: float = 0.045
    L: float = 0.145
    e: float = 0.0
    l_G: float = 0.045
    m3: float = 0.65
    m4: float = 0.55
    I2: float = 0.012
    I3: float = 0.0019

    def motion(self, theta, omega, alpha=0.0):
        """(psi, x), their velocities and their accelerations."""
        s, c = np.sin(theta), np.cos(theta)
        sine = (self.e - self.r * s) / self.L
        psi, cosine = np.arcsin(sine), np.sqrt(1 - sine**2)
        psid = -self.r * c * omega / (self.L * cosine)
        psidd = (self.r * (s * omega**2 - c * alpha) / self.L + sine * psid**2) / cosine
        x = self.r * c + self.L * cosine
        xd = -self.r * s * omega - self.L * sine * psid
        xdd = -self.r * (c * omega**2 + s * alpha) - self.L * (cosine * psid**2 + sine * psidd)
        return (psi, x), (psid, xd), (psidd, xdd)

    def forces(self, theta, omega, alpha=0.0, gas=0.0):
        """Forces by Newton and Euler for each body; ``gas`` [N] acts on the piston along -x.

        Torque ``T`` on the crank, pin forces at O (ground on crank), A (crank on rod), B (rod on piston), and the
        cylinder's side force ``N`` on the piston with its moment ``M`` about B.
        """
        (psi, x), (psid, _), (psidd, xdd) = self.motion(theta, omega, alpha)
        u, v = np.exp(1j * theta), np.exp(1j * psi)
        at_a, at_b = self.r * u, x + 1j * self.e
        a_a = (1j * alpha - omega**2) * self.r * u
        bodies = {
            "crank": Body(1.0, self.I2, 0 * u, 0 * u, alpha),
            "rod": Body(self.m3, self.I3, at_a + self.l_G * v, a_a + (1j * psidd - psid**2) * self.l_G * v, psidd),
            "piston": Body(self.m4, 0.0, at_b, xdd + 0j),
        }
        unknowns = {
            "T": (None, "crank", wrench(0j, 0.0, 1.0)), "N": (None, "piston", wrench(at_b, 1j)),
            "M": (None, "piston", wrench(0j, 0.0, 1.0)), **pin_joint("O", None, "crank", 0j),
            **pin_joint("A", "crank", "rod", at_a), **pin_joint("B", "rod", "piston", at_b),
        }  # fmt: skip
        return solve(bodies, unknowns, [("piston", wrench(at_b, -gas + 0j))])

    def torque(self, theta, omega, alpha=0.0, gas=0.0):
        """The same torque from the rate of the kinetic energy."""
        (psi, _), (psid, xd), (psidd, xdd) = self.motion(theta, omega, alpha)
        u, v = np.exp(1j * theta), np.exp(1j * psi)
        velocity = 1j * (omega * self.r * u + psid * self.l_G * v)
        rate = (1j * alpha - omega**2) * self.r * u + (1j * psidd - psid**2) * self.l_G * v
        power = (self.I2 * omega * alpha + self.I3 * psid * psidd + self.m4 * xd * xdd
                 + self.m3 * (np.conj(velocity) * rate).real + gas * xd)  # fmt: skip
        return power / omega

    def inertia(self, theta):
        """Reduced inertia: twice the kinetic energy at omega = 1 [kg m^2]."""
        (psi, _), (psid, xd), _ = self.motion(theta, 1.0)
        velocity = self.r * np.exp(1j * theta) + psid * self.l_G * np.exp(1j * psi)
        return self.I2 + self.I3 * psid**2 + self.m4 * xd**2 + self.m3 * abs(velocity) ** 2
