"""The mechanism file: what is said beside the URDF, because URDF cannot say it."""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.input.schema import Acceleration, Model
from pinarm.mechanics.coordinates import AXES, Axis, CoordinateDefinition
from pinarm.mechanics.couplings import CouplingDefinition
from pinarm.mechanics.drives import Drive
from pinarm.mechanics.forces import Force
from pinarm.mechanics.loops import Loop
from pinarm.mechanics.payload import Payload

STANDARD_GRAVITY = 9.81
"""Magnitude used where a file gives only a direction [m/s^2]."""


class Gravity(Model, frozen=True):
    """A uniform field.

    Attributes:
        direction: Where things fall, an axis of the world.
        magnitude: [m/s^2].
    """

    direction: Axis = "-z"
    magnitude: Acceleration = STANDARD_GRAVITY

    def vector(self) -> Array:
        """Return the field [m/s^2], world axes, shape (3,)."""
        return np.array(AXES[self.direction], float) * float(self.magnitude)


class MechanismDescription(Model, frozen=True):
    """Content of a mechanism file.

    Attributes:
        pinarm: Version of the format.
        title: For headings.
        robot: A URDF or xacro file, relative to this one, or the name of a robot of example-robot-data.
        arguments: Unit of every xacro argument of the model, so that a scenario can give them with units.
        gravity: ``none`` for none.
        coordinates: Coordinates beside those of the joints.
        loops: Joints that close loops of the tree.
        couplings: Gears, racks and screws between joints.
        drives: Motors and gears.
        forces: Springs, dampers and loads that belong to the mechanism.
        payloads: What links carry beside the model's own masses.
        symbols: Published symbols and what they stand for: a quantity, or a formula of quantities.
    """

    pinarm: Literal[1]
    robot: str
    title: str = ""
    arguments: dict[str, str] = {}
    gravity: Gravity | Literal["none"] = msgspec.field(default_factory=Gravity)
    coordinates: dict[str, CoordinateDefinition] = {}
    loops: dict[str, Loop] = {}
    couplings: dict[str, CouplingDefinition] = {}
    drives: dict[str, Drive] = {}
    forces: dict[str, Force] = {}
    payloads: dict[str, Payload] = {}
    symbols: dict[str, str] = {}
