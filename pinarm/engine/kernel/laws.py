"""Laws over time as the compiled library reads them: polynomials and waves, of efforts and of coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kernel.structures import LAW, LAW_TERMS
from pinarm.mechanics.laws.motion_law import PowerSeries, Stretched, Values, Wave

if TYPE_CHECKING:
    from numpy.typing import NDArray

EFFORT = -1
"""Place in q of what is no coordinate."""


class Followed(NamedTuple):
    """What follows a law.

    Attributes:
        v: Index in v.
        q: Index in q of the coordinate, whose joint's armature outweighs the tree; ``EFFORT`` where an effort does.
        function: The smooth piece of the law on the present interval.
    """

    v: int
    q: int
    function: Callable[[Array], Values] | None


def laws_of(followed: Sequence[Followed], steady: Array) -> NDArray[np.void] | None:
    """Return laws for the library, shape (k,), of ``structures.LAW``.

    Args:
        followed: What follows them.
        steady: The sum of the steady loads [N*m or N], shape (nv,), which act beside.

    Returns:
        ``None`` where a law is another one on the interval, or where two have one velocity.
    """
    numbers = [_numbers(one.function) for one in followed]
    known = [one for one in numbers if one is not None]
    if len(known) < len(numbers) or len({one.v for one in followed}) < len(followed):
        return None
    return np.array(
        [(one.v, one.q, steady[one.v], *each) for one, each in zip(followed, known, strict=True)], LAW
    )  # fmt: skip


def is_known(function: Callable[[Array], Values] | None) -> bool:
    """Return whether the library knows a piece of a law."""
    return _numbers(function) is not None


def _numbers(function: Callable[[Array], Values] | None) -> tuple[object, ...] | None:
    """Return start, size, origin, unit, amplitude, phase and coefficients; ``None`` where the function is another."""
    if isinstance(function, Wave):
        wave = function.start, function.size, function.begin, 1.0 / function.rate, 1.0, function.phase
        return (*wave, _filled((0.0, function.slope))) if function.rate > 0.0 else None
    if isinstance(function, PowerSeries):
        ends, shape = (0.0, 1.0, function.origin, 1.0), function
    elif isinstance(function, Stretched) and function.shape.origin == 0.0:
        ends, shape = (function.start, function.size, function.begin, function.duration), function.shape
    else:
        return None
    return (*ends, 0.0, 0.0, _filled(shape.coefficients)) if len(shape.coefficients) <= LAW_TERMS else None


def _filled(coefficients: tuple[float, ...]) -> tuple[float, ...]:
    return (*coefficients, *(LAW_TERMS - len(coefficients)) * (0.0,))
