"""The inertia that a drive feels: what its mechanism's masses ask of it for an acceleration, and nothing else does.

With the velocities v that the mechanism can have, in which the driven coordinate moves at 1 and the coordinates of the
other drives are held, and the mass matrix M, it is the least ``vᵀ M v``: joints that nothing drives give way as they do
when the coordinate is accelerated from rest. Weights, springs and losses have no part in it. Where one drive moves the
mechanism it is ``2 T / w²``, with the kinetic energy T at the speed w.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint_rows import rows_of
from pinarm.engine.motion.trajectory import Trajectory

HELD = 1e-10
"""Singular value of what drives do to the free motions, relative to the largest, below which one holds the others."""


def load_inertia(run: Trajectory, coordinate: str, held: Iterable[str] = ()) -> Array:
    """Return the inertia that the drive of a coordinate feels in every row, rotors included, shape (n,).

    It is in kg*m^2 or kg, and infinite where the coordinate cannot move while the other drives are held.

    Args:
        run: The rows.
        coordinate: Name of the driven coordinate.
        held: Names of joints that follow laws beside those of ``run.drives``, as where simplification holds them.
    """
    mechanism = run.mechanism
    names = [coordinate, *(name for name in dict.fromkeys((*run.drives, *held)) if name != coordinate)]
    rows = rows_of(mechanism.model, [mechanism.coordinate(name) for name in names], run.q)
    masses, felt = run.dynamics.mass_matrices(run.q), np.empty(len(run.q))
    for places, free in mechanism.closure.free_motions(run.q):
        ways = np.einsum("ndj,fnj->ndf", rows[places], free)
        reduced = np.einsum("fnj,njk,gnk->nfg", free, masses[places], free)
        felt[places] = [_felt(way, mass) for way, mass in zip(ways, reduced, strict=True)]
    return felt


def _felt(ways: Array, mass: Array) -> float:
    """Return the least ``uᵀ M u`` of free motions u, shape (f,), with ``ways u = (1, 0, ..)``; ways of shape (d, f)."""
    left, sizes, right = np.linalg.svd(ways)
    if len(sizes) < len(ways) or not sizes[-1] > HELD * sizes[0]:
        return np.inf
    u = right[: len(sizes)].T @ (left[0] / sizes)
    passive = right[len(sizes) :]
    if len(passive):
        u = u - passive.T @ np.linalg.lstsq(passive @ mass @ passive.T, passive @ (mass @ u))[0]
    return float(u @ mass @ u)
