"""Loops as the compiled library knows them: what moves each, and the buffers of their equations."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.kernel.checks import loops_are_sound
from pinarm.engine.kernel.library import contiguous, pointer
from pinarm.engine.kernel.structures import (
    FORCE,
    LOOP,
    LOOP_STATE,
    MOST_ROWS,
    ConstraintsStructure,
    SkylineStructure,
)
from pinarm.engine.kernel.tree import CompiledTree, LoadedTree
from pinarm.engine.kernel.ways import Way, Ways, end_of
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

LOWER, UNIVERSAL, ROD = range(3)
"""Kinds of loop joints: see ``loops.h``."""


NOWHERE = np.zeros(3)
"""No axis."""


class Tied(Record, frozen=True):
    """A loop joint of a model.

    Attributes:
        kind: Its kind.
        joints: The joints at whose links its frames 1 and 2 are; 0 for the world.
        places: Their placements there.
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
    axis: Array = NOWHERE
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


class LoadedLoops(Record, frozen=True):
    """A tree with loops and its loads, for the library.

    Attributes:
        structure: The C structure.
        kept: What it points to.
        places: Where the library has each row, shape (m,).
    """

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
        tree: The tree.
        tied: Its loops.
    """

    tree: CompiledTree
    tied: Sequence[Tied]

    def loaded(self, loaded: LoadedTree, units: Array, weights: Array) -> LoadedLoops | None:
        """Return the tree under its loads with its loops; ``None`` where a number is none.

        Args:
            loaded: The tree.
            units: Squares of the units of velocities, 0 of those that follow laws, shape (nv,).
            weights: 1 over the unit of the gap in every row, shape (m,).
        """
        if not loops_are_sound(self._records, len(self.tree.links)) or not np.isfinite(self._weights).all():
            return None
        model, rows = self.tree.model, sum(self._rows)
        loaded = loaded.with_unknowns(model.nv + rows)
        squares, inner = self._skyline, int(self._records["rows"][self._records["end"] >= 0].sum())
        known = self._records, self._passed, self._unknowns, self._weights, np.zeros(len(self.tied), LOOP_STATE)
        buffers = (
            contiguous(units), contiguous(weights[np.argsort(self._places)]),
            np.zeros((model.njoints, MOST_ROWS), FORCE), np.zeros((len(self._unknowns), MOST_ROWS)),
            np.zeros((model.nv + rows, MOST_ROWS)), np.zeros(model.nv), *(np.zeros(rows) for _ in range(3)),
        )  # fmt: skip
        structure = ConstraintsStructure(
            ctypes.addressof(loaded.structure), len(self.tied), inner, *map(pointer, known),
            SkylineStructure(rows, *map(pointer, squares)), *map(pointer, buffers),
        )  # fmt: skip
        return LoadedLoops(structure, (loaded, squares, known, buffers), self._places)

    @property
    def _skyline(self) -> tuple[NDArray[Any], ...]:
        """The arrays of the matrix of all rows: first columns, places, entries and factors."""
        records = self._records
        first = np.repeat(records["first"][records["coupled"]], records["rows"]).astype(np.intp)
        sizes = np.arange(len(first)) - first + 1
        origin, stored = np.cumsum(sizes) - np.arange(len(first)) - 1, int(sizes.sum())
        return first, origin.astype(np.intp), np.zeros(stored), np.zeros(stored)

    @cached_property
    def _order(self) -> list[int]:
        """The loop joints in the order of the links at which they end, from the tips."""
        ends = [end_of(self.tree.model, one.ends(self.tree.model)) for one in self.tied]
        return sorted(range(len(ends)), key=lambda k: -ends[k])

    @cached_property
    def _ordered(self) -> list[Tied]:
        return [self.tied[k] for k in self._order]

    @cached_property
    def _rows(self) -> list[int]:
        return [len(one.along) for one in self._ordered]

    @cached_property
    def _places(self) -> Indices:
        """Where each row is in this order, shape (m,)."""
        sizes = [len(one.along) for one in self.tied]
        rows = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
        return np.argsort(np.concatenate([rows[k] for k in self._order]))

    @cached_property
    def _ways(self) -> list[Way]:
        """What the rows of each loop joint pass."""
        model, ways = self.tree.model, Ways(self.tree.model, [], {})
        for one, count in zip(self._ordered, self._rows, strict=True):
            ways.add(one.ends(model), one.moving(model), count)
        return ways.found

    @cached_property
    def _passed(self) -> NDArray[np.intc]:
        return np.array([entry for way in self._ways for entry in way.passed], np.intc)

    @cached_property
    def _unknowns(self) -> NDArray[np.intc]:
        return np.array([unknown for way in self._ways for unknown in way.support], np.intc)

    @cached_property
    def _weights(self) -> Array:
        """What the rows of each have of the unknowns that they pass, shape (sum of these, MOST_ROWS)."""
        found, start, nv = np.zeros((len(self._unknowns), MOST_ROWS)), 0, self.tree.model.nv
        for one, way in zip(self._ordered, self._ways, strict=True):
            if one.weights is not None:
                places = [k for k, unknown in enumerate(way.unknowns) if unknown < nv]
                moved = [way.unknowns[k] for k in places]
                found[[start + k for k in places], : len(one.weights)] = one.weights[:, moved].T
            start += len(way.support)
        return found

    @cached_property
    def _records(self) -> NDArray[np.void]:
        """The loop joints, of ``structures.LOOP``."""
        found, ways = np.zeros(len(self.tied), LOOP), self._ways
        for name, counts in (
            ("first", self._rows), ("path", [len(way.passed) for way in ways]),
            ("support", [len(way.support) for way in ways]),
        ):  # fmt: skip
            found[name] = np.cumsum([0, *counts])[:-1]
        found["axis"], found["size"] = [one.axis for one in self._ordered], [one.size for one in self._ordered]
        for record, one, way in zip(found, self._ordered, ways, strict=True):
            record["kind"], record["rows"], record["end"] = one.kind, len(one.along), way.end
            record["links"], record["degrees"] = len(way.passed), len(way.support)
            record["along"][: len(one.along)], record["about"][: len(one.about)] = one.along, one.about
            for i, (joint, place) in enumerate(zip(one.joints, one.places, strict=True)):
                record["link"][i], record["frame"]["rotation"][i], record["frame"]["translation"][i] = (
                    self.tree.placed(joint, place)
                )  # fmt: skip
        found["tail"] = found["support"] + [way.before for way in ways]
        found["own"] = found["support"] + [len(way.unknowns) for way in ways]
        found["coupled"] = self._coupled
        return found

    @property
    def _coupled(self) -> list[int]:
        """The first loop joint that shares an unknown with each."""
        first: dict[int, int] = {}
        return [min([k, *(first.setdefault(n, k) for n in way.support)]) for k, way in enumerate(self._ways)]
