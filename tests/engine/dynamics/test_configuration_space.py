"""Configurations that are no plain numbers: their rates and projection, against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics.dynamics import configuration_space


class TestJointSpace:
    @pytest.fixture
    def joints(self):
        model = pin.Model()
        ball = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
        model.addJoint(ball, pin.JointModelRUBX(), pin.SE3.Identity(), "wheel")
        return model

    def test_rows_are_what_each_is(self, joints, differentiate):
        """Of balls, which have formulas of their own, and of joints that have none."""
        rng, balls = np.random.default_rng(3), pin.Model()
        ends = [balls.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "shoulder")]
        for joint, name in ((pin.JointModelRX(), "elbow"), (pin.JointModelSpherical(), "wrist")):
            ends.append(balls.addJoint(ends[-1], joint, pin.SE3.Identity(), name))
        for model in (joints, balls):
            one = configuration_space(model)
            raw, v = rng.normal(size=(5, one.nq)), rng.normal(size=(5, one.nv))
            q = one.project(raw)
            assert q == pytest.approx(np.array([pin.normalize(model, row) for row in raw]), abs=1e-14)
            changes = [
                differentiate(lambda t, model=model, q=a, v=b: pin.integrate(model, q, t * v), 0.0)
                for a, b in zip(q, v, strict=True)
            ]
            assert one.velocity(q, v) == pytest.approx(np.array(changes), abs=1e-11)
