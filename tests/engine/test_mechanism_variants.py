"""Which mechanisms have variants, and what these have."""

from pathlib import Path

import numpy as np
import pytest

from pinarm import Mechanism
from pinarm.engine.mechanism import mechanism_variants
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.model_variants import VariantsDiffer

MODELS = Path(__file__).parents[2] / "models"
ARM = MODELS / "gen411_arm" / "mechanism.yaml"


def test_masses_lengths_and_arguments_are_those_of_each_mechanism_alone() -> None:
    given, lengths, masses = {"l2": 0.3, "m_A": 0.2}, [0.3, 0.1, 0.5], [0.2, 0.4, 0.1]
    found, holds = mechanism_variants(Mechanism.load(ARM, given), given, {"l2": lengths, "m_A": masses})
    assert holds.all()
    np.testing.assert_array_equal(found.arguments["l2"], lengths)
    assert found.arguments["l1"] == 0.25
    tree = LinkTree.of(found.model)
    for k, (length, mass) in enumerate(zip(lengths, masses, strict=True)):
        alone = LinkTree.of(Mechanism.load(ARM, {"l2": length, "m_A": mass}).model)
        np.testing.assert_allclose(tree.inertias[k], alone.inertias, atol=1e-14)


def test_couplings_are_not_followed() -> None:
    mechanism = Mechanism.load(MODELS / "planetary_gear" / "mechanism.yaml")
    argument = next(iter(mechanism.arguments))
    with pytest.raises(VariantsDiffer, match="couplings"):
        mechanism_variants(mechanism, {}, {argument: [1.0, 2.0]})


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
