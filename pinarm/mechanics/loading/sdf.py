"""Reader of SDF models: a tree of joints, loop joints where a link has several parents, and gears.

A universal joint is two revolute joints in a row, ``NAME.axis`` and ``NAME.axis2``. A screw is a slide ``NAME.slide``
and a revolute joint ``NAME``, tied by a coupling of its lead. A gearbox moves no link, and couples two joints on one
body: with theta_1 the angle from the reference body to the parent about ``<axis>``, and theta_2 that from the reference
body to the child about ``<axis2>``, ``theta_2 = -gearbox_ratio theta_1``.

The tree takes joints in the order of the file, from the world outwards. A joint between links that both hang in the
tree already closes a loop; one that leads from a link to its own parent is turned round, and keeps its coordinate. A
model that no joint ties to the world floats.

Sources: the specification of SDFormat, versions 1.4 to 1.12 (sdformat.org/spec), and its pose frame semantics: a link
is placed in the model, a joint in its child, a frame in what it is attached to, unless ``relative_to`` says another
frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import TypeVar
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError, choices, listed
from pinarm.input.xml_text import MAX_LINKS, bound, check_names, counted, format_names, meant_by
from pinarm.mechanics.loading.model_tree import Bounds, Kind, Mimic, Tree, TreeJoint, depth_first
from pinarm.mechanics.loading.values import DIAGONAL, Part, known, rotation
from pinarm.records import Record, ValueRecord, replace

SDF = format_names({
    "sdf": "version > model* world* light- actor-",
    "world": "name > model* gravity frame* audio- atmosphere- gui- physics- scene- light- spherical_coordinates- "
             "state- magnetic_field- population- road- wind-",
    "model": "name canonical_link placement_frame > pose static link* joint* frame* self_collide- allow_auto_disable-",
    "frame": "name attached_to > pose",
    "link": "name > pose inertial gravity visual- collision- self_collide- must_be_base_link- audio_source- "
            "audio_sink-",
    "pose": "relative_to frame degrees rotation_format",
    "inertial": "auto > mass pose inertia density- auto_inertia_params-",
    "inertia": "> ixx ixy ixz iyy iyz izz",
    "joint": "name type > pose parent child axis axis2=axis gearbox_ratio gearbox_reference_body thread_pitch "
             "screw_thread_pitch",
    "axis": "> xyz use_parent_model_frame limit dynamics mimic",
    "xyz": "expressed_in",
    "limit": "> lower upper effort velocity stiffness- dissipation-",
    "dynamics": "> damping friction spring_reference spring_stiffness",
    "mimic": "joint axis > multiplier offset reference",
})  # fmt: skip
"""Names that are read, or have no part in the computation."""

Version = tuple[int, int]

LATEST: Version = (1, 7)
"""Version in whose meaning joints in ``<gazebo>`` of URDF are read: axes in the axes of the joint."""

MODEL, WORLD = "__model__", "world"
"""Names of the frame of the model, and of the fixed frame around it."""

GRAVITY = "0 0 -9.8"
"""Gravity of a world without ``<gravity>`` [m/s^2]."""

GEARBOX = "gearbox"
"""Type of the joints that move no link, and couple others."""

FREE = "root"
"""Name of the joint by which the first link of a model floats."""

LIMITLESS = 1e15
"""Limit from which on there is none: the format's own default is 1e16."""

INFINITE = ("inf", "+inf", "-inf")
"""Words for no limit."""

ALIGNED = 1e-6
"""Sine of the angle by which axes may miss being parallel, or at right angles: digits that a file prints."""

SECOND = ".axis2"
"""End of the name of the second joint of a universal one."""

Step = tuple[str, Kind, str]
_CROSS: tuple[str, tuple[Step, ...]] = "universal", ((".axis", "revolute", "axis"), (SECOND, "revolute", "axis2"))
KINDS: Mapping[str, tuple[str, tuple[Step, ...]]] = {
    "fixed": ("fixed", (("", "fixed", ""),)), "ball": ("spherical", (("", "ball", ""),)),
    "revolute": ("revolute", (("", "revolute", "axis"),)), "continuous": ("revolute", (("", "revolute", "axis"),)),
    "prismatic": ("prismatic", (("", "prismatic", "axis"),)), "universal": _CROSS, "revolute2": _CROSS,
    "screw": ("screw", ((".slide", "prismatic", ""), ("", "revolute", "axis"))),
}  # fmt: skip
"""SDF joint type -> kind of loop joint, and its simple joints from parent to child: end of the name, kind, element with
axis and limits."""

ValueT = TypeVar("ValueT")


class Frames(Record, frozen=True):
    """Frames of a model by name, or those of a world.

    Attributes:
        placed: Frame -> the frame that it is placed in, and its placement there.
        attached: Frame -> the frame that it moves with; links move with themselves.
        root: The frame in which all are placed, directly or through others.
    """

    placed: dict[str, tuple[str, pin.SE3]]
    attached: dict[str, str]
    version: Version
    root: str = MODEL

    @classmethod
    def of(cls, model: Element, version: Version) -> Frames:
        """Return the frames of a ``<model>`` element."""
        frames = cls({MODEL: (MODEL, pin.SE3.Identity())}, {}, version)
        for element in (*model.findall("link"), *model.findall("joint"), *model.findall("frame")):
            bases = {"joint": text_of(element, "child"), "frame": element.get("attached_to") or MODEL}
            base = bases.get(element.tag, MODEL)
            name = frames.add(element, base)
            frames.attached[name] = bases.get(element.tag, name)
        return frames

    @classmethod
    def around(cls, model: Element, world: Element | None, version: Version) -> Frames:
        """Return the frames that a model may be placed in: its world, those that this has, and the model itself."""
        frames = cls({WORLD: (WORLD, pin.SE3.Identity())}, {}, version, WORLD)
        for element in (model, *(world.findall("frame") if world is not None else ())):
            frames.add(element, element.get("attached_to") or WORLD)
        return frames

    def add(self, element: Element, base: str) -> str:
        """Add the frame of an element; return its name."""
        name, tag = element.get("name", ""), element.tag
        if name == WORLD or (name.startswith("__") and name.endswith("__")):
            problem = f"{tag} '{name}': this name is reserved"
            raise ModelError(problem, expected="a name that is not 'world', nor __..__")
        if name in self.placed or (not name and tag != "model"):
            raise ModelError(f"two frames have the name '{name}'" if name else f"a {tag} has no name",
                             expected="a name of its own for each link, joint and frame")  # fmt: skip
        self.placed[name] = pose_of(element, base, f"{tag} '{name}'")
        return name

    def placement(self, name: str, where: str) -> pin.SE3:
        place, chain = pin.SE3.Identity(), dict[str, None]()
        while name != self.root:
            if name in chain:
                raise ModelError(f"{where}: frames are placed in each other: {' -> '.join([*chain, name])}")
            chain[name] = None
            name, step = self._known(self.placed, name, where)
            place = step * place
        return place

    def link(self, name: str, where: str) -> str:
        """Return the link that a frame moves with."""
        chain = {name: None}
        while (base := self._known(self.attached, name, where)) != name:
            if base in chain or base == MODEL:
                problem = f"{where}: the frame '{next(iter(chain))}' is attached to no link"
                raise ModelError(problem, expected="attached_to: a link")
            chain[base], name = None, base
        return name

    def end(self, joint: Element, end: str, where: str) -> str:
        """Return the link of an end of a joint."""
        name = text_of(joint, end)
        return WORLD if name == WORLD and end != "child" else self.link(name, f"{where}: {end}")

    def axis(self, axis: Element | None, place: pin.SE3, where: str) -> Array:
        """Return an axis in the axes of a joint, shape (3,): as it says, before version 1.5 in those of the model."""
        said, xyz = Part.inside(where, axis), None if axis is None else axis.find("xyz")
        vector = Part.of(where, axis=None if xyz is None else xyz.text or "").direction("axis", (0.0, 0.0, 1.0))
        named = xyz.get("expressed_in", "") if xyz is not None else ""
        if self.version < (1, 5) or said.is_true("use_parent_model_frame"):
            named = named or MODEL
        if not named:
            return vector
        return np.asarray(place.rotation.T @ self.placement(named, f"{where}: axis").rotation @ vector)

    def _known(self, frames: Mapping[str, ValueT], name: str, where: str) -> ValueT:
        return frames[known(name, frames, f"{where}: there is no frame '{name}'")]


def pose_of(element: Element, base: str, where: str) -> tuple[str, pin.SE3]:
    """Return the frame that an element is placed in, and its placement there: as ``<pose>`` says, or at its base."""
    if (pose := element.find("pose")) is None:
        return base, pin.SE3.Identity()
    if frame := pose.get("frame"):
        raise ModelError(f"{where}: its <pose> has the attribute frame='{frame}', which no version defines",
                         hint=f'relative_to="{frame}" in version 1.7')  # fmt: skip
    quaternion = pose.get("rotation_format") == "quat_xyzw"
    said = Part.of(where, pose, pose=pose.text or "0 " * 6 + "1" * quaternion)
    values = said.numbers("pose", 7 if quaternion else 6)
    if not quaternion:
        turn = pin.rpy.rpyToMatrix(np.deg2rad(values[3:]) if said.is_true("degrees") else values[3:])
    elif values[3:].any():
        x, y, z, w = values[3:]
        turn = rotation(w, x, y, z)
    else:
        raise ModelError(f"{where}: its pose has the quaternion 0")
    return pose.get("relative_to") or base, pin.SE3(turn, values[:3])


def text_of(element: Element, path: str) -> str:
    """Return the text in an element, without spaces around it; empty where there is none."""
    return (element.findtext(path) or "").strip()


def sdf_tree(root: Element, name: str = "") -> Tree:
    """Return the tree of an ``<sdf>`` element.

    Args:
        name: Name of the model; where it is empty the only one, or the only one with joints that move.
    """
    tree, version = Tree(""), _version(root)
    model = _model(root, name, tree)
    tree.name = model.get("name", "")
    unread = check_names(root, SDF)
    for pose in root.iter("pose") if version < (1, 7) else ():  # its attribute before version 1.7
        if "frame" in pose.attrib and "relative_to" not in pose.attrib:
            pose.set("relative_to", pose.attrib.pop("frame"))
    frames = Frames.of(model, version)
    bodies = {str(link.get("name")): _inertia(link, tree) for link in model.findall("link")}
    if not bodies:
        raise ModelError("the model has no link")
    bound("links", len(bodies), MAX_LINKS)
    places = {link: frames.placement(link, f"link '{link}'") for link in bodies}
    stand = Frames.around(model, root.find("world"), version).placement(tree.name, "the model")
    if placed := model.get("placement_frame"):
        stand = stand * frames.placement(placed, "placement_frame").inverse()
    elements = model.findall("joint")
    joints = [joint_in(element, frames, tree) for element in elements if element.get("type") != GEARBOX]
    static = Part.inside("the model", model).is_true("static")
    if static and (moving := [joint.name for joint in joints if joint.kind != "fixed"]):
        problem = f"the model is static, and {listed('joint', moving)} moves"
        raise ModelError(problem, expected="fixed joints alone, or no <static>")
    around = {WORLD: stand.inverse(), **places}
    _span(tree, joints, around, stand, fixed=static)
    tree.links |= {link: bodies[link] for link in tree.links if link in bodies}
    _couple(tree, [element for element in elements if element.get("type") == GEARBOX], frames, around)
    if unread:
        tree.notes.append(f"not read: {counted(unread)}")
    tree.gravity = _gravity(root, version, tree)
    return tree


def _version(root: Element) -> Version:
    written = root.get("version", "")
    first, second, *_ = [*written.split("."), ""]
    if first != "1" or not second.isdecimal() or not second.isascii() or int(second[:4]) < 4:
        raise ModelError(
            f"the model is SDF of version '{written}'",
            expected="1.4 to 1.12",
            hint="a newer version, as 'gz sdf -p' writes it",
        )
    return 1, int(second[:4])


def _model(root: Element, name: str, tree: Tree) -> Element:
    """Return the model that is asked for; the others, and other worlds, leave the document."""
    homes = [root, *root.findall("world")]
    models = [(home, model) for home in homes for model in home.findall("model")]
    chosen = [(home, model) for home, model in models if not name or model.get("name", "") == name]
    if len(chosen) > 1:
        chosen = [(home, model) for home, model in chosen if model.find('.//joint[@type!="fixed"]') is not None]
    if len(chosen) != 1:
        names = [model.get("name", "") for _, model in models]
        expected, hint = choices(name, names) if names else ("one <model>, in <sdf> or in a <world>", "")
        said = f"the file has no model '{name}'" if name and models else f"the file has {len(models)} models"
        raise ModelError(said, expected=expected, hint=hint or ("model: NAME in the mechanism file" if names else ""))
    [(home, model)] = chosen
    others = [other.get("name", "") for _, other in models if other is not model]
    tree.remark(f"not read, beside the model '{model.get('name', '')}'", *others)
    for holder in homes:
        holder[:] = [part for part in holder if part in (model, home) or part.tag not in ("model", "world")]
    if any(model.find(tag) is not None for tag in ("include", "model")):
        raise ModelError(
            "the model is made of other models",
            expected="one <model> with links and joints",
            hint="one without <include> and nested <model>, as 'gz sdf -p' writes it",
        )
    return model


def _gravity(root: Element, version: Version, tree: Tree) -> Array | None:
    """Return the gravity of the world, before version 1.6 of its ``<physics>`` [m/s^2], shape (3,)."""
    if (world := root.find("world")) is None:
        return None
    paths = ("gravity",) if version >= (1, 6) else ("gravity", "physics/gravity")
    texts = {" ".join((part.text or "").split()) for path in paths for part in world.findall(path)} - {""}
    if len(texts) > 1:
        raise ModelError(f"the world has several gravities: {'; '.join(sorted(texts))}", expected="one")
    if not texts:
        tree.notes.append(f"the world has no <gravity>, and by the format {GRAVITY} m/s^2")
    return Part({"gravity": next(iter(texts), GRAVITY)}, "the world").numbers("gravity", 3)


def _inertia(link: Element, tree: Tree) -> pin.Inertia:
    """Return the inertia of a link about its frame; 1 kg and 1 kg*m^2 where the file gives none."""
    where, inertial = f"link '{link.get('name')}'", link.find("inertial")
    if not Part.inside(where, link).is_true("gravity", default=True):
        tree.notes.append(f"{where}: gravity acts on it, though the model switches it off")
    if inertial is None:
        tree.notes.append(f"{where}: it has no <inertial>, and by the format 1 kg and moments of 1 kg*m^2")
        return tree.body(1.0, pin.SE3.Identity(), np.eye(3), where)
    said = Part.inside(where, inertial, inertial.find("inertia"))
    if Part.of(where, inertial).is_true("auto"):
        raise ModelError(
            f"{where}: its inertia is to be computed of its collisions (auto), which is not read",
            expected="<mass> and <inertia> in its <inertial>",
        )
    if missing := [key for key in ("mass", *DIAGONAL) if key not in said.texts]:
        amounts = "1 kg" if missing == ["mass"] else "1 kg*m^2" if "mass" not in missing else "1 kg and 1 kg*m^2"
        tree.notes.append(f"{where}: its <inertial> has no {', '.join(missing)}, and by the format {amounts}")
    place = _pose_in_link(inertial, f"{where}: inertial")
    return tree.body(said.number("mass", 1.0), place, said.moments(1.0), where)


def _pose_in_link(element: Element, where: str) -> pin.SE3:
    base, place = pose_of(element, "", where)
    if base:
        raise ModelError(f"{where}: its pose is relative to '{base}'", expected="the link itself")
    return place


class SdfJoint(ValueRecord, frozen=True):
    """A joint of an SDF file.

    Attributes:
        kind: Its type in the file.
        place: Its placement in the model.
        steps: Its simple joints from the parent to the child, each with its axis in the joint's axes.
        lead: Way per turn of a screw, positive for a right-handed thread [m]; 0 of other joints.
    """

    name: str
    kind: str
    parent: str
    child: str
    place: pin.SE3
    steps: tuple[TreeJoint, ...]
    lead: float
    mimics: tuple[Mimic, ...]

    def hung(self, parent: str, child: str, placed: Mapping[str, pin.SE3]) -> list[TreeJoint]:
        """Return its simple joints between two links of a tree, of which ``parent`` is nearer to the root.

        Where the tree leads from the joint's child to its parent they follow each other in the opposite order, with
        opposite axes: coordinates stay those of the file.

        ``placed`` has the placement of every link in the model.
        """
        outwards = parent == self.parent
        steps = self.steps if outwards else [replace(step, axis=-step.axis) for step in reversed(self.steps)]
        ends = [parent, *(f"{self.name}/{number}" for number in range(1, len(steps))), child]
        places = [placed[parent].actInv(self.place), *[pin.SE3.Identity()] * (len(steps) - 1)]
        hung = [
            replace(step, parent=ends[k], child=ends[k + 1], placement=place, made_for=self.name)
            for k, (step, place) in enumerate(zip(steps, places, strict=True))
        ]
        return [*hung[:-1], replace(hung[-1], offset=self.place.actInv(placed[child]), made_for="")]

    def close(self, tree: Tree, placed: Mapping[str, pin.SE3]) -> None:
        """Close a loop of the tree by it."""
        kind, axes = KINDS[self.kind][0], [tuple(step.axis.tolist()) for step in self.steps]
        keys: dict[str, object] = {"axis": axes[-1]} if kind not in ("fixed", "spherical", "universal") else {}
        if kind == "universal":
            keys["axes"] = axes[0], axes[1]
            if abs(self.steps[0].axis @ self.steps[1].axis) > ALIGNED:
                raise ModelError(
                    f"joint '{self.name}': it closes a loop, and its axes are not at right angles",
                    expected="axes at right angles, or another joint of the loop that closes it",
                )
        if kind == "screw":
            keys["lead"] = self.lead
        ends = [(link, placed[link].actInv(self.place)) for link in (self.parent, self.child)]
        tree.close(self.name, kind, ends, **keys)
        if self.mimics or any(x.bounds != Bounds() or x.damping or x.friction or x.stiffness for x in self.steps):
            tree.remark("limits, damping, friction and springs of joints that close loops are not modelled", self.name)


def joint_in(joint: Element, frames: Frames, tree: Tree) -> SdfJoint:
    """Return the joint of an element that is no gearbox; its frame is among those of the model."""
    name, kind_name = str(joint.get("name")), joint.get("type", "")
    where = f"joint '{name}'"
    known(kind_name, [*KINDS, GEARBOX], f"{where}: a joint of type '{kind_name}' is not read")
    place = frames.placement(name, where)
    parent, child = (frames.end(joint, end, where) for end in ("parent", "child"))
    if parent == child:
        raise ModelError(f"{where}: it joins '{child}' to itself")
    steps, mimics = [], []
    for end, kind, tag in KINDS[kind_name][1]:
        step = TreeJoint(name + end, kind, parent, child, pin.SE3.Identity())
        if kind not in ("fixed", "ball"):
            step = replace(step, axis=frames.axis(joint.find(tag or "axis"), place, where))
        axis = joint.find(tag) if tag else None
        if tag:
            step = _moving(step, axis, where, tree, limited=kind_name != "continuous")
        steps.append(step)
        if axis is not None and (element := axis.find("mimic")) is not None:
            mimics.append(_mimic(element, step.name, f"{where}: mimic"))
    lead = _lead(Part.inside(where, joint), tree) if kind_name == "screw" else 0.0
    return SdfJoint(name, kind_name, parent, child, place, tuple(steps), lead, tuple(mimics))


def _moving(plain: TreeJoint, axis: Element | None, where: str, tree: Tree, *, limited: bool) -> TreeJoint:
    """Return a simple joint with the limits, damping, friction and spring of an ``<axis>``."""
    said = Part.inside(where, *(() if axis is None else (axis.find("limit"), axis.find("dynamics"))))
    lower, upper, effort, speed = (
        float(text) if (text := said.texts.get(key, "").lower()) in INFINITE else said.number(key, default)
        for key, default in (("lower", -np.inf), ("upper", np.inf), ("effort", -1.0), ("velocity", -1.0))
    )
    if limited and (lower > upper or lower >= LIMITLESS or upper <= -LIMITLESS):
        tree.notes.append(f"{where}: its limits {lower:g} to {upper:g} are none: the lower one is above the upper one")
        limited = False
    most = (value if value >= 0.0 else np.inf for value in (speed, effort))
    bounds = Bounds(
        lower if limited and lower > -LIMITLESS else -np.inf, upper if limited and upper < LIMITLESS else np.inf, *most
    )
    damping, friction, stiffness = (said.not_negative(key) for key in ("damping", "friction", "spring_stiffness"))
    rest = said.number("spring_reference", 0.0)
    return replace(plain, damping=damping, friction=friction, stiffness=stiffness, bounds=bounds, rest=rest)


def _mimic(element: Element, name: str, where: str) -> Mimic:
    """Return a relation ``q = multiplier (q_of - reference) + offset``."""
    said = Part.inside(where, element)
    multiplier, offset, reference = (
        said.number(key, x) for key, x in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
    )
    second = SECOND if element.get("axis") == "axis2" else ""
    return Mimic(name, element.get("joint", "") + second, multiplier, offset - multiplier * reference)


def _lead(said: Part, tree: Tree) -> float:
    """Return the way per turn of a screw [m]; where the file has it as rad/m it is noted."""
    for key in ("screw_thread_pitch", "thread_pitch"):
        if key not in said.texts:
            continue
        if not (pitch := said.number(key)):
            raise ModelError(f"{said.where}: its {key} is 0", expected="a number other than 0")
        if key == "screw_thread_pitch":
            return pitch
        lead = -2.0 * np.pi / pitch
        tree.notes.append(
            f"{said.where}: its thread_pitch is read as Gazebo does, in rad/m and positive for a left-handed "
            f"thread: {lead:g} m per turn; 'screw_thread_pitch' has one meaning"
        )
        return lead
    raise ModelError(f"{said.where}: a screw without a pitch", expected="<screw_thread_pitch>, in metres per turn")


def _span(
    tree: Tree, joints: Sequence[SdfJoint], placed: Mapping[str, pin.SE3], stand: pin.SE3, *, fixed: bool
) -> None:
    """Hang joints in the tree; those that it does not need close loops.

    Args:
        placed: Placements of the links, and of the world, in the model.
        stand: Placement of the model in the world.
        fixed: Whether links that no joint ties to the world are fixed to it.
    """
    at: dict[str, list[tuple[bool, int]]] = {}
    for number, joint in enumerate(joints):
        at.setdefault(joint.parent, []).append((False, number))  # outwards comes first
        at.setdefault(joint.child, []).append((True, number))
    carried, closing, hung = {joint.child for joint in joints}, dict(enumerate(joints)), list[TreeJoint]()
    for root in (WORLD, *(link for link in placed if link not in carried), *placed):
        if root in tree.links:
            continue
        if root != WORLD:
            name = f"{root}_free" if any(joint.kind == "floating" for joint in hung) else FREE
            hung.append(TreeJoint(name, "fixed" if fixed else "floating", WORLD, root, stand * placed[root]))
        tree.links[root] = pin.Inertia.Zero()
        heapify(ready := [*at.get(root, ())])
        while ready:
            joint = joints[number := heappop(ready)[1]]
            ends = joint.parent, joint.child
            if {*ends} <= tree.links.keys():
                continue
            parent, child = ends if joint.parent in tree.links else ends[::-1]
            hung += closing.pop(number).hung(parent, child, placed)
            tree.links |= {step.child: pin.Inertia.Zero() for step in hung[-len(joint.steps) :]}
            tree.mimics += joint.mimics
            if joint.lead:
                from pinarm.mechanics.couplings.kinds import Screw

                tree.couplings[joint.name] = Screw(joints=(joint.name, f"{joint.name}.slide"), lead=joint.lead)
            for item in at[child]:
                heappush(ready, item)
    tree.joints += depth_first(WORLD, hung)
    for joint in closing.values():
        joint.close(tree, placed)
    first = {joint.name: joint.steps[0].name for joint in joints if len(joint.steps) > 1 and not joint.lead}
    tree.mimics = [replace(mimic, of=first.get(mimic.of, mimic.of)) for mimic in tree.mimics]
    if free := [joint.child for joint in hung if joint.kind == "floating"]:
        tree.notes.append(
            f"no joint ties {listed('link', free)} to the world: the model floats; 'base: fixed' holds it"
        )


def _couple(tree: Tree, boxes: Iterable[Element], frames: Frames, placed: Mapping[str, pin.SE3]) -> None:
    """Couple joints of a tree by gearboxes."""
    for box in boxes:
        from pinarm.mechanics.couplings.kinds import Gear

        where = f"joint '{box.get('name')}'"
        place = frames.placement(str(box.get("name")), where)
        base, turn = frames.end(box, "gearbox_reference_body", where), place.rotation
        if not (ratio := Part.inside(where, box).number("gearbox_ratio", 1.0)):
            raise ModelError(f"{where}: its gearbox_ratio is 0", expected="a number other than 0")
        axes = ("axis", "axis" if box.find("axis2") is None else "axis2")
        (driver, sense), (follower, other) = (
            _hinge(
                tree, base, frames.end(box, end, where), turn @ frames.axis(box.find(axis), place, where), placed, where
            )
            for end, axis in zip(("parent", "child"), axes, strict=True)
        )
        tree.couplings[str(box.get("name"))] = Gear(joints=(driver, follower), ratio=-sense * other * ratio)


def _hinge(
    tree: Tree, base: str, link: str, axis: Array, placed: Mapping[str, pin.SE3], where: str
) -> tuple[str, float]:
    """Return the joint between a body and a link about an axis, and the sign of its coordinate about it."""
    for joint in tree.joints:
        if joint.kind == "revolute" and {joint.parent, joint.child} == {base, link}:
            own = placed[joint.parent].rotation @ joint.placement.rotation @ joint.axis
            if np.linalg.norm(np.cross(own, axis)) < ALIGNED:
                return joint.name, float(np.sign(own @ axis)) * (1.0 if joint.parent == base else -1.0)
    raise ModelError(
        f"{where}: no revolute joint of the tree turns '{link}' against '{base}' about the gearbox's axis",
        expected="one between its gearbox_reference_body and each of its links",
        hint="without it, a coupling of the mechanism file: couplings: {kind: gear}",
    )


def add_joints(tree: Tree, elements: Iterable[Element]) -> None:
    """Add joints of SDF to a tree of URDF, which close loops, and gearboxes; those of Gazebo's own links are noted."""
    placed = {tree.root: pin.SE3.Identity()}
    for joint in tree.joints:
        placed[joint.child] = placed[joint.parent] * joint.placement * joint.offset
    places = {link: (MODEL, place) for link, place in placed.items()}
    for element in elements:
        check_names(element, SDF)
        name, where = str(element.get("name")), f"<joint> '{element.get('name')}'"
        ends = [text_of(element, end) for end in ("parent", "child")]
        if strange := [link for link in ends if link not in placed]:
            if meant_by(strange[0], placed):
                known(strange[0], placed, f"{where}: its link '{strange[0]}' does not exist")
            tree.remark("not read, as they join links that only Gazebo has", name)
            continue
        pose = pose_of(element, ends[1], where)
        frames = Frames(
            {MODEL: (MODEL, pin.SE3.Identity()), **places, name: pose}, {link: link for link in placed}, LATEST
        )
        if element.get("type") == GEARBOX:
            _couple(tree, [element], frames, placed)
        else:
            joint_in(element, frames, tree).close(tree, placed)
