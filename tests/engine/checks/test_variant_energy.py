"""The energy balance of variants together, against that of each motion alone."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.checks.balance import variant_energies
from pinarm.engine.kernel.library import absence
from pinarm.engine.mechanism import alike_variants
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.variants import FreeMotion, IntegratedVariants
from pinarm.records import replace

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

SWING = Path(__file__).parents[3] / "scenarios" / "gen411_arm_swing.yaml"
DAMPED = "problem.loads={drag: {kind: joint_spring, joint: B, stiffness: 2 N*m/rad, damping: 0.05 N*m*s/rad}}"


@pytest.mark.parametrize("load", [[], [DAMPED]], ids=["free", "damped"])
def test_it_is_that_of_each_alone_and_shows_a_wrong_weight(load: list[str]) -> None:
    """At a tolerance of 1e-5 the energy drifts by far more than rounding."""
    values = ["problem.time={end: 1 s, samples: 9}", "accuracy.tolerance=1e-5", *load]
    results = [pinarm.run(SWING, [*values, f"problem.initial.velocity.B={speed} rad/s"]) for speed in (0, 1, -8)]
    motions = [motion for one in results if isinstance(motion := one.outcome.motion, IntegratedMotion)]
    first, grid = motions[0], results[0].trajectory.grid
    given = [FreeMotion(*one.hybrid.start, one.hybrid.time, grid) for one in motions]
    together = IntegratedVariants.integrated(results[0].trajectory, first, alike_variants(first.mechanism, 3), given)
    energy = variant_energies(together.dynamics, together.ensemble, together.interpolated)
    alone = np.array([one.figures["energy"] for one in results])
    assert (alone > 1e-9).all()
    np.testing.assert_allclose(energy, alone, rtol=0.0, atol=1e-13)  # roundings of energies of the size exchanged

    model = first.mechanism.model.copy()
    model.gravity.linear = 1.01 * model.gravity.linear
    wrong = replace(together, mechanism=alike_variants(replace(first.mechanism, model=model), 3))
    assert (variant_energies(wrong.dynamics, wrong.ensemble, wrong.interpolated) > 1e-4).all()
