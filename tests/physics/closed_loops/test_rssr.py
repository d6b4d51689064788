"""Spatial four-bar with two ball joints: closure, torque, and a rod without mass in place of the coupler."""

import numpy as np
import pytest

from pinarm.mechanics.laws import Constant, ConstantSpeed

from .rssr_closed_form import Rssr

STARTS = {1: {"A_z": 1.57, "A_y": -0.7, "phi": 0.2}, -1: {"A_z": 1.57, "A_y": 0.46, "phi": -3.1}}
ROD = """<robot name="rssr"><link name="base"/>
  <joint name="theta" type="continuous"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/></joint>
  <link name="crank"><inertial><origin xyz="0.05 0 0"/><mass value="1"/>
    <inertia ixx="0" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="A" type="fixed"><parent link="crank"/><child link="A"/><origin xyz="0.1 0 0"/></joint><link name="A"/>
  <joint name="phi" type="continuous"><parent link="base"/><child link="rocker"/><origin xyz="0.1 0.4 0.05"/>
    <axis xyz="1 0 0"/></joint>
  <link name="rocker"><inertial><origin xyz="0 0 0.125"/><mass value="1.5"/>
    <inertia ixx="{1}" iyy="{1}" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="B" type="fixed"><parent link="rocker"/><child link="B"/><origin xyz="0 0 0.25"/></joint><link name="B"/>
</robot>""".format(0.01 / 12, 1.5 * 0.0625 / 12)


@pytest.mark.parametrize("branch", [1, -1])
def test_closure_and_torques_are_those_of_the_closed_form(solve, branch):
    linkage, w = Rssr(branch=branch), 6.0
    theta, phi, phd, torque, spin = linkage.turn(w)
    found = solve("rssr", "inverse", end=2 * np.pi / w, samples=257, drives=["theta", "spin"],
                  motion={"theta": ConstantSpeed(speed=w), "spin": Constant(value=0.0)},
                  start=STARTS[branch])  # fmt: skip
    assert np.cos(found["phi"].values[:-1] - phi) == pytest.approx(1.0, abs=1e-13)
    assert found["phd"].values[:-1] == pytest.approx(phd, abs=1e-9)
    about_z, about_y = linkage.coupler(theta)
    assert found["A_y"].values[:-1] == pytest.approx(about_y, abs=1e-10)
    assert np.cos((found["A_z"].values + found["theta"].values)[:-1] - about_z) == pytest.approx(1.0, abs=1e-13)
    assert found["T"].values[:-1] == pytest.approx(torque, abs=1e-8)
    assert found["joint.spin.effort"].values[:-1] == pytest.approx(spin, abs=1e-9)


def test_a_rod_without_mass_does_what_a_light_coupler_does(solve, mechanism):
    linkage, w = Rssr(m3=0.0), 6.0
    _, phi, phd, torque, _ = linkage.turn(w)
    rod = mechanism(ROD, loops={"rod": {"kind": "rod", "between": ["A", "B"], "length": "0.45 m"}})
    found = solve(rod, "inverse", end=2 * np.pi / w, samples=257, drives=["theta"],
                  motion={"theta": ConstantSpeed(speed=w)}, start={"phi": 0.2})  # fmt: skip
    assert found["phi"].values[:-1] == pytest.approx(phi, abs=1e-11)
    assert found["joint.phi.velocity"].values[:-1] == pytest.approx(phd, abs=1e-10)
    assert found["joint.theta.effort"].values[:-1] == pytest.approx(torque, abs=1e-9)
    along = (linkage.rocker_pin(found["theta"].values) - linkage.crank_pin(found["theta"].values)) / linkage.b
    force = np.stack([found[f"loop.rod.force.{axis}"].values for axis in "xyz"], axis=1)
    assert np.cross(force, along) == pytest.approx(0.0, abs=1e-9)
