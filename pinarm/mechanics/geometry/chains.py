"""Open chains between two frames of a tree, at many configurations at once.

The chain from frame 1 to frame 2 runs along the tree: against the joints up to the common ancestor, with them down from
there. Seen from frame 1 it is a serial arm on a fixed base, with the twist of frame 2 in frame 1 as its own. So only
the joints between the frames matter, and all vectors are in the axes of frame 1, in which a loop joint says what it
holds.

Arrays have the configurations along their last axis, so that numpy works on long rows: n of them, or 1 where a vector
is the same in all, such as the axes of a planar mechanism.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.vectors import Axes, combined, cross, dot

ROUNDING = 1e-15
"""What rounding leaves of 0 and 1 in the rotation matrices of a model; taken away, such products cost nothing."""

FIXED = tuple(np.eye(3)[:, :, None])
"""The axes of frame 1 in themselves."""


@dataclass(frozen=True, eq=False)
class Stage:
    """A joint of a chain; its axis is the z axis of a frame of its own.

    Attributes:
        index: Place of its coordinate in q and v.
        turns: Whether it turns about its axis; otherwise it slides along it.
        shift: From the stage before, in the axes there [m], shape (3,).
        turn: Axes of this stage in those of the stage before, as columns, shape (3, 3).
    """

    index: int
    turns: bool
    shift: Array
    turn: Array


@dataclass(frozen=True, eq=False)
class Chain:
    """The joints between two frames, all of them revolute or prismatic, at the same places in q and in v.

    Attributes:
        stages: From frame 1 to frame 2.
        shift: From the last stage to frame 2 [m], shape (3,).
        turn: Axes of frame 2 in those of the last stage, as columns, shape (3, 3).
    """

    stages: tuple[Stage, ...]
    shift: Array
    turn: Array

    @classmethod
    def between(cls, model: pin.Model, first: int, second: int) -> Chain | None:
        """Return the chain between two frames; ``None`` where there is another kind of joint in it."""
        one, two = model.frames[first], model.frames[second]
        up, down = (list(model.supports[frame.parentJoint]) for frame in (one, two))
        path = [(j, -1.0) for j in reversed(up) if j not in down] + [(j, 1.0) for j in down if j not in up]
        stages, between, axes = [], one.placement.inverse(), np.eye(3)
        for joint, direction in path:
            screw = _screw(model.joints[joint])
            if screw is None or model.joints[joint].idx_q != model.joints[joint].idx_v:
                return None
            if direction > 0.0:
                between = between * model.jointPlacements[joint]
            turns, own = screw[0], _with_z_along(direction * screw[1])
            turn = _rounded(axes.T @ between.rotation @ own)
            stages.append(Stage(int(model.joints[joint].idx_v), turns, axes.T @ between.translation, turn))
            between = pin.SE3.Identity() if direction > 0.0 else model.jointPlacements[joint].inverse()
            axes = own
        between = between * two.placement
        return cls(tuple(stages), axes.T @ between.translation, _rounded(axes.T @ between.rotation))

    def placed(self, q: Array, cosine: Array, sine: Array) -> Placed:
        """Return where everything is.

        Args:
            q: Configurations, shape (nv, n): all joints have one coordinate.
            cosine: cos(q), shape (nv, n); only rows of revolute joints are read.
            sine: sin(q), shape (nv, n), likewise.
        """
        place: Array = np.zeros((3, 1))
        axes: Axes = FIXED
        origins, screws = [], []
        for stage in self.stages:
            place = place + combined(axes, stage.shift)
            x, y, z = (combined(axes, column) for column in stage.turn.T)
            origins.append(place)
            screws.append(z)
            if stage.turns:
                c, s = cosine[stage.index], sine[stage.index]
                axes = c * x + s * y, c * y - s * x, z
            else:
                axes, place = (x, y, z), place + q[stage.index] * z
        place = place + combined(axes, self.shift)
        axes = tuple(combined(axes, column) for column in self.turn.T)
        return Placed(self, place, axes, screws, [place - origin for origin in origins])


@dataclass(frozen=True, eq=False)
class Placed:
    """A chain at many configurations; all vectors are in the axes of frame 1.

    Attributes:
        chain: The chain.
        p: Place of the origin of frame 2 [m], shape (3, n).
        axes: Axes of frame 2, each of shape (3, n).
        screws: Axis of every stage, shape (3, n).
        arms: From the origin of every stage to that of frame 2 [m], shape (3, n).
    """

    chain: Chain
    p: Array
    axes: Axes
    screws: list[Array] = field(repr=False)
    arms: list[Array] = field(repr=False)

    @cached_property
    def travels(self) -> list[Array]:
        """Velocity of the origin of frame 2 for every stage at velocity 1, shape (3, n)."""
        parts = zip(self.chain.stages, self.screws, self.arms, strict=True)
        return [cross(screw, arm) if stage.turns else screw for stage, screw, arm in parts]

    def along(self, e: Array) -> dict[int, Array]:
        """Return the row of ``e . p'``: place in v -> coefficient, shape (n,); e has the shape (3, n)."""
        return _present(
            {stage.index: dot(e, travel) for stage, travel in zip(self.chain.stages, self.travels, strict=True)}
        )

    def about(self, w: Array) -> dict[int, Array]:
        """Return the row of ``w . omega``: place in v -> coefficient, shape (n,); w has the shape (3, n)."""
        turning = [(stage, screw) for stage, screw in zip(self.chain.stages, self.screws, strict=True) if stage.turns]
        return _present({stage.index: dot(w, screw) for stage, screw in turning})

    def rates(self, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return how frame 2 moves in frame 1 under velocities v of the joints, shape (nv, n), without accelerations.

        From stage to stage, over an arm r and with the joint's velocity u along its axis z:
        ``p' += omega x r``, ``p'' += omega' x r + omega x (omega x r)``, then for a joint that turns
        ``omega' += omega x z u`` and ``omega += z u``, for one that slides ``p'' += 2 omega x z u`` and ``p' += z u``.

        Returns:
            p' [m/s], omega [rad/s], and ``p''``, ``omega'`` for a = 0, each of shape (3, n).
        """
        dp, omega, ddp, domega = (np.zeros((3, 1)) for _ in range(4))
        stages = self.chain.stages
        arms = [*self.arms, np.zeros((3, 1))]
        for k, stage in enumerate(stages):
            u = v[stage.index] * self.screws[k]
            if stage.turns:
                domega = domega + cross(omega, u)
                omega = omega + u
            else:
                ddp = ddp + 2.0 * cross(omega, u)
                dp = dp + u
            r = arms[k] - arms[k + 1]
            turned = cross(omega, r)
            dp = dp + turned
            ddp = ddp + cross(domega, r) + cross(omega, turned)
        return dp, omega, ddp, domega


def _present(row: dict[int, Array]) -> dict[int, Array]:
    """Return a row without the coefficients that are 0 in all configurations."""
    return {index: x for index, x in row.items() if len(x) > 1 or x[0]}


def _screw(joint: pin.JointModel) -> tuple[bool, Array] | None:
    """Return whether a joint turns, and its axis in its own frame; ``None`` if it does neither that nor slide."""
    if joint.nq != 1 or joint.nv != 1:
        return None
    data = joint.createData()
    joint.calc(data, np.zeros(1))
    motion = np.asarray(data.S, float).ravel()
    slides, turns = motion[:3].any(), motion[3:].any()
    return None if slides and turns else (bool(turns), motion[3:] if turns else motion[:3])


def _with_z_along(axis: Array) -> Array:
    """Return a rotation matrix whose third column is an axis, shape (3, 3); exact for the axes of coordinates."""
    k = int(np.abs(axis).argmax())
    one = np.zeros(3)
    one[(k + 1) % 3] = 1.0
    one -= (one @ axis) * axis
    one /= np.linalg.norm(one)
    return np.column_stack([one, np.cross(axis, one), axis])


def _rounded(turn: Array) -> Array:
    nearest = np.round(turn)
    return np.where(np.abs(turn - nearest) < ROUNDING, nearest, turn)
