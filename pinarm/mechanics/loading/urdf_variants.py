"""Variants of a URDF model, whose numbers are columns: masses, inertias and origins as arrays over the variants.

The reader of ``urdf`` makes one model of one text. Here the same text has columns at some numbers, and only what
follows from these is computed, for all variants at once: dynamic parameters of bodies, and placements of joints. What
is computed for the first variant is compared with its model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.input.units import decimal
from pinarm.input.xml_text import tree_of
from pinarm.input.yaml.schema import FARTHEST, HEAVIEST, LARGEST
from pinarm.mechanics.geometry.model_variants import (
    PARAMETERS,
    ModelVariants,
    VariantFrame,
    VariantPlacement,
    VariantsDiffer,
)
from pinarm.mechanics.joints import UNIVERSE
from pinarm.mechanics.loading.model_tree import LIGHTEST, Tree, impossible
from pinarm.mechanics.loading.urdf import urdf_tree

DRAWN = ("visual", "collision")
"""Parts of links that only pictures show."""

READ = {"link": {"mass", "origin", "inertia"}, "joint": {"origin"}}
"""Elements within links and joints whose numbers may vary."""

ROUNDING = 1e-13
"""Of a number that is computed in another order, relative to the largest of its kind."""

KEPT = 4
"""Texts that are kept as they have been read: the variants of one model come in many chunks."""

Columns = Mapping[str, Sequence[Any] | Array]
"""A word in an attribute -> the numbers of the variants in its place, or texts of several numbers."""


class Body(NamedTuple):
    """The inertia of a link about a frame, of k variants or, in all of them, 1.

    Attributes:
        mass: [kg], shape (k,).
        centre: Centre of mass [m], shape (k, 3).
        moments: Inertia about the centre [kg*m^2], shape (k, 3, 3).
    """

    mass: Array
    centre: Array
    moments: Array

    def ordinary(self) -> Flags:
        """Return in which variants the numbers are neither negative nor too large, as models are read, shape (k,)."""
        near, small = np.abs(self.centre).max(axis=1) <= FARTHEST, np.abs(self.moments).max(axis=(1, 2)) <= LARGEST
        return np.asarray(near & small & (self.mass >= 0.0) & (self.mass <= HEAVIEST), dtype=bool)

    def parameters(self) -> Array:
        """Return dynamic parameters about the frame, shape (k, 10); see ``PARAMETERS``."""
        m, c = self.mass[:, None, None], self.centre
        squares = np.vecdot(c, c)[:, None, None] * np.eye(3) - c[:, :, None] * c[:, None]
        about = self.moments + m * squares
        rows = about[:, (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
        parameters = np.empty((len(about), PARAMETERS))
        parameters[:, 0], parameters[:, 1:4], parameters[:, 4:] = self.mass, self.mass[:, None] * c, rows
        return parameters


def _carried(place: VariantPlacement, body: Body) -> Body:
    turned = place.rotation @ body.moments @ place.rotation.swapaxes(1, 2)
    return Body(body.mass, place.translation + np.matvec(place.rotation, body.centre), turned)


def model_variants(model: pin.Model, xml: str, marked: str, columns: Columns) -> tuple[ModelVariants, Flags]:
    """Return variants of a model, and which of them are models at all, shape (k,).

    Args:
        marked: The same text, with words of ``columns`` where numbers vary.
    """
    return _Reader(model, _tree_of(xml), _marked(marked, (*columns,)), columns).variants()


@lru_cache(KEPT)
def _tree_of(xml: str) -> Tree:
    return urdf_tree(tree_of(xml))


@lru_cache(KEPT)
def _marked(text: str, columns: Sequence[str]) -> Element:
    robot = tree_of(text)
    _check_places(robot, columns)
    return robot


def _check_places(robot: Element, columns: Sequence[str]) -> None:
    """Raise where a number varies that is not read here; see ``_marked``."""
    for part in robot:
        for element, read in _elements(part):
            texts = [*([] if read else element.attrib.values()), element.text or "", element.tail or ""]
            if any(word in text for text in texts for word in columns):
                raise VariantsDiffer(f"<{element.tag}> of <{part.tag} name='{part.get('name')}'>")
    if any(word in text for text in robot.attrib.values() for word in columns):
        raise VariantsDiffer("<robot>")


def _elements(part: Element) -> Iterator[tuple[Element, bool]]:
    """Yield a part of a model and what is in it but for drawings, and whether numbers of it are read here."""
    yield part, False
    for child in part:
        if child.tag == "inertial" and part.tag == "link":
            yield child, False
            yield from ((inner, inner.tag in READ["link"]) for inner in child)
        elif child.tag not in DRAWN or part.tag != "link":
            yield from (
                (inner, inner is child and part.tag == "joint" and child.tag in READ["joint"]) for inner in child.iter()
            )


@dataclass(frozen=True, eq=False)
class _Reader:
    """Reader of variants: model and tree of the first variant, and the text with columns."""

    model: pin.Model
    tree: Tree
    robot: Element
    columns: Columns

    def variants(self) -> tuple[ModelVariants, Flags]:
        places, moved = self._placements()
        owner = {name: self._frame(name).parentJoint for name in self.tree.links}
        own = {name: body for name in self.tree.links if (body := self._varied_body(name)) is not None}
        varied = {owner[name] for name in (*own, *places)} - {0}
        possible = np.ones(self._count, dtype=bool)
        for body in own.values():
            possible &= ~impossible(np.broadcast_to(body.moments, (self._count, 3, 3))) & body.ordinary()
        bodies = {joint: np.zeros((self._count, PARAMETERS)) for joint in sorted(varied)}
        for name, joint in owner.items():
            if joint in bodies:
                place = places.get(name) or VariantPlacement.of(self._frame(name).placement)
                bodies[joint] = bodies[joint] + _carried(place, own.get(name) or self._body(name)).parameters()
        if not all(parameters[0, 0] > 0.0 for parameters in bodies.values()):
            raise VariantsDiffer("a body without mass")
        for joint, parameters in bodies.items():
            possible &= np.isfinite(parameters).all(axis=1) & (parameters[:, 0] >= LIGHTEST)
            _same(parameters[0], self.model.inertias[joint].toDynamicParameters())
        for origin in self._origins.values():
            possible &= np.abs(origin.translation).max(axis=1) <= FARTHEST
        for joint, place in moved.items():
            possible &= np.isfinite(place.translation).all(axis=1) & np.isfinite(place.rotation).all(axis=(1, 2))
            _same(place.rotation[0], self.model.jointPlacements[joint].rotation)
            _same(place.translation[0], self.model.jointPlacements[joint].translation)
        for parameters in bodies.values():
            parameters[~possible] = parameters[0]  # finite numbers for what is not looked at
        return self._stacked(bodies, moved, places), possible

    def _stacked(
        self, bodies: Mapping[int, Array], moved: Mapping[int, VariantPlacement], places: Mapping[str, VariantPlacement]
    ) -> ModelVariants:
        k = self._count
        shapes = np.zeros((k, 0, PARAMETERS)), np.zeros((k, 0, 3, 3)), np.zeros((k, 0, 3))
        turns = [np.broadcast_to(place.rotation, (k, 3, 3)) for place in moved.values()]
        shifts = [np.broadcast_to(place.translation, (k, 3)) for place in moved.values()]
        parameters, turned, shifted = (
            np.stack(stack, axis=1) if stack else empty
            for stack, empty in zip((list(bodies.values()), turns, shifts), shapes, strict=True)
        )
        world = self.model.frames[UNIVERSE]
        ground = VariantFrame(world.name, world.type, world.parentJoint, VariantPlacement.of(world.placement))
        frames = [ground, *(self._variant_frame(frame, places) for frame in self.model.frames.tolist()[1:])]
        return ModelVariants(self.model, frames, (*bodies,), parameters, (*moved,), turned, shifted)

    def _variant_frame(self, frame: pin.Frame, places: Mapping[str, VariantPlacement]) -> VariantFrame:
        link = frame.name in self.tree.links and frame.type == pin.FrameType.BODY
        place = places.get(frame.name) or VariantPlacement.of(frame.placement) if link or not places else None
        return VariantFrame(frame.name, frame.type, frame.parentJoint, place)

    @property
    def _count(self) -> int:
        return len(next(iter(self.columns.values())))

    def _frame(self, link: str) -> pin.Frame:
        return self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]

    def _placements(self) -> tuple[dict[str, VariantPlacement], dict[int, VariantPlacement]]:
        """Return links that are fixed elsewhere on their joint, by name, and joints that are, by index."""
        places, moved = dict[str, VariantPlacement](), dict[int, VariantPlacement]()
        for joint in self.tree.joints:
            origin = self._origins.get(joint.name)
            if origin is None and joint.parent not in places:
                continue
            if joint.kind not in ("fixed", "revolute", "prismatic", "ball"):
                raise VariantsDiffer(f"origin of the {joint.kind} joint '{joint.name}'")
            parent = places.get(joint.parent) or VariantPlacement.of(self._frame(joint.parent).placement)
            place = parent * (origin or VariantPlacement.of(joint.placement))
            if joint.kind == "fixed":
                places[joint.child] = place
            else:
                moved[self.model.getJointId(joint.name)] = place
        return places, moved

    @cached_property
    def _origins(self) -> dict[str, VariantPlacement]:
        origins = ((element.get("name", ""), element.find("origin")) for element in self.robot.findall("joint"))
        return {name: self._place(origin) for name, origin in origins if origin is not None and self._varies(origin)}

    def _varied_body(self, link: str) -> Body | None:
        inertial = self.robot.find(f"link[@name='{link}']/inertial") if "'" not in link else None
        if inertial is None or not any(self._varies(element) for element in inertial):
            return None
        mass, origin, inertia = (inertial.find(tag) for tag in ("mass", "origin", "inertia"))
        if mass is None or inertia is None:
            raise VariantsDiffer(f"link '{link}'")
        text = (inertia.get(key, "0") for key in ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz"))
        moments = self._numbers(" ".join(text)).reshape(-1, 3, 3)
        place = VariantPlacement.of(pin.SE3.Identity()) if origin is None else self._place(origin)
        body = _carried(place, Body(self._numbers(mass.get("value", ""))[:, 0], np.zeros((1, 3)), moments))
        return Body(*(np.broadcast_to(x, (self._count, *x.shape[1:])) for x in body))

    def _place(self, origin: Element) -> VariantPlacement:
        if "quat_xyzw" in origin.attrib:
            raise VariantsDiffer("an origin with a quaternion")
        shift, angles = (self._numbers(origin.get(key, "0 0 0")) for key in ("xyz", "rpy"))
        return VariantPlacement(_turns(angles), shift)

    def _body(self, link: str) -> Body:
        body = self.tree.links[link]
        return Body(np.array([body.mass]), body.lever[None], body.inertia[None])

    def _varies(self, element: Element) -> bool:
        return any(word in text for text in element.attrib.values() for word in self.columns)

    def _numbers(self, text: str) -> Array:
        """Return the numbers of an attribute, shape (k, numbers), or (1, numbers) where none varies."""
        try:
            words = [_read(self.columns.get(word, (word,))) for word in text.split()]
        except ValueError:
            raise VariantsDiffer(f"'{text}'") from None
        count = max(map(len, words), default=1)
        return np.concatenate([np.broadcast_to(word, (count, word.shape[1])) for word in words], axis=1)


def _read(column: Sequence[Any] | Array) -> Array:
    """Return the numbers of a column, shape (k, 1), or of a column of texts, shape (k, numbers)."""
    if isinstance(column, np.ndarray) and column.dtype == np.float64:
        return column[:, None]
    rows = [[*map(decimal, value.split())] if isinstance(value, str) else [float(value)] for value in column]
    return np.array(rows, dtype=np.float64)


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
