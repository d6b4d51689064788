"""Motion of a conservative mechanism with one degree of freedom, by quadrature of its energy integral.

``M(q) q'^2 / 2 + V(q) = E`` gives ``t = integral of sqrt(M / (2 (E - V))) dq`` as long as q keeps its direction.
Nothing is integrated step by step, and singular positions of the joint coordinates are met only through M and V.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)


class EnergyIntegral:
    """Instants and positions of a motion that starts at ``q0`` with speed ``v0`` and never stops.

    Args:
        inertia: M(q) [kg m^2 or kg], vectorised.
        potential: V(q) [J], vectorised.
        q0: Position at t = 0.
        v0: Speed at t = 0, not 0.
        end: Position up to which it is wanted, in the direction of v0.
        panels: Number of Gauss panels of 20 nodes.
    """

    def __init__(self, inertia: Callable, potential: Callable, q0, v0, end, panels=400) -> None:
        self.energy = 0.5 * inertia(np.array([q0]))[0] * v0**2 + potential(np.array([q0]))[0]
        self.inertia, self.potential, self.sign = inertia, potential, np.sign(v0)
        self.edges = np.linspace(q0, end, panels + 1)
        half, middle = 0.5 * np.diff(self.edges), 0.5 * (self.edges[1:] + self.edges[:-1])
        nodes = middle[:, None] + half[:, None] * NODES
        slowness = 1.0 / self.speed(nodes.ravel()).reshape(nodes.shape)
        self.times = np.concatenate([[0.0], np.cumsum((slowness * WEIGHTS).sum(axis=1) * half)])

    def speed(self, q: np.ndarray) -> np.ndarray:
        """q' at q."""
        return self.sign * np.sqrt(2.0 * (self.energy - self.potential(q)) / self.inertia(q))

    def at(self, t: np.ndarray) -> np.ndarray:
        """q(t), by Newton's method on t(q)."""
        t = np.asarray(t, float)
        panel = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.edges) - 2)
        start, q = self.edges[panel], np.interp(t, self.times, self.edges)
        for _ in range(50):
            half, middle = 0.5 * (q - start), 0.5 * (q + start)
            nodes = middle[:, None] + half[:, None] * NODES
            passed = (WEIGHTS / self.speed(nodes.ravel()).reshape(nodes.shape)).sum(axis=1) * half
            change = (t - self.times[panel] - passed) * self.speed(q)
            q = q + change
            if np.abs(change).max() < 1e-15 * (1.0 + np.abs(q).max()):
                break
        return q
