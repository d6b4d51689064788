"""What controllers measure: coordinates of a mechanism and their rates, at one state or at many."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import Joint

State = Callable[[Array, Array], Kinematics]
"""Evaluates one state (q, v), shapes (nq,) and (nv,)."""


class Signal(Protocol):
    """A coordinate that a controller measures."""

    @property
    def name(self) -> str:
        """Name of the coordinate."""
        ...

    @property
    def unit(self) -> Unit:
        """Its unit."""
        ...

    def measure(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return value and rate in states of shapes (..., nq) and (..., nv), both of shape (...)."""
        ...


@dataclass(frozen=True)
class JointSignal:
    """The coordinate of a joint.

    Attributes:
        name: Name of the joint.
        unit: Unit of its coordinate.
        q: Index in q.
        v: Index in v.
    """

    name: str
    unit: Unit
    q: int
    v: int

    @classmethod
    def of(cls, joint: Joint) -> JointSignal:
        """Return the signal of a joint."""
        return cls(joint.name, joint.unit, joint.q, joint.v)

    def measure(self, q: Array, v: Array) -> tuple[Array, Array]:
        return q[..., self.q], v[..., self.v]


@dataclass(frozen=True)
class SumSignal:
    """A weighted sum of joint coordinates.

    Attributes:
        name: Name of the coordinate.
        unit: Its unit.
        weights: Shape (nv,).
        places: Index in q for every index in v, shape (nv,).
    """

    name: str
    unit: Unit
    weights: Array
    places: Indices

    def measure(self, q: Array, v: Array) -> tuple[Array, Array]:
        return np.asarray(q[..., self.places] @ self.weights), np.asarray(v @ self.weights)


@dataclass(frozen=True, eq=False)
class CoordinateSignal:
    """Any other coordinate, state by state.

    Attributes:
        name: Name of the coordinate.
        coordinate: The coordinate.
        state: Evaluates a state.
    """

    name: str
    coordinate: Coordinate
    state: State

    @property
    def unit(self) -> Unit:
        return self.coordinate.unit

    def measure(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return ``w(q)`` and ``J v``."""
        flat = q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1])
        found = np.empty((2, len(flat[0])))
        for row, (position, velocity) in enumerate(zip(*flat, strict=True)):
            here = self.state(position, velocity)
            found[:, row] = self.coordinate.value(here), self.coordinate.row(here) @ velocity
        value, rate = found.reshape(2, *q.shape[:-1])
        return value, rate
