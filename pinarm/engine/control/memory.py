"""Sampled controllers during a run: schedule, samples, and the memory of all controllers at every change.

As Pinocchio's buffers the memory serves one integration at a time: ``begin`` clears it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.errors import InputError, within
from pinarm.mechanics.control.controller import NOTHING, Controller, Given, Sampling
from pinarm.mechanics.control.motor_control import MotorController
from pinarm.mechanics.laws.motion_law import MotionLaw

SAME = 1e-9
"""Difference of instants, over the shortest period, below which they are the same instant."""

MOST = 5_000_000
"""Samples of a run beyond which nobody waits for it."""


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


def reference_after(laws: tuple[MotionLaw, ...], t: Array, slack: float = 0.0) -> Array:
    """Return values, rates and accelerations of laws at instants, shape (n,), each after a jump; shape (n, s, 3).

    A jump that is later by the slack [s] or less is at the instant itself.
    """
    reference = np.empty((len(t), len(laws), 3))
    for k, law in enumerate(laws):
        for piece in law.smooth_pieces:
            here = (t >= piece.start - slack) & (t < piece.end - slack)
            if here.any():
                reference[here, k] = np.array(piece.function(t[here])).T
    return reference


class ScheduledAct(NamedTuple):
    """An action of a sampled controller.

    Attributes:
        order: 0 where a command of an earlier sample is applied, 1 of a measurement, 2 of a command without delay.
    """

    order: int
    controller: int
    sample: int


class Schedule(NamedTuple):
    """The instants of a run at which sampled controllers act.

    Attributes:
        instants: Ascending [s].
        actions: Those at each, in order.
        slack: Difference below which instants are the same [s].
        samples: Instants of the samples of every controller [s].
    """

    instants: list[float]
    actions: list[list[ScheduledAct]]
    slack: float
    samples: list[Array]

    @classmethod
    def of(cls, controllers: Sequence[Controller], start: float, end: float) -> Schedule:
        """Return the schedule of sampled controllers from start to end [s]."""
        timed = [controller.sampling for controller in controllers if controller.sampling]
        slack = SAME * min((sampling.period for sampling in timed), default=0.0)
        marks, samples = list[tuple[float, ScheduledAct]](), list[Array]()
        for number, sampling in enumerate(timed):
            count, applied = int((end - start - slack) / sampling.period) + 1, 0 if sampling.delay > slack else 2
            samples.append(start + sampling.period * np.arange(float(count)))
            for k, t in enumerate(samples[-1].tolist()):
                marks += [(t, ScheduledAct(1, number, k)), (t + sampling.delay, ScheduledAct(applied, number, k))]
        instants, actions = list[float](), list[list[ScheduledAct]]()
        for t, action in sorted(marks):
            if not instants or t > instants[-1] + slack:
                instants.append(t)
                actions.append([])
            actions[-1].append(action)
        return cls(instants, [sorted(here) for here in actions], slack, samples)


class Sampler:
    """A sampled controller from one sample to the next; ``reference`` has its signals there, shape (n, s, 3)."""

    def __init__(self, controller: Controller, sampling: Sampling, reference: Array) -> None:
        self.controller, self.sampling, self.reference = controller, sampling, reference
        self.integral = np.zeros(controller.integrals)
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
    """State of the controllers from an instant on.

    Attributes:
        load: Efforts of the sampled controllers in force, as generalised loads [N*m or N], shape (nv,).
        applied: Their commands in force, within the limits, shape (k,).
        commands: Their last commands, before the limits, shape (k,).
    """

    load: Array
    applied: Array
    commands: Array
    modes: tuple[int, ...]


class ControlHistory(NamedTuple):
    """The m changes of a run; fields as in ``Change``, with one row each.

    ``slack`` is the difference of instants [s] below which they are the same.
    """

    times: Array
    loads: Array
    applied: Array
    commands: Array
    modes: Indices
    slack: float


class ControlMemory:
    """The memory of all controllers of a run."""

    def __init__(self, sampled: Sequence[Controller], continuous: Sequence[Controller], nv: int) -> None:
        self.sampled, self.continuous, self.nv = tuple(sampled), tuple(continuous), nv
        self.places = _places([len(controller.joints) for controller in self.sampled])
        self.joints = np.array([joint.v for controller in self.sampled for joint in controller.joints], dtype=np.intp)
        self.integrals = _places([controller.integrals for controller in self.continuous])
        self.schedule = Schedule.of((), 0.0, 0.0)
        self._clear()

    def _clear(self) -> None:
        self.load = np.zeros(self.nv)
        self.applied, self.commands = np.zeros(len(self.joints)), np.zeros(len(self.joints))
        self.modes = [0 for _ in self.continuous]
        self.integral = np.zeros(self.integrals[-1].stop if self.integrals else 0)
        """Integrals in the states that are evaluated, shape (..., m)."""
        self.instants = np.zeros(1)
        """Instants of these states where there are several [s], shape (n,)."""
        self.waiting = [dict[int, Array]() for _ in self.sampled]
        self.done = 0
        self.times: list[float] = []
        self.changes: list[Change] = []

    def begin(self, start: float, end: float) -> None:
        self.schedule = Schedule.of(self.sampled, start, end)
        self.samplers = [
            Sampler(controller, controller.sampling, reference_after(controller.references, t, self.schedule.slack))
            for controller, t in zip(self.sampled, self.schedule.samples, strict=True)
            if controller.sampling
        ]
        self._clear()
        self.note(start)

    def note(self, t: float) -> None:
        self.times.append(t)
        self.changes.append(Change(self.load, self.applied, self.commands, tuple(self.modes)))

    def next(self, t: float) -> float:
        """Return the first instant after t at which a sampled controller acts [s]; infinite for none."""
        instants, k = self.schedule.instants, self.done
        while k < len(instants) and instants[k] <= t + self.schedule.slack:
            k += 1
        return instants[k] if k < len(instants) else np.inf

    def due(self, t: float) -> bool:
        """Return whether a sampled controller has something to do at t [s]."""
        instants = self.schedule.instants
        return self.done < len(instants) and instants[self.done] <= t + self.schedule.slack

    def act(self, t: float, q: Array, v: Array) -> None:
        """Let sampled controllers do what is due at t [s], in the state (q, v) of the mechanism."""
        self.load, self.commands, self.applied = self.load.copy(), self.commands.copy(), self.applied.copy()
        while self.due(t):
            for order, number, sample in self.schedule.actions[self.done]:
                place = self.places[number]
                if order == 1:
                    command = self.samplers[number].sample(sample, t, q, v, self._excess(number, t, q, v))
                    self.waiting[number][sample] = self.commands[place] = command
                    continue
                self.applied[place] = self.sampled[number].limited(self.waiting[number].pop(sample))
                if not self.sampled[number].supply:
                    self.load[self.joints[place]] = self.applied[place]
            self.done += 1
        self.note(t)

    def _excess(self, number: int, t: float, q: Array, v: Array) -> Array:
        """Return the part that motors withhold of the commands of a sampled controller, (k,); empty without motors."""
        for motor, place, mode in zip(self.continuous, self.integrals, self.modes, strict=True):
            if isinstance(motor, MotorController) and motor.source is self.sampled[number]:
                states = self.integral.reshape(-1)[place]
                return motor.excess(Given(t, q, v, NOTHING, NOTHING, states, mode, self.applied))
        return NOTHING

    def piece(self, t: float) -> int:
        return max(bisect_right(self.times, t) - 1, 0)

    @property
    def present(self) -> Array:
        """The load in force; see ``HeldLoad``."""
        return self.load

    def load_of(self, pieces: Indices) -> Array:
        """Return the loads after changes; see ``HeldLoad``."""
        return np.array([self.changes[piece].load for piece in pieces.tolist()]).reshape(len(pieces), self.nv)

    @contextmanager
    def as_of(self, piece: int) -> Iterator[None]:
        """Within the block, hold the state after a change."""
        now, change = (self.load, self.applied, self.modes), self.changes[piece]
        self.load, self.applied, self.modes = change.load, change.applied, list(change.modes)
        try:
            yield
        finally:
            self.load, self.applied, self.modes = now

    def history(self) -> ControlHistory:
        loads, applied, commands, modes = zip(*self.changes, strict=True)
        counts = np.array(modes, dtype=np.intp).reshape(len(self.times), len(self.continuous))
        times = np.array(self.times)
        return ControlHistory(
            times, np.array(loads), np.array(applied), np.array(commands), counts, self.schedule.slack
        )


def _places(counts: Sequence[int]) -> list[slice]:
    """Return the places of parts of given sizes, one after the other."""
    ends = np.cumsum([0, *counts]).tolist()
    return [slice(*pair) for pair in pairwise(ends)]
