"""Pinocchio's calls on many states at once, by several threads where these pay."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import pinocchio as pin

from pinarm.arrays import Array

MANY = 2**15
"""Numbers in q or v from which on a call takes so long, 5 ms, that threads gain more than they wait for one another."""

WIDE = 64
"""Coordinates up to which every thread gets buffers of its own: Pinocchio's take 65 nv^3 bytes."""


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads() -> int:
    """Return how many threads a call may use: all cores, or what ``OMP_NUM_THREADS`` allows."""
    allowed = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    return min(cores(), max(1, int(allowed))) if allowed.isdecimal() else cores()


@dataclass(frozen=True, eq=False)
class Parallel:
    """Inverse and forward dynamics of one tree, without loads.

    Attributes:
        model: Pinocchio's model.
    """

    model: pin.Model = field(repr=False)

    def rnea(self, q: Array, v: Array, a: Array) -> Array:
        """Return efforts, shape (n, nv), at configurations, shape (n, nq), with velocities and accelerations."""
        return self._rows(pin.rneaInParallel, q, v, a)

    def aba(self, q: Array, v: Array, tau: Array) -> Array:
        """Return accelerations, shape (n, nv), at configurations, shape (n, nq), with velocities and efforts."""
        return self._rows(pin.abaInParallel, q, v, tau)

    def _rows(self, call: Callable[..., Array], q: Array, *others: Array) -> Array:
        nv = self.model.nv
        number = threads() if len(q) * nv >= MANY and nv <= WIDE else 1
        pool = self.one if number == 1 else self._several
        return call(number, pool, q.T, *(x.T for x in others)).reshape(nv, len(q)).T

    @cached_property
    def one(self) -> pin.ModelPool:
        """Buffers of one thread."""
        return pin.ModelPool(self.model, 1)

    @cached_property
    def _several(self) -> pin.ModelPool:
        return pin.ModelPool(self.model, cores())
