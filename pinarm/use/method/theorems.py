"""Theorems of mechanics as test motions: a resultant, a moment about a point, the power in a motion of the whole.

A test motion gives every body of the isolated group a twist. The power of a wrench in a translation is its component
along the direction, in a rotation about an axis its moment about this axis; the power in a motion that the joints
allow is that of the theorem of kinetic energy, per unit rate of the coordinate.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.reactions import loop_axis, tree_axis
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.geometry.link_placements import LinkPlacements, moving
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record
from pinarm.use.method.actions import bodies_of, rows_along

ALIKE = 1e-9
"""Distance of points, relative to the extent, and sine of the angle of directions, below which they are the same."""


class Screw(NamedTuple):
    """A translation along a direction, or a rotation about an axis through a point.

    Attributes:
        direction: Its place among the directions of ``Landmarks``.
        point: Its place among the points; ``None`` of a translation.
    """

    direction: int
    point: int | None = None


class Landmarks(Record, frozen=True):
    """Points and directions of a mechanism at c configurations, in an order that does not depend on these.

    Attributes:
        points: Origins of joints, of the second frames of loop joints, and of links [m], shape (p, c, 3).
        point_names: Their names.
        directions: Axes of joints and loop joints, of the world, and of links, shape (d, c, 3).
        direction_names: Their names.
        extent: Length of the longest branch of links [m].
    """

    points: Array
    point_names: tuple[str, ...]
    directions: Array
    direction_names: tuple[str, ...]
    extent: float

    @classmethod
    def at(cls, mechanism: Mechanism, links: LinkPlacements) -> Landmarks:
        """Return the landmarks of a mechanism whose links are placed."""
        model, bodies = mechanism.model, bodies_of(mechanism)
        loops = [constraint for constraint in mechanism.constraints if isinstance(constraint, LoopJoint)]
        frames = [k for k, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY]
        placed = [links.frame(k) for k in frames]
        points = {str(model.names[body]): links.places[:, body] for body in bodies}
        points |= {loop.name: links.frame(loop.second)[1] for loop in loops}
        points |= {str(model.frames[k].name): place for k, (_, place) in zip(frames, placed, strict=True)}
        axes = {
            f"axis of {model.names[body]}": links.turns[:, body] @ axis
            for body in bodies
            if (axis := tree_axis(model, body)) is not None
        }
        axes |= {
            f"axis of {loop.name}": links.frame(loop.first)[0] @ axis
            for loop in loops
            if (axis := loop_axis(loop)) is not None
        }
        axes |= {name: np.broadcast_to(np.eye(3)[k], (len(links.q), 3)) for k, name in enumerate("xyz")}
        for k, (turn, _) in zip(frames, placed, strict=True):
            axes |= {f"{name} of {model.frames[k].name}": turn[..., column] for column, name in enumerate("xyz")}
        extent = float(mechanism.closure.extent)
        return cls(np.array([*points.values()]), (*points,), np.array([*axes.values()]), (*axes,), extent)

    def place(self, name: str) -> Array | None:
        """Return the point of a name at the first configuration, shape (3,); ``None`` where there is none."""
        return self.points[self.point_names.index(name), 0] if name in self.point_names else None

    @cached_property
    def screws(self) -> list[Screw]:
        """Rotations about axes through points, then translations, none twice."""
        points = _distinct(self.points / self.extent)
        ways = _distinct(self.directions, lines=True)
        rotations = [Screw(way, point) for way in ways for point in points]
        return [*self._apart(rotations), *(Screw(way) for way in ways)]

    def _apart(self, rotations: list[Screw]) -> list[Screw]:
        """Return rotations about different axes: of points on one axis the first."""
        kept: dict[int, list[Screw]] = {}
        for rotation in rotations:
            arms = (
                crossed(self.points[rotation.point] - self.points[other.point], self.directions[rotation.direction])
                for other in kept.setdefault(rotation.direction, [])
            )
            if all(np.abs(arm).max() > ALIKE * self.extent for arm in arms):
                kept[rotation.direction].append(rotation)
        return [screw for each in kept.values() for screw in each]

    def twists(self, screws: list[Screw]) -> Array:
        """Return the twists [linear; angular] of screws at the world's origin, world axes, shape (s, c, 6)."""
        twists = np.zeros((len(screws), self.points.shape[1], 6))
        for k, (way, point) in enumerate(screws):
            axis = self.directions[way]
            if point is None:
                twists[k, :, :3] = axis
            else:
                twists[k, :, :3], twists[k, :, 3:] = crossed(self.points[point], axis), axis
        return twists


def _distinct(vectors: Array, *, lines: bool = False) -> list[int]:
    """Return the places of vectors, shape (k, c, 3), that differ from all before; lines do not from their opposites."""
    kept: list[int] = []
    for k, vector in enumerate(vectors):
        others = vectors[kept]
        gaps = crossed(np.broadcast_to(vector, others.shape), others) if lines else vector - others
        if not len(kept) or np.abs(gaps).max(axis=(1, 2)).min() > ALIKE:
            kept.append(k)
    return kept


def motion_of_whole(
    mechanism: Mechanism, q: Array, efforts: dict[str, Coordinate], wanted: str
) -> tuple[Array, bool] | None:
    """Return the motion that the joints allow in which a coordinate has the rate 1 and those of other drives stand.

    Args:
        mechanism: The mechanism.
        q: Configurations, shape (c, nq).
        efforts: Coordinates along which unknown efforts act, by name.
        wanted: Name of one of them.

    Returns:
        The twists of all bodies at the world's origin, shape (c, njoints, 6), and whether the mechanism has no other
        motion; ``None`` where there is no such motion.
    """
    closure, model = mechanism.closure, mechanism.model
    still = np.zeros((len(q), model.nv))
    columns, supports = moving(model, q, still, still)[3], LinkTree.of(model).supports
    rows = {name: rows_along(mechanism, along, q) for name, along in efforts.items()}
    motions, alone = [], True
    for k, x in enumerate(q):
        free = closure.split(closure.rows(closure.state(x))).free if closure.size else np.eye(model.nv)
        asked = np.array([rows[name][k] for name in rows]) @ free
        unit = np.array([float(name == wanted) for name in rows])
        part = np.linalg.lstsq(asked, unit, rcond=None)[0]
        if np.abs(asked @ part - unit).max() > ALIKE:
            return None
        motions.append((supports * (free @ part)) @ columns[k].T)
        alone &= free.shape[1] == 1
    return np.array(motions), alone
