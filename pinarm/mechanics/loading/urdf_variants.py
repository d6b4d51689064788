"""Variants of a URDF model, whose numbers are columns: masses, inertias and origins as arrays over the variants.

The reader of ``urdf`` makes one model of one text. Here the same text has columns at some numbers, and only what
follows from these is computed, for all variants at once: dynamic parameters of bodies, and placements of joints. What
is computed for the first variant is compared with its model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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


def model_variants(model: pin.Model, xml: str, marked: str, columns: Columns) -> tuple[ModelVariants, Flags]:
    """Return variants of a model, and which of them are models at all, shape (k,).

    Args:
        marked: The same text, with words of ``columns`` where numbers vary.
    """
    robot, tree, numbers = _marked(marked, (*columns,)), _tree_of(xml), _Numbers(columns)
    inertials = {link.get("name", ""): link.find("inertial") for link in robot.iterfind("link")}
    places, moved = _placements(model, tree, robot, numbers)
    sums, possible = dict[int, Array](), np.ones(numbers.count, dtype=bool)
    for link, place in places.items():
        own, sound = numbers.parameters(inertials.get(link), tree.links[link], place)
        joint = _frame(model, link).parentJoint
        sums[joint], possible = sums.get(joint, 0.0) + own, possible & sound
    bodies = {joint: sums[joint] for joint in sorted(sums) if joint and len(sums[joint]) > 1}
    for joint, parameters in bodies.items():
        if not parameters[0, 0] > 0.0:
            raise VariantsDiffer("a body without mass")
        possible &= (np.abs(parameters).max(axis=1) <= FARTHEST) & (parameters[:, 0] >= LIGHTEST)
        _same(parameters[0], model.inertias[joint].toDynamicParameters())
    for joint, place in moved.items():
        possible &= np.abs(place.translation).max(axis=1) <= FARTHEST
        possible &= np.isfinite(place.rotation).all(axis=(1, 2))
        _same(place.rotation[0], model.jointPlacements[joint].rotation)
        _same(place.translation[0], model.jointPlacements[joint].translation)
    stacked = _stacked([*bodies.values()], numbers.count, PARAMETERS)
    stacked[~possible] = stacked[0]  # finite numbers for what is not looked at
    turns = _stacked([place.rotation for place in moved.values()], numbers.count, 3, 3)
    shifts = _stacked([place.translation for place in moved.values()], numbers.count, 3)
    frames = [*_frames(model, tree, places)]
    return ModelVariants(model, frames, (*bodies,), stacked, (*moved,), turns, shifts), possible


def _placements(
    model: pin.Model, tree: Tree, robot: Element, numbers: _Numbers
) -> tuple[dict[str, VariantPlacement], dict[int, VariantPlacement]]:
    """Return where links are on their joints, by name, and the joints whose placements vary, by index."""
    origins = {joint.get("name", ""): joint.find("origin") for joint in robot.iterfind("joint")}
    places, moved = {tree.root: VariantPlacement.of(pin.SE3.Identity())}, dict[int, VariantPlacement]()
    for joint in tree.joints:
        origin = origins.get(joint.name)
        varies = origin is not None and numbers.vary(origin)
        own = numbers.placement(origin) if varies else VariantPlacement.of(joint.placement)
        place, still = places[joint.parent] * own, VariantPlacement.of(_frame(model, joint.child).placement)
        places[joint.child] = still if place.alike or joint.kind != "fixed" else place
        if not place.alike and joint.kind != "fixed":
            if joint.kind not in ("revolute", "prismatic", "ball"):
                raise VariantsDiffer(f"origin of the {joint.kind} joint '{joint.name}'")
            moved[model.getJointId(joint.name)] = place
    return places, moved


def _frames(model: pin.Model, tree: Tree, places: Mapping[str, VariantPlacement]) -> Iterator[VariantFrame]:
    """Yield the frames of a model; where any varies, those of links and of the world have known placements alone."""
    still = all(place.alike for place in places.values())
    for index, frame in enumerate(model.frames.tolist()):
        known = frame.name in tree.links and frame.type == pin.FrameType.BODY
        placed = places[frame.name] if known else VariantPlacement.of(frame.placement) if still or not index else None
        yield VariantFrame(frame.name, frame.type, frame.parentJoint, placed)


def _frame(model: pin.Model, link: str) -> pin.Frame:
    return model.frames[model.getFrameId(link, pin.FrameType.BODY)]


def _stacked(arrays: Sequence[Array], count: int, *shape: int) -> Array:
    """Return arrays of k variants, or of one for all, side by side, shape (k, number, ..)."""
    stacked = np.zeros((count, len(arrays), *shape))
    for number, array in enumerate(arrays):
        stacked[:, number] = array
    return stacked


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
            return VariantPlacement.of(pin.SE3.Identity())
        if "quat_xyzw" in origin.attrib:
            raise VariantsDiffer("an origin with a quaternion")
        shift, angles = (self.read(origin.get(key, "0 0 0")) for key in ("xyz", "rpy"))
        return VariantPlacement(_turns(angles), shift)

    def parameters(
        self, inertial: Element | None, first: pin.Inertia, place: VariantPlacement
    ) -> tuple[Array, Flags | bool]:
        """Return dynamic parameters of a link, (k, 10), or (1, 10) where it does not vary, and which are of a body.

        Args:
            first: Inertia of the link in the first variant.
            place: Where the link is on its joint.
        """
        if inertial is None or not any(map(self.vary, inertial)):
            return _carried(np.array([first.mass]), place, first.lever[None], first.inertia[None]), True
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or inertia is None:
            raise VariantsDiffer("a mass without moments of inertia")
        text = (inertia.get(key, "0") for key in ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz"))
        moments, masses = self.read(" ".join(text)).reshape(-1, 3, 3), self.read(mass.get("value", ""))[:, 0]
        own = _carried(masses, place * self.placement(inertial.find("origin")), np.zeros((1, 3)), moments)
        return own, ~impossible(moments) & (masses >= 0.0)


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
