"""Any joint may be the one that closes: the same linkage, cut at each of its joints in turn."""

import numpy as np
import pytest
from catalogue import five_bar, four_bar, manipulator, rssr, screw_jack, slider_crank
from motions import driven, free, poses, power, states, wrench

from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.laws import Harmonic, Trapezoid

CRANK = {"crank_angle": {"kind": "rotation", "body": "crank_com", "about": "y"}}
LAW = Harmonic(amplitude=1.2, pulsation=2.5)


LINKAGES = {
    "four-bar": four_bar(), "isostatic four-bar": four_bar(("revolute", "spherical", "cylindrical", "revolute")),
    "rsur": rssr(), "slider-crank": slider_crank(), "screw jack": screw_jack(), "manipulator": manipulator(),
}  # fmt: skip
CRANKS = {"manipulator": "alpha"}
CUTS = {
    name: [[joint] for joint in linkage.joints] if name != "manipulator" else [
        ["F", "D"], ["B", "D"], ["E", "x"], ["alpha", "D"], ["F", "y"],
    ] for name, linkage in LINKAGES.items()
}  # fmt: skip
LONG = ("screw jack", "manipulator")
by_linkage = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in LINKAGES]
)


def crank_of(name):
    return CRANKS.get(name, "O")


def turning(name, folder, cut):
    """The crank turned by a motor, which acts along the joint, or where that is cut between the ground and the link."""
    mechanism = LINKAGES[name].build(folder, cut, coordinates=CRANK)
    along = crank_of(name) if crank_of(name) in mechanism.joints else "crank_angle"
    law = LAW if name != "manipulator" else Harmonic(amplitude=0.5, pulsation=2.0)
    run = driven(mechanism, {along: law}, 1.4, 6)
    return run, Quantities(run)[f"coordinate.{along}.effort"].values


@by_linkage
class TestCutAtEachJointInTurn:
    def test_the_motion_under_weight_is_the_same(self, name, tmp_path):
        runs = [free(LINKAGES[name].build(tmp_path, cut), 0.5) for cut in CUTS[name]]
        assert {tuple(sorted_as(name, run.mechanism.closure.slices)) for run in runs} == {
            tuple(sorted_as(name, cut)) for cut in CUTS[name]
        }  # beside a screw in the tree, which is a coupling
        first, *others = (states(LINKAGES[name], run) for run in runs)
        for other in others:
            assert other == pytest.approx(first, rel=1e-9, abs=1e-8)

    def test_torque_and_determined_reactions_are_the_same_and_the_torque_drives_the_energy(self, name, tmp_path):
        linkage = LINKAGES[name]
        found = [turning(name, tmp_path, cut) for cut in CUTS[name]]
        for run, torque in found:
            rows = poses(linkage, run)
            assert torque == pytest.approx(found[0][1], rel=1e-11, abs=1e-11)
            speed = [pose.omega["crank"][1] for pose in rows]
            right = [power(linkage, pose) for pose in rows]
            assert torque * speed == pytest.approx(right, rel=1e-10, abs=1e-10)
        for joint in linkage.joints:
            seen = []
            for run, torque in found:
                components = wrench(linkage, run, joint)
                if joint == crank_of(name) and joint in run.mechanism.closure.slices:  # the motor acts beside it
                    components["moment.y"] = components["moment.y"] + torque
                seen.append(components)
            for components in seen[1:]:
                assert set(components) == set(seen[0])
                for component, values in components.items():
                    assert values == pytest.approx(seen[0][component], rel=1e-9, abs=1e-9)


class TestOneCrankFollowsALaw:
    """A linkage of two freedoms: the law holds one, the other is free."""

    law = Trapezoid(start=0.0, end=0.2, acceleration=8.0, begin=0.1)

    def run(self, tmp_path, cut):
        mechanism = five_bar().build(tmp_path, cut, coordinates=CRANK)
        along = "O" if "O" in mechanism.joints else "crank_angle"
        found = free(mechanism, 0.5, 15, motion={along: self.law})
        return found, Quantities(found)[f"coordinate.{along}.effort"].values

    def test_motion_and_torque_are_the_same_wherever_it_is_cut(self, tmp_path):
        runs = [self.run(tmp_path, [cut]) for cut in "OMC"]
        t = runs[0][0].grid.t
        assert len(t) == 21  # the acceleration jumps three times, which have two rows each
        first = states(five_bar(), runs[0][0])
        turned = [
            np.arctan2(pose.turn["crank"][0, 2], pose.turn["crank"][0, 0]) for pose in poses(five_bar(), runs[0][0])
        ]
        grid = runs[0][0].grid
        assert turned == pytest.approx(grid.evaluate(self.law)[0], abs=1e-12)
        for run, torque in runs[1:]:
            assert states(five_bar(), run) == pytest.approx(first, rel=1e-9, abs=1e-8)
            assert torque == pytest.approx(runs[0][1], rel=1e-9, abs=1e-8)


def sorted_as(name, cut):
    return [joint for joint in LINKAGES[name].joints if joint in cut]
