"""N four-bars of equal rods (IFToMM A02): all uprights share one angle, which moves as a pendulum's does.

With q from the upright position: ``((N + 1)/3 + N) l q'' = ((N + 1)/2 + N) g sin q``. Started upright with speed w the
uprights turn over: with ``k = q''/sin q``, ``R = sqrt(w^2 + 4 k)/2`` and ``m = k/R^2``,
``q(t) = pi + 2 am(R t - K(m), m)`` (Jacobi's amplitude).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ellipj, ellipk


def pull(count: int, g: float, length: float = 1.0) -> float:
    """k [rad/s^2] in q'' = k sin q."""
    return ((count + 1) / 2 + count) * g / (((count + 1) / 3 + count) * length)


def angle(t, count: int, g: float = 9.81, speed: float = 1.0, length: float = 1.0) -> np.ndarray:
    """Angle of the uprights [rad] at t, from upright and turning with ``speed`` [rad/s] at t = 0."""
    k = pull(count, g, length)
    r = 0.5 * np.sqrt(speed**2 + 4.0 * k)
    m = k / r**2
    return np.pi + 2.0 * ellipj(r * np.asarray(t, float) - ellipk(m), m)[3]


def rate(t, count: int, g: float = 9.81, speed: float = 1.0, length: float = 1.0) -> np.ndarray:
    """Angular velocity [rad/s]: from the energy integral."""
    q = angle(t, count, g, speed, length)
    return np.sqrt(speed**2 + 2.0 * pull(count, g, length) * (1.0 - np.cos(q)))
