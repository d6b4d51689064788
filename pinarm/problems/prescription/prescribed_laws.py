"""The laws of motion of a problem, checked against the coordinates of a mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.joint_motion import JointMotion
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError, Key, Place, within
from pinarm.mechanics.laws import Motion, Over
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw

BESIDE = 1e-9
"""Distance of the rows beside a passage of a cam, part of the time: far above rounding of angles, 1e-16 of them."""


def laws_of(
    mechanism: Mechanism, motion: Mapping[str, Motion], place: Place, span: tuple[float, float] = (0.0, 0.0)
) -> dict[str, MotionLaw]:
    """Return the laws over time of coordinates, checked; profiles over coordinates are driven by the laws of those.

    Args:
        mechanism: The mechanism.
        motion: Coordinate -> its law.
        place: Gives errors their place.
        span: First and last instant at which the laws are wanted [s].

    Raises:
        InputError: A coordinate does not exist, or a profile's has no law.
        UnitError: A field of a law has another dimension.
    """
    found: dict[str, MotionLaw] = {}
    for name, law in motion.items():
        with place("motion", Key(name)):
            mechanism.coordinate(name)
        with place("motion", name):
            law.check_follower(name, mechanism.coordinates)
    for name in motion:
        _settle(name, (), mechanism, motion, found, place, span)
    return {name: found[name] for name in motion}


def _settle(
    name: str, before: tuple[str, ...], mechanism: Mechanism, motion: Mapping[str, Motion],
    found: dict[str, MotionLaw], place: Place, span: tuple[float, float],
) -> None:  # fmt: skip
    """Add the law over time of a coordinate, and before it that of the coordinate that drives it."""
    law, measured = motion[name], mechanism.coordinate(name).unit
    if not isinstance(law, Over):
        with place("motion", name):
            law.check_units(measured)
            law.require_continuous()
        found[name] = law
        return
    with place("motion", name, "of"):
        along = mechanism.coordinate(law.of).unit
        if law.of not in motion:
            others = ", ".join(other for other in motion if other != name)
            raise InputError(f"'{law.of}' follows no law: the profile of '{name}' has nothing to run along",
                             expected=f"one of {others}" if others else "",
                             hint=f"a law over time for '{law.of}' too")  # fmt: skip
        if law.of in (*before, name):
            raise InputError(f"profiles run along each other: {' -> '.join([*before, name, law.of])}")
    with place("motion", name):
        law.check_units(measured, along)
        with within("profile"):
            law.profile.require_continuous(along)
    if law.of not in found:
        _settle(law.of, (*before, name), mechanism, motion, found, place, span)
    with place("motion", name):
        found[name] = law.along(found[law.of], *span)


def grid_of(mechanism: Mechanism, motion: JointMotion, t: Array, laws: Sequence[MotionLaw]) -> Grid:
    """Return the grid of instants, shape (n,), cut where laws have breakpoints and cams pass those of their profiles.

    Where a cam passes one there is a row on either side: the acceleration of its follower may jump in between.

    Args:
        mechanism: The mechanism.
        motion: How its joints follow laws.
        t: Instants [s].
        laws: Laws of the motion and of loads.
    """
    joints = motion.prescribed.joint_laws
    start, end = float(t[0]), float(t[-1])
    kinks = [x for one in mechanism.relations for x in one.passages(joints, start, end) if start < x < end]
    near = [x + side * BESIDE * (end - start) for x in kinks for side in (-1.0, 1.0)]
    rows = np.unique([*t, *(x for x in near if start < x < end)]) if near else t
    return Grid.cover(rows, laws, kinks=kinks)


def profile_remarks(mechanism: Mechanism, motion: Mapping[str, Motion]) -> list[str]:
    """Return what efforts along profiles mean: each has a drive of its own, which a cam has not."""
    remarks = []
    for name, law in motion.items():
        if isinstance(law, Over):
            own, along = (f"joint.{x}" if x in mechanism.joints else f"coordinate.{x}" for x in (name, law.of))
            remarks.append(
                f"'{name}' is moved along its profile over '{law.of}' by a drive of its own: efforts, reactions, loads "
                f"and sizing at '{law.of}' are without it. The shaft of a cam carries "
                f"{along}.effort + {own}.effort*{own}.velocity/{along}.velocity; a coupling 'kind: cam' loads it"
            )
    return remarks
