"""Motions beside a hundred joints that have no part in them: large mechanisms are computed in other ways."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.constraints.nullspace import MANY

ROOT = Path(__file__).parents[2]
SAME = 1e-6
"""Of the largest value of a quantity: with more coordinates errors are smaller relative to the tolerance, and steps are
others. Of these scenarios, at tolerances of 1e-9 and less, the largest difference is 1e-8."""
LINK = (
    '<link name="aside {k}"><inertial><mass value="0.001"/>'
    '<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="aside {k}" type="continuous"><parent link="{parent}"/><child link="aside {k}"/>'
    '<axis xyz="{axis}"/></joint>'
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "model", "base", "axis"),
    [
        ("gen411_arm_swing", "gen411_arm/gen411_arm.urdf.xacro", "base", "0 1 0"),
        ("crank_rocker_free", "crank_rocker/crank_rocker.urdf.xacro", "base", "0 1 0"),
        ("mass_on_belt_stick_slip", "mass_on_belt/mass_on_belt.urdf.xacro", "frame", "0 0 1"),
    ],
)
def test_joints_at_rest_leave_a_motion_as_it_is(name: str, model: str, base: str, axis: str, tmp_path: Path) -> None:
    """Hinges along gravity, on the ground and on one another, stay at rest."""
    shutil.copytree(ROOT / "models", tmp_path / "models")
    (tmp_path / ".pinarm-root").touch()
    scenario = shutil.copytree(ROOT / "scenarios", tmp_path / "scenarios") / f"{name}.yaml"
    alone = pinarm.run(scenario)
    text = (tmp_path / "models" / model).read_text(encoding="utf-8")
    parents = [f"aside {k - 1}" if k % 10 else base for k in range(MANY + 10)]
    aside = "".join(LINK.format(k=k, parent=parent, axis=axis) for k, parent in enumerate(parents))
    (tmp_path / "models" / model).write_text(text.replace("</robot>", f"{aside}</robot>"), encoding="utf-8")
    beside = pinarm.run(scenario)
    assert beside.scenario.mechanism.model.nv > MANY >= alone.scenario.mechanism.model.nv
    for output in alone.scenario.content.outputs:
        expected = np.asarray(alone[output])
        np.testing.assert_allclose(beside[output], expected, rtol=0.0, atol=SAME * np.abs(expected).max(initial=1e-9))
