"""Prescribed coordinates while others are free: against a Lagrangian by hand, and closed forms."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pinarm.errors import InputError
from pinarm.mechanics.laws import Constant, Cycloidal, Harmonic, Trapezoid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[4] / "models"
FINE = Accuracy(tolerance=1e-13)
L1 = L2 = 0.25
TOTAL, FIRST, SECOND, G = 0.5 + 1.0 + 0.1, (0.5 + 0.1) * L2, (1.0 / 3 + 0.1) * L2**2, 9.81
"""The arm's mass beyond O, first and second moment of rod and load about B."""
THREE = ({"name": "first"}, {"name": "second", "at": "1 0 0"}, {"name": "third", "at": "0.5 0 0"})


@pytest.fixture(scope="module")
def arm():
    return Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml")


def solve(mechanism, motion, *, end=1.0, samples=41, position=None, velocity=None, loads=None):
    problem = Forward(
        time=TimeGrid(end=end, samples=samples), motion=motion, loads=loads or {},
        initial=InitialState(position=position or {}, velocity=velocity or {}),
    )  # fmt: skip
    return problem.solve(mechanism, FINE, lambda *path: nullcontext()).rows


NOD = Harmonic(mean=-0.3, amplitude=0.8, pulsation=5.0, phase=0.2)


@pytest.fixture(scope="module")
def run(arm):
    """The arm nods with BA while OB swings freely."""
    return solve(arm, {"phi": NOD}, position={"O": 0.4}, velocity={"O": -1.0}, samples=401)


class TestArmWithPrescribedAbsoluteAngle:
    """The rod BA turns as phi(t); theta is free: l1 M theta'' + S (phi'' cos + phi'^2 sin)(theta - phi) + M g cos = 0.

    M is the mass at and beyond B, S its first moment about B; from the acceleration of B and of the rod's centre along
    the normal of OB.
    """

    def phi(self, t):
        x = 5.0 * t + 0.2
        return -0.3 + 0.8 * np.sin(x), 4.0 * np.cos(x), -20.0 * np.sin(x)

    def bend(self, t, theta):
        phi, rate, second = self.phi(t)
        apart = theta - phi
        pull = FIRST * (second * np.cos(apart) + rate**2 * np.sin(apart))
        return -(pull + TOTAL * G * np.cos(theta)) / (L1 * TOTAL)

    def test_free_angle_is_that_of_the_lagrangian(self, run):
        found = solve_ivp(lambda t, y: [y[1], self.bend(t, y[0])], (0, 1), [0.4, -1.0], "DOP853", t_eval=run.grid.t,
                          rtol=1e-12, atol=1e-13)  # fmt: skip
        assert run.q[:, 0] == pytest.approx(found.y[0], abs=1e-9)
        assert run.v[:, 0] == pytest.approx(found.y[1], abs=1e-9)
        assert run.a[:, 0] == pytest.approx(self.bend(run.grid.t, run.q[:, 0]), abs=1e-12)
        assert np.ptp(run.q[:, 0]) > 1.0

    def test_effort_is_that_of_the_lagrangian(self, run):
        """The drive turns BA against the frame: in terms of the joints it is the same effort in both."""
        (theta, rate, second), (phi, _, ddphi) = (x[:, 0] for x in (run.q, run.v, run.a)), self.phi(run.grid.t)
        apart = theta - phi
        swing = FIRST * L1 * (second * np.cos(apart) - rate**2 * np.sin(apart))
        expected = SECOND * ddphi + swing + FIRST * G * np.cos(phi)
        assert run.tau[:, 1] == pytest.approx(expected, abs=1e-12)
        assert run.tau[:, 0] == pytest.approx(expected, abs=1e-12)


def test_each_side_of_a_jump_has_its_own_effort(arm):
    law = Trapezoid(start=0.2, end=0.9, acceleration=8.0, begin=0.1)
    run = solve(arm, {"B": law}, position={"O": 0.4})
    assert run.grid.cuts[1:-1] == tuple(law.jumps())
    for row, before, after in zip(run.grid.rows[1:-1], (0.0, 8.0, -8.0), (8.0, -8.0, 0.0), strict=True):
        assert run.a[row - 1, 1] == pytest.approx(before, abs=1e-13)
        assert run.a[row, 1] == pytest.approx(after, abs=1e-13)
        assert run.q[row - 1] == pytest.approx(run.q[row], abs=1e-12)
        assert run.v[row - 1] == pytest.approx(run.v[row], abs=1e-12)


class TestQuaternions:
    def test_a_wheel_turns_a_free_body_the_other_way(self, mechanism, chain):
        """Angular momentum stays 0: (0.5 + 0.3) w + 0.3 psi' = 0, about the axis through both mass centres."""
        body = mechanism(
            chain({"name": "free", "kind": "floating", "mass": 3.0, "inertia": (0.5, 0.5, 0.5)},
                  {"name": "wheel", "at": "0 0 0.4", "inertia": (0.2, 0.2, 0.3)}),
            gravity="none",
        )  # fmt: skip
        law = Cycloidal(start=0.0, end=4.0, duration=0.8)
        run = solve(body, {"wheel": law})
        psi, rate, _ = run.grid.evaluate(law)
        angle = 2 * np.arctan2(run.q[:, 5], run.q[:, 6])
        assert angle == pytest.approx(-0.375 * psi, abs=1e-11)
        assert run.v[:, 5] == pytest.approx(-0.375 * rate, abs=1e-10)
        assert run.q[:, [0, 1, 2, 3, 4]] == pytest.approx(0.0, abs=1e-12)
        assert run.q[:, 7] == pytest.approx(psi, abs=1e-14)


class TestRefusals:
    @pytest.fixture
    def robot(self, mechanism, chain):
        sums = {"tip": ["first", "second"], "all": ["first", "second", "third"], "twice": ["first", "first"]}
        coordinates = {name: {"kind": "sum", "of": joints} for name, joints in sums.items()}
        coordinates["place"] = {"kind": "point", "point": "third_link", "along": "x"}
        return mechanism(chain(*THREE, {"name": "fourth"}), coordinates=coordinates)

    @pytest.mark.parametrize(
        ("names", "message"),
        [
            (["first", "second", "tip"], "'tip' is already determined by first, second"),
            (["all", "tip", "third"], "'third' is already determined by all, tip"),
        ],
    )
    def test_coordinates_that_say_the_same(self, robot, names, message):
        with pytest.raises(InputError, match=message) as caught:
            solve(robot, {name: Constant(value=0.0) for name in names})
        assert caught.value.expected == "coordinates that can be prescribed independently"

    @pytest.mark.parametrize("part", ["position", "velocity"])
    def test_initial_values_of_what_follows_a_law(self, robot, part):
        with pytest.raises(InputError, match="'second' follows a law"):
            solve(robot, {"second": Constant(value=0.0)}, **{part: {"second": 0.0}})

    def test_nothing_left_free(self, robot):
        with pytest.raises(InputError, match="nothing is left to integrate") as caught:
            solve(robot, {name: Constant(value=0.0) for name in robot.joints})
        assert caught.value.hint == "kind: inverse"
