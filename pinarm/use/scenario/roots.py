"""Values that make quantities vanish: which counterweight, which pressure, which correction masses.

With x the unknown numbers of a scenario and r(x) the wanted quantities less their targets over all rows of the run, x
minimises ``|r(x)|^2`` by Gauss-Newton steps with central differences. Where r depends on x by a polynomial of degree 2
the differences are exact, and one or two steps end at rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, IntegrationError
from pinarm.use.scenario.find import Find

DIFFERENCE = 1e-3
"""Half width of a difference, relative to the value, or to one of its units where that is larger."""

ITERATIONS, SETTLED, SHRINK = 40, 1e-13, 0.25
"""Steps at most; relative change of the values at which they have settled; factor of a step that was too long."""

MET = 1e-6
"""What may be left of what is wanted, relative to what the values, or their units where these are larger, change."""

INDEPENDENT = 1e-9
"""Smallest singular value of the scaled Jacobian, relative to the largest, with which the values are determined."""


@dataclass(frozen=True)
class FoundValues:
    """The values that were found.

    Attributes:
        values: In SI, shape (k,).
        residuals: Quantity -> what is left of it at the worst row, in SI.
        before: The same for the starts.
        steps: Number of Gauss-Newton steps.
        met: Whether nothing is left of what is wanted, but for a small part of what the values bring about.
    """

    values: Array
    residuals: Mapping[str, float]
    before: Mapping[str, float]
    steps: int
    met: bool

    def left(self) -> dict[str, float]:
        """Return what is left of every wanted quantity, by a text that names it and what it was at the start."""
        return {f"left of {name} (started with {self.before[name]:.3g})": x for name, x in self.residuals.items()}

    def remarks(self) -> list[str]:
        """Return a remark where no values near the start bring about what is wanted."""
        if self.met:
            return []
        left = ", ".join(f"{name} by {x:.3g}" for name, x in self.residuals.items())
        return [f"so_that is not met: the values that come closest to it miss {left}, in SI"]


Residuals = Callable[[Sequence[Mapping[str, str]]], Iterable[dict[str, Array]]]
"""Several sets of values by path -> for each every wanted quantity less its target, at all rows."""


def find_root(search: Find, residuals: Residuals) -> FoundValues:
    """Return the values that a search finds.

    Args:
        search: What is unknown and what is wanted.
        residuals: What is left of it.

    Raises:
        InputError: An unknown has no effect on what is wanted, or several have the same.
        IntegrationError: The steps do not settle.
    """
    x, widths = search.start, _widths(search, search.start)
    (parts,) = residuals([search.text(x)])
    before, r = _worst(parts), np.concatenate([*parts.values()])
    for step in range(1, ITERATIONS + 1):
        jacobian = _slopes(search, residuals, x, widths)
        change = -_solved(search, jacobian, r, widths)
        length = 1.0
        while True:
            (parts,) = residuals([search.text(x + length * change)])
            moved = np.concatenate([*parts.values()])
            if np.linalg.norm(moved) <= np.linalg.norm(r) or length < SHRINK**8:
                break
            length *= SHRINK
        small = np.abs(change) <= SETTLED * np.maximum(np.abs(x), widths / DIFFERENCE)
        if small.all() or np.linalg.norm(moved) >= (1.0 - 1e-9) * np.linalg.norm(r):
            best = x + length * change if np.linalg.norm(moved) <= np.linalg.norm(r) else x
            (parts,) = residuals([search.text(best)])
            left, reach = np.concatenate([*parts.values()]), jacobian * widths / DIFFERENCE
            met = bool(np.linalg.norm(left) <= MET * np.linalg.norm(reach))
            return FoundValues(best, _worst(parts), before, step, met)
        x, r = x + length * change, moved
        widths = _widths(search, x)
    raise IntegrationError(
        f"the values of {', '.join(search.unknown)} do not settle in {ITERATIONS} steps",
        hint="other starts, or quantities that depend on them more smoothly",
    )


def _slopes(search: Find, residuals: Residuals, x: Array, widths: Array) -> Array:
    """Return the Jacobian of the residuals by central differences, shape (rows, k)."""
    sides = (x + sign * np.diag(widths)[k] for k in range(len(x)) for sign in (1.0, -1.0))
    rows = [np.concatenate([*parts.values()]) for parts in residuals([search.text(side) for side in sides])]
    return np.array(
        [(ahead - behind) / (2.0 * width) for ahead, behind, width in zip(rows[::2], rows[1::2], widths, strict=True)]
    ).T


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


def _widths(search: Find, values: Array) -> Array:
    """Return the half widths of differences about some values, shape (k,)."""
    return DIFFERENCE * np.maximum(np.abs(values), [one.factor for one in search.unknown.values()])
