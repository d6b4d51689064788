"""Controllers of a forward run: their part in the integration, with the integrals of continuous ones as states.

Integrals follow the velocities, ``[v, x]``: the integrator sees ``q' = velocity(q, v)``, ``v' = a(t, q, v, x)`` and
``x' = rates(t, q, v, x)``, so that they have the same error control as the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.control.efforts import PresentEfforts, RecordedEfforts, Span
from pinarm.engine.control.memory import ControlMemory
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.events import Watch
from pinarm.engine.integration.integrator import Acceleration, Interval, Manifold
from pinarm.mechanics.control.controller import Controller, Given
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.limited_states import Switch
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure
    from pinarm.engine.motion.systems import CompletedStates, System
    from pinarm.mechanics.laws.motion_law import Grid

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
        """Their memory."""
        sampled = [controller for controller in self.controllers if controller.sampling]
        continuous = [controller for controller in self.controllers if not controller.sampling]
        return ControlMemory(sampled, continuous, self.free.model.nv)

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equation of motion with the efforts in the memory."""
        return with_control(self.free, PresentEfforts(self.memory))

    @property
    def advice(self) -> str:
        """Changes of the controllers to try where the motion grows without bound."""
        return " or ".join(map(_advice, self.controllers))

    @property
    def continuous(self) -> bool:
        """Whether a controller acts at every instant."""
        return bool(self.memory.continuous)

    @property
    def sampled_references(self) -> list[MotionLaw]:
        """Laws that sampled controllers follow."""
        return [law for controller in self.memory.sampled for law in controller.references]

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """Indices in v of the joints that are driven, the sampled ones first, as ``RecordedEfforts`` has them."""
        ordered = (*self.memory.sampled, *self.memory.continuous)
        return tuple(joint.v for controller in ordered for joint in controller.joints)

    def begin(self, start: float, end: float) -> None:
        """Begin a run; nothing is remembered of another one."""
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
        """Return a system with the integrals of controllers, where there are any."""
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

        sampling = _SampledStates(memory, system) if memory.sampled else None
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
class _SampledStates:
    """Gives sampled controllers the states of the mechanism at their samples; see ``SampleTimes``."""

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


def _advice(controller: Controller) -> str:
    gains = {name: getattr(controller, name, None) for name in ("kp", "ki", "kd", "gains")}
    shown = ", ".join(
        f"{name} {' '.join(f'{x:.4g}' for x in np.ravel(value))}" for name, value in gains.items() if value is not None
    )
    sampling = controller.sampling
    period = f", or a period shorter than {sampling.period:g} s" if sampling else ""
    return f"smaller gains of the controller of {', '.join(controller.drives)}{shown and f' ({shown} in SI)'}{period}"


@dataclass(frozen=True)
class _WithIntegrals:
    """A configuration space with ``count`` integrals behind the velocities."""

    inner: Manifold
    count: int

    @property
    def nq(self) -> int:
        return self.inner.nq

    @property
    def nv(self) -> int:
        return self.inner.nv + self.count

    def velocity(self, q: Array, v: Array) -> Array:
        return self.inner.velocity(q, v[..., : self.inner.nv])

    def project(self, q: Array) -> Array:
        return self.inner.project(q)


@dataclass(frozen=True, eq=False)
class ControlledSystem:
    """A system with the integrals of continuous controllers, which it keeps in the memory that loads read."""

    inner: System
    memory: ControlMemory

    @property
    def manifold(self) -> Manifold:
        """Space of the integrated configurations."""
        return _WithIntegrals(self.inner.manifold, self.memory.integrals[-1].stop)

    @property
    def closure(self) -> Closure:
        """Constraints with multipliers."""
        return self.inner.closure

    def with_integrals(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return states with the integrals in the memory."""
        integral = np.broadcast_to(self.memory.integral, (*v.shape[:-1], self.memory.integral.shape[-1]))
        return q, np.concatenate([v, integral], axis=-1)

    def integrals(self, v: Array) -> Array:
        """Return the integrals in integrated states, shape (..., m)."""
        return v[..., self.inner.manifold.nv :]

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        """Return the motion on an interval without jumps."""
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
        """Return the mechanism's states; loads that are evaluated next have the integrals of these."""
        self.memory.integral, self.memory.instants = self.integrals(v).copy(), t
        return self.inner.whole(t, q, v[..., : self.inner.manifold.nv])

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the motion of the mechanism at the rows of a grid."""
        return self.inner.complete(dynamics, grid, q, v[:, : self.inner.manifold.nv])
