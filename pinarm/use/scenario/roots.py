"""Values that make quantities vanish: which counterweight, which pressure, which correction masses.

With x the unknown numbers of a scenario and r(x) the wanted quantities less their targets over all rows of the run, x
minimises ``|r(x)|^2`` by Gauss-Newton steps with the slopes of ``Differences``. Where r depends on x by a polynomial of
degree 2 these are exact, and one or two steps end at rounding. A step that does not come nearer is replaced by shorter
ones, each the best one of its length by the slopes (Levenberg, Quarterly of Applied Mathematics 2, 1944): where the
slopes are all but dependent, a part of a Gauss-Newton step hardly leads down.

Angles may be told between -180 and 180 degrees, and jump there. Where angles are not met as they are told, they are
looked for but for whole turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, IntegrationError, PinarmError
from pinarm.use.scenario.differences import Differences, Refused
from pinarm.use.scenario.find import Find

ITERATIONS, SETTLED, SHRINK = 100, 1e-13, 0.25
"""Steps at most; change of the values, relative to their sizes, at which they have settled; factor of a step that was
too long."""

SHORTER, BARRED, NEARER = 10, 5, 0.5
"""Lengths of a step that are tried, of the size of the values or below; steps, one after the other, to where nothing
can be run, after which a search ends; and what may be left of what was, where such a step counts as a good one."""

MET = 1e-6
"""What may be left of a wanted quantity, relative to what has changed of it, or what values as at the start change."""

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
        missed: Quantities of which more is left than a small part of what the values change them by.
        turned: Angles that are met but for whole turns.
    """

    values: Array
    residuals: Mapping[str, float]
    before: Mapping[str, float]
    steps: int
    missed: Sequence[str] = ()
    turned: Sequence[str] = ()

    @property
    def met(self) -> bool:
        """Whether nothing is left of what is wanted, but for a small part of what the values bring about."""
        return not self.missed

    def left(self) -> dict[str, float]:
        """Return what is left of every wanted quantity, by a text that names it and what it was at the start."""
        return {f"left of {name} (started with {self.before[name]:.3g})": x for name, x in self.residuals.items()}

    def remarks(self, noise: Mapping[str, float]) -> list[str]:
        """Return a remark where no values near the start bring about what is wanted, or all but whole turns of it.

        Args:
            noise: Quantity -> what may be left of it by rounding and the tolerance of runs, in SI.
        """
        missed = {name: self.residuals[name] for name in self.missed}
        left = ", ".join(f"{name} by {x:.3g}" for name, x in missed.items() if x > noise.get(name, 0.0))
        if left:
            return [f"so_that is not met: the closest values that were found miss {left}, in SI"]
        return [f"so_that is met but for whole turns of {name}" for name in self.turned]


Residuals = Callable[[Sequence[Mapping[str, str | float]]], Iterable["dict[str, Array] | Refused"]]
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
        stuck = False
        for step in range(1, ITERATIONS + 1):
            jacobian = self.differences.jacobian(x, r)
            slopes = self._slopes(jacobian, r)
            nearer, moved = self._stepped(x, r, slopes)
            left, before, again = float(np.linalg.norm(moved)), float(np.linalg.norm(r)), stuck
            settled = bool((np.abs(slopes.step()) <= SETTLED * self.differences.sizes).all())
            stuck = not settled and left >= (1.0 - 1e-9) * before
            best = nearer if left <= before else x
            if settled or (stuck and (again or not self.differences.renewed())):
                slopes.require_determined(self.search.unknown)
                return self._ended(best, jacobian, step)
            x, r = (x, r) if stuck else (nearer, moved)
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
        found = self.residuals([self.search.case(x) for x in points])
        return [parts if callable(parts) else self._joined(parts) for parts in found]

    def _joined(self, parts: Mapping[str, Array]) -> Array:
        """Return all residuals; of turning angles without whole turns."""
        return np.concatenate([
            np.asarray(np.remainder(part + np.pi, 2.0 * np.pi) - np.pi) if name in self.turning else part
            for name, part in parts.items()
        ])  # fmt: skip

    def _parts(self, x: Array) -> dict[str, Array]:
        """Return what is left of each quantity at a point that must run."""
        (parts,) = self.residuals([self.search.case(x)])
        if callable(parts):
            raise parts()
        return parts

    def _slopes(self, jacobian: Array, r: Array) -> _Slopes:
        """Return the slopes at a point.

        Raises:
            InputError: There are none, or fewer quantities than unknowns.
        """
        slopes = _Slopes.of(jacobian, r, self.differences.sizes)
        if len(r) < len(self.search.unknown) or not slopes.s[0]:
            slopes.require_determined(self.search.unknown)
        return slopes

    def _stepped(self, x: Array, r: Array, slopes: _Slopes) -> tuple[Array, Array]:
        """Return where a step leads and what is left there; it is shortened until less is left and it can be run."""
        refused, size = None, float(np.linalg.norm(r))
        for length in SHRINK ** np.arange(slopes.lengths):
            change = slopes.step(length)
            (moved,) = self._left([x + change])
            if callable(moved):
                refused = refused or moved
            elif np.linalg.norm(moved) <= size:
                break
        good = not callable(moved) and np.linalg.norm(moved) <= NEARER * size
        self._refused[:] = [*self._refused, refused] if refused and not good else []
        if callable(moved) or len(self._refused) >= BARRED:
            raise self._refused[0]()
        return x + change, moved

    def _ended(self, x: Array, jacobian: Array, steps: int) -> FoundValues:
        """Return the values at the end, and how much is left of what is wanted."""
        before, parts = self._parts(self.search.start), self._parts(x)
        first, last, ends = self._joined(before), self._joined(parts), np.cumsum([len(part) for part in parts.values()])
        slopes = jacobian * np.maximum(np.abs(self.search.start), self.differences.widths)
        split = (np.split(each, ends[:-1]) for each in (last, last - first, slopes))
        missed = [
            name
            for name, left, change, slope in zip(parts, *split, strict=True)
            if np.linalg.norm(left) > MET * max(np.linalg.norm(change), np.linalg.norm(slope))
        ]
        turned = [name for name in self.turning if name not in missed and (np.abs(parts[name]) > np.pi).any()]
        return FoundValues(x, _worst(parts), _worst(before), steps, missed, turned)


@dataclass(frozen=True)
class _Slopes:
    """What is left, as it changes near a point: ``r + J dx``, by the singular values of J times the sizes of x.

    Attributes:
        s: Singular values, from the largest on, shape (m,); 0 below ``INDEPENDENT`` of it.
        vt: Their directions, shape (m, k).
        b: What is left along each, shape (m,).
        sizes: Sizes of the numbers, shape (k,).
    """

    s: Array
    vt: Array
    b: Array
    sizes: Array

    @classmethod
    def of(cls, jacobian: Array, r: Array, sizes: Array) -> _Slopes:
        """Return the slopes of what is left, r of shape (rows,), by their Jacobian, shape (rows, k)."""
        u, s, vt = np.linalg.svd(jacobian * sizes, full_matrices=False)
        return cls(np.where(s > INDEPENDENT * s[0], s, 0.0), vt, u.T @ r, sizes)

    @cached_property
    def _full(self) -> Array:
        """The Gauss-Newton step along each direction."""
        return np.divide(self.b, self.s, out=np.zeros_like(self.b), where=self.s > 0.0)

    @property
    def lengths(self) -> int:
        """How many lengths of a step are tried: one that is far longer than the numbers are large has more of them."""
        far = math.log(max(float(np.linalg.norm(self._full)), 1.0), 1.0 / SHRINK)
        return SHORTER + math.ceil(far)

    def step(self, length: float = 1.0) -> Array:
        """Return the change of the numbers that leaves least, of a part of the length of the Gauss-Newton step.

        With the scaled change d it is ``-V s b/(s^2 + w)``, w so large that ``|d|`` is that length.
        """
        wanted = length * float(np.linalg.norm(self._full))
        low, high = 0.0, float(np.linalg.norm(self.s * self.b)) / wanted if length < 1.0 and wanted else 0.0
        while high - low > 1e-9 * high:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.linalg.norm(self._damped(middle)) > wanted else (low, middle)
        return np.asarray(-self.sizes * (self.vt.T @ self._damped(high)))

    def _damped(self, weight: float) -> Array:
        return self.s * self.b / (self.s**2 + weight) if weight else self._full

    def require_determined(self, unknown: Collection[str]) -> None:
        """Raise where they do not determine the numbers.

        Raises:
            InputError: Names those that are not determined.
        """
        if len(self.s) == len(unknown) and self.s.all():
            return
        weak = self.vt[-1] if len(self.s) == len(unknown) else np.ones(len(unknown))
        tied = [path for path, share in zip(unknown, weak, strict=True) if abs(share) > 0.1]
        raise InputError(
            f"what is wanted does not determine {', '.join(tied)}",
            expected="unknowns that change what is wanted, each in its own way",
            hint="fewer unknowns, another start, or more quantities in so_that",
        )


def _worst(parts: Mapping[str, Array]) -> dict[str, float]:
    return {name: float(np.abs(part).max()) for name, part in parts.items()}
