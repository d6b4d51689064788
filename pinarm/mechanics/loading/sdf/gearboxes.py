"""Joints of the type ``gearbox`` of SDF: they move no link, and couple two joints on one body.

With theta_1 the angle from the reference body to the parent about ``<axis>``, and theta_2 that from the reference body
to the child about ``<axis2>``, ``theta_2 = -gearbox_ratio theta_1``.

Source: SDFormat 1.12, specification of joint, gearbox_reference_body and gearbox_ratio.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.mechanics.loading.sdf.joints import axis_in, end_of
from pinarm.mechanics.loading.sdf.poses import Frames, number_in

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.gear import Gear

ALONG = 1e-6
"""Sine of the angle between an axis of the gearbox and that of a joint up to which they are one: printed digits."""


class Hinge(NamedTuple):
    """A revolute joint of the tree.

    Attributes:
        name: Its name.
        parent: The link that its coordinate is measured from.
        child: The link that turns.
        axis: Its axis in the axes of the model, shape (3,).
    """

    name: str
    parent: str
    child: str
    axis: Array


def gear_of(joint: Element, frames: Frames, version: tuple[int, int], hinges: Iterable[Hinge]) -> Gear:
    """Return the gear that a gearbox is.

    Args:
        joint: The ``<joint>``.
        frames: Frames of the model, the joint's own among them.
        version: Version of the format.
        hinges: The revolute joints of the tree.

    Raises:
        ModelError: No revolute joint of the tree joins one of its links to the reference body about its axis, or the
            ratio is 0.
    """
    from pinarm.mechanics.couplings.gear import Gear

    where = f"joint '{joint.get('name')}'"
    place = frames.placement(str(joint.get("name")), where)
    base = end_of(joint, "gearbox_reference_body", frames, where)
    ratio = number_in(joint, "gearbox_ratio", 1.0, where)
    if ratio == 0.0:
        raise ModelError(f"{where}: its gearbox_ratio is 0", expected="a number other than 0")
    first = joint.find("axis")
    second = joint.find("axis2") if joint.find("axis2") is not None else first
    known = [*hinges]
    (one, own), (two, other) = (
        _hinge(known, base, end_of(joint, end, frames, where),
               place.rotation @ axis_in(axis, place, frames, version, where), where)
        for end, axis in (("parent", first), ("child", second))
    )  # fmt: skip
    return Gear(joints=(one, two), ratio=-own * other * ratio)


def _hinge(hinges: Iterable[Hinge], base: str, link: str, axis: Array, where: str) -> tuple[str, float]:
    """Return the joint between a body and a link about an axis, and the sign of its coordinate about it."""
    for hinge in hinges:
        ends = hinge.parent, hinge.child
        if {*ends} == {base, link} and np.linalg.norm(np.cross(hinge.axis, axis)) < ALONG:
            return hinge.name, float(np.sign(hinge.axis @ axis)) * (1.0 if ends == (base, link) else -1.0)
    raise ModelError(f"{where}: no revolute joint of the tree turns '{link}' against '{base}' about the gearbox's axis",
                     expected="one between its gearbox_reference_body and each of its links",
                     hint="without it, a coupling of the mechanism file: couplings: {kind: gear}")  # fmt: skip
