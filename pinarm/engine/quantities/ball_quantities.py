"""Quantities of ball joints: orientation, angular velocity and moment, in the axes of the link that they carry."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.ball_joints import ANGLES, Ball, BallAngle, BallCoordinate, roll_pitch_yaw

VECTORS = {
    "angular_velocity": unit("rad/s"), "angular_acceleration": unit("rad/s^2"), "effort": unit("N*m"),
    "link_effort": unit("N*m"),
}  # fmt: skip
COMPONENTS = ("x", "y", "z", "norm")
PARTS = {
    "quaternion": ("x", "y", "z", "w"), **dict.fromkeys(ANGLES, ()), **dict.fromkeys(VECTORS, COMPONENTS), "power": (),
}  # fmt: skip
"""What can be asked of a ball joint, beside the wrench that every joint transmits, with its components."""

MEANINGS = {
    "quaternion": "orientation of a ball joint's link in the joint's placement",
    "roll": "its angle about x", "pitch": "its angle about y", "yaw": "its angle about z",
    "angular_velocity": "of a ball joint's link, in the link's own axes",
    "angular_acceleration": "of a ball joint's link, in the link's own axes",
}  # fmt: skip


def ball_quantity(run: Trajectory, ball: Ball, name: str, part: str) -> Series | None:
    """Return a quantity of a ball joint by its name, ``None`` where there is none of this name.

    Args:
        run: The motion.
        ball: The joint.
        name: Name of the series.
        part: As ``PARTS`` has it: the quaternion of the link in the joint's placement; roll, pitch and yaw [rad];
            ``angular_velocity``, ``angular_acceleration`` and ``effort`` [rad/s, rad/s^2, N*m], the moment of its
            drive, its rotor's share included, and ``link_effort`` without that; ``power`` of the first [W].

    Raises:
        InputError: The effort is asked of a joint that is moved along the components of its rotation vector.
    """
    word, _, axis = part.partition(".")
    if word not in PARTS or axis not in (PARTS[word] or ("",)):
        return None
    if word == "quaternion":
        return Series(name, unit("1"), ball.quaternion(run.q)[:, "xyzw".index(axis)])
    if word in ANGLES:
        return Series(name, unit("rad"), roll_pitch_yaw(ball.quaternion(run.q))[:, ANGLES.index(word)])
    if word == "power":
        return Series(name, unit("W"), (_effort(run, ball, name) * ball.vectors(run.v)).sum(axis=1))
    values = {"angular_velocity": run.v, "angular_acceleration": run.a}
    vectors = ball.vectors(values[word]) if word in values else _effort(run, ball, name)
    if word == "link_effort":
        vectors = vectors - ball.vectors(run.mechanism.model.armature) * ball.vectors(run.a)
    component = np.linalg.norm(vectors, axis=1) if axis == "norm" else vectors[:, "xyz".index(axis)]
    return Series(name, VECTORS[word], np.asarray(component))


def _effort(run: Trajectory, ball: Ball, name: str) -> Array:
    if run.no_efforts:
        raise InputError(f"'{name}': {run.no_efforts}", hint="kind: inverse")
    coordinates = run.mechanism.coordinates
    turned = {
        name: coordinate
        for name, coordinate in coordinates.items()
        if isinstance(coordinate, BallCoordinate | BallAngle)
    }
    guided = [one for one in run.closure.slices if one in turned and turned[one].ball == ball]
    if guided:
        raise InputError(f"'{name}': the drive acts along {', '.join(guided)}",
                         hint=f"joint.{ball.name}.moment.x, or coordinate.{guided[0]}.effort")  # fmt: skip
    return ball.vectors(run.tau)
