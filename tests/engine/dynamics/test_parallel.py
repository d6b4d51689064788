"""Recursions at many states of variants against each of their models alone."""

import os
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics import dynamics as parallel
from pinarm.mechanics.geometry.link_placements import LinkPlacements, transmitted
from tests.mechanics.geometry.random_variants import random_variants

ROUNDING = 1e-11
"""Of trees of up to seven joints with masses of any size: inertias go through dynamic parameters and back."""


@pytest.mark.parametrize("seed", range(2))
def test_the_recursions_of_variants_are_those_of_each_model_alone(seed: int) -> None:
    """Transmitted wrenches too, against those of Pinocchio's recursion."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    joints, n, count = int(rng.integers(1, 8)), 3, 5
    variants, models = random_variants(rng, joints, count)
    q, v, a = rng.normal(size=(3, n, 1, joints))
    outside = rng.normal(size=(n, count, joints + 1, 6)) * (rng.random(joints + 1) < 0.5)[:, None]
    tau, mass = parallel.rnea(variants, q, v, a), parallel.mass_matrices(variants, q)
    accelerations = parallel.aba(variants, q, v, tau)
    inner = transmitted(LinkPlacements.at(variants, q), q, v, a, outside)
    for k, model in enumerate(models):
        states = q[:, 0], v[:, 0], a[:, 0]
        np.testing.assert_allclose(tau[:, k], parallel.rnea(model, *states), atol=ROUNDING, rtol=ROUNDING)
        np.testing.assert_allclose(mass[:, k], parallel.mass_matrices(model, q[:, 0]), atol=ROUNDING, rtol=ROUNDING)
        back = parallel.aba(model, *states[:2], tau[:, k])
        np.testing.assert_allclose(accelerations[:, k], back, atol=ROUNDING * np.abs(back).max())
        data, links = model.createData(), LinkPlacements.at(model, q[:, 0])
        for row in range(n):
            loads = pin.StdVec_Force()
            loads.extend([pin.Force(load) for load in links.inwards(outside[:, k])[row]])
            pin.rnea(model, data, q[row, 0], v[row, 0], a[row, 0], loads)
            own = links.outwards(
                np.array([np.zeros(6), *(wrench.vector for wrench in list(data.f)[1:])])[None].repeat(n, 0)
            )
            np.testing.assert_allclose(inner[row, k], own[row], atol=ROUNDING, rtol=ROUNDING)


FORKED = """
import os, signal
import numpy as np, pinocchio as pin
from pinarm.engine.dynamics import dynamics

model = pin.buildSampleModelManipulator()
states = np.random.default_rng(3).normal(size=(3, dynamics.SHARED // model.nv + 1, model.nv))
many = dynamics.rnea(model, *states)
each = np.concatenate([dynamics.rnea(model, *some) for some in np.array_split(states, 9, axis=1)])
assert (many == each).all()
if not os.fork():
    signal.alarm(20)
    os._exit(0 if (dynamics.rnea(model, *states) == many).all() else 1)
assert os.wait()[1] == 0
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no forks")
def test_states_shared_by_threads_are_those_of_one_thread_and_a_fork_computes_them_too() -> None:
    """A fork has not the threads that OpenMP counts on, and would wait for them without end."""
    environment = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    subprocess.run([sys.executable, "-c", FORKED], check=True, env=environment, timeout=60)
