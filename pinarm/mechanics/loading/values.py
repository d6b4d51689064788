"""Numbers, words, directions, placements and solids in XML models, each checked."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, unit
from pinarm.errors import ModelError, choices
from pinarm.input.units import decimal
from pinarm.mechanics.loading.model_tree import inertia

ZERO, X = (0.0, 0.0, 0.0), np.array([1.0, 0.0, 0.0])

DIAGONAL, BESIDE = ("ixx", "iyy", "izz"), ("ixy", "ixz", "iyz")
"""Moments of inertia as URDF and SDF name them; ``iyx`` and so on may be given too."""

TRUTH = {"true": True, "1": True, "false": False, "0": False}
"""Words for yes and no, in capitals or not."""


class Part(NamedTuple):
    """Texts of an element by their names, and the words with which messages on it begin."""

    texts: Mapping[str, str]
    where: str

    @classmethod
    def of(cls, where: str, *elements: Element | None, **texts: str | None) -> Part:
        """Return the attributes of elements, and further texts; any of them may be missing."""
        read = {key: text for element in elements if element is not None for key, text in element.items()}
        return cls({**read, **{key: text for key, text in texts.items() if text is not None}}, where)

    @classmethod
    def inside(cls, where: str, *elements: Element | None) -> Part:
        """Return the texts in the elements within elements, such as ``<mass>2</mass>``; empty ones are missing."""
        inner = (child for element in elements if element is not None for child in element)
        return cls({child.tag: text for child in inner if (text := (child.text or "").strip())}, where)

    def numbers(self, key: str, count: int, default: Sequence[float] | None = None) -> Array:
        """Return finite numbers, shape (count,); the default where there is no text."""
        if (text := self.texts.get(key)) is None:
            if default is None:
                raise ModelError(f"{self.where}: {key} is missing")
            return np.array(default, float)
        try:
            values = np.array([decimal(word) for word in text.split()])
        except ValueError:
            values = np.empty(0)
        if len(values) != count or not np.isfinite(values).all():
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            problem = f"{self.where}: {key}: '{text.strip()[:60]}' is not {wanted}"
            raise ModelError(problem, expected=f"{wanted} such as -1.5e-3")
        return values

    def number(self, key: str, default: float | None = None) -> float:
        return float(self.numbers(key, 1, None if default is None else (default,))[0])

    def not_negative(self, key: str) -> float:
        """Return a number, 0 where there is none; negative ones are refused."""
        if (value := self.number(key, 0.0)) < 0.0:
            raise ModelError(f"{self.where}: its {key} is negative ({value:g})", expected="0 or more")
        return value

    def word(self, key: str, words: Sequence[str]) -> str:
        """Return one of several words, the first where there is no text."""
        text = self.texts.get(key, words[0])
        if text not in words:
            raise ModelError(f"{self.where}: {key} is '{text}'", expected=f"one of {', '.join(words)}")
        return text

    def is_true(self, key: str, *, default: bool = False) -> bool:
        """Return whether a text says yes; the default where there is none."""
        if not (word := self.texts.get(key, "").strip().lower()):
            return default
        return TRUTH[known(word, TRUTH, f"{self.where}: {key} is '{word}'")]

    def direction(self, key: str, default: Sequence[float] | None = None) -> Array:
        """Return the unit vector of three numbers, shape (3,)."""
        vector = self.numbers(key, 3, default)
        if not vector.any():
            raise ModelError(f"{self.where}: its {key} is 0 0 0", expected="three numbers, not all zero")
        return unit(vector)

    def moments(self, default: float | None = None) -> Array:
        """Return the matrix of inertia of URDF and SDF [kg*m^2], shape (3, 3); the default is of its diagonal."""
        moments = np.diag([self.number(key, default) for key in DIAGONAL])
        for key in BESIDE:
            i, j = ("xyz".index(letter) for letter in key[1:])
            value, twin = self.number(key, 0.0), f"i{key[2]}{key[1]}"
            if self.number(twin, value) != value:
                raise ModelError(f"{self.where}: {twin} is not {key}", expected="a symmetric matrix of inertia")
            moments[i, j] = moments[j, i] = value
        return moments


def known(name: str, names: Collection[str], problem: str) -> str:
    """Return a name that is among others; otherwise refuse it, with the nearest of them."""
    if name not in names:
        expected, hint = choices(name, names)
        raise ModelError(problem, expected=expected, hint=hint)
    return name


def rotation(w: float, x: float, y: float, z: float) -> Array:
    """Return the matrix of a quaternion of any length but 0, shape (3, 3)."""
    w, x, y, z = unit(np.array([w, x, y, z]))
    return np.asarray(pin.Quaternion(w, x, y, z).matrix())


def text_in(element: Element | None, key: str) -> str | None:
    """Return an attribute of an element, which need not exist."""
    return None if element is None else element.get(key)


def axis_of(axis: Element | None, where: str) -> Array:
    """Return the unit vector of an ``<axis>`` of URDF, x where there is none, shape (3,)."""
    return X if axis is None else Part.of(where, axis=axis.get("xyz")).direction("axis")


def placement_of(origin: Part) -> pin.SE3:
    """Return the placement that an element of URDF says by ``xyz`` and ``rpy``, or ``quat_xyzw`` of its version 1.2."""
    xyz, rpy = (origin.numbers(key, 3, ZERO) for key in ("xyz", "rpy"))
    if "quat_xyzw" not in origin.texts:
        return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    x, y, z, w = origin.numbers("quat_xyzw", 4)
    if rpy.any() or not any((x, y, z, w)):
        raise ModelError(f"{origin.where}: quat_xyzw is 0, or there is an rpy too", expected="one of them")
    return pin.SE3(rotation(w, x, y, z), xyz)


def solid_inertia(kind: str, size: Array, density: float, mass: float | None = None) -> pin.Inertia:
    """Return the inertia of a solid about its centre, of its density [kg/m^3] or its mass [kg].

    Moments follow from the mean squares of x, y and z over the solid.

    Args:
        kind: ``box``, ``ellipsoid``, ``sphere``, ``cylinder`` or ``capsule``, the last two along z.
        size: Half sizes of a box, semi-axes of an ellipsoid, else the radius and half of the length between the ends
            [m]; of a capsule without its caps.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # moments beyond all numbers are refused below
        r, half = float(size[0]), float(size[-1])
        ball, tube = 4.0 / 3.0 * math.pi * r**3, math.pi * r * r * 2.0 * half
        middle = np.array([r * r / 4, r * r / 4, half * half / 3])
        caps = np.array([r * r / 5, r * r / 5, r * r / 5 + half * half + 0.75 * half * r])  # centroid at 3/8 r
        volume, squares = {
            "box": (8.0 * size.prod(), size**2 / 3),
            "ellipsoid": (4.0 / 3.0 * math.pi * size.prod(), size**2 / 5),
            "sphere": (ball, np.full(3, r * r / 5)),
            "cylinder": (tube, middle),
            "capsule": (ball + tube, (ball * caps + tube * middle) / (ball + tube)),
        }[kind]
        total = float(volume) * density if mass is None else mass
        squares = total * squares
        return inertia(total, np.zeros(3), np.diag(squares.sum() - squares))
