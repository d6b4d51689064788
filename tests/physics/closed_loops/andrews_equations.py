"""Andrews' squeezing mechanism: reference values of the IVP Test Set, and its equations written anew.

The points of the mechanism are sums of fixed vectors turned by sums of joint angles, in complex numbers x + i y
``p = p_0 + sum_k c_k exp(i s_k q)``, so that ``dp/dq`` and the drift ``-sum_k c_k (s_k v)^2 exp(i s_k q)`` are exact
one-liners. Lagrange's equations with three closures follow, solved as a dense system at every stage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

NAMES = ("beta", "Theta", "gamma", "delta", "Phi", "epsilon", "Omega")
START = np.array([-0.0617138900142765, 0.0, 0.455279819163070, 0.487364979543844, 0.222668390165886, 1.23054744454982,
                  -0.222668390165886])  # fmt: skip
"""Joint angles at rest, t = 0 [rad]."""
PUBLISHED = np.array([15.81077119629904, -15.75637105984298, 0.04082224013073101, 0.5244099658805304,
                      -0.5347301163226948, 1.048080741042263, 0.5347301163226948])  # fmt: skip
"""At t = 0.03 s, as the test set prints them [rad]. They are the solution 1e-12 s later: beta turns at 1140 rad/s."""
DRIVE, STIFFNESS, FREE_LENGTH = 0.033, 4530.0, 0.07785


@dataclass(frozen=True)
class Point:
    """``p = fixed + sum_k vectors_k exp(i turns_k q)``: vectors complex (k,), turns (k, 7)."""

    fixed: complex
    vectors: np.ndarray
    turns: np.ndarray

    def place(self, q):
        return self.fixed + self.vectors @ np.exp(1j * self.turns @ q)

    def slope(self, q):
        """dp/dq, complex, shape (7,)."""
        return (1j * self.vectors * np.exp(1j * self.turns @ q)) @ self.turns

    def drift(self, q, v):
        return -(self.vectors * (self.turns @ v) ** 2) @ np.exp(1j * self.turns @ q)


def turned(*names):
    """Row that adds up the named joint angles."""
    return np.isin(NAMES, names).astype(float)


def point(fixed, *legs):
    """A point from (vector, names of the angles that turn it)."""
    return Point(fixed, np.array([leg for leg, _ in legs], complex), np.array([turned(*names) for _, names in legs]))


K1, K2, K3, K4, K5, K6, K7 = (("beta",), ("beta", "Theta"), ("gamma",), ("delta", "Phi"), ("delta",),
                              ("epsilon", "Omega"), ("epsilon",))  # fmt: skip
O, A, B, C = 0j, -0.06934 - 0.00227j, -0.03635 + 0.03273j, 0.014 + 0.072j
BODIES = [  # mass, moment of inertia about the mass centre, mass centre, row of its absolute angle
    (0.04325, 2.194e-6, point(O, (0.00092, K1)), turned(*K1)),
    (0.00365, 4.410e-7, point(O, (0.007, K1), (-0.0115, K2)), turned(*K2)),
    (0.02373, 5.255e-6, point(B, (0.01043 - 0.01874j, K3)), turned(*K3)),
    (0.00706, 5.667e-7, point(A, (0.04, K5), (-0.00579j, K4)), turned(*K4)),
    (0.07050, 1.169e-5, point(A, (0.02308 + 0.00916j, K5)), turned(*K5)),
    (0.00706, 5.667e-7, point(A, (-0.04j, K7), (0.00579, K6)), turned(*K6)),
    (0.05498, 1.912e-5, point(A, (0.01228 + 0.00449j, K7)), turned(*K7)),
]
P2 = point(O, (0.007, K1), (-0.028, K2))
ENDS = (point(B, (-0.035j, K3)), point(A, (0.04, K5), (-0.02j, K4)), point(A, (-0.04j, K7), (0.02, K6)))
SPRING = point(B, (0.02 - 0.018j, K3))


def acceleration(q, v):
    """Joint accelerations, and the forces of the ends P3, P4, P6 on the point P of K2 (complex, shape (3,))."""
    mass, force = np.zeros((7, 7)), np.zeros(7)
    for m, inertia, centre, row in BODIES:
        slope = centre.slope(q)
        mass += m * np.outer(np.conj(slope), slope).real + inertia * np.outer(row, row)
        force -= m * (np.conj(slope) * centre.drift(q, v)).real
    force[0] += DRIVE
    apart = C - SPRING.place(q)
    pull = STIFFNESS * (abs(apart) - FREE_LENGTH) * apart / abs(apart)
    force += (np.conj(pull) * SPRING.slope(q)).real
    gaps = [P2.slope(q) - end.slope(q) for end in ENDS]
    rows = np.array([part for gap in gaps for part in (gap.real, gap.imag)])
    drift = [P2.drift(q, v) - end.drift(q, v) for end in ENDS]
    gamma = np.array([part for rate in drift for part in (rate.real, rate.imag)])
    system = np.block([[mass, -rows.T], [rows, np.zeros((6, 6))]])
    found = np.linalg.solve(system, np.concatenate([force, -gamma]))
    return found[:7], found[7::2] + 1j * found[8::2]


def closure(q):
    """Gaps of the three loops [m]."""
    return np.array([P2.place(q) - end.place(q) for end in ENDS])


def motion(t):
    """q, v at the instants t, each of shape (n, 7); unstabilised, 1e-13: the drift stays below 1e-13 m in 0.03 s."""

    def rate(_, y):
        return np.concatenate([y[7:], acceleration(y[:7], y[7:])[0]])

    run = solve_ivp(
        rate, (0.0, t[-1]), np.concatenate([START, np.zeros(7)]), "DOP853", t_eval=t, rtol=1e-13, atol=1e-14
    )
    return run.y[:7].T, run.y[7:].T


def energy(q, v):
    """Kinetic and potential energy less the work of the drive [J]: constant."""
    kinetic = sum(0.5 * m * abs(centre.slope(q) @ v) ** 2 + 0.5 * inertia * (row @ v) ** 2
                  for m, inertia, centre, row in BODIES)  # fmt: skip
    interval = abs(C - SPRING.place(q)) - FREE_LENGTH
    return kinetic + 0.5 * STIFFNESS * interval**2 - DRIVE * q[0]
