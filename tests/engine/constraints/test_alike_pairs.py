"""Pairs that are evaluated as one, against each by itself."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.constraints.alike_pairs import BLOCK, alike_pairs
from pinarm.engine.constraints.batch_jacobians import BatchJacobians
from pinarm.engine.mechanism import Mechanism
from pinarm.records import replace

MODELS = Path(pinarm.__file__).parents[1] / "models"


def built(model):
    return Mechanism.load(MODELS / model / "mechanism.yaml")


def rows_of(measured, n, v):
    """Return gaps, rows and drifts as arrays."""
    m, nv = len(measured.gap()), len(v)
    return measured.gaps(n), measured.matrices((n, m, nv)), measured.drifts(v, m)


@pytest.mark.parametrize(("model", "n"), [
    ("two_four_bars", 1), ("planetary_gear", 3), ("andrews", BLOCK // 7), ("forty_four_bars", 3),
    pytest.param("forty_four_bars", BLOCK // 7, marks=pytest.mark.slow),  # more than fit at once
])  # fmt: skip
def test_each_pair_has_the_rows_that_it_has_by_itself(model, n):
    mechanism = built(model)
    nv = mechanism.model.nv
    q, v, w = np.random.default_rng(1).uniform(-1.0, 1.0, (3, nv, n))
    every = BatchJacobians.of(mechanism.model, mechanism.constraints)
    measured, cosine, sine = every.at(q), np.cos(q), np.sin(q)
    alone = type(measured)([(start, measure.at(q, cosine, sine)) for start, measure in every.parts])
    for rates in (v, w, v):  # what has been computed of other velocities is not taken for it
        for found, expected in zip(rows_of(measured, n, rates), rows_of(alone, n, rates), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)
    some = [0, every.size - 1]
    assert measured.rows(some).keys() == alone.rows(some).keys()
    assert measured.drift(some, v).keys() == alone.drift(some, v).keys()


def test_equal_cells_are_alike_and_others_are_not():
    groups = {model: BatchJacobians.of(built(model).model, built(model).constraints).alike
              for model in ("forty_four_bars", "andrews")}  # fmt: skip
    assert [len(pairs.places) for pairs in groups["forty_four_bars"]] == [40]
    assert sorted(place for pairs in groups["andrews"] for place in pairs.places) == [0, 1, 2]
    assert len(groups["andrews"]) == 3, "their bars have other lengths"


def test_a_pair_with_another_length_is_another_one():
    mechanism = built("forty_four_bars")
    measures = [measure for _, measure in BatchJacobians.of(mechanism.model, mechanism.constraints).parts]
    chain = measures[3].chain
    measures[3] = replace(measures[3], chain=replace(chain, shift=[x + 1e-15 for x in chain.shift]))
    assert sorted(len(pairs.places) for pairs in alike_pairs(measures)) == [1, 39]


DISC = """<robot name="disc"><link name="w"/><link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="A" type="continuous"><parent link="w"/><child link="a"/><axis xyz="0 0 1"/></joint></robot>"""


def test_a_pair_that_no_joint_moves_has_rows_of_zeros(tmp_path):
    """A disc whose plane is held once more; the drive holds its weight, ``m g r cos A``."""
    (tmp_path / "disc.urdf").write_text(DISC)
    gravity = {"direction": "-y", "magnitude": "9 m/s^2"}
    mechanism = {"pinarm": 1, "robot": str(tmp_path / "disc.urdf"), "gravity": gravity,
                 "loops": {"L": {"kind": "planar", "between": ["w", "a"], "axis": "z"}}}  # fmt: skip
    problem = {"kind": "statics", "over": {"A": {"from": "0 deg", "to": "60 deg", "samples": 3}}, "drives": ["A"]}
    with pinarm.file_root(tmp_path):
        result = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["joint.A.effort"]})
        closure = result.trajectory.mechanism.closure
    np.testing.assert_allclose(result["joint.A.effort"].values, 5.4 * np.cos(np.radians([0.0, 30.0, 60.0])), rtol=1e-14)
    measured, v = closure.batch_jacobians.at(np.ones((1, 3))), np.ones((1, 3))
    assert all(not x.any() for found in rows_of(measured, 3, v) for x in found)
