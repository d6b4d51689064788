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

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
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


STEPS = np.array([1.0, 0.5, 0.25, -1.0, -0.5, -0.25])
"""Changes of an input that one round takes, relative to the largest."""


@dataclass(eq=False)
class _Sought:
    """Derivatives by one input while they are looked for.

    Attributes:
        step: First and largest change.
        best: Those of the least error so far; none where no run has succeeded on both sides.
        failure: Why a run failed.
    """

    step: float
    best: list[Derivative] = field(default_factory=list)
    failure: str = ""

    def settled_by(self, rows: Iterable[Row], at_zero: Array, step: float, noise: Array) -> bool:
        """Take in the rows of one round, and tell whether no smaller steps are needed."""
        rows = [*rows]
        self.failure = next((row.error for row in rows if row.error), self.failure)
        if any(row.error for row in rows):
            return False
        taken = np.array([row.taken for row in rows]).reshape(2, 3, -1)
        found = _differences(taken[0], taken[1], at_zero, step, noise)
        new = [found.derivative(k) for k in range(len(at_zero))]
        pairs = zip(self.best or new, new, strict=True)
        self.best = [min(pair, key=lambda each: each.error) for pair in pairs]
        return all(found.settled(k) for k in range(len(at_zero)))


def derivatives(
    varied: Varied, at_zero: Array, step_of: Callable[[Input], float], noise: Array
) -> list[list[Derivative]]:
    """Return the derivatives of several numbers by every input, those of a round solved at once.

    Args:
        varied: The numbers, m of them.
        at_zero: The numbers without a change, shape (m,).
        step_of: Input -> its first and largest change.
        noise: Error of the numbers that changes irregularly from run to run, shape (m,).

    Raises:
        InputError: No run succeeds on both sides of an input, however small the step.
    """
    sought = [_Sought(step_of(each)) for each in varied.inputs]
    left, unit = list(range(len(sought))), np.eye(len(sought))
    for attempt in range(ROUNDS):
        steps = {k: sought[k].step / SHRINK**attempt for k in left}
        if not left:
            break
        rows = varied.rows(np.concatenate([np.outer(step * STEPS, unit[k]) for k, step in steps.items()]))
        left = [k for k, step in steps.items()
                if not sought[k].settled_by(islice(rows, len(STEPS)), at_zero, step, noise)]  # fmt: skip
    for each, of in zip(sought, varied.inputs, strict=True):
        if not each.best:
            with within("to", of.name):
                raise InputError(f"no run succeeds on both sides of {of.text(of.value)}: {each.failure}",
                                 hint="another value, from which the mechanism can be changed both ways")  # fmt: skip
    return [each.best for each in sought]


def _differences(ahead: Array, behind: Array, at_zero: Array, step: float, noise: Array) -> _Differences:
    """Return derivatives by the numbers ahead and behind, both of shape (3, m), for steps halved each time."""
    steps = step / 2.0 ** np.arange(3)
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
