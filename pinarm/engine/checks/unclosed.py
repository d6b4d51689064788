"""Loops that close but for the rounding of their file: what redundant rows leave open, and how to loosen the joints."""

from __future__ import annotations

import numpy as np

from pinarm.engine.checks.figures import sampled
from pinarm.engine.constraints.nullspace import UNCLOSED
from pinarm.engine.motion.trajectory import Trajectory

ROUNDED = 1e-13
"""What rounding of numbers leaves open, relative to the length that a row can have: with 64 bits 1e-16 in each step."""


def unclosed(run: Trajectory) -> list[str]:
    """Return what is to be said of loops that stay open by more than the rounding of numbers; nothing if all close."""
    closure = run.mechanism.closure
    if not closure.size:
        return []
    rows = sampled(len(run))
    gaps = closure.at(run.q[rows])[0]
    if (np.abs(gaps) <= ROUNDED * closure.reach).all():  # nearly always
        return []
    reached = closure.splits(run.q[rows]).each(closure.size, lambda split, gap: split.reached(gap), gaps)
    left = np.abs(gaps - reached)
    worst = left.max(axis=0)
    if (worst <= ROUNDED * closure.reach).all():
        return []
    from pinarm.engine.kinematics.mobility import mobility_of

    found = mobility_of(run.mechanism, run.q[rows[left.max(axis=1).argmax()]])
    torn: dict[str, float] = {}
    for (constraint, row), size, reach in zip(closure.owners(), worst.tolist(), closure.reach.tolist(), strict=True):
        if size > ROUNDED * reach:
            owner = f"{constraint.unit(row)} of {constraint.name}"
            torn[owner] = max(size, torn.get(owner, 0.0))
    said = ", ".join(f"{size:.2g} {owner}" for owner, size in torn.items())
    return [
        f"loops close but for {said}: up to {UNCLOSED:g} of the extent, or rad, counts as rounding of the file; "
        f"{found.shared}"
    ]
