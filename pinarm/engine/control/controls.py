"""Controllers of a forward run: their efforts as loads, now and as they have been, and their integrals as states.

Integrals follow the velocities, ``[v, x]``: the integrator sees ``q' = velocity(q, v)``, ``v' = a(t, q, v, x)`` and
``x' = rates(t, q, v, x)``, so that they have the same error control as the motion.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.control.memory import ControlHistory, ControlMemory, reference_after
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.integrator import Acceleration, Interval, Manifold, Watch
from pinarm.mechanics.control.controller import Controller, Given
from pinarm.mechanics.forces.force_element import ForceElement, HeldLoad, power
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.limited_states import Switch
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure
    from pinarm.engine.motion.systems import CompletedStates, System
    from pinarm.mechanics.laws.motion_law import Grid

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
        return [law for controller in self.memory.continuous for law in controller.references]

    def on(self, start: float, end: float) -> PresentEfforts:
        return replace(self, span=(start, end))

    @property
    def held(self) -> HeldLoad | None:
        return None if self.memory.continuous else self.memory


@dataclass(frozen=True, eq=False)
class RecordedEfforts(_ControlLoad):
    """The efforts of a run that is over.

    Attributes:
        integral: Integrals at instants [s], shape (n,), as an array of shape (n, m).
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
        rows = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        parts = self.parts(np.broadcast_to(np.asarray(t, float), len(rows[0])), *rows)
        for controller, part in zip(self.controllers, parts, strict=True):
            for k, joint in enumerate(controller.joints if "effort" in part else ()):
                tau[..., joint.v] += part["effort"][:, k].reshape(q.shape[:-1])

    def on(self, start: float, end: float) -> RecordedEfforts:
        """Return the efforts as they are on an interval, whose end is before a change there."""
        return replace(self, span=(start, end))

    def laws(self) -> list[MotionLaw]:
        return [law for controller in self.continuous for law in controller.references]

    @property
    def jumps(self) -> bool:
        """Whether efforts may jump: at samples, where relays switch, and where references do."""
        return True

    @property
    def held(self) -> HeldLoad | None:
        return None if self.continuous else self

    @property
    def present(self) -> Array:
        return np.asarray(self.history.loads[-1])

    def piece(self, t: float) -> int:
        """Return the number of the change at t, or the last one before; see ``HeldLoad``."""
        return max(bisect_right(self._instants, t) - 1, 0)

    @cached_property
    def _instants(self) -> list[float]:
        return [float(t) for t in self.history.times]

    def load_of(self, pieces: Indices) -> Array:
        return np.asarray(self.history.loads[pieces])


CONTROL = "control"
"""Name of the force element of controllers in dynamics of runs; no force has it: ``problems.control``."""


def with_control(dynamics: Dynamics, efforts: PresentEfforts | RecordedEfforts) -> Dynamics:
    """Return an equation of motion with the efforts of controllers in place of those it has."""
    return Dynamics.of(dynamics.model, {**dynamics.forces, CONTROL: efforts})


@dataclass(frozen=True, eq=False)
class Controls:
    """The controllers of a run, and the equation of motion without them."""

    controllers: tuple[Controller, ...]
    free: Dynamics
    _switches: list[tuple[int, int | None]] = field(default_factory=list, repr=False)

    @cached_property
    def memory(self) -> ControlMemory:
        sampled = [controller for controller in self.controllers if controller.sampling]
        continuous = [controller for controller in self.controllers if not controller.sampling]
        return ControlMemory(sampled, continuous, self.free.model.nv)

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equation of motion with the efforts in the memory."""
        return with_control(self.free, PresentEfforts(self.memory))

    @property
    def advice(self) -> str:
        drives = ", ".join(drive for controller in self.controllers for drive in controller.drives)
        return f"smaller gains of the controllers of {drives}" + ", or shorter periods" * bool(self.memory.sampled)

    @property
    def continuous(self) -> bool:
        return bool(self.memory.continuous)

    @cached_property
    def joints(self) -> tuple[int, ...]:
        ordered = (*self.memory.sampled, *self.memory.continuous)
        return tuple(joint.v for controller in ordered for joint in controller.joints)

    def begin(self, start: float, end: float) -> None:
        for controller in (*self.memory.sampled, *self.memory.continuous):
            controller.begin()
        self.memory.begin(start, end)

    def enter(self, t: float, q: Array, v: Array) -> None:
        """Let sampled controllers do what is due, and settle the modes of continuous ones, in a state."""
        memory, load = self.memory, PresentEfforts(self.memory)
        first = len(memory.times) <= 1  # before samples at the start are noted
        if memory.due(t):
            memory.act(t, q, v)
        for number, controller in enumerate(memory.continuous):
            before = None if first else memory.modes[number]
            memory.modes[number] = controller.mode(load.given(number, t, q, v), before)
        if memory.continuous:
            memory.note(t)

    def around(self, system: System) -> System:
        return ControlledSystem(system, self.memory) if len(self.memory.integral) else system

    def interval(self, interval: Interval, system: System) -> Interval:
        """Return an interval of a system with the instants of the samples, and with efforts that belong to steps."""
        memory = self.memory

        def of_step(t: float) -> Acceleration:
            piece, inner = memory.piece(t), interval.of_step(t)

            def acceleration(instant: float, q: Array, v: Array) -> Array:
                with memory.as_of(piece):
                    return inner(instant, q, v)

            return acceleration

        sampling = SampledStates(memory, system) if memory.sampled else None
        return replace(interval, acceleration_of_step=of_step, sampling=sampling)

    def watches(self, span: Span) -> list[tuple[int, Watch]]:
        """Return where continuous controllers change their way in a span without jumps, each with its number."""
        load, watches = PresentEfforts(self.memory, span), list[Watch]()
        self._switches.clear()
        for number, controller in enumerate(self.memory.continuous):
            for switch in controller.switches(self.memory.modes[number]):
                self._switches.append((number, switch.mode))
                watches.append(_watch(load, number, switch))
        return list(enumerate(watches))

    def switch(self, index: int) -> None:
        """Note that a controller has changed its way, by the number of the last watches."""
        number, mode = self._switches[index]
        if mode is not None:
            self.memory.modes[number] = mode

    def recorded(self, integral: Callable[[Array], Array]) -> RecordedEfforts:
        """Return the efforts of the run as they have been."""
        memory = self.memory
        return RecordedEfforts(memory.sampled, memory.continuous, memory.history(), integral, memory.integrals)


@dataclass(frozen=True, eq=False)
class SampledStates:
    """Gives sampled controllers the states of the mechanism at their samples; no step goes past one of them."""

    memory: ControlMemory
    system: System

    def act(self, t: float, q: Array, v: Array) -> None:
        if self.memory.due(t):
            (at,), (moving,) = self.system.whole(np.array([t]), q[None], v[None])
            self.memory.act(t, at, moving)

    def next(self, t: float) -> float:
        return self.memory.next(t)


def _watch(load: PresentEfforts, number: int, switch: Switch[Given]) -> Watch:
    """Return where the way of a controller changes; what a sample may change at once falls through 0."""
    if not switch.jumps:
        controller = load.memory.continuous[number]
        what, measured = (
            (f"the controller of {', '.join(controller.drives)} switches", str(controller.signals[0].unit))
            if switch.leaps
            else ("", "")
        )
        return Watch(lambda t, q, v: switch.value(load.given(number, t, q, v)), switch.direction, stops=True, what=what,
                     unit=measured)  # fmt: skip
    sign = -switch.direction
    return Watch(lambda t, q, v: sign * switch.value(load.given(number, t, q, v)), -1, stops=True, loaded=True)


@dataclass(frozen=True, eq=False)
class ControlledSystem:
    """A system with the integrals of continuous controllers, which it keeps in the memory that loads read."""

    inner: System
    memory: ControlMemory

    @property
    def manifold(self) -> Manifold:
        inner, count = self.inner.manifold, self.memory.integrals[-1].stop
        return Manifold(inner.nq, inner.nv + count, lambda q, v: inner.velocity(q, v[..., : inner.nv]), inner.project)

    @property
    def closure(self) -> Closure:
        return self.inner.closure

    def with_integrals(self, q: Array, v: Array) -> tuple[Array, Array]:
        integral = np.broadcast_to(self.memory.integral, (*v.shape[:-1], self.memory.integral.shape[-1]))
        return q, np.concatenate([v, integral], axis=-1)

    def integrals(self, v: Array) -> Array:
        return v[..., self.inner.manifold.nv :]

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        bound, inner, nv = dynamics.on(start, end), self.inner.interval(dynamics, start, end), self.inner.manifold.nv
        efforts, settle = bound.forces[CONTROL], inner.settle
        assert isinstance(efforts, PresentEfforts)

        def settled(t: float, q: Array, v: Array) -> tuple[Array, Array]:
            assert settle is not None
            closed, rates = settle(t, q, v[:nv])
            return closed, np.concatenate([rates, v[nv:]])

        of_step = (lambda t: self._acceleration(inner.of_step(t), efforts)) if inner.acceleration_of_step else None
        return replace(
            inner,
            acceleration=self._acceleration(inner.acceleration, efforts),
            acceleration_of_step=of_step,
            settle=settled if settle else None,
            compiled=None,
        )

    def _acceleration(self, inner: Acceleration, efforts: PresentEfforts) -> Acceleration:
        nv = self.inner.manifold.nv

        def acceleration(t: float, q: Array, v: Array) -> Array:
            self.memory.integral = v[nv:].copy()
            (at,), (moving,) = self.inner.whole(np.array([t]), q[None], v[None, :nv])
            return np.concatenate([inner(t, q, v[:nv]), efforts.integral_rates(t, at, moving)])

        return acceleration

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        self.memory.integral, self.memory.instants = self.integrals(v).copy(), t
        return self.inner.whole(t, q, v[..., : self.inner.manifold.nv])

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        return self.inner.complete(dynamics, grid, q, v[:, : self.inner.manifold.nv])
