"""Springs, dampers, stops, elastic cables and efforts along coordinates, of joints, loop joints, points, distances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.errors import within
from pinarm.input.units import unit
from pinarm.input.yaml.schema import AnyQuantity, Damping, InputStruct, NotNegative, Span, Stiffness, check_unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PathLength, coordinate_of
from pinarm.mechanics.forces.force_element import Edge, ElementQuantity, ForceElement, LawElement, Pieces
from pinarm.mechanics.forces.load_conditions import LoadCondition, LoadKeys, MeasuredCoordinate
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE, Joint, effort_unit
from pinarm.mechanics.laws import Law
from pinarm.mechanics.laws.motion_law import MotionLaw, Values

if TYPE_CHECKING:
    from pinarm.mechanics.rotors import Elasticity

TOUCHING = 1e-13
"""Gap, relative to ``1 + |w|`` in SI, at which what pushes or pulls one way counts as closed: where it closes it is at
work, though rounding may leave it open there."""


class AlongCoordinate(MeasuredCoordinate, ForceElement, frozen=True):
    """An effort along a coordinate w with the row J, ``load = J^T effort``; fields as in ``MeasuredCoordinate``."""

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        """Return the effort [N*m or N] for values w and their rates, each of shape (n,)."""
        raise NotImplementedError

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load ``J^T effort`` to ``tau``."""
        w, rate, rows = self.moving(q, v)
        tau += np.asarray(self.effort(t, w, rate))[..., None] * rows

    def wrenches(self, links: LinkPlacements, t: Array, v: Array) -> dict[int, Array]:
        return self.coordinate.wrenches(links, self.efforts(t, links.q, v))

    def measures(self) -> Mapping[str, ElementQuantity]:
        return {"effort": ElementQuantity(effort_unit(self.coordinate), self.efforts)}

    def efforts(self, t: Array, q: Array, v: Array) -> Array:
        w, rate, _ = self.moving(q, v)
        return np.broadcast_to(self.effort(t, w, rate), w.shape)


class SpringAlong(AlongCoordinate, frozen=True):
    """Spring and damper, and a constant pull: ``effort = -stiffness (w - rest) - damping w' - pull``.

    The energy is ``stiffness (w - rest)^2 / 2 + pull (w - rest)``.

    Attributes:
        stiffness: [N*m/rad or N/m].
        damping: [N*m*s/rad or N*s/m].
        rest: Value at which the spring is free [rad or m].
        force: The pull [N*m or N].
    """

    stiffness: float
    damping: float
    rest: float
    force: float = 0.0

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        return np.asarray(-self.stiffness * (w - self.rest) - self.damping * rate - self.force)

    def potential_energy(self, q: Array) -> Array:
        stretched = self.values(q) - self.rest
        return np.asarray(0.5 * self.stiffness * stretched**2 + self.force * stretched)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        if not self.damping:
            return np.zeros(q.shape[:-1])
        return np.asarray(self.damping * self.moving(q, v)[1] ** 2)

    @property
    def conservative(self) -> bool:
        return not self.damping


class StopSpring(AlongCoordinate, frozen=True):
    """``effort = -max(k (w - h) + c w', 0)`` for w > h, its mirror image for w < -h, and 0 between.

    Such as the flanks of a gear with the backlash 2 h: free travel, then springs and dampers that only push. Steps end
    where a side is met or left and, with a damper, where it stops pushing.

    Attributes:
        stiffness: k [N*m/rad or N/m].
        damping: c [N*m*s/rad or N*s/m].
        half: h [rad or m].
    """

    stiffness: float
    damping: float
    half: float
    sides: tuple[float, ...] = (1.0, -1.0)

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        side = self._side(w)
        push = np.maximum(self._push(side, w, rate), 0.0)
        return np.asarray(np.where(self._touches(side, w), -side * push, 0.0))

    def _side(self, w: Array) -> Array:
        return np.where(np.real(w) < 0.0, -1.0, 1.0) if len(self.sides) > 1 else np.ones(w.shape)

    def _push(self, side: Array | float, w: Array, rate: Array) -> Array:
        return np.asarray(self.stiffness * (side * w - self.half) + self.damping * side * rate)

    def _touches(self, side: Array | float, w: Array) -> Flags:
        return np.asarray(side * w > self.half - TOUCHING * (1.0 + self.half))

    def _compression(self, w: Array) -> Array:
        return np.asarray(np.maximum(self._side(w) * w - self.half, 0.0))

    def potential_energy(self, q: Array) -> Array:
        """Return ``k d^2 / 2`` of the compression d of a side."""
        return np.asarray(0.5 * self.stiffness * self._compression(self.values(q)) ** 2)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return ``-(effort + k d) w'``: of the damper, and of a side that is left before it has sprung back."""
        w, rate, _ = self.moving(q, v)
        stored = self.stiffness * self._side(w) * self._compression(w)
        return np.asarray(-(self.effort(t, w, rate) + stored) * rate)

    @property
    def conservative(self) -> bool:
        return not self.damping

    def edges(self) -> list[Edge]:
        return [edge for side in self.sides for edge in self._edges_of(side)]

    def _edges_of(self, side: float) -> list[Edge]:
        met = self.edge(lambda w, rate: side * w - self.half)
        if not self.damping:
            return [met]
        return [met, self.edge(lambda w, rate: self._push(side, w, rate), lambda w: self._touches(side, w))]

    @property
    def in_pieces(self) -> bool:
        return len(self.sides) > 1

    def passed(self, q: Array, v: Array) -> bool:
        return self._pieces.passed(self.values(q))

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(np.array([-self.half, self.half]))


class TautSpring(StopSpring, frozen=True):
    """An elastic cable: it pulls along a path that is longer than its free length, and is slack on a shorter one."""

    @property
    def path(self) -> PathLength:
        assert isinstance(self.coordinate, PathLength)
        return self.coordinate

    @property
    def points(self) -> tuple[int, ...]:
        return self.path.frames

    def measures(self) -> Mapping[str, ElementQuantity]:
        return {
            "length": ElementQuantity(METRE, lambda t, q, v: self.values(q)),
            "tension": ElementQuantity(unit("N"), lambda t, q, v: -self.efforts(t, q, v)),
        }

    @property
    def description(self) -> str:
        return f"cable through {self.path.words(self.model)}"


class EffortAlong(AlongCoordinate, LawElement, frozen=True):
    """A torque or force that follows a law; all of its power is supplied.

    Attributes:
        law: The effort [N*m or N] over time, or a factor over time of that of the condition.
    """

    law: MotionLaw
    function: Callable[[Array], Values] | None = None
    condition: LoadCondition | None = None

    def efforts(self, t: Array, q: Array, v: Array) -> Array:
        return np.broadcast_to(self.law_at(t, q, v), q.shape[:-1])

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        tau += np.asarray(self.law_at(t, q, v))[..., None] * self.moving(q, v)[2]


class CoordinateSpring(InputStruct, frozen=True, tag_field="kind", tag="coordinate_spring"):
    """Spring and damper along a coordinate, such as ``L.angle`` or ``L.position`` of a loop joint L.

    Attributes:
        coordinate: The coordinate.
        stiffness: Effort per way or angle.
        damping: Effort per speed.
        rest: Value at which the spring is free.
    """

    coordinate: str
    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0
    rest: AnyQuantity = 0.0

    def bind(self, model: pin.Model, coordinates: Mapping[str, Coordinate]) -> ForceElement:
        with within("coordinate"):
            along = coordinate_of(model, coordinates, self.coordinate)
        stiff = effort_unit(along) / along.unit
        units = {"stiffness": stiff, "damping": stiff * unit("s"), "rest": along.unit}
        for key, measured in units.items():
            with within(key):
                check_unit(getattr(self, key), measured)
        return SpringAlong(model, along, float(self.stiffness), float(self.damping), float(self.rest))


class CoordinateEffort(LoadKeys, frozen=True, tag_field="kind", tag="coordinate_effort"):
    """Torque or force along a coordinate, such as ``L.angle`` of a loop joint L.

    Attributes:
        coordinate: The coordinate.
        effort: The law, over time or over a coordinate.
    """

    coordinate: str
    effort: Law

    def bind(self, model: pin.Model, coordinates: Mapping[str, Coordinate]) -> ForceElement:
        with within("coordinate"):
            along = coordinate_of(model, coordinates, self.coordinate)
        law, condition = self.acting("effort", effort_unit(along), model, coordinates)
        return EffortAlong(model, along, law=law, condition=condition)


class ElasticCable(InputStruct, frozen=True, tag_field="kind", tag="cable"):
    """An elastic cable from one link over others to the last one; it pulls, and is slack where it is too long.

    While the path through the links, of length l, is longer than the free length l0, the tension is
    ``S = max(stiffness (l - l0) + damping l', 0)``. On the way it runs without friction over small pulleys or through
    eyes, as the loop joint ``cable``, which does not stretch.

    Attributes:
        through: The links, from one end to the other, such as ``[weight, pulley, door]``.
        stiffness: Of the whole cable: modulus times cross-section over its length.
        damping: Such as ``50 N*s/m``.
        free_length: Length without tension.
    """

    through: Annotated[list[str], msgspec.Meta(min_length=2)]
    stiffness: Stiffness
    free_length: Span
    damping: Damping = 0.0

    def bind(self, model: pin.Model, joints: Mapping[str, Joint]) -> ForceElement:
        path = PathLength.through(model, self.through)
        numbers = float(self.stiffness), float(self.damping), float(self.free_length)
        return TautSpring(model, path, *numbers, (1.0,))


def elastic_gear(
    model: pin.Model, deflection: LinearCoordinate, elasticity: Elasticity, backlash: float
) -> ForceElement:
    """Return the spring and damper of an elastic gear, or its flanks.

    Args:
        backlash: [rad or m].
    """
    stiff = effort_unit(deflection) / deflection.unit
    given = ("stiffness", elasticity.stiffness, stiff), ("damping", elasticity.damping, stiff * unit("s"))
    for key, value, expected in given:
        with within("elasticity", key):
            check_unit(value, expected)
    with within("backlash"):
        check_unit(backlash, deflection.unit)
    stiffness, damping = float(elasticity.stiffness), float(elasticity.damping)
    if backlash:
        return StopSpring(model, deflection, stiffness, damping, 0.5 * float(backlash))
    return SpringAlong(model, deflection, stiffness, damping, 0.0)
