"""Rates of coordinates at the start of a motion: of a loop joint, of sums, and what contradicts itself."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from pinarm.engine.dynamics.equation import mass_matrix
from pinarm.errors import InputError
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[3] / "models"


def start(mechanism, **initial):
    problem = Forward(time=TimeGrid(end=0.01, samples=2), initial=InitialState(**initial))
    return problem.solve(mechanism, Accuracy(), lambda *path: nullcontext()).rows


def test_the_rate_of_a_loop_joint_is_met():
    """Slider-crank: the rod turns by psi' = -w r cos(theta) / (L cos(psi)), and the joint B by its opposite."""
    mechanism = Mechanism.load(MODELS / "slider_crank" / "mechanism.yaml")
    rows = start(mechanism, position={"theta": 1.0}, velocity={"B.angle": 2.0})
    r, length, e = (mechanism.arguments[name] for name in ("r", "L", "e"))
    psi = np.arcsin((e - r * np.sin(1.0)) / length)
    rate = rows.v[0, mechanism.joints["theta"].v]
    assert abs(rate) == pytest.approx(2.0 * length * np.cos(psi) / (r * np.cos(1.0)), rel=1e-9)
    state = mechanism.closure.state(rows.q[0])
    assert mechanism.coordinate("B.angle").row(state) @ rows.v[0] == pytest.approx(2.0, rel=1e-12)


def test_a_sum_leaves_the_rest_to_the_masses(mechanism, chain):
    """Of all velocities with a' + b' = 1 that of least kinetic energy, and the one with a' = 3."""
    bodies = [{"name": name, "axis": "0 -1 0", "com": "0.5 0 0"} for name in "ab"]
    arm = mechanism(chain(*bodies), coordinates={"total": {"kind": "sum", "of": ["a", "b"]}})
    v = start(arm, velocity={"total": 1.0}).v[0]
    momentum = np.linalg.inv(mass_matrix(arm.model, np.zeros(2))) @ np.ones(2)
    assert v == pytest.approx(momentum / momentum.sum(), rel=1e-12)
    assert start(arm, velocity={"total": 1.0, "a": 3.0}).v[0] == pytest.approx([3.0, -2.0], rel=1e-12)


def test_rates_that_contradict_each_other_are_refused(mechanism, chain):
    bodies = [{"name": name, "axis": "0 -1 0"} for name in "ab"]
    arm = mechanism(chain(*bodies), coordinates={"total": {"kind": "sum", "of": ["a", "b"]}})
    with pytest.raises(InputError, match="cannot be had at once"):
        start(arm, velocity={"total": 1.0, "a": 3.0, "b": 3.0})
