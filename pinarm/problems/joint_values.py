"""Values that a problem gives for the coordinates and velocities of joints: their names and units are checked."""

from __future__ import annotations

from collections.abc import Container, Mapping

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.systems import Follower
from pinarm.errors import Key, Place
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import check_unit
from pinarm.mechanics.ball_joints import places_of, positions_of, unit_of, velocities_of


def check_levels(mechanism: Mechanism, levels: Mapping[str, float], place: Place, *at: str) -> None:
    """Check names and units of values given for the coordinates of joints."""
    _check_values(positions_of(mechanism.joints, mechanism.balls), levels, place, *at)


def check_rates(mechanism: Mechanism, rates: Mapping[str, float], place: Place, *at: str) -> None:
    """Check names and units of values given for velocities; errors as ``check_levels``.

    They are of joints, or of other coordinates of the mechanism.
    """
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
