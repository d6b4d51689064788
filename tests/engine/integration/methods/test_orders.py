"""The order of every method: the slope of its error over the step, between the first digits and rounding."""

from contextlib import nullcontext
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import pinarm
from pinarm.engine.integration import (
    METHODS,
    Adaptive,
    Collocation,
    MethodName,
    Radau,
    Stretch,
    integrate,
)
from pinarm.engine.integration.methods import collocation, stiff
from pinarm.engine.mechanism import Mechanism
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid

from .known_motions import (
    ATTITUDE,
    PLANE,
    SPIN,
    attraction,
    attractions,
    body,
    equal_steps,
    orbit,
    orbital_energy,
    slope,
    turned,
)

MODELS = Path(pinarm.__file__).parents[1] / "models"

# order of the step, and of the dense output; numbers of steps in the plane, on rotations, and on loops
CASES = {
    "dop853": (8, 8, [20, 26, 34, 44, 54], [6, 8, 11, 15, 20], [30, 38, 48, 60]),
    "conserving": (8, 8, [20, 26, 34, 44, 54], [6, 8, 11, 15, 20], [30, 38, 48, 60]),
    "dopri5": (5, 5, [40, 60, 90, 130, 200], [20, 30, 45, 70, 100], [80, 110, 150, 200]),
    "rk4": (4, 4, [60, 90, 130, 200, 300], [20, 30, 45, 70, 100], [200, 280, 400, 560]),
    "stiff": (5, 4, [30, 45, 70, 100, 140], [20, 30, 45, 70, 100], [70, 100, 140, 200]),
    "stiff, 5 stages": (9, 6, [8, 10, 12, 16, 20], [4, 5, 6, 8, 10], [25, 31, 38, 48]),
    "stiff, 7 stages": (13, 8, [7, 8, 9, 10], [4, 5], []),  # on loops too few digits lie between 0.1 and rounding
    "collocation": (8, 5, [12, 16, 22, 30, 40], [7, 9, 11, 14, 18], []),
}
MAKE = {
    "stiff": lambda: Radau(1e-10, 3),
    "stiff, 5 stages": lambda: Radau(1e-10, 5),
    "stiff, 7 stages": lambda: Radau(1e-10, 7),
    "collocation": lambda: Collocation(1e-14, nodes=4),  # of 16 the order is 32: too steep to be measured
}
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
def case(request, monkeypatch):
    """A method that never refuses a step, its orders, and numbers of steps."""
    monkeypatch.setattr(stiff, "ITERATIONS", 30)  # large steps with errors near rounding take more than are allowed
    monkeypatch.setattr(collocation, "MOST", 60)
    return MAKE.get(request.param, lambda: METHODS[request.param](1.0))(), *CASES[request.param]


def test_all_methods_are_here():
    assert {name.partition(",")[0] for name in CASES} == set(METHODS) == set(get_args(MethodName))


def test_in_the_plane(case):
    method, order, dense, counts, *_ = case
    t, ends, between = np.linspace(0.0, 6.0, 997), [], []
    for n in counts:
        solution, last = equal_steps(
            method, Stretch(0.0, 6.0, attraction, energy=orbital_energy, together=attractions), PLANE, *orbit(0.0), n
        )
        ends.append(np.abs(last - np.hstack(orbit(6.0))).max())
        between.append(np.abs(np.hstack(solution.states(t)) - np.hstack(orbit(t))).max())
    assert min(ends) > 3e-13  # rounding of 6 s is 1e-14
    assert max(ends) < 1e-4
    assert slope(counts, ends) > order - 0.8  # dopri5: 4.3, its error changes sign nearby
    assert slope(counts, between) > dense - 0.4  # 7 stages: 7.65, the steps are long
    assert method.order == order


def test_on_rotations(case):
    method, order, dense, _, counts, _ = case
    dynamics, t = body(), np.linspace(0.0, 4.0, 997)
    ends, between = [], []
    for n in counts:
        stretch = Stretch(0.0, 4.0, dynamics.acceleration(), energy=dynamics.conserved, together=dynamics.forward)
        solution, last = equal_steps(method, stretch, dynamics.manifold, ATTITUDE, SPIN, n)
        ends.append(np.abs(last - turned()(4.0)).max())
        between.append(np.abs(np.hstack(solution.states(t)) - turned()(t).T).max())
    assert min(ends) > 5e-12  # the reference is right to 1e-12
    assert max(ends) < 1e-4
    assert slope(counts, ends) > order - 0.3
    assert slope(counts, between) > dense - 0.3


@pytest.mark.parametrize("case", [name for name, (*_, counts) in CASES.items() if counts], indirect=True)
@pytest.mark.parametrize("model", FREE_LOOPS)
def test_on_loops_with_projection(case, model):
    method, order, _, _, _, counts = case
    mechanism, end = Mechanism.load(MODELS / model / "mechanism.yaml"), 0.4
    hybrid = Forward(time=TimeGrid(end=end), **FREE_LOOPS[model]).prepare(mechanism, lambda *path: nullcontext())
    system, (q, v) = hybrid.system(), hybrid.begin(hybrid.initial)
    reference = integrate([system.stretch(hybrid.dynamics, 0.0, end)], system.manifold, q, v, Adaptive(1e-13))
    last, ends = np.hstack(reference.states(np.array([end])))[0], []
    for n in counts:
        _, found = equal_steps(method, system.stretch(hybrid.dynamics, 0.0, end), system.manifold, q, v, n)
        ends.append((np.abs(found - last) / (1.0 + np.abs(last))).max())
    assert min(ends) > 3e-13  # the reference is right to 1e-13
    assert slope(counts, ends) > order - 0.8
