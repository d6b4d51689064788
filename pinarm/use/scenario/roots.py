"""Values that make quantities vanish: which counterweight, which pressure, which correction masses.

With x the unknown numbers of a scenario and r(x) the wanted quantities less their targets over all rows of the run, x
minimises ``|r(x)|^2`` by Gauss-Newton steps with the slopes of ``Differences``. Where r depends on x by a polynomial of
degree 2 these are exact, and one or two steps end at rounding.

Angles may be told between -180 and 180 degrees, and jump there. Where angles are not met as they are told, they are
looked for but for whole turns.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, IntegrationError, PinarmError
from pinarm.use.scenario.differences import Differences, Refused
from pinarm.use.scenario.find import Find

ITERATIONS, SETTLED, SHRINK = 40, 1e-13, 0.25
"""Steps at most; change of the values, relative to their sizes, at which they have settled; factor of a step that was
too long."""

SHORTER, BARRED = 10, 5
"""Lengths of a step that are tried; and steps, one after the other, to where nothing can be run, after which a search
ends."""

MET = 1e-6
"""What may be left of what is wanted, relative to what the values, or the way they went, change."""

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
        turned: Angles that are met but for whole turns.
    """

    values: Array
    residuals: Mapping[str, float]
    before: Mapping[str, float]
    steps: int
    met: bool
    turned: Sequence[str] = ()

    def left(self) -> dict[str, float]:
        """Return what is left of every wanted quantity, by a text that names it and what it was at the start."""
        return {f"left of {name} (started with {self.before[name]:.3g})": x for name, x in self.residuals.items()}

    def remarks(self) -> list[str]:
        """Return a remark where no values near the start bring about what is wanted, or all but whole turns of it."""
        if self.met:
            return [f"so_that is met but for whole turns of {name}" for name in self.turned]
        left = ", ".join(f"{name} by {x:.3g}" for name, x in self.residuals.items())
        return [f"so_that is not met: the values that come closest to it miss {left}, in SI"]


Residuals = Callable[[Sequence[Mapping[str, str]]], Iterable["dict[str, Array] | Refused"]]
"""Several sets of values by path -> for each every wanted quantity less its target, at all rows."""


def find_root(search: Find, residuals: Residuals, angles: Collection[str] = ()) -> FoundValues:
    """Return the values that a search finds.

    Args:
        search: What is unknown and what is wanted.
        residuals: What is left of it.
        angles: Wanted quantities that are angles.

    Raises:
        InputError: An unknown has no effect on what is wanted, or several have the same.
        IntegrationError: The steps do not settle.
        PinarmError: What is to be run cannot be run.
    """
    failed, told = None, None
    try:
        told = _Descent(search, residuals).found()
    except PinarmError as error:
        failed = error
    if angles and not (told and told.met):
        with suppress(PinarmError):
            turned = _Descent(search, residuals, angles).found()
            told = turned if turned.met or told is None else told
    if told is None:
        assert failed
        raise failed
    return told


@dataclass(frozen=True, eq=False)
class _Descent:
    """A search from the start.

    Attributes:
        search: What is unknown and what is wanted.
        residuals: What is left of it.
        turning: Wanted quantities that may differ by whole turns from what is wanted.
        _refused: Why the last steps, one after the other, could not be taken as a whole.
    """

    search: Find
    residuals: Residuals
    turning: Collection[str] = ()
    _refused: list[Refused] = field(default_factory=list)

    def found(self) -> FoundValues:
        """Return where it ends; see ``find_root``."""
        x = self.search.start
        r = self._joined(self._parts(x))
        for step in range(1, ITERATIONS + 1):
            jacobian = self.differences.jacobian(x, r)
            change = -self._solved(jacobian, r)
            nearer, moved = self._stepped(x, r, change)
            small = np.abs(change) <= SETTLED * self.differences.sizes
            if small.all() or np.linalg.norm(moved) >= (1.0 - 1e-9) * np.linalg.norm(r):
                best = nearer if np.linalg.norm(moved) <= np.linalg.norm(r) else x
                return self._ended(best, jacobian, step)
            x, r = nearer, moved
        raise IntegrationError(
            f"the values of {', '.join(self.search.unknown)} do not settle in {ITERATIONS} steps",
            hint="other starts, or quantities that depend on them more smoothly",
        )

    @cached_property
    def differences(self) -> Differences:
        """Slopes of what is left."""
        return Differences(self._left, np.array([one.factor for one in self.search.unknown.values()]))

    def _left(self, points: Sequence[Array]) -> list[Array | Refused]:
        """Return what is left at points, shape (rows,) each, or why they cannot be run."""
        found = self.residuals([self.search.text(x) for x in points])
        return [parts if callable(parts) else self._joined(parts) for parts in found]

    def _joined(self, parts: Mapping[str, Array]) -> Array:
        """Return all residuals; of turning angles without whole turns."""
        return np.concatenate([
            np.asarray(np.remainder(part + np.pi, 2.0 * np.pi) - np.pi) if name in self.turning else part
            for name, part in parts.items()
        ])  # fmt: skip

    def _parts(self, x: Array) -> dict[str, Array]:
        """Return what is left of each quantity at a point that must run."""
        (parts,) = self.residuals([self.search.text(x)])
        if callable(parts):
            raise parts()
        return parts

    def _stepped(self, x: Array, r: Array, change: Array) -> tuple[Array, Array]:
        """Return where a step leads and what is left there; it is shortened until less is left and it can be run."""
        refused = None
        for length in SHRINK ** np.arange(SHORTER):
            (moved,) = self._left([x + length * change])
            if callable(moved):
                refused = refused or moved
            elif np.linalg.norm(moved) <= np.linalg.norm(r):
                break
        self._refused[:] = [*self._refused, refused] if refused else []
        if callable(moved) or len(self._refused) >= BARRED:
            raise self._refused[0]()
        return x + length * change, moved

    def _ended(self, x: Array, jacobian: Array, steps: int) -> FoundValues:
        """Return the values at the end, and how much is left of what is wanted."""
        before, parts = self._parts(self.search.start), self._parts(x)
        left, way = self._joined(parts), np.maximum(self.differences.sizes, np.abs(x - self.search.start))
        met = bool(np.linalg.norm(left) <= MET * np.linalg.norm(jacobian * way))
        turned = [name for name in self.turning if met and (np.abs(parts[name]) > np.pi).any()]
        return FoundValues(x, _worst(parts), _worst(before), steps, met, turned)

    def _solved(self, jacobian: Array, r: Array) -> Array:
        """Return the change of the values that the rest asks for.

        Raises:
            InputError: The rest does not determine it.
        """
        sizes, unknown = self.differences.sizes, self.search.unknown
        u, s, vt = np.linalg.svd(jacobian * sizes, full_matrices=False)
        if len(s) < len(unknown) or s[-1] <= INDEPENDENT * s[0] or not s[0]:
            weak = vt[-1] if len(s) == len(unknown) else np.ones(len(unknown))
            tied = [path for path, share in zip(unknown, weak, strict=True) if abs(share) > 0.1]
            raise InputError(
                f"what is wanted does not determine {', '.join(tied)}",
                expected="unknowns that change what is wanted, each in its own way",
                hint="fewer unknowns, or more quantities in so_that",
            )
        return np.asarray(sizes * (vt.T @ ((u.T @ r) / s)))


def _worst(parts: Mapping[str, Array]) -> dict[str, float]:
    return {name: float(np.abs(part).max()) for name, part in parts.items()}
