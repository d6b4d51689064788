"""Industrial manipulator: law of motion in closed form, and all plane joint forces by Newton and Euler for each body.

``al'' I_eq = F l - [g (m1 (l - d)/2 + m2 l + m3 l/2 + m l - m6 d) - p S r] cos(al)``; support 2 only translates, and
``x = -r cos(al)``, ``y = h - r sin(al)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from .planar_balance import Body, pin_joint, solve, weight, wrench


@dataclass(frozen=True)
class Manipulator:
    """Lengths [m], masses [kg], piston [m^2]; G2, G7 and P from B as complex numbers."""

    l: float = 2.0
    d: float = 1.25
    r: float = 0.75
    h: float = 2.0
    AE: float = 0.6
    m1: float = 100.0
    m2: float = 120.0
    m3: float = 60.0
    m6: float = 270.0
    m: float = 600.0
    S: float = 0.03
    G2: complex = 0.3 - 0.2j
    G7: complex = 0.5 + 0.1j
    P: complex = 0.4 + 0.7j
    g: float = 9.81

    @property
    def I_eq(self) -> float:
        """Reduced inertia [kg m^2]."""
        return (self.l**2 * ((self.m1 + self.m3) / 3 + self.m2 + self.m) + self.d**2 * (self.m1 / 3 + self.m6)
                - self.l * self.d * self.m1 / 3)  # fmt: skip

    @property
    def weights(self) -> float:
        """Moment of the weights about A at alpha = 0, reduced to the arm [N m]."""
        return self.g * (self.m1 * (self.l - self.d) / 2 + (self.m2 + self.m3 / 2 + self.m) * self.l - self.m6 * self.d)

    def acceleration(self, alpha, F=0.0, p=0.0):
        """al'' [rad/s^2] under the operator's force F [N] and the pressure p [Pa]."""
        return (F * self.l - (self.weights - p * self.S * self.r) * np.cos(alpha)) / self.I_eq

    def torque(self, alpha, aldd=0.0, F=0.0, p=0.0):
        """Torque of a motor on the arm that gives al''."""
        return self.I_eq * aldd + (self.weights - p * self.S * self.r) * np.cos(alpha) - F * self.l

    def swing(self, t, alpha, ald=0.0, F=0.0, p=0.0):
        """alpha(t), al'(t) from given values at t = 0, integrated to 1e-13."""
        return solve_ivp(lambda _, y: (y[1], self.acceleration(y[0], F, p)), (0.0, t[-1]), (alpha, ald), "DOP853",
                         t_eval=t, rtol=1e-13, atol=1e-14).y  # fmt: skip

    def forces(self, alpha, ald, aldd, F=0.0, p=0.0):
        """Torque ``T`` on the arm; forces ``A``, ``B``, ``E``, ``F``, ``D`` in pins: of the ground on arm and link 3,
        of the arm on the support, of link 3 on the support, of the arm on the rod; ``x`` and ``y``: side force and
        moment (about the origins of cylinder and rod) of the ground on the cylinder and of the cylinder on the rod."""
        alpha, ald, aldd = np.broadcast_arrays(*(np.asarray(value, float) for value in (alpha, ald, aldd)))
        u, swing = np.exp(1j * alpha), (1j * aldd - ald**2) * np.exp(1j * alpha)
        at_b, at_d, at_e = self.l * u, -self.r * u, 1j * self.AE + 0 * u
        foot = at_d.real - 1j * self.h
        joint_mass = self.m2 + self.m
        arm = self.m1 + self.m6
        gravity_centre = (self.m1 * (self.l - self.d) / 2 - self.m6 * self.d) / arm
        about_a = self.m1 * (self.l**2 + self.d**2 - self.l * self.d) / 3 + self.m6 * self.d**2
        load = (self.m2 * self.G2 + self.m * self.G7) / joint_mass
        bodies = {
            "arm": Body(arm, about_a - arm * gravity_centre**2, gravity_centre * u, gravity_centre * swing, aldd),
            "support": Body(joint_mass, 0.0, at_b + load, self.l * swing),
            "link_3": Body(self.m3, self.m3 * self.l**2 / 12, at_e + self.l / 2 * u, self.l / 2 * swing, aldd),
            "cylinder": Body(0.0, 0.0, foot, 0 * u), "rod": Body(0.0, 0.0, at_d, 0 * u),
        }  # fmt: skip
        unknowns = {
            "T": (None, "arm", wrench(0j, 0.0, 1.0)),
            **pin_joint("A", None, "arm", 0 * u), **pin_joint("B", "arm", "support", at_b),
            **pin_joint("E", None, "link_3", at_e), **pin_joint("F", "link_3", "support", at_b + 1j * self.AE),
            **pin_joint("D", "arm", "rod", at_d),
            "x.force": (None, "cylinder", wrench(foot, 1j)), "x.moment": (None, "cylinder", wrench(0j, 0.0, 1.0)),
            "y.force": ("cylinder", "rod", wrench(at_d, 1.0)), "y.moment": ("cylinder", "rod", wrench(0j, 0.0, 1.0)),
        }  # fmt: skip
        loads = [
            ("support", wrench(at_b + self.P, F * 1j * u)), ("rod", wrench(at_d, -1j * p * self.S)),
            ("cylinder", wrench(foot, 1j * p * self.S)),
            *((name, weight(body, self.g)) for name, body in bodies.items()),
        ]  # fmt: skip
        return solve(bodies, unknowns, loads)
