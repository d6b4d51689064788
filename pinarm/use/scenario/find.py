"""Values that make quantities vanish: which counterweight, which pressure, which correction masses.

With x the unknown numbers of a scenario and r(x) the wanted quantities less their targets over all rows of the run, x
minimises ``|r(x)|^2`` by Gauss-Newton steps with central differences. Where r depends on x by a polynomial of degree 2
the differences are exact, and one or two steps end at rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, IntegrationError
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Measured

DIFFERENCE = 1e-3
"""Half width of a difference, relative to the value, or to one of its units where that is larger."""

ITERATIONS, SETTLED, SHRINK = 40, 1e-13, 0.25
"""Steps at most; relative change of the values at which they have settled; factor of a step that was too long."""

INDEPENDENT = 1e-9
"""Smallest singular value of the scaled Jacobian, relative to the largest, with which the values are determined."""


class Find(InputStruct, frozen=True, rename={"unknown": "for", "wanted": "so_that"}):
    """Numbers to find, and what they are to bring about at every row of the run.

    Attributes:
        unknown: ``for`` in files: path of a number of the scenario, as ``--set`` writes it -> where to start from.
        wanted: ``so_that`` in files: quantity or formula -> its value at every row; or number of the run, such as
            ``C_B @ rms`` -> its value.
    """

    unknown: Annotated[dict[str, AnyQuantity], msgspec.Meta(min_length=1)]
    wanted: Annotated[dict[str, AnyQuantity], msgspec.Meta(min_length=1)]

    def text(self, values: Array) -> dict[str, str]:
        """Return values, shape (k,) in SI, by their paths, as files write them: in the units of the starts."""
        return {path: _written(start, value) for (path, start), value in zip(self.unknown.items(), values, strict=True)}

    def starts(self) -> Array:
        """Return where to start from, in SI, shape (k,)."""
        return np.array([float(start) for start in self.unknown.values()])

    def widths(self, values: Array) -> Array:
        """Return the half widths of differences about some values, shape (k,)."""
        return DIFFERENCE * np.maximum(np.abs(values), [_factor(start) for start in self.unknown.values()])


@dataclass(frozen=True)
class FoundValues:
    """The values that were found.

    Attributes:
        values: By path, as files write them.
        numbers: The same, in the units of the starts.
        residuals: Quantity -> what is left of it at the worst row, in SI.
        before: The same for the starts.
        steps: Number of Gauss-Newton steps.
    """

    values: Mapping[str, str]
    numbers: tuple[float, ...]
    residuals: Mapping[str, float]
    before: Mapping[str, float]
    steps: int


def find(search: Find, residuals: Callable[[Mapping[str, str]], dict[str, Array]]) -> FoundValues:
    """Return the values that a search finds.

    Args:
        search: What is unknown and what is wanted.
        residuals: Values by path -> every wanted quantity less its target, at all rows.

    Raises:
        InputError: An unknown has no effect on what is wanted, or several have the same.
        IntegrationError: The steps do not settle.
    """
    x, widths = search.starts(), search.widths(search.starts())
    parts = residuals(search.text(x))
    before, r = _worst(parts), np.concatenate([*parts.values()])
    for step in range(1, ITERATIONS + 1):
        jacobian = _slopes(search, residuals, x, widths)
        change = -_solved(search, jacobian, r, widths)
        length = 1.0
        while True:
            trial = search.text(x + length * change)
            parts = residuals(trial)
            moved = np.concatenate([*parts.values()])
            if np.linalg.norm(moved) <= np.linalg.norm(r) or length < SHRINK**8:
                break
            length *= SHRINK
        small = np.abs(change) <= SETTLED * np.maximum(np.abs(x), widths / DIFFERENCE)
        if small.all() or np.linalg.norm(moved) >= (1.0 - 1e-9) * np.linalg.norm(r):
            best = x + length * change if np.linalg.norm(moved) <= np.linalg.norm(r) else x
            numbers = tuple(float(x) / _factor(one) for x, one in zip(best, search.unknown.values(), strict=True))
            return FoundValues(search.text(best), numbers, _worst(residuals(search.text(best))), before, step)
        x, r = x + length * change, moved
        widths = search.widths(x)
    raise IntegrationError(
        f"the values of {', '.join(search.unknown)} do not settle in {ITERATIONS} steps",
        hint="other starts, or quantities that depend on them more smoothly",
    )


def _slopes(search: Find, residuals: Callable[[Mapping[str, str]], dict[str, Array]], x: Array, widths: Array) -> Array:
    """Return the Jacobian of the residuals by central differences, shape (rows, k)."""
    columns = []
    for k, width in enumerate(widths):
        ahead, behind = (
            np.concatenate([*residuals(search.text(x + sign * width * np.eye(len(x))[k])).values()])
            for sign in (1.0, -1.0)
        )
        columns.append((ahead - behind) / (2.0 * width))
    return np.array(columns).T


def _solved(search: Find, jacobian: Array, r: Array, widths: Array) -> Array:
    u, s, vt = np.linalg.svd(jacobian * widths, full_matrices=False)
    if len(s) < len(search.unknown) or s[-1] <= INDEPENDENT * s[0] or not s[0]:
        weak = vt[-1] if len(s) == len(search.unknown) else np.ones(len(search.unknown))
        tied = [path for path, share in zip(search.unknown, weak, strict=True) if abs(share) > 0.1]
        raise InputError(
            f"what is wanted does not determine {', '.join(tied)}",
            expected="unknowns that change what is wanted, each in its own way",
            hint="fewer unknowns, or more quantities in so_that",
        )
    return np.asarray(widths * (vt.T @ ((u.T @ r) / s)))


def _worst(parts: Mapping[str, Array]) -> dict[str, float]:
    return {name: float(np.abs(part).max()) for name, part in parts.items()}


def _factor(start: float) -> float:
    return start.unit.factor if isinstance(start, Measured) and start.unit else 1.0


def _written(start: float, value: float) -> str:
    unit = start.unit if isinstance(start, Measured) else None
    return f"{float(value / unit.factor)!r} {unit}" if unit else repr(float(value))
