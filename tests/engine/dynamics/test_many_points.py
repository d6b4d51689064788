"""Many loops by sparse matrices against the dense route, and against the motion of one of them alone."""

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from benchmarks.growth import written
from pinarm.engine.constraints import nullspace
from pinarm.engine.dynamics.many_points import ManyPointConstraints
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.dynamics.pinocchio_constraints import PointConstraints

COUNT = 55
"""Four-bars, or crosses of a scissor: 111 and 110 velocities, a few more than are looked at as dense matrices."""


def test_accelerations_and_projections_of_the_dense_route(tmp_path):
    """Both solve with a proximal term of 1e-10; the condition of these loops, 1e3, leaves 1e-8 of their difference."""
    scenario = pinarm.Scenario.load(written(tmp_path, "fourbars", COUNT))
    mechanism, q = scenario.mechanism, scenario.run().trajectory.q[-1]
    model, closure = mechanism.model, mechanism.closure
    assert model.nv > nullspace.MANY
    many, dense = ManyPointConstraints.of(closure, q), PointConstraints.of(closure, q)
    assert many.tied.rank == dense.tied.rank and many.scale == pytest.approx(dense.scale, rel=1e-9)
    assert many.tied.regularity == pytest.approx(dense.tied.regularity, rel=1e-2)
    rows = closure.rows(closure.state(q))
    v = nullspace.split_rows(rows).free @ np.ones(model.nv - many.tied.rank)
    a, wanted = (one.acceleration(mechanism.dynamics, None, one.exact)(0.0, q, v) for one in (many, dense))
    np.testing.assert_allclose(a, wanted, atol=1e-8 * np.abs(wanted).max())
    off = rows @ a + closure.drift(closure.state(q, v))
    assert np.abs(off).max() < 1e-10 * np.abs(a).max()
    held = mass_matrix(model, q) @ a + pin.nonLinearEffects(model, mechanism.dynamics.data, q, v)
    free = nullspace.split_rows(rows).free
    assert np.abs(free.T @ held).max() < 1e-10 * np.abs(held).sum()  # what holds the loops does no work
    many.factorise(q)
    push = np.cos(np.arange(model.nv))
    left = push - many.step(many.rows() @ push)
    assert np.abs(rows @ left).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("family", ["fourbars", "scissor"])
def test_a_run_agrees_with_that_of_dense_matrices(family, tmp_path, monkeypatch):
    """Closing, rows and checks are others, the integrator is the same: what is left is rounding, and the tolerance."""
    path = written(tmp_path, family, COUNT)
    found = pinarm.Scenario.load(path).run()
    own = found.trajectory.q
    for name in (
        "engine.motion.systems",
        "engine.kinematics.newton",
        "engine.checks.residuals",
        "engine.dynamics.masses",
    ):
        monkeypatch.setattr(f"pinarm.{name}.MANY", 10**6)
    other = pinarm.Scenario.load(path).run()
    np.testing.assert_allclose(own, other.trajectory.q, atol=1e-9)
    for name in ("closure", "closure rate", "equilibrium", "return trip", "power"):
        assert max(float(found.figures[name]), float(other.figures[name])) < 1e-9, name
    for name in ("regularity", "condition"):
        assert float(found.figures[name]) == pytest.approx(float(other.figures[name]), rel=3e-2), name
