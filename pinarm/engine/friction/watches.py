"""What ends a stretch of a motion with friction: how far slips are from rest, and stuck joints from slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.friction.sliding import SlidingFriction

REST = 1e-12
"""Slip that is rest, over 1 rad/s or m/s or the largest slip at the start: rounding of a velocity that vanishes."""


NOTHING = 1e-12
"""Friction [N*m or N] without which a joint rests: where what holds it and its bound grow from 0 together, as in a gear
without a load, they are compared from there on."""


@dataclass(frozen=True, eq=False)
class Approach:
    """How far a slip is from rest, or one at rest from slip.

    Attributes:
        slips: Returns the slips [rad/s or m/s] of all k components in states, shape (n, k).
        parts: Numbers of the components of this one.
        direction: s: its direction at first, 0 where it is at rest, shape (parts,).
    """

    slips: Callable[[Array, Array], Array]
    parts: Indices
    direction: Array

    def gap(self, t: Array, q: Array, v: Array) -> Array:
        """Return ``s u`` with some slack, so that a slip that begins does not end at once, shape (n,).

        Of a slip with several components less ``|u| / 2``: it falls to 0 too where u has turned by 60 deg.
        """
        slips = self.slips(q, v)[:, self.parts]
        size = np.linalg.norm(slips, axis=1)
        if not self.direction.any():
            return np.asarray(REST - size)
        turned = 0.5 * size if len(self.parts) > 1 else 0.0
        return np.asarray(slips @ self.direction - turned + REST)


@dataclass(frozen=True, eq=False)
class Reserve:
    """How far the friction that holds a group of joints is from its bound.

    Attributes:
        sliding_at: Returns the friction between two instants.
        group: Number of the group.
    """

    sliding_at: Callable[[float, float], SlidingFriction]
    group: int

    def left(self, t: Array, q: Array, v: Array) -> Array:
        """Return ``bound^2 - phi^2`` with some slack, which is smooth where phi vanishes, shape (n,)."""
        sliding = self.sliding_at(float(t[0]), float(t[-1]))
        solutions = sliding.solutions(t, q, v)
        g, slack = self.group, NOTHING**2
        return np.array([each.bounds[g] ** 2 - each.held[g] ** 2 + slack for each in solutions])
