"""What a simpler model costs in accuracy: outputs of variants of a scenario against those of the scenario itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import methodcaller

import numpy as np

from pinarm.errors import InputError
from pinarm.use.result.output_scales import output_scales
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario
from pinarm.use.study.accuracy.common_rows import common_rows, different_course
from pinarm.use.study.accuracy.timed_solutions import SolveTrials, TimedSolution, TimedTrial


@dataclass(frozen=True, eq=False)
class Variant:
    """A model of the scenario, and how far its outputs are from those of the scenario's own.

    Attributes:
        name: As the scenario has it; ``exact`` for the scenario itself.
        result: Its result; none where it could not be solved.
        errors: Output -> largest difference over the run, in the output's unit.
        relative: The same, relative to the output's scale in the exact model.
        where: Output -> row parameter at which that stands.
        seconds: Wall time of the solution [s].
        failure: Why there is no result.
        course: How its events, contacts or end differ from those of the exact model; then only the rows are compared
            that both have.
    """

    name: str
    result: Result | None
    errors: dict[str, float] = field(default_factory=dict)
    relative: dict[str, float] = field(default_factory=dict)
    where: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    failure: str = ""
    course: str = ""


def solve_variants(scenario: Scenario, solve: SolveTrials) -> list[Variant]:
    """Return the exact model and all variants of a scenario.

    Raises:
        PinarmError: The scenario itself cannot be solved, or a variant has a mistake.
    """
    names = list(scenario.content.variants)
    changes = [methodcaller("varied", {}), *(methodcaller("variant", name) for name in names)]
    solutions = solve([TimedTrial(change) for change in changes])
    first = next(solutions)
    if first.failure:
        raise first.failure
    assert first.result
    found = [Variant("exact", first.result, seconds=first.seconds)]
    for name in names:
        with scenario.document.locating("variants", name):
            found.append(_compared(_variant(name, next(solutions)), first.result))
    return found


def _variant(name: str, solution: TimedSolution) -> Variant:
    failure = solution.failure.message if solution.failure else ""
    return Variant(name, solution.result, seconds=solution.seconds, failure=failure)


def _compared(variant: Variant, exact: Result) -> Variant:
    """Return the variant with its differences to the exact model."""
    if variant.result is None:
        return variant
    one, two = common_rows(exact.trajectory, variant.result.trajectory)
    if not len(one):
        raise InputError(f"the rows of the variant '{variant.name}' are not those of the scenario",
                         expected="the same time or range, and as many samples")  # fmt: skip
    errors, relative, where = {}, {}, {}
    for name, scale in output_scales(exact).items():
        apart = np.abs(exact[name].values[one] - variant.result[name].values[two])
        row = int(apart.argmax())
        errors[name], relative[name] = float(apart[row]), float(apart[row]) / scale
        where[name] = float(exact.trajectory.grid.t[one[row]])
    course = different_course(exact, variant.result)
    return Variant(variant.name, variant.result, errors, relative, where, variant.seconds, course=course)
