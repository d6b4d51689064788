"""Joints of the tree, coordinates and drives: motion and efforts along them, and the wrenches of joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from pinarm.arrays import Array, length
from pinarm.engine.quantities.family import (
    ALONG_AXIS,
    AXES,
    NEWTON,
    NEWTON_METRE,
    RATES,
    SAY_HOW,
    WATT,
    WRENCH,
    Asked,
    Family,
    Offered,
    WrenchFamily,
    acts,
)
from pinarm.engine.quantities.reactions import fixed_joints, fixed_wrench, tree_axis
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.ball_joints import ANGLES, Ball, BallCoordinate, roll_pitch_yaw
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.forces.along_coordinate import AlongCoordinate
from pinarm.mechanics.joints import METRE, effort_unit
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.mechanics.rotors import Drive

AT_PARENT = "at_parent"
"""Asks for the moment of a joint about its place on the parent: where a joint slides, the child's origin moves."""

EFFORTS = ("effort", "link_effort")

BALL_VECTORS = {
    "angular_velocity": unit("rad/s"),
    "angular_acceleration": unit("rad/s^2"),
    "effort": NEWTON_METRE,
    "link_effort": NEWTON_METRE,
}
"""Vectors of ball joints, in the axes of the link that they carry."""

BALL_PARTS = {
    "quaternion": ("x", "y", "z", "w"),
    **dict.fromkeys(ANGLES, ()),
    **dict.fromkeys(BALL_VECTORS, AXES),
    "power": (),
}
"""Quantities of a ball joint, beside the wrench that every joint transmits, with their components."""


class JointQuantities(WrenchFamily, frozen=True):
    """``joint.J...``: of joints with one coordinate and of ball joints."""

    element: ClassVar[str] = "J"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "position": "coordinate of the joint",
        "velocity": "its rate",
        "acceleration": "its second derivative",
        "effort": "effort of all drives at the joint, those along sums of joints and their rotors' shares included; "
        "that of one drive is coordinate.J.effort; of a joint without a drive, of the couplings that move "
        "it, or where none do what its end stops push; behind an elastic gear, what it gives, in every kind "
        "of problem, and what drives the joint itself beside it",
        "link_effort": "what of the effort reaches the links: without armature * acceleration",
        "power": "effort times velocity",
        "force": "force of the parent on the child, at the child's origin; of fixed joints of the model too",
        "moment": "moment of the parent on the child, about the child's origin",
        f"moment.{AT_PARENT}": "the same moment about the joint's place on the parent",
        "quaternion": "orientation of a ball joint's link in the joint's placement",
        "roll": "its angle about x",
        "pitch": "its angle about y",
        "yaw": "its angle about z",
        "angular_velocity": "of a ball joint's link, in the link's own axes",
        "angular_acceleration": "of a ball joint's link, in the link's own axes",
    }

    def entries(self) -> Iterator[Offered]:
        mechanism = self.run.mechanism
        for name, joint in mechanism.joints.items():
            yield from (Offered(name, part) for part in (*RATES, *EFFORTS, "power"))
            along = ALONG_AXIS if tree_axis(mechanism.model, joint.index) is not None else ()
            yield from self._transmitted_entries(name, along)
        for name in mechanism.balls:
            yield from (Offered(name, part, components) for part, components in BALL_PARTS.items())
            yield from self._transmitted_entries(name, ())
        for name in fixed_joints(mechanism.model):
            yield from (Offered(name, part, AXES) for part in WRENCH)

    def _transmitted_entries(self, name: str, along: tuple[str, ...]) -> Iterator[Offered]:
        yield from (Offered(name, part, (*AXES, *along)) for part in WRENCH)
        yield Offered(name, f"moment.{AT_PARENT}", AXES)

    def series(self, asked: Asked) -> Series:
        mechanism = self.run.mechanism
        if (ball := mechanism.balls.get(asked.of)) is not None:
            return self._of_ball(asked, ball) if asked.part in BALL_PARTS else self._transmitted(asked, ball.index)
        if (joint := mechanism.joints.get(asked.of)) is None:
            return self._of_fixed(asked)
        if len(asked.words) > 2:
            return self._transmitted(asked, joint.index)
        if asked.part in RATES:
            return self.rate(asked, asked.of, asked.part)
        self.require_efforts(asked)
        effort = self.run.effort(joint.v)
        if asked.part in EFFORTS:
            armature = self.run.armature(joint.v) if asked.part == "link_effort" else 0.0
            values, measure = effort - armature * self.run.a[..., joint.v], effort_unit(joint.unit)
        elif asked.part == "power":
            values, measure = effort * self.run.v[..., joint.v], WATT
        else:
            raise asked.unknown
        stresses = self.evaluation.reactions.stressed_multipliers(self.run.couplings_at(joint.v))
        return Series(asked.name, measure, values, self.doubt(asked, stresses))

    def _of_fixed(self, asked: Asked) -> Series:
        frame = fixed_joints(self.run.mechanism.model).get(asked.of)
        if frame is None or len(asked.words) < 3 or asked.part not in WRENCH:
            raise asked.unknown
        self.require_efforts(asked)
        origins = self.evaluation.reactions.links.frame(frame)[1]
        return self.wrench(asked, origins, fixed_wrench(self.evaluation.reactions, asked.of), [], origins)

    def _transmitted(self, asked: Asked, index: int) -> Series:
        """Return a component of the wrench that a joint transmits, by Pinocchio's index of the joint."""
        self.require_efforts(asked)
        if len(asked.words) < 3 or asked.part not in WRENCH:
            raise asked.unknown
        reactions = self.evaluation.reactions
        about = origins = reactions.origins[..., index, :]
        if asked.words[1:3] == ("moment", AT_PARENT):
            about = reactions.markers(index)
            asked = replace(asked, words=(*asked.words[:2], *asked.words[3:]))
        for wrench in reactions.open_wrenches(index) if self.evaluation.judged else ():
            if acts(self.wrench_component(asked, origins, wrench, about)):
                raise InputError(
                    f"'{asked.name}': {reactions.left_open[index]}",
                    expected="a joint before or beyond them",
                    hint=SAY_HOW,
                )
        return self.wrench(asked, origins, reactions.joints[..., index, :], reactions.stressed_joint(index), about)

    def axes(self, asked: Asked) -> Array:
        """Return the axis of a joint, world axes, shape (n, 3)."""
        joint = self.run.mechanism.joints.get(asked.of)
        axes = self.evaluation.reactions.tree_axes(joint.index) if joint else None
        if axes is None:
            raise asked.unknown
        return axes

    def _of_ball(self, asked: Asked, ball: Ball) -> Series:
        """Return a quantity of a ball joint by one of ``BALL_PARTS``."""
        run, (part, *axis) = self.run, asked.words[1:]
        if len(axis) != bool(BALL_PARTS[part]) or (axis and axis[0] not in BALL_PARTS[part]):
            raise asked.unknown
        if part == "quaternion":
            return Series(asked.name, unit("1"), ball.quaternion(run.q)[:, "xyzw".index(axis[0])])
        if part in ANGLES:
            return Series(asked.name, unit("rad"), roll_pitch_yaw(ball.quaternion(run.q))[:, ANGLES.index(part)])
        if part == "power":
            return Series(asked.name, WATT, (self._ball_effort(asked, ball) * ball.vectors(run.v)).sum(axis=1))
        rates = {"angular_velocity": run.v, "angular_acceleration": run.a}
        vectors = ball.vectors(rates[part]) if part in rates else self._ball_effort(asked, ball)
        if part == "link_effort":
            vectors = vectors - ball.vectors(run.mechanism.model.armature) * ball.vectors(run.a)
        values = length(vectors) if axis == ["norm"] else vectors[:, AXES.index(axis[0])]
        return Series(asked.name, BALL_VECTORS[part], np.asarray(values))

    def _ball_effort(self, asked: Asked, ball: Ball) -> Array:
        """Return the moment of the drive of a ball joint, with its rotor's share, axes of the link, shape (n, 3)."""
        run, coordinates = self.run, self.run.mechanism.coordinates
        self.require_efforts(asked)
        for name in run.closure.slices:
            guided = coordinates.get(name)
            if isinstance(guided, BallCoordinate) and guided.ball == ball:
                raise InputError(
                    f"'{asked.name}': the drive acts along {name}",
                    hint=f"joint.{ball.name}.moment.x, or coordinate.{name}.effort",
                )
        return ball.vectors(run.tau)


class CoordinateQuantities(JointQuantities, frozen=True):
    """``coordinate.C...``: of coordinates of joints, and of those defined beside them."""

    element: ClassVar[str] = "C"
    meanings: ClassVar[Mapping[str, str]] = {
        "position": "coordinate",
        "velocity": "its rate",
        "acceleration": "its second derivative",
        "effort": "effort of the drive along it",
    }

    def entries(self) -> Iterator[Offered]:
        """Yield all coordinates, and the efforts of drives along those that are no joint's."""
        run = self.run
        guided = run.closure.slices.keys() - run.mechanism.closure.slices.keys()
        for name in run.mechanism.coordinates:
            yield from (Offered(name, rate) for rate in RATES)
            if name in guided or run.effort_along(name) is not None:
                yield Offered(name, "effort")

    def series(self, asked: Asked) -> Series:
        along = ".".join(asked.words[:-1])
        if asked.words[-1] == "effort" and along in self.run.mechanism.coordinates:
            return self._effort(asked, along)
        return self.rate(asked, along, asked.words[-1])

    def _effort(self, asked: Asked, along: str) -> Series:
        """Return the effort of a drive along a coordinate: of joints, or one that has a multiplier of its own."""
        run = self.run
        self.require_efforts(asked)
        measure = NEWTON if run.mechanism.coordinates[along].unit == METRE else NEWTON_METRE
        if (effort := run.effort_along(along)) is not None:
            return Series(asked.name, measure, effort)
        if along in run.mechanism.joints:
            return super().series(Asked(asked.name, (along, "effort")))
        rows = run.closure.slices.get(along)
        if rows is None or along in run.mechanism.closure.slices:
            raise InputError(f"no drive acts along '{along}'", expected="a coordinate named in drives:")
        return Series(asked.name, measure, run.lam[:, rows.start])


class DriveQuantities(Family, frozen=True):
    """``drive.D...``: of the motor of drive D."""

    element: ClassVar[str] = "D"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "torque": "torque of the motor, its rotor's share and the losses of the gear included",
        "speed": "speed of the motor: that of the joint times the ratio",
        "power": "torque times speed",
        "deflection": "of an elastic gear, at the joint: of the rotor over the ratio, less that of the joint",
    }

    def entries(self) -> Iterator[Offered]:
        for name, drive in self.run.mechanism.drives.items():
            yield from (Offered(name, part) for part in self.meanings if part != "deflection" or drive.elasticity)

    def series(self, asked: Asked) -> Series:
        run, drive = self.run, self.run.mechanism.drives.get(asked.of)
        if drive is None or len(asked.words) != 2 or asked.part not in self.meanings:
            raise asked.unknown
        if asked.part == "deflection":
            return self._deflection(asked)
        index = run.mechanism.driven_joint(asked.of).v
        speed = drive.speed(run.v[..., index])
        if asked.part == "speed":
            return Series(asked.name, unit("rad/s"), speed)
        self.require_efforts(asked)
        torque = self._torque(asked, drive, index)
        return (
            Series(asked.name, NEWTON_METRE, torque)
            if asked.part == "torque"
            else Series(asked.name, WATT, torque * speed)
        )

    def _torque(self, asked: Asked, drive: Drive, index: int) -> Array:
        """Return the torque of the motor, by the index of the joint that it moves, shape (n,)."""
        run = self.run
        tells = f"drive.{asked.of}.friction" in run.columns
        if not drive.rigid and drive.efficiency < 1.0 and not tells and run.tau[..., index].any():
            raise InputError(
                f"'{asked.name}': the losses of an elastic gear follow from the motion under a controller",
                expected="a controller of the drive in a forward problem, or an efficiency of 1",
            )
        if drive.turns_rotor and run.driven is not None and run.driven[index]:  # losses come behind the rotor
            return run.supplied[..., index] / float(drive.ratio)
        if drive.elasticity is not None:
            joint = run.mechanism.joints[drive.joint].v if drive.joint else None
            if run.driven is not None and (joint is None or run.driven[joint]):
                raise InputError(
                    f"'{asked.name}': what drives '{drive.coordinate}' here is not the motor behind its elastic gear",
                    expected="a controller of the drive in a forward problem, or a drive without elasticity",
                )
            return run.supplied[..., index] / float(drive.ratio)
        a, effort = run.a[..., index], self._effort(drive)
        torque = drive.torque(effort - drive.armature * a, run.direction(index), a)
        return np.where(effort == 0.0, 0.0, torque)  # off: what moves its rotor loses nothing

    def _deflection(self, asked: Asked) -> Series:
        element = self.run.mechanism.forces.get(f"elasticity of {asked.of}")
        if not isinstance(element, AlongCoordinate) or not isinstance(element.coordinate, LinearCoordinate):
            raise asked.unknown  # the gear is rigid
        return Series(asked.name, element.coordinate.unit, element.coordinate.at(self.run.q))

    def _effort(self, drive: Drive) -> Array:
        """Return the effort of what drives the joint or the coordinate, the rotor's share included, shape (n,)."""
        if drive.joint:
            return self.run.drive_effort(drive.joint)
        along = CoordinateQuantities(self.evaluation)
        return along.series(Asked(f"coordinate.{drive.coordinate}.effort", (drive.coordinate, "effort"))).values
