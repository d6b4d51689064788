import itertools
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.checks.balance import EnergyAccount, energy_balance, power_balance
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.mechanics.forces.along_coordinate import JointEffort, JointSpring
from pinarm.mechanics.laws import Constant, Harmonic, Polynomial, Trapezoid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.inverse import Inverse, Statics
from pinarm.problems.time_grid import TimeGrid
from pinarm.records import replace
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[3] / "models"
HONEST = 1e-13
"""Sums of a few dozen terms, relative to their size."""


def outcome(problem, mechanism, tolerance=1e-9):
    return problem.solve(mechanism, Accuracy(tolerance=tolerance), lambda *path: nullcontext())


def solve(problem, mechanism):
    return outcome(problem, mechanism).rows


@pytest.fixture(scope="module")
def arm():
    return Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml")


def effort(joint, law):
    return JointEffort(joint=joint, effort=law)


LOADS = {
    "spring": JointSpring(joint="O", stiffness=5.0, damping=0.4, rest=0.2),
    "damper": JointSpring(joint="B", damping=0.02),
    "push": effort("B", Trapezoid(start=0.0, end=1.0, acceleration=9.0, begin=0.3)),
    "swing": effort("O", Harmonic(amplitude=2.0, pulsation=5.0)),
    "steady": effort("O", Constant(value=0.7)),
}


@pytest.fixture(scope="module")
def inverse(arm):
    motion = {"O": Harmonic(amplitude=1.0, pulsation=3.0), "phi": Polynomial(start=0.0, end=2.0, duration=1.0)}
    return solve(Inverse(time=TimeGrid(end=2.0, samples=81), motion=motion, loads=LOADS), arm)


@pytest.fixture(scope="module")
def statics(arm):
    over = {"phi": {"from": -1.0, "to": 1.0, "samples": 31}}
    return solve(Statics(hold={"O": 0.3}, over=over, loads={"spring": LOADS["spring"]}), arm)


@pytest.fixture(scope="module")
def integrated(arm):
    initial = {"position": {"O": 0.4}, "velocity": {"B": 3.0}}
    return outcome(Forward(time=TimeGrid(end=2.0, samples=81), initial=initial, loads=LOADS), arm, 1e-12)


@pytest.fixture(scope="module")
def forward(integrated):
    return integrated.rows


class TestPowerBalance:
    def test_honest_runs_are_balanced_to_rounding(self, inverse, statics, forward):
        for run in (inverse, statics, forward):
            figures = power_balance(run)
            assert 0.0 <= figures["equilibrium"] < HONEST
            assert 0.0 <= figures["power"] < HONEST

    @pytest.mark.parametrize("joint", [1])
    @pytest.mark.parametrize("name", ["inverse", "statics"])
    def test_a_changed_effort_shows(self, request, name, joint):
        run = request.getfixturevalue(name)
        tau = run.tau.copy()
        tau[len(tau) // 2, joint] += 1e-6 * np.abs(tau).max()
        figures = power_balance(replace(run, tau=tau))
        assert figures["equilibrium"] > 1e-8

    @pytest.mark.parametrize("field", ["a", "v", "q"])
    @pytest.mark.parametrize("name", ["inverse", "forward"])
    def test_a_changed_motion_shows(self, request, name, field):
        run = request.getfixturevalue(name)
        figures = power_balance(replace(run, **{field: getattr(run, field) * (1 + 1e-6)}))
        assert figures["equilibrium"] > 1e-8

    def test_a_forgotten_load_shows(self, inverse):
        bare = replace(inverse, dynamics=Dynamics.of(inverse.mechanism.model))
        assert power_balance(bare)["equilibrium"] > 0.1

    def test_a_precession_without_moments_has_no_residual_of_rounding_over_rounding(self):
        """Its accelerations are rounding; an effort of 1e-6 of the gyroscopic moments, 0.12 N*m, is seen."""
        file = MODELS.parent / "scenarios" / "gyroscope_precession.yaml"
        run = pinarm.run(file, {"problem.time": {"end": "0.1 s", "samples": 5}}).trajectory
        assert np.abs(run.a).max() < 1e-13
        assert residual_figures(run)["return trip"] < 1e-13
        pushed = replace(run, tau=run.tau + 1e-6 * 0.12)
        assert residual_figures(pushed)["return trip"] > 1e-8


class TestEnergyBalance:
    def test_work_and_dissipation_are_accounted_for(self, integrated):
        assert integrated.measures()["energy"] < 1e-10  # a hundred times the tolerance

    @pytest.mark.parametrize("name", ["spring", "push"])
    def test_a_load_that_is_not_accounted_for_shows(self, arm, name):
        bound = {key: load.bind(arm.model, arm.joints) for key, load in LOADS.items()}
        bounds = [0.0, *(x for x in LOADS["push"].effort.breakpoints() if 0.0 < x < 2.0), 2.0]
        whole = Dynamics.of(arm.model, bound)
        less = Dynamics.of(arm.model, {key: force for key, force in bound.items() if key != name})
        pairs = list(itertools.pairwise(bounds))
        intervals = [Interval(low, high, whole.on(low, high).acceleration()) for low, high in pairs]
        solution = integrate(intervals, whole.manifold, np.array([0.4, 0.0]), np.array([0.0, 3.0]), Adaptive(1e-10))
        assert energy_balance(EnergyAccount(solution, [whole.on(*pair) for pair in pairs]))["energy"] < 1e-8
        assert energy_balance(EnergyAccount(solution, [less.on(*pair) for pair in pairs]))["energy"] > 1e-4

    def test_a_wrong_law_of_motion_shows(self, arm):
        honest = arm.dynamics.acceleration()
        skewed = Interval(0.0, 2.0, lambda t, q, v: honest(t, q, v) * (1 + 1e-6))
        solution = integrate([skewed], arm.dynamics.manifold, np.array([0.4, 0.0]), np.zeros(2), Adaptive(1e-12))
        assert energy_balance(EnergyAccount(solution, [arm.dynamics]))["energy"] > 1e-8
