"""The loop joint ``screw`` against the coupling of that name, and against equations by hand."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from catalogue import RODS, disc, screw_jack
from linkage import GROUND, Joint, Linkage, random_body
from motions import anywhere, driven, free, freely

from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.forces.joint_forces import JointEffort
from pinarm.mechanics.laws import Constant, Cycloidal, Harmonic
from pinarm.mechanics.loops.lower_pairs import Helical
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.states import Statics
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

    @pytest.mark.parametrize("effort", [-3.0])
    def test_it_moves_as_with_the_coupling_for_many_turns(self, mechanism, effort):
        load = {"motor": JointEffort(joint="turn", effort=Constant(value=effort))}
        runs = [free(build(mechanism), 0.4, 9, loads=load) for build in (as_coupling, as_loop)]
        coupled, looped = (of(run, *STATE) for run in runs)
        assert abs(coupled[0, -1]) > 7.0 * TURN
        assert looped == pytest.approx(coupled, rel=1e-10, abs=1e-10)
        assert of(runs[1], "loop.thread.angle") == pytest.approx(-looped[:1], rel=1e-10, abs=1e-10)

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

    def test_guides_that_the_tree_repeats_are_undetermined(self, mechanism):
        loop = as_loop(mechanism)
        found = mobility_of(loop, pin.neutral(loop.model))
        assert (found.mobility, found.rows, found.degree) == (1, 5, 4)
        assert found.undetermined["thread"] == ["force x", "force y", "moment x", "moment y"]
        loosened = {joint for one in found.loosenings for joint, _ in one.changes}
        assert loosened == {"turn"}  # a nut that holds less slides, and so it does on any other guide
        with pytest.raises(InputError, match="hyperstatic of degree 4"):
            of(driven(loop, {"turn": Constant(value=0.0)}), "loop.thread.force.x")

    def test_an_offset_is_kept(self, mechanism):
        run = Statics(hold={"turn": 1.0}).solve(as_loop(mechanism, offset="2 mm"), Accuracy(), anywhere).rows
        assert of(run, "joint.height.position") == pytest.approx(0.002 + PITCH, rel=1e-12)
        assert of(run, "loop.thread.angle") == pytest.approx(-1.0, rel=1e-12)


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

    def test_nothing_is_held_twice(self, press):
        found = mobility_of(press, pin.neutral(press.model))
        assert (found.mobility, found.rows, found.degree, found.undetermined) == (1, 11, 0, {})

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
        assert outcome.figures["energy"] < 1e-9


class TestDefinition:
    def test_a_lead_of_0_is_refused(self):
        with pytest.raises(InputError, match="lead 0 does not advance") as caught:
            Helical(between=("a", "b"), lead=0.0)
        assert caught.value.hint == "kind: revolute"

    @pytest.mark.parametrize("turn", [-3.0, 0.0, 2.0])
    def test_the_open_way_is_taken_to_the_nearest_turn(self, turn):
        pair = Helical(between=("a", "b"), lead=LEAD, offset=0.001).pair()
        axes = pin.exp3(np.array([0.0, 0.0, turn])).T
        for whole in (-1000, -1, 0, 5):
            for way in (-0.45, 0.0, 0.3):
                place = np.array([0.0, 0.0, 0.001 + (turn / TURN + whole + way) * LEAD])
                assert pair.gap(place, axes)[-1] == pytest.approx(way * LEAD, abs=1e-13)


def test_a_contradicting_pair_of_threads_is_told(tmp_path):
    """Two nuts of other leads on one spindle, which the ground holds both."""
    generator = np.random.default_rng(0)
    place, turn = np.zeros(3), np.eye(3)
    linkage = Linkage({"A": random_body(generator)}, {
        "one": Joint("screw", GROUND, "A", place, turn, lead=0.01),
        "two": Joint("screw", GROUND, "A", place, turn, lead=0.03),
    })  # fmt: skip
    found = mobility_of(stuck := linkage.build(tmp_path), pin.neutral(stuck.model))
    assert (found.mobility, found.rows) == (0, 6)
    with pytest.raises((InputError, AssemblyError)):
        driven(stuck, {"one_b": Harmonic(amplitude=1.0, pulsation=1.0)})
