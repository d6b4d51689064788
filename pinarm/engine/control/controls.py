"""Controllers of a run: samples, commands in force, efforts as loads, and integrals as states.

Integrals follow the velocities, ``[v, x]``: the integrator sees ``q' = velocity(q, v)``, ``v' = a(t, q, v, x)`` and
``x' = rates(t, q, v, x)``, so that they have the same error control as the motion.
"""

from __future__ import annotations

import copy
from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.integrator import Acceleration, Interval, Manifold, Watch
from pinarm.errors import InputError, within
from pinarm.mechanics.control.controller import NOTHING, Controller, Given, Sampling
from pinarm.mechanics.control.motor_control import MotorController
from pinarm.mechanics.forces.force_element import ForceElement, HeldLoad
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.limited_states import Switch
from pinarm.records import AbstractRecord, Record, replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure
    from pinarm.engine.motion.systems import CompletedStates, System
    from pinarm.mechanics.laws.motion_law import Grid

SAME = 1e-9
"""Difference of instants, over the shortest period, below which they are the same instant."""

MOST = 5_000_000
"""Samples of a run beyond which nobody waits for it."""

APPLIED, MEASURED, APPLIED_AT_ONCE = 0, 1, 2
"""What a sampled controller does at an instant, in this order: a command of an earlier sample takes effect, a
measurement, a command without delay takes effect."""

Span = tuple[float, float]
"""Interval of time in which no law jumps [s]."""

CONTROL = "control"
"""Name of the force element of controllers in dynamics of runs; no force has it: ``problems.control``."""


def require_samples(controller: Controller, duration: float) -> None:
    """Raise where a controller samples too often in a duration [s], or its first command takes effect after it."""
    sampling = controller.sampling
    if sampling and duration > MOST * sampling.period:
        count = duration / sampling.period
        with within("period"):
            raise InputError(
                f"a period of {sampling.period:g} s makes {count:.3g} samples in {duration:g} s",
                expected=f"at most {MOST:.3g}",
            )
    if sampling and sampling.delay >= duration:
        with within("delay"):
            raise InputError(
                f"a delay of {sampling.delay:g} s: no command takes effect in {duration:g} s",
                expected="a delay shorter than the motion",
            )


def reference_of(laws: tuple[MotionLaw, ...], t: Array | float, span: Span | None = None, slack: float = 0.0) -> Array:
    """Return values, rates and accelerations of laws at instants, shape (..., s, 3).

    Within a span they are those of its smooth pieces, else those after jumps: a jump that is later by the slack [s] or
    less is at the instant itself.
    """
    instants = np.atleast_1d(np.asarray(t, float))
    reference = np.empty((len(instants), len(laws), 3))
    for k, law in enumerate(laws):
        if span is not None:
            reference[:, k] = np.array(law.on(*span)(instants)).T
            continue
        for piece in law.smooth_pieces:
            here = (instants >= piece.start - slack) & (instants < piece.end - slack)
            if here.any():
                reference[here, k] = np.array(piece.function(instants[here])).T
    return reference if np.ndim(t) else reference[0]


class Sampler:
    """A sampled controller from one sample to the next."""

    def __init__(self, controller: Controller, sampling: Sampling, start: float, end: float, slack: float) -> None:
        self.controller, self.sampling = controller, sampling
        self.velocities = np.array([joint.v for joint in controller.joints], np.intp)
        self.t = start + sampling.period * np.arange(float(int((end - start - slack) / sampling.period) + 1))
        self.reference = reference_of(controller.references, self.t, slack=slack)
        self.integral = np.zeros(controller.integrals)
        self.waiting = dict[int, Array]()
        self.mode: int | None = None
        self.last: Array | None = None

    def sample(self, number: int, t: float, q: Array, v: Array, excess: Array) -> Array:
        """Return the command of a sample by its number, before the limits [N*m or N], shape (k,).

        ``excess`` is the part of the commands in force that motors withhold; see ``Given``.
        """
        controller, sampling = self.controller, self.sampling
        measured = controller.measure(q, v)
        if sampling.resolution.any():
            step = np.where(sampling.resolution > 0.0, sampling.resolution, 1.0)
            rounded = np.round(measured[:, 0] / step) * step
            measured[:, 0] = np.where(sampling.resolution > 0.0, rounded, measured[:, 0])
        if sampling.rates == "difference":
            before = measured[:, 0].copy() if self.last is None else self.last
            self.last = measured[:, 0].copy()
            measured[:, 1] = (self.last - before) / sampling.period
        given = Given(t, q, v, measured, self.reference[number], self.integral, excess=excess)
        if controller.integrals:
            self.integral = controller.clamped(self.integral + sampling.period * controller.rates(given))
            given = given._replace(integral=self.integral)
        self.mode = controller.mode(given, self.mode)
        return controller.command(given if not self.mode else given._replace(mode=self.mode))


class Change(NamedTuple):
    """State of the controllers from an instant on; of n changes with a first axis.

    Attributes:
        t: The instant [s].
        load: Efforts of the sampled controllers in force, as generalised loads [N*m or N], shape (nv,).
        applied: Their commands in force, within the limits, shape (k,).
        commands: Their last commands, before the limits, shape (k,).
        modes: Of the continuous controllers, shape (c,).
    """

    t: float | Array
    load: Array
    applied: Array
    commands: Array
    modes: Indices


class Controls:
    """The controllers of a run, the equation of motion without them, and their state.

    As Pinocchio's buffers the state serves one integration at a time: ``begin`` clears it. Motors come after the
    controllers that command them.
    """

    def __init__(self, controllers: Sequence[Controller], free: Dynamics) -> None:
        self.controllers, self.free = tuple(controllers), free
        self.sampled = tuple(controller for controller in controllers if controller.sampling)
        self.continuous = tuple(controller for controller in controllers if not controller.sampling)
        self.places = _places([len(controller.joints) for controller in self.sampled])
        self.integrals = _places([controller.integrals for controller in self.continuous])
        self._switches: list[tuple[int, int | None]] = []
        self.clear(0.0, 0.0)

    def clear(self, start: float, end: float) -> None:
        timed = [(controller, controller.sampling) for controller in self.sampled if controller.sampling]
        self.slack = SAME * min((sampling.period for _, sampling in timed), default=0.0)
        self.samplers = [Sampler(controller, sampling, start, end, self.slack) for controller, sampling in timed]
        self.agenda: list[tuple[int, int, int, float]] = [(MEASURED, k, 0, start) for k in range(len(timed))]
        """What sampled controllers do next: what, number of the controller and of the sample, and when [s]."""
        none = np.zeros(sum(len(controller.joints) for controller in self.sampled))
        modes = np.zeros(len(self.continuous), np.intp)
        self.now = Change(start, np.zeros(self.free.model.nv), none, none, modes)
        self.times, self.changes = list[float](), list[Change]()
        self.integral = np.zeros(self.integrals[-1].stop if self.integrals else 0)
        """Integrals in the states that are evaluated, shape (..., m)."""
        self.instants = np.zeros(1)
        """Instants of these states where there are several [s], shape (n,)."""

    def begin(self, start: float, end: float) -> None:
        for controller in self.controllers:
            controller.begin()
        self.clear(start, end)
        self._note(start)

    def _note(self, t: float) -> None:
        self.now = self.now._replace(t=t)
        self.times.append(t)
        self.changes.append(self.now)

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equation of motion with the efforts in force."""
        return with_control(self.free, ControlEfforts(self))

    @property
    def advice(self) -> str:
        drives = ", ".join(drive for controller in (*self.sampled, *self.continuous) for drive in controller.drives)
        return f"smaller gains of the controllers of {drives}" + ", or shorter periods" * bool(self.sampled)

    @cached_property
    def joints(self) -> tuple[int, ...]:
        ordered = (*self.sampled, *self.continuous)
        return tuple(dict.fromkeys(joint.v for controller in ordered for joint in controller.joints))

    def next(self, t: float) -> float:
        """Return the first instant after t at which a sampled controller acts [s]; infinite for none."""
        return min((action[3] for action in self.agenda if action[3] > t + self.slack), default=np.inf)

    def due(self, t: float) -> bool:
        """Return whether a sampled controller has something to do at t [s]."""
        return any(action[3] <= t + self.slack for action in self.agenda)

    def act(self, t: float, q: Array, v: Array) -> None:
        """Let sampled controllers do what is due at t [s], in the state (q, v) of the mechanism."""
        load, applied, commands = (x.copy() for x in self.now[1:4])
        self.now = self.now._replace(load=load, applied=applied, commands=commands)
        while self.due(t):
            action = min(planned for planned in self.agenda if planned[3] <= t + self.slack)
            self.agenda.remove(action)
            what, number, sample, instant = action
            controller, place, sampler = self.sampled[number], self.places[number], self.samplers[number]
            if what == MEASURED:
                excess = ControlEfforts(self).excess(controller, t, q, v) if controller.supply else NOTHING
                commands[place] = sampler.waiting[sample] = sampler.sample(sample, t, q, v, excess)
                effect = APPLIED if sampler.sampling.delay > self.slack else APPLIED_AT_ONCE
                self.agenda.append((effect, number, sample, instant + sampler.sampling.delay))
                if sample + 1 < len(sampler.t):
                    self.agenda.append((MEASURED, number, sample + 1, float(sampler.t[sample + 1])))
                continue
            applied[place] = controller.limited(sampler.waiting.pop(sample))
            if not controller.supply:
                load[sampler.velocities] = applied[place]
        self._note(t)

    def enter(self, t: float, q: Array, v: Array) -> None:
        """Let sampled controllers do what is due, and settle the modes of continuous ones, in a state."""
        first = len(self.times) <= 1  # before samples at the start are noted
        if self.due(t):
            self.act(t, q, v)
        for number, controller in enumerate(self.continuous):
            before = None if first else int(self.now.modes[number])
            self._set_mode(number, controller.mode(ControlEfforts(self).given(number, t, q, v), before))
        if self.continuous:
            self._note(t)

    def _set_mode(self, number: int, mode: int) -> None:
        modes = self.now.modes.copy()
        modes[number] = mode
        self.now = self.now._replace(modes=modes)

    def around(self, system: System) -> System:
        return ControlledSystem(system, self) if len(self.integral) else system

    def interval(self, interval: Interval, system: System) -> Interval:
        """Return an interval of a system with the instants of the samples, and with efforts that belong to steps."""

        def of_step(t: float) -> Acceleration:
            piece, inner = self.piece(t), interval.of_step(t)

            def acceleration(instant: float, q: Array, v: Array) -> Array:
                now, self.now = self.now, self.changes[piece]
                try:
                    return inner(instant, q, v)
                finally:
                    self.now = now

            return acceleration

        sampling = SampledStates(self, system) if self.sampled else None
        return replace(interval, acceleration_of_step=of_step, sampling=sampling)

    def watches(self, span: Span) -> list[tuple[int, Watch]]:
        """Return where continuous controllers change their way in a span without jumps, each with its number."""
        efforts, watches = ControlEfforts(self, span), list[Watch]()
        self._switches.clear()
        for number, controller in enumerate(self.continuous):
            for switch in controller.switches(int(self.now.modes[number])):
                self._switches.append((number, switch.mode))
                watches.append(_watch(efforts, number, switch))
        return list(enumerate(watches))

    def switch(self, index: int) -> None:
        """Note that a controller has changed its way, by the number of the last watches."""
        number, mode = self._switches[index]
        if mode is not None:
            self._set_mode(number, mode)

    def recorded(self, integral: Callable[[Array], Array]) -> ControlEfforts:
        """Return the efforts of the run as they have been, by its integrals at instants, shape (n,) to (n, m)."""
        past = Change(*map(np.array, zip(*self.changes, strict=True)))
        return ControlEfforts(copy.copy(self), None, past, integral)

    @property
    def present(self) -> Array:
        """The load in force; see ``HeldLoad``."""
        return self.now.load

    def piece(self, t: float) -> int:
        return max(bisect_right(self.times, t) - 1, 0)

    def load_of(self, pieces: Indices) -> Array:
        """Return the loads after changes; see ``HeldLoad``."""
        return np.array([self.changes[piece].load for piece in pieces.tolist()]).reshape(len(pieces), -1)


class ControlEfforts(AbstractRecord, ForceElement, frozen=True):
    """The efforts of controllers, whose power they supply: those in force, or those of a run that is over.

    Attributes:
        span: Interval in which no reference jumps, and whose side of a change counts; ``None`` where it is not known,
            and the side after it counts.
        past: The changes of a run that is over.
        past_integral: Its integrals at instants [s], shape (n,), as an array of shape (n, m).
    """

    unshown = ("controls", "past", "past_integral")

    controls: Controls
    span: Span | None = None
    past: Change | None = None
    past_integral: Callable[[Array], Array] | None = None

    @property
    def controllers(self) -> tuple[Controller, ...]:
        """All controllers, the sampled ones first."""
        return (*self.controls.sampled, *self.controls.continuous)

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the efforts in force, and those of continuous controllers in each state."""
        if self.past is not None:
            t = np.broadcast_to(np.asarray(t, float), q.shape[:-1])
        tau += self.in_force(t).load
        for number, controller in enumerate(self.controls.continuous):
            if not controller.supply:
                efforts = controller.limited(controller.command(self.given(number, t, q, v)))
                for k, joint in enumerate(controller.joints):
                    tau[..., joint.v] += efforts[..., k]

    def in_force(self, t: Array | float) -> Change:
        """Return the changes in force at instants; those that differ by rounding are the same."""
        if self.past is None:
            return self.controls.now
        t = np.asarray(t, float) + self.controls.slack
        if self.span and self.span[0] < self.span[1]:
            t = np.minimum(t, np.nextafter(self.span[1], -np.inf))
        rows = np.maximum(np.searchsorted(self.past.t, t, side="right") - 1, 0)
        t, load, applied, commands, modes = self.past
        return Change(np.asarray(t)[rows], load[rows], applied[rows], commands[rows], modes[rows])

    def given(self, number: int, t: Array | float, q: Array, v: Array) -> Given:
        """Return the input of a continuous controller in states, with the integrals last remembered."""
        controller, given = self.controls.continuous[number], self._before_motors(number, t, q, v)
        if isinstance(controller, MotorController):
            return given._replace(commands=self._commands(controller.source, t, q, v))
        if controller.supply and controller.integrals:
            return given._replace(excess=self.excess(controller, t, q, v))
        return given

    def _before_motors(self, number: int, t: Array | float, q: Array, v: Array) -> Given:
        controller, integral = self.controls.continuous[number], self._integral(t, q)
        reference = reference_of(controller.references, t, self.span)
        mode, own = self.in_force(t).modes[..., number], integral[..., self.controls.integrals[number]]
        return Given(t, q, v, controller.measure(q, v), reference, own, mode)

    def _integral(self, t: Array | float, q: Array) -> Array:
        controls = self.controls
        if not controls.integral.shape[-1]:
            return np.zeros((*q.shape[:-1], 0))
        if self.past_integral is not None:
            return self.past_integral(np.atleast_1d(t)).reshape(*np.shape(t), -1)
        integral = controls.integral
        if integral.ndim > q.ndim:  # one of the states that were completed together
            return np.asarray(integral[np.abs(controls.instants - t).argmin()])
        return integral

    def _commands(self, source: Controller, t: Array | float, q: Array, v: Array) -> Array:
        """Return the commands of a controller of motors within its limits, shape (..., k)."""
        if source.sampling:
            return np.asarray(self.in_force(t).applied[..., self.controls.places[self.controls.sampled.index(source)]])
        number = self.controls.continuous.index(source)
        return source.limited(source.command(self._before_motors(number, t, q, v)))

    def excess(self, source: Controller, t: Array | float, q: Array, v: Array) -> Array:
        """Return the part of a controller's commands that its motors cut off, shape (..., k)."""
        motors = (
            motor.excess(self.given(number, t, q, v))
            for number, motor in enumerate(self.controls.continuous)
            if isinstance(motor, MotorController) and motor.source is source
        )
        return np.stack([*motors], axis=-1)

    def integral_rates(self, t: float, q: Array, v: Array) -> Array:
        """Return the rates of all integrals in one state, shape (m,)."""
        every = enumerate(self.controls.continuous)
        return np.concatenate([controller.rates(self.given(k, t, q, v)) for k, controller in every])

    def parts(self, t: Array, q: Array, v: Array) -> list[dict[str, Array]]:
        """Return columns of every controller at n states, the sampled ones first, shape (n, k) each.

        ``command``, before limits; ``effort`` at the joints; of motors see ``MotorController``.
        """
        here, columns = self.in_force(t), list[dict[str, Array]]()
        for controller, mine in zip(self.controls.sampled, self.controls.places, strict=True):
            in_force = {} if controller.supply else {"effort": here.applied[:, mine]}
            columns.append({"command": here.commands[:, mine], **in_force})
        every = enumerate(self.controls.continuous)
        return columns + [controller.parts(self.given(number, t, q, v)) for number, controller in every]

    def laws(self) -> list[MotionLaw]:
        return [law for controller in self.controls.continuous for law in controller.references]

    def on(self, start: float, end: float) -> ControlEfforts:
        """Return the efforts as they are on an interval, whose end is before a change there."""
        return replace(self, span=(start, end))

    @property
    def jumps(self) -> bool:
        """Whether efforts may jump: at samples, where relays switch, and where references do."""
        return self.past is not None or super().jumps

    @property
    def held(self) -> HeldLoad | None:
        return None if self.controls.continuous else self.controls


def with_control(dynamics: Dynamics, efforts: ControlEfforts) -> Dynamics:
    """Return an equation of motion with the efforts of controllers in place of those it has."""
    return Dynamics.of(dynamics.model, {**dynamics.forces, CONTROL: efforts})


class SampledStates(Record, frozen=True):
    """Gives sampled controllers the states of the mechanism at their samples; no step goes past one of them."""

    controls: Controls
    system: System

    def act(self, t: float, q: Array, v: Array) -> None:
        if self.controls.due(t):
            (at,), (moving,) = self.system.whole(np.array([t]), q[None], v[None])
            self.controls.act(t, at, moving)

    def next(self, t: float) -> float:
        return self.controls.next(t)


def _watch(efforts: ControlEfforts, number: int, switch: Switch[Given]) -> Watch:
    """Return where the way of a controller changes; what a sample may change at once falls through 0."""
    controller, sign = efforts.controls.continuous[number], -switch.direction if switch.jumps else 1

    def value(t: Array, q: Array, v: Array) -> Array:
        return np.asarray(sign * switch.value(efforts.given(number, t, q, v)))

    if switch.jumps:
        return Watch(value, -1, stops=True, loaded=True)
    what = f"the controller of {', '.join(controller.drives)} switches" if switch.leaps else ""
    return Watch(value, switch.direction, stops=True, what=what, unit=str(controller.signals[0].unit) if what else "")


class ControlledSystem(Record, frozen=True):
    """A system with the integrals of continuous controllers, which it keeps where the efforts find them."""

    inner: System
    controls: Controls

    @property
    def manifold(self) -> Manifold:
        inner, count = self.inner.manifold, self.controls.integrals[-1].stop
        return Manifold(inner.nq, inner.nv + count, lambda q, v: inner.velocity(q, v[..., : inner.nv]), inner.project)

    @property
    def closure(self) -> Closure:
        return self.inner.closure

    def with_integrals(self, q: Array, v: Array) -> tuple[Array, Array]:
        integral = self.controls.integral
        return q, np.concatenate([v, np.broadcast_to(integral, (*v.shape[:-1], integral.shape[-1]))], axis=-1)

    def acting(self, dynamics: Dynamics) -> Dynamics:
        return self.inner.acting(dynamics)

    def integrals(self, v: Array) -> Array:
        return v[..., self.inner.manifold.nv :]

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        bound, inner, nv = dynamics.on(start, end), self.inner.interval(dynamics, start, end), self.inner.manifold.nv
        efforts, settle = bound.forces[CONTROL], inner.settle
        assert isinstance(efforts, ControlEfforts)

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

    def _acceleration(self, inner: Acceleration, efforts: ControlEfforts) -> Acceleration:
        nv = self.inner.manifold.nv

        def acceleration(t: float, q: Array, v: Array) -> Array:
            self.controls.integral = v[nv:].copy()
            return np.concatenate([inner(t, q, v[:nv]), efforts.integral_rates(t, q, v[:nv])])

        return acceleration

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        self.controls.integral, self.controls.instants = self.integrals(v).copy(), t
        return q, v[..., : self.inner.manifold.nv]

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        return self.inner.complete(dynamics, grid, q, v[:, : self.inner.manifold.nv])


def _places(counts: Sequence[int]) -> list[slice]:
    """Return the places of parts of given sizes, one after the other."""
    ends = np.cumsum([0, *counts]).tolist()
    return [slice(*pair) for pair in pairwise(ends)]
