"""What is said of looser joints, against the linkage that has them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from pinarm.records import replace

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "loops"))
from catalogue import bennett, four_bar, parallelogram, scissor

from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import looser


@pytest.mark.parametrize(("linkage", "cut"), [
    (four_bar(), ["B"]), (four_bar(("revolute", "spherical", "revolute", "revolute")), ["B"]),
    (bennett(), ["axis_1"]), (parallelogram(), ["b", "d"]),
], ids=["four-bar", "four-bar with a ball", "bennett", "parallelogram"])  # fmt: skip
def test_a_loosened_linkage_is_as_hyperstatic_as_was_said_and_moves_as_before(linkage, cut, tmp_path):
    tight = linkage.build(tmp_path, cut)
    found = mobility_of(tight, np.zeros(tight.model.nq))
    assert found.loosenings
    for one in found.loosenings:
        joints = {name: replace(linkage.joints[name], kind=kind) for name, kind in one.changes}
        loose = replace(linkage, joints={**linkage.joints, **joints}).build(tmp_path, cut)
        after = mobility_of(loose, np.zeros(loose.model.nq))
        assert (after.degree, after.mobility) == (one.degree, found.mobility), str(one)


@pytest.mark.parametrize(("linkage", "cut"), [
    (four_bar(), ["A"]), (four_bar(("revolute", "spherical", "revolute", "revolute")), ["C"]),
    (bennett(), ["axis_2"]), (parallelogram(), ["b", "d"]), (scissor(3), ()),
], ids=["four-bar", "four-bar with a ball", "bennett", "parallelogram", "scissor"])  # fmt: skip
def test_what_is_not_said_of_loop_joints_would_free_a_motion(linkage, cut, tmp_path):
    tight = linkage.build(tmp_path, cut)
    found = mobility_of(tight, np.zeros(tight.model.nq))
    loops = [one for one in tight.closure.constraints if isinstance(one, LoopJoint)]
    told = {one.changes for one in found.loosenings}
    for joint, kind in ((one, kind) for one in loops for kind, _ in looser(one.pair)):
        joints = {**linkage.joints, joint.name: replace(linkage.joints[joint.name], kind=kind)}
        loose = replace(linkage, joints=joints).build(tmp_path, [each.name for each in loops])
        after = mobility_of(loose, np.zeros(loose.model.nq))
        assert (((joint.name, kind),) in told) == (after.mobility == found.mobility), (joint.name, kind)
