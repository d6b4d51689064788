"""Reactions are held against Newton's and Euler's equations of every body, and a wrong one is told."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.quantities import reactions
from pinarm.errors import InputError

SCENARIOS = Path(__file__).parents[3] / "scenarios"
TWO_POINT = """\
pinarm: 1
mechanism: panda
problem:
  kind: forward
  time: {end: 0.3 s, samples: 4}
  initial: {position: {panda_joint2: 0.4 rad, panda_joint4: -1.2 rad}, velocity: {panda_joint1: 2 rad/s}}
  loads:
    pull: {kind: point_spring, between: [panda_link0, panda_hand], stiffness: 300 N/m, free_length: 0.2 m}
    push: {kind: wrench, point: panda_link5, force: [3 N, -2 N, 8 N], moment: [0, 1 N*m, 0], axes: world}
outputs: [joint.panda_joint3.moment.x]
"""
ASKED = [
    "crank_rocker_turning", "gen411_arm_dynamic", "manipulator_held", "rotor_vertical", "slider_crank_gas",
]  # fmt: skip


@pytest.mark.parametrize("name", ASKED)
def test_those_of_scenarios_keep_every_body_in_balance(name):
    assert pinarm.run(SCENARIOS / f"{name}.yaml").figures["bodies"] < 1e-13


@pytest.fixture
def pulled(tmp_path):
    (tmp_path / "s.yaml").write_text(TWO_POINT)
    return pinarm.load(tmp_path / "s.yaml")


def test_loads_at_points_are_part_of_it(pulled):
    assert pulled.run().figures["bodies"] < 1e-14


@pytest.mark.parametrize("component", [0, 4])
def test_a_reaction_that_is_wrong_shows(pulled, monkeypatch, component):
    right = reactions.transmitted

    def wrong(*states):
        wrenches = right(*states)
        wrenches[:, 3, component] += 1e-6 * np.abs(wrenches[:, 3]).max()
        return wrenches

    monkeypatch.setattr(reactions, "transmitted", wrong)
    assert pulled.run().figures["bodies"] > 1e-8


def test_a_length_that_a_flat_mechanism_leaves_open_has_one_in_its_plane():
    """Of revolute joints, all parallel: what they carry along z together is open, what is across it is not."""
    text = "".join(
        f'<body name="{name}" pos="{place}"><joint name="{name}" axis="0 0 1"/><geom size="0.1" pos="1 0 0"/>{inside}'
        for name, place, inside in (("a", "0 0 0", ""), ("b", "0 1 0", '<site name="p" pos="2 0.5 0"/></body></body>'),
                                    ("c", "2 0 0", '<site name="q" pos="0 1.5 0"/></body>'))
    )  # fmt: skip
    loop = {"d": {"kind": "revolute", "axis": "z", "between": ["p", "q"]}}
    mechanism = _of_mjcf(f"<mujoco><worldbody>{text}</worldbody></mujoco>", loop)
    states = mechanism.at(np.zeros(3), drives=["a"])
    with pytest.raises(InputError) as caught:
        states["joint.c.force.norm"]
    assert caught.value.hint == "joint.c.force.radial, the size of what is across the axis"
    x, y = (float(states[f"joint.c.force.{axis}"].values) for axis in "xy")
    assert float(states["joint.c.force.radial"].values) == pytest.approx(np.hypot(x, y), rel=1e-14)


def _of_mjcf(text, loops):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / ".pinarm-root").touch()
        (Path(folder) / "m.xml").write_text(text)
        return pinarm.Mechanism.load(Path(folder) / "m.xml", values={"loops": loops})
