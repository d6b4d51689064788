"""How large the loops of a mechanism are, and the unit of length in which each is measured.

Measured so, translations compare with angles, and what is small or singular is so in a loop of any size, wherever it
stands and whatever else is in the model.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.model_variants import Model, placements_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record

SLIDES = {"Planar": 2, "Translation": 3, "FreeFlyer": 3}
"""Number of the first velocities of a joint that are translations; of one that slides along an axis all are."""


class LoopSizes(Record, frozen=True):
    """The joints of k loops, and how large each is.

    Attributes:
        joints: Indices of the joints of every loop.
        sizes: Half the way around each from joint to joint, with coordinates 0 [m]: no two of its joints are farther
            apart. Shape (k,), of variants (n, k) or (1, k).
    """

    joints: Sequence[Sequence[int]]
    sizes: Array

    @classmethod
    def of(cls, model: Model, loops: Sequence[LoopJoint]) -> LoopSizes:
        """Return those of the loops that joints close."""
        if not loops:
            return cls((), np.zeros(0))
        parents, places, along = list(model.parents), placements_of(model)[1], _distances(model)
        found, sizes = [], []
        for loop in loops:
            frames = [model.frames[frame] for frame in (loop.first, loop.second)]
            branches = _branches(parents, *(frame.parentJoint for frame in frames))
            ways, ends = np.zeros(along.shape[:-1]), []
            for frame, branch in zip(frames, branches, strict=True):
                end = frame.placement.translation
                if branch:
                    ways = ways + np.linalg.norm(end, axis=-1) + along[..., branch[0]] - along[..., branch[-1]]
                ends.append(places[..., branch[-1], :] if branch else end)
            found.append([*branches[0], *branches[1]])
            sizes.append(0.5 * (ways + np.linalg.norm(ends[1] - ends[0], axis=-1)))
        return cls(found, np.stack(np.broadcast_arrays(*sizes), axis=-1))


def _branches(parents: Sequence[int], one: int, other: int) -> tuple[list[int], list[int]]:
    """Return the joints between two and the link on which both stand, from each of them inwards."""
    first: list[int] = []
    second: list[int] = []
    while one != other:
        if one > other:
            first.append(one)
            one = parents[one]
        else:
            second.append(other)
            other = parents[other]
    return first, second


def _distances(model: Model) -> Array:
    """Return the length of the links from the world to every joint [m], shape (.., njoints)."""
    parents, lengths = list(model.parents), np.moveaxis(np.linalg.norm(placements_of(model)[1], axis=-1), -1, 0)
    found = [np.zeros_like(lengths[0])]
    for joint in range(1, model.njoints):
        found.append(found[parents[joint]] + lengths[joint])
    return np.stack(found, axis=-1)


def extents(model: Model, frames: Iterable[pin.Frame]) -> Array:
    """Return the length of the longest branch of links, from the world to a joint or one of the frames [m].

    Shape (), of variants (k,) or (1,). It is 1 m for a model without lengths.
    """
    along = _distances(model)
    found = along.max(axis=-1)
    for one in frames:
        found = np.maximum(found, along[..., one.parentJoint] + np.linalg.norm(one.placement.translation, axis=-1))
    return np.where(found > 0.0, found, 1.0)


def unit_of_length(size: Array | float) -> Array:
    """Return the units in which sizes [m] are numbers near 1: 1e-6, 1e-3, 1, 1e3, 1e6, ... m, of the same shape.

    A size of 0, where all stands in one point, is measured in metres.
    """
    lengths = np.where(np.asarray(size) > 0.0, size, 1.0)
    return np.asarray(10.0 ** (3.0 * np.round(np.log10(lengths) / 3.0)))


@cached_by_model
def extent(model: pin.Model) -> float:
    """Return the length of the longest branch of links of a model, from the world to a joint or a frame [m]."""
    return float(extents(model, model.frames))


@cached_by_model
def slides(model: pin.Model) -> Flags:
    """Return which velocities are translations, shape (nv,)."""
    found = np.zeros(model.nv, dtype=bool)
    for joint in model.joints[1:]:
        kind = joint.shortname().removeprefix("JointModel")
        count = SLIDES.get(kind, joint.nv if kind.startswith("P") else 0)
        found[joint.idx_v : joint.idx_v + count] = True
    found.flags.writeable = False
    return found
