"""Elements and attributes of URDF, and the extensions of others that stand in files of robots.

Source: the XML specifications of the ROS package ``urdf``. What the robots of example-robot-data have beyond these, and
what Gazebo and ros2_control add, is known and not read. ``armature``, and the joint type ``spherical``, are extensions
that are read: a ``pin.Model`` has both. So are those that close loops: see ``urdf_loops``.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

from pinarm.errors import choices
from pinarm.input.xml_names import Content, ElementNames, names

_ORIGIN = names("xyz rpy")
_GEOMETRY = names(
    "name",
    {
        "box": names("size"), "cylinder": names("radius length"), "sphere": names("radius"),
        "capsule": names("radius length"), "mesh": names("filename scale"),
    },
)  # fmt: skip
_MATERIAL = names("name", {"color": names("rgba"), "texture": Content.IDLE})
_INERTIAL = names("", {"origin": _ORIGIN, "mass": names("value"), "inertia": names("ixx ixy ixz iyy iyz izz")},
                  once="origin mass inertia")  # fmt: skip
_LINK = names(
    "name",
    {
        "inertial": _INERTIAL,
        "visual": names("name", {"origin": _ORIGIN, "geometry": _GEOMETRY, "material": _MATERIAL}),
        "collision": Content.IDLE,
        **dict.fromkeys(
            ("collision_checking", "contact", "gravity", "kinematic", "origin", "self_filter", "sensor", "surface"),
            Content.UNREAD,
        ),
    },
    unread="type", once="inertial",
)  # fmt: skip
_JOINT = names(
    "name type",
    {
        "origin": _ORIGIN, "parent": names("link"), "child": names("link"), "axis": names("xyz"),
        "limit": names("lower upper effort velocity",
                       unread="acceleration deceleration jerk command_effort current gear_velocity"),
        "dynamics": names("damping friction armature", unread="D K mu_coulomb mu_viscous"),
        "mimic": names("joint multiplier offset"), "calibration": Content.IDLE, "safety_controller": Content.IDLE,
        "joint_properties": Content.UNREAD,
    },
    unread="dont_collapse independent", once="origin parent child axis limit dynamics mimic",
)  # fmt: skip
_END = names("link name", {"origin": _ORIGIN}, once="origin")
_ENDS: dict[str, ElementNames | Content] = {"predecessor": _END, "successor": _END, "sucessor": _END}
_LINKED = names("link xyz rpy")
_CLOSING: dict[str, ElementNames | Content] = {
    "loop": names("name type", {**_ENDS, "axis": names("xyz")}, once="axis"),
    "coupling": names("name", {**_ENDS, "ratio": names("value")}, once="ratio"),
    "loop_joint": names("name type", {"link1": _LINKED, "link2": _LINKED, "axis": names("xyz")}, once="axis"),
}
_IN_ROBOT: dict[str, ElementNames | Content] = {
    "link": _LINK, "joint": _JOINT, "material": _MATERIAL, **_CLOSING,
    **dict.fromkeys(("transmission", "gazebo", "ros2_control", "sensor", "mujoco"), Content.UNREAD),
}  # fmt: skip


def urdf_names(robot: Element) -> ElementNames:
    """Return the names that a ``<robot>`` may contain: those of URDF, and its own extensions.

    An element directly in it whose name is near none of URDF is somebody's extension, and is not read.
    """
    others = {element.tag for element in robot if isinstance(element.tag, str)} - _IN_ROBOT.keys()
    extensions = {tag: Content.UNREAD for tag in others if not choices(tag, _IN_ROBOT)[1]}
    return names("name version", {**_IN_ROBOT, **extensions, **_joints_of_gazebo(robot)})


def closes_loops(robot: Element) -> bool:
    """Tell whether a ``<robot>`` has an extension that closes loops or couples joints."""
    return any(robot.find(tag) is not None for tag in _CLOSING) or bool(gazebo_joints(robot))


def gazebo_joints(robot: Element) -> list[Element]:
    """Return the joints of SDF that ``<gazebo>`` elements add to the model as a whole."""
    return [joint for gazebo in robot.findall("gazebo") if not gazebo.get("reference")
            for joint in gazebo.findall("joint")]  # fmt: skip


def _joints_of_gazebo(robot: Element) -> dict[str, ElementNames | Content]:
    """Return the names in ``<gazebo>`` where one of them adds joints: these are read, the other elements are not."""
    if not gazebo_joints(robot):
        return {}
    from pinarm.mechanics.loading.sdf.names import JOINT

    others = {element.tag for gazebo in robot.findall("gazebo") for element in gazebo if isinstance(element.tag, str)}
    return {"gazebo": names("reference", {**dict.fromkeys(others, Content.UNREAD), "joint": JOINT})}
