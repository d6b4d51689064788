"""Collocation in long windows: what is its own; orders, events and pieces of loads are where all methods are tested."""

from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest
from scipy.special import ellipj, ellipk

import pinarm
from pinarm.engine.checks.balance import EnergyAccount, energy_balance
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Count, Flat, Interval
from pinarm.engine.integration.methods.collocation import Collocation
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.integration.methods.gauss_legendre import gauss
from pinarm.errors import IntegrationError, MethodError
from pinarm.mechanics.forces.joint_definitions import JointEffort, JointSpring
from pinarm.mechanics.laws import Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid

from .known_motions import ATTITUDE, MOMENTS, PLANE, SPIN, attraction, attractions, body, orbit, turned
from .test_orders import MODELS

LINE = Flat(1, 1)
TOLERANCES = 10.0 ** -np.arange(3, 13)


def motion(dynamics, end, q, v, tolerance):
    interval = Interval(0.0, end, dynamics.acceleration(), batch=dynamics.forward, unchecked_batch=dynamics.unchecked())
    return integrate([interval], dynamics.manifold, q, v, Collocation(tolerance))


def on_a_line(acceleration, end, q=0.0, v=0.0, tolerance=1e-10, **given):
    """The motion of one coordinate; the acceleration takes one state as it takes many."""
    interval = Interval(0.0, end, acceleration, batch=lambda t, q, v: acceleration(t[:, None], q, v))
    return integrate([interval], LINE, np.array([q]), np.array([v]), Collocation(tolerance), **given)


@pytest.mark.parametrize("s", [1, 2, 7, 16])
def test_nodes_integrate_what_they_can_exactly(s):
    """A polynomial of degree s - 1 up to any node, one of degree 2s - 1 over all, and between as the terms say."""
    table, x = gauss(s), np.linspace(0.0, 1.0, 9)
    assert table.a @ table.c ** (s - 1) == pytest.approx(table.c**s / s, abs=1e-15)
    assert table.b @ table.c ** (2 * s - 1) == pytest.approx(1.0 / (2 * s), abs=1e-15)
    z = 2.0 * x - 1.0
    coefficients = table.series @ table.c ** (s - 1)
    assert z[:, None] ** np.arange(s) @ table.powers @ coefficients == pytest.approx(x ** (s - 1), abs=1e-12)


class TestTolerance:
    def check(self, errors):
        # a local error per window, amplified by the motions as with Adaptive less than 300 times
        assert np.polyfit(np.log(TOLERANCES), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.15)
        assert (errors < 300 * TOLERANCES).all()

    def test_error_shrinks_with_it_in_the_plane_within_windows_too(self):
        t, errors = np.linspace(0.0, 20.0, 501), []
        for tolerance in TOLERANCES:
            interval = Interval(0.0, 20.0, attraction, batch=attractions)
            solution = integrate([interval], PLANE, *orbit(0.0), Collocation(tolerance))
            errors.append(np.abs(np.hstack(solution.states(t)) - np.hstack(orbit(t))).max())
            assert len(solution.steps) < 40
        self.check(np.array(errors))

    def test_error_shrinks_with_it_on_rotations(self):
        t, errors = np.linspace(0.0, 4.0, 301), []
        for tolerance in TOLERANCES:
            solution = motion(body(), 4.0, ATTITUDE, SPIN, tolerance)
            errors.append(np.abs(np.hstack(solution.states(t)) - turned()(t).T).max())
        self.check(np.maximum(errors, 0.1 * TOLERANCES))


def test_a_pendulum_follows_the_elliptic_function():
    """``sin(q / 2) = k sn(K - t, k)`` from rest at ``k = sin(q_0 / 2)``: Landau and Lifshitz, Mechanics, section 11."""
    solution = on_a_line(lambda t, q, v: -np.sin(q), 30.0, q=2.5, tolerance=1e-12)
    k, t = np.sin(1.25), np.linspace(0.0, 30.0, 401)
    exact = 2.0 * np.arcsin(k * ellipj(ellipk(k**2) - t, k**2)[0])
    assert solution.states(t)[0][:, 0] == pytest.approx(exact, abs=3e-10)  # amplified as by others 100 times
    assert len(solution.steps) < 50


def test_a_free_body_keeps_its_energy_and_its_angular_momentum_in_the_world():
    solution = motion(body(), 20.0, ATTITUDE, SPIN, 1e-12)
    q, v = solution.states(np.linspace(0.0, 20.0, 301))
    momenta = np.array([pin.Quaternion(one).matrix() @ (MOMENTS * w) for one, w in zip(q, v, strict=True)])
    assert momenta == pytest.approx(np.tile(momenta[0], (301, 1)), abs=1e-11)
    assert v**2 @ MOMENTS == pytest.approx(SPIN**2 @ MOMENTS, abs=1e-11)
    assert np.linalg.norm(q, axis=1) == pytest.approx(1.0, abs=1e-15)


def test_loads_that_jump_are_met_between_windows():
    """The unit oscillator from rest under 1 from t = 1/3 to t = 2."""
    bounds, levels, t = (0.0, 1 / 3, 2.0, 5.0), (0.0, 1.0, 0.0), np.linspace(0.0, 5.0, 301)
    intervals = [
        Interval(low, high, lambda t, q, v, x=x: x - q, batch=lambda t, q, v, x=x: x - q)
        for low, high, x in zip(bounds, bounds[1:], levels, strict=False)
    ]
    solution = integrate(intervals, LINE, np.zeros(1), np.zeros(1), Collocation(1e-12))
    on, off = np.maximum(t - 1 / 3, 0.0), np.maximum(t - 2.0, 0.0)
    assert solution.states(t)[0][:, 0] == pytest.approx(np.cos(off) - np.cos(on), abs=1e-11)


class TestArm:
    @pytest.fixture
    def arm(self, mechanism, chain):
        return mechanism(chain({"name": "A", "axis": "0 1 0", "com": "0 0 -0.5"},
                               {"name": "B", "axis": "0 1 0", "at": "0 0 -1", "com": "0 0 -0.5"}))  # fmt: skip

    def test_ends_where_another_method_ends(self, arm):
        q, v, end = np.array([1.2, 0.7]), np.array([0.5, -2.0]), np.array([3.0])
        other = integrate(
            [Interval(0.0, 3.0, arm.dynamics.acceleration())], arm.dynamics.manifold, q, v, Adaptive(1e-13)
        )
        found = motion(arm.dynamics, 3.0, q, v, 1e-12)
        assert np.hstack(found.states(end)) == pytest.approx(np.hstack(other.states(end)), abs=1e-10)

    def test_an_error_within_windows_shows_in_the_balance_of_energy(self, arm):
        """One that vanishes at the ends of windows, and of their quarters."""
        solution = motion(arm.dynamics, 3.0, np.array([1.2, 0.7]), np.zeros(2), 1e-12)
        assert energy_balance(EnergyAccount(solution, [arm.dynamics]))["energy"] < 1e-11
        ripple = 1e-5 * np.sin(8.0 * np.pi * gauss(16).c)[:, None]
        solution.steps.slopes[:] += ripple
        solution._interpolated.truncate(0)
        assert energy_balance(EnergyAccount(solution, [arm.dynamics]))["energy"] > 1e-9

    def test_loads_that_depend_on_state_and_time_are_those_of_each_node(self, arm):
        loads = {"spring": JointSpring(joint="A", stiffness=30.0, damping=0.4, rest=0.2),
                 "push": JointEffort(joint="B", effort=Harmonic(amplitude=2.0, pulsation=5.0))}  # fmt: skip
        problem = Forward(time=TimeGrid(end=2.0, samples=41), loads=loads, initial={"position": {"B": 0.5}})
        runs = [problem.solve(arm, Accuracy(method=method, tolerance=1e-12), lambda *path: nullcontext())
                for method in ("dop853", "collocation")]  # fmt: skip
        assert runs[1].rows.q == pytest.approx(runs[0].rows.q, abs=1e-10)
        assert runs[1].figures["energy"] < 1e-10

    def test_one_that_a_law_leads_takes_part(self, arm):
        swing = {"A": Harmonic(amplitude=0.4, pulsation=3.0)}
        problem = Forward(time=TimeGrid(end=2.0, samples=41), motion=swing, initial={"position": {"B": 0.5}})
        runs = [problem.solve(arm, Accuracy(method=method, tolerance=1e-12), lambda *path: nullcontext()).rows
                for method in ("dop853", "collocation")]  # fmt: skip
        assert runs[1].q == pytest.approx(runs[0].q, abs=1e-10)
        assert runs[1].tau == pytest.approx(runs[0].tau, abs=1e-9)

    def test_accelerations_that_lose_digits_together_are_computed_one_by_one(self, arm):
        alone = arm.dynamics.acceleration()
        wrong = Interval(0.0, 1.0, alone, batch=arm.dynamics.forward,
                        unchecked_batch=lambda t, q, v: arm.dynamics.forward(t, q, v) * (1.0 + 1e-10))  # fmt: skip
        q, v, end = np.array([1.2, 0.7]), np.array([0.5, -2.0]), np.array([1.0])
        found = integrate([wrong], arm.dynamics.manifold, q, v, Collocation(1e-13)).states(end)
        exact = integrate([Interval(0.0, 1.0, alone)], arm.dynamics.manifold, q, v, Adaptive(1e-14)).states(end)
        assert np.hstack(found) == pytest.approx(np.hstack(exact), abs=2e-12)  # 1e-10 of an acceleration of 10


def test_a_stiff_problem_is_called_stiff_and_a_smooth_one_is_not():
    def pulled(t, q, v):
        return -1e3 * (q - np.sin(t)) - 1e3 * v

    assert on_a_line(pulled, 1.0, tolerance=1e-7).count.limited > 100
    solution = on_a_line(pulled, 1.0, tolerance=1e-7)
    assert [doubt.kind for doubt in solution.method.diagnose(solution)] == ["stiff"]
    for tolerance in TOLERANCES:
        smooth = on_a_line(lambda t, q, v: -np.sin(q), 30.0, q=2.5, tolerance=tolerance)
        assert smooth.method.diagnose(smooth) == []


def test_few_windows_are_refused():
    """A sixth of a motion whose pace changes within a window, and none of one that goes on evenly.

    From near its upper equilibrium rounding decides which: with other last digits of the coefficients 19 or 26 of 160.
    """
    flips = on_a_line(lambda t, q, v: -np.sin(q), 200.0, q=3.1, tolerance=1e-9)
    assert flips.count.rejected < 0.25 * (len(flips.steps) + flips.count.rejected)
    even = on_a_line(lambda t, q, v: -q, 200.0, q=1.0, tolerance=1e-9)
    assert even.count.rejected <= 1


def test_states_along_a_window_are_on_the_motion():
    method, count = Collocation(1e-12), Count()
    stepper = method.stepper(PLANE, count)
    stepper.begin(Interval(0.0, 6.0, attraction, batch=attractions), np.hstack(orbit(0.0)))
    assert stepper.attempt(0.0, 0.3) <= 1.0
    t, y = stepper.along(0.0, 0.3)
    assert t[[0, -1]].tolist() == [0.0, 0.3]
    assert len(t) == 18
    assert y == pytest.approx(np.hstack(orbit(t)), abs=1e-12)


def test_rest_is_crossed_in_few_windows():
    solution = on_a_line(lambda t, q, v: 0.0 * q, 1e3)
    assert len(solution.steps) < 20
    assert np.hstack(solution.states(np.array([1e3]))).tolist() == [[0.0, 0.0]]


def test_evaluations_are_counted():
    calls = []

    def counted(t, q, v):
        calls.extend(np.ravel(t))
        return -q

    solution = on_a_line(counted, 10.0, q=1.0)
    checks = len(solution.steps) + solution.count.rejected  # of one acceleration against the same of all nodes
    assert solution.count.evaluations == len(calls) - checks


class TestFailures:
    def test_blow_up_in_finite_time(self):
        with pytest.raises(IntegrationError, match="grows without bound") as caught:
            on_a_line(lambda t, q, v: v**2, 2.0, v=1.0)
        assert caught.value.partial.end == pytest.approx(1.0, abs=1e-6)  # v = 1 / (1 - t)
        t = np.linspace(0.0, 0.9, 10)
        assert caught.value.partial.states(t)[1][:, 0] == pytest.approx(1 / (1 - t), rel=1e-8)

    def test_an_acceleration_that_ceases_to_be_a_number(self):
        with pytest.raises(IntegrationError, match="not finite") as caught:
            on_a_line(lambda t, q, v: np.where(t < 0.7, -q, np.nan), 2.0, v=1.0)
        assert caught.value.partial.end == pytest.approx(0.7, abs=1e-6)

    def test_loops_are_refused_where_the_file_names_the_method(self):
        scenario = pinarm.load(MODELS.parent / "scenarios" / "crank_rocker_free.yaml")
        with pytest.raises(MethodError, match="collocation") as caught:
            scenario.varied({"accuracy.method": "collocation"}).run()
        assert "dop853" in caught.value.hint
        assert "accuracy" in str(caught.value.location)
