"""The ``<equality>`` section of MJCF: joints that follow others or are held, points and frames that are tied together.

==================================  ====================================================================================
``joint`` with two joints           a coupling, ``q1 - ref1 = c0 + c1 (q2 - ref2)``; curves are refused
``joint`` with one                  the joint is held at ``ref1 + c0``
``connect`` of bodies or sites      a spherical loop joint: a point of the first on one of the second
two ``connect`` of two bodies       a revolute loop joint through both points: one row of the six would say nothing
``weld`` of bodies or sites         a fixed loop joint; of bodies that ``relpose`` places, or the pose in the file
==================================  ====================================================================================

MuJoCo holds equalities by springs (``solref``, ``solimp``); here they are exact. Source: MuJoCo, XML reference,
section equality, and ``mj_instantiateEquality`` of its engine.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError, choices
from pinarm.mechanics.loading.mjcf_settings import Attributes, Settings, numbers
from pinarm.mechanics.loading.model_tree import Mimic, TreeJoint, from_z
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

PRINTED = 1e-4
"""Difference of two directions, or two distances relative to their size, that is due to six printed digits."""

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
        if follower in said.held or any(mimic.joint == follower for mimic in said.mimics):
            raise ModelError(f"{where}: '{follower}' is held or coupled by another equality already",
                             expected="one equality for each 'joint1'")  # fmt: skip
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
            said.frames.append(TreeJoint(f"{frame}_fixed", "fixed", body, frame, place, np.array([0.0, 0.0, 1.0]),
                                         made_for=name))  # fmt: skip
        return names


def with_hinges(said: Equalities, sites: Iterable[TreeJoint]) -> list[str]:
    """Make one revolute joint of two spherical ones that tie the same two bodies in two points; return notes on them.

    Exporters write hinges so, such as onshape-to-robot. The six rows have rank five, as the distance of the points is
    given twice, and their forces along the hinge would not be determined.
    """
    from pinarm.mechanics.loops.lower_pairs import Revolute, Spherical

    frames = {frame.child: frame for frame in (*sites, *said.frames)}
    balls = {name: loop.between for name, loop in said.loops.items() if isinstance(loop, Spherical)}
    notes = []
    for name, other in combinations(balls, 2):
        if not {name, other} <= said.loops.keys():
            continue
        (a, b), (c, d) = ([frames[end] for end in balls[each]] for each in (name, other))
        if (a.parent, b.parent) == (d.parent, c.parent):
            c, d = d, c
        axes = _hinge_axes(a, b, c, d) if (a.parent, b.parent) == (c.parent, d.parent) else None
        if axes is None:
            continue
        if np.abs(axes[0] - axes[1]).max() < PRINTED:
            between = a.child, b.child
            x, y, z = axes[0].tolist()
        else:
            between, (x, y, z) = (f"{name}_hinge_1", f"{name}_hinge_2"), (0.0, 0.0, 1.0)
            said.frames += [replace(_along(end, frame, axis), made_for=name)
                            for end, frame, axis in zip(between, (a, b), axes, strict=True)]  # fmt: skip
        del said.loops[other]
        said.loops[name] = Revolute(between=between, axis=(x, y, z))
        notes.append(f"{name} and {other} tie two points of the same bodies: together they are a revolute joint {name}")
    return notes


def _hinge_axes(a: TreeJoint, b: TreeJoint, c: TreeJoint, d: TreeJoint) -> tuple[Array, Array] | None:
    """Return the direction from a to c in the axes of a, and from b to d in those of b; ``None`` for no hinge.

    Args:
        a: A point of the first body.
        b: The point of the second body that is tied to a.
        c: Another point of the first body.
        d: The point of the second body that is tied to c.
    """
    one, two = a.placement.actInv(c.placement).translation, b.placement.actInv(d.placement).translation
    length, other = float(np.linalg.norm(one)), float(np.linalg.norm(two))
    if min(length, other) == 0.0 or abs(length - other) > PRINTED * length:
        return None
    return _rounded(one / length), _rounded(two / other)


def _rounded(axis: Array) -> Array:
    """Return a coordinate axis for a unit vector that is one but for printed digits."""
    near = np.round(axis)
    return near if np.abs(axis - near).max() < PRINTED else axis


def _along(name: str, frame: TreeJoint, axis: Array) -> TreeJoint:
    """Return a frame at another one with z along an axis in the axes of that."""
    place = frame.placement * pin.SE3(from_z(axis), np.zeros(3))
    return TreeJoint(f"{name}_fixed", "fixed", frame.parent, name, place, np.array([0.0, 0.0, 1.0]))


def _relative(given: Attributes, where: str, otherwise: pin.SE3) -> pin.SE3:
    """Return the placement that ``relpose`` gives the second body; that of the file where its quaternion is 0."""
    pose: Array = np.array(numbers(given, "relpose", where, 7, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    if not pose[3:].any():
        return otherwise
    w, x, y, z = unit(pose[3:])
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), pose[:3])


def _label(given: Attributes) -> str:
    keys = ("name", "joint1", "body1", "site1")
    return next((given[key] for key in keys if given.get(key)), "without name")
