"""What joints transmit per unit of every multiplier, and what self-stresses add to it, by other routes."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import orth

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "loops"))
from catalogue import bennett, four_bar, parallelogram, scissor

from pinarm.engine.constraints.nullspace import Decomposition
from pinarm.engine.constraints.self_stresses import SelfStresses
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.loops.loop_joints import LoopJoint

LINKAGES = [bennett(), four_bar(), parallelogram(), scissor(4)]


@pytest.fixture(params=LINKAGES, ids=["bennett", "four-bar", "parallelogram", "scissor"])
def closure(request, tmp_path):
    return request.param.build(tmp_path).closure


def carried(closure, q, lam):
    """The wrenches of all joints that balance multipliers, summed over the links beyond each."""
    links = LinkPlacements.at(closure.model, q[None])
    acting = closure.wrenches(links, lam[None])
    return -links.at_joints(np.stack([acting[:, list(part)].sum(axis=1) for part in closure.model.subtrees], axis=1))[0]


def test_self_stresses_add_to_joints_what_a_basis_of_the_null_space_does(closure):
    q = np.zeros(closure.model.nq)
    stresses = SelfStresses(closure, q[None])
    basis = Decomposition.of(closure.rows(closure.state(q)), closure.reach).stresses
    assert stresses.degree == basis.shape[1] > 0
    every = np.array([carried(closure, q, lam) for lam in basis.T])
    pairs = [(stresses.on_joint(joint)[:, 0], every[:, joint]) for joint in range(1, closure.model.njoints)]
    for joint in closure.constraints:
        if isinstance(joint, LoopJoint):
            lam = basis[closure.slices[joint.name]].T
            links = LinkPlacements.at(closure.model, np.tile(q, (len(lam), 1)))
            pairs.append((stresses.on_loop(joint)[:, 0], joint.wrench(links, lam)))
    for added, wanted in pairs:
        found, other = (orth(np.where(np.abs(each) > 1e-12, each, 0.0).T, 1e-9) for each in (added, wanted))
        np.testing.assert_allclose(found @ found.T, other @ other.T, atol=1e-9)
