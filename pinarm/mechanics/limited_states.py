"""States that are kept within limits, such as a current or an integral, by events and modes.

Such a state is free until it reaches a limit, is held there as long as its rate points outwards, and is free again from
the instant at which the rate changes its sign. Both instants are events, and the mode between them says which equation
holds. Without modes the last digit of the state at the limit would: each evaluation could take the other equation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from pinarm.arrays import Array

FREE, HIGHEST, LOWEST = 0, 1, 2
"""Modes: within the limits, held at the upper one, held at the lower one."""

ROUNDING = 1e-9
"""Part of a limit by which a state that is integrated may miss it; part of its terms below which a rate is none."""

Inputs = TypeVar("Inputs")


class Switch(NamedTuple, Generic[Inputs]):
    """A zero crossing at which a mode changes, or a value stops being smooth.

    Attributes:
        value: Of the inputs at many instants, shape (n,).
        direction: 1 for rising crossings, -1 for falling ones, 0 for both.
        mode: Mode afterwards; ``None`` for the same.
        jumps: Whether the value may also change its sign at once, where a sampled controller acts. As long as the mode
            lasts ``-direction * value`` is not negative.
        leaps: Whether what is given leaps there, as the output of a relay does.
    """

    value: Callable[[Inputs], Array]
    direction: int = 0
    mode: int | None = None
    jumps: bool = False
    leaps: bool = False


class StateLimits(NamedTuple):
    """Limits of a state; infinite for none."""

    lower: float
    upper: float

    def mode(self, value: float, rate: float, scale: float, before: int) -> int:
        """Return the mode at the start of a smooth stretch.

        A free state at a limit is held where its rate points outwards: rates jump, and two states may reach their
        limits at one instant, of which one event is located. A rate of rounding holds nothing: it is that of the
        instant at which a state was let go.
        """
        for mode, limit, sign in ((HIGHEST, self.upper, 1.0), (LOWEST, self.lower, -1.0)):
            if not np.isfinite(limit):
                continue
            at_limit, outwards = sign * (value - limit) >= -ROUNDING * abs(limit), sign * rate
            if (before == mode and outwards >= 0.0) or (at_limit and outwards > ROUNDING * scale):
                return mode
        return FREE

    def switches(
        self, mode: int, value: Callable[[Inputs], Array], rate: Callable[[Inputs], Array]
    ) -> list[Switch[Inputs]]:
        if mode != FREE:
            return [Switch(rate, -1 if mode == HIGHEST else 1, FREE, jumps=True)]
        lower, upper = self
        reached: list[Switch[Inputs]] = []
        if np.isfinite(upper):
            reached.append(Switch(lambda given: value(given) - upper, 1, HIGHEST))
        if np.isfinite(lower):
            reached.append(Switch(lambda given: value(given) - lower, -1, LOWEST))
        return reached
