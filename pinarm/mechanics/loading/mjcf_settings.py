"""Names of MJCF, settings of a whole model (units, conventions, default classes), and placements by its attributes.

The names are those of MuJoCo 4.0.0 (``mj_printSchema``), and older ones that it dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError
from pinarm.input.xml_text import format_names
from pinarm.mechanics.loading.model_tree import from_z
from pinarm.mechanics.loading.values import ZERO, Part, known, rotation

ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "orientation", "pid", "damper", "cylinder", "muscle",
    "adhesion", "dcmotor", "plugin",
)  # fmt: skip
"""Kinds of actuators, with a class's attributes in common."""

GENERATED = ("replicate", "attach", "composite", "flexcomp", "flex", "plugin")
"""Elements from which MuJoCo generates bodies."""

ORIENTED = "pos quat axisangle xyaxes zaxis euler"
EQUALITY = "name class active solimp solref"
DRIVES = " ".join(f"{kind}=drive*" for kind in ACTUATORS)
IN_BODY = (
    "inertial* joint* freejoint* geom* site* frame* body* camera- light- "
    + " ".join(f"{tag}-" for tag in GENERATED)  # refused by the reader
)

MJCF = format_names({
    "mujoco": "model > compiler* option* default* worldbody* equality* actuator* asset- visual- statistic- size- "
              "custom- tendon- keyframe- extension- deformable-",
    "compiler":
        "angle autolimits eulerseq coordinate inertiafromgeom inertiagrouprange boundmass boundinertia settotalmass "
        "fusestatic strippath meshdir texturedir assetdir discardvisual usethread fitaabb alignfree saveinertial "
        "conflict passthrough savecanonical savecompiled convexhull exactmeshinertia balanceinertia > lengthrange-",
    "option":
        "gravity density viscosity wind magnetic timestep apirate impratio tolerance ls_tolerance noslip_tolerance "
        "ccd_tolerance mpr_tolerance sleep_tolerance o_margin o_solref o_solimp o_friction integrator collision cone "
        "jacobian solver iterations ls_iterations noslip_iterations ccd_iterations mpr_iterations sdf_iterations "
        "sdf_initpoints actuatorgroupdisable > flag*",
    "flag":
        "gravity passive spring damper frictionloss constraint equality limit contact clampctrl warmstart filterparent "
        "actuation refsafe sensor midphase eulerdamp autoreset nativeccd island override energy fwdinv invdiscrete "
        "multiccd sensornoise diagexact ipc sleep speculative",
    "default": f"class > default* joint* geom* site* equality=constraint* {DRIVES} mesh- material- texture- camera- "
               "light- pair- tendon-",
    "worldbody": f"name > {IN_BODY}",
    "body": f"{ORIENTED} name childclass mocap gravcomp user sleep simple fuse > {IN_BODY}",
    "frame": f"{ORIENTED} name childclass > {IN_BODY}",
    "inertial": f"{ORIENTED} mass diaginertia fullinertia",
    "joint":
        "name class type pos axis range limited actuatorfrcrange actuatorfrclimited ref springref stiffness damping "
        "springdamper armature frictionloss group user margin solreflimit solimplimit solreffriction solimpfriction",
    "freejoint": "name group align",
    "geom":
        f"{ORIENTED} name class type size mass density fromto group mesh shellinertia contype conaffinity condim "
        "priority friction solmix margin gap fitscale rgba user hfield material fluidshape fluidcoef adhesion "
        "castshadow surfacevel solimp solref > plugin-",
    "site": f"{ORIENTED} name class type group size material mesh fromto rgba user",
    "equality": "> joint=coupled* connect=tie* weld=tie* tendon- flex- flexvert- flexstrain- distance-",
    "constraint": EQUALITY,
    "coupled": f"{EQUALITY} joint1 joint2 polycoef",
    "tie": f"{EQUALITY} body1 body2 site1 site2 anchor relpose torquescale",
    "actuator": f"> {DRIVES}",
    "drive":
        "name class joint jointinparent site refsite body tendon cranksite slidersite lengthrange plugin instance "
        "armature damping gear group user cranklength ctrllimited ctrlrange forcelimited forcerange actlimited "
        "actrange actearly actdim delay interp nsample input ffrange velrange posrange inheritrange dyntype gaintype "
        "biastype dynprm gainprm biasprm kp kv ki imax slewmax dampratio timeconst tausmooth area diameter bias range "
        "force scale lmin lmax vmax fpmax fvmax gain cogging controller inductance lugre motorconst nominal "
        "resistance saturation thermal > config-",
})  # fmt: skip
"""Names that are read, or have no part in the computation. Of actuators armature, damping and gear are read."""

Attributes = Mapping[str, str]

ACTUATOR = "actuator"
"""Entry of the attributes that all kinds of actuators have in common in a class."""

ORIENTATIONS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}
"""Attributes that say an orientation -> how many numbers they have."""


class Settings:
    """The ``<compiler>`` and ``<option>`` sections and default classes, as far as they affect rigid bodies.

    Attributes:
        off: Flags of features that are switched off.
        classes: Default class -> kind of element -> its attributes.
    """

    def __init__(self, model: Element) -> None:
        self.compiler = Part.of("<compiler>", *model.findall("compiler"))
        self.option = Part.of("<option>", *model.findall("option"))
        flags = Part.of("<flag>", *model.findall("option/flag")).texts
        self.off = {name for name, text in flags.items() if text == "disable"}
        self.classes = _classes(model)
        if self.compiler.texts.get("coordinate", "local") != "local":
            raise ModelError("the model has global coordinates", expected='<compiler coordinate="local"/>')
        sequence = self.compiler.texts.get("eulerseq", "xyz")
        if len(sequence) != 3 or not set(sequence.lower()) <= set("xyz"):
            raise ModelError(f"eulerseq is '{sequence}'", expected="three of x, y, z")

    @cached_property
    def angle(self) -> float:
        """Unit of angles [rad]."""
        return math.radians(1.0) if self.compiler.word("angle", ("degree", "radian")) == "degree" else 1.0

    @cached_property
    def limits_by_range(self) -> bool:
        """Whether a range is a limit without ``limited="true"``."""
        return self.compiler.word("autolimits", ("true", "false")) == "true"

    def part(self, element: Element, childclass: str, where: str, kind: str = "") -> Part:
        """Return the attributes of an element, with those of its default class where it has none.

        Args:
            childclass: Default class of the body, for elements without ``class``.
            kind: Name of such elements in default classes; the element's tag if empty.
        """
        name = element.get("class", childclass)
        above = self.classes[known(name, self.classes, f"there is no default class '{name}'")]
        return Part(_overridden(above.get(kind or element.tag, {}), element.attrib), where)

    def placement(self, part: Part) -> pin.SE3:
        """Return the placement from ``pos`` and one of the ``ORIENTATIONS``."""
        return pin.SE3(self._rotation(part), part.numbers("pos", 3, ZERO))

    def shape_placement(self, part: Part) -> tuple[pin.SE3, float | None]:
        """Return the placement of a geom or site, and half of the length that ``fromto`` gives it.

        With ``fromto`` it lies in the middle, its z from the second point to the first, whatever the orientation of
        its class.
        """
        if "fromto" not in part.texts:
            return self.placement(part), None
        if "pos" in part.texts:
            raise ModelError(
                f"{part.where}: its place is given by pos and fromto", expected="one of them, in its class too"
            )
        if part.texts.get("type", "sphere") == "sphere":
            raise ModelError(f"{part.where}: a sphere has no fromto", expected="a capsule, cylinder, ellipsoid or box")
        ends = part.numbers("fromto", 6)
        back = ends[:3] - ends[3:]
        if not (length := float(np.linalg.norm(back))):
            raise ModelError(f"{part.where}: fromto='{part.texts['fromto'][:60]}' has no length")
        return pin.SE3(from_z(back / length), (ends[:3] + ends[3:]) / 2), length / 2

    def _rotation(self, part: Part) -> Array:
        """Return an orientation, which is given once at most, as a matrix, shape (3, 3)."""
        ways = [key for key in ORIENTATIONS if key in part.texts]
        if len(ways) > 1:
            raise ModelError(f"{part.where}: its orientation is given by {' and '.join(ways)}", expected="one of them")
        if not ways:
            return np.eye(3)
        way = ways[0]
        values = part.numbers(way, ORIENTATIONS[way])
        if way == "euler":
            return self._euler(values)
        if not values[:3].any() and not (way == "quat" and values.any()):
            raise ModelError(f"{part.where}: {way}='{part.texts[way]}' has no direction")
        if way == "quat":
            return rotation(*values)
        if way == "axisangle":
            return np.asarray(pin.exp3(unit(values[:3]) * values[3] * self.angle))
        if way == "zaxis":
            return from_z(unit(values))
        x, second = unit(values[:3]), unit(values[3:]) if values[3:].any() else np.zeros(3)
        y = second - (x @ second) * x
        if np.linalg.norm(y) < 1e-9:
            raise ModelError(f"{part.where}: the axes of xyaxes='{part.texts[way]}' are parallel")
        y /= np.linalg.norm(y)
        return np.array([x, y, np.cross(x, y)]).T

    def _euler(self, angles: Array) -> Array:
        """Return turns in the ``eulerseq``: lower case about body axes, upper case about fixed axes."""
        turn = np.eye(3)
        for letter, angle in zip(self.compiler.texts.get("eulerseq", "xyz"), angles, strict=True):
            step = pin.exp3(np.eye(3)["xyz".index(letter.lower())] * angle * self.angle)
            turn = turn @ step if letter.islower() else step @ turn
        return turn


def _overridden(above: Attributes, own: Attributes) -> Attributes:
    """Return the attributes of an element or class over those of the class above it.

    Another orientation takes the place of that above, in whatever way it is given; of the numbers of ``size``, those
    that are not given are those above.
    """
    turned = any(key in own for key in ORIENTATIONS)
    merged = {key: value for key, value in above.items() if not (turned and key in ORIENTATIONS)} | dict(own)
    if "size" in above and "size" in own:
        first = own["size"].split()
        merged["size"] = " ".join([*first, *above["size"].split()[len(first) :]])
    return merged


def _classes(model: Element) -> dict[str, Mapping[str, Attributes]]:
    classes: dict[str, Mapping[str, Attributes]] = {"": {}}
    for top in model.findall("default"):
        classes.update(_class(top, classes[""]))
        classes[""] = classes[top.get("class", "main")]
    return classes


def _class(element: Element, above: Mapping[str, Attributes]) -> Iterator[tuple[str, Mapping[str, Attributes]]]:
    own = dict(above)
    for child in element:
        if child.tag != "default":
            kind = ACTUATOR if child.tag in ACTUATORS else child.tag
            own[kind] = _overridden(own.get(kind, {}), child.attrib)
    yield element.get("class", "main"), own
    for child in element.findall("default"):
        if "class" not in child.attrib:
            raise ModelError("a default class has no name", expected='<default class="...">')
        yield from _class(child, own)
