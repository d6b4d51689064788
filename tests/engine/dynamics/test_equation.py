"""The constrained solve against the dense equation in (a, lam), and every faster route against the solve.

The dense equation ``[M -G^T; G 0] [a; lam] = [f; b]`` is solved in the sense of least squares, so that redundant rows
do no harm; it shares nothing with the null-space form.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm import Mechanism
from pinarm.engine.constraints.nullspace import Decomposition
from pinarm.engine.dynamics.equation import accelerations
from pinarm.engine.kinematics.assembly import closed_drawing
from pinarm.engine.kinematics.newton import start_configuration

MODELS = Path(pinarm.__file__).parents[1] / "models"
CLOSED = {
    "crank_rocker": {"theta2": 0.7, "A": 0.8, "theta4": 1.8},
    "andrews": {},
    "bricard": {},
    "rssr": {},
    "manipulator": {},
    "two_four_bars": {"upright_0": 0.4, "upright_1": 0.4, "upright_2": 0.4, "coupler_0": -0.4, "coupler_1": -0.4},
}
"""Mechanisms with loops, the overconstrained Bricard linkage among them, and rough positions."""

ACCURATE = 1e-9
"""Relative agreement of two solutions: rounding times the condition of these linkages, up to 1e6."""


def state(name: str, seed: int) -> tuple[Mechanism, np.ndarray, np.ndarray, np.ndarray]:
    """Return a mechanism in a closed state with random velocities that the loops allow, and random efforts."""
    mechanism = Mechanism.load(MODELS / name / "mechanism.yaml")
    q = closed_drawing(mechanism.closure, start_configuration(mechanism, CLOSED[name])).q
    rows = mechanism.closure.rows(mechanism.closure.state(q))
    v, tau = np.random.default_rng(seed).normal(size=(2, mechanism.model.nv))
    return mechanism, q, v - np.linalg.pinv(rows, rcond=1e-9) @ (rows @ v), tau


def dense_accelerations(mechanism: Mechanism, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the accelerations by the dense equation, masses and bias forces from Pinocchio's own functions."""
    model, closure = mechanism.model, mechanism.closure
    data, here = model.createData(), closure.state(q, v)
    rows, m = closure.rows(here), closure.size
    upper = np.triu(pin.crba(model, data, q))
    mass = upper + np.triu(upper, 1).T
    force = tau + mechanism.dynamics.on(0.0, 1.0).loads(0.0, q, v) - pin.nonLinearEffects(model, data, q, v)
    # multipliers in the unit of the masses, and rows without length alone: the condition is that of the linkage
    whole = np.block([[mass, -rows.T], [rows, np.zeros((m, m))]])
    return np.linalg.lstsq(whole, np.concatenate([force, -closure.drift(here)]), rcond=1e-11)[0][: model.nv]


@pytest.mark.parametrize("seed", range(1))
@pytest.mark.parametrize("name", CLOSED)
class TestLoops:
    def test_accelerations_are_those_of_the_dense_equation(self, name, seed):
        mechanism, q, v, tau = state(name, seed)
        (a,) = accelerations(mechanism.dynamics.on(0.0, 1.0), mechanism.closure, 0.0, q[None], v[None], tau[None])
        right = dense_accelerations(mechanism, q, v, tau)
        assert a == pytest.approx(right, abs=ACCURATE * np.abs(right).max())

    def test_efforts_and_multipliers_leave_nothing_of_the_equation(self, name, seed):
        mechanism, q, v, tau = state(name, seed)
        dynamics, closure = mechanism.dynamics.on(0.0, 1.0), mechanism.closure
        (a,) = accelerations(dynamics, closure, 0.0, q[None], v[None], tau[None])
        rows = closure.rows(closure.state(q))
        held = dynamics.inverse(0.0, q, v, a)[0] - tau
        assert rows.T @ Decomposition.of(rows).multipliers(held) == pytest.approx(held, abs=1e-9 * np.abs(held).max())
