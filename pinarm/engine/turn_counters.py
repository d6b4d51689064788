"""Angles of loop joints and ball joints whose turns are counted: each by a joint of its own, which is tied to it.

Placements tell such an angle w up to whole turns. What acts along it needs all of them, as along an angle of the tree:
the coordinate of that name then is the counting joint's x, with ``x - w(q) = 0`` but for whole turns. As part of the
configuration x is integrated, continued, saved and restored like any other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import pinocchio as pin

from pinarm.engine.mechanism_parts import Locate, NamedParts
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import Coordinate, coordinate_of, sum_of
from pinarm.mechanics.description import MechanismDescription
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint import Constraint


def acted_along(forces: Iterable[Any], control: Iterable[Any]) -> list[str]:
    """Return the names of coordinates along which definitions of forces act, and of what controllers need."""
    along = [name for force in forces if (name := getattr(force, "coordinate", None)) is not None]
    return [*along, *(name for one in control for name in one.names)]


def counted_angles(
    description: MechanismDescription, model: pin.Model, parts: NamedParts, acted: Sequence[str], here: Locate
) -> list[str]:
    """Return the angles whose turns are to be counted: those that are told up to whole turns, and matter beyond these.

    Args:
        description: The mechanism file.
        model: Pinocchio's model.
        parts: What has a name in it.
        acted: Coordinates along which something acts that the mechanism file does not say.
        here: Gives errors their place.

    Raises:
        InputError: There is no angle of a name under ``turns``.
    """
    for k, name in enumerate(description.turns):
        with here("turns", k):
            if not coordinate_of(model, parts.coordinates, name).wraps:
                raise InputError(f"'{name}' counts its turns, or has none",
                                 expected="L.angle of a loop joint, or J.yaw or J.roll of a ball joint")  # fmt: skip
    names = [*description.turns, *acted_along(description.forces.values(), description.control), *acted]
    known = parts.coordinates
    return [name for name in dict.fromkeys(names) if name in known and known[name].wraps]


def counting(model: pin.Model, parts: NamedParts, angles: Sequence[str]) -> tuple[NamedParts, list[Constraint]]:
    """Return parts of a model with counters whose coordinates are those of the counters, and what ties these to angles.

    Args:
        model: With the joints of ``with_counters``.
        parts: What has a name in it.
        angles: Names of the angles.
    """
    if not angles:
        return parts, []
    from pinarm.mechanics.rotors import GearedRotor, counter_name

    ties: list[Constraint] = [
        GearedRotor(f"turns of {angle}", parts.joints[counter_name(angle)], parts.coordinates[angle])
        for angle in angles
    ]
    counted: dict[str, Coordinate] = {angle: sum_of(model, parts.joints, [counter_name(angle)]) for angle in angles}
    return replace(parts, coordinates={**parts.coordinates, **counted}), ties
