"""Slopes of what is wanted over numbers that are to be found, by differences whose widths follow these numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import PinarmError

WIDTH = 1e-3
"""Half width of a difference, relative to the size of the number."""

LEAST = 1e-3
"""Size of a number that comes near 0, relative to the largest that it has had."""

STRAIGHT = 1e-2
"""Second difference, relative to the first, up to which a width is taken: above it the curve bends between the places,
or the number changes it by less than its rounding."""

OTHER_WIDTHS = (10.0, 0.1, 100.0, 0.01, 1e3, 1e-3, 1e4, 1e-4)
"""Widths that are tried besides, relative to the last one, in this order."""

Refused = Callable[[], PinarmError]
"""Tells why something cannot be run."""

Curves = Callable[[Sequence[Array]], Sequence["Array | Refused"]]
"""Several points, each of shape (k,) in SI -> what is left of what is wanted there, shape (rows,)."""


@dataclass(frozen=True)
class _Slope:
    """A slope.

    Attributes:
        values: Of each row, shape (rows,).
        bend: Second difference relative to the first.
        width: Half width.
    """

    values: Array
    bend: float
    width: float


@dataclass(eq=False)
class Differences:
    """Differences about points of a search.

    Attributes:
        curves: What they are of.
        units: SI values of one unit of each number, shape (k,): their sizes where they are 0 at the start.
        sizes: Sizes of the numbers, shape (k,).
    """

    curves: Curves
    units: Array
    sizes: Array = field(init=False)
    _largest: Array = field(init=False)
    _relative: Array = field(init=False)
    _least: Array = field(init=False)

    def __post_init__(self) -> None:
        self.sizes = self._largest = self._least = np.zeros(len(self.units))
        self._relative = np.full(len(self.units), WIDTH)

    def jacobian(self, x: Array, left: Array) -> Array:
        """Return the slopes at a point, shape (rows, k): central ones, one-sided ones where a side cannot be run.

        With h the half width and f what is left, ``(f(x + h) - f(x - h))/(2 h)``, or ``(4 f(x + h/2) - f(x + h) -
        3 f(x))/h``: exact where f is a polynomial of degree 2.

        Args:
            x: The point, shape (k,).
            left: What is left there, shape (rows,).

        Raises:
            PinarmError: Neither side can be run, however near.
        """
        self._resize(x)
        steps = np.diag(self.widths)
        sides = self.curves([x + sign * step for step in steps for sign in (1.0, -1.0)])
        columns = []
        for k in range(len(x)):
            found = self._slope(x, left, k, sides[2 * k : 2 * k + 2])
            self._relative[k] = found.width / self.sizes[k]
            columns.append(found.values)
        return np.array(columns).T

    @property
    def widths(self) -> Array:
        """Half widths of the differences, shape (k,)."""
        return self._relative * self.sizes

    def renewed(self) -> bool:
        """Begin anew with the first width, and tell whether another one was in use.

        Curves that bend may by accident look straight across a wide width: what it says is not what is near the point.
        """
        used = self._relative.copy()
        self._relative[:] = WIDTH
        return bool((used != WIDTH).any())

    def _resize(self, x: Array) -> None:
        """Let sizes follow the point; numbers that leave 0 are as large as they become, or as a width about 0 was."""
        left = (self._largest == 0.0) & (x != 0.0)
        self._least = np.where(left, self.widths, self._least)
        self._relative[left] = WIDTH
        self._largest = np.maximum(self._largest, np.abs(x))
        own = np.maximum(np.maximum(np.abs(x), LEAST * self._largest), self._least)
        self.sizes = np.where(self._largest > 0.0, own, self.units)

    def _slope(self, x: Array, left: Array, k: int, sides: Sequence[Array | Refused]) -> _Slope:
        """Return the slopes over one number: the first width across which the curves are straight, else the best."""
        best = self._across(x, left, k, self._relative[k] * self.sizes[k], sides)
        for width in self._widths(k) if best is None or best.bend > STRAIGHT else ():
            step = width * np.eye(len(x))[k]
            other = self._across(x, left, k, width, self.curves([x + step, x - step]))
            best = min((one for one in (best, other) if one), key=lambda one: one.bend, default=None)
            if best and best.bend <= STRAIGHT:
                break
        if best is None:
            raise next(side for side in sides if callable(side))()
        return best

    def _widths(self, k: int) -> Iterator[float]:
        """Yield the widths to try besides."""
        for factor in OTHER_WIDTHS:
            yield float(factor * self._relative[k] * self.sizes[k])
        yield float(WIDTH * self.units[k])

    def _across(self, x: Array, left: Array, k: int, width: float, sides: Sequence[Array | Refused]) -> _Slope | None:
        """Return the slopes with one width; none where neither side can be run."""
        ahead, behind = sides
        if not callable(ahead) and not callable(behind):
            return _slope(ahead - behind, ahead + behind - 2.0 * left, ahead - behind, 2.0 * width, width)
        sign, far = (-1.0, behind) if callable(ahead) else (1.0, ahead)
        if callable(far):
            return None
        (near,) = self.curves([x + 0.5 * sign * width * np.eye(len(x))[k]])
        if callable(near):
            return None
        return _slope(4.0 * near - far - 3.0 * left, far - 2.0 * near + left, far - left, sign * width, width)


def _slope(rise: Array, second: Array, first: Array, run: float, width: float) -> _Slope:
    change = float(np.linalg.norm(first))
    return _Slope(rise / run, float(np.linalg.norm(second)) / change if change else np.inf, width)
