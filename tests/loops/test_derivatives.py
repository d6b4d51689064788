"""Derivatives of the equation of motion of loops of every kind, against real differences of its terms in single states.

The terms are Pinocchio's ``rnea`` and the rows and drifts of the constraints in one state each.
"""

import numpy as np
import pinocchio as pin
import pytest
from linkage import GROUND, Linkage, random_body, random_joint
from test_kinds import KINDS

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.linear.derivatives import equation_derivatives

TOLERANCE = 1e-7
"""Rounding of terms of size 100 over steps of 2e-3, and the eighth order of these."""


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_the_slopes_of_the_terms(kind, tmp_path, differentiate):
    generator = np.random.default_rng(KINDS.index(kind))
    linkage = Linkage(
        {"A": random_body(generator), "B": random_body(generator)},
        {
            "pivot": random_joint(generator, "revolute", GROUND, "A"),
            "joint": random_joint(generator, kind, "A", "B"),
            "free": random_joint(generator, "free", GROUND, "B"),
        },
    )
    mechanism = linkage.build(tmp_path, ["joint"], forces={"pull": {
        "kind": "point_spring", "between": ["A", "B"], "stiffness": "90 N/m", "damping": "3 N*s/m",
        "free_length": "0.1 m",
    }})  # fmt: skip
    model, closure = mechanism.model, mechanism.closure
    q = pin.integrate(model, pin.neutral(model), 0.3 * generator.standard_normal(model.nv))
    v, a = generator.standard_normal((2, model.nv))
    lam = generator.standard_normal(closure.size)
    dynamics = Dynamics.of(model, mechanism.forces)

    def force(x, y):
        demanded = dynamics.inverse(0.0, x[None], y[None], a[None])[0]
        return demanded - closure.rows(closure.state(x)).T @ lam

    def acceleration(x, y):
        state = closure.state(x, y)
        return closure.rows(state) @ a + closure.drift(state)

    found = equation_derivatives(dynamics, closure.constraints, 0.0, q, v, a, lam)
    assert found.rows == pytest.approx(closure.rows(closure.state(q)), abs=1e-13)
    assert found.mass == pytest.approx(pin.crba(model, model.createData(), q), abs=1e-12)
    for k, way in enumerate(np.eye(model.nv)):

        def moved(x, way=way):
            return pin.integrate(model, q, x * way)

        pairs = [
            (found.force_q[:, k], lambda x: force(moved(x), v)),
            (found.force_v[:, k], lambda x, way=way: force(q, v + x * way)),
            (found.acceleration_q[:, k], lambda x: acceleration(moved(x), v)),
            (found.acceleration_v[:, k], lambda x, way=way: acceleration(q, v + x * way)),
            (found.rows_q[k] @ v, lambda x: closure.rows(closure.state(moved(x))) @ v),
        ]
        for slope, term in pairs:
            assert slope == pytest.approx(differentiate(term, 0.0, h=2e-3), abs=TOLERANCE)
