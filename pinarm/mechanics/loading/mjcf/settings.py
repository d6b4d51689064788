"""Names of MJCF, settings of a whole model (units, conventions, default classes), and readers of its attributes.

The names are those of MuJoCo 4.0.0 (``mj_printSchema``), and older ones that it dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError, choices
from pinarm.input.xml_text import format_names
from pinarm.input.yaml.schema import LARGEST
from pinarm.mechanics.loading.model_tree import from_z
from pinarm.mechanics.loading.values import numbers, rotation, word

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


SWITCHES = ("gravity", "passive", "spring", "damper", "frictionloss", "constraint", "equality")
"""Flags that are read."""

NO, YES = ("false", "true"), ("true", "false")
"""Words of a switch, the default first."""


@dataclass(frozen=True)
class Settings:
    """The ``<compiler>`` and ``<option>`` sections, as far as they affect the motion of rigid bodies.

    Attributes:
        angle: Unit of angles [rad]: 1, or pi/180.
        sequence: Axes of Euler angles: lower case about body axes, upper case about fixed axes.
        limits_by_range: Whether a range is a limit without ``limited="true"`` (``autolimits``).
        source: Source of inertias (``inertiafromgeom``): ``false``: inertials, ``true``: geoms, ``auto``: inertials
            where given, else geoms.
        least_mass: Lower bound of the mass of every body [kg].
        least_inertia: Lower bound of the principal moments of every body [kg*m^2].
        balances: Whether moments that no body can have are replaced by their mean (``balanceinertia``).
        fuses: Whether bodies that do not move become part of the world (``fusestatic``), which has no mass.
        total_mass: Total to which all masses are scaled [kg]; 0 for no scaling.
        gravity: Gravity field [m/s^2], world axes, shape (3,).
        off: The disabled ones of ``SWITCHES``.
    """

    angle: float
    sequence: str
    limits_by_range: bool
    source: str
    groups: tuple[float, float]
    least_mass: float
    least_inertia: float
    balances: bool
    fuses: bool
    total_mass: float
    gravity: Array
    off: frozenset[str]
    classes: Mapping[str, Mapping[str, Attributes]] = field(repr=False)

    @classmethod
    def of(cls, model: Element) -> Settings:
        compiler, option = (_merged(model.findall(tag)) for tag in ("compiler", "option"))
        flags = _merged(model.findall("option/flag"))
        if compiler.get("coordinate", "local") != "local":
            raise ModelError("the model has global coordinates", expected='<compiler coordinate="local"/>')
        sequence = compiler.get("eulerseq", "xyz")
        if len(sequence) != 3 or not set(sequence.lower()) <= set("xyz"):
            raise ModelError(f"eulerseq is '{sequence}'", expected="three of x, y, z")

        def chosen(key: str, words: Sequence[str]) -> str:
            return word(compiler.get(key), words, f"<compiler>: {key}")

        first, last = numbers_in(compiler, "inertiagrouprange", "<compiler>", 2, (0.0, 5.0))
        least_mass, least_inertia, total = (
            number_in(compiler, key, "<compiler>", 0.0) for key in ("boundmass", "boundinertia", "settotalmass")
        )
        return cls(
            angle=math.pi / 180.0 if chosen("angle", ("degree", "radian")) == "degree" else 1.0, sequence=sequence,
            limits_by_range=chosen("autolimits", YES) == "true", source=chosen("inertiafromgeom", ("auto", *YES)),
            groups=(first, last), least_mass=least_mass, least_inertia=least_inertia,
            balances=chosen("balanceinertia", NO) == "true", total_mass=max(0.0, total),
            fuses=chosen("fusestatic", NO) == "true",
            gravity=numbers_in(option, "gravity", "<option>", 3, (0.0, 0.0, -9.81)),
            off=frozenset(name for name in SWITCHES if flags.get(name) == "disable"), classes=_classes(model),
        )  # fmt: skip

    def attributes(self, element: Element, childclass: str, kind: str = "") -> Attributes:
        """Return the attributes of an element, with those of its default class where it has none.

        Args:
            childclass: Default class of the body, for elements without ``class``.
            kind: Name of such elements in default classes; the element's tag if empty.
        """
        name = element.get("class", childclass)
        if name not in self.classes:
            expected, hint = choices(name, self.classes)
            raise ModelError(f"there is no default class '{name}'", expected=expected, hint=hint)
        return _overridden(self.classes[name].get(kind or element.tag, {}), element.attrib)

    def placement(self, attributes: Attributes, where: str) -> pin.SE3:
        """Return the placement from ``pos`` and one of the ``ORIENTATIONS``."""
        return pin.SE3(self._rotation(attributes, where), numbers_in(attributes, "pos", where, 3, (0.0, 0.0, 0.0)))

    def shape_placement(self, attributes: Attributes, where: str) -> tuple[pin.SE3, float | None]:
        """Return the placement of a geom or site, and half of the length that ``fromto`` gives it.

        With ``fromto`` it lies in the middle, its z from the second point to the first, whatever the orientation of
        its class.
        """
        if "fromto" not in attributes:
            return self.placement(attributes, where), None
        if "pos" in attributes:
            raise ModelError(f"{where}: its place is given by pos and fromto", expected="one of them, in its class too")
        if attributes.get("type", "sphere") == "sphere":
            raise ModelError(f"{where}: a sphere has no fromto", expected="a capsule, cylinder, ellipsoid or box")
        ends = numbers_in(attributes, "fromto", where, 6)
        back = ends[:3] - ends[3:]
        if not (length := float(np.linalg.norm(back))):
            raise ModelError(f"{where}: fromto='{attributes['fromto'][:60]}' has no length")
        return pin.SE3(from_z(back / length), (ends[:3] + ends[3:]) / 2), length / 2

    def _rotation(self, attributes: Attributes, where: str) -> Array:
        """Return an orientation, which is given once at most, as a matrix, shape (3, 3)."""
        ways = [key for key in ORIENTATIONS if key in attributes]
        if len(ways) > 1:
            raise ModelError(f"{where}: its orientation is given by {' and '.join(ways)}", expected="one of them")
        if not ways:
            return np.eye(3)
        way = ways[0]
        values = numbers_in(attributes, way, where, ORIENTATIONS[way])
        if way == "euler":
            return self._euler(values)
        if not values[:3].any() and not (way == "quat" and values.any()):
            raise ModelError(f"{where}: {way}='{attributes[way]}' has no direction")
        if way == "quat":
            return rotation(*values)
        if way == "axisangle":
            return np.asarray(pin.exp3(unit(values[:3]) * values[3] * self.angle))
        if way == "zaxis":
            return from_z(unit(values))
        x, second = unit(values[:3]), unit(values[3:]) if values[3:].any() else np.zeros(3)
        y = second - (x @ second) * x
        if np.linalg.norm(y) < 1e-9:
            raise ModelError(f"{where}: the axes of xyaxes='{attributes[way]}' are parallel")
        y /= np.linalg.norm(y)
        return np.array([x, y, np.cross(x, y)]).T

    def _euler(self, angles: Array) -> Array:
        turn = np.eye(3)
        for letter, angle in zip(self.sequence, angles, strict=True):
            step = pin.exp3(np.eye(3)["xyz".index(letter.lower())] * angle * self.angle)
            turn = turn @ step if letter.islower() else step @ turn
        return turn


def numbers_in(
    attributes: Attributes, key: str, where: str, count: int, default: Sequence[float] | None = None
) -> Array:
    """Return an attribute with ``count`` finite numbers, shape (count,)."""
    return numbers(attributes.get(key), count, f"{where}: {key}", default, most=LARGEST)


def number_in(attributes: Attributes, key: str, where: str, default: float | None = None) -> float:
    """Return an attribute that is one number."""
    return float(numbers_in(attributes, key, where, 1, None if default is None else (default,))[0])


def known(name: str, names: Iterable[str], what: str, where: str) -> str:
    """Return a name that is one of those of the model's joints, bodies or sites."""
    names = [*names]
    if name not in names:
        expected, hint = choices(name, names)
        raise ModelError(f"{where}: there is no {what} '{name}'", expected=expected, hint=hint)
    return name


def _merged(elements: Sequence[Element]) -> dict[str, str]:
    """Return the attributes of several elements; later ones take precedence."""
    return {key: value for element in elements for key, value in element.attrib.items()}


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
