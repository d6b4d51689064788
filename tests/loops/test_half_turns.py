"""Loops that hold all rotation are open where their frames differ by half a turn, of one state and of many."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import PinarmError

AXES = ([0.0, 0.0, 1.0], [2.0, -3.0, 6.0])
HALF = np.pi


def arm(folder: Path, kind: str, axis: list[float]) -> Path:
    """A link that turns and one that slides along the same axis, held by a loop that lets it slide, or not."""
    x, y, z = axis
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    (folder / "arm.urdf").write_text(
        f'<robot name="arm"><link name="base"/><link name="link">{inertial}</link><link name="end">{inertial}</link>'
        '<joint name="turn" type="continuous"><parent link="base"/><child link="link"/>'
        f'<axis xyz="{x} {y} {z}"/></joint>'
        '<joint name="slide" type="prismatic"><parent link="link"/><child link="end"/>'
        f'<axis xyz="{x} {y} {z}"/><limit lower="-5" upper="5" effort="1e6" velocity="100"/></joint></robot>'
    )
    held = f", axis: {axis}" if kind == "prismatic" else ""
    (folder / "arm.yaml").write_text(
        f"pinarm: 1\nrobot: arm.urdf\ntitle: arm\nloops: {{L: {{kind: {kind}, between: [base, end]{held}}}}}\n"
    )
    return folder / "arm.yaml"


@pytest.mark.parametrize("kind", ["fixed", "prismatic"])
@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("turn", [-HALF, HALF - 1e-7, 3.0 * HALF])
def test_a_state_half_a_turn_off_is_refused_alone_and_among_others(
    tmp_path: Path, kind: str, axis: list[float], turn: float
) -> None:
    mechanism = pinarm.Mechanism.load(arm(tmp_path, kind, axis))
    shut, torn = np.zeros(2), np.array([turn, 0.0])
    assert np.abs(mechanism.closure.at(np.array([torn, torn]))[0]).max() > 1.0
    for q in (torn, np.array([torn, torn]), np.array([shut, torn])):
        idle = np.zeros_like(q)
        for call in (mechanism.at, mechanism.forward):
            with pytest.raises(PinarmError, match=r"tear 'L' by"):
                call(q, idle)
    mechanism.at(np.array([shut, shut]))
