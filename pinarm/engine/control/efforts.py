"""The efforts of controllers as loads: during the integration, and afterwards as they have been."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.control.memory import ControlHistory, ControlMemory
from pinarm.engine.control.sampler import reference_after
from pinarm.mechanics.control.controller import Controller, Given
from pinarm.mechanics.forces.force_element import ForceElement, HeldLoad, power
from pinarm.mechanics.laws.motion_law import MotionLaw

Span = tuple[float, float]
"""Interval of time in which no law jumps [s]."""


def reference_of(laws: tuple[MotionLaw, ...], t: Array | float, span: Span | None) -> Array:
    """Return what laws say at instants, shape (..., s, 3): within a span by its smooth pieces, else after jumps."""
    instants = np.atleast_1d(np.asarray(t, float))
    if span is None:
        found = reference_after(laws, instants)
    else:
        found = np.empty((len(instants), len(laws), 3))
        for k, law in enumerate(laws):
            found[:, k] = np.array(law.on(*span)(instants)).T
    return found if np.ndim(t) else found[0]


class ControlLoad(ForceElement):
    """What both kinds of load share: efforts of drives, whose power is that of the controllers."""

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return minus the power of the efforts: controllers supply it."""
        return -power(self, t, q, v)


@dataclass(frozen=True, eq=False)
class PresentEfforts(ControlLoad):
    """The efforts during an integration, from what controllers remember.

    Attributes:
        memory: Their memory.
        span: Interval in which no reference jumps; ``None`` where it is not known.
    """

    memory: ControlMemory = field(repr=False)
    span: Span | None = None

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the efforts in force, and those of continuous controllers in each state."""
        tau += self.memory.load
        for number, controller in enumerate(self.memory.continuous):
            efforts = controller.limited(controller.command(self.given(number, t, q, v)))
            for k, joint in enumerate(controller.joints):
                tau[..., joint.v] += efforts[..., k]

    def given(self, number: int, t: Array | float, q: Array, v: Array) -> Given:
        """Return what a continuous controller knows in states, with the integrals last remembered."""
        memory, controller = self.memory, self.memory.continuous[number]
        integral = memory.integral[..., memory.integrals[number]]
        reference = reference_of(controller.references, t, self.span)
        return Given(t, q, v, controller.measure(q, v), reference, integral, memory.modes[number])

    def integral_rates(self, t: float, q: Array, v: Array) -> Array:
        """Return the rates of all integrals in one state, shape (m,)."""
        numbers = range(len(self.memory.continuous))
        return np.concatenate([self.memory.continuous[k].rates(self.given(k, t, q, v)) for k in numbers])

    def laws(self) -> list[MotionLaw]:
        """Return the references of continuous controllers."""
        return [law for controller in self.memory.continuous for law in controller.references]

    def on(self, start: float, end: float) -> PresentEfforts:
        """Return the efforts with the references as they are on an interval."""
        return replace(self, span=(start, end))

    @property
    def held(self) -> HeldLoad | None:
        """The memory, where all controllers are sampled."""
        return None if self.memory.continuous else self.memory


@dataclass(frozen=True, eq=False)
class RecordedEfforts(ControlLoad):
    """The efforts of a run that is over.

    Attributes:
        sampled: The sampled controllers.
        continuous: The others.
        history: What has changed, and when.
        integral: Integrals at instants [s], shape (n,), as an array of shape (n, m).
        places: Integrals of every continuous controller.
        span: Interval whose side of a change counts; ``None`` for what holds after it.
    """

    sampled: tuple[Controller, ...]
    continuous: tuple[Controller, ...]
    history: ControlHistory = field(repr=False)
    integral: Callable[[Array], Array] = field(repr=False)
    places: list[slice] = field(repr=False)
    span: Span | None = None

    def pieces(self, t: Array) -> Indices:
        """Return the changes in force at instants, shape (n,); those that differ by rounding are the same."""
        t = t + self.history.slack
        if self.span and self.span[0] < self.span[1]:
            t = np.minimum(t, np.nextafter(self.span[1], -np.inf))
        return np.maximum(np.searchsorted(self.history.times, t, side="right") - 1, 0)

    def values(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return commands and efforts of all drives, the sampled ones first, shape (n, k) each."""
        pieces = self.pieces(t)
        commands, efforts = [self.history.commands[pieces]], [self.history.loads[pieces][:, self._sampled_joints]]
        integral = self.integral(t) if self.places and self.places[-1].stop else np.zeros((len(t), 0))
        for number, controller in enumerate(self.continuous):
            given = self.given(
                controller, t, q, v, integral[:, self.places[number]], self.history.modes[pieces, number]
            )
            commands.append(controller.command(given))
            efforts.append(controller.limited(commands[-1]))
        return np.concatenate(commands, axis=1), np.concatenate(efforts, axis=1)

    def given(self, one: Controller, t: Array, q: Array, v: Array, integral: Array, mode: Array | int) -> Given:
        """Return what a controller knows in states, or would if it measured."""
        return Given(t, q, v, one.measure(q, v), reference_of(one.references, t, self.span), integral, mode)

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the efforts."""
        rows = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        efforts = self.values(np.broadcast_to(np.asarray(t, float), len(rows[0])), *rows)[1]
        tau[..., self.joints] += efforts.reshape(*q.shape[:-1], -1)

    @cached_property
    def _sampled_joints(self) -> Indices:
        return np.array([joint.v for one in self.sampled for joint in one.joints], dtype=np.intp)

    @cached_property
    def joints(self) -> Indices:
        """Indices in v of all drives, the sampled ones first, shape (k,)."""
        return np.array([joint.v for one in (*self.sampled, *self.continuous) for joint in one.joints], dtype=np.intp)

    def on(self, start: float, end: float) -> RecordedEfforts:
        """Return the efforts as they are on an interval, whose end is before a change there."""
        return replace(self, span=(start, end))

    def laws(self) -> list[MotionLaw]:
        """Return the references of continuous controllers."""
        return [law for one in self.continuous for law in one.references]

    @property
    def held(self) -> HeldLoad | None:
        """The efforts themselves, where all controllers are sampled."""
        return None if self.continuous else self

    @property
    def present(self) -> Array:
        """The load at the end; see ``HeldLoad``."""
        return np.asarray(self.history.loads[-1])

    def piece(self, t: float) -> int:
        """Return the number of the change at t, or the last one before; see ``HeldLoad``."""
        return max(bisect_right(self._instants, t) - 1, 0)

    @cached_property
    def _instants(self) -> list[float]:
        return [float(t) for t in self.history.times]

    def load_of(self, pieces: Indices) -> Array:
        """Return the loads that changes have brought about; see ``HeldLoad``."""
        return np.asarray(self.history.loads[pieces])
