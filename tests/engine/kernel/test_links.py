"""Links as the library knows them."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.kernel.tree import KINDS, links_of

from .known_trees import JOINTS, UNKNOWN, tree


def test_every_kind_has_a_sample():
    assert set(JOINTS) == set(KINDS)


@pytest.mark.parametrize("name", UNKNOWN)
def test_a_tree_with_another_joint_is_not_known(name):
    assert links_of(tree(["RX", name], 0)) is None


@pytest.mark.parametrize("name", JOINTS)
def test_a_sample_is_the_joint_that_it_is_named_after(name):
    model = tree([name], 0)
    assert model.joints[1].shortname() == f"JointModel{name}"
    known = links_of(model)
    (link,), screws = known.links, known.screws
    assert (link["parent"], link["q"], link["v"], len(screws)) == (-1, 0, 0, model.nv)


@pytest.mark.parametrize("axis", [[0, -1, 0], [0, 0, 1], [0.48, 0.6, 0.64]])
def test_the_axis_of_a_joint_is_the_z_axis_of_its_link(axis):
    model = pin.Model()
    model.addJoint(0, pin.JointModelRevoluteUnaligned(np.array(axis, float)), pin.SE3.Identity(), "j")
    links = links_of(model).links
    rotation = links["rotation"][0]
    assert rotation[:, 2] == pytest.approx(axis, abs=1e-14)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)


def test_bodies_keep_their_principal_moments():
    """They are invariant to the axes in which the body stands; the inertia is about the frame's origin."""
    model = tree(["RevoluteUnaligned"], 3)
    body = model.inertias[1]
    links = links_of(model).links
    xx, xy, xz, yy, yz, zz = links["inertia"][0]
    ours = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert ours == pytest.approx(np.linalg.eigvalsh(body.matrix()[3:, 3:]), rel=1e-13)
    assert links["mass"][0] == body.mass
    assert np.linalg.norm(links["moment"][0]) == pytest.approx(np.linalg.norm(body.lever) * body.mass)
