"""The force of a thread on a spindle, its nut and their bearings, in closed form."""

import numpy as np
import pytest
from catalogue import disc
from motions import anywhere

from pinarm.engine.quantities.names import Quantities
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Statics

MASS, LEAD, G = 7.0, 0.012, 9.81
JACK = f"""<robot name="jack"><link name="base"/>{disc("screw", 0.3, "0.1 0 0")}
  <link name="nut_link"><inertial><origin xyz="0.2 0 0"/><mass value="{MASS}"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="nut" type="prismatic"><parent link="base"/><child link="nut_link"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1e6" velocity="1e6"/></joint></robot>"""


@pytest.mark.parametrize("hand", [-1.0])
def test_the_spindle_bears_the_weight_and_the_guide_its_moments(mechanism, hand):
    thread = {"kind": "screw", "joints": ["screw", "nut"], "lead": f"{hand * LEAD} m"}
    jack = mechanism(JACK, couplings={"thread": thread})
    found = Quantities(Statics(hold={"screw": 0.4}, drives=["screw"]).solve(jack, Accuracy(), anywhere).rows)
    weight, moment = MASS * G, hand * MASS * G * LEAD / (2.0 * np.pi)
    assert found["coupling.thread.axial"].values == pytest.approx(weight, rel=1e-14)
    assert found["coupling.thread.torque"].values == pytest.approx(moment, rel=1e-14)
    assert found["coupling.thread.moment.z"].values == pytest.approx(moment, rel=1e-14)
    assert found["joint.screw.force.z"].values == pytest.approx(weight + G, rel=1e-14)  # and the spindle's 1 kg
    assert found["joint.screw.moment.z"].values == pytest.approx(moment, rel=1e-14)
    # the nut is lifted at x = 0.1 and weighs at 0.6: its guide, at 0.4, holds 0.5 m of it, and the thread's moment
    assert found["joint.nut.force.norm"].values == pytest.approx(0.0, abs=1e-13)
    assert found["joint.nut.moment.y"].values == pytest.approx(-0.5 * weight, rel=1e-13)
    assert found["joint.nut.moment.z"].values == pytest.approx(-moment, rel=1e-13)
