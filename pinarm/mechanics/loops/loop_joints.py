"""A loop joint of one mechanism, and what files say of any.

What a kind of joint holds is a ``Pair``. The multiplier lam of a row ``e . p' + w . omega = 0`` is a force ``lam e`` at
the origin of frame 2 and a moment ``lam w``, of the first link on the second: their power is ``lam`` times the row.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, vecmat
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements, opposed
from pinarm.mechanics.geometry.link_tree import LinkTree, states_first
from pinarm.mechanics.geometry.vectors import cross, joined, moved, rotated
from pinarm.mechanics.joints import METRE, RADIAN, frame_of
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.loops.pair import Pair

LOCAL = pin.ReferenceFrame.LOCAL


class LoopJoint(Record, frozen=True):
    """A loop joint of one mechanism, ready for evaluation.

    Attributes:
        name: Its name.
        kind: Its kind, as files call it.
        first: Index of frame 1.
        second: Index of frame 2.
        pair: What the joint holds.
    """

    name: str
    kind: str
    first: int
    second: int
    pair: Pair

    @property
    def side(self) -> float:
        """0: it holds both ways."""
        return 0.0

    @property
    def size(self) -> int:
        return len(self.pair.along)

    def unit(self, row: int) -> Unit:
        """Return the unit of the gap in a row: m or rad."""
        return METRE if self.pair.along[row] else RADIAN

    def helical(self, row: int) -> bool:
        """Tell whether a row ties a way to an angle, so that its gap is known but for whole leads."""
        return self.pair.along[row] and self.pair.about[row]

    def gap(self, state: Kinematics) -> Array:
        between = state.data.oMf[self.first].actInv(state.data.oMf[self.second])
        return np.array(self.pair.gap(between.translation, np.asarray(between.rotation.T)))

    def rows(self, state: Kinematics) -> Array:
        """Return G, shape (m, nv).

        What moves both links alike is exactly 0: the difference of their Jacobians leaves rounding there, which would
        fill the rows of a deep tree.
        """
        model, data = state.model, state.data
        between = data.oMf[self.first].actInv(data.oMf[self.second])
        one, two = (
            pin.getFrameJacobian(model, data, frame, LOCAL).reshape(6, -1) for frame in (self.first, self.second)
        )
        moves = LinkTree.of(model).supports
        apart = moves[model.frames[self.first].parentJoint] != moves[model.frames[self.second].parentJoint]
        p, relative = between.translation, (between.action @ two - one) * apart
        e, w = self.pair.directions(p, np.asarray(between.rotation.T))
        return np.asarray(e @ (relative[:3] - pin.skew(p) @ relative[3:]) + w @ relative[3:])

    def drift(self, state: Kinematics) -> Array:
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
        return np.asarray(e @ ddp + w @ domega + self.pair.bend(p, axes, dp, omega))

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return what multipliers, shape (.., m), do to links: joint index -> [f; m] at the world's origin, (.., 6)."""
        acting = moved(self.wrench(links, lam), links.frame(self.second)[1])
        return opposed(links.model, self.first, self.second, acting)

    def wrench(self, links: LinkPlacements, lam: Array) -> Array:
        """Return [f; m] of the first link on the second, at the origin of frame 2, world axes [N, N*m].

        Of multipliers of shape (n, m), or (n, k, m) of variants, as (n, 6) or (n, k, 6).
        """
        return _wrench(self.pair, links.frame(self.first), links.frame(self.second), lam)


def _wrench(pair: Pair, one: tuple[Array, Array], two: tuple[Array, Array], lam: Array) -> Array:
    """Return the wrench of multipliers, shape (.., m), given the rotation matrices and the origins of both frames."""
    (turn, origin), (other, place) = one, two
    if pair.constant is not None:
        # numpy turns vectors whose components lie apart in memory in a third of the time
        columns = lam.reshape(-1, lam.shape[-1]).T
        inner = ((direction.T @ columns).reshape(3, *lam.shape[:-1]) for direction in pair.constant)
        return joined(*(rotated(turn, states_first(part, 1)) for part in inner))
    axes, p = turn.swapaxes(-1, -2) @ other, vecmat(place - origin, turn)
    states = np.broadcast_shapes(axes.shape[:-2], p.shape[:-1], lam.shape[:-1])
    axes, p, lam = (
        np.broadcast_to(x, (*states, *x.shape[len(states) :])).reshape(-1, *x.shape[len(states) :])
        for x in (axes, p, lam)
    )
    directions = pair.directions(p.T, axes.transpose(2, 1, 0))
    inner = (np.einsum("nk,kcn->nc", lam, _spread(direction, len(lam))) for direction in directions)
    return joined(*(rotated(turn, part.reshape(*states, 3)) for part in inner))


def _spread(directions: Array, n: int) -> Array:
    """Return directions, shape (k, 3) or (k, 3, n), at n configurations."""
    spread = directions[:, :, None] if directions.ndim == 2 else directions
    return np.broadcast_to(spread, (*directions.shape[:2], n))


class LoopDefinition(InputStruct, frozen=True):
    """What every loop joint says.

    Attributes:
        between: The two links whose frames the joint ties; a fixed link without mass serves as a named frame.
    """

    between: tuple[str, str]

    def pair(self) -> Pair:
        raise NotImplementedError

    def bind(self, model: pin.Model, name: str) -> LoopJoint:
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
        return LoopJoint(name, str(self.__struct_config__.tag), first, second, self.pair())
