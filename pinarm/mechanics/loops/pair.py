"""What a loop joint holds between its two frames: rows ``e . p' + w . omega = 0``.

With frame 1 on the first link and frame 2 on the second, ``p`` is the place of frame 2's origin and R its orientation,
both seen from frame 1, and ``omega`` the angular velocity of 2 in 1. Every row has a direction e of translation and a
direction w of rotation, in the axes of frame 1. A row with an e measures a length, and w is a way per angle [m/rad]; a
row without one measures an angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.geometry.vectors import Axes

NOTHING, ALL = np.zeros((0, 3)), np.eye(3)
"""No directions, and all three."""


class Pair(Protocol):
    """What a kind of joint holds between its two frames, in one configuration or in n of them.

    All vectors are in the axes of frame 1; (..) stands for nothing or for n. ``axes`` are those of frame 2.
    """

    @property
    def along(self) -> Sequence[bool]:
        """Which of the m rows have a direction e of translation: these measure lengths, the others angles."""
        ...

    @property
    def about(self) -> Sequence[bool]:
        """Which of the m rows have a direction w of rotation."""
        ...

    @property
    def constant(self) -> tuple[Array, Array] | None:
        """The directions e and w where they are the same in all configurations, each of shape (m, 3)."""
        ...

    def gap(self, p: Array, axes: Axes) -> list[Array]:
        """Return what is not closed in every row [m or rad], shape (..) or (1,)."""
        ...

    def directions(self, p: Array, axes: Axes) -> tuple[Array, Array]:
        """Return e and w of all rows, each of shape (m, 3, ..), 0 where a row has none.

        Without their last axis where they are the same in all configurations.
        """
        ...

    def bend(self, p: Array, axes: Axes, dp: Array, omega: Array) -> Array:
        """Return what the change of the directions does, ``e' . p' + w' . omega``, shape (m, ..)."""
        ...
