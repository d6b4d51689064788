"""Integrated motions of variants: their rows are those of each motion alone, at the same instants or at others."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.kernel.library import absence
from pinarm.engine.mechanism import alike_variants
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.variants import FreeMotion, IntegratedVariants
from pinarm.records import replace

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

SWING = Path(__file__).parents[3] / "scenarios" / "gen411_arm_swing.yaml"


@pytest.fixture(scope="module")
def motions() -> list[IntegratedMotion]:
    values = ["problem.time={end: 0.3 s, samples: 7}", "accuracy.tolerance=1e-6"]
    results = [pinarm.run(SWING, [*values, f"problem.initial.velocity.B={speed} rad/s"]) for speed in (0, 1, -2)]
    return [motion for one in results if isinstance(motion := one.outcome.motion, IntegratedMotion)]


@pytest.fixture(scope="module")
def variants(motions: list[IntegratedMotion]) -> IntegratedVariants:
    first, t = motions[0], np.linspace(0.0, 0.3, 7)
    grid = first.hybrid.grid(t)
    given = [FreeMotion(*one.hybrid.start, one.hybrid.time, grid) for one in motions]
    return IntegratedVariants.integrated(first.at(grid), first, alike_variants(first.mechanism, 3), given)


def test_rows_are_those_of_each_motion(variants: IntegratedVariants, motions: list[IntegratedMotion]) -> None:
    rows, sound = variants.rows()
    assert sound.all()
    assert rows.grid.t.shape == (7,)
    for k, motion in enumerate(motions):
        alone = motion.at(variants.run.grid)
        for own, other in ((rows.q, alone.q), (rows.v, alone.v), (rows.a, alone.a)):
            np.testing.assert_allclose(own[:, k], other, rtol=0.0, atol=1e-12 * np.abs(other).max())


def test_motions_that_the_library_gets_wrong_are_not_sound(
    variants: IntegratedVariants, monkeypatch: pytest.MonkeyPatch
) -> None:
    intervals = list(variants.ensemble.solution.intervals)
    right = intervals[1].acceleration
    intervals[1] = replace(intervals[1], acceleration=lambda t, q, v: right(t, q, v) * (1.0 + 1e-9))
    monkeypatch.setattr(variants.ensemble.solution, "intervals", intervals)
    fresh = variants.some(variants.mechanism, np.arange(3), variants.grids)
    assert fresh.rows()[1].tolist() == [True, False, True]
