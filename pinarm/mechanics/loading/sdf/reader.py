"""Reader of SDF models: a tree of joints, and loop joints where a link has several parents.

Joints are taken in the order of the file, from the world outwards. A joint between links that both hang in the tree
already closes a loop; one that leads from a link to its own parent is turned round, and keeps its coordinate. A model
that no joint ties to the world floats.

Source: SDFormat 1.12, specification of model, link and joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.input.xml_names import check_names, counted
from pinarm.input.xml_text import MAX_LINKS, bound
from pinarm.mechanics.loading.model_tree import (
    Bounds,
    Kind,
    Mimic,
    Tree,
    TreeJoint,
    checked_mimics,
    inertia,
    inertia_defect,
    listed,
)
from pinarm.mechanics.loading.sdf.names import SDF
from pinarm.mechanics.loading.sdf.poses import MODEL, TRUE, Frames, number_in, numbers_of, pose_of, text_of

if TYPE_CHECKING:
    from pinarm.mechanics.loops.kinds import Loop

WORLD, FREE = "world", "root"
"""Name of what a model stands on, and of the joint by which its first link floats."""

KINDS: dict[str, Kind] = {
    "fixed": "fixed", "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "ball": "ball",
}  # fmt: skip
"""SDF joint type -> kind; others are refused."""

LIMITLESS = 1e15
"""Limit from which on there is none: the format's own default is 1e16."""


@dataclass(frozen=True)
class _Joint:
    """A joint of the file.

    Attributes:
        tree: The joint as one of a tree, from the link that the file calls parent to the child.
        place: Its placement in the model.
        mimic: What it follows; none of most.
    """

    tree: TreeJoint
    place: pin.SE3
    mimic: Mimic | None = None

    @property
    def active(self) -> bool:
        """Whether it has more than a motion: limits, damping, friction, a spring, or a joint that it follows."""
        plain = replace(self.tree, bounds=Bounds(), damping=0.0, friction=0.0, stiffness=0.0, rest=0.0)
        return self.mimic is not None or any(
            getattr(self.tree, key) != getattr(plain, key) for key in ("bounds", "damping", "friction", "stiffness")
        )


@dataclass
class _Tree:
    """The tree while it grows.

    Attributes:
        links: Links that hang in it already, the world first.
        joints: Joints and frames in their order.
        loops: Joints that close loops.
        notes: What is modelled differently, in words.
    """

    links: list[str] = field(default_factory=lambda: [WORLD])
    joints: list[TreeJoint] = field(default_factory=list)
    loops: dict[str, Loop] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def sdf_tree(root: Element) -> Tree:
    """Return the tree of an ``<sdf>`` element.

    Raises:
        ModelError: There is not one model, or a name, number, mass, axis or kind of joint is invalid.
    """
    unread = check_names(root, SDF)
    version, model = _version(root), _only_model(root)
    frames = Frames.of(model)
    defects: list[str] = []
    notes: list[str] = []
    bodies = {str(link.get("name")): _inertia(link, defects, notes) for link in model.findall("link")}
    if not bodies:
        raise ModelError("the model has no link")
    bound("links", len(bodies), MAX_LINKS)
    places = {name: frames.placement(name, f"link '{name}'") for name in bodies}
    stand = pose_of(model, WORLD, "the model")[1] * _reference(model, frames)
    joints = [_joint(element, frames, version) for element in model.findall("joint")]
    grown = _grown(joints, places, stand, fixed=text_of(model, "static") in TRUE)
    mimics = [joint.mimic for joint in joints if joint.mimic and joint.tree.name not in grown.loops]
    kinds = {joint.name: joint.kind for joint in grown.joints}
    kept, orphans = checked_mimics(mimics, kinds)
    if unread:
        notes.append(f"not read: {counted(unread)}")
    ends = {joint.child: pin.Inertia.Zero() for joint in grown.joints if joint.child not in bodies}
    links = {WORLD: pin.Inertia.Zero(), **{name: bodies[name] for name in grown.links[1:]}, **ends}
    gravity = numbers_of(text, 3, "gravity") if (text := root.findtext("world/gravity")) else None
    return Tree(
        model.get("name", ""), links, tuple(grown.joints), kept, gravity, (*defects, *orphans),
        (*notes, *grown.notes), grown.loops,
    )  # fmt: skip


def _version(root: Element) -> tuple[int, int]:
    """Return the version of the format.

    Raises:
        ModelError: It is none that is read.
    """
    parts = root.get("version", "").split(".")
    if len(parts) < 2 or not all(part.isdecimal() and part.isascii() for part in parts[:2]) or parts[0] != "1":
        raise ModelError(f"the model is SDF of version '{root.get('version', '')}'", expected="1.4 to 1.12")
    version = int(parts[0][:4]), int(parts[1][:4])
    if version < (1, 4):
        raise ModelError(f"the model is SDF of version {version[0]}.{version[1]}", expected="1.4 to 1.12",
                         hint="a newer version, as 'gz sdf -p' writes it")  # fmt: skip
    return version


def _only_model(root: Element) -> Element:
    """Return the model of a file.

    Raises:
        ModelError: There is not exactly one, or it has parts in other files or other models.
    """
    models = [*root.findall("model"), *root.findall("world/model")]
    if len(models) != 1:
        raise ModelError(f"the file has {len(models)} models", expected="one <model>, in <sdf> or in a <world>")
    nested = [tag for tag in ("include", "model") if models[0].find(tag) is not None]
    if nested or root.find("world/include") is not None:
        raise ModelError("the model is made of other models", expected="one <model> with links and joints",
                         hint="one without <include> and nested <model>, as 'gz sdf -p' writes it")  # fmt: skip
    return models[0]


def _reference(model: Element, frames: Frames) -> pin.SE3:
    """Return the model's frame in what its pose places: the model itself, or its ``placement_frame``."""
    placed = model.get("placement_frame")
    return frames.placement(placed, "placement_frame").inverse() if placed else pin.SE3.Identity()


def _inertia(link: Element, defects: list[str], notes: list[str]) -> pin.Inertia:
    """Return the inertia of a link about its frame; 1 kg and 1 kg*m^2 where the file gives none, as the format has it.

    Raises:
        ModelError: The mass is negative, or to be computed from collision shapes.
    """
    where, inertial = f"link '{link.get('name')}'", link.find("inertial")
    if text_of(link, "gravity") in ("0", "false"):
        notes.append(f"{where}: gravity acts on it, though the model switches it off")
    if inertial is None:
        notes.append(f"{where}: it has no <inertial>, and by the format 1 kg and moments of 1 kg*m^2")
    elif inertial.get("auto", "") in TRUE:
        raise ModelError(f"{where}: its inertia is to be computed from its collision shapes",
                         expected="<mass> and <inertia>")  # fmt: skip
    mass = number_in(inertial, "mass", 1.0, where)
    if mass < 0.0:
        raise ModelError(f"{where}: the mass is negative ({mass:g} kg)")
    xx, yy, zz = (number_in(inertial, f"inertia/{key}", 1.0, where) for key in ("ixx", "iyy", "izz"))
    xy, xz, yz = (number_in(inertial, f"inertia/{key}", 0.0, where) for key in ("ixy", "ixz", "iyz"))
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if wrong := inertia_defect(moments):
        defects.append(f"{where}: {wrong}")
    base, place = ("", pin.SE3.Identity()) if inertial is None else pose_of(inertial, "", f"{where}: inertial")
    if base:
        raise ModelError(f"{where}: the pose of its inertia is relative to '{base}'", expected="the link itself")
    return inertia(mass, place.translation, place.rotation @ moments @ place.rotation.T)


def _joint(joint: Element, frames: Frames, version: tuple[int, int]) -> _Joint:
    name, given = str(joint.get("name")), joint.get("type", "")
    where = f"joint '{name}'"
    if given not in KINDS:
        raise ModelError(f"{where}: a joint of type '{given}' is not read", expected=f"one of {', '.join(KINDS)}",
                         hint="a gearbox or a screw under 'couplings:' of the mechanism file")  # fmt: skip
    place = frames.placement(name, where)
    parent, child = (_end(joint, end, frames, where) for end in ("parent", "child"))
    if parent == child:
        raise ModelError(f"{where}: it joins '{child}' to itself")
    plain = TreeJoint(name, KINDS[given], parent, child, pin.SE3.Identity(), np.array([0.0, 0.0, 1.0]))
    axis = joint.find("axis")
    if plain.kind in ("fixed", "ball"):
        return _Joint(plain, place)
    bounds = Bounds() if given == "continuous" else _bounds(axis, where)
    effort, speed = (number_in(axis, f"limit/{key}", -1.0, where) for key in ("effort", "velocity"))
    damping, friction, stiffness = (
        number_in(axis, f"dynamics/{key}", 0.0, where) for key in ("damping", "friction", "spring_stiffness")
    )
    if min(damping, friction, stiffness) < 0.0:
        raise ModelError(f"{where}: its damping, friction or stiffness is negative")
    full = replace(
        plain, axis=_axis(axis, place, frames, version, where), damping=damping, friction=friction,
        stiffness=stiffness, rest=number_in(axis, "dynamics/spring_reference", 0.0, where),
        bounds=replace(bounds, effort=effort if effort >= 0.0 else np.inf, velocity=speed if speed >= 0.0 else np.inf),
    )  # fmt: skip
    return _Joint(full, place, _mimic(axis, name, where))


def _end(joint: Element, end: str, frames: Frames, where: str) -> str:
    """Return the link at an end of a joint, or the world."""
    name = text_of(joint, end)
    return WORLD if end == "parent" and name == WORLD else frames.link(name, f"{where}: {end}")


def _axis(axis: Element | None, place: pin.SE3, frames: Frames, version: tuple[int, int], where: str) -> Array:
    """Return the axis of a joint in its own axes, shape (3,): as it says, before version 1.5 in those of the model."""
    given = None if axis is None else axis.find("xyz")
    xyz = numbers_of((given.text or "") if given is not None else "0 0 1", 3, f"{where}: axis")
    length = float(np.linalg.norm(xyz))
    if not length:
        raise ModelError(f"{where}: its axis is 0", expected="a direction")
    named = given.get("expressed_in", "") if given is not None else ""
    if version < (1, 5) or (axis is not None and text_of(axis, "use_parent_model_frame") in TRUE):
        named = named or MODEL
    turn = place.rotation.T @ frames.placement(named, f"{where}: axis").rotation if named else np.eye(3)
    return np.asarray(turn @ xyz / length)


def _bounds(axis: Element | None, where: str) -> Bounds:
    lower, upper = (number_in(axis, f"limit/{key}", x, where) for key, x in (("lower", -1e16), ("upper", 1e16)))
    if lower > upper:
        raise ModelError(f"{where}: its limits are {lower:g} to {upper:g}", expected="the lower one first")
    return Bounds(lower if lower > -LIMITLESS else -np.inf, upper if upper < LIMITLESS else np.inf)


def _mimic(axis: Element | None, name: str, where: str) -> Mimic | None:
    """Return what a joint follows: ``q = multiplier (q_of - reference) + offset``."""
    given = None if axis is None else axis.find("mimic")
    if given is None:
        return None
    multiplier, offset, reference = (
        number_in(given, key, x, f"{where}: mimic")
        for key, x in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
    )
    return Mimic(name, given.get("joint", ""), multiplier, offset - multiplier * reference)


def _grown(joints: list[_Joint], places: dict[str, pin.SE3], stand: pin.SE3, *, fixed: bool) -> _Tree:
    """Return the tree of joints, and loop joints for those that it does not need.

    Args:
        joints: Joints of the file.
        places: Placement of every link in the model, in the order of the file.
        stand: Placement of the model in the world.
        fixed: Whether the model does not move.
    """
    tree, waiting = _Tree(), list(joints)
    placed = {WORLD: stand.inverse(), **places}
    carried = {joint.tree.child for joint in joints}
    order = [*(link for link in places if link not in carried), *places]
    while True:
        while (joint := _reaching(waiting, tree.links)) is not None:
            waiting.remove(joint)
            _hang(tree, joint, placed)
        loose = next((link for link in order if link not in tree.links), None)
        if loose is None:
            break
        name = FREE if not any(joint.kind == "floating" for joint in tree.joints) else f"{loose}_free"
        kind: Kind = "fixed" if fixed else "floating"
        tree.joints.append(TreeJoint(name, kind, WORLD, loose, stand * places[loose], np.array([0.0, 0.0, 1.0])))
        tree.links.append(loose)
    for joint in waiting:
        _close(tree, joint, placed)
    tree.notes += _said(tree, joints)
    tree.joints = _depth_first(tree.joints)
    return tree


def _depth_first(joints: list[TreeJoint]) -> list[TreeJoint]:
    """Return the joints with those beyond each next to it, as Pinocchio's algorithms need them."""
    beyond: dict[str, list[TreeJoint]] = {}
    for joint in reversed(joints):
        beyond.setdefault(joint.parent, []).append(joint)
    ordered, waiting = list[TreeJoint](), [*beyond.get(WORLD, [])]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += beyond.get(joint.child, [])
    return ordered


def _reaching(waiting: list[_Joint], links: list[str]) -> _Joint | None:
    """Return the first joint from a link of the tree to one that does not hang in it yet, outwards before inwards."""
    there = set(links)
    outwards = (joint for joint in waiting if joint.tree.parent in there and joint.tree.child not in there)
    inwards = (joint for joint in waiting if joint.tree.child in there and joint.tree.parent not in there)
    return next(outwards, None) or next(inwards, None)


def _hang(tree: _Tree, joint: _Joint, placed: dict[str, pin.SE3]) -> None:
    """Hang a link in the tree by a joint; one that leads inwards is turned round, with the opposite axis."""
    given = joint.tree
    outwards = given.parent in tree.links
    parent, child = (given.parent, given.child) if outwards else (given.child, given.parent)
    placement, offset = placed[parent].actInv(joint.place), joint.place.actInv(placed[child])
    axis = given.axis if outwards else -given.axis
    tree.joints.append(replace(given, parent=parent, child=child, placement=placement, offset=offset, axis=axis))
    tree.links.append(child)


def _close(tree: _Tree, joint: _Joint, placed: dict[str, pin.SE3]) -> None:
    """Add a loop joint, between frames on both of its links."""
    from pinarm.mechanics.loops.lower_pairs import Fixed, Prismatic, Revolute, Spherical

    given, (x, y, z) = joint.tree, joint.tree.axis.tolist()
    between = f"{given.name}_1", f"{given.name}_2"
    for frame, link in zip(between, (given.parent, given.child), strict=True):
        place = placed[link].actInv(joint.place)
        tree.joints.append(TreeJoint(f"{frame}_fixed", "fixed", link, frame, place, given.axis))
    if given.kind in ("revolute", "prismatic"):
        tree.loops[given.name] = (Revolute if given.kind == "revolute" else Prismatic)(between=between, axis=(x, y, z))
    else:
        tree.loops[given.name] = (Fixed if given.kind == "fixed" else Spherical)(between=between)


def _said(tree: _Tree, joints: list[_Joint]) -> Iterator[str]:
    """Yield what is to be said of loops and of a model that floats."""
    if names := [*tree.loops]:
        yield f"closing loops of the tree of joints: {listed('joint', names)}"
    if active := [joint.tree.name for joint in joints if joint.tree.name in tree.loops and joint.active]:
        yield f"limits, damping, friction and springs of {listed('joint', active)}, closing loops, are not modelled"
    if free := [joint.child for joint in tree.joints if joint.kind == "floating"]:
        yield f"no joint ties {listed('link', free)} to the world: the model floats; 'base: fixed' holds it"
