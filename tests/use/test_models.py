"""Models of every kind through the command line: floating robots, MJCF, limits, notes."""

import json

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import InputError

FALL = """\
pinarm: 1
mechanism: hector
problem:
  kind: forward
  time: {end: 1 s, samples: 11}
  initial:
    position: {root.z: 10 m, root.roll: 30 deg, root.yaw: 90 deg}
    velocity: {root.x: 2 m/s, root.angular_velocity.z: 100 rpm}
outputs: [root.z, joint.root.quaternion.w, joint.root.yaw, root.rotation.z, joint.root.angular_velocity.z, height]
symbols: {height: point.base_link.position.z}
expect:
  - {quantity: root.z, at: end, value: 5.0950000 m, source: free fall for a second}
  - {quantity: joint.root.angular_velocity.z, at: all, value: 10.4719755 rad/s, source: no moment about the centre}
"""

ARM = """\
<mujoco model="arm">
  <option gravity="0 0 -10"/>
  <worldbody>
    <body name="link.1"><joint name="j.1" axis="0 1 0" range="-30 30" actuatorfrcrange="-4 4"/>
      <inertial pos="0.5 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><site name="tip" pos="1 0 0"/></body>
  </worldbody>
</mujoco>
"""

HELD = """\
pinarm: 1
mechanism: arm.xml
problem: {kind: statics, over: {j.1: {from: -60 deg, to: 60 deg, samples: 13}}}
outputs:
  - joint.j.1.effort
  - point.tip.position.z
  - joint.j.1.moment.about.link.1.y
  - body.link.1.angular_velocity.along.link.1.x
"""


@pytest.fixture
def write(tmp_path):
    def written(scenario, **files):
        for name, text in files.items():
            (tmp_path / name.replace("_", ".")).write_text(text)
        (tmp_path / "s.yaml").write_text(scenario)
        return tmp_path / "s.yaml"

    return written


def test_a_robot_that_floats_falls_and_what_is_written_of_it_again(write, tmp_path):
    assert main(["check", str(write(FALL))]) == 0
    result = pinarm.load(write(FALL)).run()
    assert result["joint.root.yaw"].values[0] == pytest.approx(np.pi / 2)
    assert result["height"].values[-1] == pytest.approx(10 - 9.81 / 2)
    assert main(["run", str(write(FALL)), "-o", str(tmp_path / "r"), "--no-plots"]) == 0
    assert main(["check", str(tmp_path / "r" / "scenario.yaml")]) == 0


@pytest.mark.parametrize(("before", "after", "said"), [
    ("root.z: 10 m", "rot.z: 10 m", ["no joint 'rot.z' with one coordinate", "root.z"]),
    ("root.roll: 30 deg", "root.roll: 30 m", ["'m' is not a unit"]),
    ("root.roll: 30 deg", "root.rotation.x: 30 deg", ["the orientation of 'root' is given twice"]),
    ("joint.root.quaternion.w", "joint.root.quaternion.v", ["no quantity 'joint.root.quaternion.v'",
                                                            "joint.root.quaternion"]),
])  # fmt: skip
def test_mistakes_about_a_floating_joint_are_told(write, before, after, said):
    with pytest.raises(InputError) as caught:
        pinarm.load(write(FALL.replace(before, after, 1))).validate()
    for words in said:
        assert words in str(caught.value)


def test_limits_that_are_exceeded_are_told_on_the_terminal_and_in_the_summary_and_notes_too(write, tmp_path, capsys):
    arm = ARM.replace("<site", "<geom size='1'/><site")
    assert main(["run", str(write(HELD, arm_xml=arm)), "-o", str(tmp_path / "r"), "--no-plots"]) == 0
    told = capsys.readouterr().out
    assert "note: geoms do not touch: contacts are not modelled" in told
    lines = [line for line in told.splitlines() if line.startswith("limit: ")]
    assert lines == [
        f"limit: joint j.1: {words} rows)"
        for words in (
            "position -1.0472 rad is below its limit -0.523599 rad, first at j.1 = -1.0472 rad (3 of 13",
            "position 1.0472 rad exceeds its limit 0.523599 rad, first at j.1 = 0.698132 rad (3 of 13",
            "effort -5 N*m exceeds its limit 4 N*m, first at j.1 = -0.523599 rad (7 of 13",
        )
    ]
    limits = json.loads((tmp_path / "r" / "summary.json").read_text())["limits"]
    assert limits[2] == {"joint": "j.1", "of": "effort", "unit": "N*m", "limit": 4.0, "value": pytest.approx(-5.0),
                         "at": pytest.approx(-np.pi / 6), "rows": 7,
                         "sentence": lines[2].removeprefix("limit: ")}  # fmt: skip
    assert (tmp_path / "r" / "model.xml").read_text() == arm


@pytest.mark.parametrize(("creep", "pull"), [("0.5 rad/s", np.tanh(2.0)), (None, 1.0)])
def test_dry_friction_of_the_model_acts_and_is_regularised_where_its_creep_is_set(write, creep, pull):
    urdf = ('<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>'
            '<inertia ixx="1" iyy="1" izz="1"/></inertial></link><joint name="j" type="continuous"><parent link="a"/>'
            '<child link="b"/><axis xyz="0 0 1"/><dynamics friction="3" damping="0.5"/></joint></robot>')  # fmt: skip
    mechanism = "pinarm: 1\nrobot: r.urdf\n" + (f"creep: {creep}\n" if creep else "")
    power = "power.joint friction" if creep else "power.friction"
    scenario = f"""\
pinarm: 1
mechanism: m.yaml
problem: {{kind: inverse, time: {{end: 1 s, samples: 3}}, motion: {{j: {{law: constant_speed, speed: 1 rad/s}}}}}}
outputs: [joint.j.effort, {power}]
"""
    result = pinarm.load(write(scenario, r_urdf=urdf, m_yaml=mechanism)).run()
    assert result["joint.j.effort"].values == pytest.approx(3.0 * pull + 0.5, rel=1e-12)
    assert result[power].values == pytest.approx(-3.0 * pull, rel=1e-12)
    assert ("F tanh(v / 0.5)" in " ".join(result.notes())) == (creep is not None)
