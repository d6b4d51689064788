"""Variants of a URDF model, whose numbers are columns: masses, inertias and origins as arrays over the variants.

The reader of ``urdf`` makes one model of one text. Here the same text has columns at some numbers, and only what
follows from these is computed, for all variants at once: dynamic parameters of bodies, and placements of joints. What
is computed for the first variant is compared with its model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from xml.etree.ElementTree import Element, tostring

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.input.units import decimal
from pinarm.input.xml_text import tree_of
from pinarm.input.yaml.schema import FARTHEST
from pinarm.mechanics.geometry.model_variants import (
    PARAMETERS,
    ModelVariants,
    VariantFrame,
    VariantPlacement,
    VariantsDiffer,
)
from pinarm.mechanics.loading.model_tree import LIGHTEST, Tree, impossible
from pinarm.mechanics.loading.urdf import urdf_tree

DRAWN = ("visual", "collision")
"""Parts of links that only pictures show."""

ROUNDING = 1e-13
"""Of a number that is computed in another order, relative to the largest of its kind."""

KEPT = 4
"""Texts that are kept as they have been read: the variants of one model come in many chunks."""

Columns = Mapping[str, Array]
"""A word in an attribute -> the numbers of the variants in its place, shape (k,)."""

IDENTITY = VariantPlacement.of(pin.SE3.Identity())


def model_variants(model: pin.Model, xml: str, marked: str, columns: Columns) -> tuple[ModelVariants, Flags]:
    """Return variants of a model, and which of them are models at all, shape (k,).

    Args:
        marked: The same text, with words of ``columns`` where numbers vary.
    """
    return _Variants(model, _tree_of(xml), _Numbers(columns), _marked(marked, (*columns,))).read()


@lru_cache(KEPT)
def _tree_of(xml: str) -> Tree:
    return urdf_tree(tree_of(xml))


@lru_cache(KEPT)
def _marked(text: str, columns: Sequence[str]) -> Element:
    """Return the text as an element; raise where a number varies that is not read here, nor drawn only."""
    rest = tree_of(text)
    for link in rest.iterfind("link"):
        link[:] = [part for part in link if part.tag not in DRAWN]
    for path in ("link/inertial/mass", "link/inertial/origin", "link/inertial/inertia", "joint/origin"):
        for element in rest.iterfind(path):
            element.attrib.clear()
    for part in (rest, *rest):
        own = " ".join(part.attrib.values()) if part is rest else tostring(part, encoding="unicode")
        if any(word in own for word in columns):
            raise VariantsDiffer(f"<{part.tag} name='{part.get('name')}'>")
    return tree_of(text)


class _Numbers:
    """Numbers of attributes in which words of columns may stand."""

    def __init__(self, columns: Columns) -> None:
        self.columns, self.count = columns, len(next(iter(columns.values())))

    def vary(self, element: Element) -> bool:
        return any(word in text for text in element.attrib.values() for word in self.columns)

    def read(self, text: str) -> Array:
        """Return the numbers of a text, shape (k, numbers), or (1, numbers) where none varies."""
        try:
            words = [self.columns[word] if word in self.columns else decimal(word) for word in text.split()]
        except ValueError:
            raise VariantsDiffer(f"'{text}'") from None
        return np.atleast_2d(np.stack(np.broadcast_arrays(*words), axis=-1))

    def placement(self, origin: Element | None) -> VariantPlacement:
        if origin is None:
            return IDENTITY
        if "quat_xyzw" in origin.attrib:
            raise VariantsDiffer("an origin with a quaternion")
        shift, angles = (self.read(origin.get(key, "0 0 0")) for key in ("xyz", "rpy"))
        return VariantPlacement(_turns(angles), shift)


class _Variants:
    """Model and tree of the first variant beside the numbers of all."""

    def __init__(self, model: pin.Model, tree: Tree, numbers: _Numbers, robot: Element) -> None:
        self.model, self.tree, self.numbers = model, tree, numbers
        self.possible = np.ones(numbers.count, dtype=bool)
        self.origins = {
            joint.get("name", ""): numbers.placement(origin)
            for joint in robot.iterfind("joint")
            if (origin := joint.find("origin")) is not None and numbers.vary(origin)
        }
        self.inertials = {
            link.get("name", ""): inertial
            for link in robot.iterfind("link")
            if (inertial := link.find("inertial")) is not None and any(map(numbers.vary, inertial))
        }

    def read(self) -> tuple[ModelVariants, Flags]:
        places, moved = self._placements()
        frames = [*map(self._frame_of, self.tree.links)]
        varied = {frame.parentJoint for frame in frames if frame.name in self.inertials or frame.name in places} - {0}
        bodies = {joint: np.zeros((self.numbers.count, PARAMETERS)) for joint in sorted(varied)}
        for frame in frames:
            if frame.parentJoint in bodies or frame.name in self.inertials:
                place = places.get(frame.name) or VariantPlacement.of(frame.placement)
                own = self._parameters(frame.name, place)
                if frame.parentJoint:  # that of the world is only checked
                    bodies[frame.parentJoint] = bodies[frame.parentJoint] + own
        for joint, parameters in bodies.items():
            if not parameters[0, 0] > 0.0:
                raise VariantsDiffer("a body without mass")
            self._allow((np.abs(parameters).max(axis=1) <= FARTHEST) & (parameters[:, 0] >= LIGHTEST))
            _same(parameters[0], self.model.inertias[joint].toDynamicParameters())
        for joint, place in moved.items():
            self._allow(
                (np.abs(place.translation).max(axis=1) <= FARTHEST) & np.isfinite(place.rotation).all(axis=(1, 2))
            )
            _same(place.rotation[0], self.model.jointPlacements[joint].rotation)
            _same(place.translation[0], self.model.jointPlacements[joint].translation)
        for parameters in bodies.values():
            parameters[~self.possible] = parameters[0]  # finite numbers for what is not looked at
        return self._stacked(bodies, moved, places), self.possible

    def _allow(self, possible: Flags) -> None:
        self.possible = np.asarray(self.possible & possible, dtype=bool)

    def _stacked(
        self, bodies: Mapping[int, Array], moved: Mapping[int, VariantPlacement], places: Mapping[str, VariantPlacement]
    ) -> ModelVariants:
        k = self.numbers.count
        parameters = np.zeros((k, len(bodies), PARAMETERS))
        turns, shifts = np.zeros((k, len(moved), 3, 3)), np.zeros((k, len(moved), 3))
        for number, own in enumerate(bodies.values()):
            parameters[:, number] = own
        for number, place in enumerate(moved.values()):
            turns[:, number], shifts[:, number] = place.rotation, place.translation
        frames = list[VariantFrame]()
        for frame in self.model.frames.tolist():
            link = frame.name in self.tree.links and frame.type == pin.FrameType.BODY
            known = link or not frames or not places  # the first is the world
            placed = (places.get(frame.name) or VariantPlacement.of(frame.placement)) if known else None
            frames.append(VariantFrame(frame.name, frame.type, frame.parentJoint, placed))
        return ModelVariants(self.model, frames, (*bodies,), parameters, (*moved,), turns, shifts)

    def _frame_of(self, link: str) -> pin.Frame:
        return self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]

    def _placements(self) -> tuple[dict[str, VariantPlacement], dict[int, VariantPlacement]]:
        """Return links that are fixed elsewhere on their joint, by name, and joints that are, by index."""
        places, moved = dict[str, VariantPlacement](), dict[int, VariantPlacement]()
        for joint in self.tree.joints:
            origin = self.origins.get(joint.name)
            if origin is None and joint.parent not in places:
                continue
            if joint.kind not in ("fixed", "revolute", "prismatic", "ball"):
                raise VariantsDiffer(f"origin of the {joint.kind} joint '{joint.name}'")
            parent = places.get(joint.parent) or VariantPlacement.of(self._frame_of(joint.parent).placement)
            place = parent * (origin or VariantPlacement.of(joint.placement))
            if joint.kind == "fixed":
                places[joint.child] = place
            else:
                moved[self.model.getJointId(joint.name)] = place
        return places, moved

    def _parameters(self, link: str, place: VariantPlacement) -> Array:
        """Return dynamic parameters of a link, shape (k, 10), or (1, 10) where it does not vary; see ``PARAMETERS``.

        Args:
            place: Where the link is on its joint.
        """
        inertial, numbers = self.inertials.get(link), self.numbers
        if inertial is None:
            body = self.tree.links[link]
            return _carried(np.array([body.mass]), place, body.lever[None], body.inertia[None])
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or inertia is None:
            raise VariantsDiffer(f"link '{link}'")
        text = (inertia.get(key, "0") for key in ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz"))
        moments, masses = numbers.read(" ".join(text)).reshape(-1, 3, 3), numbers.read(mass.get("value", ""))[:, 0]
        self._allow(~impossible(moments) & (masses >= 0.0))
        return _carried(masses, place * numbers.placement(inertial.find("origin")), np.zeros((1, 3)), moments)


def _carried(mass: Array, place: VariantPlacement, centre: Array, moments: Array) -> Array:
    """Return dynamic parameters about a frame of bodies at a place in it, shape (k, 10)."""
    c = place.translation + np.matvec(place.rotation, centre)
    squares = np.vecdot(c, c)[:, None, None] * np.eye(3) - c[:, :, None] * c[:, None]
    about = place.rotation @ moments @ place.rotation.swapaxes(1, 2) + mass[:, None, None] * squares
    rows = about[:, (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
    parts = mass[:, None], mass[:, None] * c, rows
    return np.concatenate([np.broadcast_to(part, (len(rows), part.shape[1])) for part in parts], axis=1)


def _turns(angles: Array) -> Array:
    """Return ``Rz(yaw) Ry(pitch) Rx(roll)``, angles of shape (k, 3), as an array of shape (k, 3, 3)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _same(own: Array, first: Array) -> None:
    if not np.abs(own - first).max() <= ROUNDING * np.abs(first).max():
        raise VariantsDiffer("the model of the first variant")
