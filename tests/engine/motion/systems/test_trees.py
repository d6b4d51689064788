"""Trees with couplings and with joints that follow laws: closed forms, and compiled code against Python."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import pinarm
from pinarm.engine.kernel.library import absence, library
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems.loop_system import LoopSystem

CART = """<robot name="cart"><link name="ground"/>
<link name="cart"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="prismatic"><parent link="ground"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-99" upper="99" effort="1" velocity="1"/></joint>
<link name="rod"><inertial><origin xyz="0 0 -0.4"/><mass value="1"/>
<inertia ixx="0.05" iyy="0.05" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="cart"/><child link="rod"/><axis xyz="0 -1 0"/></joint></robot>"""

INERTIA, MASS, ARM, WEIGHT = 0.05 + 0.4**2, 1.0, 0.4, 9.81
LAWS = {
    "harmonic": ({"law": "harmonic", "amplitude": "0.2 m", "pulsation": "6 rad/s"},
                 lambda t: -0.2 * 36.0 * np.sin(6.0 * t)),
    "constant_acceleration": ({"law": "constant_acceleration", "acceleration": "3 m/s^2"}, lambda t: 3.0),
    "polynomial": ({"law": "polynomial", "from": "0 m", "to": "1 m", "duration": "2 s", "degree": 5},
                   lambda t: (60 * t / 2 - 180 * (t / 2) ** 2 + 120 * (t / 2) ** 3) / 4),
    "hold": ({"law": "constant", "value": "0.3 m"}, lambda t: 0.0),
}  # fmt: skip


@pytest.fixture
def cart(tmp_path):
    """Return a function from the law of a cart to a scenario of the pendulum that hangs on it."""
    (tmp_path / "cart.urdf").write_text(CART)
    mechanism = pinarm.Mechanism.load(tmp_path / "cart.urdf", values={"gravity": {"direction": "-z"}})

    def asked(law, tolerance=1e-10, **problem):
        return {
            "pinarm": 1, "mechanism": mechanism, "outputs": ["x", "turn", "joint.x.effort"],
            "accuracy": {"tolerance": tolerance},
            "problem": {"kind": "forward", "time": {"end": "2 s", "samples": 21}, "motion": {"x": law},
                        "initial": {"position": {"turn": "0.5 rad"}}, **problem},
        }  # fmt: skip

    return asked


@pytest.mark.parametrize("name", LAWS)
def test_a_pendulum_on_a_driven_cart_swings_as_its_equation_says(cart, calls, name):
    """``J turn'' = -m l (g sin(turn) + x'' cos(turn))``, solved by SciPy; in compiled steps where there are any."""
    law, rate = LAWS[name]
    result = pinarm.run(cart(law))
    assert calls or absence()

    def slope(t, y):
        return [y[1], -MASS * ARM * (WEIGHT * np.sin(y[0]) + rate(t) * np.cos(y[0])) / INERTIA]

    t = result["t"].values
    exact = solve_ivp(slope, (0.0, 2.0), [0.5, 0.0], "DOP853", t, rtol=1e-12, atol=1e-13).y[0]
    assert np.abs(result["turn"].values - exact).max() < 1e-8  # the tolerance, over some hundred steps


WHEEL = """<link name="{name}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="continuous"><parent link="{parent}"/><child link="{name}"/><axis xyz="0 0 1"/></joint>"""


@pytest.fixture
def wheels(tmp_path):
    """Two wheels of 2 and 0.5 kg m^2 with ``q2 = -3 q1``, and a spring of 26 N m/rad at the first."""
    parts = [WHEEL.format(name=f"wheel{k}", joint=f"q{k}", inertia=inertia, parent="base")
             for k, inertia in ((1, 2.0), (2, 0.5))]  # fmt: skip
    (tmp_path / "wheels.urdf").write_text(f'<robot name="wheels"><link name="base"/>{"".join(parts)}</robot>')
    values = {"couplings": {"gear": {"kind": "sum", "weights": {"q2": 1.0, "q1": 3.0}}},
              "forces": {"spring": {"kind": "joint_spring", "joint": "q1", "stiffness": "26 N*m/rad"}}}  # fmt: skip
    return pinarm.Mechanism.load(tmp_path / "wheels.urdf", values=values)


def asked(mechanism, outputs, end="10 s", **problem):
    return {"pinarm": 1, "mechanism": mechanism, "outputs": outputs, "accuracy": {"tolerance": 1e-12}, "problem": {
        "kind": "forward", "time": {"end": end, "samples": 51}, **problem,
    }}  # fmt: skip


def test_a_geared_oscillator_has_its_frequency(wheels):
    """``(J1 + 9 J2) q'' + k q = 0``: w = 2/s."""
    result = pinarm.run(asked(wheels, ["q1", "q2"], initial={"position": {"q1": "0.4 rad", "q2": "-1.2 rad"}}))
    exact = 0.4 * np.cos(2.0 * result["t"].values)
    assert np.abs(result["q1"].values - exact).max() < 1e-9
    assert np.abs(result["q2"].values + 3.0 * result["q1"].values).max() < 1e-14
    assert result.figures["energy"] < 1e-9


def test_accelerations_of_the_kernel_satisfy_the_equation_of_motion():
    """``M a + nle = W^T lam`` by Pinocchio and ``W a = 0``, in states that are on the couplings."""
    if library() is None:
        pytest.skip("no compiled library")
    mechanism, none = pinarm.Mechanism.load("panda"), PrescribedCoordinates((), (), ())
    model, closure = mechanism.model, mechanism.closure
    system = LoopSystem.of(closure, mechanism.dynamics, none, np.zeros(model.nq))
    flow = system.interval(mechanism.dynamics, 0.0, 1.0).compiled
    random = np.random.default_rng(5)
    assert flow is not None
    weights, nothing = closure.rows(closure.state(np.zeros(model.nq))), np.zeros((1, 0))
    for _ in range(10):
        q, v = random.normal(size=(1, model.nq)), random.normal(size=(1, model.nv))
        q, v, _ = system.settled(q, v, nothing, nothing, np.zeros(1))
        a = flow.slope(0.0, np.concatenate([q[0], v[0]]))[model.nq :]
        left = pin.rnea(model, mechanism.dynamics.data, q[0], v[0], a) - mechanism.dynamics.loads(0.0, q[0], v[0])
        lam = np.linalg.lstsq(weights.T, left)[0]
        size = np.abs(a).max() * np.diag(pin.crba(model, mechanism.dynamics.data, q[0])).max()
        assert np.abs(left - weights.T @ lam).max() < 1e-12 * size
        assert np.abs(weights @ a).max() < 1e-13 * np.abs(a).max()


def test_a_rotor_that_begins_with_its_load_leaves_the_given_velocities_as_they_are():
    """Through a ratio of 10 the rotor of an elastic gear turns with the load; only the load's velocity is given."""
    given = {"problem.initial": {"velocity": {"x": "0.3 rad/s"}}}
    scenario = pinarm.load("scenarios/servo_backlash.yaml", given)
    hybrid = scenario.problem.prepare(scenario.mechanism, scenario.content.accuracy, scenario.place)
    before = hybrid.initial.v.copy()
    moving = hybrid.begin()[1]
    assert np.count_nonzero(moving) == 2
    np.testing.assert_array_equal(hybrid.initial.v, before)
