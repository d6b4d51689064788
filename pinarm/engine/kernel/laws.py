"""Laws over time as the compiled library reads them: polynomials, waves and splines, of efforts and of coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kernel.structures import LAW, LAW_TERMS
from pinarm.mechanics.laws.clamped_spline import ClampedSpline
from pinarm.mechanics.laws.motion_law import PowerSeries, Stretched, Values, Wave

if TYPE_CHECKING:
    from numpy.typing import NDArray

EFFORT = -1
"""Place in q of what is no coordinate."""

MOST_CUBICS = 10_000
"""Most cubics of a spline: the library looks through all of them, at 1 to 2 ns each, for that of an instant."""


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
    """Return laws for the library, shape (k,), of ``structures.LAW``: of a spline one for each of its cubics.

    Args:
        followed: What follows them.
        steady: The sum of the steady loads [N*m or N], shape (nv,), which act beside.

    Returns:
        ``None`` where a law is another one on the interval, or where two have one velocity.
    """
    parts: list[NDArray[np.void]] = [np.zeros(0, LAW)]
    for one in followed:
        known = _parts(one.function)
        if known is None:
            return None
        known["v"], known["q"], known["steady"] = one.v, one.q, steady[one.v]
        parts.append(known)
    return np.concatenate(parts) if len({one.v for one in followed}) == len(followed) else None


def is_known(function: Callable[[Array], Values] | None) -> bool:
    """Return whether the library knows a piece of a law."""
    return _parts(function) is not None


def _parts(function: Callable[[Array], Values] | None) -> NDArray[np.void] | None:
    """Return what a function is on its intervals, shape (k,), of ``LAW``; ``None`` where it is another one."""
    if isinstance(function, ClampedSpline):
        return _cubics(function)
    if isinstance(function, Wave):
        wave = function.start, function.size, function.begin, 1.0 / function.rate, 1.0, function.phase
        return _one(wave, (0.0, function.slope)) if function.rate > 0.0 else None
    if isinstance(function, PowerSeries):
        return _one((0.0, 1.0, function.origin, 1.0, 0.0, 0.0), function.coefficients)
    if isinstance(function, Stretched) and function.shape.origin == 0.0:
        ends = function.start, function.size, function.begin, function.duration
        return _one((*ends, 0.0, 0.0), function.shape.coefficients)
    return None


def _one(numbers: tuple[float, ...], coefficients: tuple[float, ...]) -> NDArray[np.void] | None:
    """Return a law that holds at all times, given start, size, origin, unit, amplitude and phase."""
    if len(coefficients) > LAW_TERMS:
        return None
    filled = (*coefficients, *(LAW_TERMS - len(coefficients)) * (0.0,))
    return np.array([(EFFORT, EFFORT, -np.inf, np.inf, 0.0, *numbers, filled)], LAW)


def _cubics(spline: ClampedSpline) -> NDArray[np.void] | None:
    """Return the cubics of a spline, the first and the last without end; ``None`` of more than are looked through."""
    n = spline.coefficients.shape[1]
    if n > MOST_CUBICS:
        return None
    cubics = np.zeros(n, LAW)
    cubics["from"][0], cubics["from"][1:] = -np.inf, spline.knots[1:-1]
    cubics["until"][-1], cubics["until"][:-1] = np.inf, spline.knots[1:-1]
    cubics["origin"], cubics["size"], cubics["unit"] = spline.knots[:-1], 1.0, 1.0
    cubics["coefficients"][:, :4] = spline.coefficients.T
    return cubics
