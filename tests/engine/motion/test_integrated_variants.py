"""Integrated motions of variants: their rows are those of each motion alone, at the same instants or at others."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.mechanism_variants import alike_variants, some_variants
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.integrated_variants import IntegratedVariants
from pinarm.mechanics.laws.motion_law import Grid

SWING = Path(__file__).parents[3] / "scenarios" / "gen411_arm_swing.yaml"


@pytest.fixture(scope="module")
def variants() -> IntegratedVariants:
    values = ["problem.time={end: 0.3 s, samples: 7}", "accuracy.tolerance=1e-6"]
    results = [pinarm.run(SWING, [*values, f"problem.initial.velocity.B={speed} rad/s"]) for speed in (0, 1, -2)]
    motions = [motion for one in results if isinstance(motion := one.outcome.motion, IntegratedMotion)]
    first = results[0].trajectory
    return IntegratedVariants(first, alike_variants(results[0].scenario.mechanism, 3), motions, [first.grid] * 3)


def test_rows_are_those_of_each_motion(variants: IntegratedVariants) -> None:
    rows, sound = variants.rows()
    assert sound.all()
    assert rows.grid.t.shape == (7,)
    for k, motion in enumerate(variants.motions):
        alone = motion.at(variants.run.grid)
        for own, other in ((rows.q, alone.q), (rows.v, alone.v), (rows.a, alone.a)):
            np.testing.assert_array_equal(own[:, k], other)


def test_some_of_them_at_other_instants_have_instants_of_their_own(variants: IntegratedVariants) -> None:
    places, cuts = np.array([2, 0]), variants.run.grid.cuts
    grids = [Grid(np.array(t), cuts, (0, 2)) for t in ((0.01, 0.02), (0.11, 0.25))]
    some = variants.some(some_variants(variants.mechanism, places), places, grids)
    rows, _ = some.at(np.zeros((2, 2, 2)))
    np.testing.assert_array_equal(rows.grid.t, [[0.01, 0.11], [0.02, 0.25]])
    for k, (place, grid) in enumerate(zip(places, grids, strict=True)):
        np.testing.assert_array_equal(rows.q[:, k], variants.motions[place].at(grid).q)
