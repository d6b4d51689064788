"""Placements of the frames of an SDF model: links, joints and ``<frame>``, each relative to another one.

Source: SDFormat, pose frame semantics: a link is placed in the model, a joint in its child, a frame in what it is
attached to, unless ``relative_to`` says another frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError, choices
from pinarm.input.numbers import decimal

MODEL = "__model__"
"""Name of the frame of the model."""

WORLD = "world"
"""Name of what a model stands on."""

TRUTH = {"true": True, "1": True, "false": False, "0": False}
"""Words of SDF for yes and no, in capitals or not."""

FoundT = TypeVar("FoundT")


@dataclass(frozen=True)
class Frames:
    """Frames of a model by name, or those of a world.

    Attributes:
        placed: Frame -> the frame that it is placed in, and its placement there.
        attached: Frame -> the frame that it moves with; links move with themselves.
        root: The frame in which all are placed, directly or through others.
    """

    placed: Mapping[str, tuple[str, pin.SE3]]
    attached: Mapping[str, str]
    root: str = MODEL
    _places: dict[str, pin.SE3] = field(default_factory=dict)
    _links: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, model: Element) -> Frames:
        """Return the frames of a ``<model>`` element.

        Raises:
            ModelError: Two have the same name, or one has no name, or one that the format keeps for itself.
        """
        placed: dict[str, tuple[str, pin.SE3]] = {MODEL: (MODEL, pin.SE3.Identity())}
        attached: dict[str, str] = {}
        for element in (*model.findall("link"), *model.findall("joint"), *model.findall("frame")):
            name = element.get("name", "")
            if not name or name in placed:
                raise ModelError(f"two frames have the name '{name}'" if name else f"a {element.tag} has no name",
                                 expected="a name of its own for each link, joint and frame")  # fmt: skip
            _require_free(name, element.tag)
            base = {"link": MODEL, "joint": text_of(element, "child"), "frame": element.get("attached_to") or MODEL}
            attached[name] = name if element.tag == "link" else base[element.tag]
            placed[name] = pose_of(element, base[element.tag], f"{element.tag} '{name}'")
        return cls(placed, attached)

    @classmethod
    def around(cls, model: Element, world: Element | None) -> Frames:
        """Return the frames that a model may be placed in: its world, those that this has, and the model itself.

        Raises:
            ModelError: Two have the same name, or one has no name, or one that the format keeps for itself.
        """
        placed: dict[str, tuple[str, pin.SE3]] = {WORLD: (WORLD, pin.SE3.Identity())}
        for element in (model, *(world.findall("frame") if world is not None else ())):
            name = element.get("name", "")
            if name in placed:
                raise ModelError(f"two frames have the name '{name}'", expected="a name of its own for each")
            _require_free(name, element.tag)
            placed[name] = pose_of(element, element.get("attached_to") or WORLD, f"{element.tag} '{name}'")
        return cls(placed, {}, WORLD)

    def placement(self, name: str, where: str) -> pin.SE3:
        """Return the placement of a frame in the root.

        Raises:
            ModelError: There is no such frame, or frames are placed in each other.
        """
        chain = dict[str, pin.SE3]()
        while name != self.root and name not in self._places:
            base, chain[name] = self._known(self.placed, name, where)
            if base in chain:
                raise ModelError(f"{where}: frames are placed in each other: {' -> '.join([*chain, base])}")
            name = base
        place = self._places.get(name, pin.SE3.Identity())
        for frame, step in reversed(chain.items()):
            place = self._places[frame] = place * step
        return place

    def link(self, name: str, where: str) -> str:
        """Return the link that a frame moves with.

        Raises:
            ModelError: There is no such frame, or it moves with none.
        """
        chain = {name: None}
        while (base := self._links.get(name) or self._known(self.attached, name, where)) != name:
            if base in chain or base == MODEL:
                raise ModelError(f"{where}: the frame '{next(iter(chain))}' is attached to no link",
                                 expected="attached_to: a link")  # fmt: skip
            chain[base], name = None, base
        self._links.update(dict.fromkeys(chain, name))
        return name

    def _known(self, found: Mapping[str, FoundT], name: str, where: str) -> FoundT:
        if name not in found:
            expected, hint = choices(name, [key for key in found if key != MODEL])
            raise ModelError(f"{where}: there is no frame '{name}'", expected=expected, hint=hint)
        return found[name]


def _require_free(name: str, what: str) -> None:
    """Raise where a name is one that the format keeps for itself.

    Raises:
        ModelError: It is ``world``, or begins and ends with two underscores.
    """
    if name == WORLD or (name.startswith("__") and name.endswith("__")):
        raise ModelError(f"{what} '{name}': this name is reserved", expected="a name that is not 'world', nor __..__")


def pose_of(element: Element, base: str, where: str) -> tuple[str, pin.SE3]:
    """Return the frame that an element is placed in, and its placement there: as ``<pose>`` says, or at its base.

    Raises:
        ModelError: The pose is malformed.
    """
    pose = element.find("pose")
    if pose is None:
        return base, pin.SE3.Identity()
    if pose.get("frame"):
        raise ModelError(f"{where}: its <pose> has the attribute frame='{pose.get('frame')}', which no version defines",
                         hint=f"relative_to=\"{pose.get('frame')}\" in version 1.7")  # fmt: skip
    quaternion = pose.get("rotation_format") == "quat_xyzw"
    given = numbers_of(pose.text or ("0 " * 6 + "1" * quaternion), 7 if quaternion else 6, f"{where}: pose")
    if quaternion:
        if not given[3:].any():
            raise ModelError(f"{where}: its pose has the quaternion 0")
        x, y, z, w = unit(given[3:])
        turn = pin.Quaternion(w, x, y, z).matrix()
    else:
        angles = np.deg2rad(given[3:]) if is_true(pose.get("degrees"), f"{where}: degrees of its pose") else given[3:]
        turn = pin.rpy.rpyToMatrix(angles)
    return pose.get("relative_to") or base, pin.SE3(turn, given[:3])


def is_true(text: str | None, where: str, *, default: bool = False) -> bool:
    """Return whether a text says yes; the default where there is none.

    Raises:
        ModelError: It says neither yes nor no.
    """
    word = (text or "").strip()
    if not word:
        return default
    if word.lower() not in TRUTH:
        raise ModelError(f"{where}: '{word}'", expected=f"one of {', '.join(TRUTH)}")
    return TRUTH[word.lower()]


def numbers_of(text: str, count: int, where: str) -> Array:
    """Return finite numbers of a text, shape (count,).

    Raises:
        ModelError: They are not so many, or not finite numbers.
    """
    try:
        found = [decimal(part) for part in text.split()]
    except ValueError:
        found = []
    if len(found) != count or not all(math.isfinite(number) for number in found):
        raise ModelError(f"{where}: '{text.strip()}'", expected=f"{count} finite number{'s' if count > 1 else ''}")
    return np.array(found)


def number_in(element: Element | None, path: str, default: float, where: str) -> float:
    """Return the number in an element that is given by its path; the default where there is none."""
    text = None if element is None else element.findtext(path)
    return default if text is None or not text.strip() else float(numbers_of(text, 1, f"{where}: {path}")[0])


def text_of(element: Element, tag: str) -> str:
    """Return the text in an element, without spaces around it; empty where there is none."""
    return (element.findtext(tag) or "").strip()
