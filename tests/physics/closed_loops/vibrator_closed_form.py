"""Olive-tree vibrator with its rotor prescribed: the exact law of motion of beta, and the published linear one.

Exact closure: ``O3 = (d0, -l5 sin be, l5 cos be)``, ``x2 = (k, 0, u)/rho`` with ``k = d0 - l1``, ``u = l5 cos be``,
``rho = hypot(k, u)``, and ``C4 = O3 - d y + e (-sin(phi) x2 + cos(phi) y)``. The law of motion is that of virtual
power, ``sum m_i a_i . dr_i/dbe + A5 be'' = Q``, with derivatives of these positions taken by hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Vibrator:
    """Numbers of the reference mechanism [SI]; Omega is the speed of the rotor, phi = Omega t."""

    m1: float = 20.0
    m2: float = 6.0
    m3: float = 15.0
    m4: float = 10.0
    e: float = 0.06
    d: float = 0.25
    l1: float = 0.3
    l3: float = 0.2
    l5: float = 1.1
    d0: float = 4.3
    A5: float = 45.0
    k_star: float = 2.5e5
    b_star: float = 350.0
    lam: float = 15.0
    k1: float = 2e4
    b1: float = 300.0
    Omega: float = 157.0

    def closure(self, beta):
        """Y, theta, X."""
        k, u = self.d0 - self.l1, self.l5 * np.cos(beta)
        return -self.l5 * np.sin(beta), -np.arctan2(u, k), np.hypot(k, u) - self.l3

    def _axis(self, beta):
        """x2 with its first and second derivative with respect to beta, each of shape (3,)."""
        k, u, du, ddu = self.d0 - self.l1, self.l5 * np.cos(beta), -self.l5 * np.sin(beta), -self.l5 * np.cos(beta)
        rho2 = k * k + u * u
        first = np.array([-k * u, 0.0, k * k]) / rho2**1.5
        second = np.array([-k, 0.0, 0.0]) / rho2**1.5 - 3 * u / rho2 * first
        return np.array([k, 0.0, u]) / rho2**0.5, first * du, second * du**2 + first * ddu

    def _paths(self, t, beta):
        """(dr/dbe, d2r/dbe2, d2r/dbe dt, d2r/dt2) of O3 and of C4."""
        phi, sine, cosine = self.Omega * t, np.sin(beta), np.cos(beta)
        x2, dx2, ddx2 = self._axis(beta)
        o3 = self.l5 * np.array([[0.0, -cosine, -sine], [0.0, sine, -cosine], [0, 0, 0], [0, 0, 0]])
        own = self.e * np.array([
            -np.sin(phi) * dx2, -np.sin(phi) * ddx2, -self.Omega * np.cos(phi) * dx2,
            self.Omega**2 * (np.sin(phi) * x2 - np.cos(phi) * Y)])  # fmt: skip
        return o3, o3 + own

    def acceleration(self, t, beta, bed):
        """be'' [rad/s^2]."""
        slope, stiffness = -self.l5 * np.cos(beta), self.k1 * -self.l5 * np.sin(beta)
        o3, c4 = self._paths(t, beta)
        inertia, force = self.A5, -self.k_star * beta - (self.b_star + self.lam) * bed
        force += -stiffness * slope - self.b1 * slope**2 * bed
        boom = np.array([slope * Y, self.l5 * np.sin(beta) * Y, 0 * Y, 0 * Y])
        for mass, (first, second, mixed, own) in ((self.m1 + self.m2, boom), (self.m3, o3), (self.m4, c4)):
            inertia += mass * first @ first
            force -= mass * first @ (second * bed**2 + 2 * mixed * bed + own)
        return force / inertia

    def inertia(self, t, beta):
        """Reduced inertia on beta [kg m^2]."""
        o3, c4 = self._paths(t, beta)
        return (self.A5 + (self.m1 + self.m2) * (self.l5 * np.cos(beta)) ** 2 + self.m3 * o3[0] @ o3[0]
                + self.m4 * c4[0] @ c4[0])  # fmt: skip

    def motion(self, t, beta=0.0, bed=0.0):
        """beta, be', be'' at the instants t from given values at t = 0, integrated to 1e-13."""
        run = solve_ivp(lambda t, y: (y[1], self.acceleration(t, *y)), (0.0, t[-1]), (beta, bed), "DOP853",
                        t_eval=t, rtol=1e-13, atol=1e-15, max_step=0.1 / self.Omega)  # fmt: skip
        return (*run.y, np.array([self.acceleration(*row) for row in zip(t, *run.y, strict=True)]))

    def loop_force(self, t, beta, bed, bedd):
        """X53, Y53, Z53: force of the trunk on the vibrator at O3 in basis 2, by momenta of bodies 1 to 4.

        X53: bodies 3 and 4 along x2; Y53: bodies 1 to 4 along y; Z53: bodies 2, 3, 4 about y at O2.
        """
        o3, c4 = self._paths(t, beta)
        a3, a4 = (p[0] * bedd + p[1] * bed**2 + 2 * p[2] * bed + p[3] for p in (o3, c4))
        (x2, *_), boom = self._axis(beta), -self.l5 * np.sin(beta)
        rate, change = -self.l5 * np.cos(beta) * bed, -self.l5 * (np.cos(beta) * bedd - np.sin(beta) * bed**2)
        along = (self.m1 + self.m2) * change + self.m3 * a3 @ Y + self.m4 * a4 @ Y
        arm3 = np.hypot(self.d0 - self.l1, self.l5 * np.cos(beta)) * x2
        arm4 = arm3 - self.d * Y + self.e * (-np.sin(self.Omega * t) * x2 + np.cos(self.Omega * t) * Y)
        about = np.cross(arm3, self.m3 * a3) @ Y + np.cross(arm4, self.m4 * a4) @ Y
        return (self.m3 * a3 @ x2 + self.m4 * a4 @ x2, along + self.k1 * boom + self.b1 * rate,
                -about / np.linalg.norm(arm3))  # fmt: skip

    def linear(self, t, beta=0.0, bed=0.0):
        """The published law: beta, be', be'' of the linear oscillator from given values at t = 0, in closed form."""
        mass = self.A5 + (self.m1 + self.m2 + self.m3 + self.m4) * self.l5**2
        damping, stiffness = self.b_star + self.b1 * self.l5**2 + self.lam, self.k1 * self.l5**2 + self.k_star
        forced = -self.m4 * self.l5 * self.e * self.Omega**2
        forced /= stiffness - mass * self.Omega**2 + 1j * damping * self.Omega
        decay = (-damping + np.sqrt(complex(damping**2 - 4 * mass * stiffness))) / (2 * mass)
        # the free part Re(c exp(decay t)) makes up for what the forced part has at t = 0
        missing, speed = beta - forced.real, bed - (1j * self.Omega * forced).real
        free = missing + 1j * (decay.real * missing - speed) / decay.imag
        turning, dying = forced * np.exp(1j * self.Omega * t), free * np.exp(decay * t)
        return tuple((turning * (1j * self.Omega) ** k + dying * decay**k).real for k in range(3))

    def amplitude(self):
        """Amplitude of the published law's steady motion [rad]."""
        mass = self.A5 + (self.m1 + self.m2 + self.m3 + self.m4) * self.l5**2
        damping, stiffness = self.b_star + self.b1 * self.l5**2 + self.lam, self.k1 * self.l5**2 + self.k_star
        return self.m4 * self.l5 * self.e * self.Omega**2 / abs(
            stiffness - mass * self.Omega**2 + 1j * damping * self.Omega)  # fmt: skip
