"""Trees side by side against each tree alone."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.side_by_side import WIDTH, SideBySide
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantsDiffer
from pinarm.records import replace
from tests.mechanics.geometry.random_variants import random_variants

ROUNDING = 1e-11
"""Of trees of up to seven joints with masses of any size: inertias go through dynamic parameters and back."""


def with_bodies_only(variants: ModelVariants) -> ModelVariants:
    return replace(variants, moved=(), turns=variants.turns[:, :0], shifts=variants.shifts[:, :0])


@pytest.mark.parametrize("bodies", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_recursions_are_those_of_each_tree_alone(seed: int, bodies: bool) -> None:
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    joints, n = int(rng.integers(1, 8)), 3
    count = WIDTH // joints + 2  # more than stand side by side, and not a multiple of it
    variants, models = random_variants(rng, joints, count)
    if bodies:
        variants.first.armature[:] = rng.random(joints)
        variants = with_bodies_only(variants)
        models = [variants.tree(k) for k in range(count)]
    q, v, a = rng.normal(size=(3, n, 1, joints))
    outside = rng.normal(size=(n, count, joints + 1, 6)) * (rng.random(joints + 1) < 0.5)[:, None]
    together = SideBySide(variants)
    tau, mass = together.rnea(q, v, a), together.mass_matrices(q)
    accelerations = together.aba(q, v, tau), together.aba_one_by_one(q, v, tau)
    inner = together.transmitted(LinkPlacements.at(variants, q), q, v, a, outside)
    for k, model in enumerate(models):
        alone = Dynamics.of(model).recursions
        states = q[:, 0], v[:, 0], a[:, 0]
        np.testing.assert_allclose(tau[:, k], alone.rnea(*states), atol=ROUNDING, rtol=ROUNDING)
        np.testing.assert_allclose(mass[:, k], alone.mass_matrices(q[:, 0]), atol=ROUNDING, rtol=ROUNDING)
        back = alone.aba(*states[:2], tau[:, k])
        for given in accelerations:
            np.testing.assert_allclose(given[:, k], back, atol=ROUNDING * np.abs(back).max())
        own = alone.transmitted(LinkPlacements.at(model, q[:, 0]), *states, outside[:, k])
        np.testing.assert_allclose(inner[:, k], own, atol=ROUNDING, rtol=ROUNDING)


@pytest.mark.parametrize("bodies", [False, True])
def test_the_numbers_of_a_variant_do_not_depend_on_its_neighbours(bodies: bool) -> None:
    rng = np.random.default_rng(5)
    variants, _ = random_variants(rng, 3, 40)
    variants = with_bodies_only(variants) if bodies else variants
    q, v, a = rng.normal(size=(3, 2, 1, 3))
    every = SideBySide(variants).rnea(q, v, a)
    for some in (slice(0, 1), slice(7, 9), slice(20, 40)):
        fewer = replace(variants, parameters=variants.parameters[some], turns=variants.turns[some],
                        shifts=variants.shifts[some])  # fmt: skip
        np.testing.assert_array_equal(SideBySide(fewer).rnea(q, v, a), every[:, some])


def test_variants_have_no_forward_dynamics() -> None:
    variants, _ = random_variants(np.random.default_rng(5), 2, 3)
    with pytest.raises(VariantsDiffer, match="forward dynamics"):
        Dynamics.of_variants(variants).forward(0.0, np.zeros((1, 1, 2)), np.zeros((1, 1, 2)))
