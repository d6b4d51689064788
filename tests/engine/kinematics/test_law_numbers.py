"""How many laws a mechanism can follow: as many as it has degrees of freedom, wherever its loops close."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.kinematics.assembly import determining
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[3] / "models"


@pytest.fixture(scope="module")
def leg():
    return Mechanism.load(MODELS / "exoskeleton_leg" / "mechanism.yaml")


def test_too_few_laws(leg):
    with pytest.raises(InputError, match="3 coordinates have to follow a law and 1 do") as caught:
        determining(leg, {"knee": Constant(value=0.0)})
    assert caught.value.expected == "laws for 2 more, such as of the joints ankle, hip"


def test_too_many_laws(leg):
    names = ["ankle", "knee", "hip", "hip_height"]
    with pytest.raises(InputError, match="4 coordinates follow a law, but the mechanism has only 3 degrees") as caught:
        determining(leg, {name: Constant(value=0.0) for name in names})
    assert caught.value.expected == "3 of ankle, knee, hip, hip_height"


CONNECTED = """<mujoco><worldbody>
<body name="A"><joint name="a" axis="0 1 0"/><geom size=".05" pos="0 0 .1"/>
  <body name="B" pos="0 0 .2"><joint name="b" axis="0 1 0"/><geom size=".05" pos=".2 0 0"/></body></body>
<body name="C" pos=".5 0 0"><joint name="c" axis="0 1 0"/><geom size=".05" pos="0 0 .1"/></body>
<body name="D" pos="1 0 1"><joint name="d" type="ball"/><geom size=".05" pos="0 0 -.1"/></body></worldbody>
<equality><connect body1="B" body2="C" anchor=".5 0 .15"/></equality></mujoco>"""


def test_missing_laws_are_counted_by_mobility_and_not_by_rows(tmp_path):
    """A four-bar, whose three rows hold two motions in the plane, and a ball joint: 3 - 2 + 3."""
    (tmp_path / "m.xml").write_text(CONNECTED)
    with pytest.raises(InputError, match="4 coordinates have to follow a law and 1 do") as caught:
        determining(Mechanism.load(tmp_path / "m.xml"), {"a": Constant(value=0.0)})
    assert caught.value.expected.startswith("laws for 3 more")


@pytest.mark.parametrize("names", [["theta2", "theta4"]])
def test_too_many_laws_of_a_loop_are_counted_by_its_mobility(names):
    """Of three joints one is free in a four-bar; values of two would fit one another by chance only."""
    bars = Mechanism.load(MODELS / "crank_rocker" / "mechanism.yaml")
    motion = {name: Constant(value=0.1 * k) for k, name in enumerate(names)}
    with pytest.raises(InputError, match="has only 1 degree of freedom") as caught:
        DeterminedMotion(bars, determining(bars, motion)).begin(
            Grid.cover(np.zeros(1), []), start_configuration(bars, {})
        )
    assert caught.value.expected == f"1 of {', '.join(names)}"


def test_loops_that_do_not_close_are_told_as_they_are_met_and_not_as_in_another_attempt():
    """The base is longer than the other three together; the drawing without the start would leave another gap."""
    file = MODELS / "crank_rocker" / "mechanism.yaml"
    problem = {"kind": "kinematics", "time": {"end": "1 s", "samples": 2}, "start": {"A": "0 deg", "theta4": "180 deg"},
               "motion": {"theta2": {"law": "constant", "value": "0 deg"}}}  # fmt: skip
    bars = Mechanism.load(file, arguments={"d": 5.0})
    with pytest.raises(AssemblyError, match=r"the motion is out of reach at t = 0 s: B stays open by") as caught:
        pinarm.run({"pinarm": 1, "mechanism": bars, "problem": problem, "outputs": ["theta4"]})
    assert "theta2 = " in caught.value.expected
