"""Names of SDF, and the placements of its frames: links, joints and ``<frame>``, each relative to another one.

Sources: the specification of SDFormat, versions 1.4 to 1.12 (sdformat.org/spec), and its pose frame semantics: a link
is placed in the model, a joint in its child, a frame in what it is attached to, unless ``relative_to`` says another
frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.errors import ModelError, choices
from pinarm.input.xml_text import format_names
from pinarm.mechanics.loading.values import number, numbers, rotation

SDF = format_names({
    "sdf": "version > model* world* light- actor-",
    "world": "name > model* gravity frame* audio- atmosphere- gui- physics- scene- light- spherical_coordinates- "
             "state- magnetic_field- population- road- wind-",
    "model": "name canonical_link placement_frame > pose static link* joint* frame* self_collide- allow_auto_disable-",
    "frame": "name attached_to > pose",
    "link": "name > pose inertial gravity visual- collision- self_collide- must_be_base_link- audio_source- "
            "audio_sink-",
    "pose": "relative_to frame degrees rotation_format",
    "inertial": "auto > mass pose inertia density- auto_inertia_params-",
    "inertia": "> ixx ixy ixz iyy iyz izz",
    "joint": "name type > pose parent child axis axis2=axis gearbox_ratio gearbox_reference_body thread_pitch "
             "screw_thread_pitch",
    "axis": "> xyz use_parent_model_frame limit dynamics mimic",
    "xyz": "expressed_in",
    "limit": "> lower upper effort velocity stiffness- dissipation-",
    "dynamics": "> damping friction spring_reference spring_stiffness",
    "mimic": "joint axis > multiplier offset reference",
})  # fmt: skip
"""Names that are read, or have no part in the computation."""

MODEL = "__model__"
"""Name of the frame of the model."""

WORLD = "world"
"""Name of the fixed frame around a model."""

TRUTH = {"true": True, "1": True, "false": False, "0": False}
"""Words of SDF for yes and no, in capitals or not."""

ValueT = TypeVar("ValueT")


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

    @classmethod
    def of(cls, model: Element) -> Frames:
        """Return the frames of a ``<model>`` element."""
        placed = {MODEL: (MODEL, pin.SE3.Identity())}
        attached: dict[str, str] = {}
        for element in (*model.findall("link"), *model.findall("joint"), *model.findall("frame")):
            base = {"link": MODEL, "joint": text_of(element, "child"), "frame": element.get("attached_to") or MODEL}
            name = _place(placed, element, base[element.tag])
            attached[name] = name if element.tag == "link" else base[element.tag]
        return cls(placed, attached)

    @classmethod
    def around(cls, model: Element, world: Element | None) -> Frames:
        """Return the frames that a model may be placed in: its world, those that this has, and the model itself."""
        placed = {WORLD: (WORLD, pin.SE3.Identity())}
        for element in (model, *(world.findall("frame") if world is not None else ())):
            _place(placed, element, element.get("attached_to") or WORLD)
        return cls(placed, {}, WORLD)

    def placement(self, name: str, where: str) -> pin.SE3:
        place, chain = pin.SE3.Identity(), dict[str, None]()
        while name != self.root:
            if name in chain:
                raise ModelError(f"{where}: frames are placed in each other: {' -> '.join([*chain, name])}")
            chain[name] = None
            name, step = self._known(self.placed, name, where)
            place = step * place
        return place

    def link(self, name: str, where: str) -> str:
        """Return the link that a frame moves with."""
        chain = {name: None}
        while (base := self._known(self.attached, name, where)) != name:
            if base in chain or base == MODEL:
                raise ModelError(
                    f"{where}: the frame '{next(iter(chain))}' is attached to no link", expected="attached_to: a link"
                )
            chain[base], name = None, base
        return name

    def _known(self, frames: Mapping[str, ValueT], name: str, where: str) -> ValueT:
        if name not in frames:
            expected, hint = choices(name, [key for key in frames if key != MODEL])
            raise ModelError(f"{where}: there is no frame '{name}'", expected=expected, hint=hint)
        return frames[name]


def _place(placed: dict[str, tuple[str, pin.SE3]], element: Element, base: str) -> str:
    """Add the frame of an element to others; return its name."""
    name, tag = element.get("name", ""), element.tag
    if name == WORLD or (name.startswith("__") and name.endswith("__")):
        raise ModelError(f"{tag} '{name}': this name is reserved", expected="a name that is not 'world', nor __..__")
    if name in placed or (not name and tag != "model"):
        raise ModelError(f"two frames have the name '{name}'" if name else f"a {tag} has no name",
                         expected="a name of its own for each link, joint and frame")  # fmt: skip
    placed[name] = pose_of(element, base, f"{tag} '{name}'")
    return name


def pose_of(element: Element, base: str, where: str) -> tuple[str, pin.SE3]:
    """Return the frame that an element is placed in, and its placement there: as ``<pose>`` says, or at its base."""
    pose = element.find("pose")
    if pose is None:
        return base, pin.SE3.Identity()
    if pose.get("frame"):
        raise ModelError(f"{where}: its <pose> has the attribute frame='{pose.get('frame')}', which no version defines",
                         hint=f"relative_to=\"{pose.get('frame')}\" in version 1.7")  # fmt: skip
    quaternion = pose.get("rotation_format") == "quat_xyzw"
    values = numbers(pose.text or ("0 " * 6 + "1" * quaternion), 7 if quaternion else 6, f"{where}: pose")
    if quaternion:
        if not values[3:].any():
            raise ModelError(f"{where}: its pose has the quaternion 0")
        x, y, z, w = values[3:]
        turn = rotation(w, x, y, z)
    else:
        angles = np.deg2rad(values[3:]) if is_true(pose.get("degrees"), f"{where}: degrees of its pose") else values[3:]
        turn = pin.rpy.rpyToMatrix(angles)
    return pose.get("relative_to") or base, pin.SE3(turn, values[:3])


def is_true(text: str | None, where: str, *, default: bool = False) -> bool:
    """Return whether a text says yes; the default where there is none."""
    word = (text or "").strip()
    if not word:
        return default
    if word.lower() not in TRUTH:
        raise ModelError(f"{where}: '{word}'", expected=f"one of {', '.join(TRUTH)}")
    return TRUTH[word.lower()]


def number_in(element: Element | None, path: str, default: float, where: str) -> float:
    """Return the number in an element that is given by its path; the default where there is none."""
    text = text_of(element, path)
    return number(text, f"{where}: {path}") if text else default


def text_of(element: Element | None, path: str) -> str:
    """Return the text in an element, without spaces around it; empty where there is none."""
    return "" if element is None else (element.findtext(path) or "").strip()
