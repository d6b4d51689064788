"""What controllers remember during a run: efforts in force, states of relays and integrals, now and at every change.

As Pinocchio's buffers it serves one integration at a time: ``begin`` clears it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.control.sampler import Sampler, reference_after
from pinarm.engine.control.schedule import Schedule
from pinarm.mechanics.control.controller import NOTHING, Controller, Given
from pinarm.mechanics.control.motor_control import MotorController


class ControlMemory:
    """The memory of all controllers of a run.

    Args:
        sampled: The sampled controllers.
        continuous: The others.
        nv: Number of velocities.
        supplying: Numbers of the sampled controllers whose commands are not efforts, but voltages of motors.
    """

    def __init__(
        self, sampled: Sequence[Controller], continuous: Sequence[Controller], nv: int,
        supplying: frozenset[int] = frozenset(),
    ) -> None:  # fmt: skip
        self.supplying = supplying
        self.sampled, self.continuous, self.nv = tuple(sampled), tuple(continuous), nv
        counts = [0, *(len(each.joints) for each in self.sampled)]
        self.places = [slice(*pair) for pair in zip(np.cumsum(counts)[:-1], np.cumsum(counts)[1:], strict=True)]
        self.joints = np.array([joint.v for each in self.sampled for joint in each.joints], dtype=np.intp)
        sizes = np.cumsum([0, *(each.integrals for each in self.continuous)])
        self.integrals = [slice(*pair) for pair in zip(sizes[:-1].tolist(), sizes[1:].tolist(), strict=True)]
        self.schedule = Schedule.of((), 0.0, 0.0)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.load = np.zeros(self.nv)
        """Efforts of the sampled controllers in force, as generalised loads [N*m or N], shape (nv,)."""
        self.applied = np.zeros(len(self.joints))
        """Their commands in force, within the limits, shape (k,)."""
        self.commands = np.zeros(len(self.joints))
        """Their last commands, before the limits, shape (k,)."""
        self.modes = [0 for _ in self.continuous]
        """States of the continuous controllers."""
        self.integral = np.zeros(self.integrals[-1].stop if self.integrals else 0)
        """Integrals in the states that are evaluated, shape (..., m)."""
        self.instants = np.zeros(1)
        """Instants of these states where there are several [s], shape (n,)."""
        self.waiting = [dict[int, Array]() for _ in self.sampled]
        self.done = 0
        self.times: list[float] = []
        self.loads: list[Array] = []
        self.all_applied: list[Array] = []
        self.all_commands: list[Array] = []
        self.all_modes: list[tuple[int, ...]] = []

    def begin(self, start: float, end: float) -> None:
        """Begin a run from start to end [s]."""
        self.schedule = Schedule.of(self.sampled, start, end)
        self.samplers = [
            Sampler(each, each.sampling, reference_after(each.references, t, self.schedule.slack))
            for each, t in zip(self.sampled, self.schedule.samples, strict=True) if each.sampling
        ]  # fmt: skip
        self.clear()
        self.note(start)

    def note(self, t: float) -> None:
        """Keep what holds from an instant on [s]."""
        self.times.append(t)
        self.loads.append(self.load)
        self.all_applied.append(self.applied)
        self.all_commands.append(self.commands)
        self.all_modes.append(tuple(self.modes))

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
            for number, sample, measures in self.schedule.actions[self.done]:
                if measures:
                    command = self.samplers[number].sample(sample, t, q, v, self._excess(number, t, q, v))
                    self.waiting[number][sample] = command
                    self.commands[self.places[number]] = command
                else:
                    self.apply(number, self.waiting[number].pop(sample))
            self.done += 1
        self.note(t)

    def _excess(self, number: int, t: float, q: Array, v: Array) -> Array:
        """Return what motors withhold of the commands of a sampled controller, shape (k,); empty without motors."""
        for one, place, mode in zip(self.continuous, self.integrals, self.modes, strict=True):
            if isinstance(one, MotorController) and one.source is self.sampled[number]:
                states = self.integral.reshape(-1)[place]
                return one.excess(Given(t, q, v, NOTHING, NOTHING, states, mode, self.applied))
        return NOTHING

    def apply(self, number: int, command: Array) -> None:
        """Put a command of a sampled controller into force, within its limits."""
        place = self.places[number]
        self.applied[place] = self.sampled[number].limited(command)
        if number not in self.supplying:
            self.load[self.joints[place]] = self.applied[place]

    def piece(self, t: float) -> int:
        """Return the number of the change at t, or the last one before [s]."""
        return max(bisect_right(self.times, t) - 1, 0)

    @property
    def present(self) -> Array:
        """The load in force; see ``HeldLoad``."""
        return self.load

    def load_of(self, pieces: Indices) -> Array:
        """Return the loads that changes have brought about; see ``HeldLoad``."""
        return np.array([self.loads[piece] for piece in pieces.tolist()]).reshape(len(pieces), self.nv)

    @contextmanager
    def as_of(self, piece: int) -> Iterator[None]:
        """Within the block, hold what a change has brought about."""
        now = self.load, self.applied, self.modes
        self.load, self.applied = self.loads[piece], self.all_applied[piece]
        self.modes = list(self.all_modes[piece])
        try:
            yield
        finally:
            self.load, self.applied, self.modes = now

    def history(self) -> ControlHistory:
        """Return all changes until now."""
        return ControlHistory(
            np.array(self.times), np.array(self.loads), np.array(self.all_applied), np.array(self.all_commands),
            np.array(self.all_modes, dtype=np.intp).reshape(len(self.times), len(self.continuous)),
            self.schedule.slack,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ControlHistory:
    """The changes of a run, one after another, m of them.

    Attributes:
        times: When [s], shape (m,).
        loads: Efforts of sampled controllers from then on, as generalised loads, shape (m, nv).
        applied: Their commands in force, within the limits, shape (m, k).
        commands: Their last commands, shape (m, k).
        modes: States of the continuous controllers, shape (m, c).
        slack: Difference of instants below which they are the same [s].
    """

    times: Array
    loads: Array
    applied: Array
    commands: Array
    modes: Indices
    slack: float
