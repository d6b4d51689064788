"""Elements and attributes of SDF that are read, and those that are known and are not.

Source: the specification of SDFormat, versions 1.4 to 1.12 (sdformat.org/spec).
"""

from __future__ import annotations

from collections.abc import Mapping

from pinarm.input.xml_names import Content, ElementNames, names


def _each(tags: str, content: ElementNames | Content) -> dict[str, ElementNames | Content]:
    """Return elements with the same content; tags are separated by spaces."""
    return dict.fromkeys(tags.split(), content)


def _names(attributes: str, children: Mapping[str, ElementNames | Content], unread: str = "") -> ElementNames:
    """Return the names of an element; what is read of it stands once, but for ``SEVERAL``."""
    once = (tag for tag, content in children.items() if isinstance(content, ElementNames) and tag not in SEVERAL)
    return names(attributes, children, unread, " ".join(once))


SEVERAL = ("model", "link", "joint", "frame")
"""Elements that may stand in another one more than once."""

_TEXT = names()
_POSE = names("relative_to frame degrees rotation_format")
_INERTIAL = _names(
    "",
    {
        "mass": _TEXT, "pose": _POSE, "inertia": _names("", _each("ixx ixy ixz iyy iyz izz", _TEXT)),
        "fluid_added_mass": Content.UNREAD, "density": Content.IDLE, "auto_inertia_params": Content.IDLE,
    },
    unread="auto",
)  # fmt: skip
_LINK = _names(
    "name",
    {
        "pose": _POSE, "inertial": _INERTIAL, "gravity": _TEXT,
        **_each("visual collision self_collide must_be_base_link audio_source audio_sink", Content.IDLE),
        **_each("velocity_decay enable_wind kinematic sensor projector", Content.UNREAD),
        **_each("battery light particle_emitter plugin frame", Content.UNREAD),
    },
)  # fmt: skip
_LIMIT = _names("", {**_each("lower upper effort velocity", _TEXT),
                     **_each("stiffness dissipation", Content.IDLE)})  # fmt: skip
_AXIS = _names(
    "",
    {
        "xyz": names("expressed_in"), "use_parent_model_frame": _TEXT, "limit": _LIMIT,
        "initial_position": Content.UNREAD,
        "dynamics": _names("", _each("damping friction spring_reference spring_stiffness", _TEXT)),
        "mimic": _names("joint axis", _each("multiplier offset reference", _TEXT)),
    },
)  # fmt: skip
JOINT: ElementNames = _names(
    "name type",
    {
        "pose": _POSE, "parent": _TEXT, "child": _TEXT, "axis": _AXIS, "axis2": _AXIS,
        **_each("gearbox_ratio gearbox_reference_body thread_pitch screw_thread_pitch", _TEXT),
        **_each("physics sensor plugin frame", Content.UNREAD),
    },
)  # fmt: skip
"""The names that a ``<joint>`` may contain."""
_FRAME = _names("name attached_to", {"pose": _POSE})
_MODEL = _names(
    "name canonical_link placement_frame",
    {
        "pose": _POSE, "static": _TEXT, "link": _LINK, "joint": JOINT,
        "frame": _FRAME, "model": Content.UNREAD, "include": Content.UNREAD,
        **_each("self_collide allow_auto_disable", Content.IDLE),
        **_each("enable_wind plugin gripper", Content.UNREAD),
    },
)  # fmt: skip
_WORLD = _names(
    "name",
    {
        "model": _MODEL, "gravity": _TEXT,
        **_each("audio atmosphere gui physics scene light spherical_coordinates", Content.IDLE),
        **_each("state magnetic_field population road wind", Content.IDLE),
        "frame": _FRAME, **_each("include actor plugin joint", Content.UNREAD),
    },
)  # fmt: skip
SDF: ElementNames = _names("version", {"model": _MODEL, "world": _WORLD, **_each("light actor", Content.IDLE)})
"""The names that an ``<sdf>`` element may contain."""
