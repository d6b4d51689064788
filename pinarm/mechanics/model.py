"""From a model's text to Pinocchio's model. The text is checked first: Pinocchio takes a NaN mass for 0 kg."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError, choices

TURNS_WITHOUT_LIMIT = 1e15
"""Limit written for joints that have none [rad]; the parser refuses infinity."""

TRIANGLE = 1e-9
"""Relative violation of the triangle inequality of the principal moments that rounding of printed digits explains."""


@dataclass(frozen=True)
class RobotModel:
    """A model as Pinocchio sees it, with what its text says and Pinocchio ignores.

    Attributes:
        model: Pinocchio's model; its joints stand depth-first.
        xml: The URDF text it was built from.
        damping: Viscous damping of the joints, N*m*s/rad or N*s/m, shape (nv,).
        notes: What is not modelled as the text has it, in words.
    """

    model: pin.Model
    xml: str
    damping: Array
    notes: tuple[str, ...]


def build_model(xml: str) -> RobotModel:
    """Build the model of a URDF text.

    Joints of type ``continuous`` become revolute without limits, so that their coordinate is an angle that counts
    turns, not a pair (cos, sin).

    Raises:
        ModelError: The text is no URDF, or has a mass, inertia or axis that no body or joint can have.
    """
    try:
        robot = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise ModelError(f"the model is not XML: {error}") from None
    if robot.tag != "robot":
        raise ModelError(f"the model begins with <{robot.tag}>", expected="<robot>: a URDF or xacro file")
    _check_links(robot)
    _check_joints(robot)
    notes = [f"joint {name}: mimics {of}, which is not enforced; both move freely" for name, of in _mimics(robot)]
    for joint in robot.iter("joint"):
        if joint.get("type") == "continuous":
            _make_revolute(joint)
    try:
        model = pin.buildModelFromXML(ElementTree.tostring(robot, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"the model cannot be read as URDF: {' '.join(str(error).split())}") from None
    if model.nv == 0:
        raise ModelError("the model has no joint that moves", expected="at least one joint that is not fixed")
    if not model.check(model.createData()):
        raise ModelError("the model's joints are not in depth-first order, which the algorithms need")
    notes += [
        f"joint {model.names[joint.id]}: dry friction is not modelled"
        for joint in model.joints[1:]
        if model.friction[joint.idx_v : joint.idx_v + joint.nv].any()
    ]
    return RobotModel(model, xml, np.array(model.damping), tuple(notes))


def _check_links(robot: ElementTree.Element) -> None:
    for link in robot.iter("link"):
        where = f"link '{link.get('name')}'"
        for inertial in link.findall("inertial"):
            mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
            mass = _number(mass_element, "value", f"{where}: mass")
            if mass < 0.0:
                raise ModelError(f"{where}: the mass is negative ({mass:g} kg)")
            if inertia_element is not None:
                _check_inertia(inertia_element, where)
            origin = inertial.find("origin")
            for key in ("xyz", "rpy") if origin is not None else ():
                _vector(origin, key, f"{where}: origin of the inertia", default=(0.0, 0.0, 0.0))


def _check_inertia(element: ElementTree.Element, where: str) -> None:
    xx, yy, zz, xy, xz, yz = (
        _number(element, key, f"{where}: {key}", default=0.0) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    slack = TRIANGLE * abs(moments).max()
    if moments[0] < -slack:
        raise ModelError(f"{where}: a principal moment of inertia is negative ({moments[0]:g} kg*m^2)")
    if moments[0] + moments[1] < moments[2] - slack:
        raise ModelError(
            f"{where}: no body has principal moments of inertia {', '.join(f'{m:g}' for m in moments)} kg*m^2",
            expected="each at most the sum of the other two",
        )


def _check_joints(robot: ElementTree.Element) -> None:
    links = {str(link.get("name")) for link in robot.iter("link")}
    for joint in robot.findall("joint"):
        where = f"joint '{joint.get('name')}'"
        for end in ("parent", "child"):
            element = joint.find(end)
            name = element.get("link", "") if element is not None else ""
            if name not in links:
                expected, hint = choices(name, links)
                raise ModelError(f"{where}: its {end} link '{name}' does not exist", expected=expected, hint=hint)
        axis = joint.find("axis")
        if axis is not None and joint.get("type") != "fixed" and not any(_vector(axis, "xyz", f"{where}: axis")):
            raise ModelError(f"{where}: its axis is 0 0 0", expected="three numbers, not all zero")
        dynamics = joint.find("dynamics")
        for key in ("damping", "friction") if dynamics is not None else ():
            if _number(dynamics, key, f"{where}: {key}", default=0.0) < 0.0:
                raise ModelError(f"{where}: its {key} is negative")


Vector = tuple[float, float, float]


def _vector(element: ElementTree.Element | None, key: str, where: str, default: Vector | None = None) -> Vector:
    """Return three finite numbers, which the parser would otherwise drop with the whole element around them."""
    text = element.get(key) if element is not None else None
    if text is None and default is not None:
        return default
    try:
        x, y, z = (float(part) for part in (text or "").split())
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x) or not math.isfinite(y) or not math.isfinite(z):
        raise ModelError(f"{where}: {key}='{text or ''}' is not a vector", expected="three finite numbers")
    return x, y, z


def _number(element: ElementTree.Element | None, key: str, where: str, default: float | None = None) -> float:
    text = element.get(key) if element is not None else None
    if text is None:
        if default is None:
            raise ModelError(f"{where} is missing")
        return default
    try:
        number = float(text)
    except ValueError:
        raise ModelError(f"{where}: '{text}' is not a number") from None
    if not math.isfinite(number):
        raise ModelError(f"{where}: '{text}' is not a finite number")
    return number


def _mimics(robot: ElementTree.Element) -> Iterator[tuple[str | None, str | None]]:
    for joint in robot.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            yield joint.get("name"), mimic.get("joint")


def _make_revolute(joint: ElementTree.Element) -> None:
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ElementTree.SubElement(
            joint, "limit", effort=f"{TURNS_WITHOUT_LIMIT}", velocity=f"{TURNS_WITHOUT_LIMIT}"
        )
    limit.set("lower", f"{-TURNS_WITHOUT_LIMIT}")
    limit.set("upper", f"{TURNS_WITHOUT_LIMIT}")
