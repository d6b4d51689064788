"""What is said of looser joints, against the linkage that has them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from pinarm.records import replace

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "loops"))
from catalogue import bennett, four_bar, parallelogram

from pinarm.engine.kinematics.mobility import mobility_of


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
