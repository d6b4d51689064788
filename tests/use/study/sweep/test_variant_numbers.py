"""Numbers of cases that are solved together: against closed forms, and which states are solved for them."""

import math
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.arrays import Array
from pinarm.engine.motion.prescribed_variants import PrescribedVariants

SCENARIOS = Path(__file__).parents[4] / "scenarios"
MASSES = [0.1, 0.2, 0.35, 0.5]
"""Of the load of the two-rod arm [kg]; its rods are 0.25 m long and weigh 0.2 kg."""


def test_holding_torques_of_swept_masses_are_those_of_the_closed_form() -> None:
    """``C = g l2 (m_A + m_BA/2) cos(phi)``, whose top at phi = 0 no row is at."""
    sweep = pinarm.sweep(
        pinarm.load(SCENARIOS / "gen411_arm_static.yaml", ["problem.over.phi.samples=4"]),
        {"arguments.m_A": MASSES}, results=["C_B @ max", "C_B @ rms", "phi @ min(C_B)"], workers=1,
    )  # fmt: skip
    mechanism = pinarm.load(SCENARIOS / "gen411_arm_static.yaml").mechanism
    top = 9.81 * float(mechanism.arguments["l2"]) * (np.array(MASSES) + 0.5 * float(mechanism.arguments["m_BA"]))
    end = math.pi / 3  # over -end to end the mean of the squared cosine is 1/2 + sin(2 end)/(4 end)
    np.testing.assert_allclose(sweep["C_B @ max"].values, top, rtol=1e-13)
    np.testing.assert_allclose(
        sweep["C_B @ rms"].values, top * math.sqrt(0.5 + math.sin(2 * end) / (4 * end)), rtol=1e-12
    )
    np.testing.assert_allclose(np.abs(sweep["phi @ min(C_B)"].values), end, rtol=1e-13)
    assert (sweep["quadrature error"].values < 1e-10).all()


def test_forces_of_swept_speeds_are_those_of_the_closed_form() -> None:
    """A four-bar without gravity: all its forces grow as the square of the speed of its crank."""
    speeds = [60.0, 90.0, 150.0]
    values = ["gravity=none", "problem.time={end: 1 s, samples: 121}"]
    sweep = pinarm.sweep(
        pinarm.load(SCENARIOS / "crank_rocker_turning.yaml", values),
        {"problem.motion.theta2.speed": [f"{speed} rpm" for speed in speeds]},
        results=["F_B @ theta2=2 rad"], workers=1,
    )  # fmt: skip
    forces = sweep["F_B @ theta2=2 rad"].values
    np.testing.assert_allclose(forces / forces[0], (np.array(speeds) / speeds[0]) ** 2, rtol=1e-11)


def test_states_between_rows_are_solved_for_all_cases_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    solved, at = [], PrescribedVariants.at

    def noted(variants: PrescribedVariants, near: Array):
        solved.append(near.shape[:2])
        return at(variants, near)

    monkeypatch.setattr(PrescribedVariants, "at", noted)
    scenario = pinarm.load(SCENARIOS / "crank_rocker_turning.yaml", ["problem.time.samples=61"])
    masses = np.linspace(0.8, 1.2, 12)
    sweep = pinarm.sweep(scenario, {"arguments.m3": [f"{m!r} kg" for m in masses.tolist()]},
                         results=["T @ max", "F_B @ end"], workers=1)  # fmt: skip
    assert not sweep.errors
    assert (
        len([shape for shape in solved if shape[1] >= 12]) <= 8
    )  # of the nodes of two brackets, then of single places
