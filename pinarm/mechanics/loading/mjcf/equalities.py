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

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.mechanics.loading.mjcf.settings import Attributes, Settings, known, numbers_in
from pinarm.mechanics.loading.model_tree import Mimic, TreeJoint, fixed_frame, from_z, tied_frames
from pinarm.mechanics.loading.values import rotation

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

PRINTED = 1e-4
"""Difference of two directions, or two distances relative to their size, that is due to six printed digits."""

TIES = ("connect", "weld")
"""Equalities that close loops."""


@dataclass
class Equalities:
    """Couplings, held joints and loops of equalities, while they are read.

    Attributes:
        places: Body -> its placement in the world in the pose of the file.
        sites: Named points, as joints that fix them to bodies, by name.
        held: Joint -> coordinate at which it is held [rad or m].
        frames: Frames that are tied, as joints that fix them to their bodies.
        loops: Joints that close loops, by name.
    """

    joints: Mapping[str, TreeJoint]
    places: Mapping[str, pin.SE3]
    sites: Mapping[str, TreeJoint]
    mimics: list[Mimic] = field(default_factory=list)
    held: dict[str, float] = field(default_factory=dict)
    frames: list[TreeJoint] = field(default_factory=list)
    loops: dict[str, Loop] = field(default_factory=dict)

    def read(self, settings: Settings, model: Element) -> Equalities:
        """Read the active equalities of a ``<mujoco>`` element."""
        for number, (element, attributes) in enumerate(_active(settings, model), 1):
            label = next(
                (attributes[key] for key in ("name", "joint1", "body1", "site1") if attributes.get(key)), "without name"
            )
            where = f"equality '{label}'"
            if element.tag == "joint":
                self._couple(attributes, where)
            elif element.tag in TIES:
                self._tie(element.tag, attributes.get("name") or f"{element.tag}_{number}", attributes, where)
            else:
                raise ModelError(
                    f"{where}: a <{element.tag}> is not read",
                    expected=f"joint, {', '.join(TIES)}",
                    hint="remove it, and use 'loops:' or 'couplings:' of the mechanism file",
                )
        return self

    def _couple(self, attributes: Attributes, where: str) -> None:
        """Read the equality of one or two joints."""
        follower, leader = attributes.get("joint1", ""), attributes.get("joint2")
        text = attributes.get("polycoef", "0 1 0 0 0").split()
        curve = numbers_in({"polycoef": " ".join([*text, *["0"] * (5 - len(text))])}, "polycoef", where, 5)
        drawn = {name: joint.drawn for name, joint in self.joints.items()}
        if follower in self.held or any(mimic.joint == follower for mimic in self.mimics):
            raise ModelError(
                f"{where}: '{follower}' is held or coupled by another equality already",
                expected="one equality for each 'joint1'",
            )
        if leader is None:
            if self.joints[known(follower, self.joints, "joint", where)].kind not in ("revolute", "prismatic"):
                raise ModelError(
                    f"{where}: '{follower}' is held, and is no hinge or slide", expected="a joint with one coordinate"
                )
            self.held[follower] = float(drawn[follower] + curve[0])
        elif curve[2:].any():
            raise ModelError(
                f"{where}: it couples by a curve, which is not read", expected="polycoef with at most two numbers"
            )
        else:
            ends = [drawn.get(joint, 0.0) for joint in (follower, leader)]
            offset = float(curve[0] + ends[0] - curve[1] * ends[1])
            self.mimics.append(Mimic(follower, leader, float(curve[1]), offset))

    def _tie(self, tag: str, name: str, attributes: Attributes, where: str) -> None:
        """Read an equality that ties two bodies, or two sites."""
        from pinarm.mechanics.loops.lower_pairs import Fixed, Spherical  # not paid for by models without loops

        if name in self.loops:
            raise ModelError(f"two equalities have the name '{name}'", expected="a name of its own for each")
        if "site1" in attributes:
            first, second = (known(attributes.get(key, ""), self.sites, "site", where) for key in ("site1", "site2"))
        else:
            frames, (first, second) = tied_frames(name, self._ends(tag, attributes, where))
            self.frames += frames
        self.loops[name] = (Spherical if tag == "connect" else Fixed)(between=(first, second))

    def _ends(self, tag: str, attributes: Attributes, where: str) -> list[tuple[str, pin.SE3]]:
        """Return two bodies that are tied, each with the place of the tie in it."""
        first, second = (
            known(attributes.get(key, default), self.places, "body", where)
            for key, default in (("body1", ""), ("body2", "world"))
        )
        drawn = self.places[first].actInv(self.places[second])
        anchor = pin.SE3(np.eye(3), numbers_in(attributes, "anchor", where, 3, (0.0, 0.0, 0.0)))
        if tag == "connect":  # the anchor is a point of the first body
            return [(first, anchor), (second, drawn.actInv(anchor))]
        pose = numbers_in(attributes, "relpose", where, 7, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        relative = pin.SE3(rotation(*pose[3:]), pose[:3]) if pose[3:].any() else drawn * anchor
        return [(first, relative), (second, anchor)]

    def join_hinges(self) -> Iterator[str]:
        """Make one revolute joint of two spherical ones that tie the same two bodies in two points; yield notes.

        Exporters write hinges so, such as onshape-to-robot. The six rows have rank five, as the distance of the points
        is given twice, and their forces along the hinge would not be determined.
        """
        if len(self.loops) < 2:
            return
        from pinarm.mechanics.loops.lower_pairs import Revolute, Spherical

        frames = {**self.sites, **{frame.child: frame for frame in self.frames}}
        balls = {
            name: [frames[end] for end in loop.between]
            for name, loop in self.loops.items()
            if isinstance(loop, Spherical)
        }
        for name, other in combinations(balls, 2):
            if not {name, other} <= self.loops.keys() or (axes := _hinge_axes(*balls[name], *balls[other])) is None:
                continue
            ends = balls[name]
            if np.abs(axes[0] - axes[1]).max() < PRINTED:
                between, (x, y, z) = (ends[0].child, ends[1].child), axes[0].tolist()
            else:
                between, (x, y, z) = (f"{name}_hinge_1", f"{name}_hinge_2"), (0.0, 0.0, 1.0)
                turned = [
                    frame.placement * pin.SE3(from_z(axis), np.zeros(3)) for frame, axis in zip(ends, axes, strict=True)
                ]
                self.frames += [
                    fixed_frame(end, frame.parent, place, name)
                    for end, frame, place in zip(between, ends, turned, strict=True)
                ]
            del self.loops[other]
            self.loops[name] = Revolute(between=between, axis=(x, y, z))
            yield f"{name} and {other} tie two points of the same bodies: together they are a revolute joint {name}"


def _active(settings: Settings, model: Element) -> Iterable[tuple[Element, Attributes]]:
    if not settings.off & {"equality", "constraint"}:
        for element in model.findall("equality/*"):
            attributes = settings.attributes(element, "", "equality")
            if attributes.get("active", "true") != "false":
                yield element, attributes


def _hinge_axes(a: TreeJoint, b: TreeJoint, c: TreeJoint, d: TreeJoint) -> tuple[Array, Array] | None:
    """Return the direction from a to c in the axes of a, and from b to d in those of b; ``None`` for no hinge."""
    if (a.parent, b.parent) == (d.parent, c.parent):
        c, d = d, c
    if (a.parent, b.parent) != (c.parent, d.parent):
        return None
    ways = [start.placement.actInv(end.placement).translation for start, end in ((a, c), (b, d))]
    length, other = (float(np.linalg.norm(way)) for way in ways)
    if min(length, other) == 0.0 or abs(length - other) > PRINTED * length:
        return None
    return _rounded(ways[0] / length), _rounded(ways[1] / other)


def _rounded(axis: Array) -> Array:
    """Return a coordinate axis for a unit vector that is one but for printed digits."""
    near = np.round(axis)
    return near if np.abs(axis - near).max() < PRINTED else axis
