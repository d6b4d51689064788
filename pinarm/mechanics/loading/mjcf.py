"""Reader of MJCF models.

Pinocchio's parser is not used: it drops gravity, springs, couplings and every tree but the first, merges several joints
of a body into one without their names, and opens any mesh. What this reader does not support it refuses or notes.
Coordinates are MuJoCo's, except that free and ball joints count from the pose in the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.errors import ModelError, several
from pinarm.input.xml_names import check_names, counted
from pinarm.input.xml_text import MAX_LINKS, bound
from pinarm.mechanics.loading.mjcf_actuators import with_actuators
from pinarm.mechanics.loading.mjcf_equalities import EqualityReader, with_hinges
from pinarm.mechanics.loading.mjcf_geoms import geom_inertia
from pinarm.mechanics.loading.mjcf_joints import aligned, elements_of, joint_chain
from pinarm.mechanics.loading.mjcf_names import GENERATED, MJCF
from pinarm.mechanics.loading.mjcf_settings import ORIENTATIONS, Attributes, Settings, number, numbers
from pinarm.mechanics.loading.model_tree import Kind, Tree, TreeJoint, checked_mimics, inertia, inertia_defect

WORLD = "world"
JOINTS = ("joint", "freejoint")
HOLDERS = ("worldbody", "body", "frame")
"""Elements that bodies stand in."""


@dataclass
class _Reader:
    """What has been read while walking through the bodies.

    Attributes:
        settings: Conventions of the model.
        links: Inertia of every body.
        joints: Joints by name, depth-first.
        nameless: Number of bodies without a name by their parent.
        sites: Named points, as joints that hold them.
        places: Placement of every body in the world in the pose of the file.
        defects: As in ``Tree``.
        notes: What is not modelled -> names.
    """

    settings: Settings
    links: dict[str, pin.Inertia] = field(default_factory=lambda: {WORLD: pin.Inertia.Zero()})
    joints: dict[str, TreeJoint] = field(default_factory=dict)
    nameless: Counter[str] = field(default_factory=Counter)
    sites: list[TreeJoint] = field(default_factory=list)
    places: dict[str, pin.SE3] = field(default_factory=lambda: {WORLD: pin.SE3.Identity()})
    defects: list[str] = field(default_factory=list)
    notes: dict[str, list[str]] = field(default_factory=dict)

    def note(self, what: str, name: str) -> None:
        """Add a name to a note that several elements may share."""
        self.notes.setdefault(what, []).append(name)

    def add(self, joint: TreeJoint) -> None:
        """Add a joint.

        Raises:
            ModelError: There is one of its name, or there are too many.
        """
        if joint.name in self.joints:
            raise ModelError(f"two joints have the name '{joint.name}'", expected="a name of its own for each")
        self.joints[joint.name] = joint
        bound("bodies, joints and sites", len(self.joints) + len(self.sites), MAX_LINKS)


def mjcf_tree(model: Element) -> Tree:
    """Return the tree of a ``<mujoco>`` element whose includes are resolved.

    Raises:
        ModelError: A name, number, mass or axis is invalid, or the model has a part that would move it and is not
            supported: couplings by curves, generated bodies.
    """
    unread = check_names(model, MJCF)
    _refuse_generated(model)
    settings = Settings.of(model)
    reader = _Reader(settings)
    for world in model.findall("worldbody"):
        if any(elements_of(settings, world, "", *JOINTS)):
            raise ModelError(
                "<worldbody> has a joint of its own", expected="joints in its bodies: the world stands still"
            )
        _bodies(reader, world, WORLD, pin.SE3.Identity(), "", moves=False)
    sites = [site for site in reader.sites if site.child not in reader.links]  # points, unless a body is called so
    links = {**_scaled(reader.links, settings.total_mass), **{site.child: pin.Inertia.Zero() for site in sites}}
    names = frozenset(site.child for site in sites)
    said = EqualityReader(settings, reader.joints, reader.places, names).read(model)
    hinges = with_hinges(said, sites) if len(said.loops) > 1 else []
    links |= {frame.child: pin.Inertia.Zero() for frame in said.frames}
    joints = with_actuators(settings, model, reader.joints, reader.notes)
    kinds: dict[str, Kind] = {name: "fixed" if name in said.held else joint.kind for name, joint in joints.items()}
    mimics, orphans = checked_mimics(said.mimics, kinds)
    gravity = np.zeros(3) if "gravity" in settings.off else settings.gravity
    notes = [*hinges, *(f"{what}: {several(names)}" for what, names in reader.notes.items())]
    if unread:
        notes.append(f"not read: {counted(unread)}")
    return Tree(
        model.get("model", ""), links, (*joints.values(), *sites, *said.frames), mimics, gravity,
        (*reader.defects, *orphans), (*notes, *_unread(model)), said.loops, held=said.held,
    )  # fmt: skip


def _refuse_generated(model: Element) -> None:
    """Raise where bodies stand for many others: MuJoCo's compiler, which is asked for masses, would generate them.

    Raises:
        ModelError: Some do.
    """
    for world in model.findall("worldbody"):
        for holder in world.iter():
            if holder.tag in HOLDERS and (tag := next((child.tag for child in holder if child.tag in GENERATED), "")):
                raise ModelError(f"in '{holder.get('name', WORLD)}': <{tag}> is not read",
                                 expected="the bodies that it stands for",
                                 hint="the model as MuJoCo writes it, by mj_saveLastXML")  # fmt: skip


def _bodies(reader: _Reader, element: Element, parent: str, frame: pin.SE3, childclass: str, *, moves: bool) -> None:
    """Read the bodies and sites in a body, or in a frame of it with the given placement in the body."""
    for child in element:
        if child.tag == "frame":
            place = frame * reader.settings.placement(child.attrib, f"a frame of '{parent}'")
            _bodies(reader, child, parent, place, child.get("childclass", childclass), moves=moves)
        elif child.tag == "site":
            given = reader.settings.attributes(child, childclass)
            if name := given.get("name"):
                place = frame * reader.settings.shape_placement(given, f"site '{name}'")[0]
                reader.sites.append(_fixed(f"{name}_fixed", parent, name, place))
                bound("bodies, joints and sites", len(reader.joints) + len(reader.sites), MAX_LINKS)
        elif child.tag == "body":
            _body(reader, child, parent, frame, childclass, moves)


def _body(reader: _Reader, body: Element, parent: str, frame: pin.SE3, childclass: str, moves: bool) -> None:
    name = body.get("name")
    if not name:
        reader.nameless[parent] += 1
        name = f"{parent}_body{reader.nameless[parent]}"
    if name in reader.links:
        raise ModelError(f"two bodies have the name '{name}'", expected="a name of its own for each")
    where, settings = f"body '{name}'", reader.settings
    if body.get("mocap", "false") == "true":
        reader.note("held where they are drawn, though MuJoCo lets its user move them", name)
    if number(body.attrib, "gravcomp", where, 0.0):
        reader.note("gravity compensation is not modelled", name)
    childclass = body.get("childclass", childclass)
    place = frame * settings.placement(body.attrib, where)
    joints = [*elements_of(settings, body, childclass, *JOINTS)]
    reader.links[name], reader.places[name] = pin.Inertia.Zero(), reader.places[parent] * place
    if not joints:
        reader.add(_fixed(f"{name}_fixed", parent, name, place))
    for joint in joint_chain(settings, joints, parent, name, place, reader.notes):
        reader.add(joint)
    if any(aligned(settings, joint) for joint in joints) and sum(1 for _ in body.iter("body")) == 1:
        reader.note("free bodies whose frame MuJoCo moves to their inertia (align): here it stays as drawn", name)
    moves = moves or bool(joints)
    reader.links[name] = _inertia(reader, body, childclass, where, moves)
    _bodies(reader, body, name, pin.SE3.Identity(), childclass, moves=moves)


def _fixed(name: str, parent: str, child: str, place: pin.SE3) -> TreeJoint:
    return TreeJoint(name, "fixed", parent, child, place, np.array([0.0, 0.0, 1.0]))


def _inertia(reader: _Reader, body: Element, childclass: str, where: str, moves: bool) -> pin.Inertia:
    """Return the inertia of a body about its frame; zero for a body that never moves.

    As in MuJoCo an ``<inertial>`` stays where ``inertiafromgeom`` is true, but no geom of the body has a mass, and what
    ``boundmass`` gives a body without mass stands at the body's ``pos``, though in the axes of the body.
    """
    settings = reader.settings
    if not moves and not settings.total_mass:
        return pin.Inertia.Zero()
    inertials = [*elements_of(settings, body, childclass, "inertial")]
    total = pin.Inertia.Zero()
    if settings.source == "geoms" or (settings.source == "auto" and not inertials):
        for geom in elements_of(settings, body, childclass, "geom"):
            shape = geom_inertia(geom.given, settings, f"{where}: geom '{geom.given.get('name', '')}'")
            total += geom.frame.act(shape)
    elif not inertials and any(elements_of(settings, body, childclass, *JOINTS, "geom")):
        reader.note("without <inertial>, and their geoms have no mass, as inertiafromgeom is false", where)
    if inertials and not total.mass:
        if len(inertials) > 1:
            raise ModelError(f"{where}: it has {len(inertials)} <inertial>", expected="one, of all its mass")
        total = inertials[0].frame.act(_inertial(inertials[0].given, settings, where))
    elif not total.mass and settings.least_mass:
        total = inertia(0.0, numbers(body.attrib, "pos", where, 3, (0.0, 0.0, 0.0)), np.zeros((3, 3)))
    if not moves and settings.fuses and total.mass:
        raise ModelError(
            f"{where}: its mass counts in settotalmass, or with fusestatic does not", expected="one of them"
        )
    return _bounded(reader, total, where)


def _inertial(given: Attributes, settings: Settings, where: str) -> pin.Inertia:
    mass = number(given, "mass", f"{where}: inertial")
    if mass < 0.0:
        raise ModelError(f"{where}: the mass is negative ({mass:g} kg)")
    numbers(given, "pos", f"{where}: inertial", 3)  # it has no default
    place = settings.placement(given, f"{where}: inertial")
    if "fullinertia" in given:
        if twice := [key for key in ("diaginertia", *ORIENTATIONS) if key in given]:
            raise ModelError(f"{where}: inertial: it has fullinertia and {', '.join(twice)}", expected="one of them")
        xx, yy, zz, xy, xz, yz = numbers(given, "fullinertia", where, 6)
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        moments = np.diag(numbers(given, "diaginertia", where, 3, (0.0, 0.0, 0.0)))
    return inertia(mass, place.translation, place.rotation @ moments @ place.rotation.T)


def _bounded(reader: _Reader, body: pin.Inertia, where: str) -> pin.Inertia:
    """Return an inertia raised to the least mass and moments of ``boundmass`` and ``boundinertia``, and balanced."""
    settings, moments = reader.settings, body.inertia
    if settings.least_inertia:
        values, axes = np.linalg.eigh(moments)
        moments = axes @ np.diag(np.maximum(values, settings.least_inertia)) @ axes.T
    if wrong := inertia_defect(moments):
        if settings.balances and np.linalg.eigvalsh(moments)[0] >= 0.0:
            moments = np.trace(moments) / 3.0 * np.eye(3)
        else:
            reader.defects.append(f"{where}: {wrong}")
    return inertia(max(body.mass, settings.least_mass), body.lever, moments)


def _scaled(links: dict[str, pin.Inertia], total: float) -> dict[str, pin.Inertia]:
    """Return the inertias scaled to the total mass of ``settotalmass``; unchanged where it is 0."""
    mass = sum(body.mass for body in links.values())
    share = total / mass if total > 0.0 and mass else 1.0
    return {name: inertia(share * body.mass, body.lever, share * body.inertia) for name, body in links.items()}


def _unread(model: Element) -> Iterator[str]:
    """Yield notes on sections that move a MuJoCo model and are not supported."""
    for tag in ("deformable", "extension"):
        if any(len(section) for section in model.findall(tag)):
            raise ModelError(f"the model has a section <{tag}>, which is not read", expected="rigid bodies and joints")
    option = {key: value for section in model.findall("option") for key, value in section.attrib.items()}
    medium = [key for key in ("density", "viscosity") if number(option, key, "<option>", 0.0)]
    if medium:
        yield f"the forces of a medium ({', '.join(medium)}) are not modelled"
    if any(True for world in model.findall("worldbody") for _ in world.iter("geom")):
        yield "geoms do not touch: contacts are not modelled"
    for section, meant in (
        ("tendon", "tendons are not modelled"),
        (
            "actuator",
            "actuators only have armature and damping: efforts come from laws, drives and loads",
        ),
        ("keyframe", "keyframes are not used: the scenario says how a motion begins"),
    ):
        names = [element.get("name") or element.tag for part in model.findall(section) for element in part]
        if names:
            yield f"{meant}: {several(names)}"
