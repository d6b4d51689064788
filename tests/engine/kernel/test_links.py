"""Links as the library knows them."""

import pytest

from pinarm.engine.kernel.tree import KINDS, links_of

from .known_trees import JOINTS, UNKNOWN, tree


def test_every_kind_has_a_sample():
    assert set(JOINTS) == set(KINDS)


@pytest.mark.parametrize("name", UNKNOWN)
def test_a_tree_with_another_joint_is_not_known(name):
    assert links_of(tree(["RX", name], 0)) is None
