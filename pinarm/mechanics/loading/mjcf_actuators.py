"""What MJCF actuators add to their joints while they give no effort: armature and damping behind their gear."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from pinarm.errors import ModelError, choices
from pinarm.mechanics.loading.mjcf_joints import coefficient
from pinarm.mechanics.loading.mjcf_settings import ACTUATOR, Settings, number
from pinarm.mechanics.loading.model_tree import TreeJoint
from pinarm.records import replace


def with_actuators(
    settings: Settings, model: Element, joints: Mapping[str, TreeJoint], notes: dict[str, list[str]]
) -> dict[str, TreeJoint]:
    """Return the joints with the armature ``N^2 J`` and the damping ``N^2 d`` of their actuators, with the gear N.

    Args:
        settings: Conventions of the model.
        model: The ``<mujoco>`` element.
        joints: The joints by name.
        notes: What is not modelled -> names; completed here.

    Raises:
        ModelError: An actuator is at a joint that does not exist, or has a negative armature or damping.
    """
    completed = dict(joints)
    for element in (element for section in model.findall(ACTUATOR) for element in section):
        given = settings.attributes(element, "", ACTUATOR)
        name = given.get("joint") or given.get("jointinparent")
        where = f"actuator '{given.get('name') or name or element.tag}'"
        armature, damping = (coefficient(given, key, settings, where) for key in ("armature", "damping"))
        if name is None:
            if armature or damping:
                notes.setdefault("armature and damping beyond joints are not modelled", []).append(where)
            continue
        if name not in joints:
            expected, hint = choices(name, joints)
            raise ModelError(f"{where}: there is no joint '{name}'", expected=expected, hint=hint)
        squared = number({"gear": (given.get("gear", "").split() or ["1"])[0]}, "gear", where) ** 2
        joint = completed[name]
        completed[name] = replace(joint, armature=joint.armature + squared * armature,
                                  damping=joint.damping + squared * damping)  # fmt: skip
    return completed
