"""Free motions of variants in compiled code: their slopes against Pinocchio's, variant by variant."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kernel.tree import CompiledTree, TreeFlow
from pinarm.engine.kernel.tree_variants import variant_flows
from pinarm.records import replace
from tests.mechanics.geometry.random_variants import random_variants

pytestmark = pytest.mark.usefixtures("compiled")

ROUNDING = 1e-9
"""Of trees with masses of any size, relative to the largest acceleration."""


@pytest.mark.parametrize("seed", range(3))
def test_slopes_are_those_of_each_tree(seed):
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    variants, models = random_variants(rng, 4, 7)
    flow = CompiledTree.of(variants.first).flow(np.zeros(4), [])
    assert isinstance(flow, TreeFlow)
    flows, finite = variant_flows(flow, variants)
    assert finite.all()
    motions, y = [3, 0, 6, 3], rng.normal(size=(4, 8))
    slopes = np.array([flows[motion].slope(0.0, state) for motion, state in zip(motions, y, strict=True)])
    np.testing.assert_array_equal(slopes[:, :4], y[:, 4:])
    for k, motion in enumerate(motions):
        expected = Dynamics.of(models[motion]).acceleration()(0.0, y[k, :4], y[k, 4:])
        np.testing.assert_allclose(slopes[k, 4:], expected, rtol=0.0, atol=ROUNDING * np.abs(expected).max())


def test_numbers_that_are_not_finite_are_told():
    variants, _ = random_variants(np.random.default_rng(1), 2, 3)
    parameters = variants.parameters.copy()
    parameters[1, 0, 0] = np.nan
    flow = CompiledTree.of(variants.first).flow(np.zeros(2), [])
    assert variant_flows(flow, replace(variants, parameters=parameters))[1].tolist() == [True, False, True]
