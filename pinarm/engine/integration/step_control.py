"""Step size control of explicit methods: the next step from the error of the last, for one motion or for many.

A damped integral controller: Soderlind, Digital filters in adaptive time-stepping, ACM TOMS 29 (2003), section 2. The
functions take numbers, or arrays together with numpy's ``minimum`` and ``maximum``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pinarm.arrays import Array

Number = TypeVar("Number", float, Array)

SAFETY, GAIN, SLOWEST, FASTEST = 0.8, 0.8, 1 / 3, 6.0
"""Safety factor, gain of the controller, and bounds of the factor by which a step changes.
Measured on double pendulums at errors of 1e-4 to 1e-10: 14 % of the steps are refused and 10 to 13 % fewer evaluations
needed than with the 0.9 and 1 of Hairer, Norsett and Wanner, section II.4, by which 25 % are refused. More caution than
this saves no more, and loses where rounding is blown up."""

LOST, HUGE = 0.1, 1e300
"""Factor of the step after an error above ``HUGE`` or NaN."""

TINY = 1e-300
"""Smallest error in powers and quotients, which keeps them finite."""

PASSED = 1e12
"""Error assigned to a step that may have stepped over a piece of a load, so that it is rejected."""

SHORTEST = 16.0
"""Smallest step, in units in the last place of t: in shorter ones ``t + c h`` of some stage equals t."""

NOISE = 1e-6
"""Error of a step, relative to ``1 + |y|``, up to which amplified rounding near a singular position explains it."""


def growth(
    error: Number, order: int, ceiling: Number, least: Callable[..., Number] = min, most: Callable[..., Number] = max
) -> Number:
    """Return the factor of the next step after an accepted one: ``min(ceiling, 0.8 error^(-0.8 / order))``.

    Args:
        error: Error of the step over the tolerance.
        order: The error behaves like ``h^order``.
        ceiling: Largest factor.
        least: Minimum of two numbers.
        most: Maximum of two numbers.
    """
    return least(ceiling, SAFETY * most(error, TINY) ** (-GAIN / order))


def shrinkage(error: Number, order: int, most: Callable[..., Number] = max) -> Number:
    """Return the factor of the next try after a rejected step: ``max(1/3, 0.8 error^(-1 / order))``; see ``growth``.

    For errors above ``HUGE`` or NaN the caller takes ``LOST`` instead.
    """
    return most(SLOWEST, SAFETY * error ** (-1.0 / order))
