"""How far the frames of a loop joint have turned or slid against each other: coordinates like those of tree joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.geometry.joint_axes import screw_of
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.rotation_rows import AngleAbout, whole_turns
from pinarm.mechanics.joints import METRE, RADIAN
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import LowerPair, normals
from pinarm.mechanics.loops.screw import Thread
from pinarm.records import Record

PARALLEL = 1e-9
"""Sine of the angle between axes that are parallel but for rounding."""

TURNING = ("revolute", "pin", "cylindrical", "planar", "screw")
"""Kinds with a coordinate ``angle``, about their axis."""
SLIDING = ("prismatic", "cylindrical", "screw", "point_on_line")
"""Kinds with a coordinate ``position``, along their axis."""


class SlidOut(Record, frozen=True):
    """Place of frame 2 along the axis of a loop joint, from the origin of frame 1: ``z = axis . p`` [m].

    Attributes:
        loop: Name of the loop joint.
        way: The direction as one row of a loop joint.
        unit: Metre.
    """

    wraps: ClassVar[bool] = False
    loop: str
    way: LoopJoint
    unit: Unit = METRE

    def value(self, state: Kinematics) -> float:
        return float(self.way.gap(state)[0])

    def row(self, state: Kinematics) -> Array:
        """Return the row of ``axis . p'``, seen from frame 1."""
        return np.asarray(self.way.rows(state)[0])

    def drift(self, state: Kinematics) -> float:
        """Return ``axis . p''`` for a = 0."""
        return float(self.way.drift(state)[0])

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        return self.way.wrenches(links, effort[:, None])


class TurnedAbout(Record, frozen=True):
    """Angle of frame 2 against frame 1 about the axis of a loop joint, ``atan2(v . R u - u . R v, u . R u + v . R v)``.

    Turns are counted where something says how many there are: the place along a screw, or, where all joints between the
    frames turn about parallel axes, the sum of their angles. Elsewhere it is from -pi to pi.

    Attributes:
        loop: Name of the loop joint.
        way: The direction as one row of a loop joint.
        turns: Sum of the angles of the joints between the frames, which tells the turns; ``None`` where it does not.
        offset: What the angle is more than that, but for whole turns [rad].
        counted: Whether the place along a screw counts the turns.
        unit: Radian.
    """

    loop: str
    way: LoopJoint
    turns: LinearCoordinate | None = None
    offset: float = 0.0
    counted: bool = False
    unit: Unit = RADIAN

    @property
    def wraps(self) -> bool:
        return self.turns is None and not self.counted

    def value(self, state: Kinematics) -> float:
        angle = self.way.gap(state)
        return float((angle + self.missing_turns(angle, state.q))[0])

    def missing_turns(self, angle: Array, q: Array) -> Array:
        """Return the turns that angles from -pi to pi lack [rad] at configurations, shape (.., nq)."""
        counted = angle if self.turns is None else self.turns.at(q) + self.offset
        return whole_turns(counted - angle)

    def row(self, state: Kinematics) -> Array:
        """Return the row of ``axis . omega``, seen from frame 1."""
        return np.asarray(self.way.rows(state)[0])

    def drift(self, state: Kinematics) -> float:
        """Return ``axis . omega'`` for a = 0."""
        return float(self.way.drift(state)[0])

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        """Return the moments about the axis, of the first link on the second and back."""
        return self.way.wrenches(links, effort[:, None])


LoopCoordinate = SlidOut | TurnedAbout
"""A coordinate of a loop joint; ``way.wrench`` is what an effort along it does."""


def loop_coordinates(model: pin.Model, loops: Sequence[LoopJoint]) -> dict[str, Coordinate]:
    """Return the coordinates of loop joints that have an axis: ``L.angle`` and ``L.position``."""
    return {name: coordinate for loop in loops for name, coordinate in _own(model, loop).items()}


def _own(model: pin.Model, loop: LoopJoint) -> Mapping[str, Coordinate]:
    pair, found = loop.pair, dict[str, Coordinate]()
    if not isinstance(pair, LowerPair):
        return found
    nothing, axis = np.zeros((1, 3)), pair.axis[None]
    if loop.kind in TURNING:
        thread = pair.rotation.angle if isinstance(pair.rotation, Thread) else None
        about = LowerPair(nothing, axis, pair.axis, AngleAbout(pair.axis, normals(pair.axis), thread))
        way = LoopJoint(loop.name, loop.kind, loop.first, loop.second, about)
        turns = (None, 0.0) if thread else _counting(model, way)
        found[f"{loop.name}.angle"] = TurnedAbout(loop.name, way, *turns, thread is not None)
    if loop.kind in SLIDING:
        way = LoopJoint(loop.name, loop.kind, loop.first, loop.second, LowerPair(axis, nothing, pair.axis, None))
        found[f"{loop.name}.position"] = SlidOut(loop.name, way)
    return found


def _axis(way: LoopJoint) -> Array:
    assert isinstance(way.pair, LowerPair)
    return way.pair.axis


def _counting(model: pin.Model, way: LoopJoint) -> tuple[LinearCoordinate | None, float]:
    """Return the sum of the joint angles between the frames that counts the turns, and what it misses at q = 0."""
    state = Kinematics.at(model, pin.neutral(model))
    axis = state.data.oMf[way.first].rotation @ _axis(way)
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
    return LinearCoordinate(RADIAN, weights, places), TurnedAbout(way.name, way).value(state)


def _path(model: pin.Model, way: LoopJoint) -> Iterator[tuple[int, float]]:
    """Yield the joints between the frames, with -1 for those on the way to the first and 1 to the second."""
    up, down = ({int(j) for j in model.supports[model.frames[frame].parentJoint]} for frame in (way.first, way.second))
    yield from ((j, -1.0) for j in sorted(up - down))
    yield from ((j, 1.0) for j in sorted(down - up))
