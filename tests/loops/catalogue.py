"""Linkages with closed loops whose every joint may be cut."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from linkage import GROUND, Body, Joint, Linkage, random_turn

from pinarm.engine.mechanism import Mechanism

ABOUT_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Axes of a joint about y of the world."""


def bar(start, end, mass, offset=(0.0, 0.0, 0.0)) -> Body:
    """A bar of some thickness, its centre of mass off its middle."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    along = end - start
    square = along @ along
    inertia = mass / 12 * (square * np.eye(3) - np.outer(along, along)) + mass * 0.02**2 * np.eye(3)
    return Body(mass, (start + end) / 2 + np.asarray(offset, float), inertia)


def axes_along(axis) -> np.ndarray:
    """A rotation whose third column is the given direction."""
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def four_bar(kinds=("revolute",) * 4) -> Linkage:
    """A crank-rocker in the plane x-z, the axes along y: joints crank, A, B, rocker."""
    o, a, b, c = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.1], [0.45, 0.0, 0.33], [0.5, 0.0, 0.0]])
    bodies = {"crank": bar(o, a, 1.0, (0.02, 0.0, 0.03)), "coupler": bar(a, b, 2.0, (0.0, 0.0, 0.05)),
              "rocker": bar(c, b, 1.5)}  # fmt: skip
    ends = {"O": (GROUND, "crank", o), "A": ("crank", "coupler", a), "B": ("coupler", "rocker", b),
            "C": (GROUND, "rocker", c)}  # fmt: skip
    joints = {
        name: Joint(kind, *ends[name][:2], ends[name][2], ABOUT_Y) for name, kind in zip(ends, kinds, strict=True)
    }
    return Linkage(bodies, joints)


def rssr(second="universal") -> Linkage:
    """A spatial four-bar; with two ball joints the coupler spins freely, with a universal one everything is held."""
    o, a, b, c = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.02], [0.25, 0.35, 0.3], [0.3, 0.4, 0.05]])
    bodies = {"crank": bar(o, a, 1.0, (0.01, 0.02, 0.03)), "coupler": bar(a, b, 2.0, (0.02, 0.0, 0.01)),
              "rocker": bar(c, b, 1.5, (0.0, 0.03, 0.0))}  # fmt: skip
    return Linkage(bodies, {
        "O": Joint("revolute", GROUND, "crank", o, ABOUT_Y),
        "A": Joint("spherical", "crank", "coupler", a, random_turn(np.random.default_rng(1))),
        "B": Joint(second, "coupler", "rocker", b, random_turn(np.random.default_rng(2))),
        "C": Joint("revolute", GROUND, "rocker", c, axes_along([1.0, 0.3, -0.2])),
    })  # fmt: skip


def slider_crank() -> Linkage:
    """A crank about y, and a slider along x; nothing is held twice."""
    o, a, b = np.array([[0.0, 0.0, 0.0], [0.06, 0.0, 0.08], [0.4, 0.0, 0.0]])
    bodies = {"crank": bar(o, a, 1.0), "rod": bar(a, b, 0.7), "slider": Body(2.0, b, 0.003 * np.eye(3))}
    return Linkage(bodies, {
        "O": Joint("revolute", GROUND, "crank", o, ABOUT_Y),
        "A": Joint("spherical", "crank", "rod", a, axes_along([0.0, 1.0, 0.0])),
        "B": Joint("universal", "rod", "slider", b, np.eye(3)[:, [1, 2, 0]]),
        "C": Joint("prismatic", GROUND, "slider", b, axes_along([1.0, 0.0, 0.0])),
    })  # fmt: skip


def taken_from(mechanism: Mechanism, q: np.ndarray, names: dict[str, str]) -> Linkage:
    """The linkage that a model with simple joints is, at a closed configuration; ``names``: link -> body."""
    model, data = mechanism.model, mechanism.model.createData()
    pin.framesForwardKinematics(model, data, q)
    called = {0: GROUND, **{model.frames[model.getFrameId(link)].parentJoint: name for link, name in names.items()}}
    bodies = {}
    for index in range(1, model.njoints):
        inertia, place = model.inertias[index], data.oMi[index]
        turned = place.rotation @ inertia.inertia @ place.rotation.T
        bodies[called[index]] = Body(inertia.mass, place.act(inertia.lever), turned)
    joints = {}
    for index in range(1, model.njoints):
        axis = _axis(model, index)
        kind = "revolute" if axis[3:].any() else "prismatic"
        turn = axes_along(data.oMi[index].rotation @ (axis[3:] + axis[:3]))
        ends = called[model.parents[index]], called[index]
        joints[model.names[index]] = Joint(kind, *ends, data.oMi[index].translation.copy(), turn)
    for loop in mechanism.constraints:
        one, two = model.frames[loop.first], model.frames[loop.second]
        place = data.oMf[loop.first]
        ends = called[one.parentJoint], called[two.parentJoint]
        joints[loop.name] = Joint(loop.kind, *ends, place.translation.copy(), place.rotation.copy())
    return Linkage(bodies, joints, 9.81)


def _axis(model: pin.Model, index: int) -> np.ndarray:
    """The unit twist of a joint in its own axes."""
    data, v = model.createData(), np.zeros(model.nv)
    v[model.joints[index].idx_v] = 1.0
    pin.forwardKinematics(model, data, pin.neutral(model), v)
    return np.round(data.v[index].vector - data.liMi[index].actInv(data.v[model.parents[index]]).vector, 15)
