"""The initial values that tell the motions of a batch apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.states import columns_of
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, require_map
from pinarm.input.units import unit


@dataclass(frozen=True, eq=False)
class Starts:
    """Initial values of b motions.

    Attributes:
        mechanism: What is solved.
        position: Joint -> initial coordinates [rad or m], shape (b,).
        velocity: Joint -> initial velocities [rad/s or m/s], shape (b,).
        size: b.
    """

    mechanism: Mechanism
    position: Mapping[str, Array]
    velocity: Mapping[str, Array]
    size: int

    @classmethod
    def of(
        cls, mechanism: Mechanism, hybrid: HybridSystem, position: Mapping[str, ArrayLike],
        velocity: Mapping[str, ArrayLike],
    ) -> Starts:  # fmt: skip
        """Return initial values, those of single numbers the same for all.

        Raises:
            InputError: A joint has not one coordinate or follows a law, or the numbers of values differ.
        """
        for given_as, values in (("position", position), ("velocity", velocity)):
            require_map(values, given_as, f"{given_as}={{'knee': [0.1, 0.2]}}")
        for name in (*position, *velocity):
            if name not in mechanism.joints or name in hybrid.prescribed.names:
                free = [joint for joint in mechanism.joints if joint not in hybrid.prescribed.names]
                expected, hint = choices(name, free)
                raise InputError(
                    f"no free joint '{name}' with one coordinate can begin elsewhere", expected=expected, hint=hint
                )
        joints = mechanism.joints
        given = {f"position {name}": x for name, x in position.items()}
        given |= {f"velocity {name}": x for name, x in velocity.items()}
        units = {f"position {name}": [joint.unit] for name, joint in joints.items()}
        units |= {f"velocity {name}": [joint.unit / unit("s")] for name, joint in joints.items()}
        shape, columns = columns_of(given, units)
        if len(shape) > 1:
            raise InputError(f"the arrays have {len(shape)} axes", expected="one: a value for every motion")
        for name, column in columns.items():
            if not np.isfinite(column).all():
                raise InputError(f"{name} is not finite", expected="a finite number for every motion")
        if shape == (0,):
            raise InputError("there are no initial values", expected="one motion or more")
        found = [np.array(x, ndmin=1) for x in columns.values()]
        return cls(mechanism, dict(zip(position, found, strict=False)),
                   dict(zip(velocity, found[len(position) :], strict=True)), *(shape or (1,)))  # fmt: skip

    def of_one(self, number: int) -> dict[str, dict[str, str]]:
        """Return the initial values of one motion, as a scenario's ``initial`` has them."""
        given = {"position": (self.position, ""), "velocity": (self.velocity, "/s")}
        return {
            what: {name: f"{float(x[number])!r} {self.mechanism.joints[name].unit}{per}" for name, x in values.items()}
            for what, (values, per) in given.items()
        }

    def columns(self, quantities: Quantities) -> list[Series]:
        """Return the values as columns of a table; the quantities tell their units."""
        found = {f"joint.{name}.position": x for name, x in self.position.items()}
        found |= {f"joint.{name}.velocity": x for name, x in self.velocity.items()}
        return [Series(f"start {name}", quantities[name].unit, x) for name, x in found.items()]
