"""Force elements. Each gives its load, its potential energy and the power that it dissipates.

The three obey ``load . v = -dU/dt - dissipated``, whatever the motion; one test holds every element to it. A load that
drives the mechanism dissipates a negative power: it supplies it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from pinarm.arrays import Array, Indices
from pinarm.errors import InputError, choices
from pinarm.input.schema import AnyQuantity, Measured, Model
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import METRE, Joint
from pinarm.mechanics.motion import Law, MotionLaw, Values


class ForceElement(Protocol):
    """An element of one mechanism, ready for evaluation at one state or at many (leading axes)."""

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the generalised load [N*m or N] to ``tau``, shape (..., nv)."""
        ...

    def potential_energy(self, q: Array) -> Array:
        """Return U [J], shape (...)."""
        ...

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power that leaves the mechanism [W], shape (...)."""
        ...

    def laws(self) -> list[MotionLaw]:
        """Return the laws over time that the load follows; it may jump where they do."""
        ...

    def on(self, start: float, end: float) -> ForceElement:
        """Return the element as it is on a stretch of time in which no law jumps."""
        ...


@dataclass(frozen=True)
class SpringDamper:
    """Linear spring and damper at joints: ``load = -stiffness (q - rest) - damping v``.

    Potential energy ``stiffness (q - rest)^2 / 2``, dissipated power ``damping v^2``, summed over the joints.

    Attributes:
        q: Indices in q, shape (k,).
        v: Indices in v, shape (k,).
        stiffness: [N*m/rad or N/m], shape (k,).
        damping: [N*m*s/rad or N*s/m], shape (k,).
        rest: Coordinate at which the spring is free [rad or m], shape (k,).
    """

    q: Indices
    v: Indices
    stiffness: Array
    damping: Array
    rest: Array

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] -= self.stiffness * (q[..., self.q] - self.rest) + self.damping * v[..., self.v]

    def potential_energy(self, q: Array) -> Array:
        """Return the energy of the springs."""
        return np.asarray((0.5 * self.stiffness * (q[..., self.q] - self.rest) ** 2).sum(axis=-1))

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power of the dampers."""
        return np.asarray((self.damping * v[..., self.v] ** 2).sum(axis=-1))

    def laws(self) -> list[MotionLaw]:
        """Return nothing: the element does not depend on time."""
        return []

    def on(self, start: float, end: float) -> SpringDamper:
        """Return the element itself."""
        return self


@dataclass(frozen=True)
class AppliedEffort:
    """A torque or force at a joint that follows a law of time; all of its power is supplied.

    Attributes:
        v: Index in v.
        law: The effort [N*m or N] over time.
        function: The smooth piece of the law on the present stretch; ``None`` for evaluation at right-hand sides.
    """

    v: int
    law: MotionLaw
    function: Callable[[Array], Values] | None = None

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] += self._effort(t)

    def potential_energy(self, q: Array) -> Array:
        """Return 0."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power supplied, with a minus."""
        return np.asarray(-self._effort(t) * v[..., self.v])

    def laws(self) -> list[MotionLaw]:
        """Return the law."""
        return [self.law]

    def on(self, start: float, end: float) -> AppliedEffort:
        """Return the element with the piece of its law on the stretch."""
        return replace(self, function=self.law.on(start, end))

    def _effort(self, t: Array | float) -> Array:
        if self.function is None:
            raise ValueError("a law is evaluated on a stretch of time: take the element's on(start, end)")
        return self.function(np.asarray(t, float))[0]


class JointSpring(Model):
    """Spring and damper between a joint's two links."""

    kind: Literal["joint_spring"]
    joint: str
    stiffness: AnyQuantity = Field(default=0.0, ge=0)
    damping: AnyQuantity = Field(default=0.0, ge=0)
    rest: AnyQuantity = 0.0

    def bind(self, joints: Mapping[str, Joint]) -> ForceElement:
        """Return the element of one model."""
        joint = _joint(joints, self.joint)
        effort = effort_unit(joint)
        for value, expected in ((self.stiffness, effort / joint.unit), (self.rest, joint.unit),
                                (self.damping, effort / joint.unit * unit("s"))):  # fmt: skip
            if isinstance(value, Measured):
                value.check(expected)
        one = np.array([1.0])
        return SpringDamper(np.array([joint.q]), np.array([joint.v]), self.stiffness * one, self.damping * one,
                            self.rest * one)  # fmt: skip


class JointEffort(Model):
    """Torque or force at a joint over time."""

    kind: Literal["joint_effort"]
    joint: str
    effort: Law

    def bind(self, joints: Mapping[str, Joint]) -> ForceElement:
        """Return the element of one model."""
        joint = _joint(joints, self.joint)
        self.effort.check_units(effort_unit(joint))
        return AppliedEffort(joint.v, self.effort)


Force = Annotated[JointSpring | JointEffort, Field(discriminator="kind")]
"""Any force element. A new one is two classes above, as written and as evaluated, and one entry here."""


def effort_unit(joint: Joint) -> Unit:
    """Return N for a joint that slides and N*m for one that turns."""
    return unit("N") if joint.unit == METRE else unit("N*m")


def _joint(joints: Mapping[str, Joint], name: str) -> Joint:
    if name not in joints:
        expected, hint = choices(name, joints)
        raise InputError(f"the model has no joint '{name}' with one coordinate", expected=expected, hint=hint)
    return joints[name]
