"""Loop joints: joints of any kind between two links that the tree has already joined another way.

What a kind of joint holds is a ``Pair``. The multiplier lam of a row ``e . p' + w . omega = 0`` is a force ``lam e`` at
the origin of frame 2 and a moment ``lam w``, of the first link on the second.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import InputStruct, Span
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import cross, crossed
from pinarm.mechanics.joints import METRE, RADIAN, Direction, frame_of, unit_vector
from pinarm.mechanics.loops.pairs import ALL, NOTHING, Cross, LowerPair, Pair, Tie, normals

LOCAL = pin.ReferenceFrame.LOCAL


@dataclass(frozen=True, eq=False)
class LoopJoint:
    """A loop joint of one mechanism, ready for evaluation.

    Attributes:
        name: Its name.
        kind: Its kind, as files call it.
        first: Index of frame 1.
        second: Index of frame 2.
        pair: What the joint allows.
    """

    name: str
    kind: str
    first: int
    second: int
    pair: Pair = field(repr=False)

    @property
    def size(self) -> int:
        """Number m of rows."""
        return self.pair.size

    def unit(self, row: int) -> Unit:
        """Return the unit of the gap in a row: m or rad."""
        return METRE if row < self.pair.lengths else RADIAN

    def gap(self, state: Kinematics) -> Array:
        """Return what is not closed [m or rad], shape (m,)."""
        data = state.data
        return np.concatenate(self.pair.gap(*_placed(data.oMf[self.first], data.oMf[self.second])))

    def rows(self, state: Kinematics) -> Array:
        """Return G, shape (m, nv)."""
        model, data = state.model, state.data
        between = data.oMf[self.first].actInv(data.oMf[self.second])
        one, two = (
            pin.getFrameJacobian(model, data, frame, LOCAL).reshape(6, -1) for frame in (self.first, self.second)
        )
        p, relative = between.translation, between.action @ two - one
        e, w = self.pair.directions(p, np.asarray(between.rotation.T))
        return np.concatenate([e @ (relative[:3] - pin.skew(p) @ relative[3:]), w @ relative[3:]])

    def drift(self, state: Kinematics) -> Array:
        """Return G' v, shape (m,)."""
        model, data = state.model, state.data
        one, two = self.first, self.second
        between = data.oMf[one].actInv(data.oMf[two])
        own, twist = (pin.getFrameVelocity(model, data, frame, LOCAL) for frame in (one, two))
        drift, other = (pin.getFrameAcceleration(model, data, frame, LOCAL) for frame in (one, two))
        relative = between.act(twist) - own
        change = between.act(other) - drift + relative.cross(own)  # of the relative twist, in the axes of frame 1
        p, axes = between.translation, np.asarray(between.rotation.T)
        omega, domega = relative.angular, change.angular
        dp = relative.linear + cross(omega, p)
        ddp = change.linear + cross(domega, p) + cross(omega, dp)
        e, w = self.pair.directions(p, axes)
        return np.asarray(np.concatenate([e @ ddp, w @ domega]) + np.concatenate(self.pair.bend(p, axes, dp, omega)))

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return what multipliers, shape (n, m), do to links: joint index -> [f; m] at the world's origin, (n, 6)."""
        wrench, place = self.wrench(links, lam), links.frame(self.second)[1]
        moved = np.concatenate([wrench[:, :3], wrench[:, 3:] + crossed(place, wrench[:, :3])], axis=1)
        frames = links.model.frames
        return {frames[self.second].parentJoint: moved, frames[self.first].parentJoint: -moved}

    def wrench(self, links: LinkPlacements, lam: Array) -> Array:
        """Return [f; m] of the first link on the second, at the origin of frame 2, world axes [N, N*m], (n, 6)."""
        (turn, origin), (other, place) = links.frame(self.first), links.frame(self.second)
        axes = (turn.swapaxes(1, 2) @ other).transpose(2, 1, 0)
        directions = self.pair.directions(np.vecmat(place - origin, turn).T, axes)
        parts = lam[:, : self.pair.lengths], lam[:, self.pair.lengths :]
        inner = (np.einsum("nk,kcn->nc", x, _spread(e, len(x))) for x, e in zip(parts, directions, strict=True))
        return np.concatenate([np.matvec(turn, one) for one in inner], axis=1)


def _spread(directions: Array, n: int) -> Array:
    """Return directions, shape (k, 3) or (k, 3, n), at n configurations."""
    spread = directions[:, :, None] if directions.ndim == 2 else directions
    return np.broadcast_to(spread, (*directions.shape[:2], n))


def _placed(one: pin.SE3, two: pin.SE3) -> tuple[Array, Array]:
    """Return the place of frame 2 in frame 1, and its axes as the rows of an array, shape (3, 3)."""
    between = one.actInv(two)
    return between.translation, np.asarray(between.rotation.T)


class LoopDefinition(InputStruct, frozen=True):
    """What every loop joint says.

    Attributes:
        between: The two links whose frames the joint ties; a fixed link without mass serves as a named frame.
    """

    between: tuple[str, str]

    def bound(self, model: pin.Model, name: str, pair: Pair) -> LoopJoint:
        """Return the loop joint of one model.

        Raises:
            InputError: A link does not exist, or both belong to one rigid body.
        """
        first, second = (frame_of(model, link) for link in self.between)
        if model.frames[first].parentJoint == model.frames[second].parentJoint:
            raise InputError(
                f"{' and '.join(self.between)} belong to one rigid body: a joint between them closes no loop",
                expected="links that move against each other",
            )
        return LoopJoint(name, str(self.__struct_config__.tag), first, second, pair)


class Fixed(LoopDefinition, frozen=True, tag_field="kind", tag="fixed"):
    """The frames coincide."""

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        points = np.vstack([np.zeros(3), ALL[:2]])
        return self.bound(model, name, LowerPair(ALL, ALL, ALL[2], points))


class Revolute(LoopDefinition, frozen=True, tag_field="kind", tag="revolute"):
    """The frames turn against each other about a common axis; the origins coincide."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(ALL, normals(axis), axis, np.array([np.zeros(3), axis])))


class Prismatic(LoopDefinition, frozen=True, tag_field="kind", tag="prismatic"):
    """Frame 2 slides along an axis without turning."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(normals(axis), ALL, axis))


class Cylindrical(LoopDefinition, frozen=True, tag_field="kind", tag="cylindrical"):
    """Frame 2 slides along an axis and turns about it."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(normals(axis), normals(axis), axis))


class Spherical(LoopDefinition, frozen=True, tag_field="kind", tag="spherical"):
    """A ball joint: the origins coincide."""

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        return self.bound(model, name, LowerPair(ALL, NOTHING, ALL[2], np.zeros((1, 3))))


class Universal(LoopDefinition, frozen=True, tag_field="kind", tag="universal"):
    """The origins coincide; an axis of frame 1 and an axis of frame 2, those of the cross, stay at right angles.

    Attributes:
        axes: The axis of the cross in frame 1, and that in frame 2.
    """

    axes: tuple[Direction, Direction] = ("x", "y")

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        return self.bound(model, name, Cross(unit_vector(self.axes[0]), unit_vector(self.axes[1])))


class Planar(LoopDefinition, frozen=True, tag_field="kind", tag="planar"):
    """Two planes slide on each other; the axis is their normal."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(axis[None], normals(axis), axis))


class PointOnLine(LoopDefinition, frozen=True, tag_field="kind", tag="point_on_line"):
    """The origin of frame 2 stays on a line through that of frame 1."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(normals(axis), NOTHING, axis))


class PointOnPlane(LoopDefinition, frozen=True, tag_field="kind", tag="point_on_plane"):
    """The origin of frame 2 stays in a plane through that of frame 1; the axis is its normal."""

    axis: Direction = "z"

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        axis = unit_vector(self.axis)
        return self.bound(model, name, LowerPair(axis[None], NOTHING, axis))


class Rod(LoopDefinition, frozen=True, tag_field="kind", tag="rod", kw_only=True):
    """The origins keep their distance, as by a rod without mass with ball joints at its ends."""

    length: Span

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
        """Return the loop joint of one model."""
        return self.bound(model, name, Tie(float(self.length)))


Loop = Fixed | Revolute | Prismatic | Cylindrical | Spherical | Universal | Planar | PointOnLine | PointOnPlane | Rod
"""Any loop joint. A new kind is one class above, with a ``Pair`` that says what it holds, and one entry here."""
