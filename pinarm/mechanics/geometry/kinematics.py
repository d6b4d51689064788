"""The evaluated state of a tree of links: placements, Jacobians, twists and centripetal accelerations in one state."""

from __future__ import annotations

import weakref
from functools import cache

import numpy as np
import pinocchio as pin
from msgspec import Struct

from pinarm.arrays import Array
from pinarm.mechanics.geometry.pinocchio_data import new_data

KEPT = 4
"""Number of unused buffers of a model that are kept: more at once are rare, and buffers may be large."""

_UNUSED: dict[int, list[pin.Data]] = {}
"""Identity of a model -> its buffers that nobody owns."""


def take(model: pin.Model) -> pin.Data:
    """Return buffers of a model that nobody owns; what is in them is left from another use."""
    unused = _UNUSED.get(id(model))
    if unused is None:
        unused = _UNUSED[id(model)] = []
        weakref.finalize(model, _UNUSED.pop, id(model), None)
    try:
        return unused.pop()
    except IndexError:
        return new_data(model)


def give_back(model: pin.Model, data: pin.Data) -> None:
    """Let others use buffers that ``take`` has returned; views of their arrays change from now on."""
    unused = _UNUSED.get(id(model))
    if unused is not None and len(unused) < KEPT:
        unused.append(data)


class Kinematics(Struct, eq=False):
    """A state (q, v) of a tree of links, evaluated by forward kinematics; accelerations are those for ``a = 0``.

    It owns its buffers for as long as it lives: no other state overwrites them.

    Attributes:
        model: Pinocchio's model.
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        data: Pinocchio's buffers, to be read only: placements of joints and frames, joint Jacobians, twists, and the
            accelerations ``J' v``. Views of its arrays are valid for as long as the state lives.
    """

    model: pin.Model
    q: Array
    v: Array
    data: pin.Data

    @classmethod
    def at(cls, model: pin.Model, q: Array, v: Array | None = None) -> Kinematics:
        """Return the evaluated state; at rest where the velocity is left out.

        Args:
            model: Pinocchio's model.
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
        """
        data, at_rest = take(model), _zeros(model.nv)
        velocity = at_rest if v is None else v
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, velocity, at_rest)
        pin.updateFramePlacements(model, data)
        return cls(model, q, velocity, data)

    def __del__(self) -> None:
        """Let another state have the buffers."""
        give_back(self.model, self.data)


@cache
def _zeros(nv: int) -> Array:
    """Return a velocity of 0, shape (nv,), to be read only."""
    zeros = np.zeros(nv)
    zeros.flags.writeable = False
    return zeros
