"""Derivatives of numbers that whole runs give: differences, extrapolated to steps of 0, with their errors.

With f(h) the number where an input is changed by h, for h, h/2 and h/4:

    c(h) = (f(h) - f(-h)) / 2h = f' + a h² + b h⁴ + ...,    r(h) = (f(h) - f(0)) / h = f' + a h + b h² + ...

Two rounds of Richardson's extrapolation leave ``O(h⁶)`` of the central and ``O(h³)`` of each one-sided derivative. The
last correction tells what is left, and the error e of the numbers themselves makes ``4 e / h`` of it; both are least
together for ``h ~ e^(1/7)``. Where the two one-sided derivatives differ by more than their errors, the number has a
kink there: a maximum that moves from one instant to another.

Source: Ridders, Accurate computation of F'(x) and F'(x) F''(x), Advances in Engineering Software 4 (1982).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import PinarmError

SHRINK, ROUNDS = 16.0, 3
"""Factor by which steps are made smaller where the error is not small yet, and how often that is tried."""

GOOD = 1e-6
"""Error of a derivative, relative to it, that is small enough."""

KINK = 1e-3
"""Difference of one-sided derivatives, relative to their sizes, that makes a kink."""


@dataclass(frozen=True)
class Derivative:
    """A derivative.

    Attributes:
        value: Of central differences; at a kink, that of the steeper side.
        error: Estimate of its error.
        left: Derivative below.
        right: Derivative above.
        kink: Whether these differ.
    """

    value: float
    error: float
    left: float
    right: float
    kink: bool = False


@dataclass(frozen=True)
class _Differences:
    """Derivatives of several numbers by steps of one size, and their errors, each of shape (m,)."""

    central: Array
    error: Array
    left: Array
    right: Array
    one_sided_error: Array
    rounding: Array

    def derivative(self, k: int) -> Derivative:
        left, right, sided = float(self.left[k]), float(self.right[k]), float(self.one_sided_error[k])
        if abs(right - left) > KINK * (abs(left) + abs(right)) + 10.0 * sided:
            return Derivative(max(left, right, key=abs), sided, left, right, kink=True)
        return Derivative(float(self.central[k]), float(self.error[k]), left, right)

    def settled(self, k: int) -> bool:
        found = self.derivative(k)
        return found.error <= GOOD * abs(found.value) + 10.0 * float(self.rounding[k])


def derivatives(numbers: Callable[[float], Array], at_zero: Array, step: float, noise: Array) -> list[Derivative]:
    """Return the derivatives of several numbers by one input.

    Args:
        numbers: Change of the input -> the numbers, shape (m,).
        at_zero: The numbers without a change, shape (m,).
        step: First and largest change.
        noise: Error of the numbers that changes irregularly from run to run, shape (m,).

    Raises:
        PinarmError: No run succeeds on both sides, however small the step.
    """
    best: list[Derivative] = []
    for attempt in range(ROUNDS):
        try:
            found = _differences(numbers, at_zero, step / SHRINK**attempt, noise)
        except PinarmError:
            if attempt == ROUNDS - 1 and not best:
                raise
            continue
        new = [found.derivative(k) for k in range(len(at_zero))]
        best = [min(pair, key=lambda each: each.error) for pair in zip(best, new, strict=True)] if best else new
        if all(found.settled(k) for k in range(len(at_zero))):
            break
    return best


def _differences(numbers: Callable[[float], Array], at_zero: Array, step: float, noise: Array) -> _Differences:
    steps = step / 2.0 ** np.arange(3)
    ahead, behind = (np.array([numbers(sign * h) for h in steps]) for sign in (1.0, -1.0))
    h = steps[:, None]
    central, error = _extrapolated((ahead - behind) / (2.0 * h), 2)
    right, above = _extrapolated((ahead - at_zero) / h, 1)
    left, below = _extrapolated((at_zero - behind) / h, 1)
    rounding = noise / steps[-1]
    return _Differences(central, error + 2.0 * rounding, left, right, np.maximum(above, below) + 8.0 * rounding,
                        rounding)  # fmt: skip


def _extrapolated(differences: Array, order: int) -> tuple[Array, Array]:
    """Return three differences of steps halved each time, extrapolated, and the last correction, shape (m,).

    Args:
        differences: Shape (3, m).
        order: Of the first power of the step in them, and the distance to the next.
    """
    first, second = 2.0**order, 2.0 ** (2 * order)
    once = (first * differences[1:] - differences[:-1]) / (first - 1.0)
    twice = (second * once[1] - once[0]) / (second - 1.0)
    return twice, np.abs(twice - once[1])
