"""Root finding: values of a scenario's numbers at which quantities of the run take wanted values.

With x the unknown numbers and r(x) the wanted quantities less their targets over all rows of the run, x minimises
``|r(x)|^2`` by Levenberg-Marquardt steps (MINPACK; More, Garbow and Hillstrom, ANL-80-74, 1980) with slopes by central
differences whose widths follow the numbers.

One wanted number of one unknown is bracketed first, by secant steps from the start that grow, and Brent's method closes
the bracket; where there is none near the start, or it closes around a jump, the search is that above.

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

BARRIER = 1e3
"""Residuals where a run is refused, relative to those at the start: the search turns back."""

PROBE, FARTHER, PROBES = 0.1, 4.0, 12
"""First step that looks for a bracket, relative to the size of the number; largest growth of a step; most steps."""

NEAR = 1e-3
"""Remainder, relative to that at the start, below which it is compared with the noise of the run: that costs one."""

MET, BARRED = 1e-9, 1e-3
"""Largest remainder of a wanted quantity that is met, relative to its change from the start to the end; remainder,
relative to that at the start, above which a refused run is reported as what stopped the search."""

INDEPENDENT = 1e-9
"""Smallest singular value of the scaled Jacobian, relative to the largest, with which the values are determined."""

WIDTHS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-2, 1e-1, 1.0)
"""Half widths of differences, relative to the size of the number, in the order in which they are tried: a curve may
look straight across a wide one by accident."""

STRAIGHT = 1e-2
"""Largest second difference, relative to the first, of an accepted width. Above it the curve bends between the points,
or its change is rounding."""


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

    @property
    def met(self) -> bool:
        """Whether all wanted quantities are met."""
        return not self.missed

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


Refused = Callable[[], PinarmError]
"""The error of a run that failed."""

Residuals = Callable[[Sequence[Mapping[str, str | float]]], Iterable["dict[str, Array] | Refused"]]
"""Several sets of values by path -> for each every wanted quantity less its target, at all rows."""

Noise = Callable[[Array], float]
"""Values in SI, shape (k,) -> remainder of one wanted number that the tolerance of a run there explains, in SI."""


def find_root(
    search: Find, residuals: Residuals, angles: Collection[str] = (), noise: Noise = lambda _: 0.0
) -> FoundValues:
    """Return the values that a search finds.

    Args:
        search: Unknown numbers and wanted quantities.
        residuals: Remainders of the wanted quantities.
        angles: Wanted quantities that are angles.
        noise: Remainder of one wanted number that the tolerance of a run explains.

    Raises:
        InputError: An unknown has no effect on the wanted quantities, or several have the same.
        IntegrationError: The search does not settle.
        PinarmError: A run fails.
    """
    ends, failures = list[FoundValues](), list[PinarmError]()
    for turning in [angles, ()] if angles else [()]:
        try:
            end = _Search(search, residuals, noise, turning).solved()
        except PinarmError as error:
            failures.append(error)
            continue
        if end.met and not end.turned:
            return end
        ends.insert(0, end)
    if not ends:
        raise failures[-1]
    return next((end for end in ends if end.met), ends[0])


class _NoBracket(Exception):
    """There are no two values near the start between which a remainder changes its sign."""


@dataclass(eq=False)
class _Search:
    """A search from the start.

    Attributes:
        search: Unknown numbers and wanted quantities.
        residuals: Remainders of the wanted quantities.
        noise: Remainder of one wanted number that the tolerance of a run explains.
        turning: Angles whose whole turns do not count.
        largest: Largest sizes of the numbers so far, shape (k,).
        known: What came of runs, by the bytes of their values.
        refusals: Values and errors of runs that are refused, in their order.
    """

    search: Find
    residuals: Residuals
    noise: Noise
    turning: Collection[str] = ()
    largest: Array | float = 0.0
    refusals: list[tuple[Array, Refused]] = field(default_factory=list)
    known: dict[bytes, dict[str, Array] | Refused] = field(default_factory=dict)

    def solved(self) -> FoundValues:
        """Return the end of the search; see ``find_root``."""
        from scipy.optimize import least_squares

        start = self.search.start
        before = self._parts(start)
        first = self._joined(before)
        if (
            len(start) == len(first) == 1
            and first[0]
            and (root := self._bracketed(float(start[0]), float(first[0]))) is not None
        ):
            after = self._parts(root)
            return FoundValues(root, _worst(after), _worst(before), turned=self._turned(after))
        barrier = BARRIER * np.maximum(np.abs(first), np.linalg.norm(first) or 1.0)

        def left(x: Array) -> Array:
            (row,) = self._left([x])
            return barrier if callable(row) else row

        slopes, scale = self._slopes(start), self._sizes(start)
        if len(first) < len(start) or not slopes.any():
            self._require_determined(slopes[:0])
        options = {"ftol": 1e-15, "xtol": SETTLED, "gtol": 1e-15, "max_nfev": ITERATIONS}
        ended = least_squares(left, start, self._slopes, method="lm", x_scale=scale, **options)
        if not ended.status:
            raise IntegrationError(
                f"the values of {', '.join(self.search.unknown)} do not settle in {ITERATIONS} steps",
                hint="other starts, or quantities that depend on them more smoothly",
            )
        self._require_determined(ended.jac)
        after = self._parts(ended.x)
        missed = self._missed(after, self._joined(after) - first, slopes * scale)
        if self.refusals and np.sqrt(2.0 * ended.cost) > BARRED * np.linalg.norm(first):
            raise self._stopped(*self.refusals[0])
        turned = [name for name in self._turned(after) if name not in missed]
        return FoundValues(ended.x, _worst(after), _worst(before), missed, turned)

    def _stopped(self, x: Array, refused: Refused) -> PinarmError:
        """Return the error of a refused run with the values of the search there."""
        error = refused()
        values = ", ".join(f"{path} = {value:.6g}" for path, value in self.search.figures(x).items())
        error.message = f"the search is stopped by a run that is refused, at {values}: {error.message}"
        error.hint = error.hint or "another start, or a wish that runs on this side can meet"
        return error

    def _turned(self, parts: Mapping[str, Array]) -> list[str]:
        """Return the angles of which whole turns are left."""
        return [name for name in self.turning if (np.abs(parts[name]) > np.pi).any()]

    def _bracketed(self, start: float, first: float) -> Array | None:
        """Return the root between two values at which the remainder of one number has different signs, shape (1,).

        ``None`` where no such values are found, a run on the way is refused, or the remainder jumps between them.
        """
        from scipy.optimize import brentq

        def left(x: float) -> float:
            (row,) = self._left([np.array([x])])
            if callable(row):
                raise _NoBracket
            size = abs(float(row[0]))
            return 0.0 if size <= NEAR * abs(first) and size <= self.noise(np.array([x])) else float(row[0])

        try:
            ends = self._signs(left, start, first)
            x = np.array([brentq(left, *ends, xtol=SETTLED * max(map(abs, ends)), rtol=SETTLED)])
            reached = abs(left(float(x[0]))) <= MET * abs(first)
        except _NoBracket:
            self.refusals.clear()
            return None
        return x if reached else None

    def _signs(self, left: Callable[[float], float], start: float, first: float) -> tuple[float, float]:
        """Return two values with remainders of different signs: by secant steps that go half as far again.

        Raises:
            _NoBracket: There are none near the start, or the remainder does not change.
        """
        x, f = start, first
        step = PROBE * float(self._sizes(np.array([start]))[0])
        for _ in range(PROBES):
            ahead = left(x + step)
            if f * ahead <= 0.0:
                return x, x + step
            slope = (ahead - f) / step
            if not slope:
                break
            secant = -1.5 * ahead / slope
            x, f, step = x + step, ahead, float(np.clip(secant, -FARTHER * abs(step), FARTHER * abs(step)))
        raise _NoBracket

    def _run(self, points: Sequence[Array]) -> list[dict[str, Array] | Refused]:
        """Return the remainders or refusals of runs at points; known points are not run again."""
        new = {x.tobytes(): x for x in points if x.tobytes() not in self.known}
        self.known |= zip(new, self.residuals([self.search.case(x) for x in new.values()]), strict=True)
        return [self.known[x.tobytes()] for x in points]

    def _parts(self, x: Array) -> dict[str, Array]:
        """Return the remainder of each quantity at a point that must run."""
        (parts,) = self._run([x])
        if callable(parts):
            raise parts()
        return parts

    def _joined(self, parts: Mapping[str, Array]) -> Array:
        """Return all remainders, those of turning angles without whole turns, shape (rows,)."""
        return np.concatenate(
            [
                np.remainder(part + np.pi, 2.0 * np.pi) - np.pi if name in self.turning else part
                for name, part in parts.items()
            ]
        )

    def _left(self, points: Sequence[Array]) -> list[Array | Refused]:
        """Return the remainders at points, or why they cannot be run."""
        left = [parts if callable(parts) else self._joined(parts) for parts in self._run(points)]
        self.refusals += [(x, row) for x, row in zip(points, left, strict=True) if callable(row)]
        return left

    def _sizes(self, x: Array) -> Array:
        """Return the sizes of the numbers at a point, shape (k,): one of their units where they have been 0 so far."""
        self.largest = np.maximum(self.largest, np.abs(x))
        units = np.array([unknown.factor for unknown in self.search.unknown.values()])
        return np.where(self.largest > 0.0, np.maximum(np.abs(x), 1e-3 * self.largest), units)

    def _slopes(self, x: Array) -> Array:
        """Return the slopes at a point, shape (rows, k), each by the first width across which its curve is straight."""
        middle, steps = self._joined(self._parts(x)), np.diag(self._sizes(x))
        best: list[tuple[float, Array]] = [(np.inf, np.zeros_like(middle))] * len(x)
        for width in WIDTHS:
            open_columns = [k for k in range(len(x)) if best[k][0] > STRAIGHT]
            sides = iter(self._left([x + sign * width * steps[k] for k in open_columns for sign in (1.0, -1.0)]))
            for k, ahead, behind in zip(open_columns, sides, sides, strict=False):
                best[k] = min(
                    best[k], self._slope(x, middle, width * steps[k], ahead, behind), key=lambda pair: pair[0]
                )
        return np.array([slope for _, slope in best]).T

    def _slope(
        self, x: Array, middle: Array, step: Array, ahead: Array | Refused, behind: Array | Refused
    ) -> tuple[float, Array]:
        """Return the bend of a curve between points, relative to its change, and its slope; exact for parabolas."""
        width = float(step.sum())
        if not callable(ahead) and not callable(behind):
            rise, second = ahead - behind, ahead + behind - 2.0 * middle
            return _bend(second, rise), rise / (2.0 * width)
        sign, far = (-1.0, behind) if callable(ahead) else (1.0, ahead)
        (near,) = self._left([x + 0.5 * sign * step])
        if callable(far) or callable(near):
            return np.inf, np.zeros_like(middle)
        rise, second = 4.0 * near - far - 3.0 * middle, far - 2.0 * near + middle
        return _bend(second, far - middle), rise / (sign * width)

    def _missed(self, after: Mapping[str, Array], changes: Array, slopes: Array) -> list[str]:
        """Return the quantities whose remainders at the end are more than a small part of their changes.

        Args:
            after: Remainders at the end.
            changes: Changes from the start, shape (rows,).
            slopes: Changes at the start where a number changes by its size, shape (rows, k).
        """
        ends = np.cumsum([len(part) for part in after.values()])[:-1]
        split = (np.split(each, ends) for each in (self._joined(after), changes, slopes))
        return [
            name
            for name, left, change, slope in zip(after, *split, strict=True)
            if np.linalg.norm(left) > MET * max(np.linalg.norm(change), np.linalg.norm(slope))
        ]

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


def _bend(second: Array, rise: Array) -> float:
    change = float(np.linalg.norm(rise))
    return float(np.linalg.norm(second)) / change if change else np.inf


def _worst(parts: Mapping[str, Array]) -> dict[str, float]:
    return {name: float(np.abs(part).max()) for name, part in parts.items()}
