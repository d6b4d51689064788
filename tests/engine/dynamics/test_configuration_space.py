"""Configurations that are no plain numbers: their rates and projection, against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.configuration_space import ConfigurationSpace


class TestJointSpace:
    @pytest.fixture
    def space(self):
        model = pin.Model()
        ball = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
        model.addJoint(ball, pin.JointModelRUBX(), pin.SE3.Identity(), "wheel")
        return ConfigurationSpace(model, model.nq, model.nv)

    def test_velocity_is_the_derivative_along_the_manifold(self, space, differentiate):
        rng = np.random.default_rng(1)
        q, v = pin.normalize(space.model, rng.normal(size=space.nq)), rng.normal(size=space.nv)
        change = differentiate(lambda t: pin.integrate(space.model, q, t * v), 0.0)
        assert space.velocity(q, v) == pytest.approx(change, abs=1e-11)

    def test_rows_are_what_each_is(self, space, differentiate):
        """Of balls, which have formulas of their own, and of joints that have none."""
        rng, balls = np.random.default_rng(3), pin.Model()
        ends = [balls.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "shoulder")]
        for joint, name in ((pin.JointModelRX(), "elbow"), (pin.JointModelSpherical(), "wrist")):
            ends.append(balls.addJoint(ends[-1], joint, pin.SE3.Identity(), name))
        for one in (space, ConfigurationSpace(balls, balls.nq, balls.nv)):
            raw, v = rng.normal(size=(5, one.nq)), rng.normal(size=(5, one.nv))
            q = one.project(raw)
            assert q == pytest.approx(np.array([pin.normalize(one.model, row) for row in raw]), abs=1e-14)
            changes = [
                differentiate(lambda t, model=one.model, q=a, v=b: pin.integrate(model, q, t * v), 0.0)
                for a, b in zip(q, v, strict=True)
            ]
            assert one.velocity(q, v) == pytest.approx(np.array(changes), abs=1e-11)

    def test_projection_keeps_what_is_on_it_and_takes_rows(self, space):
        rng = np.random.default_rng(2)
        rows = rng.normal(size=(4, space.nq))
        found = space.project(rows)
        assert np.linalg.norm(found[:, 3:7], axis=1) == pytest.approx(1.0, abs=1e-14)
        assert np.linalg.norm(found[:, 7:], axis=1) == pytest.approx(1.0, abs=1e-14)
        assert np.array_equal(found[:, :3], rows[:, :3])
        assert np.array_equal(found[2], space.project(rows[2]))
        assert space.project(found) == pytest.approx(found, abs=1e-14)
