from pathlib import Path

import numpy as np
import pytest

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.errors import InputError
from pinarm.mechanics.forces.along_coordinate import JointEffort, JointSpring
from pinarm.mechanics.laws import Harmonic
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[3] / "models"

# two bodies of unequal mass in the vertical plane x-y, y up: lengths, mass centres, moments about the mass centre
L1, C1, C2, M1, M2, I1, I2, G = 0.8, 0.3, 0.45, 1.3, 2.1, 0.07, 0.19, 9.81
PENDULUM = (
    {"name": "first", "mass": M1, "com": f"{C1} 0 0", "inertia": (I1, I1, I1)},
    {"name": "second", "at": f"{L1} 0 0", "mass": M2, "com": f"{C2} 0 0", "inertia": (I2, I2, I2)},
)
Y_UP = {"direction": "-y", "magnitude": "9.81 m/s^2"}


@pytest.fixture
def pendulum(mechanism, chain):
    return mechanism(chain(*PENDULUM), gravity=Y_UP)


@pytest.fixture(params=["gen411_arm", "talos_arm"], scope="module")
def robot(request):
    return Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml" if request.param == "gen411_arm" else request.param)


def textbook(q, v):
    """Mass matrix, Coriolis terms and weights of the double pendulum; angles from x, the second relative."""
    coupling = M2 * L1 * C2 * np.cos(q[1])
    second = I2 + M2 * C2**2
    mass = np.array([
        [I1 + M1 * C1**2 + M2 * L1**2 + second + 2 * coupling, second + coupling], [second + coupling, second]
    ])  # fmt: skip
    h = M2 * L1 * C2 * np.sin(q[1])
    coriolis = np.array([-h * (2 * v[0] + v[1]) * v[1], h * v[0] ** 2])
    far = M2 * C2 * G * np.cos(q[0] + q[1])
    return mass, coriolis, np.array([(M1 * C1 + M2 * L1) * G * np.cos(q[0]) + far, far])


def states(model, n, seed=0):
    """Random q, v, a of plain joints: positions within limits of +-2."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (n, model.nq)), rng.normal(size=(n, model.nv)), rng.normal(size=(n, model.nv)) * 3


class TestDoublePendulum:
    def test_mass_matrix_coriolis_terms_and_weights_are_those_of_the_textbook(self, pendulum):
        for q, v, _ in zip(*states(pendulum.model, 10), strict=True):
            mass, coriolis, weight = textbook(q, v)
            zero = np.zeros(2)
            held = pendulum.inverse(q, zero, zero)
            assert held == pytest.approx(weight, abs=1e-13)  # sums of terms near 30 N*m
            assert pendulum.inverse(q, v, zero) - held == pytest.approx(coriolis, abs=1e-13)
            columns = [pendulum.inverse(q, zero, unit) - held for unit in np.eye(2)]
            assert pytest.approx(mass, abs=1e-13) == np.array(columns).T

    def test_free_motion_solves_the_textbook_equation(self, pendulum):
        for q, v, tau in zip(*states(pendulum.model, 10, seed=1), strict=True):
            mass, coriolis, weight = textbook(q, v)
            expected = np.linalg.solve(mass, tau - coriolis - weight)
            assert pendulum.forward(q, v, tau) == pytest.approx(expected, rel=1e-12)

    def test_energy_is_that_of_the_textbook(self, pendulum):
        q, v, _ = states(pendulum.model, 10, seed=2)
        kinetic, potential = pendulum.dynamics.energy(q, v)
        for k in range(10):
            assert kinetic[k] == pytest.approx(0.5 * v[k] @ textbook(q[k], v[k])[0] @ v[k], rel=1e-13)
        height = (M1 * C1 + M2 * L1) * np.sin(q[:, 0]) + M2 * C2 * np.sin(q.sum(axis=1))
        assert potential == pytest.approx(G * height, abs=1e-13)


class TestRotors:
    @pytest.fixture
    def geared(self, mechanism, chain):
        """Two joints about axes that are none of the frame's, the second with a rotor; Pinocchio forgets its energy."""
        bodies = (
            {"name": "first", "axis": "0 0.6 0.8", "com": "0.5 0 0"},
            {"name": "second", "kind": "revolute", "axis": "0.8 0 0.6", "at": "1 0 0", "com": "0 0.5 0"},
        )
        drive = {"joint": "second", "ratio": 100, "rotor_inertia": "1e-5 kg*m^2"}
        return mechanism(chain(*bodies), drives={"motor": drive})

    def test_their_energy_is_that_of_the_mass_matrix(self, geared):
        q, v, _ = states(geared.model, 5)
        M = geared.dynamics.mass_matrices(q)
        expected = 0.5 * np.einsum("ni,nij,nj->n", v, M, v)
        assert geared.dynamics.energy(q, v)[0] == pytest.approx(expected, rel=1e-14)


class TestIdentities:
    def test_forward_undoes_inverse(self, robot):
        q, v, a = states(robot.model, 20, seed=3)
        # condition of M: 1e4
        assert robot.forward(q, v, robot.inverse(q, v, a)) == pytest.approx(a, abs=1e-10)


def loaded(pendulum):
    forces = [
        JointSpring(joint="first", stiffness=20.0, damping=0.5, rest=0.3),
        JointEffort(joint="second", effort=Harmonic(amplitude=4.0, pulsation=3.0)),
    ]
    return Dynamics.of(
        pendulum.model, {str(k): force.bind(pendulum.model, pendulum.joints) for k, force in enumerate(forces)}
    ).on(0.0, 1.0)


class TestLoads:
    def test_they_act_like_efforts(self, pendulum):
        dynamics, (q, v, a) = loaded(pendulum), states(pendulum.model, 6)
        t = np.linspace(0.1, 0.9, 6)
        expected = np.stack([-20.0 * (q[:, 0] - 0.3) - 0.5 * v[:, 0], 4.0 * np.sin(3.0 * t)], axis=1)
        assert dynamics.loads(t, q, v) == pytest.approx(expected, abs=1e-14)
        bare = pendulum.dynamics
        assert dynamics.inverse(t, q, v, a) == pytest.approx(bare.inverse(t, q, v, a) - expected, abs=1e-13)
        assert dynamics.forward(t, q, v) == pytest.approx(bare.forward(t, q, v, expected), abs=1e-12)
        assert dynamics.forward(t, q, v, a) == pytest.approx(bare.forward(t, q, v, expected + a), abs=1e-12)

    def test_energy_and_power_are_theirs(self, pendulum):
        dynamics, (q, v, _) = loaded(pendulum), states(pendulum.model, 6)
        t = np.linspace(0.1, 0.9, 6)
        spring = 10.0 * (q[:, 0] - 0.3) ** 2
        assert dynamics.energy(q, v)[1] == pytest.approx(pendulum.dynamics.energy(q, v)[1] + spring, abs=1e-13)
        expected = 0.5 * v[:, 0] ** 2 - 4.0 * np.sin(3.0 * t) * v[:, 1]
        assert dynamics.dissipated_power(t, q, v) == pytest.approx(expected, abs=1e-13)
        assert pendulum.dynamics.dissipated_power(t, q, v).tolist() == [0.0] * 6


class TestShapes:
    @pytest.mark.parametrize("given", [[[None, 0.0]], np.zeros((1, 2)) + 1j, [[0.0], [0.0, 1.0]]])
    def test_what_is_no_array_of_real_numbers_is_refused(self, pendulum, given):
        with pytest.raises(InputError, match="q is no array of real numbers"):
            pendulum.inverse(given, np.zeros((1, 2)), np.zeros((1, 2)))


class TestGravity:
    @pytest.mark.parametrize(("direction", "factor"), [("-y", 1.0), ("y", -1.0), ("z", 0.0), ("-z", 0.0)])
    def test_direction(self, mechanism, chain, direction, factor):
        found = mechanism(chain(*PENDULUM), gravity={"direction": direction}).inverse(*np.zeros((3, 2)))
        assert found == pytest.approx(factor * textbook(np.zeros(2), np.zeros(2))[2], abs=1e-12)  # of 30 N*m

    def test_a_caller_replaces_that_of_the_file(self):
        file = MODELS / "gen411_arm" / "mechanism.yaml"
        assert Mechanism.load(file, values={"gravity": "none"}).gravity == 0.0
        up = Mechanism.load(file, values={"gravity": {"direction": "y", "magnitude": "2 m/s^2"}})
        assert up.model.gravity.linear.tolist() == [0.0, 2.0, 0.0]


@pytest.mark.parametrize(("length", "away"), [(1e-6, 0.0), (1.0, 1e6), (1.0, 0.0)])
def test_many_states_are_as_exact_as_each_where_links_are_short_or_far_away(mechanism, chain, length, away):
    """Two points on rods: the equations solved by hand; Pinocchio's parallel recursion loses up to all digits here."""
    point = {"mass": 1.0, "inertia": (0.0, 0.0, 0.0), "axis": "0 1 0"}
    rods = mechanism(chain(
        {**point, "name": "A", "at": f"{away!r} 0 0", "com": "0 0 -1"},
        {**point, "name": "B", "at": "0 0 -1", "com": f"0 0 {-length!r}"},
    ))  # fmt: skip
    generator = np.random.default_rng(0)
    q, v = generator.uniform(-1.0, 1.0, (50, 2)), generator.uniform(-1.0, 1.0, (50, 2)) / [1.0, length**0.5]
    a, b, u, w = q[:, 0], q.sum(axis=1), v[:, 0], v.sum(axis=1)
    s, c = np.sin(a - b), np.cos(a - b)
    first = (-u * u * s * c + 9.81 * np.sin(b) * c - length * w * w * s - 2 * 9.81 * np.sin(a)) / (1 + s * s)
    second = (2 * (u * u * s - 9.81 * np.sin(b) + 9.81 * np.sin(a) * c) + length * w * w * s * c) / (1 + s * s) / length
    bound = 1e-8 if away else 1e-10 if length < 1.0 else 1e-13  # the places themselves are rounded; 1e-16 m of 1e-6 m
    found = rods.forward(q, v)
    assert found[:, 0] == pytest.approx(first, abs=bound * np.abs(second).max())
    assert found.sum(axis=1) == pytest.approx(second, abs=bound * np.abs(second).max())
