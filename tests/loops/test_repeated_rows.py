"""Forward motions of loops whose rows repeat others: one method and another, one bearing and two."""

import numpy as np
import pytest

import pinarm

INERTIA = '<inertia ixx="0.1" iyy="0.1" izz="0.05" ixy="0" ixz="0" iyz="0"/>'
SHAFT = f"""<robot name="s"><link name="base"/>
<link name="shaft"><inertial><origin xyz="0.1 0 0.1"/><mass value="5"/>{INERTIA}</inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="shaft"/><axis xyz="0 0 1"/></joint></robot>"""


def test_a_loop_that_only_repeats_leaves_the_pendulum_that_the_shaft_is(tmp_path):
    """A second bearing in line with the first, exactly: its rows do not depend on the angle at all."""
    (tmp_path / "shaft.urdf").write_text(SHAFT)
    place = ["0 m", "0 m", "0.4 m"]
    second = {"points": {"right": {"link": "shaft", "at": place}, "seat": {"link": "base", "at": place}},
              "loops": {"B": {"kind": "revolute", "between": ["seat", "right"], "axis": "z"}}}  # fmt: skip
    angles = []
    for keys in ({}, second):
        mechanism = pinarm.Mechanism.load(
            tmp_path / "shaft.urdf", values={"gravity": {"direction": [0, -1, 0]}, **keys}
        )
        problem = {"kind": "forward", "time": {"end": "0.5 s", "samples": 6}}
        run = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["x"]})
        angles.append(run["x"].values)
    assert angles[1] == pytest.approx(angles[0], abs=1e-8)
    assert np.ptp(angles[0]) > 0.5
