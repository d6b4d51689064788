"""Many motions integrated together, in compiled code and in Python, against each integrated by itself."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration import ensemble as ensembles
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.ensemble import integrate_variants
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.kernel.library import absence
from pinarm.engine.kernel.tree import CompiledTree
from pinarm.engine.kernel.tree_variants import variant_flows
from pinarm.mechanics.forces.joint_forces import AppliedEffort
from pinarm.mechanics.laws import Constant
from tests.mechanics.geometry.random_variants import random_variants

from ..kernel.known_trees import states
from .test_compiled_steps import intervals, regular

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

METHOD, COUNT, JOINTS = Adaptive(1e-9), 5, 3


@pytest.fixture(scope="module")
def motion():
    """A tree with a ball joint under a steady effort, and states of no special kind."""
    dynamics = regular(["RZ", "Spherical", "PX"], forces={"push": AppliedEffort(0, law=Constant(value=0.7))})
    compiled, _ = intervals(dynamics, 0.0, 1.5)
    q, v = (np.array(x) for x in zip(*states(dynamics.model, 9), strict=True))
    return dynamics.manifold, compiled[0], q, 0.5 * v


def test_motions_that_cannot_go_on_leave_the_others(motion):
    """One spins so fast that its steps are used up."""
    manifold, compiled, q, v = motion
    y = np.concatenate([q, v / 1e3], axis=1)
    usual = integrate_variants([compiled] * len(y), manifold, y, METHOD, 10_000)
    y[4, q.shape[1] :] *= 1e6
    most = 2 * usual.counts.max() + 20
    found = integrate_variants([compiled] * len(y), manifold, y, METHOD, most)
    assert list(found.failures) == [4]
    assert f"it has taken {most} steps" in found.failures[4]
    others = np.arange(len(y)) != 4
    assert (found.arrived == others).all()
    assert found.counts[others].tolist() == usual.counts[others].tolist()
    assert (found.sizes[others] == usual.sizes[others]).all()


@pytest.mark.parametrize("room", [16384, 40])
def test_variants_take_the_steps_of_each_by_itself(room, monkeypatch):
    """In one round and in many; each on an interval of its own, with errors relative to a size of its own."""
    monkeypatch.setattr(ensembles, "ROOM", room)
    rng = np.random.default_rng(4)
    pin.seed(4)
    variants, models = random_variants(rng, JOINTS, COUNT)
    flows, finite = variant_flows(CompiledTree.of(variants.first).flow(np.zeros(JOINTS), []), variants)
    assert finite.all()
    end, y, size = np.linspace(0.3, 0.5, COUNT), rng.normal(size=(COUNT, 2 * JOINTS)), [1.0, 1.0, 0.1, 1.0, 1e-3]
    dynamics = [Dynamics.of(model) for model in models]
    given = [Interval(0.0, end[k], dynamics[k].acceleration(), size=size[k], compiled=flows[k]) for k in range(COUNT)]
    found = integrate_variants(given, dynamics[0].manifold, y, METHOD, 10_000)
    assert found.arrived.all()
    t = np.linspace(0.0, 1.0, 11)[:, None] * end
    together = np.concatenate(found.states_in(found.located(np.arange(COUNT), t), t), axis=-1)
    for k, model in enumerate(models):
        compiled = CompiledTree.of(model).flow(np.zeros(JOINTS), [])
        interval = Interval(0.0, end[k], dynamics[k].acceleration(), size=size[k], compiled=compiled)
        alone = integrate([interval], dynamics[k].manifold, y[k, :JOINTS], y[k, JOINTS:], METHOD)
        assert found.counts[k] == len(alone.steps)
        expected = np.concatenate(alone.states(t[:, k]), axis=1)
        np.testing.assert_allclose(together[:, k], expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
