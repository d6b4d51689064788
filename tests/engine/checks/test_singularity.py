"""The regularity of runs, where it is known."""

import numpy as np
import pytest

import pinarm
from pinarm.use.show.text import report

LINKAGE = """<robot name="linkage"><link name="base"/><link name="A"/><link name="B"/>
  <link name="crank"><inertial><origin xyz="0.075 0 0"/><mass value="1.5"/>
    <inertia ixx="0.001" iyy="0.003" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="rocker"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.001" iyy="0.007" izz="0.007" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="theta2" type="continuous"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/></joint>
  <joint name="theta4" type="continuous"><parent link="base"/><child link="rocker"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="a" type="fixed"><parent link="crank"/><child link="A"/><origin xyz="0.15 0 0"/></joint>
  <joint name="b" type="fixed"><parent link="rocker"/><child link="B"/><origin xyz="0.2 0 0"/></joint>
</robot>"""


@pytest.mark.parametrize("longer", [1e-4, 1e-6])
def test_a_rod_has_one_row_which_is_lost_where_cranks_and_rod_are_in_line(tmp_path, longer):
    """One row has one singular value, so that its ratio to the largest is 1 everywhere. For a rod that is longer by x
    than in the singular position, the row there is as the square root of x."""
    (tmp_path / "linkage.urdf").write_text(LINKAGE)
    (tmp_path / "m.yaml").write_text(
        "pinarm: 1\nrobot: linkage.urdf\ngravity: none\n"
        f"loops: {{C: {{kind: rod, between: [A, B], length: {0.35 + longer!r} m}}}}\n"
    )
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\noutputs: [theta2, theta4]\n"
        "problem: {kind: inverse, time: {end: 1 s, samples: 400}, start: {theta2: 2.6 rad, theta4: 160 deg},\n"
        "          motion: {theta2: {law: constant_speed, speed: 1 rad/s, from: 2.6 rad}}, drives: [theta2]}\n"
    )
    found = pinarm.run(tmp_path / "s.yaml")
    q = found.trajectory.q
    rows = [pinarm.Mechanism.load(tmp_path / "m.yaml").closure.values(each[None])[0, 0] for each in q[::20]]
    assert found.figures["least regular at"] == pytest.approx(np.pi - 2.6, abs=0.02)
    assert 0.5 * np.sqrt(longer) < found.figures["regularity"] < 20.0 * np.sqrt(longer)
    assert found.figures["regularity"] < min(rows) / max(rows)
    # of one row the only singular value is the largest too
    assert found.figures["relative regularity"] == pytest.approx(found.figures["regularity"], rel=1e-12)
    assert "regularity: falls to 0.0" in report(found)


def test_a_constant_transmission_is_regular(tmp_path):
    """A rack at 1 mm and a gear of 1:50: the rows are the same everywhere, so nothing falls and nothing is said."""
    (tmp_path / "m.yaml").write_text(
        "pinarm: 1\nplanar: {points: {O: [0, 0], P: [0.1 m, 0], A: [0, 0.1 m], B: [1 m, 0.1 m]}, ground: [O, P, B],\n"
        "  links: {wheel: {points: [O], mass: 1 kg, inertia: 0.1 kg*m^2}, pinion: {points: [P], mass: 1 kg,\n"
        "  inertia: 0.1 kg*m^2}, slide: {points: [A], mass: 1 kg}}, sliders: {rail: {link: slide, along: [A, B]}}}\n"
        "couplings: {gear: {kind: gear, joints: [O, P], ratio: 0.02}, rack: {kind: rack, joints: [P, rail],\n"
        "  radius: 1 mm}}\n"
    )
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\noutputs: [joint.rail.position]\n"
        "problem: {kind: inverse, time: {end: 1 s}, motion: {O: {law: constant_speed, speed: 1 rad/s}}}\n"
    )
    found = pinarm.run(tmp_path / "s.yaml")
    assert found.figures["relative regularity"] == pytest.approx(1.0, abs=1e-12)
    assert "regularity" not in report(found)
