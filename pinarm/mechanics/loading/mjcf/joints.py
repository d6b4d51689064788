"""The joints of MJCF bodies with their springs, dampers and limits, and the equalities that tie joints and bodies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.mechanics.loading.mjcf.settings import (
    ACTUATOR,
    Attributes,
    Settings,
    known,
    number_in,
    numbers_in,
)
from pinarm.mechanics.loading.model_tree import Bounds, Kind, Mimic, TreeJoint, fixed_frame, from_z, tied_frames
from pinarm.mechanics.loading.values import direction, rotation, word
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

KINDS: dict[str, Kind] = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}

COEFFICIENTS: dict[str, frozenset[str]] = {
    "stiffness": frozenset({"passive", "spring"}),
    "damping": frozenset({"passive", "damper"}),
    "frictionloss": frozenset({"frictionloss", "constraint"}),
    "armature": frozenset(),
}
"""Coefficients of joints, and the flags of the model that switch them off."""

POLYNOMIALS = ("stiffness", "damping")
"""Coefficients that may be followed by those of the second and the third power."""

UNSAID = ("auto", "true", "false")

Notes = dict[str, list[str]]
"""Feature that is not modelled -> names of the elements that have it."""


class BodyElement(NamedTuple):
    """An element of a body: its tag, its attributes with those of its class, the placement of its ``<frame>``."""

    tag: str
    attributes: Attributes
    frame: pin.SE3


def elements_of(settings: Settings, body: Element, childclass: str, *tags: str) -> Iterator[BodyElement]:
    """Yield the elements of some kinds that belong to a body itself, those in frames with the frame's placement.

    They come in the order of the file, in which the joints of a body follow each other.
    """
    waiting = [(child, pin.SE3.Identity(), childclass) for child in reversed(body)]
    while waiting:
        element, place, inherited = waiting.pop()
        if element.tag in tags:
            plain = element.tag in ("freejoint", "inertial")
            yield BodyElement(element.tag, element.attrib if plain else settings.attributes(element, inherited), place)
        elif element.tag == "frame":
            inner = place * settings.placement(element.attrib, f"a frame of body '{body.get('name', '')}'")
            within = element.get("childclass", inherited)
            waiting += [(child, inner, within) for child in reversed(element)]


def joint_chain(
    settings: Settings, joints: Sequence[BodyElement], parent: str, body: str, place: pin.SE3, notes: Notes
) -> Iterator[TreeJoint]:
    """Yield the joints of a body as a chain: each moves in the frame of the one before it.

    Args:
        joints: The ``<joint>`` elements of the body.
    """
    free = any(joint.tag == "freejoint" or joint.attributes.get("type") == "free" for joint in joints)
    if free and (len(joints) > 1 or parent != "world"):
        raise ModelError(f"body '{body}': a free joint stands alone, in a body of the world")
    for k, part in enumerate(joints):
        name = part.attributes.get("name") or (
            f"{body}_free" if free else f"{body}_joint{k + 1 if len(joints) > 1 else ''}"
        )
        child = body if k == len(joints) - 1 else f"{body}/{name}"
        kind = (
            "free" if part.tag == "freejoint" else word(part.attributes.get("type"), (*KINDS,), f"joint '{name}': type")
        )
        joint = _joint(settings, part, name, KINDS[kind], notes)
        made_for = name if child != body else ""
        yield replace(joint, parent=parent, child=child, placement=place * joint.placement, made_for=made_for)
        parent, place = child, pin.SE3.Identity()


def with_actuators(
    settings: Settings, model: Element, joints: Mapping[str, TreeJoint], notes: Notes
) -> dict[str, TreeJoint]:
    """Return the joints with the armature ``N^2 J`` and the damping ``N^2 d`` of their actuators, with the gear N."""
    completed = dict(joints)
    for element in model.findall(f"{ACTUATOR}/*"):
        attributes = settings.attributes(element, "", ACTUATOR)
        name = attributes.get("joint") or attributes.get("jointinparent")
        where = f"actuator '{attributes.get('name') or name or element.tag}'"
        armature, damping = (_coefficient(attributes, key, settings, where) for key in ("armature", "damping"))
        if name is None:
            if armature or damping:
                notes.setdefault("armature and damping beyond joints are not modelled", []).append(where)
            continue
        joint = completed[known(name, joints, "joint", where)]
        squared = number_in({"gear": (attributes.get("gear", "").split() or ["1"])[0]}, "gear", where) ** 2
        completed[name] = replace(
            joint, armature=joint.armature + squared * armature, damping=joint.damping + squared * damping
        )
    return completed


def _coefficient(attributes: Attributes, key: str, settings: Settings, where: str) -> float:
    """Return one of the ``COEFFICIENTS``; 0 where it is not given, or the model disables it."""
    count = max(len(attributes.get(key, "").split()), 1) if key in POLYNOMIALS else 1
    value, *higher = numbers_in(attributes, key, where, count, (0.0,))
    if any(higher):
        raise ModelError(
            f"{where}: {key}='{attributes[key][:60]}' is a polynomial, which is not read",
            expected="one number",
            hint=f"no {key} here, and 'forces:' in the mechanism file",
        )
    if value < 0.0:
        raise ModelError(f"{where}: its {key} is negative")
    return 0.0 if COEFFICIENTS[key] & settings.off else float(value)


def _joint(settings: Settings, part: BodyElement, name: str, kind: Kind, notes: Notes) -> TreeJoint:
    where, attributes = f"joint '{name}'", part.attributes
    stiffness, damping, friction, armature = (_coefficient(attributes, key, settings, where) for key in COEFFICIENTS)
    joint = TreeJoint(name, kind, "", "", pin.SE3.Identity(), stiffness=stiffness, damping=damping, friction=friction,
                      armature=armature)  # fmt: skip
    if "springdamper" in attributes and numbers_in(attributes, "springdamper", where, 2).any():
        raise ModelError(
            f"{where}: springdamper='{attributes['springdamper'][:60]}' is not read",
            expected="stiffness and damping of the joint",
            hint="with its inertia m: stiffness m / (T D)^2 and damping 2 m / T of the time constant T and the ratio D",
        )
    if kind == "floating":
        return joint
    anchor = pin.SE3(np.eye(3), part.frame.act(numbers_in(attributes, "pos", where, 3, (0.0, 0.0, 0.0))))
    joint = replace(joint, placement=anchor, offset=anchor.inverse())
    if kind == "ball":
        if attributes.get("range") and attributes.get("limited") != "false":
            notes.setdefault("the range of ball joints is not watched", []).append(name)
        return joint
    axis = direction(numbers_in(attributes, "axis", where, 3, (0.0, 0.0, 1.0)), f"{where}: its axis")
    measured = _measured(settings, replace(joint, axis=part.frame.rotation @ axis), attributes, where)
    if measured.drawn:
        notes.setdefault("drawn at their ref, but begin at 0 where nothing is said", []).append(name)
    return measured


def _measured(settings: Settings, joint: TreeJoint, attributes: Attributes, where: str) -> TreeJoint:
    """Return a joint of one coordinate, completed by its reference, spring rest position and limits."""
    turns = joint.kind == "revolute"
    measure = settings.angle if turns else 1.0
    drawn, rest = (measure * number_in(attributes, key, where, 0.0) for key in ("ref", "springref"))
    lower, upper = measure * _range(attributes, "range", "limited", settings, where)
    effort = np.abs(_range(attributes, "actuatorfrcrange", "actuatorfrclimited", settings, where)).max()
    back = pin.SE3(pin.exp3(-drawn * joint.axis), np.zeros(3)) if turns else pin.SE3(np.eye(3), -drawn * joint.axis)
    bounds = Bounds(float(lower), float(upper), effort=float(effort))
    return replace(joint, offset=back * joint.offset, bounds=bounds, rest=rest, drawn=drawn)


def _range(attributes: Attributes, key: str, switch: str, settings: Settings, where: str) -> Array:
    """Return a range if it is a limit, otherwise an infinite one, shape (2,)."""
    limited = word(attributes.get(switch), UNSAID, f"{where}: {switch}")
    if limited == "true" and key not in attributes:
        raise ModelError(f"{where}: {switch}='true', and it has no {key}", expected=f"a {key}, or {switch}='false'")
    if key not in attributes or limited == "false" or (limited == "auto" and not settings.limits_by_range):
        return np.array([-np.inf, np.inf])
    lower, upper = numbers_in(attributes, key, where, 2)
    if lower == upper == 0.0 and limited == "auto":  # the format's own default
        return np.array([-np.inf, np.inf])
    if lower >= upper:
        raise ModelError(f"{where}: {key}='{attributes[key]}'", expected="the lower number first")
    return np.array([lower, upper])


PRINTED = 1e-4
"""Difference of two directions, or two distances relative to their size, that is due to six printed digits."""

TIES = ("connect", "weld")
"""Equalities that close loops."""


@dataclass
class Equalities:
    """Couplings, held joints and loops of equalities, while they are read.

    ==================================  ================================================================================
    ``joint`` with two joints           a coupling, ``q1 - ref1 = c0 + c1 (q2 - ref2)``; curves are refused
    ``joint`` with one                  the joint is held at ``ref1 + c0``
    ``connect`` of bodies or sites      a spherical loop joint: a point of the first on one of the second
    two ``connect`` of two bodies       a revolute loop joint through both points: one row of the six would say nothing
    ``weld`` of bodies or sites         a fixed loop joint; of bodies that ``relpose`` places, or the pose in the file
    ==================================  ================================================================================

    MuJoCo holds equalities by springs (``solref``, ``solimp``); here they are exact. Source: MuJoCo, XML reference,
    section equality, and ``mj_instantiateEquality`` of its engine.

    Attributes:
        places: Body -> its placement in the world in the pose of the file.
        held: Joint -> coordinate at which it is held [rad or m].
        frames: Frames that are tied, as joints that fix them to their bodies.
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
    near = np.round(axis)
    return near if np.abs(axis - near).max() < PRINTED else axis
