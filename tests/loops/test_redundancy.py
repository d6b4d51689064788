"""Joints that hold more than once: what is determined all the same is right, and what is not is not said.

What is determined follows here from the joints of all bodies alike, none of them being a tree's: a component is, unless
some set of joint forces without any load has a part in it.
"""

import numpy as np
import pytest
from catalogue import bennett, bricard, four_bar, manipulator, parallelogram, shaft
from linkage import GROUND, Joint, Linkage
from motions import anywhere, driven, free, poses, wrench
from newton_euler import newton_euler, self_stresses

from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import DrivesError
from pinarm.mechanics.laws import Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Statics

COMPONENTS = [f"{part}.{axis}" for part in ("force", "moment") for axis in "xyz"]
CASES = {  # degree of hyperstatism by counting: 6 bodies - rows + mobility
    "four-bar": (four_bar(), 5 * 4 - 6 * 3 + 1, [["O"], ["B"]]),
    "parallelogram": (parallelogram(), 5 * 7 - 6 * 5 + 1, [["b", "d"], ["foot_1", "foot_2"]]),
    "bennett": (bennett(), 5 * 4 - 6 * 3 + 1, [["axis_1"], ["axis_2"]]),
    "bricard": (bricard(), 5 * 6 - 6 * 5 + 1, [["P5"], ["P2"]]),
    "shaft": (shaft(), 5 + 4 + 4 - 6 + 1, [["middle", "right"], ["left", "right"]]),
}
every_cut = pytest.mark.parametrize(
    ("name", "cut"), [(name, cut) for name, (_, _, cuts) in CASES.items() for cut in cuts], ids=str, scope="class"
)


@pytest.fixture(scope="class")
def run(name, cut, tmp_path_factory):
    """A motion of a linkage that has been cut."""
    return free(CASES[name][0].build(tmp_path_factory.mktemp("linkage"), cut), 0.2, 3)


@every_cut
class TestHyperstatic:
    def test_the_degree_is_counted(self, name, run):
        _, degree, _ = CASES[name]
        found = mobility_of(run.mechanism, run.q[-1])
        assert (found.degree, found.mobility) == (degree, 1)

    def test_what_no_self_stress_reaches_is_determined_and_right(self, name, run):
        linkage, degree, _ = CASES[name]
        pose = poses(linkage, run)[-1]
        right, stresses = newton_euler(linkage, pose), self_stresses(linkage, pose)
        assert right.redundant == len(stresses) == degree
        for body in linkage.bodies:
            assert pose.acceleration[body] == pytest.approx(right.acceleration[body], rel=1e-9, abs=1e-9)
            assert pose.alpha[body] == pytest.approx(right.alpha[body], rel=1e-9, abs=1e-9)
        for joint in linkage.joints:
            reached = np.abs([stress[joint] for stress in stresses]).max(axis=0) > 1e-8
            found = wrench(linkage, run, joint)
            assert set(found) == {component for component, doubt in zip(COMPONENTS, reached, strict=True) if not doubt}
            for component, values in found.items():
                wanted = right.wrench[joint][COMPONENTS.index(component)]
                assert values[-1] == pytest.approx(wanted, rel=1e-9, abs=1e-9)

    def test_the_multipliers_are_the_least_that_do_it(self, run):
        closure = run.mechanism.closure
        for q, lam in zip(run.q, run.lam, strict=True):
            state = closure.state(q)
            across = closure.rows(state).T
            assert lam == pytest.approx(np.linalg.lstsq(across, across @ lam, rcond=1e-9)[0], rel=1e-9, abs=1e-9)

    def test_the_rest_is_marked_and_keeps_every_body_in_balance(self, name, run):
        linkage, degree, _ = CASES[name]
        pose = poses(linkage, run)[-1]
        found = {joint: wrench(linkage, run, joint, "minimum_norm") for joint in linkage.joints}
        for body, content in linkage.bodies.items():
            force = content.mass * (pose.acceleration[body] + [0.0, 0.0, linkage.gravity])
            inertia = pose.turn[body] @ content.inertia @ pose.turn[body].T
            moment = inertia @ pose.alpha[body] + np.cross(pose.omega[body], inertia @ pose.omega[body])
            for name_, joint in linkage.joints.items():
                sign = (joint.second == body) - (joint.first == body)
                pull = sign * np.array([found[name_][component][-1] for component in COMPONENTS])
                at = end_of(linkage, pose, joint)
                force = force - pull[:3]
                moment = moment - pull[3:] - np.cross(at - pose.place[body], pull[:3])
            assert force == pytest.approx(0.0, abs=1e-9)
            assert moment == pytest.approx(0.0, abs=1e-9)
        loop = next(iter(run.mechanism.closure.slices))
        doubts = {Quantities(run, undetermined="minimum_norm")[f"loop.{loop}.{one}"].doubt for one in COMPONENTS}
        assert any(f"degree {degree}" in doubt for doubt in doubts)


def end_of(linkage, pose, joint):
    """Where frame 2 of a joint is."""
    body = joint.second
    if body == GROUND:
        return joint.end()
    return pose.place[body] + pose.turn[body] @ (joint.end() - linkage.bodies[body].com)


def test_in_the_plane_a_loosened_four_bar_has_the_same_forces(tmp_path):
    plane, loose = four_bar(), four_bar(("revolute", "spherical", "cylindrical", "revolute"))
    runs = [(one, free(one.build(tmp_path, ["B"]), 0.4, 5)) for one in (plane, loose)]
    assert [mobility_of(run.mechanism, run.q[0]).degree for _, run in runs] == [3, 0]
    for joint in plane.joints:
        tight, relaxed = (wrench(one, run, joint) for one, run in runs)
        assert set(tight) == {"force.x", "force.z", "moment.y"}
        assert len(relaxed) == 6
        for component, values in tight.items():
            assert values == pytest.approx(relaxed[component], rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(("tip", "degree"), [("spherical", 4), ("revolute", 6)])
def test_the_manipulator_is_hyperstatic_of_the_degree_that_its_publication_counts(tip, degree, tmp_path):
    """Three out of the plane for the parallelogram; one along z for the cylinder's loop, three with a pivot there."""
    linkage = manipulator()
    along_z = linkage.joints["F"].turn
    changed = linkage.joints["D"]
    changed = Joint(tip, changed.first, changed.second, changed.place, along_z)
    mechanism = Linkage(linkage.bodies, {**linkage.joints, "D": changed}).build(tmp_path, ["F", "D"])
    assert mobility_of(mechanism, np.zeros(mechanism.model.nq)).degree == degree


class TestDrives:
    law = {"O": Harmonic(amplitude=0.4, pulsation=2.0)}

    def test_two_motors_on_one_freedom_are_refused_by_name(self, tmp_path):
        mechanism = four_bar().build(tmp_path, ["B"])
        with pytest.raises(
            DrivesError, match="more drives than degrees of freedom, 2 and 1: the efforts of O, C are not"
        ):
            driven(mechanism, self.law, drives=["O", "C"])


class TestStructure:
    """A triangle of two bars on hinges carries its weight; nothing can move."""

    def built(self, tmp_path):
        linkage = four_bar()
        bars = {name: linkage.bodies[name] for name in ("crank", "coupler")}
        joints = {"O": linkage.joints["O"], "A": linkage.joints["A"]}
        place = linkage.joints["B"].place
        joints["B"] = Joint("revolute", GROUND, "coupler", place, linkage.joints["B"].turn)
        return Linkage(bars, joints), Linkage(bars, joints).build(tmp_path, ["B"])

    def test_its_reactions_are_those_of_statics(self, tmp_path):
        linkage, mechanism = self.built(tmp_path)
        run = Statics().solve(mechanism, Accuracy(), anywhere).rows
        right = newton_euler(linkage, poses(linkage, run)[0])
        for joint in linkage.joints:
            found = wrench(linkage, run, joint)
            assert set(found) == {"force.x", "force.z", "moment.y"}
            for component, values in found.items():
                wanted = right.wrench[joint][COMPONENTS.index(component)]
                assert values[0] == pytest.approx(wanted, rel=1e-12, abs=1e-12)
