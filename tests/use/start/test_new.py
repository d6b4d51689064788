"""What is written to begin with runs as it is, and nothing that the user wrote is lost."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.input.yaml.document import Document
from pinarm.use.start.new import TEMPLATES, templates

CART = """\
<robot name="cart">
  <link name="base"/>
  <link name="cart"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="arm"><inertial><origin xyz="1 0 0"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="twin"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="kite"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="rail-1" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="0.02" upper="0.05" effort="10" velocity="0.01"/></joint>
  <joint name="on" type="revolute"><parent link="cart"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="0.1" effort="5" velocity="2"/></joint>
  <joint name="follower" type="continuous"><parent link="base"/><child link="twin"/><axis xyz="0 1 0"/>
    <mimic joint="on" multiplier="2"/></joint>
  <joint name="free" type="floating"><parent link="base"/><child link="kite"/></joint>
</robot>
"""

LINK = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
PIN = """<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/>
  <axis xyz="0 1 0"/></joint>"""
LOOP = '<loop_joint name="k" type="spherical"><link1 link="B" xyz="{0}"/><link2 link="C" xyz="0 0 0.3"/></loop_joint>'
BARS = [
    '<robot name="bars"><link name="base"/>', *(LINK.format(name) for name in "ABC"),
    PIN.format("a", "base", "A", "0 0 0"), PIN.format("b", "A", "B", "0 0 0.2"),
    PIN.format("c", "base", "C", "0.5 0 0"),
]  # fmt: skip
"""A four-bar in the plane x-z, of crank 0.2 m, ground 0.5 m and rocker 0.3 m."""
SCREW = """\
<sdf version="1.9"><model name="press"><link name="base"/>
  <joint name="w" type="fixed"><parent>world</parent><child>base</child></joint>
  <link name="ram"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
  <joint name="s" type="screw"><parent>base</parent><child>ram</child>
    <screw_thread_pitch>0.01</screw_thread_pitch><axis><xyz>0 0 1</xyz></axis></joint>
</model></sdf>
"""


def files(folder: Path) -> dict[str, str]:
    return {file.name: file.read_text(encoding="utf-8") for file in folder.iterdir()}


@pytest.mark.parametrize("name", templates())
def test_every_template_runs_and_its_answer_key_agrees(tmp_path: Path, name: str) -> None:
    folder = pinarm.new(name, tmp_path / name)
    findings = pinarm.check(folder)
    assert len(findings) > 0
    assert all(finding.ok for finding in findings), str(findings)
    assert files(folder) == files(TEMPLATES / name)


def test_a_model_moves_every_joint_within_its_limits(tmp_path: Path) -> None:
    (tmp_path / "cart.urdf").write_text(CART)
    assert pinarm.new(tmp_path / "cart.urdf") == tmp_path
    result = pinarm.run(tmp_path / "scenario.yaml")
    outputs = {"joint.rail-1.effort", "joint.on.effort", *(f"joint.free.moment.{axis}" for axis in "xyz")}
    assert {*result.content.outputs} == outputs
    way, angle = result["rail-1"].values, result["on"].values
    np.testing.assert_allclose(way[[0, -1]], [0.02, 0.05], atol=1e-14)
    np.testing.assert_allclose(angle[[0, -1]], [0.0, np.radians(-30)], atol=1e-14)
    assert not result.excesses() or {one.joint for one in result.excesses()} == {"on"}, "of effort only"
    assert np.abs(result["joint.rail-1.velocity"].values).max() <= 0.01
    assert np.abs(result["free.x"].values).max() == 0.0
    text = (tmp_path / "mechanism.yaml").read_text()
    assert "#   rail-1: slides, 20 to 50 mm, at most 10 N\n" in text
    assert "#   on: turns, -171.887 to 5.72958 deg, at most 5 N*m\n" in text


@pytest.mark.parametrize("end", ["\n", "\r", "\x85", "\u2028"])
def test_a_name_of_the_model_writes_no_line_of_the_files(tmp_path: Path, end: str) -> None:
    name, title = f"a{end}gravity: none{end}#", f"t{end}gravity: none{end}#"
    coded = [text.replace(end, "".join(f"&#{ord(char)};" for char in end)) for text in (title, name)]
    pin = PIN.format(coded[1], "base", "A", "0 0 0")
    (tmp_path / "m.urdf").write_text(f'<robot name="{coded[0]}"><link name="base"/>{LINK.format("A")}{pin}</robot>')
    pinarm.new(tmp_path / "m.urdf")
    described = Document.read(tmp_path / "mechanism.yaml").data
    assert described.keys() == {"pinarm", "title", "robot"}
    assert pinarm.run(tmp_path / "scenario.yaml").trajectory.mechanism.gravity == 9.81
    assert moved(tmp_path) == [name]
    for text in files(tmp_path).values():
        assert "gravity: none" not in [line.strip() for line in text.splitlines()]


def moved(folder: Path) -> list[str]:
    return [*pinarm.load(folder / "scenario.yaml").document.data["problem"]["motion"]]


@pytest.mark.parametrize("coupler", ["0.5 0 0.1", "0.3 0 0.1"])
def test_a_loop_is_driven_at_one_joint(tmp_path: Path, coupler: str) -> None:
    """Of three joints one is free, by Gruebler; the second coupler closes the loop away from the zero position."""
    (tmp_path / "bars.urdf").write_text("\n".join([*BARS, LOOP.format(coupler), "</robot>"]))
    pinarm.new(tmp_path / "bars.urdf")
    result = pinarm.run(tmp_path / "scenario.yaml")
    a, b, c = (result[name].values for name in "abc")
    x, _, z = map(float, coupler.split())
    gap = 0.2 * np.exp(1j * a) + (z + 1j * x) * np.exp(1j * (a + b)) - (0.5j + 0.3 * np.exp(1j * c))
    assert moved(tmp_path) == ["a"]
    assert np.abs(gap).max() < 1e-13
    assert np.ptp(a) > 0.01


def test_a_screw_is_driven_by_turning_it(tmp_path: Path) -> None:
    (tmp_path / "press.sdf").write_text(SCREW)
    pinarm.new(tmp_path / "press.sdf")
    assert moved(tmp_path) == ["s"]
    result = pinarm.run(tmp_path / "scenario.yaml")
    np.testing.assert_allclose(np.ptp(result["s.slide"].values), 0.01 / 12, rtol=1e-12)


def test_a_loop_that_does_not_close_says_so_in_the_file(tmp_path: Path) -> None:
    (tmp_path / "bars.urdf").write_text("\n".join([*BARS, LOOP.format("9 0 0"), "</robot>"]))
    pinarm.new(tmp_path / "bars.urdf")
    assert (tmp_path / "scenario.yaml").read_text().startswith("# This does not run as it is: ")


def test_a_model_of_another_folder_is_referred_to(tmp_path: Path) -> None:
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "cart.urdf").write_text(CART)
    folder = pinarm.new(tmp_path / "cart.urdf", tmp_path / "deep" / "mine")
    assert 'robot: "../../cart.urdf"' in (folder / "mechanism.yaml").read_text()
    assert len(pinarm.validate(folder)) == 1
    (tmp_path / "deep" / ".pinarm-root").touch()
    with pytest.raises(InputError, match="leads out of the root folder"):
        pinarm.new(tmp_path / "cart.urdf", tmp_path / "deep" / "other")
    assert not (tmp_path / "deep" / "other").exists()


def test_a_drawing_becomes_a_urdf_with_the_same_answers(tmp_path: Path) -> None:
    (tmp_path / ".pinarm-root").touch()
    drawn = pinarm.new("scissor_lift", tmp_path / "drawn")
    made = pinarm.new(drawn / "mechanism.yaml", tmp_path / "made")
    assert set(files(made)) == {"mechanism.urdf", "mechanism.yaml"}
    one = pinarm.run(drawn / "scenario.yaml")
    two = pinarm.run(drawn / "scenario.yaml", {"mechanism": "../made/mechanism.yaml"})
    for name in one.content.outputs:
        np.testing.assert_array_equal(one[name].values, two[name].values)


def test_files_and_links_that_exist_stay_and_nothing_is_written(tmp_path: Path) -> None:
    (tmp_path / "file").mkdir()
    (tmp_path / "file" / "scenario.yaml").write_text("mine")
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / "scenario.yaml").symlink_to(tmp_path / "elsewhere")
    for name in ("file", "link"):
        with pytest.raises(InputError, match=r"scenario\.yaml exists already: nothing is written"):
            pinarm.new("arm", tmp_path / name)
        assert [file.name for file in (tmp_path / name).iterdir()] == ["scenario.yaml"]
    assert files(tmp_path / "file") == {"scenario.yaml": "mine"}
    assert not (tmp_path / "elsewhere").exists()


def test_what_cannot_be_made_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no template 'four-bar'") as caught:
        pinarm.new("four-bar", tmp_path / "x")
    assert "scissor_lift" in caught.value.expected
    assert caught.value.hint == "four_bar"
    with pytest.raises(InputError, match="no drawing"):
        pinarm.new(pinarm.new("arm", tmp_path / "arm") / "mechanism.yaml", tmp_path / "out")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        pinarm.new("arm", tmp_path / "file" / "sub")
