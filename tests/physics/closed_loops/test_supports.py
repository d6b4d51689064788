"""Bodies that loop joints hold in space: on a rod, and without any freedom."""

import numpy as np
import pytest

GRAVITY = {"direction": "-z", "magnitude": "9.81 m/s^2"}
SLIDES, TURNS = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}, {"rx": "1 0 0", "ry": "0 1 0", "rz": "0 0 1"}
MASS, CENTRE, PLACE = 1.5, np.array([0.3, -0.2, 0.15]), np.array([0.2, 0.1, -0.3])


def on_joints(names, centre):
    """A body on joints one after the other, whose links but for the last have no mass."""
    xml, parent = '<robot name="held"><link name="base"/>', "base"
    for name in names:
        child = "body" if name == names[-1] else f"after_{name}"
        kind, axis = ("prismatic", SLIDES[name]) if name in SLIDES else ("continuous", TURNS[name])
        xml += "" if child == "body" else f'<link name="{child}"/>'
        xml += f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
          <axis xyz="{axis}"/><limit lower="-99" upper="99" effort="1e9" velocity="1e9"/></joint>"""
        parent = child
    for link in ("base", "body"):
        xml += f"""<link name="{link}_end"/><joint name="{link}_end" type="fixed"><parent link="{link}"/>
          <child link="{link}_end"/><origin xyz="{PLACE[0]} {PLACE[1]} {PLACE[2]}"/></joint>"""
    return f"""{xml}<link name="body"><inertial>
      <origin xyz="{centre[0]} {centre[1]} {centre[2]}"/><mass value="{MASS}"/>
      <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def test_a_body_without_freedom_is_carried_by_what_holds_it(solve, mechanism):
    fixed = {"kind": "fixed", "between": ["base_end", "body_end"]}
    held = mechanism(on_joints([*SLIDES, *TURNS], CENTRE), gravity=GRAVITY, loops={"tie": fixed})
    still, weight, arm = solve(held, "statics"), MASS * 9.81, CENTRE - PLACE
    force = [still[f"loop.tie.force.{axis}"].values[0] for axis in "xyz"]
    moment = [still[f"loop.tie.moment.{axis}"].values[0] for axis in "xyz"]
    assert force == pytest.approx([0.0, 0.0, weight], abs=1e-10)
    assert moment == pytest.approx([arm[1] * weight, -arm[0] * weight, 0.0], abs=1e-10)


def test_a_mass_on_a_rod_is_a_conical_pendulum(solve, mechanism):
    length, tilt = 0.8, 0.7
    rod = {"kind": "rod", "between": ["base", "body"], "length": f"{length} m"}
    pendulum = mechanism(on_joints(list(SLIDES), np.zeros(3)), gravity=GRAVITY, loops={"rod": rod})
    spin, radius, height = np.sqrt(9.81 / (length * np.cos(tilt))), length * np.sin(tilt), -length * np.cos(tilt)
    initial = {"position": {"x": radius, "y": 0.0, "z": height}, "velocity": {"x": 0.0, "y": radius * spin, "z": 0.0}}
    found = solve(pendulum, "forward", end=3.0, initial=initial)
    t = found["t"].values
    assert found["x"].values == pytest.approx(radius * np.cos(spin * t), abs=1e-9)
    assert found["y"].values == pytest.approx(radius * np.sin(spin * t), abs=1e-9)
    assert found["z"].values == pytest.approx(height, abs=1e-9)
    assert found["loop.rod.force.norm"].values == pytest.approx(MASS * 9.81 / np.cos(tilt), rel=1e-9)
    assert found["loop.rod.force.z"].values == pytest.approx(MASS * 9.81, rel=1e-9)
