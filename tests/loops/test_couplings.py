"""Gears and screws against equations by hand; alone, and beside loops, which take another route through the engine."""

import numpy as np
import pytest
from catalogue import RODS, disc, five_bar
from motions import anywhere, driven, free, freely, poses, wrench
from newton_euler import Mesh, newton_euler

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant, Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Statics

J1, J2, J3, RATIO = 0.3, 0.05, 0.02, -2.5
M, LEAD, G = 7.0, 0.012, 9.81


WHEELS = disc("one", J1) + disc("two", J2, "1 0 0") + disc("three", J3, "2 0 0")
DISCS = f'<robot name="discs"><link name="base"/>{WHEELS}</robot>'
JACK = f"""<robot name="jack"><link name="base"/>{disc("screw", J1)}
  <link name="nut_link"><inertial><mass value="{M}"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="nut" type="prismatic"><parent link="base"/><child link="nut_link"/><axis xyz="0 0 1"/>
    <limit lower="-9" upper="9" effort="1e6" velocity="1e6"/></joint></robot>"""
BESIDE = {  # a second bearing of the first disc: it closes a loop and changes nothing
    "alone": {},
    "beside a loop": {"loops": {"bearing": {"kind": "revolute", "between": ["base", "one_link"], "axis": "z"}}},
}


def gear(one, two, ratio, **more):
    return {"kind": "gear", "joints": [one, two], "ratio": ratio, **more}


def angles(run, joint):
    return run.q[:, run.mechanism.joints[joint].q]


def speeds(run, joint):
    return run.v[:, run.mechanism.joints[joint].v]


def rates(run, joint):
    return run.a[:, run.mechanism.joints[joint].v]


@pytest.fixture(params=BESIDE)
def train(request, mechanism):
    """Three discs, the first two in mesh."""
    return mechanism(DISCS, couplings={"mesh": gear("one", "two", RATIO)}, **BESIDE[request.param])


class TestGear:
    def test_inertia_is_felt_by_the_square_of_the_ratio(self, train):
        outcome = freely(train, loads={"motor": JointEffort(joint="one", effort=Constant(value=4.0))})
        run = outcome.rows
        assert rates(run, "one") == pytest.approx(4.0 / (J1 + RATIO**2 * J2), rel=1e-12)
        assert rates(run, "two") == pytest.approx(RATIO * rates(run, "one"), rel=1e-12)
        assert rates(run, "three") == pytest.approx(0.0, abs=1e-12)
        assert angles(run, "two") == pytest.approx(RATIO * angles(run, "one"), abs=1e-12)
        assert outcome.measures()["energy"] < 1e-11

    def test_the_motor_torque_of_a_given_motion(self, train):
        law = Harmonic(amplitude=0.7, pulsation=3.0)
        run = driven(train, {"one": law, "three": Constant(value=0.2)})
        q = angles(run, "one")
        assert Quantities(run)["joint.one.effort"].values == pytest.approx((J1 + RATIO**2 * J2) * -9.0 * q, abs=1e-12)
        assert angles(run, "two") == pytest.approx(RATIO * q, abs=1e-12)

    def test_an_offset_is_kept(self, mechanism):
        geared = mechanism(DISCS, couplings={"mesh": gear("one", "two", RATIO, offset="0.3 rad")})
        run = driven(geared, {"one": Harmonic(amplitude=0.7, pulsation=3.0), "three": Constant(value=0.0)})
        assert angles(run, "two") == pytest.approx(RATIO * angles(run, "one") + 0.3, abs=1e-14)
        still = free(geared)
        assert angles(still, "two") == pytest.approx(RATIO * angles(still, "one") + 0.3, abs=1e-14)


@pytest.mark.parametrize("beside", BESIDE)
class TestTrain:
    """Three discs in mesh all round: the third coupling says what the other two say."""

    round = {"a": gear("one", "two", RATIO), "b": gear("two", "three", -4.0), "c": gear("one", "three", -4.0 * RATIO)}

    def test_a_coupling_that_says_it_again_changes_nothing(self, mechanism, beside):
        train = mechanism(DISCS, couplings=self.round, **BESIDE[beside])
        felt = J1 + RATIO**2 * J2 + (4.0 * RATIO) ** 2 * J3
        run = free(train, loads={"motor": JointEffort(joint="one", effort=Constant(value=4.0))})
        assert rates(run, "one") == pytest.approx(4.0 / felt, rel=1e-12)
        turned = driven(train, {"one": Harmonic(amplitude=0.7, pulsation=3.0)})
        assert Quantities(turned)["joint.one.effort"].values == pytest.approx(
            -9.0 * felt * angles(turned, "one"), abs=1e-12
        )

    def test_one_that_contradicts_blocks_the_train(self, mechanism, beside):
        blocked = {**self.round, "c": gear("one", "three", 7.0)}
        train = mechanism(DISCS, couplings=blocked, **BESIDE[beside])
        with pytest.raises(InputError, match="only 0 degrees of freedom"):
            driven(train, {"one": Harmonic(amplitude=0.7, pulsation=3.0)})

    def test_offsets_that_contradict_are_named(self, mechanism, beside):
        torn = {**self.round, "c": gear("one", "three", -4.0 * RATIO, offset="0.1 rad")}
        train = mechanism(DISCS, couplings=torn, **BESIDE[beside])
        for ask in (
            lambda: driven(train, {"one": Constant(value=0.0)}),
            lambda: free(train, loads={"motor": JointEffort(joint="one", effort=Constant(value=4.0))}),
        ):
            with pytest.raises((InputError, AssemblyError), match=r"a stays open by 0.02.* rad, and with it b, c"):
                ask()


class TestScrew:
    screw = {"thread": {"kind": "screw", "joints": ["screw", "nut"], "lead": f"{LEAD} m"}}

    def test_the_weight_turns_a_free_screw(self, mechanism):
        jack = mechanism(JACK, couplings=self.screw)
        run = free(jack)
        pitch = LEAD / (2 * np.pi)
        assert rates(run, "screw") == pytest.approx(-M * G * pitch / (J1 + M * pitch**2), rel=1e-12)


class TestJointWithoutADrive:
    """A joint that a coupling moves tells what the coupling does along it, one that has a drive what that does."""

    screw = TestScrew.screw

    def at_rest(self, mechanism, held, drives):
        return Statics(hold=held, drives=drives).solve(mechanism, Accuracy(), anywhere).rows

    def test_a_drive_on_the_nut_leaves_the_spindle_at_rest(self, mechanism):
        jack = mechanism(JACK, couplings=self.screw)
        found = Quantities(self.at_rest(jack, {"nut": 0.01}, ["nut"]))
        assert found["joint.nut.effort"].values == pytest.approx(M * G, rel=1e-14)
        assert found["joint.screw.effort"].values == pytest.approx(0.0, abs=1e-14)
        assert found["coupling.thread.effort"].values == pytest.approx(0.0, abs=1e-12)  # of 69 N

    def test_a_drive_without_load_gives_nothing_though_the_wheels_bear_on_each_other(self, mechanism):
        """Two wheels out of balance that balance each other through their teeth: 1 kg at 0.1 m each."""
        off = [disc(name, 0.1, at).replace("<inertial>", '<inertial><origin xyz="0.1 0 0"/>')
               for name, at in (("one", "0 0 0"), ("two", "0.5 0 0"))]  # fmt: skip
        xml = f'<robot name="pair"><link name="base"/>{"".join(off)}</robot>'
        gravity = {"direction": "-y", "magnitude": f"{G} m/s^2"}
        pair = mechanism(xml, gravity=gravity, couplings={"mesh": gear("one", "two", -1.0)})
        found = Quantities(self.at_rest(pair, {"one": 0.0}, ["one"]))
        assert found["joint.one.effort"].values == pytest.approx(0.0, abs=1e-14)
        assert found["joint.two.effort"].values == pytest.approx(0.1 * G, rel=1e-14)

    def test_in_motion_it_is_what_the_nut_asks(self, mechanism):
        jack = mechanism(JACK, couplings=self.screw)
        run = driven(jack, {"screw": Harmonic(amplitude=40.0, pulsation=3.0)})
        a = rates(run, "nut")
        found = Quantities(run)
        assert found["joint.nut.effort"].values == pytest.approx(M * (G + a), rel=1e-12)
        assert found["joint.nut.power"].values == pytest.approx(M * (G + a) * speeds(run, "nut"), rel=1e-12, abs=1e-12)
        fallen = free(jack)
        assert Quantities(fallen)["joint.nut.effort"].values == pytest.approx(M * (G + rates(fallen, "nut")), rel=1e-10)


class TestScrewThatDrivesALoop:
    """A screw moves the foot of a strut along x, its head lifts a table: ``(0.6 - x)^2 + h^2 = 0.5^2``."""

    def built(self, mechanism):
        return mechanism(
            RODS.format(screw=disc("screw", J1, axis="1 0 0"), mass=M),
            couplings={"thread": {"kind": "screw", "joints": ["screw", "nut"], "lead": f"{LEAD} m"}},
            loops={"head": {"kind": "revolute", "between": ["strut_end", "table"], "axis": "y"}},
        )

    def test_the_holding_torque_by_virtual_work(self, mechanism):
        x = 0.25
        start = {"foot": 0.8, "height": 0.3}
        run = (
            Statics(hold={"nut": x}, drives=["screw"], start=start)
            .solve(self.built(mechanism), Accuracy(), anywhere)
            .rows
        )
        h = np.sqrt(0.5**2 - (0.6 - x) ** 2)
        rise = (0.6 - x) / h  # dh/dx
        assert Quantities(run)["joint.height.position"].values == pytest.approx(h, rel=1e-14)
        found = Quantities(run)["joint.screw.effort"].values
        assert found == pytest.approx(M * G * rise * LEAD / (2 * np.pi), rel=1e-12)

    def test_the_free_fall_by_lagrange(self, mechanism):
        """The strut, the foot and the nut have no mass: one coordinate, the angle of the screw."""
        run = free(self.built(mechanism), 0.2, 5, position={"nut": 0.25}, start={"foot": 0.8, "height": 0.3})
        pitch = LEAD / (2 * np.pi)
        for angle, speed, found in zip(*(rate(run, "screw") for rate in (angles, speeds, rates)), strict=True):
            u = 0.6 - pitch * angle
            h = np.sqrt(0.25 - u * u)
            slope, bend = pitch * u / h, -(pitch**2) * 0.25 / h**3  # dh/dangle, its derivative
            right = (-M * G * slope - M * slope * bend * speed**2) / (J1 + M * slope**2)
            assert found == pytest.approx(right, rel=1e-11)


class TestGearedFiveBar:
    """The cranks of a five-bar, on the ground, in mesh with each other: loops and teeth together, one freedom."""

    R1, R2, ALPHA = 0.2, 0.4, np.deg2rad(20.0)

    def test_every_body_obeys_newton_and_euler_with_a_push_along_the_line_of_action(self, tmp_path):
        linkage = five_bar()
        mesh = gear("O", "C", -self.R1 / self.R2, pressure_angle="20 deg")
        run = free(linkage.build(tmp_path, ["M"], couplings={"mesh": mesh}), 0.4, 4)
        found = Quantities(run)
        # both cranks turn about y; where the first one turns forwards it goes against z at the pitch point
        ways = [np.array([np.sin(self.ALPHA), 0.0, sign * np.cos(self.ALPHA)]) for sign in (1.0, -1.0)]
        for i, pose in enumerate(poses(linkage, run)):
            answers = [newton_euler(linkage, pose, meshes=(Mesh("crank", "last", np.array([self.R1, 0.0, 0.0]), n),))
                       for n in ways]  # fmt: skip
            (right,) = [one for one in answers if one.pushes[0] > 0.0]  # teeth do not pull
            assert found["coupling.mesh.force.norm"].values[i] == pytest.approx(right.pushes[0], rel=1e-10)
            for joint in "OAMBC":
                told = wrench(linkage, run, joint)
                assert set(told) >= {"force.x", "force.z"}  # a plane linkage is hyperstatic across it
                for part, values in told.items():
                    k = ["force.x", "force.y", "force.z", "moment.x", "moment.y", "moment.z"].index(part)
                    assert values[i] == pytest.approx(right.wrench[joint][k], rel=1e-9, abs=1e-9)
