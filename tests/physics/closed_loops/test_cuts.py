"""It does not matter where a loop is cut, nor whether a joint stands in the tree or closes a loop."""

import numpy as np
import pytest

from pinarm.mechanics.laws import Harmonic

from .energy_integral import EnergyIntegral
from .four_bar_closed_form import FourBar
from .slider_crank_closed_form import SliderCrank

BAR = FourBar(0.10, 0.35, 0.25, 0.40, 1.0, 3.5, 2.5)
DOWN_Y = {"direction": "-y", "magnitude": "9.81 m/s^2"}


def joint(name, parent, child, x, kind="continuous", axis="0 0 1"):
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <origin xyz="{x} 0 0"/><axis xyz="{axis}"/><limit lower="-9" upper="9" effort="1e9" velocity="1e9"/></joint>"""


def link(name, mass=0.0, x=0.0, length=0.0):
    """A uniform slender bar along x with its centre at x; the frame of the link is at the joint that carries it."""
    inertia = mass * length**2 / 12
    return f"""<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>
      <inertia ixx="0" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def frame(name, parent, x):
    return f'<link name="{name}"/>' + joint(f"{name}_fixed", parent, name, x, "fixed")


def bars(crank, coupler, rocker):
    """The three bars with their frames at one end (1) or the other (-1), x from O2 to A, A to B, O4 to B."""
    return "".join(
        link(name, mass, side * length / 2, length)
        for name, mass, length, side in (
            ("crank", BAR.m2, BAR.a, crank), ("coupler", BAR.m3, BAR.b, coupler), ("rocker", BAR.m4, BAR.c, rocker)
        )
    )  # fmt: skip


GROUND = '<link name="base"/>' + frame("O4_base", "base", BAR.d) + frame("O2_base", "base", 0)
O2, O4 = joint("O2", "base", "crank", 0), joint("O4", "base", "rocker", BAR.d)
CUTS = {  # cut -> bars, joints of the tree, first and second frame of the loop, joints that sum up to theta2
    "B": (bars(1, 1, 1) + O2 + joint("A", "crank", "coupler", BAR.a) + O4
          + frame("one", "coupler", BAR.b) + frame("two", "rocker", BAR.c), ["O2"]),
    "O4": (bars(1, 1, -1) + O2 + joint("A", "crank", "coupler", BAR.a) + joint("B", "coupler", "rocker", BAR.b)
           + frame("one", "base", BAR.d) + frame("two", "rocker", -BAR.c), ["O2"]),
    "A": (bars(1, -1, 1) + O2 + O4 + joint("B", "rocker", "coupler", BAR.c)
          + frame("one", "crank", BAR.a) + frame("two", "coupler", -BAR.b), ["O2"]),
    "O2": (bars(-1, -1, 1) + O4 + joint("B", "rocker", "coupler", BAR.c) + joint("A", "coupler", "crank", -BAR.b)
           + frame("one", "base", 0) + frame("two", "crank", -BAR.a), ["O4", "B", "A"]),
}  # fmt: skip
REVERSED = {("A", "B"), ("O2", "B"), ("O2", "A")}
"""Cuts with joints whose child is nearer to the crank, so that they give the reaction."""


@pytest.fixture
def cut(request, mechanism):
    xml, sums = CUTS[request.param]
    return request.param, mechanism(
        f'<robot name="four_bar">{GROUND}{xml}</robot>',
        gravity=DOWN_Y,
        loops={request.param: {"kind": "revolute", "between": ["one", "two"], "axis": "z"}},
        coordinates={"theta2": {"kind": "sum", "of": sums}},
    )


def starting(joints, theta2):
    (theta3, theta4) = BAR.angles(theta2)
    if "O4" in joints and "O2" not in joints:
        angles = {"O4": theta4, "B": theta3 - theta4, "A": theta2 - theta3}
    elif "O4" in joints and "A" not in joints:
        angles = {"O2": theta2, "O4": theta4, "B": theta3 - theta4}
    elif "O4" in joints:
        angles = {"O2": theta2, "A": theta3 - theta2, "O4": theta4}
    else:
        angles = {"O2": theta2, "A": theta3 - theta2, "B": theta4 - theta3}
    return {name: float(angle) for name, angle in angles.items()}


@pytest.mark.parametrize("cut", CUTS, indirect=True)
def test_torque_and_every_pin_force_of_a_four_bar_cut_anywhere(solve, cut):
    where, linkage = cut
    law = Harmonic(mean=2.0, amplitude=3.5, pulsation=6.0)
    found = solve(linkage, "inverse", motion={"theta2": law}, drives=["theta2"], start=starting(linkage.joints, 2.0))
    theta2, omega2, alpha2 = (
        found[f"coordinate.theta2.{rate}"].values for rate in ("position", "velocity", "acceleration")
    )
    forces = BAR.forces(theta2, omega2, alpha2)
    for pin in ("O2", "A", "B", "O4"):
        name, sign = (f"loop.{pin}", 1) if pin == where else (f"joint.{pin}", -1 if (where, pin) in REVERSED else 1)
        for axis in "xy":
            assert sign * found[f"{name}.force.{axis}"].values == pytest.approx(forces[f"{pin}.{axis}"], abs=1e-8)
    if where != "O2":
        assert found["joint.O2.effort"].values == pytest.approx(forces["T"], abs=1e-9)


@pytest.mark.parametrize("cut", CUTS, indirect=True)
def test_free_motion_of_a_four_bar_cut_anywhere(solve, cut):
    _, linkage = cut
    position = starting(linkage.joints, 0.3)
    *_, d3, d4 = BAR.slopes(np.array([0.3]))
    speeds = {"O2": 16.0, "A": 16.0 * (d3[0] - 1), "O4": 16.0 * d4[0], "B": 16.0 * (d4 - d3)[0]}
    if "O2" not in linkage.joints:
        speeds |= {"A": -speeds["A"], "B": -speeds["B"]}
    elif "A" not in linkage.joints:
        speeds["B"] *= -1
    initial = {"position": position, "velocity": {name: speeds[name] for name in linkage.joints}}
    found = solve(linkage, "forward", end=1.0, initial=initial)
    turning = EnergyIntegral(BAR.inertia, BAR.potential, 0.3, 16.0, 25.0)
    assert found["theta2"].values == pytest.approx(turning.at(found["t"].values), abs=1e-9)


def test_a_slide_that_closes_the_loop_is_the_slide_of_the_tree(solve, mechanism):
    crank = SliderCrank(e=0.012)
    xml = f"""<robot name="slider_crank"><link name="base"/>
      <link name="crank"><inertial><mass value="1"/>
        <inertia ixx="{crank.I2 / 2}" iyy="{crank.I2 / 2}" izz="{crank.I2}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      {joint("theta", "base", "crank", 0)}{joint("A", "crank", "rod", crank.r)}{joint("B", "rod", "piston", crank.L)}
      <link name="rod"><inertial><origin xyz="{crank.l_G} 0 0"/><mass value="{crank.m3}"/>
        <inertia ixx="0" iyy="{crank.I3}" izz="{crank.I3}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      {link("piston", crank.m4)}<link name="line"/>
      <joint name="line_fixed" type="fixed"><parent link="base"/><child link="line"/><origin xyz="0 0.012 0"/></joint>
      </robot>"""
    slide = {"kind": "prismatic", "between": ["line", "piston"], "axis": "x"}
    engine = mechanism(xml, gravity="none", loops={"slide": slide})
    law = Harmonic(amplitude=8.0, pulsation=20.0)
    found = solve(
        engine, "inverse", end=0.4, motion={"theta": law}, drives=["theta"], start={"theta": 0, "A": 0, "B": 0}
    )
    theta, omega, alpha = (found[f"joint.theta.{rate}"].values for rate in ("position", "velocity", "acceleration"))
    forces = crank.forces(theta, omega, alpha)
    assert found["joint.theta.effort"].values == pytest.approx(forces["T"], rel=1e-9, abs=1e-8)
    assert found["loop.slide.force.y"].values == pytest.approx(forces["N"], rel=1e-9, abs=1e-8)
    assert found["loop.slide.moment.z"].values == pytest.approx(forces["M"], abs=1e-8)
    assert found["joint.B.force.x"].values == pytest.approx(forces["B.x"], rel=1e-9, abs=1e-7)
