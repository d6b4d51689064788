"""Whole periods: notes on figures that are taken over a part of a cycle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.engine.mechanism import Mechanism
from pinarm.errors import nowhere
from pinarm.mechanics.laws import Over
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.problems.laws import laws_of
from pinarm.use.result.curve_figures import is_figure

if TYPE_CHECKING:
    from pinarm.problems import Problem
    from pinarm.use.result.numbers import AnyNumber

WHOLE = 1e-6
"""Part of a period by which a motion may miss a whole one: values in degrees have no more digits."""

INDIFFERENT = ("peak", "p0", "p100")
"""Figures that are the same over one period and a half."""


def whole_period_notes(problem: Problem, mechanism: Mechanism, numbers: Sequence[AnyNumber]) -> list[str]:
    """Return a note on each period of which a run makes no whole number, where figures are taken over the run.

    Args:
        problem: The question; nothing has to be solved.
        mechanism: The mechanism.
        numbers: Those that are asked for.
    """
    parts = [part for number in numbers for part in number.parts]
    asked = [part.label for part in parts if is_figure(part.figure) and part.figure not in INDIFFERENT]
    if not asked:
        return []
    laws = _laws(problem, mechanism)
    notes = []
    for name, of, period in _periodic(problem, mechanism):
        if of in laws and (count := abs(_way(problem, laws[of])) / period) and abs(count - round(count)) > WHOLE:
            notes.append(
                f"'{name}' repeats with a period of '{of}', which passes {count:.6g} of them in this run: "
                f"{', '.join(asked)} hold for that part only; a time that is a whole number of periods gives those of "
                "the cycle"
            )
    return notes


def _periodic(problem: Problem, mechanism: Mechanism) -> Iterator[tuple[str, str, float]]:
    """Yield laws and forces that are periodic in a coordinate: name, coordinate, and period [rad or m]."""
    for name, law in getattr(problem, "motion", {}).items():
        if isinstance(law, Over) and law.period is not None:
            yield name, law.of, float(law.period)
    for name, force in {**mechanism.description.forces, **getattr(problem, "loads", {})}.items():
        if (along := getattr(force, "over", None)) is not None and force.period is not None:
            yield name, along, float(force.period)


def _laws(problem: Problem, mechanism: Mechanism) -> Mapping[str, MotionLaw]:
    motion, time = getattr(problem, "motion", {}), getattr(problem, "time", None)
    return laws_of(mechanism, motion, nowhere, (time.start, time.end)) if motion and time else {}


def _way(problem: Problem, law: MotionLaw) -> float:
    time = problem.time  # type: ignore[attr-defined]  # of a problem that has laws
    start, end = (float(law.on(time.start, time.end)(np.array([t]))[0][0]) for t in (time.start, time.end))
    return end - start
