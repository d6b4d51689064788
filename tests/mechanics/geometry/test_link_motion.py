"""Motions of links, read where Pinocchio writes them, against the recursion for variants, which has another route."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.geometry.link_motion import motion_of
from pinarm.mechanics.geometry.link_placements import moving
from pinarm.mechanics.geometry.pinocchio_data import WIDE

N = 3


def chain(count):
    model = pin.Model()
    for k in range(count):
        model.addJoint(k, pin.JointModelRX() if k % 2 else pin.JointModelPY(), pin.SE3.Random(), f"joint_{k}")
    return model


MODELS = {
    "held": pin.buildSampleModelManipulator, "floating": pin.buildSampleModelHumanoid, "one joint": lambda: chain(1),
    "no joint": pin.Model, "many joints": lambda: chain(WIDE + 1),
}  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
def test_what_is_read_is_what_the_recursion_for_variants_finds(name):
    model, generator = MODELS[name](), np.random.default_rng(1)
    q = np.array([pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv)) for _ in range(N)])
    v, a = generator.normal(size=(2, N, model.nv))
    links, *found = motion_of(model, q, v, a)
    motion_of(model, q[::-1], a, v)  # what has been read stays
    others, *expected = moving(model, q, v, a)
    for one, other in zip((links.turns, links.places, *found), (others.turns, others.places, *expected), strict=True):
        assert one == pytest.approx(other, abs=1e-12 * max(1.0, np.abs(other).max(initial=0.0)))
