"""How far the frames of a loop joint have turned or slid against each other: coordinates like those of tree joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, PairCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.pairs import AngleAbout, LowerPair, TiedFrames, whole_turns
from pinarm.mechanics.joints import METRE, RADIAN, screw_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import Thread, normals

PARALLEL = 1e-9
"""Sine of the angle between axes that are parallel but for rounding."""

TURNING = ("revolute", "pin", "cylindrical", "planar", "screw")
"""Kinds with a coordinate ``angle``, about their axis."""
SLIDING = ("prismatic", "cylindrical", "screw", "point_on_line")
"""Kinds with a coordinate ``position``, along their axis."""


class TurnedAbout(PairCoordinate, frozen=True):
    """Angle of frame 2 against frame 1 about the axis of a loop joint.

    Turns are counted where something says how many there are: the place along a screw, or, where all joints between the
    frames turn about parallel axes, the sum of their angles. Elsewhere it is from -pi to pi.

    Attributes:
        turns: Sum of the angles of the joints between the frames, which tells the turns; ``None`` where it does not.
        offset: What the angle is more than that, but for whole turns [rad].
        threaded: Whether the place along a screw tells the turns.
    """

    turns: LinearCoordinate | None = None
    offset: float = 0.0
    threaded: bool = False

    @property
    def wraps(self) -> bool:  # type: ignore[override]
        return self.turns is None and not self.threaded

    def missing_turns(self, angle: Array, q: Array) -> Array:
        counted = angle if self.turns is None else self.turns.at(q) + self.offset
        return whole_turns(counted - angle)


def loop_coordinates(model: pin.Model, loops: Sequence[LoopJoint]) -> dict[str, Coordinate]:
    """Return the coordinates of loop joints that have an axis: ``L.angle`` and ``L.position``."""
    return {name: coordinate for loop in loops for name, coordinate in _own(model, loop).items()}


def _own(model: pin.Model, loop: LoopJoint) -> Mapping[str, Coordinate]:
    pair, own, nothing = loop.pair, dict[str, Coordinate](), np.zeros(3)
    if not isinstance(pair, LowerPair):
        return own
    if loop.kind in TURNING:
        thread = pair.rotation if isinstance(pair.rotation, Thread) else None
        about = LowerPair.row(
            nothing, pair.axis, AngleAbout(pair.axis, normals(pair.axis), thread.angle if thread else None)
        )
        way = TiedFrames(loop.first, loop.second, about)
        turns, offset = (None, 0.0) if thread else _counting(model, way, pair.axis)
        own[f"{loop.name}.angle"] = TurnedAbout(way, RADIAN, loop.name, turns, offset, thread is not None)
    if loop.kind in SLIDING:
        way = TiedFrames(loop.first, loop.second, LowerPair.row(pair.axis, nothing))
        own[f"{loop.name}.position"] = PairCoordinate(way, METRE, loop.name)
    return own


def _counting(model: pin.Model, way: TiedFrames, axis: Array) -> tuple[LinearCoordinate | None, float]:
    """Return the sum of the joint angles between the frames that counts the turns, and what it misses at q = 0."""
    state = Kinematics.at(model, pin.neutral(model))
    axis = state.data.oMf[way.first].rotation @ axis
    weights, places = np.zeros(model.nv), np.zeros(model.nv, dtype=np.intp)
    for index, sense in _path(model, way):
        joint, screw = model.joints[index], screw_of(model.joints[index])
        if screw is None:
            return None, 0.0
        turns, own = screw
        along = state.data.oMi[index].rotation @ own
        if turns and np.linalg.norm(np.cross(along, axis)) > PARALLEL:
            return None, 0.0
        weights[joint.idx_v] = sense * round(float(along @ axis)) if turns else 0.0
        places[joint.idx_v] = joint.idx_q
    return LinearCoordinate(RADIAN, weights, places), float(way.gap(state)[0])


def _path(model: pin.Model, way: TiedFrames) -> Iterator[tuple[int, float]]:
    """Yield the joints between the frames, with -1 for those on the way to the first and 1 to the second."""
    up, down = ({int(j) for j in model.supports[model.frames[frame].parentJoint]} for frame in (way.first, way.second))
    yield from ((j, -1.0) for j in sorted(up - down))
    yield from ((j, 1.0) for j in sorted(down - up))
