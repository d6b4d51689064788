"""Numbers, words, directions, placements and solids in XML models, each checked; ``where`` begins the messages."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError
from pinarm.input.numbers import decimal
from pinarm.mechanics.loading.model_tree import inertia

FINITE = sys.float_info.max
"""Largest number."""


def numbers(
    text: str | None, count: int, where: str, default: Sequence[float] | None = None, *, most: float = FINITE
) -> Array:
    """Return the numbers in a text, shape (count,); the default where there is no text."""
    if text is None:
        if default is None:
            raise ModelError(f"{where} is missing")
        return np.array(default, float)
    try:
        values = np.array([decimal(part) for part in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not (np.abs(values) <= most).all():
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        bounded = f"{wanted}, at most {most:g}" if most < FINITE else f"{wanted} such as -1.5e-3"
        raise ModelError(f"{where}: '{text.strip()[:60]}' is not {wanted}", expected=bounded)
    return values


def number(text: str | None, where: str, default: float | None = None) -> float:
    """Return the number that a text is; see ``numbers``."""
    return float(numbers(text, 1, where, None if default is None else (default,))[0])


def not_negative(text: str | None, where: str) -> float:
    """Return the number that a text is, 0 where there is none; negative ones are refused."""
    value = number(text, where, 0.0)
    if value < 0.0:
        raise ModelError(f"{where} is negative ({value:g})", expected="0 or more")
    return value


def word(text: str | None, words: Sequence[str], where: str) -> str:
    """Return one of several words, the first where there is no text."""
    if text is not None and text not in words:
        raise ModelError(f"{where} is '{text}'", expected=f"one of {', '.join(words)}")
    return words[0] if text is None else text


def direction(vector: Array, where: str) -> Array:
    """Return a vector, shape (3,), with the length 1; 0 is refused."""
    if not vector.any():
        raise ModelError(f"{where} is 0 0 0", expected="three numbers, not all zero")
    return unit(vector)


def rotation(w: float, x: float, y: float, z: float) -> Array:
    """Return the matrix of a quaternion of any length but 0, shape (3, 3)."""
    w, x, y, z = unit(np.array([w, x, y, z]))
    return np.asarray(pin.Quaternion(w, x, y, z).matrix())


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """Return the symmetric matrix of six numbers, shape (3, 3)."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def axis_of(axis: Element | None, where: str) -> Array:
    """Return the unit vector of an ``<axis>`` of URDF, x where there is none, shape (3,)."""
    vector = np.array([1.0, 0.0, 0.0]) if axis is None else numbers(axis.get("xyz"), 3, f"{where}: axis")
    return direction(vector, f"{where}: its axis")


def placement_of(origin: Element | None, where: str) -> pin.SE3:
    """Return the placement that an element of URDF says by ``xyz`` and ``rpy``, or ``quat_xyzw`` of its version 1.2."""
    xyz, rpy = (numbers(text_in(origin, key), 3, f"{where}: {key}", (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
    if (text := text_in(origin, "quat_xyzw")) is None:
        return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    x, y, z, w = numbers(text, 4, f"{where}: quat_xyzw")
    if rpy.any() or not any((x, y, z, w)):
        raise ModelError(f"{where}: quat_xyzw='{text[:60]}' is 0, or there is an rpy too", expected="one of them")
    return pin.SE3(rotation(w, x, y, z), xyz)


def text_in(element: Element | None, key: str) -> str | None:
    """Return an attribute of an element, which need not exist."""
    return None if element is None else element.get(key)


def solid(kind: str, size: Array) -> tuple[float, Array]:
    """Return the volume of a solid [m^3], and the mean squares of x, y and z over it [m^2], shape (3,).

    Args:
        kind: ``box``, ``ellipsoid``, ``sphere``, ``cylinder`` or ``capsule``, the last two along z.
        size: Half sizes of a box, semi-axes of an ellipsoid, else the radius and half of the length between the ends
            [m]; of a capsule without its caps.
    """
    if kind == "box":
        return 8.0 * float(size.prod()), size**2 / 3
    if kind == "ellipsoid":
        return 4.0 / 3.0 * math.pi * float(size.prod()), size**2 / 5
    r = float(size[0])
    ball = 4.0 / 3.0 * math.pi * r**3
    if kind == "sphere":
        return ball, np.full(3, r * r / 5)
    half = float(size[1])
    tube, middle = math.pi * r * r * 2 * half, np.array([r * r / 4, r * r / 4, half * half / 3])
    if kind == "cylinder":
        return tube, middle
    caps = np.array([r * r / 5, r * r / 5, r * r / 5 + half * half + 0.75 * half * r])  # centroid at 3/8 r
    return ball + tube, (ball * caps + tube * middle) / (ball + tube)


def solid_inertia(kind: str, size: Array, density: float, mass: float | None = None) -> pin.Inertia:
    """Return the inertia of a solid about its centre, of its density [kg/m^3] or its mass [kg]; see ``solid``."""
    with np.errstate(over="ignore", invalid="ignore"):  # moments beyond all numbers are refused below
        volume, gyration = solid(kind, size)
        total = volume * density if mass is None else mass
        squares = total * gyration
        return inertia(total, np.zeros(3), np.diag(squares.sum() - squares))
