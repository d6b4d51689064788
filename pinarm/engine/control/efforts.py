"""Efforts of controllers as loads: during the integration, and afterwards as they have been."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.control.memory import ControlHistory, ControlMemory, reference_after
from pinarm.mechanics.control.controller import Controller, Given
from pinarm.mechanics.forces.force_element import ForceElement, HeldLoad, power
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.records import replace

Span = tuple[float, float]
"""Interval of time in which no law jumps [s]."""


def reference_of(laws: tuple[MotionLaw, ...], t: Array | float, span: Span | None) -> Array:
    """Return values of laws at instants, shape (..., s, 3): within a span by its smooth pieces, else after jumps."""
    instants = np.atleast_1d(np.asarray(t, float))
    if span is None:
        reference = reference_after(laws, instants)
    else:
        reference = np.empty((len(instants), len(laws), 3))
        for k, law in enumerate(laws):
            reference[:, k] = np.array(law.on(*span)(instants)).T
    return reference if np.ndim(t) else reference[0]


class _ControlLoad(ForceElement):
    """Efforts of drives, whose power is that of the controllers."""

    def potential_energy(self, q: Array) -> Array:
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return minus the power of the efforts: controllers supply it."""
        return -power(self, t, q, v)


@dataclass(frozen=True, eq=False)
class PresentEfforts(_ControlLoad):
    """The efforts during an integration, from the memory of the controllers.

    ``span`` is the interval in which no reference jumps; ``None`` where it is not known.
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
        """Return the input of a continuous controller in states, with the integrals last remembered."""
        memory, controller = self.memory, self.memory.continuous[number]
        integral = memory.integral[..., memory.integrals[number]]
        if integral.ndim > q.ndim:  # one of the states that were completed together
            integral = integral[np.abs(memory.instants - t).argmin()]
        reference = reference_of(controller.references, t, self.span)
        measured, mode = controller.measure(q, v), memory.modes[number]
        return Given(t, q, v, measured, reference, integral, mode, memory.applied)

    def integral_rates(self, t: float, q: Array, v: Array) -> Array:
        """Return the rates of all integrals in one state, shape (m,)."""
        every = enumerate(self.memory.continuous)
        return np.concatenate([controller.rates(self.given(k, t, q, v)) for k, controller in every])

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
class RecordedEfforts(_ControlLoad):
    """The efforts of a run that is over.

    Attributes:
        sampled: The sampled controllers.
        continuous: The others.
        history: Changes and their instants.
        integral: Integrals at instants [s], shape (n,), as an array of shape (n, m).
        places: Integrals of every continuous controller.
        span: Interval whose side of a change counts; ``None`` for the side after it.
    """

    sampled: tuple[Controller, ...]
    continuous: tuple[Controller, ...]
    history: ControlHistory = field(repr=False)
    integral: Callable[[Array], Array] = field(repr=False)
    places: list[slice] = field(repr=False)
    span: Span | None = None

    @property
    def controllers(self) -> tuple[Controller, ...]:
        """All controllers, the sampled ones first."""
        return (*self.sampled, *self.continuous)

    def _pieces(self, t: Array) -> Indices:
        """Return the changes in force at instants, shape (n,); those that differ by rounding are the same."""
        t = t + self.history.slack
        if self.span and self.span[0] < self.span[1]:
            t = np.minimum(t, np.nextafter(self.span[1], -np.inf))
        return np.maximum(np.searchsorted(self.history.times, t, side="right") - 1, 0)

    def parts(self, t: Array, q: Array, v: Array) -> list[dict[str, Array]]:
        """Return columns of every controller at n states, the sampled ones first, shape (n, k) each.

        ``command``, before limits; ``effort`` at the joints; of motors see ``Actuator.parts``.
        """
        pieces, columns, place = self._pieces(t), list[dict[str, Array]](), 0
        for controller in self.sampled:
            mine = slice(place, place + len(controller.joints))
            place = mine.stop
            in_force = {} if controller.supply else {"effort": self.history.applied[pieces, mine]}
            columns.append({"command": self.history.commands[pieces, mine], **in_force})
        integral = self.integral(t) if self.places and self.places[-1].stop else np.zeros((len(t), 0))
        for number, controller in enumerate(self.continuous):
            reference, mode = reference_of(controller.references, t, self.span), self.history.modes[pieces, number]
            own, applied = integral[:, self.places[number]], self.history.applied[pieces]
            columns.append(controller.parts(Given(t, q, v, controller.measure(q, v), reference, own, mode, applied)))
        return columns

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the efforts."""
        rows = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        parts = self.parts(np.broadcast_to(np.asarray(t, float), len(rows[0])), *rows)
        for controller, part in zip(self.controllers, parts, strict=True):
            for k, joint in enumerate(controller.joints if "effort" in part else ()):
                tau[..., joint.v] += part["effort"][:, k].reshape(q.shape[:-1])

    def on(self, start: float, end: float) -> RecordedEfforts:
        """Return the efforts as they are on an interval, whose end is before a change there."""
        return replace(self, span=(start, end))

    def laws(self) -> list[MotionLaw]:
        """Return the references of continuous controllers."""
        return [law for controller in self.continuous for law in controller.references]

    @property
    def jumps(self) -> bool:
        """Whether efforts may jump: at samples, where relays switch, and where references do."""
        return True

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
        """Return the loads after changes; see ``HeldLoad``."""
        return np.asarray(self.history.loads[pieces])
