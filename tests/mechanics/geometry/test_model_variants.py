"""Variants of random trees against Pinocchio's model of each variant alone."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.geometry.link_placements import moving
from tests.mechanics.geometry.random_variants import random_variants

ROUNDING = 1e-12
"""Of chains of up to ten joints with lengths of about 1: some hundred operations."""


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("alike", [True, False])
def test_motions_are_those_of_each_model_alone(seed: int, alike: bool) -> None:
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    joints, count, n = int(rng.integers(1, 10)), 7, 4
    variants, models = random_variants(rng, joints, count)
    q, v, a = rng.normal(size=(3, n, 1 if alike else count, joints))
    found = moving(variants, q, v, a)
    for k, model in enumerate(models):
        own = 0 if alike else k
        expected = moving(model, q[:, own], v[:, own], a[:, own])
        _close(found[0].turns, expected[0].turns, k)
        _close(found[0].places, expected[0].places, k)
        for one, other in zip(found[1:], expected[1:], strict=True):
            _close(one, other, k)
        for frame in range(model.nframes):
            for one, other in zip(found[0].frame(frame), expected[0].frame(frame), strict=True):
                _close(one, other, k)


def _close(found: np.ndarray, expected: np.ndarray, k: int) -> None:
    """Compare variant k of an array; an axis of length 1 stands for all variants."""
    own = found[:, k if found.shape[1] > 1 else 0]
    np.testing.assert_allclose(own, np.broadcast_to(expected, own.shape), atol=ROUNDING, rtol=ROUNDING)
