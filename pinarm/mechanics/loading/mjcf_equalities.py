"""The ``<equality>`` section of MJCF: joints that follow others or are held, points and frames that are tied together.

==================================  ====================================================================================
``joint`` with two joints           a coupling, ``q1 - ref1 = c0 + c1 (q2 - ref2)``; curves are refused
``joint`` with one                  the joint is held at ``ref1 + c0``
``connect`` of bodies or sites      a spherical loop joint: a point of the first on one of the second
``weld`` of bodies or sites         a fixed loop joint; of bodies that ``relpose`` places, or the pose in the file
==================================  ====================================================================================

MuJoCo holds equalities by springs (``solref``, ``solimp``); here they are exact. Source: MuJoCo, XML reference,
section equality, and ``mj_instantiateEquality`` of its engine.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError, choices
from pinarm.mechanics.loading.mjcf_settings import Attributes, Settings, numbers
from pinarm.mechanics.loading.model_tree import Mimic, TreeJoint

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

TIES = ("connect", "weld")
"""Equalities that close loops."""


@dataclass
class Equalities:
    """What equalities say.

    Attributes:
        mimics: Joints that follow others.
        held: Joint -> coordinate at which it is held [rad or m].
        frames: Frames that are tied, as joints that fix them to their bodies.
        loops: Joints that close loops, by name.
    """

    mimics: list[Mimic] = field(default_factory=list)
    held: dict[str, float] = field(default_factory=dict)
    frames: list[TreeJoint] = field(default_factory=list)
    loops: dict[str, Loop] = field(default_factory=dict)


@dataclass(frozen=True)
class EqualityReader:
    """What equalities refer to.

    Attributes:
        settings: Conventions of the model.
        joints: The joints by name.
        places: Body -> its placement in the world in the pose of the file.
        sites: Names of the sites.
    """

    settings: Settings
    joints: Mapping[str, TreeJoint]
    places: Mapping[str, pin.SE3]
    sites: frozenset[str]

    def read(self, model: Element) -> Equalities:
        """Return what the active equalities of a ``<mujoco>`` element say.

        Raises:
            ModelError: One names something that does not exist, couples by a curve, or ties what is not a rigid body.
        """
        said = Equalities()
        for number, (element, given) in enumerate(self._active(model), 1):
            name = given.get("name") or f"{element.tag}_{number}"
            where = f"equality '{_label(given)}'"
            if element.tag == "joint":
                self._couple(given, where, said)
            elif element.tag in TIES:
                self._tie(element.tag, name, given, where, said)
            else:
                raise ModelError(f"{where}: a <{element.tag}> is not read", expected=f"joint, {', '.join(TIES)}",
                                 hint="remove it, and use 'loops:' or 'couplings:' of the mechanism file")  # fmt: skip
        return said

    def _active(self, model: Element) -> Iterator[tuple[Element, Attributes]]:
        if self.settings.off & {"equality", "constraint"}:
            return
        for element in (element for section in model.findall("equality") for element in section):
            given = self.settings.attributes(element, "", "equality")
            if given.get("active", "true") != "false":
                yield element, given

    def _couple(self, given: Attributes, where: str, said: Equalities) -> None:
        """Read the equality of one or two joints."""
        follower, leader = given.get("joint1", ""), given.get("joint2")
        text = given.get("polycoef", "0 1 0 0 0").split()
        curve = numbers({"polycoef": " ".join([*text, *["0"] * (5 - len(text))])}, "polycoef", where, 5)
        drawn = {name: joint.drawn for name, joint in self.joints.items()}
        if leader is None:
            if follower not in self.joints:
                expected, hint = choices(follower, self.joints)
                raise ModelError(f"{where}: there is no joint '{follower}'", expected=expected, hint=hint)
            if self.joints[follower].kind not in ("revolute", "prismatic"):
                raise ModelError(f"{where}: '{follower}' is held, and is no hinge or slide",
                                 expected="a joint with one coordinate")  # fmt: skip
            said.held[follower] = float(drawn[follower] + curve[0])
        elif curve[2:].any():
            raise ModelError(f"{where}: it couples by a curve, which is not read",
                             expected="polycoef with at most two numbers")  # fmt: skip
        else:
            ends = [drawn.get(joint, 0.0) for joint in (follower, leader)]
            offset = float(curve[0] + ends[0] - curve[1] * ends[1])
            said.mimics.append(Mimic(follower, leader, float(curve[1]), offset))

    def _tie(self, tag: str, name: str, given: Attributes, where: str, said: Equalities) -> None:
        """Read an equality that ties two bodies, or two sites."""
        from pinarm.mechanics.loops.lower_pairs import Fixed, Spherical  # not paid for by models without loops

        if name in said.loops:
            raise ModelError(f"two equalities have the name '{name}'", expected="a name of its own for each")
        between = self._sites(given, where) if "site1" in given else self._frames(tag, name, given, where, said)
        said.loops[name] = (Spherical if tag == "connect" else Fixed)(between=between)

    def _sites(self, given: Attributes, where: str) -> tuple[str, str]:
        first, second = (given.get(key, "") for key in ("site1", "site2"))
        for site in (first, second):
            if site not in self.sites:
                expected, hint = choices(site, sorted(self.sites))
                raise ModelError(f"{where}: there is no site '{site}'", expected=expected, hint=hint)
        return first, second

    def _frames(self, tag: str, name: str, given: Attributes, where: str, said: Equalities) -> tuple[str, str]:
        """Add the frames that two bodies have at a tie; return their names."""
        first, second = given.get("body1", ""), given.get("body2", "world")
        for body in (first, second):
            if body not in self.places:
                expected, hint = choices(body, self.places)
                raise ModelError(f"{where}: there is no body '{body}'", expected=expected, hint=hint)
        drawn = self.places[first].actInv(self.places[second])
        anchor = pin.SE3(np.eye(3), np.array(numbers(given, "anchor", where, 3, (0.0, 0.0, 0.0))))
        if tag == "connect":  # the anchor is a point of the first body
            places = anchor, drawn.actInv(anchor)
        else:  # it is one of the second body
            places = _relative(given, where, drawn * anchor), anchor
        names = f"{name}_1", f"{name}_2"
        for frame, body, place in zip(names, (first, second), places, strict=True):
            if frame in self.places or frame in self.sites:
                raise ModelError(f"{where}: '{frame}', which would be the name of its frame, is a body or site",
                                 expected="another name for the equality")  # fmt: skip
            said.frames.append(TreeJoint(f"{frame}_fixed", "fixed", body, frame, place, np.array([0.0, 0.0, 1.0])))
        return names


def with_held(joints: Mapping[str, TreeJoint], held: Mapping[str, float]) -> dict[str, TreeJoint]:
    """Return the joints, those that are held fixed at their coordinates."""
    return {name: _held(joint, held[name]) if name in held else joint for name, joint in joints.items()}


def _held(joint: TreeJoint, value: float) -> TreeJoint:
    turned = pin.SE3(pin.exp3(joint.axis * value), np.zeros(3))
    moved = turned if joint.kind == "revolute" else pin.SE3(np.eye(3), joint.axis * value)
    place = joint.placement * moved * joint.offset
    return TreeJoint(joint.name, "fixed", joint.parent, joint.child, place, joint.axis)


def _relative(given: Attributes, where: str, otherwise: pin.SE3) -> pin.SE3:
    """Return the placement that ``relpose`` gives the second body; that of the file where its quaternion is 0."""
    pose: Array = np.array(numbers(given, "relpose", where, 7, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    if not pose[3:].any():
        return otherwise
    w, x, y, z = pose[3:] / np.linalg.norm(pose[3:])
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), pose[:3])


def _label(given: Attributes) -> str:
    keys = ("name", "joint1", "body1", "site1")
    return next((given[key] for key in keys if given.get(key)), "without name")
