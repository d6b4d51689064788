"""Loops as the compiled library knows them: what moves each, and the buffers of their equations."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.kernel.checks import loops_are_sound
from pinarm.engine.kernel.library import pointer
from pinarm.engine.kernel.structures import (
    FORCE,
    LOOP,
    LOOP_STATE,
    MOST_ROWS,
    ConstraintsStructure,
    SkylineStructure,
)
from pinarm.engine.kernel.tree import CompiledTree, LoadedTree
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

POINT, LOWER, UNIVERSAL, ROD = range(4)
"""Kinds of loop joints: see ``loops.h``."""


class Tied(Record, frozen=True):
    """A loop joint of a model.

    Attributes:
        kind: Its kind.
        joints: The joints at whose links its frames 1 and 2 are; 0 for the world.
        places: Their placements there.
        along: Directions e of its rows, shape (k, 3).
        about: Directions w, shape (k, 3).
        weights: What rows have of velocities beside: of couplings, shape (k, nv); nothing of loop joints.
    """

    kind: int
    joints: tuple[int, int]
    places: tuple[pin.SE3, pin.SE3]
    along: Array
    about: Array
    weights: Array | None = None

    @classmethod
    def coupling(cls, weights: Array) -> Tied:
        """Return the coupling whose row has these weights of velocities, shape (nv,)."""
        nothing, here = np.zeros((1, 3)), pin.SE3.Identity()
        return cls(LOWER, (0, 0), (here, here), nothing, nothing, weights[None])


class LoadedLoops(Record, frozen=True):
    """A tree with loops and its loads, for the library.

    Attributes:
        structure: The C structure.
        kept: What it points to.
    """

    structure: ConstraintsStructure
    kept: tuple[Any, ...]

    @property
    def multipliers(self) -> Array:
        """Multipliers of the accelerations last computed [N or N*m], a view of shape (m,)."""
        rows = self.structure.delassus.rows
        return np.frombuffer((ctypes.c_double * rows).from_address(self.structure.multiplier))


class CompiledLoops(Record, frozen=True):
    """A tree with loops as the library knows it.

    Attributes:
        tree: The tree.
        tied: Its loops.
    """

    tree: CompiledTree
    tied: Sequence[Tied]

    def loaded(self, loaded: LoadedTree) -> LoadedLoops | None:
        """Return the tree under its loads with its loops; ``None`` where a number is none."""
        if not loops_are_sound(self._records, len(self.tree.links)) or not np.isfinite(self._weights).all():
            return None
        model, rows = self.tree.model, len(self._first)
        sizes = np.arange(rows) - self._first + 1
        places, stored = (self._first, np.cumsum(sizes) - np.arange(rows) - 1), int(sizes.sum())
        entries = np.zeros(stored), np.zeros(stored)
        known = self._records, self._paths, self._velocities, self._weights, np.zeros(len(self.tied), LOOP_STATE)
        buffers = (
            np.zeros((model.njoints, MOST_ROWS), FORCE), np.zeros((len(self._velocities), MOST_ROWS)),
            np.zeros((model.nv, MOST_ROWS)), np.zeros(model.nv), *(np.zeros(rows) for _ in range(3)),
        )  # fmt: skip
        counts = len(self.tied), len(self._paths), len(self._velocities)
        structure = ConstraintsStructure(
            ctypes.addressof(loaded.structure), *counts, *map(pointer, known),
            SkylineStructure(rows, *map(pointer, (*places, *entries))), *map(pointer, buffers),
        )  # fmt: skip
        return LoadedLoops(structure, (loaded, places, entries, known, buffers))

    @cached_property
    def _links(self) -> list[Indices]:
        """Links that move either frame of each loop joint, children before their parents."""
        supports = [np.array(one.tolist(), np.intp) - 1 for one in self.tree.model.supports]
        return [distinct(np.concatenate([supports[joint] for joint in self._joints(one)]))[:0:-1] for one in self.tied]

    def _joints(self, one: Tied) -> list[int]:
        """Return the joints at whose links a loop joint is, or that a coupling couples."""
        if one.weights is None:
            return [*one.joints]
        joints = enumerate(self.tree.model.joints)
        moved = [k for k, joint in joints if k and one.weights[:, joint.idx_v : joint.idx_v + joint.nv].any()]
        return [*one.joints, *moved]

    @cached_property
    def _weights(self) -> Array:
        """What the rows of each have of the velocities that move it, shape (sum of these, MOST_ROWS)."""
        found = np.zeros((len(self._velocities), MOST_ROWS))
        ends = np.cumsum([len(moved) for moved in self._moved])
        for end, one, moved in zip(ends, self.tied, self._moved, strict=True):
            if one.weights is not None:
                found[end - len(moved) : end, : len(one.weights)] = one.weights[:, moved].T
        return found

    @cached_property
    def _paths(self) -> NDArray[np.intc]:
        return np.concatenate(self._links).astype(np.intc)

    @cached_property
    def _moved(self) -> list[list[int]]:
        """Velocities of these links."""
        places, counts = self.tree.model.idx_vs.tolist()[1:], self.tree.model.nvs.tolist()[1:]
        return [[places[i] + k for i in links for k in range(counts[i])] for links in self._links]

    @cached_property
    def _velocities(self) -> NDArray[np.intc]:
        return np.concatenate(self._moved).astype(np.intc)

    @cached_property
    def _records(self) -> NDArray[np.void]:
        """The loop joints, of ``structures.LOOP``."""
        found = np.zeros(len(self.tied), LOOP)
        rows = [len(one.along) for one in self.tied]
        for name, counts in (
            ("first", rows), ("path", map(len, self._links)), ("support", map(len, self._moved)),
        ):  # fmt: skip
            found[name] = np.cumsum([0, *counts])[:-1]
        for record, one, links, moved in zip(found, self.tied, self._links, self._moved, strict=True):
            record["kind"], record["rows"] = one.kind, len(one.along)
            record["links"], record["degrees"] = len(links), len(moved)
            record["along"][: len(one.along)], record["about"][: len(one.about)] = one.along, one.about
            for i, (joint, place) in enumerate(zip(one.joints, one.places, strict=True)):
                record["link"][i], record["frame"]["rotation"][i], record["frame"]["translation"][i] = (
                    self.tree.placed(joint, place)
                )  # fmt: skip
        found["coupled"] = self._coupled
        return found

    @property
    def _coupled(self) -> list[int]:
        """The first loop joint that shares a velocity with each."""
        first: dict[int, int] = {}
        return [min([k, *(first.setdefault(v, k) for v in moved)]) for k, moved in enumerate(self._moved)]

    @cached_property
    def _first(self) -> NDArray[np.intp]:
        """Column of the first entry of each row of the matrix of all rows."""
        records = self._records
        return np.repeat(records["first"][records["coupled"]], records["rows"]).astype(np.intp)
