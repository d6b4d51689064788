"""Elements of URDF: numbers, vectors, axes and placements, each checked."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError
from pinarm.input.numbers import decimal, is_decimal

Vector = tuple[float, float, float]


def axis_of(axis: Element | None, where: str) -> Array:
    """Return the unit vector of an ``<axis>``, x where there is none, shape (3,).

    Raises:
        ModelError: It is 0, or no vector; ``where`` begins the message.
    """
    vector = np.array(vector_of(axis, "xyz", f"{where}: axis") if axis is not None else (1.0, 0.0, 0.0))
    if not vector.any():
        raise ModelError(f"{where}: its axis is 0 0 0", expected="three numbers, not all zero")
    return unit(vector)


def placement_of(origin: Element | None, where: str) -> pin.SE3:
    """Return the placement that ``xyz`` and ``rpy`` of an element say, the identity where there is none.

    Raises:
        ModelError: One is no vector; ``where`` begins the message.
    """
    if origin is None:
        return pin.SE3.Identity()
    xyz = vector_of(origin, "xyz", where, default=(0.0, 0.0, 0.0))
    rpy = vector_of(origin, "rpy", where, default=(0.0, 0.0, 0.0))
    return pin.SE3(pin.rpy.rpyToMatrix(np.array(rpy)), np.array(xyz))


def vector_of(element: Element | None, key: str, where: str, default: Vector | None = None) -> Vector:
    """Return the three numbers of an attribute, or the default where it is missing.

    Raises:
        ModelError: They are not three finite numbers; ``where`` begins the message.
    """
    text = element.get(key) if element is not None else None
    if text is None and default is not None:
        return default
    try:
        x, y, z = (decimal(part) for part in (text or "").split())
    except ValueError:
        x = y = z = math.nan
    if not math.isfinite(x) or not math.isfinite(y) or not math.isfinite(z):
        raise ModelError(f"{where}: {key}='{text or ''}' is not a vector", expected="three finite numbers")
    return x, y, z


def number_of(element: Element | None, key: str, where: str, default: float | None = None) -> float:
    """Return the number of an attribute, or the default where it is missing.

    Raises:
        ModelError: It is missing without a default, or no finite number; ``where`` begins the message.
    """
    text = element.get(key) if element is not None else None
    if text is None:
        if default is None:
            raise ModelError(f"{where} is missing")
        return default
    if not is_decimal(text):
        raise ModelError(f"{where}: '{text}' is not a number", expected="a decimal number such as -1.5e-3")
    number = decimal(text)
    if not math.isfinite(number):
        raise ModelError(f"{where}: '{text}' is not a finite number")
    return number
