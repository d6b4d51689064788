"""Reader of SDF models: a tree of joints, loop joints where a link has several parents, and gears.

Source: SDFormat 1.12, specification of model, link and joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError, choices, listed
from pinarm.input.xml_text import MAX_LINKS, bound, check_names, counted
from pinarm.mechanics.loading.model_tree import Tree, body_inertia, checked_mimics, inertia_defect
from pinarm.mechanics.loading.sdf.frames import SDF, WORLD, Frames, is_true, number_in, pose_of, text_of
from pinarm.mechanics.loading.sdf.joints import GEARBOX, Hinge, SdfJoint, gear_of, joint_in, spanning_tree
from pinarm.mechanics.loading.values import numbers, solid_inertia, symmetric
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.kinds import Gear

MOMENTS = ("ixx", "iyy", "izz")

GRAVITY = "0 0 -9.8"
"""Gravity of a world without ``<gravity>`` [m/s^2]."""


def sdf_tree(root: Element, name: str = "") -> Tree:
    """Return the tree of an ``<sdf>`` element.

    Args:
        name: Name of the model; where it is empty the only one, or the only one with joints that move.
    """
    notes: list[str] = []
    version, model = _version(root), _model(root, name, notes)
    unread = check_names(root, SDF)
    for pose in root.iter("pose") if version < (1, 7) else ():  # its attribute before version 1.7
        if "frame" in pose.attrib and "relative_to" not in pose.attrib:
            pose.set("relative_to", pose.attrib.pop("frame"))
    frames = Frames.of(model)
    defects: list[str] = []
    bodies = {str(link.get("name")): _inertia(link, defects, notes) for link in model.findall("link")}
    if not bodies:
        raise ModelError("the model has no link")
    bound("links", len(bodies), MAX_LINKS)
    places = {name: frames.placement(name, f"link '{name}'") for name in bodies}
    around = Frames.around(model, root.find("world"))
    placed = model.get("placement_frame")
    own = frames.placement(placed, "placement_frame").inverse() if placed else pin.SE3.Identity()
    stand = around.placement(model.get("name", ""), "the model") * own
    elements = model.findall("joint")
    joints = [joint_in(element, frames, version) for element in elements if element.get("type") != GEARBOX]
    static = is_true(model.findtext("static"), "static")
    if static and (moving := [joint.name for joint in joints if joint.kind != "fixed"]):
        raise ModelError(
            f"the model is static, and {listed('joint', moving)} moves", expected="fixed joints alone, or no <static>"
        )
    tree = spanning_tree(joints, places, stand, fixed=static)
    couplings = {**tree.couplings, **_gears(elements, frames, version, tree.hung)}
    leaders = {joint.name: joint.steps[0].name for joint in tree.hung if joint.kind != "screw"}
    mimics = [replace(mimic, of=leaders.get(mimic.of, mimic.of)) for joint in tree.hung for mimic in joint.mimics]
    kept, orphans = checked_mimics(mimics, {joint.name: joint.kind for joint in tree.joints})
    if unread:
        notes.append(f"not read: {counted(unread)}")
    ends = {joint.child: pin.Inertia.Zero() for joint in tree.joints if joint.child not in bodies}
    links = {WORLD: pin.Inertia.Zero(), **{name: bodies[name] for name in tree.links if name != WORLD}, **ends}
    gravity = _gravity(root, version, notes)
    return Tree(
        model.get("name", ""), links, tuple(tree.joints), kept, gravity, (*defects, *orphans),
        (*notes, *tree.notes), tree.loops, couplings,
    )  # fmt: skip


def _gravity(root: Element, version: tuple[int, int], notes: list[str]) -> Array | None:
    """Return the gravity of the world, before version 1.6 of its ``<physics>`` [m/s^2], shape (3,)."""
    world = root.find("world")
    if world is None:
        return None
    paths = ("gravity",) if version >= (1, 6) else ("gravity", "physics/gravity")
    texts = {" ".join((part.text or "").split()) for path in paths for part in world.findall(path)} - {""}
    if len(texts) > 1:
        raise ModelError(f"the world has several gravities: {'; '.join(sorted(texts))}", expected="one")
    if not texts:
        notes.append(f"the world has no <gravity>, and by the format {GRAVITY} m/s^2")
    return numbers(next(iter(texts), GRAVITY), 3, "gravity")


def _gears(
    elements: Sequence[Element], frames: Frames, version: tuple[int, int], hung: Sequence[SdfJoint]
) -> dict[str, Gear]:
    """Return the gears that the gearboxes of a model are, by name."""
    hinges = [
        Hinge(joint.name, joint.parent, joint.child, joint.place.rotation @ joint.steps[0].axis)
        for joint in hung
        if joint.kind in ("revolute", "continuous")
    ]
    boxes = [element for element in elements if element.get("type") == GEARBOX]
    return {str(box.get("name")): gear_of(box, frames, version, hinges) for box in boxes}


def _version(root: Element) -> tuple[int, int]:
    written = root.get("version", "")
    first, _, second = written.partition(".")
    second = second.partition(".")[0]
    if first != "1" or not second.isdecimal() or not second.isascii() or int(second[:4]) < 4:
        raise ModelError(
            f"the model is SDF of version '{written}'",
            expected="1.4 to 1.12",
            hint="a newer version, as 'gz sdf -p' writes it",
        )
    return 1, int(second[:4])


def _model(root: Element, name: str, notes: list[str]) -> Element:
    models = [(holder, model) for holder in (root, *root.findall("world")) for model in holder.findall("model")]
    chosen = [(holder, model) for holder, model in models if model.get("name", "") == name] if name else models
    if len(chosen) > 1:
        moves = './/joint[@type!="fixed"]'
        chosen = [(holder, model) for holder, model in chosen if model.find(moves) is not None]
    if len(chosen) != 1:
        names = [model.get("name", "") for _, model in models]
        expected, hint = choices(name, names) if names else ("one <model>, in <sdf> or in a <world>", "")
        said = f"the file has no model '{name}'" if name and models else f"the file has {len(models)} models"
        raise ModelError(said, expected=expected, hint=hint or ("model: NAME in the mechanism file" if names else ""))
    (home, model), others = chosen[0], [other for _, other in models if other is not chosen[0][1]]
    if others:
        notes.append(
            f"not read, beside the model '{model.get('name', '')}': "
            f"{listed('model', [other.get('name', '') for other in others])}"
        )
    for holder in [root, *root.findall("world")]:
        holder[:] = [
            child for child in holder if child is model or child is home or child.tag not in ("model", "world")
        ]
    if any(model.find(tag) is not None for tag in ("include", "model")):
        raise ModelError(
            "the model is made of other models",
            expected="one <model> with links and joints",
            hint="one without <include> and nested <model>, as 'gz sdf -p' writes it",
        )
    return model


SOLIDS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "ellipsoid": ("radii",),
}
"""Shape of a ``<geometry>`` -> the elements with its sizes [m]."""

WATER = 1000.0
"""Density of a collision that gives none [kg/m^3]."""


def _solids(link: Element, inertial: Element, where: str) -> pin.Inertia:
    """Return the inertia of a link with ``auto="true"``: of its collision shapes, by density, or by a mass of all."""
    total, common = pin.Inertia.Zero(), number_in(inertial, "density", WATER, where)
    for collision in link.findall("collision"):
        part = f"{where}: collision '{collision.get('name', '')}'"
        shape = next((shape for shape in collision.findall("geometry/*") if shape.tag in SOLIDS), None)
        if shape is None:
            raise ModelError(
                f"{part}: the mass of its shape is not computed",
                expected=f"one of {', '.join(SOLIDS)}",
                hint="<mass> and <inertia> in the <inertial> of the link",
            )
        words = " ".join(text_of(shape, tag) for tag in SOLIDS[shape.tag])
        sizes = numbers(words, 3 if shape.tag in ("box", "ellipsoid") else len(SOLIDS[shape.tag]), f"{part}: size")
        halved = {"box": [0.5] * 3, "cylinder": [1.0, 0.5], "capsule": [1.0, 0.5]}.get(shape.tag, 1.0)
        density = number_in(collision, "density", common, part)
        if density < 0.0 or not (sizes > 0.0).all():
            raise ModelError(f"{part}: its density or a size of it is not positive")
        base, place = pose_of(collision, "", part)
        if base:
            raise ModelError(f"{part}: its pose is relative to '{base}'", expected="the link itself")
        total += place.act(solid_inertia(shape.tag, sizes * halved, density))
    if not total.mass:
        raise ModelError(f"{where}: its inertia is that of its collisions, and they have no mass")
    mass = number_in(inertial, "mass", total.mass, where)
    return body_inertia(mass, pin.SE3(np.eye(3), total.lever), total.inertia * (mass / total.mass), where)


def _inertia(link: Element, defects: list[str], notes: list[str]) -> pin.Inertia:
    """Return the inertia of a link about its frame; 1 kg and 1 kg*m^2 where the file gives none."""
    where, inertial = f"link '{link.get('name')}'", link.find("inertial")
    if not is_true(link.findtext("gravity"), f"{where}: gravity", default=True):
        notes.append(f"{where}: gravity acts on it, though the model switches it off")
    if inertial is None:
        notes.append(f"{where}: it has no <inertial>, and by the format 1 kg and moments of 1 kg*m^2")
    elif is_true(inertial.get("auto"), f"{where}: auto"):
        return _solids(link, inertial, where)
    elif missing := [tag for tag in ("mass", *(f"inertia/{key}" for key in MOMENTS)) if not inertial.findtext(tag)]:
        amounts = "1 kg" if missing == ["mass"] else "1 kg*m^2" if "mass" not in missing else "1 kg and 1 kg*m^2"
        notes.append(f"{where}: its <inertial> has no {', '.join(missing)}, and by the format {amounts}")
    diagonal = [number_in(inertial, f"inertia/{key}", 1.0, where) for key in MOMENTS]
    moments = symmetric(
        *diagonal, *(number_in(inertial, f"inertia/{key}", 0.0, where) for key in ("ixy", "ixz", "iyz"))
    )
    if wrong := inertia_defect(moments):
        defects.append(f"{where}: {wrong}")
    base, place = ("", pin.SE3.Identity()) if inertial is None else pose_of(inertial, "", f"{where}: inertial")
    if base:
        raise ModelError(f"{where}: the pose of its inertia is relative to '{base}'", expected="the link itself")
    return body_inertia(number_in(inertial, "mass", 1.0, where), place, moments, where)
