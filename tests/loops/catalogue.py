"""Linkages with closed loops whose every joint may be cut."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from linkage import GROUND, Body, Joint, Linkage, random_turn

from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[2] / "models"
UPRIGHT = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
"""The turn that brings y of a model upwards, and its z along y."""

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


def scissor(stages: int) -> Linkage:
    """Crosses of two equal bars on one hinge in the plane x-z, squares of 1 m; the loops close at the upper ends.

    The falling bar of a cross carries the rising one of the next, which carries its own falling bar at the middle.
    """
    bodies, joints = {}, {}
    for k in range(stages):
        low, high = np.array([[k, 0.0, 0.0], [k, 0.0, 1.0]])
        across, middle = np.array([1.0, 0.0, 1.0]), np.array([k + 0.5, 0.0, 0.5])
        bodies[f"rising_{k}"] = bar(low, low + across, 1.0)
        bodies[f"falling_{k}"] = bar(high, low + np.array([1.0, 0.0, 0.0]), 1.0)
        joints[f"tree_{2 * k}"] = Joint("revolute", f"falling_{k - 1}" if k else GROUND, f"rising_{k}", low, ABOUT_Y)
        joints[f"tree_{2 * k + 1}"] = Joint("revolute", f"rising_{k}", f"falling_{k}", middle, ABOUT_Y)
        if k:
            joints[f"loop_{k}"] = Joint("revolute", f"rising_{k - 1}", f"falling_{k}", high, ABOUT_Y)
    return Linkage(bodies, joints)


def five_bar() -> Linkage:
    """Two cranks and two couplers in the plane x-z: two freedoms."""
    o, a, m, b, c = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.2], [0.3, 0.0, 0.4], [0.5, 0.0, 0.25], [0.6, 0.0, 0.0]])
    bodies = {
        "crank": bar(o, a, 1.0),
        "one": bar(a, m, 0.8, (0.0, 0.0, 0.03)),
        "two": bar(b, m, 1.2),
        "last": bar(c, b, 0.9),
    }
    ends = {"O": (GROUND, "crank", o), "A": ("crank", "one", a), "M": ("one", "two", m), "B": ("last", "two", b),
            "C": (GROUND, "last", c)}  # fmt: skip
    return Linkage(bodies, {name: Joint("revolute", *both, at, ABOUT_Y) for name, (*both, at) in ends.items()})


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


def screw_jack() -> Linkage:
    """A spindle about y whose nut, held from turning by a rod only, lifts a table along z; nothing is held twice."""
    o, s, a, b = np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.15, 0.08], [0.05, 0.45, 0.3]])
    bodies = {"crank": bar(o, 4.0 * s, 1.0, (0.01, 0.0, 0.02)), "nut": bar(s, a, 0.6, (0.01, 0.0, 0.0)),
              "rod": bar(a, b, 0.8), "table": Body(3.0, b, 0.004 * np.eye(3))}  # fmt: skip
    return Linkage(bodies, {
        "O": Joint("revolute", GROUND, "crank", o, ABOUT_Y),
        "S": Joint("screw", "crank", "nut", s, ABOUT_Y, lead=0.09),
        "A": Joint("universal", "nut", "rod", a, axes_along([0.3, 1.0, 0.1])),
        "B": Joint("universal", "rod", "table", b, axes_along([0.2, 0.1, 1.0])),
        "C": Joint("prismatic", GROUND, "table", b, axes_along([0.0, 0.0, 1.0])),
    })  # fmt: skip


def parallelogram() -> Linkage:
    """Three equal cranks in the plane x-z and two couplers between their ends, one of which would do."""
    feet = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.1], [0.9, 0.0, 0.0]])
    arm = np.array([0.1, 0.0, 0.25])
    bodies = {f"crank_{k}": bar(foot, foot + arm, 1.0 + k) for k, foot in enumerate(feet)}
    bodies |= {f"coupler_{k}": bar(feet[k] + arm, feet[k + 1] + arm, 0.5, (0.0, 0.0, 0.05)) for k in (0, 1)}
    joints = {f"foot_{k}": Joint("revolute", GROUND, f"crank_{k}", foot, ABOUT_Y) for k, foot in enumerate(feet)}
    for name, crank, coupler in (("a", 0, 0), ("b", 1, 0), ("c", 1, 1), ("d", 2, 1)):
        place = feet[crank] + arm
        joints[name] = Joint("revolute", f"crank_{crank}", f"coupler_{coupler}", place, ABOUT_Y)
    return Linkage(bodies, joints)


def two_cranks(start: float) -> Linkage:
    """Two equal cranks and a coupler in the plane x-z; ``start``: angle of the cranks from upright, pi/2 in line.

    As a parallelogram it moves as one pendulum, ``TWO_CRANKS``.
    """
    feet, arm = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]), 0.2 * np.array([np.sin(start), 0.0, np.cos(start)])
    tips = feet + arm
    bodies = {"one": bar(feet[0], tips[0], 1.0), "two": bar(feet[1], tips[1], 1.0), "coupler": bar(*tips, 0.5)}
    ends = {"O": (GROUND, "one", feet[0]), "A": ("one", "coupler", tips[0]), "B": ("coupler", "two", tips[1]),
            "C": (GROUND, "two", feet[1])}  # fmt: skip
    return Linkage(bodies, {name: Joint("revolute", *both, at, ABOUT_Y) for name, (*both, at) in ends.items()})


TWO_CRANKS = 2.0 * (0.2**2 / 3.0 + 0.02**2) + 0.5 * 0.2**2, 9.81 * (2.0 * 0.1 + 0.5 * 0.2)
"""Inertia [kg m^2] and largest moment of the weights [N m] of these cranks, as one pendulum."""


def bennett() -> Linkage:
    """Bennett's linkage: four revolutes of any directions in space that move all the same.

    Lengths a, b, a, b and twists with sin alpha / a = sin beta / b; its angles obey
    tan(th1/2) tan(th2/2) = sin((beta + alpha)/2) / sin((beta - alpha)/2), th3 = -th1, th4 = -th2.
    """
    lengths, twist = (0.3, 0.45), 0.6
    twists = (twist, np.arcsin(lengths[1] * np.sin(twist) / lengths[0]))
    first = 1.1
    ratio = np.sin(sum(twists) / 2) / np.sin((twists[1] - twists[0]) / 2)
    second = 2 * np.arctan(ratio / np.tan(first / 2))
    frames = [pin.SE3(axes_along([0.2, 0.9, 0.3]), np.array([0.1, 0.0, 0.2]))]
    for angle, k in ((first, 0), (second, 1), (-first, 0), (-second, 1)):
        along = pin.SE3(pin.exp3(np.array([twists[k], 0.0, 0.0])), np.array([lengths[k], 0.0, 0.0]))
        frames.append(frames[-1] * pin.SE3(pin.exp3(np.array([0.0, 0.0, angle])), np.zeros(3)) * along)
    assert frames[4].isApprox(frames[0], 1e-12)
    links = [GROUND, "one", "two", "three", GROUND]
    bodies = {links[k]: bar(frames[k - 1].translation, frames[k].translation, float(k)) for k in (1, 2, 3)}
    return Linkage(bodies, {
        f"axis_{k + 1}": Joint("revolute", links[k], links[k + 1], frames[k].translation, frames[k].rotation)
        for k in range(4)
    })  # fmt: skip


def shaft() -> Linkage:
    """A shaft across its weight in three bearings: two would do."""
    body = Body(3.0, np.array([0.02, 0.3, 0.01]), np.diag([0.2, 0.01, 0.2]))
    bearings = {"left": "revolute", "middle": "cylindrical", "right": "cylindrical"}
    return Linkage({"shaft": body}, {
        name: Joint(kind, GROUND, "shaft", np.array([0.0, y, 0.0]), ABOUT_Y)
        for (name, kind), y in zip(bearings.items(), (0.0, 0.4, 1.0), strict=True)
    })  # fmt: skip


def bricard() -> Linkage:
    """Bricard's linkage on the edges of a cube, y of the model upwards."""
    loaded = Mechanism.load(MODELS / "bricard" / "mechanism.yaml")
    rods = {f"P{k}P{k + 1}": f"rod_{k}" for k in range(5)}
    return taken_from(loaded, pin.neutral(loaded.model), rods).turned(UPRIGHT)


def manipulator() -> Linkage:
    """The manipulator at alpha = 0.4, y of the model upwards."""
    loaded = Mechanism.load(MODELS / "manipulator" / "mechanism.yaml")
    r, h, alpha = 0.75, 2.0, 0.4
    given = {"alpha": alpha, "B": -alpha, "E": alpha, "x": -r * np.cos(alpha), "y": h - r * np.sin(alpha)}
    q = pin.neutral(loaded.model)
    for name, value in given.items():
        q[loaded.joints[name].q] = value
    names = {"arm": "crank", "support": "support", "link_3": "link_3", "cylinder": "cylinder", "rod": "rod"}
    return taken_from(loaded, q, names).turned(UPRIGHT)


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
        turn = axes_along(place.rotation @ loop.pair.axis)
        joints[loop.name] = Joint(loop.kind, *ends, place.translation.copy(), turn)
    return Linkage(bodies, joints, 9.81)


def _axis(model: pin.Model, index: int) -> np.ndarray:
    """The unit twist of a joint in its own axes."""
    data, v = model.createData(), np.zeros(model.nv)
    v[model.joints[index].idx_v] = 1.0
    pin.forwardKinematics(model, data, pin.neutral(model), v)
    return np.round(data.v[index].vector - data.liMi[index].actInv(data.v[model.parents[index]]).vector, 15)


def disc(name, inertia, at="0 0 0", axis="0 0 1") -> str:
    """The URDF of a disc on the ground, and of its joint of the same name."""
    return f"""<link name="{name}_link"><inertial><mass value="1.0"/>
      <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="{name}" type="continuous"><parent link="base"/><child link="{name}_link"/><origin xyz="{at}"/>
      <axis xyz="{axis}"/></joint>"""


RODS = """<robot name="lift"><link name="base"/>{screw}
  <link name="nut_link"/>
  <joint name="nut" type="prismatic"><parent link="base"/><child link="nut_link"/><origin xyz="0 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1e6" velocity="1e6"/></joint>
  <link name="strut"/>
  <joint name="foot" type="continuous"><parent link="nut_link"/><child link="strut"/><axis xyz="0 -1 0"/></joint>
  <link name="strut_end"/><joint name="end" type="fixed"><parent link="strut"/><child link="strut_end"/>
    <origin xyz="0.5 0 0"/></joint>
  <link name="table"><inertial><mass value="{mass}"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="height" type="prismatic"><parent link="base"/><child link="table"/><origin xyz="0.6 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1e6" velocity="1e6"/></joint></robot>"""
"""A screw, a nut along x, a strut on it, and a table that its head lifts: ``(0.6 - x)^2 + h^2 = 0.5^2``."""
