"""Motions with a known course, and integration by steps of one length, for tests of integrators."""

from contextlib import suppress
from functools import cache

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.integrator import Manifold, Solution
from pinarm.engine.integration.runge_kutta import Steps

PLANE = Manifold(2, 2)
ECCENTRICITY = 0.1
MOMENTS = np.array([0.5, 1.0, 1.7])
SPIN = np.array([0.6, -1.1, 0.4])
ATTITUDE = np.array([0.1, 0.5, -0.3, 0.8]) / np.linalg.norm([0.1, 0.5, -0.3, 0.8])


def attraction(t, q, v):
    return -q / np.linalg.norm(q) ** 3


def orbit(t):
    """Position and velocity on the orbit of unit attraction and semi-axis, from its pericentre."""
    mean = anomaly = np.asarray(t, float)
    for _ in range(30):
        change = (anomaly - ECCENTRICITY * np.sin(anomaly) - mean) / (1 - ECCENTRICITY * np.cos(anomaly))
        anomaly = anomaly - change
    minor, rate = np.sqrt(1 - ECCENTRICITY**2), 1 / (1 - ECCENTRICITY * np.cos(anomaly))
    q = np.stack([np.cos(anomaly) - ECCENTRICITY, minor * np.sin(anomaly)], axis=-1)
    return q, np.stack([-np.sin(anomaly) * rate, minor * np.cos(anomaly) * rate], axis=-1)


@cache
def body():
    """A body free to turn about its mass centre."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.addJointFrame(joint)
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.diag(MOMENTS)), pin.SE3.Identity())
    return Dynamics.of(model)


@cache
def turned():
    """Attitude (x, y, z, w) and angular velocity of the same body by Euler's equations alone."""

    def rate(t, y):
        (x, y_, z, s), w = y[:4], y[4:]
        rows = np.array([[s, -z, y_], [z, s, -x], [-y_, x, s], [-x, -y_, -z]])
        return np.concatenate([0.5 * rows @ w, -np.cross(w, MOMENTS * w) / MOMENTS])

    start = np.concatenate([ATTITUDE, SPIN])
    return solve_ivp(rate, (0, 4), start, "DOP853", rtol=1e-13, atol=1e-14, dense_output=True).sol


def equal_steps(method, interval, manifold, q, v, n):
    """Return the solution of n equal steps of any method, and its last state."""
    solution, h = Solution(method, manifold, [interval]), (interval.end - interval.start) / n
    stepper = method.stepper(solution, None)
    stepper.begin(interval, np.concatenate([q, v]))
    for k in range(n):
        t = interval.start + k * h
        if np.isnan(stepper.attempt(t, h)):  # an old Jacobian
            stepper.retry(h, np.nan)
            if not np.isfinite(stepper.attempt(t, h)):
                raise ArithmeticError("the iteration does not converge")
        y, (slopes, _) = stepper.y.copy(), stepper.accept(t + h, h, 1.0)
        solution.add(Steps(*np.array([[t], [h], [t + h]]), y[None], slopes[None], np.zeros((1, 3))))
    return solution, stepper.y.copy()


def measurable(method, errors, floor, ceiling, first=4):
    """Return numbers of steps, and what ``errors`` says of each: those whose first error is between the bounds.

    Each number is 1.2 times the one before; the last five are kept, where powers of h are purest.
    """
    tried, n, most = [], first, 300 if method.order > 3 else 4000
    while n <= most and (not tried or tried[-1][1][0] > floor):
        with suppress(ArithmeticError):  # too few steps for the iteration of an implicit method
            tried.append((n, errors(n)))
        n = max(round(1.2 * n), n + 1)
    kept = [(n, row) for n, row in tried if floor < row[0] < ceiling][-5:]
    assert len(kept) >= 2, f"too few errors between {floor} and {ceiling}"
    return [n for n, _ in kept], np.array([row for _, row in kept]).T


def slope(counts, errors):
    """Return the order that errors show: their slope over the number of steps, both logarithmic."""
    return -np.polyfit(np.log(counts), np.log(errors), 1)[0]
