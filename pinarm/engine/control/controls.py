"""The controllers of a forward run, as the integration of the motion uses them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.control.controlled_system import CONTROL, ControlledSystem
from pinarm.engine.control.efforts import PresentEfforts, RecordedEfforts, Span
from pinarm.engine.control.memory import ControlMemory
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.events import Watch
from pinarm.engine.integration.integrator import Acceleration, Interval
from pinarm.mechanics.control.controller import Controller, Given
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.limited_states import Switch
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.systems import System


@dataclass(frozen=True, eq=False)
class Controls:
    """The controllers of a run.

    Attributes:
        controllers: The controllers.
        free: The equation of motion without them.
    """

    controllers: tuple[Controller, ...]
    free: Dynamics
    _switches: list[tuple[int, int | None]] = field(default_factory=list, repr=False)

    @cached_property
    def memory(self) -> ControlMemory:
        """What they remember."""
        sampled = [one for one in self.controllers if one.sampling]
        continuous = [one for one in self.controllers if not one.sampling]
        supplying = frozenset(number for number, one in enumerate(sampled) if one.supply)
        return ControlMemory(sampled, continuous, self.free.model.nv, supplying)

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equation of motion with the efforts that are remembered."""
        return with_control(self.free, PresentEfforts(self.memory))

    @property
    def advice(self) -> str:
        """What to try with the controllers where the motion grows without bound."""
        return " or ".join(_advice(one) for one in self.controllers)

    @property
    def continuous(self) -> bool:
        """Whether a controller acts at every instant."""
        return bool(self.memory.continuous)

    @property
    def sampled_references(self) -> list[MotionLaw]:
        """What sampled controllers follow."""
        return [law for one in self.memory.sampled for law in one.references]

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """Indices in v of the joints that are driven, the sampled ones first, as ``RecordedEfforts`` has them."""
        ordered = (*self.memory.sampled, *self.memory.continuous)
        return tuple(joint.v for one in ordered for joint in one.joints)

    def begin(self, start: float, end: float) -> None:
        """Begin a run; nothing is remembered of another one."""
        for controller in (*self.memory.sampled, *self.memory.continuous):
            controller.begin()
        self.memory.begin(start, end)

    def enter(self, t: float, q: Array, v: Array) -> None:
        """Let sampled controllers do what is due, and settle what continuous ones do, in a state of the mechanism."""
        memory = self.memory
        first = len(memory.times) <= 1  # before samples at the start are noted
        if memory.due(t):
            memory.act(t, q, v)
        if memory.continuous:
            load = self.dynamics.forces[CONTROL]
            assert isinstance(load, PresentEfforts)
            for number, controller in enumerate(memory.continuous):
                before = None if first else memory.modes[number]
                memory.modes[number] = controller.mode(load.given(number, t, q, v), before)
            memory.note(t)

    def around(self, system: System) -> System:
        """Return what is integrated: a system, with the integrals of controllers where there are any."""
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
        return replace(interval, acceleration_of_step=of_step, batch=None, sampling=sampling)

    def watches(self, span: Span) -> list[tuple[int, Watch]]:
        """Return where continuous controllers change their way in a span without jumps, each with its number."""
        load = PresentEfforts(self.memory, span)
        found: list[Watch] = []
        self._switches.clear()
        for number, controller in enumerate(self.memory.continuous):
            for switch in controller.switches(self.memory.modes[number]):
                self._switches.append((number, switch.mode))
                found.append(_watch(load, number, switch))
        return list(enumerate(found))

    def switch(self, index: int) -> None:
        """Note that a controller has changed its way, by the number of the last watches."""
        number, mode = self._switches[index]
        if mode is not None:
            self.memory.modes[number] = mode

    def remember(self, integral: Array) -> None:
        """Set the integrals of the present state, shape (m,)."""
        self.memory.integral = integral

    def recorded(self, integral: Callable[[Array], Array]) -> RecordedEfforts:
        """Return the efforts of the run as they have been.

        Args:
            integral: Integrals at instants [s], shape (n,), as an array of shape (n, m).
        """
        memory = self.memory
        return RecordedEfforts(memory.sampled, memory.continuous, memory.history(), integral, memory.integrals)


@dataclass(frozen=True, eq=False)
class _SampledStates:
    """Gives sampled controllers the states of the mechanism at their samples."""

    memory: ControlMemory
    system: System

    def act(self, t: float, q: Array, v: Array) -> None:
        """Let them act; see ``SampleTimes``."""
        if self.memory.due(t):
            (at,), (moving,) = self.system.whole(np.array([t]), q[None], v[None])
            self.memory.act(t, at, moving)

    def next(self, t: float) -> float:
        """Return the first instant after t [s]."""
        return self.memory.next(t)


def _watch(load: PresentEfforts, number: int, switch: Switch[Given]) -> Watch:
    """Return where the way of a controller changes; what a sample may change at once falls through 0."""
    if not switch.jumps:
        one = load.memory.continuous[number]
        what, measured = (f"the controller of {', '.join(one.drives)} switches", str(one.signals[0].unit)) if (
            switch.leaps) else ("", "")  # fmt: skip
        return Watch(lambda t, q, v: switch.value(load.given(number, t, q, v)), switch.direction, stops=True, what=what,
                     unit=measured)  # fmt: skip
    sign = -switch.direction
    return Watch(lambda t, q, v: sign * switch.value(load.given(number, t, q, v)), -1, stops=True, loaded=True)


def with_control(dynamics: Dynamics, efforts: PresentEfforts | RecordedEfforts) -> Dynamics:
    """Return an equation of motion with the efforts of controllers in place of those it has."""
    return Dynamics.of(dynamics.model, {**dynamics.forces, CONTROL: efforts})


def _advice(controller: Controller) -> str:
    gains = {name: getattr(controller, name, None) for name in ("kp", "ki", "kd", "gains")}
    written = {
        name: " ".join(f"{x:.4g}" for x in np.ravel(value)) for name, value in gains.items() if value is not None
    }
    shown = ", ".join(f"{name} {text}" for name, text in written.items())
    sampling = controller.sampling
    period = f", or a period shorter than {sampling.period:g} s" if sampling else ""
    return f"smaller gains of the controller of {', '.join(controller.drives)}{shown and f' ({shown} in SI)'}{period}"
