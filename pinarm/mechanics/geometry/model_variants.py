"""Variants of a model: the same tree of joints and links, with other masses and lengths, as arrays over variants."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.records import Record, replace

ALIKE = (
    "name", "nq", "nv", "njoints", "nframes", "names", "parents", "joints", "supports", "subtrees", "gravity",
    "armature", "getFrameId", "getJointId",
)  # fmt: skip
"""Attributes of Pinocchio's models that all variants have in common, functions of names too."""

PARAMETERS = 10
"""Dynamic parameters of a body: m, m c, and Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin of its joint."""


class VariantsDiffer(Exception):
    """The requested quantity is computed for one model at a time: variants have to be solved one by one."""


class VariantPlacement(Record, frozen=True):
    """A placement in k variants, or in all of them, with k = 1; it is composed as Pinocchio's ``SE3`` is.

    Attributes:
        rotation: Rotation matrix, shape (k, 3, 3).
        translation: Place [m], shape (k, 3).
    """

    rotation: Array
    translation: Array

    @classmethod
    def of(cls, place: pin.SE3) -> VariantPlacement:
        return cls(np.array(place.rotation)[None], np.array(place.translation)[None])

    def __mul__(self, inner: VariantPlacement) -> VariantPlacement:
        """Return the placement of what is placed in what is placed."""
        place = self.translation + np.matvec(self.rotation, inner.translation)
        return VariantPlacement(self.rotation @ inner.rotation, place)

    def some(self, places: Indices) -> VariantPlacement:
        rotation, translation = (x[places] if len(x) > 1 else x for x in (self.rotation, self.translation))
        return VariantPlacement(rotation, translation)

    @property
    def alike(self) -> bool:
        """Whether it is the same in all variants."""
        return len(self.rotation) == len(self.translation) == 1


class VariantFrame(Record, frozen=True):
    """A frame of variants of a model.

    Attributes:
        placed: Where it is on the joint; ``None`` where that is not known of all variants.
    """

    name: str
    type: pin.FrameType
    parentJoint: int
    placed: VariantPlacement | None

    def some(self, places: Indices) -> VariantFrame:
        return self if self.placed is None else replace(self, placed=self.placed.some(places))

    @property
    def placement(self) -> VariantPlacement:
        """Where it is on the joint."""
        if self.placed is None:
            raise VariantsDiffer(f"the placement of '{self.name}'")
        return self.placed


class ModelVariants(Record, frozen=True):
    """Variants of one model, in the place of a ``pin.Model``.

    It has what all variants have in common, such as ``nv`` and ``joints``. It is no ``pin.Model``, and anything else
    that is asked of it raises ``VariantsDiffer``: no number of a single variant can be taken for that of another.

    Attributes:
        frames: Its frames, with the placements of all variants.
        parameters: Their dynamic parameters, see ``PARAMETERS`` [kg, kg*m, kg*m^2], shape (k, len(bodies), 10).
        moved: Indices of the joints whose placements vary.
        turns: Their axes in those of their parents' joints, shape (k, len(moved), 3, 3).
        shifts: Their places in the axes of their parents' joints [m], shape (k, len(moved), 3).
    """

    first: pin.Model
    frames: Sequence[VariantFrame]
    bodies: Sequence[int]
    parameters: Array
    moved: Sequence[int]
    turns: Array
    shifts: Array

    @classmethod
    def alike(cls, model: pin.Model, count: int) -> ModelVariants:
        """Return variants of a model that do not differ."""
        frames = [
            VariantFrame(frame.name, frame.type, frame.parentJoint, VariantPlacement.of(frame.placement))
            for frame in model.frames.tolist()
        ]
        none = np.zeros((count, 0, PARAMETERS)), np.zeros((count, 0, 3, 3)), np.zeros((count, 0, 3))
        return cls(model, frames, (), none[0], (), *none[1:])

    def __len__(self) -> int:
        return len(self.parameters)

    def some(self, places: Indices) -> ModelVariants:
        return replace(
            self,
            frames=[frame.some(places) for frame in self.frames],
            parameters=self.parameters[places],
            turns=self.turns[places],
            shifts=self.shifts[places],
        )

    @property
    def in_place(self) -> bool:
        """Whether all variants have their joints and frames in the same places: only masses and inertias vary."""
        still = (frame.placed is not None and frame.placed.alike for frame in self.frames)
        return not self.moved and all(still)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute that all variants share; others raise ``VariantsDiffer``."""
        if name in ALIKE:
            return getattr(self.first, name)
        raise VariantsDiffer(f"'{name}' of a model, of which there are several variants")


Model = Any
"""A ``pin.Model``, of which Pinocchio has no types, or ``ModelVariants``."""


def bodies_of(model: Model) -> tuple[Array, Array, Array]:
    """Return masses [kg], centres of mass [m] and spatial inertias of the links in their joints' axes.

    Shapes (.., njoints), (.., njoints, 3) and (.., njoints, 6, 6), with k variants in place of the dots.
    """
    if not isinstance(model, ModelVariants):
        bodies = model.inertias.tolist()
        return (
            np.array([body.mass for body in bodies]),
            np.array([body.lever for body in bodies]),
            np.array([body.matrix() for body in bodies]),
        )
    masses, levers, inertias = (np.repeat(x[None], len(model), axis=0) for x in bodies_of(model.first))
    places, given = list(model.bodies), model.parameters
    masses[:, places] = given[..., 0]
    levers[:, places] = given[..., 1:4] / given[..., :1]
    inertias[:, places] = spatial_inertias(given)
    return masses, levers, inertias


def spatial_inertias(parameters: Array) -> Array:
    """Return ``[[m 1, -m [c]x], [m [c]x, I]]`` of dynamic parameters, shape (.., 10), as (.., 6, 6)."""
    m, (x, y, z) = parameters[..., 0], np.moveaxis(parameters[..., 1:4], -1, 0)
    xx, xy, yy, xz, yz, zz = np.moveaxis(parameters[..., 4:], -1, 0)
    o = np.zeros_like(m)
    rows = [
        [m, o, o, o, z, -y],
        [o, m, o, -z, o, x],
        [o, o, m, y, -x, o],
        [o, -z, y, xx, xy, xz],
        [z, o, -x, xy, yy, yz],
        [-y, x, o, xz, yz, zz],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def placements_of(model: Model) -> tuple[Array, Array]:
    """Return rotation matrices and places [m] of the joints in their parents' axes.

    Shapes (.., njoints, 3, 3) and (.., njoints, 3), with k variants in place of the dots; 1 where all are alike.
    """
    if not isinstance(model, ModelVariants):
        places = model.jointPlacements.tolist()
        return np.array([place.rotation for place in places]), np.array([place.translation for place in places])
    turns, shifts = placements_of(model.first)
    return _spread(turns, model.turns, model.moved), _spread(shifts, model.shifts, model.moved)


def _spread(common: Array, own: Array, places: Sequence[int]) -> Array:
    """Return arrays of k variants, or of one if all are alike: common values, replaced at ``places`` by their own."""
    alike = len(places) == 0 or bool((own == own[:1]).all())
    spread = np.repeat(common[None], 1 if alike else len(own), axis=0)
    spread[:, list(places)] = own[: len(spread)]
    return spread
