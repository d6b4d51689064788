"""Accuracy of outputs and numbers of a run: what their errors are relative to, and what rounding leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import Unit
from pinarm.use.result.measures import SOLVED, ZERO, natural_sizes
from pinarm.use.result.numbers import AnyNumber, CombinedNumber, RunNumber
from pinarm.use.result.numbers import measured as measured_number

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

STEPS = 10.0
"""Global error of an integrated motion over its tolerance; what changes irregularly from run to run is less."""


def output_scales(result: Result) -> dict[str, float]:
    """Return the scales of the errors of the outputs, by name.

    A scale is the largest absolute value over the run; of an output that is 0 but for rounding, the natural size of
    its unit, see ``natural_sizes``.
    """
    return {name: usual if size <= ZERO * usual else size for name, (size, usual) in _sizes(result).items()}


def rounded_to_zero(result: Result) -> dict[str, float]:
    """Return the sizes of outputs that are 0 but for rounding, though not exactly, relative to their scales."""
    return {name: size / usual for name, (size, usual) in _sizes(result).items() if 0.0 < size <= ZERO * usual}


def _sizes(result: Result) -> dict[str, tuple[float, float]]:
    natural = natural_sizes(result.trajectory)
    columns = {name: result[name] for name in result.content.outputs}
    return {name: (float(np.abs(column.values).max()), natural(column.unit)) for name, column in columns.items()}


def noise(result: Result, numbers: Sequence[AnyNumber], measured: Sequence[tuple[Series, float]]) -> Array:
    """Return the irregular change of numbers from one run to the next [SI], shape (m,).

    Numbers that are 0 but for rounding change by the size that ``rounding`` gives.

    Args:
        result: The run.
        numbers: The numbers.
        measured: Their values, and the errors of their quadrature.
    """
    key, value = result.content.accuracy.setting
    adaptive = "evaluations" in result.figures and key == "tolerance"
    relative = max(SOLVED, STEPS * value) if adaptive else SOLVED
    sizes = [
        max(_size(result, number), abs(float(series.values[0])))
        for number, (series, _) in zip(numbers, measured, strict=True)
    ]
    lefts = rounding(result, [series.unit for series, _ in measured])
    return np.array(
        [
            _noise_of_formula(result, number)
            if isinstance(number, CombinedNumber)
            else (relative * size if size > left else left) + error
            for number, size, left, (_, error) in zip(numbers, sizes, lefts, measured, strict=True)
        ]
    )


def _noise_of_formula(result: Result, number: CombinedNumber) -> float:
    parts = [measured_number(part, result) for part in number.parts]
    changes = noise(result, number.parts, parts).tolist()
    return number.of([(float(series.values[0]), change) for (series, _), change in zip(parts, changes, strict=True)])[1]


def rounding(result: Result, units: Sequence[Unit | None]) -> Array:
    """Return the sizes up to which numbers are 0 but for rounding [SI], shape (m,); 0 where a unit is not known."""
    natural = natural_sizes(result.trajectory)
    return np.array([ZERO * natural(unit) if unit is not None else 0.0 for unit in units])


def _size(result: Result, number: AnyNumber) -> float:
    return float(np.abs(result[number.quantity].values).max()) if isinstance(number, RunNumber) else 0.0
