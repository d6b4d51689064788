"""Which mechanisms have variants, and what these have."""

from pathlib import Path

import numpy as np

from pinarm import Mechanism
from pinarm.engine.mechanism import mechanism_variants
from pinarm.mechanics.geometry.link_tree import LinkTree


def test_a_branch_that_the_model_does_not_take_is_marked(tmp_path: Path) -> None:
    (tmp_path / "rod.urdf.xacro").write_text(
        '<robot name="rod" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="m" default="1"/>'
        '<xacro:property name="m" value="$(arg m)"/><link name="ground"/><link name="rod"><inertial>'
        '<mass value="${m if m &lt; 2 else 10*m}"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
        '<joint name="pivot" type="continuous"><parent link="ground"/><child link="rod"/></joint></robot>'
    )
    mechanism = Mechanism.load(tmp_path / "rod.urdf.xacro", {"m": 1.0})
    found, holds = mechanism_variants(mechanism, {"m": 1.0}, {"m": [1.0, 1.5, 3.0]})
    assert holds.tolist() == [True, True, False]
    np.testing.assert_array_equal(LinkTree.of(found.model).masses[:2, 1], [1.0, 1.5])
