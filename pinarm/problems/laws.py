"""The laws of motion of a problem, checked against the coordinates of a mechanism."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.assembly import determining, start_near
from pinarm.engine.kinematics.joint_motion import DeterminedMotion, JointMotion
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError, Key, Place, within
from pinarm.input.yaml.schema import InputStruct, Level, check_unit
from pinarm.mechanics.couplings.coupling import cams_of
from pinarm.mechanics.joints import joint_of
from pinarm.mechanics.laws import Motion, Over
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw
from pinarm.problems.values import Weight, weights_of

if TYPE_CHECKING:
    from pinarm.arrays import Array
    from pinarm.engine.kinematics.redundancy import Posture
    from pinarm.mechanics.forces.force_element import ForceElement
    from pinarm.mechanics.joints import Joint


BESIDE = 1e-9
"""Distance of the rows beside a passage of a cam, part of the time: far above rounding of angles, 1e-16 of them."""


def laws_of(
    mechanism: Mechanism, motion: Mapping[str, Motion], place: Place, span: tuple[float, float] = (0.0, 0.0)
) -> dict[str, MotionLaw]:
    """Return the laws over time of coordinates, checked; profiles over coordinates are driven by the laws of those.

    Args:
        motion: Coordinate -> its law.
        span: First and last instant at which the laws are wanted [s].
    """
    laws: dict[str, MotionLaw] = {}
    for name, law in motion.items():
        with place("motion", Key(name)):
            mechanism.coordinate(name)
        with place("motion", name):
            law.check_follower(name, mechanism.coordinates)
    for name in motion:
        _settle(name, (), mechanism, motion, laws, place, span)
    return {name: laws[name] for name in motion}


def _settle(
    name: str, before: tuple[str, ...], mechanism: Mechanism, motion: Mapping[str, Motion],
    laws: dict[str, MotionLaw], place: Place, span: tuple[float, float],
) -> None:  # fmt: skip
    """Add the law over time of a coordinate, and before it that of the coordinate that drives it."""
    law, measured = motion[name], mechanism.coordinate(name).unit
    if not isinstance(law, Over):
        with place("motion", name):
            law.check_units(measured)
            law.require_continuous()
        laws[name] = law
        return
    with place("motion", name, "of"):
        along = mechanism.coordinate(law.of).unit
        if law.of not in motion:
            others = ", ".join(other for other in motion if other != name)
            raise InputError(
                f"'{law.of}' follows no law: the profile of '{name}' has nothing to run along",
                expected=f"one of {others}" if others else "",
                hint=f"a law over time for '{law.of}' too",
            )
        if law.of in (*before, name):
            raise InputError(f"profiles run along each other: {' -> '.join([*before, name, law.of])}")
    with place("motion", name):
        law.check_units(measured, along)
        with within("profile"):
            law.profile.require_continuous(along)
    if law.of not in laws:
        _settle(law.of, (*before, name), mechanism, motion, laws, place, span)
    with place("motion", name):
        laws[name] = law.along(laws[law.of], *span)


def grid_of(mechanism: Mechanism, motion: JointMotion, t: Array, forces: Collection[ForceElement]) -> Grid:
    """Return the grid of instants, shape (n,), cut where laws have breakpoints, and cams and loads jump.

    Where a cam passes a breakpoint of its profile there is a row on either side: the acceleration of its follower may
    jump in between. Where a load jumps with the position or direction of a joint that follows a law there are two rows.

    Args:
        t: Instants [s].
    """
    joints, laws = motion.prescribed.joint_laws, [*motion.laws, *(law for force in forces for law in force.laws())]
    start, end = float(t[0]), float(t[-1])
    leaping = [law for force in forces if (law := force.law) is not None and law.leaps]
    jumps = [x for law in leaping for x in law.passages(joints, start, end)]
    jumps += [x for law in laws if leaping for x in law.breakpoints() if start < x < end]  # where a joint comes to rest
    kinks = [x for cam in cams_of(mechanism.constraints) for x in cam.passages(joints, start, end) if start < x < end]
    near = [x + side * BESIDE * (end - start) for x in kinks for side in (-1.0, 1.0)]
    rows = np.unique([*t, *(x for x in near if start < x < end)]) if near else t
    return Grid.cover(rows, laws, jumps, kinks)


def profile_remarks(mechanism: Mechanism, motion: Mapping[str, Motion]) -> list[str]:
    """Return notes on efforts along profiles: each profile has a drive of its own, which a cam has not."""
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


class NearestPosture(InputStruct, frozen=True):
    """At every instant the configuration on the path with the least ``sum_i (w_i (q_i - q0_i))^2`` over joints i.

    Attributes:
        nearest_to: Joint -> q0, such as ``{elbow: 90 deg}``. Joints that are left out are free to help the others.
        weights: Joint -> w, of every joint of ``nearest_to``, such as ``{elbow: 1, wrist: 2}``; the larger, the nearer
            it stays. Numbers without unit where all of them turn, or all slide; else in 1/rad (or none) and 1/m. 1
            where left out.
        within: ``limits`` keeps the joints within the limits of the model; ``{elbow: [0 deg, 120 deg]}`` keeps some
            joints within others. None are kept where it is left out.
    """

    nearest_to: Annotated[dict[str, Level], msgspec.Meta(min_length=1)]
    weights: dict[str, Weight] = {}
    within: Literal["limits"] | dict[str, tuple[Level, Level]] = {}

    def posture(self, mechanism: Mechanism, followed: Mapping[str, MotionLaw]) -> Posture:
        from pinarm.engine.kinematics.redundancy import Posture
        from pinarm.mechanics.ball_joints import coordinate_name

        model, target, weights = mechanism.model, *np.zeros((2, mechanism.model.nv))
        units = {}
        with within("nearest_to"):
            for name, value in self.nearest_to.items():
                units[name] = _free_joint(mechanism, name, followed).unit
                with within(name):
                    check_unit(value, units[name])
                target[mechanism.joints[name].v] = value
        weights[[mechanism.joints[name].v for name in units]] = weights_of(
            self.weights, units, "joint of nearest_to", "resolve", "angles and lengths"
        )
        lower, upper = self._limits(mechanism, followed)
        for name, value in self.nearest_to.items():
            low, high = (float(bound[mechanism.joints[name].v]) for bound in (lower, upper))
            if not low <= value <= high:
                with within("nearest_to", name):
                    raise InputError(
                        f"{value:g} {units[name]} is outside of the limits of {name}",
                        expected=f"a value from {low:g} to {high:g} {units[name]}",
                    )
        places = np.zeros(model.nv, dtype=np.intp)
        for joint in mechanism.joints.values():
            places[joint.v] = joint.q
        names = tuple(coordinate_name(model, v) for v in range(model.nv))
        return Posture(target, weights, lower, upper, places, names)

    def _limits(self, mechanism: Mechanism, followed: Mapping[str, MotionLaw]) -> tuple[Array, Array]:
        """Return the lower and upper limits, infinite where there are none, each of shape (nv,)."""
        lower, upper = np.full((2, mechanism.model.nv), np.inf) * np.array([[-1.0], [1.0]])
        if isinstance(self.within, str):
            for name, joint in mechanism.joints.items():
                if name not in followed:
                    lower[joint.v] = mechanism.model.lowerPositionLimit[joint.q]
                    upper[joint.v] = mechanism.model.upperPositionLimit[joint.q]
            return lower, upper
        with within("within"):
            for name, bounds in self.within.items():
                joint = _free_joint(mechanism, name, followed)
                for k, bound in enumerate(bounds):
                    with within(name, k):
                        check_unit(bound, joint.unit)
                if not bounds[0] < bounds[1]:
                    with within(name):
                        raise InputError(f"{bounds[0]:g} is not below {bounds[1]:g}", expected="[lower, upper]")
                lower[joint.v], upper[joint.v] = bounds
        return lower, upper


def joint_motion(
    mechanism: Mechanism, motion: Mapping[str, MotionLaw], resolve: NearestPosture | None, place: Place
) -> JointMotion:
    """Return the motion of the joints of a mechanism by laws.

    Args:
        motion: Coordinate -> its law.
        resolve: Posture that chooses a motion where there are fewer laws than degrees of freedom; ``None`` where
            there are as many.
    """
    rolls = mechanism.closure.rolls
    if resolve is None:
        with place("motion"):
            prescribed = determining(mechanism, motion)
        if not rolls:
            return DeterminedMotion(mechanism, prescribed)
        from pinarm.engine.kinematics.joint_motion import RolledMotion

        return RolledMotion(mechanism, prescribed)
    if rolls:
        with place("resolve"):
            raise InputError(
                "a mechanism that rolls has no nearest posture: its positions hang on its whole way",
                expected="a law for every velocity that is left",
            )
    from pinarm.engine.kinematics.redundancy import NearestMotion

    with place("resolve"):
        posture = resolve.posture(mechanism, motion)
    with place("motion"):
        return NearestMotion.of(mechanism, motion, posture)


def rough_start(
    mechanism: Mechanism, start: Mapping[str, float], resolve: NearestPosture | None, motion: JointMotion, grid: Grid
) -> Array:
    """Return the rough configuration from which a motion is assembled, shape (nq,): the start, else the posture."""
    posture = resolve.nearest_to if resolve else {}
    return start_near(mechanism, {**posture, **start}, motion.prescribed, grid)


def _free_joint(mechanism: Mechanism, name: str, followed: Mapping[str, MotionLaw]) -> Joint:
    with within(Key(name)):
        joint = joint_of(mechanism.joints, name)
        if name in followed:
            raise InputError(f"'{name}' follows a law of its own", expected="a joint that the path leaves free")
        return joint
