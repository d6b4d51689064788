"""Recursions at many states: one thread and several, and variants against each of their models alone."""

import os
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics import dynamics as parallel
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from tests.mechanics.geometry.random_variants import random_variants

ROUNDING = 1e-11
"""Of trees of up to seven joints with masses of any size: inertias go through dynamic parameters and back."""


def test_threads_change_no_digit(monkeypatch):
    model = pin.buildSampleModelManipulator()
    states = np.random.default_rng(0).normal(size=(3, 500, model.nv))
    monkeypatch.setattr(parallel, "threads", lambda: 2)
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    alone = parallel.rnea(model, *states)
    monkeypatch.setattr(parallel, "MANY", 1)
    assert np.array_equal(parallel.rnea(model, *states), alone)


@pytest.mark.parametrize(("text", "number"), [("2,1", 2), ("9", 3), ("many", 3)])
def test_the_environment_may_allow_fewer_threads(monkeypatch, text, number):
    monkeypatch.setattr(parallel, "cores", lambda: 3)
    monkeypatch.setenv("OMP_NUM_THREADS", text)
    assert parallel.threads() == number


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_forked_process_takes_one_thread():
    """OpenMP counts on threads that a fork does not have, and would wait for them for ever."""
    script = (
        "import multiprocessing, numpy, pinocchio\n"
        "from pinarm.engine.dynamics import dynamics as parallel\n"
        "parallel.cores, parallel.MANY = (lambda: 2), 1\n"
        "model = pinocchio.buildSampleModelManipulator()\n"
        "states = numpy.random.default_rng(0).normal(size=(3, 500, model.nv))\n"
        "first, known = parallel.rnea(model, *states), parallel.threads()\n"
        "def child(out):\n"
        "    out.put((parallel.threads(), numpy.array_equal(parallel.rnea(model, *states), first)))\n"
        "context = multiprocessing.get_context('fork')\n"
        "out = context.Queue()\n"
        "process = context.Process(target=child, args=(out,), daemon=True)\n"
        "process.start()\n"
        "print(known, *out.get(timeout=20))\n"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["2", "1", "True"], done.stderr


@pytest.mark.parametrize("seed", range(2))
def test_the_recursions_of_variants_are_those_of_each_model_alone(seed: int) -> None:
    """Transmitted wrenches too, which are sums by numpy for variants and Pinocchio's for one model."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    joints, n, count = int(rng.integers(1, 8)), 3, 5
    variants, models = random_variants(rng, joints, count)
    q, v, a = rng.normal(size=(3, n, 1, joints))
    outside = rng.normal(size=(n, count, joints + 1, 6)) * (rng.random(joints + 1) < 0.5)[:, None]
    tau, mass = parallel.rnea(variants, q, v, a), parallel.mass_matrices(variants, q)
    accelerations = parallel.aba(variants, q, v, tau)
    inner = parallel.transmitted(LinkPlacements.at(variants, q), q, v, a, outside)
    for k, model in enumerate(models):
        states = q[:, 0], v[:, 0], a[:, 0]
        np.testing.assert_allclose(tau[:, k], parallel.rnea(model, *states), atol=ROUNDING, rtol=ROUNDING)
        np.testing.assert_allclose(mass[:, k], parallel.mass_matrices(model, q[:, 0]), atol=ROUNDING, rtol=ROUNDING)
        back = parallel.aba(model, *states[:2], tau[:, k])
        np.testing.assert_allclose(accelerations[:, k], back, atol=ROUNDING * np.abs(back).max())
        own = parallel.transmitted(LinkPlacements.at(model, q[:, 0]), *states, outside[:, k])
        np.testing.assert_allclose(inner[:, k], own, atol=ROUNDING, rtol=ROUNDING)
