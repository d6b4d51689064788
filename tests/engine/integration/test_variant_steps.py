"""Motions of variants in compiled code, each with a flow of its own, against each integrated by itself."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration import compiled_batch
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.integration.variant_steps import integrate_variants
from pinarm.engine.kernel.library import absence
from pinarm.engine.kernel.tree import CompiledTree
from pinarm.engine.kernel.tree_variants import TreeVariants
from tests.mechanics.geometry.random_variants import random_variants

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

METHOD, COUNT, JOINTS = Adaptive(1e-9), 5, 3


@pytest.mark.parametrize("room", [16384, 40])
def test_steps_and_states_are_those_of_each_by_itself(room, monkeypatch):
    """In one round and in many; each on an interval of its own, with errors relative to a size of its own."""
    monkeypatch.setattr(compiled_batch, "ROOM", room)
    rng = np.random.default_rng(4)
    pin.seed(4)
    variants, models = random_variants(rng, JOINTS, COUNT)
    flow = CompiledTree.of(variants.first).flow(np.zeros(JOINTS), [])
    start, end = np.zeros(COUNT), np.linspace(0.3, 0.5, COUNT)
    y, size = rng.normal(size=(COUNT, 2 * JOINTS)), np.array([1.0, 1.0, 0.1, 1.0, 1e-3])
    given = y.copy()
    solution = integrate_variants(TreeVariants.of(flow, variants), METHOD, start, end, y, size, 10_000)
    np.testing.assert_array_equal(y, given)
    assert solution.arrived.all()
    t = np.linspace(0.0, 1.0, 11)[:, None] * end
    states = solution.states_in(solution.located(np.arange(COUNT), t), t)
    for k, model in enumerate(models):
        dynamics = Dynamics.of(model)
        compiled = CompiledTree.of(model).flow(np.zeros(JOINTS), [])
        interval = Interval(0.0, end[k], dynamics.acceleration(), batch=dynamics.accelerations(), size=size[k],
                            compiled=compiled)  # fmt: skip
        alone = integrate([interval], dynamics.manifold, y[k, :JOINTS], y[k, JOINTS:], METHOD)
        assert solution.counts[k] == len(alone.steps)
        expected = np.concatenate(alone.states(t[:, k]), axis=1)
        np.testing.assert_allclose(states[:, k], expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


def test_a_motion_with_too_many_steps_has_not_arrived():
    variants, _ = random_variants(np.random.default_rng(1), JOINTS, 2)
    flow = CompiledTree.of(variants.first).flow(np.zeros(JOINTS), [])
    y = np.zeros((2, 2 * JOINTS))
    y[1, JOINTS:] = 100.0
    solution = integrate_variants(
        TreeVariants.of(flow, variants), METHOD, np.zeros(2), np.full(2, 0.05), y, np.ones(2), 6
    )
    assert not solution.arrived[1]
