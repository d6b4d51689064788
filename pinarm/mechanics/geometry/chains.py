"""Open chains between two frames of a tree, at many configurations at once.

The chain from frame 1 to frame 2 follows the tree: from frame 1 towards the root, against the direction of the joints,
to the common ancestor, and from there with it to frame 2. Seen from frame 1 it is a serial arm on a fixed base that
ends at frame 2. So only the joints between the frames matter, and all vectors are in the axes of frame 1, in which the
rows of a loop joint are defined.

Arrays have the configurations along their last axis, so that numpy works on long rows: n of them, or 1 where a vector
is the same in all, such as the axes of a planar mechanism. Of k variants of a model the states stand along that axis,
row by row and variant by variant within each; what differs between variants is repeated for every row.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import takewhile

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.geometry.model_variants import Model, ModelVariants, VariantPlacement, joint_placement
from pinarm.mechanics.geometry.vectors import Axes, Weights, combined, cross, dot
from pinarm.records import Record, replace

ROUNDING = 1e-15
"""Deviation from 0 and 1 in rotation matrices of a model that is rounding; removed, it leaves exact products."""

FIXED = tuple(np.eye(3)[:, :, None])
"""The axes of frame 1 in frame 1, each of shape (3, 1)."""


class Stage(Record, frozen=True):
    """A joint of a chain, with a frame whose z axis is the joint axis.

    Attributes:
        index: Index of its coordinate in q and v.
        turns: True for a revolute joint, False for a prismatic one.
        shift: Origin in the axes of the stage before [m]; components that differ between states are arrays.
        turn: Its three axes in those of the stage before, likewise.
    """

    index: int
    turns: bool
    shift: Weights
    turn: Sequence[Weights]

    def beside(self, place: Array, axes: Axes) -> tuple[Array, Array, Array, Array]:
        """Return its origin and axes, before its own motion, behind a stage of given origin and axes."""
        x, y, z = (combined(axes, column) for column in self.turn)
        return place + combined(axes, self.shift), x, y, z

    def repeated(self, n: int) -> Stage:
        """Return the stage for n rows of all variants."""
        return replace(self, shift=_repeated(self.shift, n), turn=[_repeated(axis, n) for axis in self.turn])


class Chain(Record, frozen=True):
    """The joints between two frames, all revolute or prismatic, each with one index in q and v.

    Attributes:
        stages: Joints from frame 1 to frame 2.
        shift: Origin of frame 2 in the axes of the last stage [m], as that of a stage.
        turn: Axes of frame 2 in those of the last stage, likewise.
        count: Number of variants that differ; 1 where all are alike.
    """

    stages: tuple[Stage, ...]
    shift: Weights
    turn: Sequence[Weights]
    count: int = 1

    @classmethod
    def between(cls, model: Model, first: int, second: int) -> Chain | None:
        """Return the chain between two frames; ``None`` where it contains another kind of joint."""
        start, end = model.frames[first], model.frames[second]
        up, down = (list(model.supports[frame.parentJoint]) for frame in (start, end))
        shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(up, down, strict=False)))
        path = [(j, -1.0) for j in reversed(up[shared:])] + [(j, 1.0) for j in down[shared:]]
        stages, between, axes, count = [], start.placement.inverse(), np.eye(3), 1
        here = VariantPlacement.of(pin.SE3.Identity()) if isinstance(model, ModelVariants) else pin.SE3.Identity()
        for joint, direction in path:
            screw = screw_of(model.joints[joint])
            if screw is None or model.joints[joint].idx_q != model.joints[joint].idx_v:
                return None
            if direction > 0.0:
                between = between * joint_placement(model, joint)
            turns, own = screw[0], _with_z_along(direction * screw[1])
            turn = _rounded(axes.T @ between.rotation @ own)
            shift = np.matvec(axes.T, between.translation)
            stages.append(Stage(int(model.joints[joint].idx_v), turns, _weights(shift), _columns(turn)))
            count = max(count, shift.size // 3, turn.size // 9)
            between = here if direction > 0.0 else joint_placement(model, joint).inverse()
            axes = own
        between = between * end.placement
        shift, turn = np.matvec(axes.T, between.translation), _rounded(axes.T @ between.rotation)
        return cls(tuple(stages), _weights(shift), _columns(turn), max(count, shift.size // 3, turn.size // 9))

    def repeated(self, n: int) -> Chain:
        """Return the chain for n rows of all variants, row by row."""
        if self.count == 1 or n == 1:
            return self
        stages = tuple(stage.repeated(n) for stage in self.stages)
        return Chain(stages, _repeated(self.shift, n), [_repeated(axis, n) for axis in self.turn], n * self.count)

    @cached_property
    def _first(self) -> tuple[Array, Array, Array, Array]:
        """Origin and axes of the first stage before its own motion, which are the same in all configurations."""
        return self.stages[0].beside(np.zeros((3, 1)), FIXED)

    def placed(self, q: Array, cosine: Array, sine: Array) -> Placed:
        """Return the placements of the stages and of frame 2 in frame 1, stage by stage: ``R <- R turn Rz(q)``.

        Args:
            q: Configurations, shape (nv, n): all joints have one coordinate.
            cosine: cos(q), shape (nv, n); only rows of revolute joints are read.
            sine: sin(q), shape (nv, n), likewise.
        """
        place: Array = np.zeros((3, 1))
        axes: Axes = FIXED
        origins, screws = [], []
        for k, stage in enumerate(self.stages):
            place, x, y, z = stage.beside(place, axes) if k else self._first
            origins.append(place)
            screws.append(z)
            if stage.turns:
                c, s = cosine[stage.index], sine[stage.index]
                axes = c * x + s * y, c * y - s * x, z
            else:
                axes, place = (x, y, z), place + q[stage.index] * z
        place = place + combined(axes, self.shift)
        axes = tuple(combined(axes, column) for column in self.turn)
        return Placed(self, place, axes, screws, [place - origin for origin in origins])


class Placed(Record, frozen=True):
    """A chain at n configurations; all vectors are in the axes of frame 1.

    Attributes:
        chain: The chain.
        p: Origin of frame 2 [m], shape (3, n).
        axes: Axes of frame 2, each of shape (3, n).
        screws: Joint axis of every stage, shape (3, n).
        arms: Vector from the origin of every stage to that of frame 2 [m], shape (3, n).
    """

    chain: Chain
    p: Array
    axes: Axes
    screws: list[Array]
    arms: list[Array]

    @cached_property
    def travels(self) -> list[Array]:
        """Velocity of the origin of frame 2 for unit velocity of every stage: ``z x r`` or ``z``, shape (3, n)."""
        parts = zip(self.chain.stages, self.screws, self.arms, strict=True)
        return [cross(screw, arm) if stage.turns else screw for stage, screw, arm in parts]

    def along(self, e: Array) -> dict[int, Array]:
        """Return the row of ``e . p'``: index in v -> coefficient, shape (n,); e has the shape (3, n)."""
        return _present(
            {stage.index: dot(e, travel) for stage, travel in zip(self.chain.stages, self.travels, strict=True)}
        )

    def about(self, w: Array) -> dict[int, Array]:
        """Return the row of ``w . omega``: index in v -> coefficient, shape (n,); w has the shape (3, n)."""
        turning = [(stage, screw) for stage, screw in zip(self.chain.stages, self.screws, strict=True) if stage.turns]
        return _present({stage.index: dot(w, screw) for stage, screw in turning})

    def rows(self, e: Array, w: Array) -> Array:
        """Return the rows of ``e . p' + w . omega`` by stages, shape (m, s, n), or (m, s, 1) where all are the same.

        Args:
            e: Constant directions, shape (m, 3).
            w: Constant directions of rotations, shape (m, 3).
        """
        count = max([x.shape[1] for x in (*self.travels, *self.screws)], default=1)
        motions = np.zeros((6, len(self.screws), count))
        for k, (stage, travel, screw) in enumerate(zip(self.chain.stages, self.travels, self.screws, strict=True)):
            motions[:3, k] = travel
            if stage.turns:
                motions[3:, k] = screw
        return (np.concatenate([e, w], axis=1) @ motions.reshape(6, -1)).reshape(len(e), -1, count)

    def rates(self, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return the motion of frame 2 in frame 1 for joint velocities v, shape (nv, n), and zero joint accelerations.

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
    """Return a row without coefficients that are 0 in all configurations."""
    return {index: x for index, x in row.items() if len(x) > 1 or x[0]}


def screw_of(joint: pin.JointModel) -> tuple[bool, Array] | None:
    """Return whether a joint is revolute, and its axis in joint axes; ``None`` if neither revolute nor prismatic."""
    if joint.nq != 1 or joint.nv != 1:
        return None
    data = joint.createData()
    joint.calc(data, np.zeros(max(joint.idx_q, 0) + 1))  # it reads at its place in q, unchecked
    motion = np.asarray(data.S, float).ravel()
    slides, turns = motion[:3].any(), motion[3:].any()
    return None if slides and turns else (bool(turns), motion[3:] if turns else motion[:3])


def _with_z_along(axis: Array) -> Array:
    """Return a rotation matrix whose third column is an axis, shape (3, 3); exact for coordinate axes."""
    k = int(np.abs(axis).argmax())
    normal = np.zeros(3)
    normal[(k + 1) % 3] = 1.0
    normal -= (normal @ axis) * axis
    normal /= np.linalg.norm(normal)
    return np.column_stack([normal, np.cross(axis, normal), axis])


def _weights(x: Array) -> Weights:
    """Return the components of a vector, shape (3,), or of those of k variants, shape (k, 3)."""
    if x.ndim == 1:
        return [float(part) for part in x]  # numpy multiplies arrays by floats in less time than by its own numbers
    return [part if len(part) > 1 and (part != part[0]).any() else float(part[0]) for part in np.ascontiguousarray(x.T)]


def _columns(turn: Array) -> Sequence[Weights]:
    """Return the columns of a rotation matrix, shape (3, 3), or of those of k variants, shape (k, 3, 3)."""
    return [_weights(turn[..., k]) for k in range(3)]


def _repeated(weights: Weights, n: int) -> Weights:
    """Return components for n rows of all variants."""
    return [np.tile(part, n) if isinstance(part, np.ndarray) else part for part in weights]


def _rounded(turn: Array) -> Array:
    nearest = np.round(turn)
    return np.where(np.abs(turn - nearest) < ROUNDING, nearest, turn)
