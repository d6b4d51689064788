"""Pinocchio's calls on many states at once, by several threads where these pay."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from msgspec import Struct, field

from pinarm.arrays import Array
from pinarm.engine.dynamics.mass_matrix import Masses, masses, shared_mass_matrices
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.pinocchio_data import WIDE, new_data
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.link_placements import LinkPlacements

FEW, MANY = 2**8, 2**15
"""Numbers in v of all states: up to which a call is over before threads gain anything, and from which on it takes so
long, 5 ms, that they gain more than they ever wait for one another. In between the calls themselves tell."""

RARELY = 32
"""Number of calls after which the number of threads that was slower is tried again; more where it was much slower."""


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_forked = False
"""Whether this process is a fork of one that had loaded Pinocchio: it lacks the threads that OpenMP still counts on."""


def _note_fork() -> None:
    global _forked
    _forked = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)


def threads() -> int:
    """Return how many threads a call may use: all cores, or what ``OMP_NUM_THREADS`` allows; one after a fork."""
    if _forked:
        return 1
    allowed = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    return min(cores(), max(1, int(allowed))) if allowed.isdecimal() else cores()


class ThreadTiming(Struct):
    """How fast calls of like size are with one thread and with several.

    That depends on who else needs the cores: calls of 256 pandas take 0.20 to 0.28 ms with two threads instead of 0.40,
    according to how these wait, and 0.4 to 5 where another program has the second core.

    Attributes:
        spent: Time for a number in v [s], of late, by the number of threads.
        left: Number of calls until the slower number of threads is tried again.
    """

    spent: dict[int, float] = field(default_factory=dict)
    left: int = RARELY

    def choice(self, most: int) -> int:
        """Return the number of threads for the next call: 1, or ``most``."""
        if len(self.spent) < 2:
            return 1 if most in self.spent else most
        fast, slow = sorted((most, 1), key=self.spent.__getitem__)
        self.left -= 1
        if self.left > 0:
            return fast
        self.left = int(RARELY * self.spent[slow] / self.spent[fast])
        return slow

    def note(self, number: int, spent: float) -> None:
        """Note the time for a number in v [s]; a faster call counts at once, one that was held up a little."""
        known = self.spent.get(number, spent)
        self.spent[number] = min(spent, 0.5 * (known + min(spent, 2.0 * known)))


class Parallel(Record, frozen=True):
    """Inverse and forward dynamics of one tree, without loads.

    Attributes:
        model: Pinocchio's model.
    """

    model: pin.Model

    def rnea(self, q: Array, v: Array, a: Array) -> Array:
        """Return efforts, shape (n, nv), at configurations, shape (n, nq), with velocities and accelerations."""
        return self._rows(pin.rneaInParallel, pin.rnea, q, v, a)

    def aba(self, q: Array, v: Array, tau: Array) -> Array:
        """Return accelerations, shape (n, nv), at configurations, shape (n, nq), with velocities and efforts."""
        return self._rows(pin.abaInParallel, pin.aba, q, v, tau)

    def transmitted(self, links: LinkPlacements, q: Array, v: Array, a: Array, acting: Array) -> Array:
        """Return the wrench of the parent on the child at every joint's origin, world axes, shape (n, njoints, 6).

        Args:
            links: Where the links are.
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            a: Accelerations, shape (n, nv).
            acting: Wrenches [f; m] on the links about the world's origin, world axes, shape (n, njoints, 6).
        """
        outside = links.inwards(acting)
        model, data, inner = self.model, new_data(self.model), np.empty_like(outside)
        forces, loaded = pin.StdVec_Force(), np.flatnonzero(outside.any(axis=(0, 2))).tolist()
        forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
        given, found = [forces[joint] for joint in loaded], [data.f[joint] for joint in range(model.njoints)]
        for k, loads in enumerate(outside[:, loaded]):
            for force, load in zip(given, loads, strict=True):
                force.vector = load
            pin.rnea(model, data, q[k], v[k], a[k], forces)
            inner[k] = [wrench.vector for wrench in found]
        inner[:, 0] = 0.0  # of the world, not of a joint
        return links.outwards(inner)

    def mass_matrices(self, q: Array) -> Array:
        """Return M at configurations, shape (n, nq), as an array of shape (n, nv, nv); armatures are in it."""
        return shared_mass_matrices(self.model, q)

    def masses(self, q: Array) -> Masses:
        """Return M at configurations, shape (n, nq): as ``mass_matrices``, or of many joints its products."""
        return masses(self.model, q)

    def _rows(self, call: Callable[..., Array], single: Callable[..., Array], q: Array, *others: Array) -> Array:
        nv, size = self.model.nv, len(q) * self.model.nv
        if nv > WIDE:
            return np.array([single(self.model, self._data, *each) for each in zip(q, *others, strict=True)])
        most = threads() if size > FEW else 1
        pace = self._paces[call, size.bit_length()]
        number = pace.choice(most) if size < MANY else most
        pool = self.one if number == 1 else _several(self.model)
        start = perf_counter()
        found = call(number, pool, q.T, *(x.T for x in others))
        pace.note(number, (perf_counter() - start) / max(size, 1))
        return found.reshape(nv, len(q)).T

    @cached_property
    def _data(self) -> pin.Data:
        return new_data(self.model)

    @cached_property
    def _paces(self) -> defaultdict[tuple[Callable[..., Array], int], ThreadTiming]:
        return defaultdict(ThreadTiming)

    @property
    def one(self) -> pin.ModelPool:
        """Buffers of one thread."""
        return _one(self.model)


@cached_by_model
def _one(model: pin.Model) -> pin.ModelPool:
    return pin.ModelPool(model, 1)


@cached_by_model
def _several(model: pin.Model) -> pin.ModelPool:
    return pin.ModelPool(model, cores())
