"""Settings of a whole MJCF model: units, conventions, default classes; readers of its attributes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError, choices
from pinarm.input.numbers import decimal
from pinarm.input.yaml.schema import LARGEST
from pinarm.mechanics.loading.mjcf_names import ACTUATORS
from pinarm.mechanics.loading.model_tree import from_z

Attributes = Mapping[str, str]

ACTUATOR = "actuator"
"""Entry of the attributes that all kinds of actuators have in common in a class."""

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
SWITCHES = {"gravity", "passive", "spring", "damper", "frictionloss", "constraint", "equality"}


@dataclass(frozen=True)
class Settings:
    """The ``<compiler>`` and ``<option>`` sections, as far as they affect the motion of rigid bodies.

    Attributes:
        angle: Unit of angles [rad]: 1, or pi/180.
        sequence: Axes of Euler angles: lower case about body axes, upper case about fixed axes.
        limits_by_range: Whether a range is a limit without ``limited="true"`` (``autolimits``).
        source: Source of inertias: ``inertial``, ``geoms``, or ``auto``: ``inertial`` where given, else geoms.
        groups: First and last group of the geoms with mass.
        least_mass: Lower bound of the mass of every body [kg].
        least_inertia: Lower bound of the principal moments of every body [kg*m^2].
        balances: Whether moments that no body can have are replaced by their mean (``balanceinertia``).
        total_mass: Total to which all masses are scaled [kg]; 0 for no scaling.
        fuses: Whether bodies that do not move become part of the world (``fusestatic``), which has no mass.
        aligns: Whether MuJoCo moves the frames of free bodies to their inertia (``alignfree``).
        gravity: Gravity field [m/s^2], world axes, shape (3,).
        off: The disabled ones of ``SWITCHES``.
        classes: Attributes by class and element, inherited ones included.
    """

    angle: float
    sequence: str
    limits_by_range: bool
    source: str
    groups: tuple[float, float]
    least_mass: float
    least_inertia: float
    balances: bool
    total_mass: float
    fuses: bool
    aligns: bool
    gravity: Array
    off: frozenset[str]
    classes: Mapping[str, Mapping[str, Attributes]] = field(repr=False)

    @classmethod
    def of(cls, model: Element) -> Settings:
        """Read the sections of a model.

        Raises:
            ModelError: A value is malformed, or a convention is not supported.
        """
        compiler = _merged(model.findall("compiler"))
        option = _merged(model.findall("option"))
        flags = _merged([flag for section in model.findall("option") for flag in section.findall("flag")])
        if compiler.get("coordinate", "local") != "local":
            raise ModelError("the model has global coordinates", expected='<compiler coordinate="local"/>')
        sequence = compiler.get("eulerseq", "xyz")
        if len(sequence) != 3 or not set(sequence.lower()) <= set("xyz"):
            raise ModelError(f"eulerseq is '{sequence}'", expected="three of x, y, z")
        source = {"auto": "auto", "true": "geoms", "false": "inertial"}[
            one_of(compiler, "inertiafromgeom", ("auto", "true", "false"), "<compiler>")
        ]
        first, last = numbers(compiler, "inertiagrouprange", "<compiler>", 2, (0.0, 5.0))
        degrees = one_of(compiler, "angle", ("degree", "radian"), "<compiler>") == "degree"
        least_mass, least_inertia = (number(compiler, key, "<compiler>", 0.0) for key in ("boundmass", "boundinertia"))
        return cls(
            math.pi / 180.0 if degrees else 1.0, sequence,
            one_of(compiler, "autolimits", ("true", "false"), "<compiler>") == "true", source, (first, last),
            least_mass, least_inertia, one_of(compiler, "balanceinertia", ("false", "true"), "<compiler>") == "true",
            max(0.0, number(compiler, "settotalmass", "<compiler>", 0.0)),
            one_of(compiler, "fusestatic", ("false", "true"), "<compiler>") == "true",
            one_of(compiler, "alignfree", ("false", "true"), "<compiler>") == "true",
            numbers(option, "gravity", "<option>", 3, (0.0, 0.0, -9.81)),
            frozenset(name for name in SWITCHES if flags.get(name) == "disable"), _classes(model),
        )  # fmt: skip

    def attributes(self, element: Element, childclass: str, kind: str = "") -> Attributes:
        """Return the attributes of an element, with those of its default class where it has none.

        Args:
            element: An element, such as a joint.
            childclass: Default class of the body, for elements without ``class``.
            kind: Name of such elements in default classes; the element's tag if empty.

        Raises:
            ModelError: There is no class of that name.
        """
        name = element.get("class", childclass)
        if name not in self.classes:
            expected, hint = choices(name, self.classes)
            raise ModelError(f"there is no default class '{name}'", expected=expected, hint=hint)
        return _overridden(self.classes[name].get(kind or element.tag, {}), element.attrib)

    def placement(self, given: Attributes, where: str) -> pin.SE3:
        """Return the placement from ``pos`` and one of the ``ORIENTATIONS``."""
        return pin.SE3(self.rotation(given, where), numbers(given, "pos", where, 3, (0.0, 0.0, 0.0)))

    def shape_placement(self, given: Attributes, where: str) -> tuple[pin.SE3, float | None]:
        """Return the placement of a geom or site, and half of the length that ``fromto`` gives it.

        With ``fromto`` it lies in the middle, its z from the second point to the first, whatever the orientation of
        its class.

        Raises:
            ModelError: There is a ``pos`` beside ``fromto``, or it is a sphere, or both points are the same.
        """
        if "fromto" not in given:
            return self.placement(given, where), None
        if "pos" in given:
            raise ModelError(f"{where}: its place is given by pos and fromto", expected="one of them, in its class too")
        if given.get("type", "sphere") == "sphere":
            raise ModelError(f"{where}: a sphere has no fromto", expected="a capsule, cylinder, ellipsoid or box")
        ends = numbers(given, "fromto", where, 6)
        back = ends[:3] - ends[3:]
        if not (length := float(np.linalg.norm(back))):
            raise ModelError(f"{where}: fromto='{given['fromto'][:60]}' has no length")
        return pin.SE3(from_z(back / length), (ends[:3] + ends[3:]) / 2), length / 2

    def rotation(self, given: Attributes, where: str) -> Array:
        """Return an orientation as a matrix, shape (3, 3).

        Raises:
            ModelError: It is given twice, or has no direction.
        """
        ways = [key for key in ORIENTATIONS if key in given]
        if len(ways) > 1:
            raise ModelError(f"{where}: its orientation is given by {' and '.join(ways)}", expected="one of them")
        if not ways:
            return np.eye(3)
        way = ways[0]
        values = numbers(given, way, where, {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}[way])
        if way == "euler":
            return self._euler(values)
        if not values[:3].any() and not (way == "quat" and values.any()):
            raise ModelError(f"{where}: {way}='{given[way]}' has no direction")
        if way == "quat":
            w, x, y, z = unit(values)
            return np.asarray(pin.Quaternion(w, x, y, z).matrix())
        if way == "axisangle":
            return np.asarray(pin.exp3(unit(values[:3]) * values[3] * self.angle))
        if way == "zaxis":
            return from_z(unit(values))
        x, second = unit(values[:3]), unit(values[3:]) if values[3:].any() else np.zeros(3)
        y = second - (x @ second) * x
        if np.linalg.norm(y) < 1e-9:
            raise ModelError(f"{where}: the axes of xyaxes='{given[way]}' are parallel")
        y /= np.linalg.norm(y)
        return np.array([x, y, np.cross(x, y)]).T

    def _euler(self, angles: Array) -> Array:
        turn = np.eye(3)
        for letter, angle in zip(self.sequence, angles, strict=True):
            step = pin.exp3(np.eye(3)["xyz".index(letter.lower())] * angle * self.angle)
            turn = turn @ step if letter.islower() else step @ turn
        return turn


def number(given: Attributes, key: str, where: str, default: float | None = None) -> float:
    """Return an attribute that is one number; see ``numbers``."""
    return float(numbers(given, key, where, 1, None if default is None else (default,))[0])


def numbers(given: Attributes, key: str, where: str, count: int, default: Sequence[float] | None = None) -> Array:
    """Return an attribute with ``count`` finite numbers, shape (count,).

    Raises:
        ModelError: It is missing without a default, malformed, or beyond ``LARGEST``.
    """
    if key not in given:
        if default is None:
            raise ModelError(f"{where}: {key} is missing")
        return np.array(default, float)
    text = given[key]
    try:
        values = np.array([decimal(part) for part in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not (np.abs(values) <= LARGEST).all():
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ModelError(f"{where}: {key}='{text[:60]}' is not what is read here",
                         expected=f"{wanted}, at most {LARGEST:g}")  # fmt: skip
    return values


def one_of(given: Attributes, key: str, words: Sequence[str], where: str) -> str:
    """Return an attribute with one of the given words; the first is the default.

    Raises:
        ModelError: It is another word.
    """
    word = given.get(key, words[0])
    if word not in words:
        raise ModelError(f"{where}: {key} is '{word}'", expected=f"one of {', '.join(words)}")
    return word


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
        for name, elements in _class(top, classes[""]):
            classes[name] = elements
        classes[""] = classes[top.get("class", "main")]
    return classes


def _class(element: Element, above: Mapping[str, Attributes]) -> Iterator[tuple[str, Mapping[str, Attributes]]]:
    """Yield a default class and the classes in it, each with its inherited attributes."""
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
