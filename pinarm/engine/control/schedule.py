"""When sampled controllers measure, and when their efforts change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.mechanics.control.controller import Controller

SAME = 1e-9
"""Difference of instants, over the shortest period, below which they are the same instant."""

MOST = 5_000_000
"""Samples of a run beyond which nobody waits for it."""


class ScheduledAct(NamedTuple):
    """Something that a controller does at an instant.

    Attributes:
        controller: Its number among the sampled ones.
        sample: Number of the sample.
        measures: Whether it measures; otherwise it applies what it has commanded at that sample.
    """

    controller: int
    sample: int
    measures: bool


def require_few_samples(controller: Controller, duration: float) -> None:
    """Raise where a controller has more samples in a duration [s] than anybody waits for.

    Raises:
        InputError: Says how many.
    """
    if controller.sampling and duration > MOST * controller.sampling.period:
        period = controller.sampling.period
        with within("period"):
            raise InputError(f"a period of {period:g} s makes {duration / period:.3g} samples in {duration:g} s",
                             expected=f"at most {MOST:.3g}")  # fmt: skip


def require_action(controller: Controller, duration: float) -> None:
    """Raise where the first command of a controller takes effect after a duration [s] only.

    Raises:
        InputError: Says after which delay.
    """
    if controller.sampling and controller.sampling.delay >= duration:
        with within("delay"):
            raise InputError(f"a delay of {controller.sampling.delay:g} s: no command takes effect in {duration:g} s",
                             expected="a delay shorter than the motion")  # fmt: skip


@dataclass(frozen=True)
class Schedule:
    """The instants of a run at which sampled controllers act.

    Attributes:
        instants: Ascending [s].
        actions: What is done at each, in order: commands of earlier samples are applied before others are measured.
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
        timed = [each.sampling for each in controllers if each.sampling]
        slack = SAME * min((each.period for each in timed), default=0.0)
        marks, samples = list[tuple[float, ScheduledAct]](), list[Array]()
        for number, sampling in enumerate(timed):
            count = int((end - start - slack) / sampling.period) + 1
            samples.append(start + sampling.period * np.arange(float(count)))
            for k, t in enumerate(samples[-1].tolist()):
                marks.append((t, ScheduledAct(number, k, True)))
                marks.append((t + sampling.delay, ScheduledAct(number, k, False)))
        marks.sort()
        instants, actions = list[float](), list[list[ScheduledAct]]()
        for t, action in marks:
            if not instants or t > instants[-1] + slack:
                instants.append(t)
                actions.append([])
            actions[-1].append(action)
        return cls(instants, [_in_order(here) for here in actions], slack, samples)


def _in_order(actions: Sequence[ScheduledAct]) -> list[ScheduledAct]:
    """Return what is done at one instant: earlier commands apply, then all measure, then apply what that gives."""
    measured = {(act.controller, act.sample) for act in actions if act.measures}

    def place(act: ScheduledAct) -> tuple[int, ScheduledAct]:
        at_once = not act.measures and (act.controller, act.sample) in measured
        return (2 if at_once else int(act.measures)), act

    return sorted(actions, key=place)
