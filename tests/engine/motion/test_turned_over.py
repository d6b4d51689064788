"""What acts along the angle of a loop in space is said to jump where it goes round, and only there."""

from pathlib import Path
from typing import Any

import pytest

import pinarm

URDF = """<robot name="body"><link name="w"/><link name="b"><inertial><origin xyz="0.1 0.05 0.02"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="root" type="floating"><parent link="w"/><child link="b"/></joint></robot>"""
LOOP = {"L": {"kind": "revolute", "between": ["w", "b"], "axis": [0.6, 0, 0.8]}}
SPRING = {"forces": {"S": {"kind": "coordinate_spring", "coordinate": "L.angle", "stiffness": "0.001 N*m/rad"}}}
DRIVE = {"drives": {"D": {"along": "L.angle"}}}


@pytest.mark.parametrize(("parts", "user"), [(SPRING, "'S'"), (DRIVE, "drive 'D'"), ({}, "")])
@pytest.mark.parametrize(("speed", "turns"), [("14 rad/s", True), ("3 rad/s", False)])
def test_an_angle_that_goes_round_is_told(
    tmp_path: Path, parts: dict[str, Any], user: str, speed: str, turns: bool
) -> None:
    """At 14 rad/s it passes half a turn within the 0.4 s, at 3 rad/s not."""
    (tmp_path / "body.urdf").write_text(URDF)
    problem = {"kind": "forward", "time": {"end": "0.4 s", "samples": 3}, "initial": {"velocity": {"L.angle": speed}}}
    mechanism = {"pinarm": 1, "robot": str(tmp_path / "body.urdf"), "loops": LOOP, "gravity": "none", **parts}
    with pinarm.file_root(tmp_path):
        result = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["loop.L.angle"]})
    told = [note for note in result.notes() if "jumps by a turn where it passes 180 deg" in note]
    assert len(told) == (turns and bool(user))
    assert all(note.startswith(f"{user} acts along an angle") for note in told)
