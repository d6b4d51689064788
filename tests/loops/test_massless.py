"""Bodies without mass inside of loops: what they transmit is exact, and where nothing holds them this is said."""

import numpy as np
import pytest
from catalogue import ABOUT_Y, axes_along, bar, rssr
from linkage import GROUND, Body, Joint, Linkage
from motions import driven, free, poses, wrench

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import DynamicsError
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.forces.points import PointSpring
from pinarm.mechanics.laws import Constant, Harmonic
from pinarm.records import replace

CUTS = pytest.mark.parametrize("cut", ["O", "B"])
LAW = {"O": Harmonic(amplitude=0.8, pulsation=3.0)}


def light(second="universal"):
    """The spatial four-bar with a coupler that has no mass."""
    linkage = rssr(second)
    return replace(linkage, bodies={**linkage.bodies, "coupler": Body(0.0, linkage.bodies["coupler"].com)})


def rod():
    """The same with a rod in place of the coupler, which is no body."""
    linkage = rssr()
    a, b = linkage.joints["A"].place, linkage.joints["B"].place
    tie = Joint("rod", "crank", "rocker", a, axes_along(b - a), float(np.linalg.norm(b - a)))
    bodies = {name: linkage.bodies[name] for name in ("crank", "rocker")}
    return Linkage(bodies, {"O": linkage.joints["O"], "C": linkage.joints["C"], "rod": tie})


def turning(linkage, run):
    """Angular velocities and accelerations of crank and rocker, over the rows."""
    return np.array(
        [[*pose.omega[name], *pose.alpha[name]] for pose in poses(linkage, run) for name in ("crank", "rocker")]
    )


class TestCouplerWithoutMass:
    @CUTS
    def test_it_moves_and_pulls_as_a_rod(self, cut, tmp_path):
        run = free(light().build(tmp_path, [cut]), 0.4)
        right = free(rod().build(tmp_path, ["rod"]), 0.4)
        assert turning(light(), run) == pytest.approx(turning(rod(), right), rel=1e-9, abs=1e-8)
        found, pull = wrench(light(), run, "B"), wrench(rod(), right, "rod")
        for axis in "xyz":
            assert found[f"force.{axis}"] == pytest.approx(pull[f"force.{axis}"], rel=1e-9, abs=1e-8)
            assert found[f"moment.{axis}"] == pytest.approx(0.0, abs=1e-9)

    @pytest.mark.parametrize("cut", ["A", "C"])
    def test_it_asks_for_the_same_torque(self, cut, tmp_path):
        torques = [
            Quantities(driven(one.build(tmp_path, [where]), LAW))["joint.O.effort"].values
            for one, where in ((light(), cut), (rod(), "rod"))
        ]
        assert torques[0] == pytest.approx(torques[1], rel=1e-11, abs=1e-11)

    @CUTS
    def test_where_it_can_spin_this_is_said(self, cut, tmp_path):
        with pytest.raises(DynamicsError, match=r"joints .*[AB]_[abc].* can move without mass"):
            free(light("spherical").build(tmp_path, [cut]))


class TestCylinderWithoutMass:
    """An arm that a cylinder between the ground and a point of it lifts with a constant force."""

    o, p, foot = np.array([0.0, 0.0, 1.0]), np.array([0.5, 0.0, 1.2]), np.array([0.6, 0.0, 0.0])
    force = 40.0

    def arm(self):
        return {"arm": bar(self.o, 2 * self.p - self.o, 3.0)}

    def built(self, tmp_path, tip, cut):
        along = axes_along(self.p - self.foot)
        bodies = {**self.arm(), "cylinder": Body(0.0, self.foot), "piston": Body(0.0, self.p)}
        joints = {
            "O": Joint("revolute", GROUND, "arm", self.o, ABOUT_Y),
            "G": Joint("revolute", GROUND, "cylinder", self.foot, ABOUT_Y),
            "slide": Joint("prismatic", "cylinder", "piston", self.foot, along),
            "P": Joint(tip, "piston", "arm", self.p, ABOUT_Y),
        }
        linkage = Linkage(bodies, joints)
        return linkage, linkage.build(tmp_path, [cut])

    @pytest.mark.parametrize(("tip", "cut"), [("revolute", "O"), ("spherical", "G"), ("spherical", "P")])
    def test_it_is_a_force_between_two_points(self, tip, cut, tmp_path):
        linkage, mechanism = self.built(tmp_path, tip, cut)
        run = free(mechanism, 0.5, loads={"air": JointEffort(joint="slide", effort=Constant(value=self.force))})
        ends = {name: Joint("free", GROUND, "arm", at) for name, at in (("p", self.p), ("foot", self.foot))}
        bare = Linkage(self.arm(), {"O": linkage.joints["O"], **ends})
        push = PointSpring(between=("foot_1", "p_2"), force=-self.force)  # a pull is positive
        right = free(bare.build(tmp_path, ["p", "foot"]), 0.5, loads={"air": push})
        found, wanted = (
            np.array([[pose.alpha["arm"][1], pose.omega["arm"][1]] for pose in poses(one, each)])
            for one, each in ((linkage, run), (bare, right))
        )
        assert np.abs(wanted).max() > 1.0
        assert found == pytest.approx(wanted, rel=1e-10, abs=1e-9)

    def test_its_pin_transmits_that_force(self, tmp_path):
        linkage, mechanism = self.built(tmp_path, "spherical", "P")
        run = free(mechanism, 0.5, loads={"air": JointEffort(joint="slide", effort=Constant(value=self.force))})
        found = wrench(linkage, run, "P")
        size = np.hypot(found["force.x"], found["force.z"])
        assert size == pytest.approx(self.force, rel=1e-12)
