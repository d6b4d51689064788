"""Springs, dampers and loads in letters, as efforts at the joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy
from msgspec.structs import replace

from pinarm.errors import InputError
from pinarm.mechanics.forces.along_coordinate import CoordinateEffort, CoordinateSpring, JointEffort, JointSpring
from pinarm.mechanics.forces.joint_forces import SpringDamper
from pinarm.mechanics.forces.points import Wrench
from pinarm.mechanics.laws import Constant
from pinarm.records import ValueRecord
from pinarm.use.letters.bodies import exact, letter
from pinarm.use.letters.projection import Letters

ONE = Constant(value=1.0)
"""The law of a load in the proof of its equations."""


class LetteredForce(ValueRecord, frozen=True):
    """A force in letters.

    Attributes:
        definition: What a file says of it, with the law ``ONE``.
        efforts: Joint -> its effort there.
        symbols: Symbol -> what it stands for, and its number; of a load as long as its law is 1.
    """

    definition: Any
    efforts: Mapping[str, sympy.Expr]
    symbols: Mapping[str, tuple[str, float]]


def lettered_forces(letters: Letters, loads: Mapping[str, Any]) -> list[LetteredForce]:
    """Return the forces of a mechanism, and loads beside them.

    Raises:
        InputError: A force is of a kind that is not written in letters.
    """
    mechanism = letters.mechanism
    forces = {**mechanism.description.forces, **loads}
    for name, element in mechanism.forces.items():
        if name not in forces and not (isinstance(element, SpringDamper) and not element.stiffness.any()):
            raise _unknown(name)
    if mechanism.frictions:
        raise _unknown("dry friction")
    return [_lettered(letters, name, force) for name, force in forces.items()]


def _unknown(name: str) -> InputError:
    expected = "springs and efforts of joints and of sums of joints, and forces along axes of the world"
    return InputError(f"the force '{name}' is not written in letters", expected=expected)


def joint_damping(letters: Letters) -> Mapping[str, sympy.Expr]:
    """Return the efforts of the damping that the model gives to joints."""
    rate = letters.coordinates.rate
    return {joint.name: -joint.damping * rate(letters.coordinates.joints[joint.name]) for joint in letters.tree.joints}


def _lettered(letters: Letters, name: str, force: Any) -> LetteredForce:
    shares = letters.coordinates.shares
    match force:
        case JointSpring():
            return _spring(letters, name, force, shares(force.joint))
        case CoordinateSpring():
            return _spring(letters, name, force, shares(force.coordinate))
        case JointEffort():
            return _effort(name, force, shares(force.joint), f"effort of the load {name} at the joint {force.joint}")
        case CoordinateEffort():
            along = shares(force.coordinate)
            return _effort(name, force, along, f"effort of the load {name} along {force.coordinate}")
        case Wrench(axes="world") if not any(force.moment):
            return _force(letters, name, force)
    raise _unknown(name)


def _effort(name: str, force: Any, shares: Mapping[str, sympy.Expr], meaning: str) -> LetteredForce:
    efforts = {joint: share * letter(name) for joint, share in shares.items()}
    acting = replace(force, effort=ONE, over=None, period=None, while_={}, start=None, end=None)
    return LetteredForce(acting, efforts, {name: (meaning, 1.0)})


def _spring(
    letters: Letters, name: str, force: JointSpring | CoordinateSpring, shares: Mapping[str, sympy.Expr]
) -> LetteredForce:
    value = sum(share * letters.coordinates.joints[joint] for joint, share in shares.items())
    terms = (
        ("k", "stiffness", force.stiffness, value - exact(float(force.rest))),
        ("c", "damping", force.damping, letters.coordinates.rate(value)),
    )
    kept = [(f"{sign}_{name}", word, float(number), factor) for sign, word, number, factor in terms if number]
    pull = sympy.Add(*(letter(symbol) * factor for symbol, _, _, factor in kept))
    symbols = {symbol: (f"{word} of {name}", number) for symbol, word, number, _ in kept}
    return LetteredForce(force, {joint: -share * pull for joint, share in shares.items()}, symbols)


def _force(letters: Letters, name: str, force: Wrench) -> LetteredForce:
    point, path = letters.place(force.point)
    vector, symbols = sympy.zeros(3, 1), dict[str, tuple[str, float]]()
    for k, component in enumerate(force.force):
        if component:
            symbol = f"{name}_{'xyz'[k]}"
            vector[k] = letter(symbol)
            symbols[symbol] = f"component {'xyz'[k]} of the load {name} at {force.point}", float(component)
    efforts = {joint: letters.per_rate(joint, point).dot(vector) for joint in path}
    return LetteredForce(replace(force, factor=ONE), efforts, symbols)
