"""Bounds of the errors of numbers of a run, those of sections among them, by another solution of the same run.

A number differs in both solutions by the error of the coarser one, as outputs do. Where rounding alone is left, two
values of one number may agree by chance: as a part of itself it is as wrong as the worst output, at least.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from pinarm.errors import PinarmError
from pinarm.use.result.section import Section
from pinarm.use.result.section_number import AnyNumber, SectionNumber, read_number

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

OF_NUMBERS = ("limits", "sensitivity")
"""Assessments of other numbers of the run, which they request."""


def number_bounds(result: Result, other: Result | None, factor: float) -> dict[str, float]:
    """Return bounds [SI] of the errors of the numbers that a result tells, by name.

    They are infinite where the other has none, and where a decision of the run that is open touches the number. Numbers
    that the run does not come to have none.

    Args:
        result: What the errors are wanted of, with those of its outputs.
        other: A finer solution, or one at rounding; ``None`` where there is none.
        factor: By which differences are multiplied.
    """
    asked = {number.label: number for number in _numbers(result)}
    if search := result.known.get("find"):  # whose objective is called as the number of the run that it is
        asked["find.objective"] = read_number(search.numbers["objective"].name)
    found = {label: (number, *_value(result, number)) for label, number in asked.items()}
    undecided = [decision for decision in result.outcome.decisions if decision.is_open]
    worst = max((error for error in result.errors.values() if np.isfinite(error)), default=0.0)
    bounds = {}
    for label, (number, value, left) in found.items():
        if np.isfinite(value):
            known = other and not any(decision.touches(label) for decision in undecided)
            difference = abs(_value(other, number)[0] - value) if other and known else np.inf
            least = worst * abs(value)
            bounds[label] = max(factor * difference, least) + left if np.isfinite(difference) else np.inf
    return bounds


def bounded_sections(result: Result, bounds: Mapping[str, float]) -> dict[str, Section]:
    """Return the sections of a result that have numbers with bounds, by key, with these."""
    found = {}
    for key in [*result.known, *_own(result)]:
        own = {name: bounds[label] for name in _names(result, key) if (label := f"{key}.{name}") in bounds}
        if own:
            found[key] = result.section(key).bounded(own)
    return found


def _numbers(result: Result) -> Iterator[AnyNumber]:
    """Yield the numbers that a result tells, but for those of sections that take many runs."""
    content = result.content
    yield from map(read_number, content.numbers)
    for key in OF_NUMBERS:
        if key in content.assessments:
            yield from map(read_number, content.assessments[key].requested(result.trajectory.mechanism))
    for key in _own(result):
        yield from (SectionNumber(key, name) for name in _names(result, key))


def _own(result: Result) -> list[str]:
    """Return the keys of the sections that follow from this run alone."""
    return [key for key in result.content.assessments if key not in OF_NUMBERS]


def _names(result: Result, key: str) -> list[str]:
    """Return the names of the numbers of a section; none where the run has no such section, and says so elsewhere."""
    try:
        return list(result.section(key).numbers)
    except PinarmError:
        return []


def _value(result: Result, number: AnyNumber) -> tuple[float, float]:
    """Return a number and the error of its quadrature [SI]; NaN where the run does not have it."""
    try:
        return number.value(result)
    except PinarmError:
        return np.nan, 0.0
