"""Values that a problem gives by the names of coordinates, joints and drives: their names and units are checked."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Self

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.systems import Follower
from pinarm.errors import InputError, Key, Place, UnitError, choices, within
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import Measured, check_unit
from pinarm.mechanics.ball_joints import places_of, positions_of, unit_of, velocities_of
from pinarm.mechanics.coordinates import Coordinate


def coordinates_of(
    mechanism: Mechanism, values: Mapping[str, float], place: Place, *at: str, order: int = 0
) -> list[Coordinate]:
    """Return the coordinates for which values are given; ``order`` 1 is that of rates, 2 of accelerations."""
    coordinates = list[Coordinate]()
    for name, value in values.items():
        with place(*at, Key(name)):
            coordinates.append(mechanism.coordinate(name))
        with place(*at, name):
            check_unit(value, coordinates[-1].unit / unit("s") ** order)
    return coordinates


def check_levels(mechanism: Mechanism, levels: Mapping[str, float], place: Place, *at: str) -> None:
    """Check names and units of values given for the coordinates of joints."""
    _check_values(positions_of(mechanism.joints, mechanism.balls), levels, place, *at)


def check_rates(mechanism: Mechanism, rates: Mapping[str, float], place: Place, *at: str) -> None:
    """Check names and units of values given for velocities of joints, or of other coordinates of the mechanism."""
    known = velocities_of(mechanism.joints, mechanism.balls)
    others = {name: mechanism.coordinate(name).unit / unit("s") for name in rates_of_coordinates(mechanism, rates)}
    _check_values({**known, **others}, rates, place, *at)


def rates_of_coordinates(mechanism: Mechanism, rates: Mapping[str, float]) -> dict[str, float]:
    """Return the given rates of coordinates that are not simply velocities of joints."""
    own = places_of(mechanism.joints, mechanism.balls)
    return {name: rate for name, rate in rates.items() if name not in own and name in mechanism.coordinates}


def _check_values(known: Mapping[str, Unit], values: Mapping[str, float], place: Place, *at: str) -> None:
    for name, value in values.items():
        with place(*at, Key(name)):
            expected = unit_of(name, known)
        with place(*at, name):
            check_unit(value, expected)


def followers_of(mechanism: Mechanism, positions: Container[str], velocities: Container[str]) -> tuple[Follower, ...]:
    """Return rotors of elastic gears, and wheels, by the names of joints whose position or velocity is given.

    They begin where the other end of the shaft is, on its turn where it is a joint of its own.
    """
    followers: list[Follower] = []
    for name, drive in mechanism.drives.items():
        if drive.elasticity:
            from pinarm.mechanics.rotors import shaft_name, wheel_name

            rotor, shaft = mechanism.driven_joint(name), shaft_name(name)
            driven = mechanism.coordinate(shaft if shaft in mechanism.joints else drive.coordinate)
            begins = rotor.name not in positions, rotor.name not in velocities
            parts = (mechanism.joints.get(part) for part in (rotor.name, wheel_name(name)))
            followers += [Follower(joint, driven, *begins) for joint in parts if joint is not None]
    return tuple(followers)


class Weight(Measured):
    """A positive number, bare or with the reciprocal of the unit of what it weighs, such as ``0.02 1/N``."""

    above = 0.0

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read a weight; see ``Measured.read``. A number without unit is one, in files too."""
        return super().read(value, bare=True)

    @property
    def plain(self) -> bool:
        return self.unit is None or self.unit.dimension == DIMENSIONLESS.dimension


def weights_of(weights: Mapping[str, Weight], units: Mapping[str, Unit], kind: str, key: str, apart: str) -> Array:
    """Return the weights of quantities in the order of their units, shape (n,); 1 where none are given.

    Args:
        weights: Name -> weight.
        units: Name -> unit of what is weighed.
        kind: What the names are, for messages, such as ``drive of this run``.
        key: Key of the problem that holds the weights.
        apart: Why quantities of several dimensions need weights, in words.
    """
    several = len({measured.dimension for measured in units.values()}) > 1
    if not weights and several:
        hint = ", ".join(f"{name}: 1 {_reciprocal(measured)}" for name, measured in units.items())
        raise InputError(
            f"{apart} have no common sum of squares: it would depend on the unit of length",
            expected="weights with units, such as the reciprocals of rated efforts, or of the ranges of joints",
            hint=f"{key}: {{weights: {{{hint}}}}}",
        )
    if not weights:
        return np.ones(len(units))
    with within("weights"):
        check_names(weights, units, kind)
        if missing := [name for name in units if name not in weights]:
            raise InputError(
                f"no weight is given for {', '.join(missing)}", expected=f"one for every {kind.split()[0]}"
            )
        if several or not all(weight.plain for weight in weights.values()):
            for name, measured in units.items():
                with within(name):
                    _check_reciprocal(weights[name], measured)
    return np.array([float(weights[name]) for name in units])


def check_names(names: Iterable[str], known: Iterable[str], kind: str) -> None:
    """Raise where a name is none of those known."""
    for name in names:
        if name not in known:
            with within(Key(name)):
                expected, hint = choices(name, known)
                raise InputError(f"'{name}' is no {kind}", expected=expected, hint=hint)


def _reciprocal(measured: Unit) -> str:
    """Return the unit of a weight as files have it."""
    return f"1/{measured}".replace("*", "/")


def _check_reciprocal(weight: Weight, measured: Unit) -> None:
    if weight.plain and measured.dimension != DIMENSIONLESS.dimension:
        raise UnitError(
            f"the weight {weight:g} has no unit",
            hint=f"{weight:g} {_reciprocal(measured)}",
            expected="a unit for every weight, where different kinds of quantities are weighed, or another "
            "weight has one",
        )
    check_unit(weight, DIMENSIONLESS / measured)
