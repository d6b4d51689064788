"""Springs, dampers and efforts along any coordinate: of a loop joint, a sum of joints, a point, a distance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.errors import within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, NotNegative, check_unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, coordinate_of
from pinarm.mechanics.forces.force_element import Edge, ElementQuantity, ForceElement
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws import Law
from pinarm.mechanics.laws.motion_law import MotionLaw, Values
from pinarm.records import AbstractRecord, replace

TOUCHING = 1e-13
"""Gap, relative to ``1 + |w|`` in SI, at which what pushes or pulls one way counts as closed: where it closes it is at
work, though rounding may leave it open there."""


class Evaluated(AbstractRecord, frozen=True, kw_only=True):
    """How a coordinate is evaluated at many states.

    Attributes:
        many: ``q -> w, J`` at configurations, shape (n, nq), also complex steps; Pinocchio where it is left out.
    """

    unshown: ClassVar[tuple[str, ...]] = ("many",)

    many: Callable[[Array], tuple[Array, Array]] | None = None


class AlongCoordinate(Evaluated, ForceElement, frozen=True):
    """An effort along a coordinate w with the row J, ``load = J^T effort``.

    Attributes:
        model: Pinocchio's model.
        coordinate: The coordinate.
    """

    unshown = ("model", "many")

    model: pin.Model
    coordinate: Coordinate

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        """Return the effort [N*m or N] for values w and their rates, each of shape (n,)."""
        raise NotImplementedError

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load ``J^T effort`` to ``tau``."""
        w, rows = self._evaluated(q, v)
        efforts = self.effort(t, w, (rows * v).sum(axis=-1))
        tau += np.asarray(efforts)[..., None] * rows

    def wrenches(self, t: float, q: Array, v: Array) -> dict[int, Array]:
        """Return what the effort does to the links, unless it is one at joints of the tree."""
        w, rows = self._evaluated(q, v)
        effort = np.atleast_1d(self.effort(t, w, (rows * v).sum(axis=-1)))
        acting = self.coordinate.wrenches(LinkPlacements.at(self.model, q[None]), effort)
        return {joint: wrench[0] for joint, wrench in acting.items()}

    def measures(self) -> Mapping[str, ElementQuantity]:
        return {"effort": ElementQuantity(effort_along(self.coordinate), self.efforts)}

    def efforts(self, t: Array, q: Array, v: Array) -> Array:
        w, rows = self._evaluated(q, v)
        return np.broadcast_to(self.effort(t, w, (rows * v).sum(axis=-1)), w.shape)

    def _edge(self, value: Callable[[Array, Array], Array], counts: Callable[[Array], Flags] | None = None) -> Edge:
        """Return an edge at zeros of a function of w and its rate, which count where another one of w says so."""

        def at(t: Array, q: Array, v: Array) -> Array:
            w, rows = self._evaluated(q, v)
            return value(w, (rows * v).sum(axis=-1))

        return Edge(at, counts and (lambda t, q, v: counts(self._evaluated(q, v)[0])))

    def _evaluated(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return w, shape (...), and J, shape (..., nv)."""
        if isinstance(self.coordinate, LinearCoordinate):
            weights = self.coordinate.weights
            return np.asarray(q[..., self.coordinate.places] @ weights), np.broadcast_to(weights, v.shape)
        if self.many is not None:
            w, rows = self.many(q.reshape(-1, q.shape[-1]))
            return w.reshape(q.shape[:-1]), rows.reshape(*q.shape[:-1], v.shape[-1])
        states = [Kinematics.at(self.model, one) for one in q.reshape(-1, q.shape[-1])]
        w = np.array([self.coordinate.value(state) for state in states])
        rows = np.array([self.coordinate.row(state) for state in states])
        return w.reshape(q.shape[:-1]), rows.reshape(*q.shape[:-1], v.shape[-1])


class SpringAlong(AlongCoordinate, frozen=True):
    """Spring and damper: ``effort = -stiffness (w - rest) - damping w'``; energy ``stiffness (w - rest)^2 / 2``.

    Attributes:
        stiffness: [N*m/rad or N/m].
        damping: [N*m*s/rad or N*s/m].
        rest: Value at which the spring is free [rad or m].
    """

    stiffness: float
    damping: float
    rest: float

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        return np.asarray(-self.stiffness * (w - self.rest) - self.damping * rate)

    def potential_energy(self, q: Array) -> Array:
        w, _ = self._evaluated(q, np.zeros((*q.shape[:-1], self.model.nv)))
        return np.asarray(0.5 * self.stiffness * (w - self.rest) ** 2)

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        return np.asarray(self.damping * (self._evaluated(q, v)[1] * v).sum(axis=-1) ** 2)

    @property
    def conservative(self) -> bool:
        return not self.damping


class EffortAlong(AlongCoordinate, frozen=True):
    """A torque or force that follows a law of time; all of its power is supplied.

    Attributes:
        law: The effort [N*m or N] over time.
        function: The smooth piece of the law on the present interval.
    """

    law: MotionLaw
    function: Callable[[Array], Values] | None = None

    def effort(self, t: Array | float, w: Array, rate: Array) -> Array:
        if self.function is None:
            raise ValueError("a law is evaluated on an interval of time: take the element's on(start, end)")
        return self.function(np.asarray(t, float))[0]

    def potential_energy(self, q: Array) -> Array:
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        w, rows = self._evaluated(q, v)
        rate = (rows * v).sum(axis=-1)
        return np.asarray(-self.effort(t, w, rate) * rate)

    def laws(self) -> list[MotionLaw]:
        return [self.law]

    def on(self, start: float, end: float) -> EffortAlong:
        return replace(self, function=self.law.on(start, end))


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
        effort = effort_along(along)
        for key, measured in (
            ("stiffness", effort / along.unit), ("damping", effort / along.unit * unit("s")), ("rest", along.unit),
        ):  # fmt: skip
            with within(key):
                check_unit(getattr(self, key), measured)
        return SpringAlong(model, along, float(self.stiffness), float(self.damping), float(self.rest))


class CoordinateEffort(InputStruct, frozen=True, tag_field="kind", tag="coordinate_effort"):
    """Torque or force along a coordinate, such as ``L.angle`` of a loop joint L, over time.

    Attributes:
        coordinate: The coordinate.
        effort: The law.
    """

    coordinate: str
    effort: Law

    def bind(self, model: pin.Model, coordinates: Mapping[str, Coordinate]) -> ForceElement:
        with within("coordinate"):
            along = coordinate_of(model, coordinates, self.coordinate)
        with within("effort"):
            self.effort.check_units(effort_along(along))
        return EffortAlong(model, along, self.effort)


def effort_along(coordinate: Coordinate) -> Unit:
    """Return N for a coordinate that is a length and N*m for an angle."""
    return unit("N") if coordinate.unit == METRE else unit("N*m")
