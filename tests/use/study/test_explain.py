"""The drawing of a mechanism: parts, points, joints and loops with their names, where its loops close."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import IntegrationError

MODELS = Path(pinarm.__file__).parents[1] / "models"


def test_a_mechanism_is_drawn_with_its_names() -> None:
    """Slider-crank of 45 mm and 145 mm, stretched or folded along x; its points by Pinocchio's convention of z."""
    found = pinarm.explain(MODELS / "slider_crank" / "mechanism.yaml")
    [axis] = found.sketch().axes
    names = {text.get_text(): text.xy for text in axis.texts}
    [piston] = [xy for text, xy in names.items() if text.startswith("$B_{3}$, B")]
    [pin] = [xy for text, xy in names.items() if text.split(", ")[0] == "A"]
    assert np.hypot(*np.subtract(piston, pin)) == pytest.approx(0.145, abs=1e-9)
    assert np.hypot(*pin) == pytest.approx(0.045, abs=1e-12)
    assert {"crank", "rod"} <= names.keys()


@pytest.mark.parametrize(("form", "begins"), [("svg", b"<?xml"), ("png", b"\x89PNG")])
def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str, begins: bytes) -> None:
    file = tmp_path / f"four_bar.{form}"
    assert main(["explain", str(MODELS / "four_bar" / "mechanism.yaml"), "--draw", str(file)]) == 0
    assert file.read_bytes().startswith(begins)
    assert f"written to {file}" in capsys.readouterr().out


WHEELS = """<robot name="wheels"><link name="base"/><link name="one"/><link name="two"/>
  <joint name="a" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/></joint>
  <joint name="b" type="continuous"><parent link="base"/><child link="two"/><origin xyz="0.5 0 0"/>
  <axis xyz="0 0 1"/></joint></robot>"""


def test_a_belt_that_slips_is_not_left_out(tmp_path: Path) -> None:
    """Wheels of one size are wrapped by half a turn: ``2 F0 tanh(mu pi / 2)`` of a pretension of 300 N and 0.3."""
    (tmp_path / "wheels.urdf").write_text(WHEELS)
    belt = {"kind": "belt", "joints": ["a", "b"], "radii": ["0.1 m", "0.1 m"], "pretension": "300 N"}
    own = {"constant": "2 N*m", "static_constant": "3 N*m", "viscous": "0.1 N*m*s"}
    values = {"couplings": {"belt": belt}, "friction": {"belt": {"mu": 0.3}, "a": own}}
    shown = str(pinarm.explain(tmp_path / "wheels.urdf", values))
    assert "belt: belt, no row: friction ties its wheels; two strands, pretension 300 N" in shown
    assert f"friction of coupling belt: {600.0 * np.tanh(0.15 * np.pi):g} N" in shown
    assert "friction of joint a: 2 N*m (3 N*m at rest), viscous 0.1 N*m*s/rad" in shown
    assert "open chain" not in shown


RODS = """<robot name="rods"><link name="base"/><link name="crank">{mass}</link><link name="rod">{mass}</link>
  <link name="foot"/><link name="ground"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/></joint>
  <joint name="ball" type="{kind}"><parent link="crank"/><child link="rod"/><origin xyz="0.1 0 0.2"/></joint>
  <joint name="end" type="fixed"><parent link="rod"/><child link="foot"/><origin xyz="0.3 0.4 0"/></joint>
  <joint name="post" type="fixed"><parent link="base"/><child link="ground"/><origin xyz="0.4 0.4 0.2"/></joint>
</robot>"""
MASS = """<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def test_rods_that_spin_between_two_balls_are_counted(tmp_path: Path) -> None:
    """Crank 1, ball 3, less the 3 rows of the ball at the foot: mobility 1, which is the spin of the rod."""
    (tmp_path / "rods.urdf").write_text(RODS.format(mass=MASS, kind="spherical"))
    (tmp_path / "m.yaml").write_text(
        "pinarm: 1\nrobot: rods.urdf\nloops: {foot: {kind: spherical, between: [foot, ground]}}\n"
    )
    found = pinarm.explain(tmp_path / "m.yaml")
    assert found.mobility.mobility == 1
    assert found.mobility.spins == ("ball",)
    assert "1 of these are links that spin by themselves" in str(found)
    (tmp_path / "m.yaml").write_text("pinarm: 1\nrobot: rods.urdf\n")
    free = pinarm.explain(tmp_path / "m.yaml")
    assert not free.mobility.spins and "spin by themselves" not in str(free)  # a ball that no loop holds


def test_an_integrated_motion_is_explained_where_it_begins_without_being_solved(tmp_path: Path) -> None:
    """A pendulum of 1 m, let go at 30 degrees; its run would fail, as it may take one step only."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "m.yaml").write_text(
        "pinarm: 1\nplanar:\n  points: {O: [0, 0], A: [1 m, 0]}\n  ground: [O]\n"
        "  links: {rod: {points: [O, A], mass: 1 kg}}\n"
    )
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\nproblem: {kind: forward, time: {end: 1 s}, initial: {position: {O: 30 deg}}}\n"
        "accuracy: {max_steps: 1}\noutputs: [O]\n"
    )
    with pytest.raises(IntegrationError):
        pinarm.run(tmp_path / "s.yaml")
    found = pinarm.explain(tmp_path / "s.yaml")
    assert found.q == pytest.approx([np.pi / 6], abs=1e-12)
    assert "mobility 1 where the motion begins" in str(found)
    [axis] = found.sketch().axes
    [tip] = [text.xy for text in axis.texts if text.get_text() == "A"]
    assert tip == pytest.approx([np.cos(np.pi / 6), 0.5], abs=1e-12)
