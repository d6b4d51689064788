"""Derivatives of numbers that whole runs give: differences, extrapolated to steps of 0, with their errors.

With f(h) the number where an input is changed by h, for h, h/2 and h/4:

    c(h) = (f(h) - f(-h)) / 2h = f' + a h² + b h⁴ + ...,    r(h) = (f(h) - f(0)) / h = f' + a h + b h² + ...

Two rounds of Richardson's extrapolation leave ``O(h⁶)`` of the central and ``O(h³)`` of each one-sided derivative. The
last correction tells what is left where h is small. Where it is not, it may be small by accident; of a series whose
terms go down like ``q^n`` the one-sided derivatives keep ``~ q³`` of f' and the central one ``~ q⁶``, the square of it.
So what is left is at least told as ``2 d² / f'`` with the distance d between them. The error e of the numbers
themselves makes ``4 e / h`` of it; both are least together for ``h ~ e^(1/7)``. Where the two one-sided derivatives
differ by more than their errors, the number has a kink there: a maximum that moves from one instant to another.

A step over which the number is no such series, as where an oscillation turns by several radians, may look settled by
accident. So a step is enough only where all three derivatives are about the same; otherwise smaller steps are taken
too, which contradict larger ones by what they differ beyond their own errors. Derivatives that differ from one another,
other than those at a kink that is found again with another step, are as wrong as they differ.

Source: Ridders, Accurate computation of F'(x) and F'(x) F''(x), Advances in Engineering Software 4 (1982).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.use.assessments.sensitivity.variation import Input, Varied
from pinarm.use.cases.case import Row

SHRINK, ROUNDS = 16.0, 3
"""Factor by which steps are made smaller where the error is not small yet, and how often that is tried."""

GOOD = 1e-6
"""Error of a derivative, relative to it, that is small enough."""

CONVINCING = 1e-4
"""Error of a derivative, relative to it, that is hardly small by accident: enough where it is that of the numbers."""

REGULAR = 0.05
"""Difference of one-sided derivatives from the central one, over the difference quotients, up to which a step is small
enough for a power series."""

KINK = 1e-3
"""Difference of one-sided derivatives, relative to their sizes, that makes a kink."""

SQUARE = 2.0
"""Error of central differences over the squared error of one-sided ones, both relative to the quotient."""

DOUBT = 2.0
"""Error of a derivative over what smaller steps contradict: these are wrong themselves, by about as much."""


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
    """Derivatives of several numbers by steps of one size, and their errors, each of shape (m,).

    ``quotient`` is the larger one-sided quotient of differences over the whole step, ``rounding`` what the noise of the
    numbers makes of a difference over the smallest one.
    """

    central: Array
    error: Array
    left: Array
    right: Array
    one_sided_error: Array
    quotient: Array
    rounding: Array

    def derivative(self, k: int) -> Derivative:
        left, right, sided = float(self.left[k]), float(self.right[k]), float(self.one_sided_error[k])
        if abs(right - left) > KINK * (abs(left) + abs(right)) + 10.0 * sided:
            return Derivative(max(left, right, key=abs), sided, left, right, kink=True)
        return Derivative(float(self.central[k]), float(self.error[k]), left, right)

    def settled(self, k: int) -> bool:
        derivative = self.derivative(k)
        if self.quotient[k] <= self.rounding[k]:
            return True  # it does not depend on the input
        excused = min(10.0 * float(self.rounding[k]), CONVINCING * abs(derivative.value))
        return derivative.error <= GOOD * abs(derivative.value) + excused and self.apart(k) <= self.alike(k)

    def apart(self, k: int) -> float:
        return float(max(abs(self.left[k] - self.central[k]), abs(self.right[k] - self.central[k])))

    def alike(self, k: int) -> float:
        return float(REGULAR * self.quotient[k] + 8.0 * self.rounding[k])

    def finds(self, other: _Differences, k: int) -> bool:
        """Tell whether another step has given about the same derivatives on both sides."""
        alike = REGULAR * min(self.quotient[k], other.quotient[k]) + 8.0 * (self.rounding[k] + other.rounding[k])
        return bool(self.moved(other, k) <= alike)

    def moved(self, other: _Differences, k: int) -> float:
        return float(max(abs(self.left[k] - other.left[k]), abs(self.right[k] - other.right[k])))

    def contradicted(self, finer: _Differences, k: int) -> float:
        """Return the error that smaller steps show: of both sides at a kink, which they may be too small to see."""
        if self.derivative(k).kink:
            return DOUBT * self.moved(finer, k) - float(finer.one_sided_error[k])
        return float(DOUBT * abs(self.central[k] - finer.central[k]) - finer.error[k])


STEPS = np.array([1.0, 0.5, 0.25, -1.0, -0.5, -0.25])
"""Changes of an input that one round takes, relative to the largest."""


@dataclass(eq=False)
class _Sought:
    """Derivatives by one input while they are looked for.

    Attributes:
        step: First and largest change.
        rounds: Those of all steps with which all runs succeeded, from large to small ones.
        failure: Why a run failed.
    """

    step: float
    rounds: list[_Differences] = field(default_factory=list)
    failure: str = ""

    def settled_by(self, rows: Iterable[Row], at_zero: Array, step: float, noise: Array) -> bool:
        """Take in the rows of one round, and tell whether no smaller steps are needed."""
        rows = [*rows]
        self.failure = next((row.error for row in rows if row.error), self.failure)
        if any(row.error for row in rows):
            return False
        taken = np.array([row.taken for row in rows]).reshape(2, 3, -1)
        differences = _differences(taken[0], taken[1], at_zero, step, noise)
        self.rounds.append(differences)
        return all(differences.settled(k) or self._is_kink(k) for k in range(len(at_zero)))

    def _is_kink(self, k: int) -> bool:
        """Tell whether the last two steps have found the same kink."""
        last = self.rounds[-2:]
        return (
            len(last) == 2 and all(differences.derivative(k).kink for differences in last) and last[0].finds(last[1], k)
        )

    def best(self, k: int) -> Derivative:
        """Return the derivative of number k with the least error, after what the other steps say of it."""
        derivatives, rounds = [differences.derivative(k) for differences in self.rounds], self.rounds
        errors = [derivative.error for derivative in derivatives]
        for n, differences in enumerate(rounds):
            errors[n] = max([errors[n], *(differences.contradicted(finer, k) for finer in rounds[n + 1 :])])
            again = derivatives[n].kink and any(
                differences.finds(other, k) for other in rounds if other is not differences
            )
            if differences.apart(k) > differences.alike(k) and not again:
                errors[n] = max(errors[n], differences.apart(k))
        least = int(np.argmin(errors))
        return replace(derivatives[least], error=errors[least])


def derivatives(
    varied: Varied, at_zero: Array, step_of: Callable[[Input], float], noise: Array
) -> list[list[Derivative]]:
    """Return the derivatives of several numbers by every input, those of a round solved at once.

    Args:
        varied: The numbers, m of them.
        at_zero: The numbers without a change, shape (m,).
        step_of: Input -> its first and largest change.
        noise: Error of the numbers that changes irregularly from run to run, shape (m,).
    """
    sought = [_Sought(step_of(search)) for search in varied.inputs]
    left, unit = list(range(len(sought))), np.eye(len(sought))
    for attempt in range(ROUNDS):
        steps = {k: sought[k].step / SHRINK**attempt for k in left}
        if not left:
            break
        rows = varied.rows(np.concatenate([np.outer(step * STEPS, unit[k]) for k, step in steps.items()]))
        left = [
            k for k, step in steps.items() if not sought[k].settled_by(islice(rows, len(STEPS)), at_zero, step, noise)
        ]
    for search, of in zip(sought, varied.inputs, strict=True):
        if not search.rounds:
            with within("to", of.name):
                raise InputError(
                    f"no run succeeds on both sides of {of.text(of.value)}: {search.failure}",
                    hint="another value, from which the mechanism can be changed both ways",
                )
    return [[search.best(k) for k in range(len(at_zero))] for search in sought]


def _differences(ahead: Array, behind: Array, at_zero: Array, step: float, noise: Array) -> _Differences:
    steps = step / 2.0 ** np.arange(3)
    h = steps[:, None]
    central, correction = _extrapolated((ahead - behind) / (2.0 * h), 2)
    right, above = _extrapolated((ahead - at_zero) / h, 1)
    left, below = _extrapolated((at_zero - behind) / h, 1)
    rounding = noise / steps[-1]
    quotient = np.maximum(np.abs(ahead[0] - at_zero), np.abs(at_zero - behind[0])) / step
    apart = np.maximum(np.abs(right - central), np.abs(left - central))
    left_out = np.maximum(correction, SQUARE * apart**2 / np.where(quotient > 0.0, quotient, np.inf))
    error, sided = left_out + 2.0 * rounding, np.maximum(above, below) + 8.0 * rounding
    return _Differences(central, error, left, right, sided, quotient, rounding)


def _extrapolated(differences: Array, order: int) -> tuple[Array, Array]:
    """Return three differences of steps halved each time, extrapolated, shape (m,), and the last correction.

    Args:
        differences: Shape (3, m).
        order: Of the first power of the step in them, and the distance to the next.
    """
    first, second = 2.0**order, 2.0 ** (2 * order)
    once = (first * differences[1:] - differences[:-1]) / (first - 1.0)
    twice = (second * once[1] - once[0]) / (second - 1.0)
    return twice, np.abs(twice - once[1])
