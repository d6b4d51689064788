"""Loops as the compiled library knows them: paths of their rows through the tree, and buffers of their equations."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.kernel.library import (
    FORCE,
    LOOP,
    LOOP_STATE,
    MOST_ROWS,
    ConstraintsStructure,
    SkylineStructure,
    contiguous,
    finite,
    pointer,
)
from pinarm.engine.kernel.tree import CompiledTree, LoadedTree
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

LOWER, UNIVERSAL, ROD = range(3)
"""Kinds of loop joints: see ``loops.h``."""


class Tied(Record, frozen=True):
    """A loop joint of a model.

    Attributes:
        joints: The joints at whose links its frames 1 and 2 are; 0 for the world.
        along: Directions e of its rows, shape (k, 3).
        about: Directions w, shape (k, 3).
        axis: About which frame 2 may turn, shape (3,); 0 where it may not.
        size: Length of a rod; place along the axis at which the angle of a screw is 0 [m].
        weights: What rows have of velocities beside: of couplings, shape (k, nv); nothing of loop joints.
    """

    kind: int
    joints: tuple[int, int]
    places: tuple[pin.SE3, pin.SE3]
    along: Array
    about: Array
    axis: Array = np.zeros(3)
    size: float = 0.0
    weights: Array | None = None

    @classmethod
    def coupling(cls, weights: Array) -> Tied:
        """Return the coupling whose rows have these weights of velocities, shape (k, nv)."""
        nothing, here = np.zeros((len(weights), 3)), pin.SE3.Identity()
        return cls(LOWER, (0, 0), (here, here), nothing, nothing, weights=weights)

    def moving(self, model: pin.Model) -> list[int]:
        """Return the joints whose velocities, with those before them, its rows hold."""
        if self.weights is None:
            return [*self.joints]
        joints, weights = enumerate(model.joints), self.weights
        return [k for k, joint in joints if k and weights[:, joint.idx_v : joint.idx_v + joint.nv].any()]

    def ends(self, model: pin.Model) -> list[int]:
        """Return the joints at whose links its rows begin: what moves all of these does not move the rows."""
        return [*self.joints] if self.weights is None else [model.parents[joint] for joint in self.moving(model)]


class Way(Record, frozen=True):
    """Path of the rows of a loop joint, over links and unknowns, to the link at which it ends.

    Attributes:
        end: The last link that moves all that its rows hold; -1 for the world.
        passed: Links, children before their parents, and ``~k`` where loop joint k is eliminated.
        unknowns: The unknowns there: velocities, and multipliers behind all velocities.
        before: Number of unknowns that are not eliminated at the link at which it ends.
    """

    end: int
    passed: list[int]
    unknowns: list[int]
    own: list[int]
    before: int

    @property
    def support(self) -> list[int]:
        return self.unknowns + self.own


def ways_of(model: pin.Model, loops: Sequence[tuple[list[int], list[int], int]]) -> list[Way]:
    """Return the ways of loop joints: ``ends`` and ``moving`` as in ``Tied``, and the number of rows.

    Those come first that end at links farther from the world.
    """
    ways, meeting = list[Way](), dict[tuple[int, int], list[int]]()  # (link, unknown) -> ways that end there with it

    def meet(link: int, passed: list[int], unknowns: list[int]) -> None:
        """Pass the loop joints that end at a link and share an unknown, those that these bring along too."""
        pending = {k for unknown in unknowns for k in meeting.get((link, unknown), [])}
        while pending:
            pending.discard(k := min(pending))
            passed.append(~k)
            unknowns += ways[k].own
            pending.update(j for unknown in ways[k].own for j in meeting[link, unknown] if j > k)

    for ends, moving, rows in loops:
        end, passed, unknowns = end_of(model, ends), list[int](), list[int]()
        for link in sorted(_moved_by(model, moving) - _moved_by(model, [end + 1]), reverse=True):
            meet(link, passed, unknowns)
            passed.append(link)
            joint = model.joints[link + 1]
            unknowns += range(joint.idx_v, joint.idx_v + joint.nv)
        before = len(unknowns)
        meet(end, passed, unknowns)
        first = ways[-1].own[-1] + 1 if ways else model.nv
        way = Way(end, passed, unknowns, list(range(first, first + rows)), before)
        for unknown in way.support:
            meeting.setdefault((end, unknown), []).append(len(ways))
        ways.append(way)
    return ways


def end_of(model: pin.Model, joints: Iterable[int]) -> int:
    """Return the last link that moves the links of all of some joints; -1 for the world."""
    return max(set.intersection(*(_moved_by(model, [joint]) | {-1} for joint in joints)))


def _moved_by(model: pin.Model, joints: Iterable[int]) -> set[int]:
    return {link - 1 for joint in joints for link in model.supports[joint].tolist()} - {-1}


class LoadedLoops(Record, frozen=True):
    """A tree with loops and its loads, for the library."""

    structure: ConstraintsStructure
    kept: tuple[Any, ...]
    places: Indices

    @property
    def multipliers(self) -> Array:
        """Multipliers of the accelerations last computed [N or N*m], shape (m,)."""
        held = (ctypes.c_double * len(self.places)).from_address(self.structure.multiplier)
        return np.array(held)[self.places]


class CompiledLoops(Record, frozen=True):
    """A tree with loops as the library knows it.

    Attributes:
        tied: The loop joints in the order of the links at which they end, from the tips.
        places: Places of the rows among these, in the order of the constraints, shape (m,).
    """

    tree: CompiledTree
    tied: list[Tied]
    ways: list[Way]
    places: Indices

    @classmethod
    def of(cls, tree: CompiledTree, tied: Sequence[Tied]) -> CompiledLoops:
        """Return the tree with loops, given in the order of the constraints."""
        model = tree.model
        ends = [end_of(model, loop.ends(model)) for loop in tied]
        order = sorted(range(len(ends)), key=lambda k: -ends[k])
        sizes = [len(loop.along) for loop in tied]
        rows, ordered = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1]), [tied[k] for k in order]
        ways = ways_of(model, [(loop.ends(model), loop.moving(model), len(loop.along)) for loop in ordered])
        places = [rows[k] for k in order]
        return cls(tree, ordered, ways, np.argsort(np.concatenate(places) if places else np.zeros(0, np.intp)))

    def loaded(self, loaded: LoadedTree, units: Array, weights: Array) -> LoadedLoops | None:
        """Return the tree under its loads with its loops; ``None`` where a number is none.

        Args:
            loaded: The tree.
            units: Squares of the units of velocities, 0 of those that follow laws, shape (nv,).
            weights: 1 over the unit of the gap in every row, shape (m,).
        """
        records, factors, model, rows = self._records, self._weights, self.tree.model, len(self.places)
        if max(records["rows"]) > MOST_ROWS or not finite(records) or not np.isfinite(factors).all():
            return None
        loaded = loaded.with_unknowns(model.nv + rows)
        squares, inner = _skyline(records), int(records["rows"][records["end"] >= 0].sum())
        passed = np.array([entry for way in self.ways for entry in way.passed], np.intc)
        unknowns = np.array([unknown for way in self.ways for unknown in way.support], np.intc)
        known = records, passed, unknowns, factors, np.zeros(len(self.tied), LOOP_STATE)
        buffers = (
            contiguous(units),
            contiguous(weights[np.argsort(self.places)]),
            np.zeros((model.njoints, MOST_ROWS), FORCE),
            np.zeros((len(unknowns), MOST_ROWS)),
            np.zeros((model.nv + rows, MOST_ROWS)),
            np.zeros(model.nv),
            *(np.zeros(rows) for _ in range(3)),
        )
        structure = ConstraintsStructure(
            ctypes.addressof(loaded.structure),
            len(self.tied),
            inner,
            *map(pointer, known),
            SkylineStructure(rows, *map(pointer, squares)),
            *map(pointer, buffers),
        )
        return LoadedLoops(structure, (loaded, squares, known, buffers), self.places)

    @property
    def _weights(self) -> Array:
        """Weights of couplings on the unknowns of all ways, 0 of loop joints, shape (unknowns, MOST_ROWS)."""
        nv, factors = self.tree.model.nv, list[Array]()
        for tied, way in zip(self.tied, self.ways, strict=True):
            weights = np.zeros((len(way.support), MOST_ROWS))
            if tied.weights is not None:
                places = [k for k, unknown in enumerate(way.unknowns) if unknown < nv]
                weights[places, : len(tied.weights)] = tied.weights[:, [way.unknowns[k] for k in places]].T
            factors.append(weights)
        return np.concatenate(factors)

    @cached_property
    def _records(self) -> NDArray[np.void]:
        """The loop joints, of ``library.LOOP``."""
        records, ways, first = np.zeros(len(self.tied), LOOP), self.ways, dict[int, int]()
        for k, (record, tied, way) in enumerate(zip(records, self.tied, ways, strict=True)):
            record["axis"], record["size"], record["kind"] = tied.axis, tied.size, tied.kind
            record["rows"], record["end"] = len(tied.along), way.end
            record["links"], record["degrees"] = len(way.passed), len(way.support)
            record["along"][: len(tied.along)], record["about"][: len(tied.about)] = tied.along, tied.about
            for i, (joint, place) in enumerate(zip(tied.joints, tied.places, strict=True)):
                frame = record["frame"]
                record["link"][i], frame["rotation"][i], frame["translation"][i] = self.tree.placed(joint, place)
            record["coupled"] = min([k, *(first.setdefault(n, k) for n in way.support)])  # shares an unknown with it
        for name, counts in (("first", "rows"), ("path", "links"), ("support", "degrees")):
            records[name] = np.cumsum(records[counts]) - records[counts]
        records["tail"] = records["support"] + [way.before for way in ways]
        records["own"] = records["support"] + [len(way.unknowns) for way in ways]
        return records


def _skyline(records: NDArray[np.void]) -> tuple[NDArray[Any], ...]:
    """Return the arrays of the matrix of all rows: first columns, places, entries and factors."""
    first = np.repeat(records["first"][records["coupled"]], records["rows"]).astype(np.intp)
    sizes = np.arange(len(first)) - first + 1
    origin, stored = np.cumsum(sizes) - np.arange(len(first)) - 1, int(sizes.sum())
    return first, origin.astype(np.intp), np.zeros(stored), np.zeros(stored)
