"""Slips with several components: friction is against their direction, and its limit is that of its length.

A joint that turns and slides, or turns about a point, has one contact for each component of its slip, all with one
name, one law and one bearing. Of a joint with one component the direction is 1 or -1.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.mechanics.friction.contact import FrictionContact


def same_joint(contacts: Sequence[FrictionContact]) -> Flags:
    """Return which contacts are components of one slip, shape (k, k)."""
    return _same_names(tuple(contact.name for contact in contacts))[0]


def several(contacts: Sequence[FrictionContact]) -> Flags:
    """Return which contacts are components of a slip with several, shape (k,)."""
    return _same_names(tuple(contact.name for contact in contacts))[1]


@lru_cache(maxsize=16)  # asked at every evaluation of an equation of motion
def _same_names(names: tuple[str, ...]) -> tuple[Flags, Flags]:
    same = np.array([[name == other for other in names] for name in names], dtype=bool).reshape(len(names), len(names))
    return same, same.sum(axis=1) > 1


def sizes(contacts: Sequence[FrictionContact], x: Array) -> Array:
    """Return the length of the slip that each component, shape (.., k), is of, shape (.., k)."""
    if not several(contacts).any():
        return np.abs(x)
    return np.asarray(np.sqrt(x**2 @ same_joint(contacts).astype(float)))


def unit_vectors(contacts: Sequence[FrictionContact], x: Array) -> Array:
    """Return ``x / |x|`` joint by joint, 0 where x is, of the shape of x, (.., k)."""
    if not several(contacts).any():
        return np.sign(x)
    length = sizes(contacts, x)
    return np.divide(x, length, out=np.zeros_like(x), where=length > 0.0)
