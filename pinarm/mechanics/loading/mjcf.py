"""Reader of MJCF models: bodies, joints with their springs, dampers and limits, and equalities.

Pinocchio's parser is not used: it drops gravity, springs, couplings and every tree but the first, merges several joints
of a body into one without their names, and opens any mesh. What this reader does not support it refuses or notes.
Coordinates are MuJoCo's, except that free and ball joints count from the pose in the file.

==================================  ================================================================================
equality                            here
==================================  ================================================================================
``joint`` with two joints           a coupling, ``q1 - ref1 = c0 + c1 (q2 - ref2)``; curves are refused
``joint`` with one                  the joint is held at ``ref1 + c0``
``connect`` of bodies or sites      a spherical loop joint: a point of the first on one of the second
two ``connect`` of two bodies       a revolute loop joint through both points: one row of the six would say nothing
``weld`` of bodies or sites         a fixed loop joint; of bodies that ``relpose`` places, or the pose in the file
==================================  ================================================================================

MuJoCo holds equalities by springs (``solref``, ``solimp``); here they are exact. Source: MuJoCo, XML reference,
section equality, and ``mj_instantiateEquality`` of its engine.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.input.xml_text import MAX_LINKS, bound, check_names, counted
from pinarm.mechanics.loading.mjcf_settings import ACTUATOR, GENERATED, MJCF, ORIENTATIONS, Settings
from pinarm.mechanics.loading.model_tree import (
    Bounds,
    Kind,
    MeshMass,
    Mimic,
    Tree,
    TreeJoint,
    body_inertia,
    fixed_frame,
    from_z,
    held,
    inertia,
    inertia_defect,
)
from pinarm.mechanics.loading.values import ZERO, Part, known, rotation, solid_inertia
from pinarm.records import replace

WORLD = "world"
JOINTS = ("joint", "freejoint")
HOLDERS = ("worldbody", "body", "frame")
"""Elements that bodies stand in."""

KINDS: dict[str, Kind] = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}

COEFFICIENTS: dict[str, set[str]] = {
    "stiffness": {"passive", "spring"}, "damping": {"passive", "damper"},
    "frictionloss": {"frictionloss", "constraint"}, "armature": set(),
}  # fmt: skip
"""Coefficients of joints, and the flags of the model that switch them off."""

TIES = {"connect": "spherical", "weld": "fixed"}
"""Equalities that close loops -> kind of loop joint."""

UNMODELLED = {
    "tendon": "tendons are not modelled",
    "actuator": "actuators only have armature and damping: efforts come from laws, drives and loads",
    "keyframe": "keyframes are not used: the scenario says how a motion begins",
}
"""Sections that move a MuJoCo model -> what is said of them."""

PRINTED = 1e-4
"""Difference of two directions, or two distances relative to their size, that is due to six printed digits."""

WATER = 1000.0
"""Density where none is given [kg/m^3]."""

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
MOST_SIZES = 3
"""Numbers of ``size`` that MJCF allows; a shape takes the first ones it needs, as MuJoCo does."""

FLAT = ("plane", "hfield")
"""Shapes without mass."""


def mjcf_tree(model: Element) -> Tree:
    """Return the tree of a ``<mujoco>`` element whose includes are resolved."""
    unread, tree = check_names(model, MJCF), Tree(model.get("model", ""))
    _refuse_generated(model)
    reader = _Reader(settings := Settings(model), tree)
    for world in model.findall("worldbody"):
        content = reader.content(world, "", WORLD)
        if any(part.tag in JOINTS for part in content):
            raise ModelError(
                "<worldbody> has a joint of its own", expected="joints in its bodies: the world stands still"
            )
        reader.bodies(content, WORLD, moves=False)
    reader.scale_masses()
    reader.add_actuators(model)
    reader.sites = [site for site in reader.sites if site.child not in reader.places]  # a link has the name already
    for site in reader.sites:
        tree.add_frame(site.child, site.parent, site.placement)
    _add_equalities(reader, model)
    _join_hinges(tree)
    tree.joints[:0] = reader.joints.values()
    tree.gravity = (
        np.zeros(3) if "gravity" in settings.off else settings.option.numbers("gravity", 3, (0.0, 0.0, -9.81))
    )
    if unread:
        tree.notes.append(f"not read: {counted(unread)}")
    _note_unread(model, settings, tree)
    return tree


def _refuse_generated(model: Element) -> None:
    """Refuse bodies that stand for many others: MuJoCo's compiler, which is asked for masses, would generate them."""
    for world in model.findall("worldbody"):
        for holder in world.iter():
            if holder.tag in HOLDERS and (tag := next((child.tag for child in holder if child.tag in GENERATED), "")):
                raise ModelError(
                    f"in '{holder.get('name', WORLD)}': <{tag}> is not read",
                    expected="the bodies that it stands for",
                    hint="the model as MuJoCo writes it, by mj_saveLastXML",
                )


def _note_unread(model: Element, settings: Settings, tree: Tree) -> None:
    for tag in ("deformable", "extension"):
        if model.find(f"{tag}/*") is not None:
            raise ModelError(f"the model has a section <{tag}>, which is not read", expected="rigid bodies and joints")
    medium = [key for key in ("density", "viscosity") if settings.option.number(key, 0.0)]
    tree.remark("the forces of a medium are not modelled", *medium)
    if model.find("worldbody//geom") is not None:
        tree.notes.append("geoms do not touch: contacts are not modelled")
    for tag, words in UNMODELLED.items():
        tree.remark(words, *(element.get("name") or element.tag for element in model.findall(f"{tag}/*")))


class BodyElement(NamedTuple):
    """An element of a body: its attributes with those of its class, the placement and class of its ``<frame>``."""

    tag: str
    said: Part
    frame: pin.SE3
    element: Element
    childclass: str


class _Reader:
    """Links, joints and sites read so far, on the way through the bodies.

    Attributes:
        places: Body -> its placement in the world in the pose of the file.
        sites: Frames of sites, as joints that fix them to their bodies.
    """

    def __init__(self, settings: Settings, tree: Tree) -> None:
        self.settings, self.tree = settings, tree
        self.joints, self.sites, self.nameless = dict[str, TreeJoint](), list[TreeJoint](), Counter[str]()
        self.places = {WORLD: pin.SE3.Identity()}
        tree.links[WORLD] = pin.Inertia.Zero()

    def content(self, body: Element, childclass: str, where: str) -> list[BodyElement]:
        """Return the elements of a body, in the order of the file; those in frames have their placement."""
        content, waiting = list[BodyElement](), [(child, pin.SE3.Identity(), childclass) for child in reversed(body)]
        while waiting:
            element, place, inherited = waiting.pop()
            words = f"{where}: {element.tag}" + (f" '{name}'" if (name := element.get("name")) else "")
            classed = element.tag in ("joint", "geom", "site")
            said = self.settings.part(element, inherited, words) if classed else Part.of(words, element)
            if element.tag == "frame":
                inner, within = place * self.settings.placement(said), element.get("childclass", inherited)
                waiting += [(child, inner, within) for child in reversed(element)]
            else:
                content.append(BodyElement(element.tag, said, place, element, inherited))
        return content

    def bodies(self, content: Sequence[BodyElement], parent: str, *, moves: bool) -> None:
        """Read the bodies and sites in a body."""
        for part in content:
            if part.tag == "site" and (name := part.said.texts.get("name")):
                place = part.frame * self.settings.shape_placement(part.said)[0]
                self.sites.append(fixed_frame(name, parent, place))
            elif part.tag == "body":
                self._body(part, parent, moves=moves)
            bound("bodies, joints and sites", len(self.joints) + len(self.sites), MAX_LINKS)

    def _body(self, body: BodyElement, parent: str, *, moves: bool) -> None:
        self.nameless[parent] += not body.element.get("name")
        name = body.element.get("name") or f"{parent}_body{self.nameless[parent]}"
        if name in self.places:
            raise ModelError(f"two bodies have the name '{name}'", expected="a name of its own for each")
        said = Part(body.said.texts, f"body '{name}'")
        if said.is_true("mocap"):
            self.tree.remark("held where they are drawn, though MuJoCo lets its user move them", name)
        if said.number("gravcomp", 0.0):
            self.tree.remark("gravity compensation is not modelled", name)
        content = self.content(body.element, said.texts.get("childclass", body.childclass), said.where)
        place = body.frame * self.settings.placement(said)
        self.places[name] = self.places[parent] * place
        parts = [part for part in content if part.tag in JOINTS]
        for joint in [*self._chain(parts, parent, name, place)] or [fixed_frame(name, parent, place)]:
            if joint.name in self.joints:
                raise ModelError(f"two joints have the name '{joint.name}'", expected="a name of its own for each")
            self.joints[joint.name] = joint
        moves = moves or bool(parts)
        self.tree.links[name] = self._inertia(content, said, moves=moves)
        self.bodies(content, name, moves=moves)

    def _chain(self, parts: Sequence[BodyElement], parent: str, body: str, place: pin.SE3) -> Iterator[TreeJoint]:
        """Yield the joints of a body as a chain: each moves in the frame of the one before it."""
        free = any(part.tag == "freejoint" or part.said.texts.get("type") == "free" for part in parts)
        if free and (len(parts) > 1 or parent != WORLD):
            raise ModelError(f"body '{body}': a free joint stands alone, in a body of the world")
        for number, part in enumerate(parts, 1):
            other = f"{body}_free" if free else f"{body}_joint{number if len(parts) > 1 else ''}"
            name = part.said.texts.get("name") or other
            child = body if number == len(parts) else f"{body}/{name}"
            joint = self._joint(Part(part.said.texts, f"joint '{name}'"), part, name)
            made_for = name if child != body else ""
            yield replace(joint, parent=parent, child=child, placement=place * joint.placement, made_for=made_for)
            parent, place = child, pin.SE3.Identity()

    def _joint(self, said: Part, part: BodyElement, name: str) -> TreeJoint:
        kind = KINDS["free" if part.tag == "freejoint" else said.word("type", (*KINDS,))]
        stiffness, damping, friction, armature = (self._coefficient(said, key) for key in COEFFICIENTS)
        joint = TreeJoint(name, kind, "", "", pin.SE3.Identity(), stiffness=stiffness, damping=damping,
                          friction=friction, armature=armature)  # fmt: skip
        if "springdamper" in said.texts and said.numbers("springdamper", 2).any():
            raise ModelError(
                f"{said.where}: springdamper='{said.texts['springdamper'][:60]}' is not read",
                expected="stiffness and damping of the joint",
                hint="with its inertia m: stiffness m / (T D)^2 and damping 2 m / T of the time constant T and the "
                "ratio D",
            )
        if kind == "floating":
            return joint
        anchor = pin.SE3(np.eye(3), part.frame.act(said.numbers("pos", 3, ZERO)))
        joint = replace(joint, placement=anchor, offset=anchor.inverse())
        if kind == "ball":
            ranged = said.texts.get("range") and said.texts.get("limited") != "false"
            self.tree.remark("the range of ball joints is not watched", *[name] if ranged else [])
            return joint
        axis, turns = part.frame.rotation @ said.direction("axis", (0.0, 0.0, 1.0)), kind == "revolute"
        measure = self.settings.angle if turns else 1.0
        drawn, rest = (measure * said.number(key, 0.0) for key in ("ref", "springref"))
        lower, upper = (measure * self._range(said, "range", "limited")).tolist()
        effort = float(np.abs(self._range(said, "actuatorfrcrange", "actuatorfrclimited")).max())
        self.tree.remark("drawn at their ref, but begin at 0 where nothing is said", *[name] if drawn else [])
        back = pin.SE3(pin.exp3(-drawn * axis), np.zeros(3)) if turns else pin.SE3(np.eye(3), -drawn * axis)
        return replace(joint, axis=axis, offset=back * joint.offset, bounds=Bounds(lower, upper, effort=effort),
                       rest=rest, drawn=drawn)  # fmt: skip

    def _coefficient(self, said: Part, key: str) -> float:
        """Return one of the ``COEFFICIENTS``; 0 where it is not given, or the model disables it."""
        value, *higher = said.numbers(key, max(len(said.texts.get(key, "").split()), 1), (0.0,))
        if any(higher):
            raise ModelError(
                f"{said.where}: {key}='{said.texts[key][:60]}' is a polynomial, which is not read",
                expected="one number",
                hint=f"no {key} here, and 'forces:' in the mechanism file",
            )
        if value < 0.0:
            raise ModelError(f"{said.where}: its {key} is negative")
        return 0.0 if COEFFICIENTS[key] & self.settings.off else float(value)

    def _range(self, said: Part, key: str, switch: str) -> Array:
        """Return a range if it is a limit, otherwise an infinite one, shape (2,)."""
        limited = said.word(switch, ("auto", "true", "false"))
        if limited == "true" and key not in said.texts:
            problem = f"{said.where}: {switch}='true', and it has no {key}"
            raise ModelError(problem, expected=f"a {key}, or {switch}='false'")
        none = np.array([-np.inf, np.inf])
        if key not in said.texts or limited == "false" or (limited == "auto" and not self.settings.limits_by_range):
            return none
        lower, upper = ends = said.numbers(key, 2)
        if lower == upper == 0.0 and limited == "auto":  # the format's own default
            return none
        if lower >= upper:
            raise ModelError(f"{said.where}: {key}='{said.texts[key]}'", expected="the lower number first")
        return ends

    def _inertia(self, content: Sequence[BodyElement], said: Part, *, moves: bool) -> pin.Inertia:
        """Return the inertia of a body about its frame; zero for a body that never moves.

        As in MuJoCo an ``<inertial>`` stays where ``inertiafromgeom`` is true, but no geom of the body has a mass, and
        what ``boundmass`` gives a body without mass stands at the body's ``pos``, though in the axes of the body.
        """
        settings, compiler, where = self.settings, self.settings.compiler, said.where
        scaled = compiler.number("settotalmass", 0.0) > 0.0
        if not moves and not scaled:
            return pin.Inertia.Zero()
        source = compiler.word("inertiafromgeom", ("auto", "false", "true"))
        inertials = [part for part in content if part.tag == "inertial"]
        total = pin.Inertia.Zero()
        if source == "true" or (source == "auto" and not inertials):
            for geom in (part for part in content if part.tag == "geom"):
                total += geom.frame.act(geom_inertia(geom.said, settings))
        elif not inertials and any(part.tag in (*JOINTS, "geom") for part in content):
            self.tree.remark("without <inertial>, and their geoms have no mass, as inertiafromgeom is false", where)
        if inertials and not total.mass:
            if len(inertials) > 1:
                raise ModelError(f"{where}: it has {len(inertials)} <inertial>", expected="one, of all its mass")
            total = inertials[0].frame.act(_inertial(inertials[0].said, settings))
        least = compiler.number("boundmass", 0.0)
        if not total.mass and not inertials and least:
            total = inertia(0.0, said.numbers("pos", 3, ZERO), np.zeros((3, 3)))
        if not moves and total.mass and compiler.is_true("fusestatic"):
            raise ModelError(
                f"{where}: its mass counts in settotalmass, or with fusestatic does not", expected="one of them"
            )
        moments = total.inertia
        if least_moment := compiler.number("boundinertia", 0.0):
            values, axes = np.linalg.eigh(moments)
            moments = axes @ np.diag(np.maximum(values, least_moment)) @ axes.T
        if inertia_defect(moments) and compiler.is_true("balanceinertia") and np.linalg.eigvalsh(moments)[0] >= 0.0:
            moments = np.trace(moments) / 3.0 * np.eye(3)
        return self.tree.body(max(total.mass, least), pin.SE3(np.eye(3), total.lever), moments, where)

    def scale_masses(self) -> None:
        """Scale the inertias to the total mass of ``settotalmass``, where that is positive."""
        links, total = self.tree.links, self.settings.compiler.number("settotalmass", 0.0)
        mass = sum(body.mass for body in links.values())
        share = total / mass if total > 0.0 and mass else 1.0
        for name, body in links.items():
            links[name] = inertia(share * body.mass, body.lever, share * body.inertia)

    def add_actuators(self, model: Element) -> None:
        """Add the armature ``N^2 J`` and the damping ``N^2 d`` of actuators, with the gear N, to their joints."""
        for element in model.findall(f"{ACTUATOR}/*"):
            texts = self.settings.part(element, "", "", ACTUATOR).texts
            name = texts.get("joint") or texts.get("jointinparent")
            where = f"actuator '{texts.get('name') or name or element.tag}'"
            said = Part({**texts, "gear": (texts.get("gear", "").split() or ["1"])[0]}, where)
            armature, damping = (self._coefficient(said, key) for key in ("armature", "damping"))
            if name is None:
                beyond = [where] if armature or damping else []
                self.tree.remark("armature and damping beyond joints are not modelled", *beyond)
                continue
            joint = self.joints[known(name, self.joints, f"{where}: there is no joint '{name}'")]
            squared = said.number("gear") ** 2
            self.joints[name] = replace(
                joint, armature=joint.armature + squared * armature, damping=joint.damping + squared * damping
            )


def geom_inertia(said: Part, settings: Settings) -> pin.Inertia:
    """Return the inertia of a shape about its body's frame."""
    kind = said.texts.get("type", "mesh" if "mesh" in said.texts else "sphere")
    mass, density = (said.number(key, -1.0) for key in ("mass", "density"))
    first, last = settings.compiler.numbers("inertiagrouprange", 2, (0.0, 5.0))
    grouped = first <= said.number("group", 0.0) <= last
    if kind in FLAT or mass == 0.0 or (mass < 0.0 and density == 0.0) or not grouped:
        return pin.Inertia.Zero()
    if any(said.number(key, 0.0) < 0.0 for key in ("mass", "density")):
        raise ModelError(f"{said.where}: its mass or density is negative")
    if kind not in SIZES or "mesh" in said.texts or said.texts.get("shellinertia", "false") != "false":
        what = "mesh" if kind in ("mesh", "sdf") or "mesh" in said.texts else f"'{kind}' or shell"
        raise MeshMass(
            f"{said.where}: the mass of a {what} is not computed here",
            expected="an <inertial> of its body",
            hint="pip install 'pinarm[mjcf]', by which MuJoCo's compiler computes it",
        )
    place, size = _shape(said, kind, settings)
    return place.act(solid_inertia(kind, size, density if density >= 0.0 else WATER, mass if mass >= 0.0 else None))


def _shape(said: Part, kind: str, settings: Settings) -> tuple[pin.SE3, Array]:
    """Return placement and size; with ``fromto`` the length is that between the two points."""
    size, count = said.numbers("size", len(said.texts.get("size", "").split()), ()), SIZES[kind]
    given = len(size)
    place, half = settings.shape_placement(said)
    if half is not None and given:
        size = np.array([size[0], half] if count == 2 else [size[0], size[0], half])
    if given > MOST_SIZES or len(size) < count or not (size[:count] > 0.0).all():
        raise ModelError(
            f"{said.where}: size='{said.texts.get('size', '')[:60]}'",
            expected=f"{count} positive numbers, {MOST_SIZES} at most",
        )
    return place, size[:count]


def _inertial(said: Part, settings: Settings) -> pin.Inertia:
    mass = said.number("mass")
    said.numbers("pos", 3)  # it has no default
    place = settings.placement(said)
    if "fullinertia" not in said.texts:
        moments = np.diag(said.numbers("diaginertia", 3, ZERO))
    elif twice := [key for key in ("diaginertia", *ORIENTATIONS) if key in said.texts]:
        raise ModelError(f"{said.where}: it has fullinertia and {', '.join(twice)}", expected="one of them")
    else:  # xx, yy, zz, xy, xz, yz
        moments = said.numbers("fullinertia", 6)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    return body_inertia(mass, place, moments, said.where)


def _add_equalities(reader: _Reader, model: Element) -> None:
    """Add the couplings and loops of active equalities to the tree; joints that they hold are fixed."""
    settings, drawn, done = reader.settings, {name: joint.drawn for name, joint in reader.joints.items()}, set[str]()
    elements = [] if settings.off & {"equality", "constraint"} else model.findall("equality/*")
    parts = [(element.tag, settings.part(element, "", "", "equality").texts) for element in elements]
    active = [(tag, texts) for tag, texts in parts if texts.get("active", "true") != "false"]
    for number, (tag, texts) in enumerate(active, 1):
        label = next((texts[key] for key in ("name", "joint1", "body1", "site1") if texts.get(key)), "without name")
        said = Part(texts, f"equality '{label}'")
        if tag == "joint":
            _couple(reader, said, drawn, done)
        elif tag in TIES:
            _tie(reader, tag, texts.get("name") or f"{tag}_{number}", said)
        else:
            raise ModelError(
                f"{said.where}: a <{tag}> is not read",
                expected=f"joint, {', '.join(TIES)}",
                hint="remove it, and use 'loops:' or 'couplings:' of the mechanism file",
            )


def _couple(reader: _Reader, said: Part, drawn: Mapping[str, float], done: set[str]) -> None:
    follower, leader = said.texts.get("joint1", ""), said.texts.get("joint2")
    words = said.texts.get("polycoef", "0 1 0 0 0").split()
    curve = (
        Part({"polycoef": " ".join([*words, *["0"] * (5 - len(words))])}, said.where).numbers("polycoef", 5).tolist()
    )
    if follower in done:
        problem = f"{said.where}: '{follower}' is held or coupled by another equality already"
        raise ModelError(problem, expected="one equality for each 'joint1'")
    done.add(follower)
    if leader is None:
        joint = reader.joints[known(follower, reader.joints, f"{said.where}: there is no joint '{follower}'")]
        if joint.kind not in ("revolute", "prismatic"):
            problem = f"{said.where}: '{follower}' is held, and is no hinge or slide"
            raise ModelError(problem, expected="a joint with one coordinate")
        reader.joints[follower] = held(joint, joint.drawn + curve[0])
        return
    if any(curve[2:]):
        problem = f"{said.where}: it couples by a curve, which is not read"
        raise ModelError(problem, expected="polycoef with at most two numbers")
    ends = [drawn.get(joint, 0.0) for joint in (follower, leader)]
    reader.tree.mimics.append(Mimic(follower, leader, curve[1], curve[0] + ends[0] - curve[1] * ends[1]))


def _tie(reader: _Reader, tag: str, name: str, said: Part) -> None:
    """Close a loop between two sites, or two bodies at their places in the pose of the file."""
    tree = reader.tree
    if name in tree.loops:
        raise ModelError(f"two equalities have the name '{name}'", expected="a name of its own for each")
    by_sites = "site1" in said.texts
    what, names = ("site", {joint.child for joint in reader.sites}) if by_sites else ("body", {*reader.places})
    first, second = (
        known(end, names, f"{said.where}: there is no {what} '{end}'")
        for end in (said.texts.get(f"{what}1", ""), said.texts.get(f"{what}2", "" if by_sites else WORLD))
    )
    if by_sites:
        tree.tie(name, TIES[tag], (first, second))
        return
    between = reader.places[first].actInv(reader.places[second])
    anchor = pin.SE3(np.eye(3), said.numbers("anchor", 3, ZERO))
    if tag == "connect":  # the anchor is a point of the first body
        ends = anchor, between.actInv(anchor)
    else:
        pose = said.numbers("relpose", 7, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        ends = pin.SE3(rotation(*pose[3:]), pose[:3]) if pose[3:].any() else between * anchor, anchor
    tree.close(name, TIES[tag], zip((first, second), ends, strict=True))


def _join_hinges(tree: Tree) -> None:
    """Make one revolute joint of two spherical ones that tie the same two bodies in two points.

    Exporters write hinges so, such as onshape-to-robot. The six rows have rank five, as the distance of the points
    is given twice, and their forces along the hinge would not be determined.
    """
    if len(tree.loops) < 2:
        return
    from pinarm.mechanics.loops.lower_pairs import Spherical

    frames, pairs = {joint.child: joint for joint in tree.joints}, dict[frozenset[str], list[str]]()
    tied = {
        name: [frames[end] for end in loop.between] for name, loop in tree.loops.items() if isinstance(loop, Spherical)
    }
    for name, ends in tied.items():
        pairs.setdefault(frozenset(end.parent for end in ends), []).append(name)
    for name, other in (pair for names in pairs.values() for pair in combinations(names, 2)):
        ends, others = tied[name], sorted(tied[other], key=lambda end: end.parent != tied[name][0].parent)
        ways = [end.placement.actInv(second.placement).translation for end, second in zip(ends, others, strict=True)]
        length, second_length = (float(np.linalg.norm(way)) for way in ways)
        apart = abs(length - second_length) <= PRINTED * length and min(length, second_length) > 0.0
        if not apart or not {name, other} <= tree.loops.keys():
            continue
        hinge = f"{name}_hinge_1", f"{name}_hinge_2"
        for frame, end, axis in zip(hinge, ends, (ways[0] / length, ways[1] / second_length), strict=True):
            turned = end.placement * pin.SE3(from_z(_rounded(axis)), np.zeros(3))
            tree.add_frame(frame, end.parent, turned, name)
        del tree.loops[other]
        tree.tie(name, "revolute", hinge, axis=(0.0, 0.0, 1.0))
        tree.notes.append(
            f"{name} and {other} tie two points of the same bodies: together they are a revolute joint {name}"
        )


def _rounded(axis: Array) -> Array:
    near = np.round(axis)
    return near if np.abs(axis - near).max() < PRINTED else axis
