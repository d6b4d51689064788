"""Extremes of cases that are solved together, against closed forms and each case alone."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.use.cases.case import Task, Value, Wanted, solve_case
from pinarm.use.cases.stack import Stack

SCENARIOS = Path(__file__).parents[3] / "scenarios"
OVER = {"from": "-50 deg", "to": "61 deg", "samples": 20}
"""Positions of the arm, of which none is level."""


def stack_of(name: str, wanted: list[str], first: dict[str, Value], **values: object) -> Stack:
    scenario = pinarm.load(SCENARIOS / f"{name}.yaml", {"expect": [], **values})
    stack, row = Stack.begin(Task.of(scenario, map(Wanted.read, wanted)), first)
    assert stack is not None, row.error
    return stack


def arm(*wanted: str) -> tuple[Stack, list[dict[str, Value]]]:
    cases: list[dict[str, Value]] = [
        {"arguments.m_A": f"{mass} kg", "arguments.l2": f"{length} mm"}
        for mass, length in ((0.1, 250), (0.2, 300), (0.5, 200), (0.05, 400))
    ]
    return stack_of("gen411_arm_static", list(wanted), cases[0], **{"problem.over.phi": OVER}), cases


def test_an_extreme_between_rows_is_that_of_the_closed_form() -> None:
    """C_B = g l2 (m_A + m_BA/2) cos(phi), with m_BA = 1 kg: largest at phi = 0, least at 61 deg, a row."""
    stack, cases = arm("C_B @ max", "C_B @ min", "phi @ max(C_B)", "C_B @ start", "C_B @ end", "-C_B @ largest")
    factor = 9.81 * np.array([0.25 * 0.6, 0.3 * 0.7, 0.2 * 1.0, 0.4 * 0.55])
    end, start = np.cos(np.radians((61, -50)))
    rows = stack.rows(cases)
    taken = np.array([row.taken for row in rows if row is not None])
    np.testing.assert_allclose(taken[:, 2], 0.0, atol=1e-7)  # the place of a flat top: the root of the rounding
    exact = np.outer(factor, [1.0, end, start, end, -1.0])
    np.testing.assert_allclose(np.delete(taken, 2, axis=1), exact, rtol=1e-13)
    apart = [row for case in reversed(cases) for row in stack.rows([case])][::-1]
    assert [repr(row) for row in apart] == [repr(row) for row in rows]


def test_a_kink_is_left_to_each_case_alone() -> None:
    """No polynomial follows |phi - 0.17|."""
    stack, cases = arm("abs(phi - 0.17) @ min")
    assert stack.rows(cases[:2]) == [None, None]
    assert stack.agrees(cases[0], solve_case(stack.task, cases[0])) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "wanted"),
    [("crank_rocker_turning", ["T @ max", "F_B @ largest", "theta4 @ min", "F_O4 @ max(T)"]),
     ("gen411_arm_dynamic_true", ["C_B @ max", "C_B @ min"])],
)  # fmt: skip
def test_extremes_are_those_of_each_case_alone(name: str, wanted: list[str]) -> None:
    """Of a loop, and of a motion with several intervals; polynomials err by less than 1e-12 of the values."""
    rng, loop = np.random.default_rng(3), name.startswith("crank")
    cases: list[dict[str, Value]] = [
        {"arguments.a": f"{a!r} m", "arguments.m3": f"{m!r} kg"} if loop else {"arguments.m_A": f"{m!r} kg"}
        for a, m in zip(rng.uniform(0.09, 0.11, 5).tolist(), rng.uniform(0.1, 0.5, 5).tolist(), strict=True)
    ]
    stack = stack_of(name, wanted, cases[0])
    for case, row in zip(cases, stack.rows(cases), strict=True):
        assert row is not None
        np.testing.assert_allclose(row.taken, solve_case(stack.task, case).taken, rtol=1e-12)
