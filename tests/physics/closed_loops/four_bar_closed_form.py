"""Four-bar linkage O2 A B O4 in closed form: positions, velocities, accelerations, forces, and its reduced inertia.

Crank a from O2 = 0, coupler b, rocker c from O4 = d, angles from x. With ``f = d - a exp(i theta2)`` (from A to O4),
``theta3 = arg f + atan2(R, b^2 + |f|^2 - c^2)``, ``R = +-sqrt(((b + c)^2 - |f|^2)(|f|^2 - (b - c)^2))``: the plus sign
for the open linkage (B above the line from A to O4), the minus sign for the crossed one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .planar_balance import Body, pin_joint, solve, weight, wrench


@dataclass(frozen=True)
class FourBar:
    """Uniform slender bars of lengths a, b, c [m] and masses m2, m3, m4 [kg]; ground d [m]."""

    a: float
    b: float
    c: float
    d: float
    m2: float
    m3: float
    m4: float
    open: bool = True

    def angles(self, theta2):
        """theta3, theta4 [rad]."""
        f = self.d - self.a * np.exp(1j * theta2)
        s2 = abs(f) ** 2
        root = np.sqrt(((self.b + self.c) ** 2 - s2) * (s2 - (self.b - self.c) ** 2))
        return self._angles(theta2, f, root if self.open else -root)

    def _angles(self, theta2, f, root):
        theta3 = np.angle(f) + np.arctan2(root, self.b**2 + abs(f) ** 2 - self.c**2)
        tip = (self.b * np.exp(1j * theta3) - f) / self.c
        return theta3, np.angle(tip)

    def rates(self, theta2, omega2, alpha2=0.0):
        """(theta3, theta4), (omega3, omega4), (alpha3, alpha4): the loop equation derived twice."""
        theta3, theta4 = self.angles(theta2)
        p2, p3, p4 = (length * np.exp(1j * angle) for length, angle in
                      ((self.a, theta2), (self.b, theta3), (self.c, theta4)))  # fmt: skip
        omega3, omega4 = _split(p3, -p4, -omega2 * p2)
        drift = -(alpha2 * p2 + 1j * (omega2**2 * p2 + omega3**2 * p3 - omega4**2 * p4))
        return (theta3, theta4), (omega3, omega4), _split(p3, -p4, drift)

    def bodies(self, theta2, omega2, alpha2=0.0):
        """Crank, coupler and rocker, with the points A and B."""
        (theta3, theta4), (omega3, omega4), (alpha3, alpha4) = self.rates(theta2, omega2, alpha2)
        u2, u3, u4 = (np.exp(1j * angle) for angle in (theta2, theta3, theta4))
        a2, a3, a4 = (1j * alpha - omega**2 for alpha, omega in
                      ((alpha2, omega2), (alpha3, omega3), (alpha4, omega4)))  # fmt: skip
        point_a = self.a * u2
        point_b = point_a + self.b * u3
        bodies = {
            "crank": Body(self.m2, self.m2 * self.a**2 / 12, point_a / 2, a2 * point_a / 2, alpha2),
            "coupler": Body(self.m3, self.m3 * self.b**2 / 12, point_a + self.b * u3 / 2,
                            a2 * point_a + a3 * self.b * u3 / 2, alpha3),
            "rocker": Body(self.m4, self.m4 * self.c**2 / 12, self.d + self.c * u4 / 2, a4 * self.c * u4 / 2, alpha4),
        }  # fmt: skip
        return bodies, point_a, point_b

    def forces(self, theta2, omega2, alpha2=0.0, g=9.81):
        """Torque ``T`` of the ground on the crank, and pin forces: of the ground at O2, O4, of crank on coupler at A,
        of coupler on rocker at B, by Newton and Euler for each body."""
        bodies, point_a, point_b = self.bodies(theta2, omega2, alpha2)
        unknowns = {
            "T": (None, "crank", wrench(0j, 0.0, 1.0)),
            **pin_joint("O2", None, "crank", 0j), **pin_joint("A", "crank", "coupler", point_a),
            **pin_joint("B", "coupler", "rocker", point_b), **pin_joint("O4", None, "rocker", self.d + 0j),
        }  # fmt: skip
        return solve(bodies, unknowns, [(name, weight(body, g)) for name, body in bodies.items()])

    def inertia(self, theta2):
        """Reduced inertia: twice the kinetic energy at omega2 = 1 [kg m^2]."""
        theta3, _, d3, d4 = self.slopes(theta2)
        crank_tip = 1j * self.a * np.exp(1j * theta2)
        middle = crank_tip + 0.5j * self.b * d3 * np.exp(1j * theta3)
        return (self.m2 * self.a**2 / 3 + self.m3 * (abs(middle) ** 2 + (self.b * d3) ** 2 / 12)
                + self.m4 * (self.c * d4) ** 2 / 3)  # fmt: skip

    def potential(self, theta2, g=9.81):
        """Potential energy of the weights [J]."""
        theta3, theta4, *_ = self.slopes(theta2)
        return g * ((self.m2 / 2 + self.m3) * self.a * np.sin(theta2) + self.m3 * self.b / 2 * np.sin(theta3)
                    + self.m4 * self.c / 2 * np.sin(theta4))  # fmt: skip

    def slopes(self, theta2):
        """theta3, theta4 and their derivatives with respect to theta2."""
        (theta3, theta4), (d3, d4), _ = self.rates(theta2, 1.0)
        return theta3, theta4, d3, d4


@dataclass(frozen=True)
class ChangePoint(FourBar):
    """A linkage with a + d = b + c, along its smooth motion through the aligned position at theta2 = pi.

    There ``(b + c)^2 - |f|^2 = 4 a d cos^2(theta2/2)``, so that
    ``R = 2 sqrt(a d) cos(theta2/2) sqrt(|f|^2 - (b - c)^2)`` is smooth and changes sign: the linkage is open on one
    turn and crossed on the next. The slopes are the derivatives of this form and exist at theta2 = pi too.
    """

    def slopes(self, theta2):
        """theta3, theta4 and their derivatives with respect to theta2, theta2 = 0 being on the open branch."""
        a, b, c, d = self.a, self.b, self.c, self.d
        u = np.exp(1j * np.asarray(theta2))
        f, df = d - a * u, -1j * a * u
        s2, ds2 = a * a + d * d - 2 * a * d * u.real, 2 * a * d * u.imag
        half = np.sqrt(s2 - (b - c) ** 2)
        cosine, sine = np.cos(np.asarray(theta2) / 2), np.sin(np.asarray(theta2) / 2)
        root = 2 * np.sqrt(a * d) * cosine * half
        droot = 2 * np.sqrt(a * d) * (-0.5 * sine * half + cosine * ds2 / (2 * half))
        near = b * b + s2 - c * c
        theta3, theta4 = self._angles(theta2, f, root)
        d3 = (df / f).imag + (droot * near - root * ds2) / (4 * b * b * s2)
        d4 = ((a * u + b * d3 * np.exp(1j * theta3)) / (c * np.exp(1j * theta4))).real
        return theta3, theta4, d3, d4


def _split(p, q, wanted):
    """Real x, y with x p + y q = wanted."""
    det = (np.conj(p) * q).imag
    return (np.conj(wanted) * q).imag / det, (np.conj(p) * wanted).imag / det
