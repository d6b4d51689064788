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

from pinarm.arrays import Array
from pinarm.errors import ModelError, several
from pinarm.input.xml_text import MAX_LINKS, bound, check_names, counted
from pinarm.mechanics.loading.mjcf.joints import Equalities, Notes, elements_of, joint_chain, with_actuators
from pinarm.mechanics.loading.mjcf.settings import (
    GENERATED,
    MJCF,
    ORIENTATIONS,
    Attributes,
    Settings,
    number_in,
    numbers_in,
)
from pinarm.mechanics.loading.model_tree import (
    Kind,
    Tree,
    TreeJoint,
    body_inertia,
    checked_mimics,
    fixed_frame,
    inertia,
    inertia_defect,
)
from pinarm.mechanics.loading.values import solid_inertia, symmetric

WORLD = "world"
JOINTS = ("joint", "freejoint")
HOLDERS = ("worldbody", "body", "frame")
"""Elements that bodies stand in."""

UNMODELLED = {
    "tendon": "tendons are not modelled",
    "actuator": "actuators only have armature and damping: efforts come from laws, drives and loads",
    "keyframe": "keyframes are not used: the scenario says how a motion begins",
}
"""Sections that move a MuJoCo model -> what is said of them."""


WATER = 1000.0
"""Density where none is given [kg/m^3]."""

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
MOST_SIZES = 3
"""Numbers of ``size`` that MJCF allows; a shape takes the first ones it needs, as MuJoCo does."""

FLAT = ("plane", "hfield")
"""Shapes without mass."""


def mjcf_tree(model: Element) -> Tree:
    """Return the tree of a ``<mujoco>`` element whose includes are resolved."""
    unread = check_names(model, MJCF)
    _refuse_generated(model)
    settings = Settings.of(model)
    reader = _Reader(settings)
    for world in model.findall("worldbody"):
        if any(elements_of(settings, world, "", *JOINTS)):
            raise ModelError(
                "<worldbody> has a joint of its own", expected="joints in its bodies: the world stands still"
            )
        reader.bodies(world, WORLD, pin.SE3.Identity(), "", moves=False)
    sites = {site.child: site for site in reader.sites if site.child not in reader.links}  # points
    said = Equalities(reader.joints, reader.places, sites).read(settings, model)
    hinges = [*said.join_hinges()]
    points = [*(site for site in reader.sites if site.child not in reader.links), *said.frames]
    links = {**_scaled(reader.links, settings.total_mass), **{point.child: pin.Inertia.Zero() for point in points}}
    joints = with_actuators(settings, model, reader.joints, reader.notes)
    kinds: dict[str, Kind] = {name: "fixed" if name in said.held else joint.kind for name, joint in joints.items()}
    mimics, orphans = checked_mimics(said.mimics, kinds)
    gravity = np.zeros(3) if "gravity" in settings.off else settings.gravity
    notes = [*hinges, *(f"{what}: {several(names)}" for what, names in reader.notes.items())]
    if unread:
        notes.append(f"not read: {counted(unread)}")
    return Tree(
        model.get("model", ""), links, (*joints.values(), *points), mimics, gravity, (*reader.defects, *orphans),
        (*notes, *_unread(model)), said.loops, held=said.held,
    )  # fmt: skip


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


@dataclass
class _Reader:
    """Links, joints and sites read so far, on the way through the bodies."""

    settings: Settings
    links: dict[str, pin.Inertia] = field(default_factory=lambda: {WORLD: pin.Inertia.Zero()})
    joints: dict[str, TreeJoint] = field(default_factory=dict)
    nameless: Counter[str] = field(default_factory=Counter)
    sites: list[TreeJoint] = field(default_factory=list)
    places: dict[str, pin.SE3] = field(default_factory=lambda: {WORLD: pin.SE3.Identity()})
    defects: list[str] = field(default_factory=list)
    notes: Notes = field(default_factory=dict)

    def bodies(self, element: Element, parent: str, frame: pin.SE3, childclass: str, *, moves: bool) -> None:
        for child in element:
            if child.tag == "frame":
                place = frame * self.settings.placement(child.attrib, f"a frame of '{parent}'")
                self.bodies(child, parent, place, child.get("childclass", childclass), moves=moves)
            elif child.tag == "site":
                attributes = self.settings.attributes(child, childclass)
                if name := attributes.get("name"):
                    place = frame * self.settings.shape_placement(attributes, f"site '{name}'")[0]
                    self.sites.append(fixed_frame(name, parent, place))
            elif child.tag == "body":
                self._body(child, parent, frame, childclass, moves=moves)
            bound("bodies, joints and sites", len(self.joints) + len(self.sites), MAX_LINKS)

    def _body(self, body: Element, parent: str, frame: pin.SE3, childclass: str, *, moves: bool) -> None:
        self.nameless[parent] += not body.get("name")
        name = body.get("name") or f"{parent}_body{self.nameless[parent]}"
        if name in self.links:
            raise ModelError(f"two bodies have the name '{name}'", expected="a name of its own for each")
        where, settings = f"body '{name}'", self.settings
        if body.get("mocap", "false") == "true":
            self._note("held where they are drawn, though MuJoCo lets its user move them", name)
        if number_in(body.attrib, "gravcomp", where, 0.0):
            self._note("gravity compensation is not modelled", name)
        childclass = body.get("childclass", childclass)
        place = frame * settings.placement(body.attrib, where)
        self.places[name] = self.places[parent] * place
        joints = [*elements_of(settings, body, childclass, *JOINTS)]
        chain = [*joint_chain(settings, joints, parent, name, place, self.notes)]
        for joint in chain or [fixed_frame(name, parent, place)]:
            if joint.name in self.joints:
                raise ModelError(f"two joints have the name '{joint.name}'", expected="a name of its own for each")
            self.joints[joint.name] = joint
        moves = moves or bool(joints)
        self.links[name] = self._inertia(body, childclass, where, moves=moves)
        self.bodies(body, name, pin.SE3.Identity(), childclass, moves=moves)

    def _note(self, what: str, name: str) -> None:
        self.notes.setdefault(what, []).append(name)

    def _inertia(self, body: Element, childclass: str, where: str, *, moves: bool) -> pin.Inertia:
        """Return the inertia of a body about its frame; zero for a body that never moves.

        As in MuJoCo an ``<inertial>`` stays where ``inertiafromgeom`` is true, but no geom of the body has a mass, and
        what ``boundmass`` gives a body without mass stands at the body's ``pos``, though in the axes of the body.
        """
        settings = self.settings
        if not moves and not settings.total_mass:
            return pin.Inertia.Zero()
        inertials = [*elements_of(settings, body, childclass, "inertial")]
        total = pin.Inertia.Zero()
        if settings.source == "true" or (settings.source == "auto" and not inertials):
            for geom in elements_of(settings, body, childclass, "geom"):
                shape = geom_inertia(geom.attributes, settings, f"{where}: geom '{geom.attributes.get('name', '')}'")
                total += geom.frame.act(shape)
        elif not inertials and any(elements_of(settings, body, childclass, *JOINTS, "geom")):
            self._note("without <inertial>, and their geoms have no mass, as inertiafromgeom is false", where)
        if inertials and not total.mass:
            if len(inertials) > 1:
                raise ModelError(f"{where}: it has {len(inertials)} <inertial>", expected="one, of all its mass")
            total = inertials[0].frame.act(_inertial(inertials[0].attributes, settings, where))
        elif not total.mass and settings.least_mass:
            total = inertia(0.0, numbers_in(body.attrib, "pos", where, 3, (0.0, 0.0, 0.0)), np.zeros((3, 3)))
        if not moves and settings.fuses and total.mass:
            raise ModelError(
                f"{where}: its mass counts in settotalmass, or with fusestatic does not", expected="one of them"
            )
        return self._bounded(total, where)

    def _bounded(self, body: pin.Inertia, where: str) -> pin.Inertia:
        """Return an inertia raised to the mass and moments of ``boundmass`` and ``boundinertia``, and balanced."""
        settings, moments = self.settings, body.inertia
        if settings.least_inertia:
            values, axes = np.linalg.eigh(moments)
            moments = axes @ np.diag(np.maximum(values, settings.least_inertia)) @ axes.T
        if wrong := inertia_defect(moments):
            if settings.balances and np.linalg.eigvalsh(moments)[0] >= 0.0:
                moments = np.trace(moments) / 3.0 * np.eye(3)
            else:
                self.defects.append(f"{where}: {wrong}")
        return inertia(max(body.mass, settings.least_mass), body.lever, moments)


class MeshMass(ModelError):
    """A mass that only a mesh, or a compiler of shells, would tell."""


def geom_inertia(attributes: Attributes, settings: Settings, where: str) -> pin.Inertia:
    """Return the inertia of a shape about its body's frame."""
    kind = attributes.get("type", "mesh" if "mesh" in attributes else "sphere")
    mass, density = (number_in(attributes, key, where, -1.0) for key in ("mass", "density"))
    group = number_in(attributes, "group", where, 0.0)
    first, last = settings.groups
    if kind in FLAT or mass == 0.0 or (mass < 0.0 and density == 0.0) or not first <= group <= last:
        return pin.Inertia.Zero()
    if any(number_in(attributes, key, where, 0.0) < 0.0 for key in ("mass", "density")):
        raise ModelError(f"{where}: its mass or density is negative")
    if kind not in SIZES or "mesh" in attributes or attributes.get("shellinertia", "false") != "false":
        what = "mesh" if kind in ("mesh", "sdf") or "mesh" in attributes else f"'{kind}' or shell"
        raise MeshMass(
            f"{where}: the mass of a {what} is not computed here",
            expected="an <inertial> of its body",
            hint="pip install 'pinarm[mjcf]', by which MuJoCo's compiler computes it",
        )
    place, size = _shape(attributes, kind, settings, where)
    return place.act(solid_inertia(kind, size, density if density >= 0.0 else WATER, mass if mass >= 0.0 else None))


def _shape(attributes: Attributes, kind: str, settings: Settings, where: str) -> tuple[pin.SE3, Array]:
    """Return placement and size; with ``fromto`` the length is that between the two points."""
    size = numbers_in(attributes, "size", where, len(attributes.get("size", "").split()), ())
    if len(size) > MOST_SIZES:
        raise ModelError(
            f"{where}: size='{attributes['size'][:60]}' has {len(size)} numbers",
            expected=f"{SIZES[kind]} positive numbers, {MOST_SIZES} at most",
        )
    place, half = settings.shape_placement(attributes, where)
    if half is not None and len(size):
        size = np.array([size[0], half] if SIZES[kind] == 2 else [size[0], size[0], half])
    if len(size) < SIZES[kind] or not (size[: SIZES[kind]] > 0.0).all():
        raise ModelError(f"{where}: size='{attributes.get('size', '')}'", expected=f"{SIZES[kind]} positive numbers")
    return place, size[: SIZES[kind]]


def _inertial(attributes: Attributes, settings: Settings, where: str) -> pin.Inertia:
    mass = number_in(attributes, "mass", f"{where}: inertial")
    numbers_in(attributes, "pos", f"{where}: inertial", 3)  # it has no default
    place = settings.placement(attributes, f"{where}: inertial")
    if "fullinertia" in attributes:
        if twice := [key for key in ("diaginertia", *ORIENTATIONS) if key in attributes]:
            raise ModelError(f"{where}: inertial: it has fullinertia and {', '.join(twice)}", expected="one of them")
        moments = symmetric(*numbers_in(attributes, "fullinertia", where, 6))
    else:
        moments = np.diag(numbers_in(attributes, "diaginertia", where, 3, (0.0, 0.0, 0.0)))
    return body_inertia(mass, place, moments, where)


def _scaled(links: dict[str, pin.Inertia], total: float) -> dict[str, pin.Inertia]:
    """Return the inertias scaled to the total mass of ``settotalmass``; unchanged where it is 0."""
    mass = sum(body.mass for body in links.values())
    share = total / mass if total > 0.0 and mass else 1.0
    return {name: inertia(share * body.mass, body.lever, share * body.inertia) for name, body in links.items()}


def _unread(model: Element) -> Iterator[str]:
    for tag in ("deformable", "extension"):
        if model.find(f"{tag}/*") is not None:
            raise ModelError(f"the model has a section <{tag}>, which is not read", expected="rigid bodies and joints")
    option = {key: value for section in model.findall("option") for key, value in section.attrib.items()}
    medium = [key for key in ("density", "viscosity") if number_in(option, key, "<option>", 0.0)]
    if medium:
        yield f"the forces of a medium ({', '.join(medium)}) are not modelled"
    if model.find("worldbody//geom") is not None:
        yield "geoms do not touch: contacts are not modelled"
    for tag, words in UNMODELLED.items():
        if names := [element.get("name") or element.tag for element in model.findall(f"{tag}/*")]:
            yield f"{words}: {several(names)}"
