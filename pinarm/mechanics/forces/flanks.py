"""Flanks with backlash between two sides of a gear: free travel, then a spring and damper that only push."""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.errors import within
from pinarm.input.units import unit
from pinarm.input.yaml.schema import check_unit
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.drives import Elasticity
from pinarm.mechanics.forces.along_coordinate import TOUCHING, AlongCoordinate, SpringAlong, effort_along
from pinarm.mechanics.forces.breakpoints import Pieces
from pinarm.mechanics.forces.force_element import Edge, ForceElement


def elastic_gear(
    model: pin.Model, deflection: LinearCoordinate, elasticity: Elasticity, backlash: float
) -> ForceElement:  # fmt: skip
    """Return the spring and damper of an elastic gear, or its flanks.

    Args:
        model: Pinocchio's model.
        deflection: w, of the rotor less what it drives.
        elasticity: Stiffness and damping.
        backlash: [rad or m].

    Raises:
        UnitError: A unit is not that of what is driven.
    """
    stiff = effort_along(deflection) / deflection.unit
    given = ("stiffness", elasticity.stiffness, stiff), ("damping", elasticity.damping, stiff * unit("s"))
    for key, value, expected in given:
        with within("elasticity", key):
            check_unit(value, expected)
    with within("backlash"):
        check_unit(backlash, deflection.unit)
    spring = SpringAlong(model, deflection, float(elasticity.stiffness), float(elasticity.damping), 0.0)
    return Flanks(model, deflection, spring, 0.5 * float(backlash)) if backlash else spring


class Flanks(AlongCoordinate, frozen=True):
    """``effort = -max(k (w - h) + c w', 0)`` for w > h, its mirror image for w < -h, and 0 between.

    Steps end where a flank is met or left and, with a damper, where it stops pushing.

    Attributes:
        spring: Stiffness k and damping c of the flanks.
        half: h, half of the backlash [rad or m].
    """

    spring: SpringAlong
    half: float

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        side = np.sign(np.real(w))
        push = np.maximum(self._push(side, w, rate), 0.0)
        return np.asarray(np.where(self._touches(side, w), -side * push, 0.0))

    def _push(self, side: Array | float, w: Array, rate: Array) -> Array:
        return np.asarray(self.spring.stiffness * (side * w - self.half) + self.spring.damping * side * rate)

    def potential_energy(self, q: Array) -> Array:
        """Return ``k d^2 / 2`` of the compression d of a flank."""
        return np.asarray(0.5 * self.spring.stiffness * self._compression(self._deflection(q)) ** 2)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return ``-(effort + k d) w'``: of the damper, and of a flank that is left before it has sprung back."""
        w, rows = self._evaluated(q, v)
        rate = (rows * v).sum(axis=-1)
        stored = self.spring.stiffness * np.sign(w) * self._compression(w)
        return np.asarray(-(self.effort(t, w, rate) + stored) * rate)

    @property
    def conservative(self) -> bool:
        return not self.spring.damping

    def edges(self) -> list[Edge]:
        """Return where the flanks begin to touch and, with a damper, where they stop pushing while they touch."""
        found: list[Edge] = []
        for side in (1.0, -1.0):
            found.append(self._edge(lambda w, rate, side=side: side * w - self.half))  # type: ignore[misc]
            if self.spring.damping:
                push, touches = partial(self._push, side), partial(self._touches, side)
                found.append(self._edge(push, touches))
        return found

    def _touches(self, side: Array | float, w: Array) -> Flags:
        return np.asarray(side * w > self.half - TOUCHING * (1.0 + self.half))

    @property
    def in_pieces(self) -> bool:
        """Whether there are pieces: there are."""
        return True

    def passed(self, q: Array, v: Array) -> bool:
        return self._pieces.passed(self._deflection(q))

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(np.array([-self.half, self.half]))

    def _deflection(self, q: Array) -> Array:
        return self._evaluated(q, np.zeros((*q.shape[:-1], self.model.nv)))[0]

    def _compression(self, w: Array) -> Array:
        return np.asarray(np.maximum(np.abs(w) - self.half, 0.0))
