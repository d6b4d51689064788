"""Numbers of cases that are solved together: against closed forms."""

import math
from pathlib import Path

import numpy as np

import pinarm
from pinarm.use.cases.case import QUADRATURE, WORTH
from tests.use.cases.conftest import Chunk

SCENARIOS = Path(__file__).parents[3] / "scenarios"


def test_holding_torques_of_swept_masses_are_those_of_the_closed_form(chunk: Chunk) -> None:
    """``C = g l2 (m_A + m_BA/2) cos(phi)``, whose top at phi = 0 no row is at."""
    scenario = pinarm.load(SCENARIOS / "gen411_arm_static.yaml", ["problem.over.phi.samples=4"])
    masses, mechanism = np.array([0.1, 0.2, 0.35, 0.5]), scenario.mechanism
    cases = [{"arguments.m_A": f"{mass!r} kg"} for mass in masses.tolist()]
    numbers = chunk(scenario, cases, ["C_B @ max", "C_B @ rms", "phi @ min(C_B)"])
    top = 9.81 * float(mechanism.arguments["l2"]) * (masses + 0.5 * float(mechanism.arguments["m_BA"]))
    end = math.pi / 3  # over -end to end the mean of the squared cosine is 1/2 + sin(2 end)/(4 end)
    np.testing.assert_allclose(numbers[:, 0], top, rtol=1e-13)
    np.testing.assert_allclose(numbers[:, 1], top * math.sqrt(0.5 + math.sin(2 * end) / (4 * end)), rtol=1e-12)
    np.testing.assert_allclose(np.abs(numbers[:, 2]), end, rtol=1e-13)
    assert (numbers[:, 3 + WORTH.index(QUADRATURE)] < 1e-10).all()


def test_forces_of_swept_speeds_are_those_of_the_closed_form(chunk: Chunk) -> None:
    """A four-bar without gravity: all its forces grow as the square of the speed of its crank."""
    scenario = pinarm.load(
        SCENARIOS / "crank_rocker_turning.yaml", ["gravity=none", "problem.time={end: 1 s, samples: 61}"]
    )
    speeds = np.array([60.0, 75.0, 90.0, 120.0])
    cases = [{"problem.motion.theta2.speed": f"{speed!r} rpm"} for speed in speeds.tolist()]
    forces = chunk(scenario, cases, ["F_B @ theta2=2 rad"])[:, 0]
    np.testing.assert_allclose(forces / forces[0], (speeds / speeds[0]) ** 2, rtol=1e-11)
