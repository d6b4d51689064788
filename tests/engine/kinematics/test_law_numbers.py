"""How many laws a mechanism can follow: as many as it has degrees of freedom, wherever its loops close."""

from pathlib import Path

import numpy as np
import pytest

from pinarm.engine.kinematics.assembly import determining
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.errors import InputError
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
