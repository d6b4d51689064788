"""What ends a stretch of a motion with friction: how far slips are from rest, and stuck joints from slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.friction.sliding import SlidingFriction
from pinarm.engine.friction.slip import Slip

REST = 1e-12
"""Slip that is rest, over the largest velocity in SI: rounding of a velocity that vanishes."""

INSTANT = 8.0 * float(np.finfo(float).eps)
"""What rounding leaves of an instant, over the largest one: slips are as fast as they become in that time."""

NOTHING = 1e-12
"""Path, over the size that errors are relative to: friction that moves a joint no farther in the whole run is nothing.
Where what holds a joint and its bound grow from 0 together, as in a gear without a load, they are compared from there
on."""

DISPLACED = 1e-14
"""Displacement, over the same size, that rounding leaves of configurations: so does the change of loads by it."""


def resting_speed(slip: Slip, velocities: Array) -> Array:
    """Return the slips [rad/s or m/s] up to which k joints are at rest at velocities, shape (.., nv), as (.., k)."""
    return np.asarray(slip.rest + REST * np.abs(velocities).max(axis=-1, initial=0.0)[..., None])


@dataclass(frozen=True, eq=False)
class Approach:
    """How far a slip is from rest, or one at rest from slip.

    Attributes:
        slips: Returns the slips [rad/s or m/s] of all k components in states, shape (n, k).
        parts: Numbers of the components of this one.
        slip: What joints do at first.
    """

    slips: Callable[[Array, Array], Array]
    parts: Indices
    slip: Slip

    def gap(self, t: Array, q: Array, v: Array) -> Array:
        """Return ``s u`` with some slack, so that a slip that begins does not end at once, shape (n,).

        Of a slip with several components less ``|u| / 2``: it falls to 0 too where u has turned by 60 deg.
        """
        slips = self.slips(q, v)[:, self.parts]
        size, slack = np.linalg.norm(slips, axis=1), resting_speed(self.slip, v)[:, self.parts].max(axis=1)
        direction = np.array(self.slip.direction)[self.parts]
        if not direction.any():
            return np.asarray(slack - size)
        turned = 0.5 * size if len(self.parts) > 1 else 0.0
        return np.asarray(slips @ direction - turned + slack)


@dataclass(frozen=True, eq=False)
class Reserve:
    """How far the friction that holds a group of joints is from its bound.

    Attributes:
        sliding_at: Returns the friction between two instants.
        group: Number of the group.
        slack: Friction of the group that rounding leaves [N*m or N].
    """

    sliding_at: Callable[[float, float], SlidingFriction]
    group: int
    slack: float

    def margin(self, t: Array, q: Array, v: Array) -> Array:
        """Return ``bound - |phi|`` [N*m or N], shape (n,)."""
        held, bounds = self.sliding_at(float(t[0]), float(t[-1])).reserves(self.group, t, q, v)
        return np.asarray(bounds - np.abs(held))

    def left(self, t: Array, q: Array, v: Array) -> Array:
        """Return ``bound^2 - phi^2`` with some slack, which is smooth where phi vanishes, shape (n,)."""
        held, bounds = self.sliding_at(float(t[0]), float(t[-1])).reserves(self.group, t, q, v)
        return np.asarray(bounds**2 - held**2 + self.slack**2)
