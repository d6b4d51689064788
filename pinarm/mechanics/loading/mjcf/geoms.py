"""Inertias of MJCF geoms: solids of uniform density, or of a given mass."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError
from pinarm.mechanics.loading.mjcf.settings import Attributes, Settings, number_in, numbers_in
from pinarm.mechanics.loading.model_tree import inertia

WATER = 1000.0
"""Density where none is given [kg/m^3]."""

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
MOST_SIZES = 3
"""Numbers of ``size`` that MJCF allows; a shape takes the first ones it needs, as MuJoCo does."""

FLAT = ("plane", "hfield")
"""Shapes without mass."""


class MeshMass(ModelError):
    """A mass that only a mesh, or a compiler of shells, would tell."""


def geom_inertia(attributes: Attributes, settings: Settings, where: str) -> pin.Inertia:
    """Return the inertia of a shape about its body's frame.

    Args:
        attributes: Those of the geom, with those of its class.
        settings: Conventions of the model.
        where: What it belongs to, for messages.

    Raises:
        ModelError: Its size or mass is malformed.
        MeshMass: Its mass would come from a mesh.
    """
    kind = attributes.get("type", "mesh" if "mesh" in attributes else "sphere")
    mass, density = (number_in(attributes, key, where, -1.0) for key in ("mass", "density"))
    group = number_in(attributes, "group", where, 0.0)
    first, last = settings.groups
    if kind in FLAT or mass == 0.0 or (mass < 0.0 and density == 0.0) or not first <= group <= last:
        return pin.Inertia.Zero()
    if any(number_in(attributes, key, where, 0.0) < 0.0 for key in ("mass", "density")):
        raise ModelError(f"{where}: its mass or density is negative")
    if kind not in SIZES or "mesh" in attributes or attributes.get("shellinertia", "false") != "false":
        what = "mesh" if kind in ("mesh", "sdf") or "mesh" in attributes else f"'{kind}' or shell"
        raise MeshMass(f"{where}: the mass of a {what} is not computed here", expected="an <inertial> of its body",
                       hint="pip install 'pinarm[mjcf]', by which MuJoCo's compiler computes it")  # fmt: skip
    place, size = _shape(attributes, kind, settings, where)
    with np.errstate(over="ignore", invalid="ignore"):  # moments beyond all numbers are refused below
        volume, gyration = _solid(kind, size)
        total = mass if mass >= 0.0 else volume * (density if density >= 0.0 else WATER)
        squares = total * gyration
        moments = np.diag(squares.sum() - squares)
    return place.act(inertia(total, np.zeros(3), moments))


def _shape(attributes: Attributes, kind: str, settings: Settings, where: str) -> tuple[pin.SE3, Array]:
    """Return placement and size; with ``fromto`` the length is that between the two points."""
    size = numbers_in(attributes, "size", where, len(attributes.get("size", "").split()), ())
    if len(size) > MOST_SIZES:
        raise ModelError(f"{where}: size='{attributes['size'][:60]}' has {len(size)} numbers",
                         expected=f"{SIZES[kind]} positive numbers, {MOST_SIZES} at most")  # fmt: skip
    place, half = settings.shape_placement(attributes, where)
    if half is not None and len(size):
        size = np.array([size[0], half] if SIZES[kind] == 2 else [size[0], size[0], half])
    if len(size) < SIZES[kind] or not (size[: SIZES[kind]] > 0.0).all():
        raise ModelError(f"{where}: size='{attributes.get('size', '')}'", expected=f"{SIZES[kind]} positive numbers")
    return place, size[: SIZES[kind]]


def _solid(kind: str, size: Array) -> tuple[float, Array]:
    """Return the volume [m^3], and the mean squares of x, y and z over it [m^2], shape (3,)."""
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
