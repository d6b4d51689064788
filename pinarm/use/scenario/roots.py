"""Root finding: values of a scenario's numbers at which quantities of the run take wanted values.

With x the unknown numbers and r(x) the wanted quantities less their targets over all rows of the run, x minimises
``|r(x)|^2`` by Levenberg-Marquardt steps (MINPACK; More, Garbow and Hillstrom, ANL-80-74, 1980) with slopes by central
differences whose widths follow the numbers.

Angles may be reported between -180 and 180 degrees, and jump there. A first search takes differences of angles without
whole turns; where whole turns are left of it, a second one takes them as they are reported.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, IntegrationError, PinarmError
from pinarm.use.scenario.find import Find

ITERATIONS, SETTLED = 200, 1e-13
"""Largest number of runs of a search, slopes apart; change of the values, relative to them, at which it ends."""

BARRIER, BARRED = 1e3, 1e-3
"""Relative to the residuals at the start: those of refused runs, from which the search turns back; those above which a
refused run is reported as what stopped the search."""

MET = 1e-9
"""Largest remainder of a wanted quantity that is met, relative to its remainder at the start."""

INDEPENDENT = 1e-9
"""Smallest singular value of the scaled Jacobian, relative to the largest, with which the values are determined."""

WIDTH = 1e-3
"""Half width of differences, relative to the size of the number, which is at least this part of its start."""

Refused = Callable[[], PinarmError]
"""The error of a run that failed."""

Parts = dict[str, Array]
"""Wanted quantity -> its values less its target, at all rows."""

Residuals = Callable[[Sequence[Mapping[str, str | float]]], Iterable[Parts | Refused]]
"""Runs several sets of values by path."""


@dataclass(frozen=True)
class FoundValues:
    """Result of a search.

    Attributes:
        values: Values in SI, shape (k,).
        residuals: Quantity -> largest remainder over the rows, in SI.
        before: The same at the start.
        missed: Quantities that are not met.
        turned: Angles that are met but for whole turns.
    """

    values: Array
    residuals: Mapping[str, float]
    before: Mapping[str, float]
    missed: Sequence[str] = ()
    turned: Sequence[str] = ()

    def left(self) -> dict[str, float]:
        """Return the remainder of every wanted quantity, by a text with its name and its remainder at the start."""
        return {f"left of {name} (started with {self.before[name]:.3g})": x for name, x in self.residuals.items()}

    def remarks(self, noise: Mapping[str, float]) -> list[str]:
        """Return a remark where quantities are missed by more than noise, or met but for whole turns.

        Args:
            noise: Quantity -> remainder that rounding and the tolerance of runs explain, in SI.
        """
        missed = {name: self.residuals[name] for name in self.missed}
        left = ", ".join(f"{name} by {x:.3g}" for name, x in missed.items() if x > noise.get(name, 0.0))
        if left:
            return [f"so_that is not met: the closest values that were found miss {left}, in SI"]
        return [f"so_that is met but for whole turns of {name}" for name in self.turned]


def find_root(search: Find, residuals: Residuals, angles: Collection[str] = ()) -> FoundValues:
    """Return the values that a search finds.

    Args:
        search: Unknown numbers and wanted quantities.
        residuals: Remainders of the wanted quantities.
        angles: Wanted quantities that are angles.
    """
    ends, failures = list[FoundValues](), list[PinarmError]()
    for turning in [angles, ()] if angles else [()]:
        try:
            ends.insert(0, _Search(search, residuals, turning).solved())
        except PinarmError as error:
            failures.append(error)
        else:
            if not ends[0].missed and not ends[0].turned:
                break
    if not ends:
        raise failures[-1]
    return min(ends, key=lambda end: bool(end.missed))


@dataclass(eq=False)
class _Search:
    """A search from the start.

    Attributes:
        turning: Angles whose whole turns do not count.
        known: Remainders or refusals of runs, by the bytes of their values.
        refusals: Values and errors of the refused runs.
    """

    search: Find
    residuals: Residuals
    turning: Collection[str]
    known: dict[bytes, Parts | Refused] = field(default_factory=dict)
    refusals: list[tuple[Array, Refused]] = field(default_factory=list)

    def solved(self) -> FoundValues:
        """Return the end of the search; see ``find_root``."""
        from scipy.optimize import least_squares

        start = self.search.start
        before = self._parts(start)
        first = self._joined(before)
        barrier = BARRIER * np.maximum(np.abs(first), np.linalg.norm(first) or 1.0)
        slopes = self._slopes(start)
        if len(first) < len(start) or not slopes.any():
            self._require_determined(slopes[:0])

        def left(x: Array) -> Array:
            (parts,) = self._run([x])
            return barrier if callable(parts) else self._joined(parts)

        options = {"ftol": 1e-15, "xtol": SETTLED, "gtol": 1e-15, "max_nfev": ITERATIONS}
        ended = least_squares(left, start, self._slopes, method="lm", x_scale=self._sizes(start), **options)
        if not ended.status:
            raise IntegrationError(
                f"the values of {', '.join(self.search.unknown)} do not settle in {ITERATIONS} steps",
                hint="other starts, or quantities that depend on them more smoothly",
            )
        self._require_determined(ended.jac)
        if self.refusals and np.sqrt(2.0 * ended.cost) > BARRED * np.linalg.norm(first):
            raise self._stopped(*self.refusals[0])
        after = self._parts(ended.x)
        missed = [name for name in after if self._size(after, name) > MET * self._size(before, name)]
        turned = [name for name in self.turning if name not in missed and (np.abs(after[name]) > np.pi).any()]
        return FoundValues(ended.x, _worst(after), _worst(before), missed, turned)

    def _stopped(self, x: Array, refused: Refused) -> PinarmError:
        error = refused()
        values = ", ".join(f"{path} = {value:.6g}" for path, value in self.search.figures(x).items())
        error.message = f"the search is stopped by a run that is refused, at {values}: {error.message}"
        error.hint = error.hint or "another start, or a wish that runs on this side can meet"
        return error

    def _run(self, points: Sequence[Array]) -> list[Parts | Refused]:
        """Return the remainders or refusals of runs at points; known points are not run again."""
        new = {x.tobytes(): x.copy() for x in points if x.tobytes() not in self.known}
        for (key, x), parts in zip(
            new.items(), self.residuals([self.search.case(x) for x in new.values()]), strict=True
        ):
            self.known[key] = parts
            if callable(parts):
                self.refusals.append((x, parts))
        return [self.known[x.tobytes()] for x in points]

    def _parts(self, x: Array) -> Parts:
        """Return the remainder of each quantity at a point that must run."""
        (parts,) = self._run([x])
        if callable(parts):
            raise parts()
        return parts

    def _joined(self, parts: Parts) -> Array:
        """Return all remainders, those of turning angles without whole turns, shape (rows,)."""
        return np.concatenate([self._turned(parts, name) for name in parts])

    def _turned(self, parts: Parts, name: str) -> Array:
        part = parts[name]
        return np.remainder(part + np.pi, 2.0 * np.pi) - np.pi if name in self.turning else part

    def _size(self, parts: Parts, name: str) -> float:
        return float(np.linalg.norm(self._turned(parts, name)))

    def _sizes(self, x: Array) -> Array:
        """Return the sizes of the numbers at a point, shape (k,): of 0 that of its unit."""
        units = np.array([unknown.factor for unknown in self.search.unknown.values()])
        sizes = np.maximum(np.abs(x), WIDTH * np.abs(self.search.start))
        return np.where(sizes > 0.0, sizes, units)

    def _slopes(self, x: Array) -> Array:
        """Return the slopes at a point, shape (rows, k); beside refused runs those of one side."""
        steps = np.diag(WIDTH * self._sizes(x))
        sides = self._run([x + sign * step for step in steps for sign in (1.0, -1.0)])
        pairs = zip(steps, sides[::2], sides[1::2], strict=True)
        return np.array([self._slope(x, step, ahead, behind) for step, ahead, behind in pairs]).T

    def _slope(self, x: Array, step: Array, ahead: Parts | Refused, behind: Parts | Refused) -> Array:
        """Return the slope along a step, shape (rows,); exact for parabolas."""
        width = float(step.sum())
        if not callable(ahead) and not callable(behind):
            return (self._joined(ahead) - self._joined(behind)) / (2.0 * width)
        sign, far = (-1.0, behind) if callable(ahead) else (1.0, ahead)
        if callable(far):
            raise far()
        near = self._joined(self._parts(x + 0.5 * sign * step))
        return (4.0 * near - self._joined(far) - 3.0 * self._joined(self._parts(x))) / (sign * width)

    def _require_determined(self, jacobian: Array) -> None:
        """Raise an InputError where slopes, shape (rows, k), do not determine the numbers."""
        paths = list(self.search.unknown)
        weak, rank = np.ones(len(paths)), 0
        if len(jacobian):
            columns = np.linalg.norm(jacobian, axis=0)
            _, s, vt = np.linalg.svd(jacobian / np.where(columns > 0.0, columns, 1.0))
            weak, rank = vt[-1], int((s > INDEPENDENT * s[0]).sum())
        if rank < len(paths):
            tied = [path for path, share in zip(paths, weak, strict=True) if abs(share) > 0.1]
            raise InputError(
                f"what is wanted does not determine {', '.join(tied)}",
                expected="unknowns that change what is wanted, each in its own way",
                hint="fewer unknowns, another start, or more quantities in so_that",
            )


def _worst(parts: Mapping[str, Array]) -> dict[str, float]:
    return {name: float(np.abs(part).max()) for name, part in parts.items()}
