"""Paths of keys, those that have dots among them, in data, on the command line and in sweeps."""

from pathlib import Path

import pytest

import pinarm
from pinarm.errors import InputError, Location
from pinarm.input.yaml.document import steps_of

DATA = {"motion": {"tcp.x": {"value": 1}, "tcp.y": [{"a.b.c": 2, "a.b": 3}], "plain": 4}, "a": {"b": 5}, "a.b": 6}
PLACE = Location("--set")


@pytest.mark.parametrize(
    ("path", "steps"),
    [
        ('motion."tcp.y".0', ["motion", "tcp.y", 0]),
        ("motion.tcp.x.value", ["motion", "tcp.x", "value"]),
        ("motion.tcp.y.0.a.b", ["motion", "tcp.y", 0, "a.b"]),
        ("a.b", ["a", "b"]),
        ('"a.b"', ["a.b"]),
        ('motion."new.key"', ["motion", "new.key"]),
    ],
)
def test_steps(path: str, steps: list[str | int]) -> None:
    assert steps_of(path, DATA, PLACE) == steps


@pytest.mark.parametrize("path", ["", "a..b", 'a."b', 'a."b"c'])
def test_what_is_no_path(path: str) -> None:
    with pytest.raises(InputError, match="is no path of keys"):
        steps_of(path, DATA, PLACE)


def test_the_start_of_keys_with_dots_is_refused_with_their_quotes() -> None:
    with pytest.raises(InputError, match="no key 'tcp' here") as caught:
        steps_of("motion.tcp.z.value", DATA, PLACE)
    assert caught.value.expected == 'motion."tcp.x", motion."tcp.y"'
    assert "--set 'problem.motion.\"tcp.y\".value=3 mm'" in caught.value.hint


URDF = """<robot name="slide"><link name="base"/><link name="body"><inertial><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="tcp.y" type="prismatic"><parent link="base"/><child link="body"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    (tmp_path / "slide.urdf").write_text(URDF)
    (tmp_path / "m.yaml").write_text("pinarm: 1\nrobot: slide.urdf\n")
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\nproblem: {kind: statics, hold: {tcp.y: 1 mm}}\noutputs: [joint.tcp.y.position]\n"
    )
    return tmp_path / "s.yaml"


def test_a_joint_with_a_dot_is_set_and_swept(scenario: Path, one_process: None) -> None:
    result = pinarm.run(scenario, ['problem.hold."tcp.y"=3 mm'])
    assert result["joint.tcp.y.position"].values == pytest.approx(0.003, rel=1e-12)
    over = {"problem.hold.tcp.y": "3, 5 mm"}
    sweep = pinarm.sweep(scenario, over=over, results=["joint.tcp.y.position @ max"], workers=1)
    assert sweep["joint.tcp.y.position @ max"].values == pytest.approx([0.003, 0.005], rel=1e-12)
