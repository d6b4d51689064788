"""The order of every method: the slope of its error over the step, between the first digits and rounding."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.integration.methods import METHODS, stiff
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.integration.methods.stiff import Radau
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

from .known_motions import (
    ATTITUDE,
    PLANE,
    SPIN,
    attraction,
    body,
    equal_steps,
    measurable,
    orbit,
    slope,
    turned,
)

MODELS = Path(pinarm.__file__).parents[1] / "models"

MEASURED = {
    "stiff": lambda: Radau(1e-10, 3),
    "stiff, 5 stages": lambda: Radau(1e-10, 5),
    "stiff, 7 stages": lambda: Radau(1e-10, 7),
}
"""Members of a family whose order can be measured, in place of the one that a scenario gets or beside it."""

CASES = list(dict.fromkeys([*METHODS, *MEASURED]))
TOO_STEEP = {"stiff, 7 stages"}
"""On loops too few digits lie between the first and rounding."""

ORDERS = {"dop853": 8, "dopri5": 5, "rk4": 4, "stiff": 5, "stiff, 5 stages": 9, "stiff, 7 stages": 13}
"""As published; a method beyond these is held to the order that it declares."""

FREE_LOOPS = {
    "crank_rocker": {
        "start": {"A": 0.8, "theta4": 1.8},
        "initial": {"position": {"theta2": 0.0}, "velocity": {"theta2": 12.0}},
    },
    "rssr": {
        "start": {"A_z": 1.57, "A_y": -0.7, "phi": 0.23},
        "initial": {"position": {"theta": 0.0, "spin": 0.0}, "velocity": {"theta": 15.0, "spin": 5.0}},
    },
}


@pytest.fixture(params=CASES)
def method(request, monkeypatch):
    """A method that never refuses a step."""
    monkeypatch.setattr(stiff, "ITERATIONS", 30)  # large steps with errors near rounding take more than are allowed
    return made(request.param)


def made(name):
    return MEASURED[name]() if name in MEASURED else METHODS[name].make(1.0)


@pytest.mark.parametrize("name", ORDERS)
def test_the_declared_order_is_the_published_one(name):
    assert made(name).order == ORDERS[name]


def dense_order(solution, method):
    """Power of h of the error between steps: the dense output's degree and one, or less where the steps are."""
    terms = method.dense_output(solution.intervals[0], solution.manifold, solution.steps.some(np.arange(1)))
    return min(method.order, terms.shape[1] + 1)


def test_in_the_plane(method):
    t = np.linspace(0.0, 6.0, 997)
    interval = Interval(0.0, 6.0, attraction)

    def errors(n):
        solution, last = equal_steps(method, interval, PLANE, *orbit(0.0), n)
        between = np.abs(np.hstack(solution.states(t)) - np.hstack(orbit(t))).max()
        return np.abs(last - np.hstack(orbit(6.0))).max(), between, dense_order(solution, method)

    counts, (ends, between, dense) = measurable(
        method, errors, 2e-12, 1e-4
    )  # iterations end, and rounding begins, at 1e-12
    assert slope(counts, ends) > method.order - 0.8  # dopri5: 4.3, its error changes sign nearby
    assert slope(counts, between) > dense[0] - 0.7  # 7 stages: 7.4 of 8, the steps are long


def test_on_rotations(method):
    dynamics, t = body(), np.linspace(0.0, 4.0, 997)
    interval = Interval(0.0, 4.0, dynamics.acceleration())

    def errors(n):
        solution, last = equal_steps(method, interval, dynamics.manifold, ATTITUDE, SPIN, n)
        between = np.abs(np.hstack(solution.states(t)) - turned()(t).T).max()
        return np.abs(last - turned()(4.0)).max(), between, dense_order(solution, method)

    counts, (ends, between, dense) = measurable(method, errors, 5e-12, 1e-4)  # the reference is right to 1e-12
    assert slope(counts, ends) > method.order - 0.3
    assert slope(counts, between) > dense[0] - 0.4


ON_LOOPS = [
    name if name in ("dop853", "stiff, 5 stages") else pytest.param(name, marks=pytest.mark.slow)
    for name in CASES
    if name not in TOO_STEEP
]
"""What projects is common to all methods; few steps are taken at a high order."""


@pytest.mark.parametrize("method", ON_LOOPS, indirect=True)
@pytest.mark.parametrize("model", ["crank_rocker", pytest.param("rssr", marks=pytest.mark.slow)])
def test_on_loops_with_projection(method, model):
    mechanism, end = Mechanism.load(MODELS / model / "mechanism.yaml"), 0.4
    hybrid = Forward(time=TimeGrid(end=end), **FREE_LOOPS[model]).prepare(
        mechanism, Accuracy(), lambda *path: nullcontext()
    )
    system, (q, v) = hybrid.closed_system, hybrid.begin()
    reference = integrate([system.interval(hybrid.dynamics, 0.0, end)], system.manifold, q, v, Adaptive(1e-13))
    last = np.hstack(reference.states(np.array([end])))[0]

    def errors(n):
        _, reached = equal_steps(method, system.interval(hybrid.dynamics, 0.0, end), system.manifold, q, v, n)
        return ((np.abs(reached - last) / (1.0 + np.abs(last))).max(),)

    counts, (ends,) = measurable(method, errors, 4e-12, 1e-4, first=20)  # iterations end at 1e-12
    assert slope(counts, ends) > method.order - 0.8
