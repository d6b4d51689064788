"""Trees with driven joints, all of whose coordinates are integrated: closed forms, and the independent ones alone."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinarm
from pinarm.engine.kernel.library import absence
from pinarm.engine.motion.systems.driven import DrivenSystem

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


@pytest.mark.parametrize("name", LAWS)
def test_they_move_as_where_the_independent_coordinates_alone_are_integrated(cart, monkeypatch, name):
    whole = pinarm.run(cart(LAWS[name][0]))
    monkeypatch.setattr(DrivenSystem, "of", classmethod(lambda *_: None))
    reduced = pinarm.run(cart(LAWS[name][0]))
    for output in ("x", "turn"):
        assert np.abs(whole[output].values - reduced[output].values).max() < 1e-8
    assert np.abs(whole["joint.x.effort"].values - reduced["joint.x.effort"].values).max() < 1e-6


@pytest.mark.parametrize("tolerance", [1e-3, 1e-10])
def test_driven_joints_stand_where_their_laws_say_however_coarse_the_steps(cart, tolerance):
    result = pinarm.run(cart(LAWS["harmonic"][0], tolerance))
    assert np.abs(result["x"].values - 0.2 * np.sin(6.0 * result["t"].values)).max() < 1e-14


@pytest.mark.parametrize("name", LAWS)
def test_steps_are_the_same_with_the_library_and_without(cart, calls, without, name):
    found = pinarm.run(cart(LAWS[name][0]))
    expected = without(lambda: pinarm.run(cart(LAWS[name][0])))
    assert found.figures["steps"] == pytest.approx(expected.figures["steps"], abs=1)
    assert np.abs(found["turn"].values - expected["turn"].values).max() < 1e-8
    assert not [note for note in found.notes() if "kernel" in note]


def test_other_loads_leave_it_to_the_independent_coordinates(cart, calls):
    """A load over a coordinate is none that compiled code knows."""
    points = [["-4 rad", "0 N*m"], ["0 rad", "1 N*m"], ["4 rad", "0 N*m"]]
    load = {"kind": "joint_effort", "joint": "turn", "over": "turn", "effort": {"law": "spline", "points": points}}
    pinarm.run(cart(LAWS["hold"][0], loads={"push": load}))
    assert not calls
