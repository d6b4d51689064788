"""A crank, a rod of twice its length and two slides: the rod's middle runs on the crank's circle by itself.

One of the constraints repeats the others, but only where the loops are closed, and its row of G passes through 0 where
the crank lies along a slide. Closed form, with the crank's angle s to the first slide, its length r and the inertia
``J(s) = J_crank + m_rod r^2 + J_rod + m_shoe (2 r sin s)^2``:

    J s'' + J' s'^2 / 2 + g (m_crank / 2 + m_rod) r cos s = torque of the crank
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinarm

G, R = 9.80665, 0.15
CRANK, ROD, SHOE = 1.5, 2.5, 0.4
J_CRANK, J_ROD = CRANK * R**2 / 3.0, 0.04
BEGIN = np.arctan2(0.09, 0.12)
"""The crank's angle to the first slide in the drawing, where the joint's angle is 0 [rad]."""

TRAMMEL = f"""
pinarm: 1
title: Trammel with a crank
gravity: {{direction: -y, magnitude: {G} m/s^2}}
planar:
  points: {{O: [0, 0], M: [120 mm, 90 mm], P: [240 mm, 0], Q: [0, 180 mm], X: [1 m, 0], Y: [0, 1 m]}}
  ground: [O, X, Y]
  links:
    crank: {{points: [O, M], mass: {CRANK} kg}}
    rod: {{points: [P, M, Q], mass: {ROD} kg, centre: M, inertia: {J_ROD} kg*m^2}}
    shoe: {{points: [P], mass: {SHOE} kg}}
  sliders:
    x: {{link: shoe, along: [O, X]}}
  slots:
    y: {{link: rod, point: Q, along: [O, Y]}}
"""


def inertia(s):
    return J_CRANK + ROD * R**2 + J_ROD + SHOE * (2.0 * R * np.sin(s)) ** 2


def torque(s, v, a):
    """Return the torque of the crank."""
    growth = SHOE * (2.0 * R) ** 2 * np.sin(2.0 * s)
    return inertia(s) * a + 0.5 * growth * v**2 + G * (CRANK / 2.0 + ROD) * R * np.cos(s)


@pytest.fixture(scope="module")
def trammel(tmp_path_factory):
    file = tmp_path_factory.mktemp("trammel") / "mechanism.yaml"
    file.write_text(TRAMMEL)
    return pinarm.Mechanism.load(file)


@pytest.mark.parametrize("method", ["dop853", "stiff"])
def test_it_falls_through_the_positions_where_a_repeated_row_vanishes(trammel, method):
    """The crank passes both slides; errors of 1e-9 a step add up to less than 1e-6 in half a second."""
    times = np.linspace(0.0, 0.6, 13)
    result = pinarm.run({
        "pinarm": 1, "mechanism": trammel, "outputs": ["joint.O.position"],
        "problem": {"kind": "forward", "time": {"end": "0.6 s", "samples": 13},
                    "initial": {"position": {"O": "20 deg"}}},
        "accuracy": {"method": method, "tolerance": 1e-9},
    })  # fmt: skip
    start = BEGIN + np.deg2rad(20.0)
    exact = solve_ivp(lambda t, y: [y[1], -torque(y[0], y[1], 0.0) / inertia(y[0])], (0.0, 0.6), [start, 0.0],
                      t_eval=times, rtol=1e-12, atol=1e-12, method="DOP853")  # fmt: skip
    assert exact.y[0].min() < -np.pi / 2.0
    assert result["joint.O.position"].values + BEGIN == pytest.approx(exact.y[0], abs=1e-6)


@pytest.fixture(scope="module")
def turned(trammel):
    """The crank turns at a changing speed, past both slides; its torque by the closed form."""
    t = np.linspace(0.0, 1.0, 41)
    s, v, a = 0.1 + 2.0 * t + 0.4 * np.sin(3.0 * t), 2.0 + 1.2 * np.cos(3.0 * t), -3.6 * np.sin(3.0 * t)
    columns = {"O": (s - BEGIN, v, a), "M": (-2.0 * (s - BEGIN), -2.0 * v, -2.0 * a)}
    slide = 2.0 * R * np.cos(s), -2.0 * R * np.sin(s) * v, -2.0 * R * (np.cos(s) * v**2 + np.sin(s) * a)
    columns["x"] = slide[0] - 0.24, *slide[1:]
    motion = np.zeros((3, len(t), 3))
    for name, values in columns.items():
        motion[:, :, trammel.joints[name].v] = values
    return t, motion, torque(s, v, a)


def test_recorded_efforts_of_open_rows_are_held_against_the_equation(trammel, turned):
    """A wrong torque shows, whatever the loops of open rows could carry."""
    t, (q, v, a), exact = turned
    rows = q + 1e-8 * np.random.default_rng(0).normal(size=q.shape)
    tau = np.zeros_like(v)
    tau[:, trammel.joints["O"].v] = exact
    figures = [trammel.result(t, rows, v, a, each).figures["equilibrium"] for each in (tau, 1.05 * tau)]
    assert figures[0] < 1e-6
    assert figures[1] > 1e-3
