"""Variants of a text with columns against the model of each text alone, and what is left to be read alone."""

import numpy as np
import pytest

from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.model_variants import VariantsDiffer, placements_of
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.mechanics.loading.urdf_variants import model_variants

TEXT = """<robot name="crane">
  <link name="base"><inertial><mass value="7"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="post"/>
    <origin xyz="0 0 {height}" rpy="0.1 0.2 {yaw}"/><axis xyz="0 0 1"/></joint>
  <link name="post"><inertial><origin xyz="0 {centre} 0.1" rpy="0.3 {roll} 0.1"/><mass value="{mass}"/>
    <inertia ixx="0.3" ixy="0.01" iyy="0.2" izz="{inertia}"/></inertial>
    <visual><geometry><sphere radius="{height}"/></geometry></visual></link>
  <joint name="weld" type="fixed"><parent link="post"/><child link="head"/><origin xyz="{centre} 0 1"/></joint>
  <link name="head"><inertial><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link>
  <joint name="reach" type="prismatic"><parent link="head"/><child link="hook"/><origin rpy="0 0.4 0" xyz="0.1 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="{limit}" effort="1" velocity="1"/></joint>
  <link name="hook"><inertial><mass value="2"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
</robot>"""
PLAIN = {"height": 1.0, "yaw": 0.5, "centre": 0.2, "roll": 0.7, "mass": 3.0, "inertia": 0.4, "limit": 2.0}


def variants(**columns: list[float]) -> tuple:
    """Return variants of the crane, which of them are possible, and the model of each alone."""
    models = [build_model(TEXT.format(**PLAIN | dict(zip(columns, row, strict=True)))).model
              for row in zip(*columns.values(), strict=True)]  # fmt: skip
    first = TEXT.format(**PLAIN | {name: values[0] for name, values in columns.items()})
    marked = TEXT.format(**PLAIN | {name: f"word_{name}" for name in columns})
    found = model_variants(
        models[0], first, marked, {f"word_{name}": np.array(values) for name, values in columns.items()}
    )
    return *found, models


@pytest.mark.parametrize("names", [["roll"], ["inertia"], ["height", "yaw", "centre", "mass"]])
def test_bodies_and_placements_are_those_of_each_text_alone(names: list[str]) -> None:
    rng = np.random.default_rng(1)
    columns = {name: (PLAIN[name] + rng.uniform(-0.1, 0.1, 6)).tolist() for name in names}
    found, possible, models = variants(**columns)
    assert possible.all()
    tree, (turns, shifts) = LinkTree.of(found), placements_of(found)
    for k, model in enumerate(models):
        place = k if len(turns) > 1 else 0
        for joint in range(1, model.njoints):
            np.testing.assert_allclose(tree.inertias[k, joint], model.inertias[joint].matrix(), atol=1e-14)
            np.testing.assert_allclose(turns[place, joint], model.jointPlacements[joint].rotation, atol=1e-15)
            own = shifts[k if len(shifts) > 1 else 0, joint]
            np.testing.assert_allclose(own, model.jointPlacements[joint].translation, atol=1e-15)
        for frame, same in zip(model.frames, found.frames, strict=True):
            if frame.name in ("post", "head", "hook"):
                shift = np.broadcast_to(same.placement.translation, (6, 3))[k]
                np.testing.assert_allclose(shift, frame.placement.translation, atol=1e-15)


def test_what_no_body_can_be_is_marked() -> None:
    _, possible, _ = variants(mass=[1.0, 2.0])
    assert possible.tolist() == [True, True]
    first, marked = (
        TEXT.format(**PLAIN),
        TEXT.format(**PLAIN | {"mass": "w_mass", "inertia": "w_inertia", "height": "w_height"}),
    )
    columns = {
        "w_mass": [3.0, -1.0, 3.0, 3.0, 3.0], "w_inertia": [0.4, 0.4, 5.0, -0.1, 0.4],
        "w_height": [1.0, 1.0, 1.0, 1.0, float("nan")],
    }  # fmt: skip
    arrays = {word: np.array(values) for word, values in columns.items()}
    _, possible = model_variants(build_model(first).model, first, marked, arrays)
    assert possible.tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('name="head"', 'name="word"'), ('axis xyz="1 0 0"', 'axis xyz="word 0 1"'),
        ('mass value="2"', 'mass value="-word"'),
    ],
)  # fmt: skip
def test_words_that_stand_elsewhere_are_not_followed(old: str, new: str) -> None:
    text = TEXT.format(**PLAIN)
    with pytest.raises(VariantsDiffer):
        model_variants(build_model(text).model, text, text.replace(old, new), {"word": np.array([1.0, 2.0])})
