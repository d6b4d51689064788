"""The loop joint ``screw`` against the coupling of that name, and against equations by hand."""

from pathlib import Path

import numpy as np
import pytest
from catalogue import RODS, disc, screw_jack
from motions import anywhere, driven, freely

from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant, Cycloidal
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Statics
from pinarm.records import replace
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[2] / "models"
INERTIA, MASS, LEAD, G = 0.003, 7.0, 0.012, 9.81
PITCH = LEAD / (2.0 * np.pi)
TURN = 2.0 * np.pi

JACK = f"""<robot name="jack"><link name="base"/>
  <link name="spindle"><inertial><mass value="1.0"/>
    <inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="spindle"/><axis xyz="0 0 1"/></joint>
  <link name="nut"><inertial><mass value="{MASS}"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="height" type="prismatic"><parent link="base"/><child link="nut"/><axis xyz="0 0 1"/>
    <limit lower="-9" upper="9" effort="1e6" velocity="1e6"/></joint></robot>"""
"""A spindle that turns in the ground and a nut that slides along it without turning.

Seen from the spindle the nut turns backwards: a left-handed thread lifts it where the spindle turns forwards.
"""


def as_coupling(mechanism, **more):
    thread = {"kind": "screw", "joints": ["turn", "height"], "lead": f"{LEAD} m", **more}
    return mechanism(JACK, couplings={"thread": thread})


def as_loop(mechanism, **more):
    thread = {"kind": "screw", "between": ["spindle", "nut"], "lead": f"-{LEAD} m", **more}
    return mechanism(JACK, loops={"thread": thread})


def of(run, *names):
    asked = Quantities(run)
    return np.array([asked[name].values for name in names])


STATE = [f"joint.{joint}.{part}" for joint in ("turn", "height") for part in ("position", "velocity", "acceleration")]


class TestJack:
    """The tree guides the nut as well, so that only the force and the moment along the axis are determined."""

    @pytest.mark.parametrize("turns", [-7.3])
    def test_many_turns_take_the_effort_that_the_coupling_takes(self, mechanism, turns):
        law = Cycloidal(start=0.0, end=turns * TURN, duration=1.0)
        runs = [driven(build(mechanism), {"turn": law}, samples=9) for build in (as_coupling, as_loop)]
        coupled, looped = (of(run, *STATE, "joint.turn.effort") for run in runs)
        assert coupled[0, -1] == pytest.approx(turns * TURN)
        assert looped == pytest.approx(coupled, rel=1e-10, abs=1e-10)

    @pytest.mark.parametrize("turns", [0.2, -7.3])
    def test_torque_holds_the_weight_on_any_turn_of_the_thread(self, mechanism, turns):
        hold, start = {"turn": turns * TURN}, {"height": turns * LEAD}
        run = Statics(hold=hold, start=start).solve(as_loop(mechanism), Accuracy(), anywhere).rows
        held = Statics(hold=hold).solve(as_coupling(mechanism), Accuracy(), anywhere).rows
        names = "joint.turn.effort", "joint.height.position"
        assert of(run, *names) == pytest.approx(of(held, *names), rel=1e-12)
        assert of(run, names[0]) == pytest.approx(MASS * G * PITCH, rel=1e-12)

    def test_the_start_says_which_turn_of_the_thread_the_nut_is_on(self, mechanism):
        for start, height in ((0.0, 0.3), (4.9, 5.3), (5.7, 5.3), (5.9, 6.3)):
            problem = Statics(hold={"turn": 7.3 * TURN}, start={"height": start * LEAD})
            run = problem.solve(as_loop(mechanism), Accuracy(), anywhere).rows
            assert of(run, "joint.height.position") == pytest.approx(height * LEAD, rel=1e-9)


class TestScrewInASpatialLoop:
    """A spindle whose nut lifts a table by a rod; the nut turns a little with the rod."""

    def built(self, tmp_path, lead=0.001):
        linkage = screw_jack()
        finer = replace(linkage.joints["S"], lead=lead)
        return replace(linkage, joints={**linkage.joints, "S": finer}).build(tmp_path, ["S"])

    @pytest.mark.parametrize("samples", [2, 9])
    def test_no_turn_is_lost_however_far_rows_are_apart(self, samples, tmp_path):
        """From rest to rest, so that the velocities at the ends tell nothing of the turns between."""
        jack = self.built(tmp_path)
        run = driven(jack, {"C": Cycloidal(start=0.0, end=-0.12, duration=1.0)}, samples=samples)
        spindle, nut = of(run, "O", "loop.S.angle") / TURN
        assert abs(spindle[-1]) > 50.0
        assert spindle == pytest.approx(-nut, abs=0.1)  # but for the turning of the nut


def test_a_nut_slides_to_its_place_and_then_turns_to_the_nearest_thread(mechanism):
    """It begins some 20 leads from where it belongs, more than damped steps can turn: ``(0.6 - x)^2 + h^2 = 0.5^2``."""
    thread = {"kind": "screw", "between": ["screw_link", "nut_link"], "axis": "x", "lead": "-2 mm"}
    head = {"kind": "revolute", "between": ["strut_end", "table"], "axis": "y"}
    lift = mechanism(
        RODS.format(screw=disc("screw", INERTIA, axis="1 0 0"), mass=MASS), loops={"thread": thread, "head": head}
    )
    start = {"foot": 0.8, "height": 0.3, "nut": 0.24}
    run = Statics(hold={"height": 0.3}, drives=["screw"], start=start).solve(lift, Accuracy(), anywhere).rows
    (nut, turn), effort = of(run, "nut", "screw")[:, 0], of(run, "joint.screw.effort")
    assert nut == pytest.approx(0.2, rel=1e-12)
    assert abs(turn) <= TURN / 2
    assert effort == pytest.approx(MASS * G * (0.4 / 0.3) * 0.002 / TURN, rel=1e-10)


class TestDifferentialScrew:
    """Two threads of leads p1 and p2 on one spindle: a turn moves the nut by ``p1 - p2``."""

    p1, p2 = 0.006, 0.005

    @pytest.fixture
    def press(self):
        return Mechanism.load(MODELS / "differential_screw" / "mechanism.yaml")

    @pytest.mark.parametrize("turns", [7.3, -7.3])
    def test_the_mechanical_advantage_is_that_of_the_difference_of_the_leads(self, press, turns):
        push = 500.0
        height = turns * (self.p1 - self.p2)
        start = {"height": height, "advance": turns * self.p1, "spin": turns * TURN}
        loads = {"push": JointEffort(joint="height", effort=Constant(value=-push))}
        run = Statics(hold={"spin": turns * TURN}, start=start, loads=loads).solve(press, Accuracy(), anywhere).rows
        found = of(run, "height", "joint.spin.effort", "loop.T1.force.z", "loop.T1.moment.z", "loop.T2.moment.z")[:, 0]
        right = [height, push * (self.p1 - self.p2) / TURN, push, -push * self.p1 / TURN, -push * self.p2 / TURN]
        assert found == pytest.approx(right, rel=1e-10)

    def test_a_free_spindle_is_accelerated_as_by_one_inertia(self, press):
        """``I = m_s r^2 / 2 + m_s h1^2 + m_n (h1 - h2)^2`` about the axis, h = p / (2 pi)."""
        h1, h2, push = self.p1 / TURN, self.p2 / TURN, 2000.0
        outcome = freely(press, 0.5, 5, loads={"push": JointEffort(joint="height", effort=Constant(value=push))})
        run = outcome.rows
        inertia = 0.8 * 0.01**2 / 2 + 0.8 * h1**2 + 0.5 * (h1 - h2) ** 2
        rate = push * (h1 - h2) / inertia
        assert of(run, "joint.spin.acceleration") == pytest.approx(rate, rel=1e-9)
        assert of(run, "spin")[0] == pytest.approx(rate * run.grid.t**2 / 2, rel=1e-9)
        assert of(run, "spin")[0, -1] > 100 * TURN
        assert outcome.measures()["energy"] < 1e-9
