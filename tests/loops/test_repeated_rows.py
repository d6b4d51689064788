"""Forward motions of loops whose rows repeat others: one method and another, one bearing and two."""

from pathlib import Path

import numpy as np
import pytest

import pinarm

SHIPPED = Path(__file__).parents[2] / "scenarios"
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


def test_steps_of_one_length_end_where_the_run_does():
    """A stage of the last step lies at the end of the run, beside the closed state there."""
    scenario = pinarm.load(SHIPPED / "crank_rocker_free.yaml")
    time = {"problem.time": {"end": "0.1 s", "samples": 5}}
    plain = scenario.varied(time).run()
    fixed = scenario.varied({**time, "accuracy": {"method": "rk4", "step": "0.5 ms"}}).run()
    for output in ("omega2", "theta4"):
        assert fixed[output].values == pytest.approx(plain[output].values, rel=1e-7, abs=1e-7)
