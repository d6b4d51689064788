"""Which cases of a chunk are solved together, in which order, and that nothing else follows from it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.use.cases.case import Row, Task, Value, Wanted, solve_case
from pinarm.use.cases.solving import CaseSolver, Stack
from pinarm.use.workers.runners import in_order

BRANCHES = """\
<robot name="pendulum" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="m" default="2"/>
  <xacro:property name="m" value="$(arg m)"/>
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 ${-1 if m &lt; 2 else -3}"/><mass value="${m}"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5"/></inertial></link>
  <joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>
"""


def masses(*texts: str, **others: Value) -> list[dict[str, Value]]:
    return [{"arguments.m": text, **{k.replace("__", "."): x for k, x in others.items()}} for text in texts]


def rows_of(solver: CaseSolver, cases: Sequence[dict[str, Value]]) -> list[Row]:
    return [*in_order(solver.together(cases))]


@pytest.fixture
def task(held: pinarm.Scenario) -> Task:
    return Task.of(held, (Wanted.read("M").measured(held.quantities())[0],))


@pytest.fixture
def sizes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list of how many cases stacks are given."""
    given: list[int] = []
    rows = Stack.rows

    def noted(stack: Stack, cases: Sequence[dict[str, Value]]) -> list[Row | None]:
        given.append(len(cases))
        return rows(stack, cases)

    monkeypatch.setattr(Stack, "rows", noted)
    return given


def test_rows_come_in_the_order_of_their_jobs(task: Task, sizes: list[int]) -> None:
    """M = m g l sin(alpha), with g = 10 m/s^2, l = 1 m or 2 m, and alpha up to 90 deg."""
    one, other = masses("1 kg", "4 kg", "2 kg"), masses("3 kg", "7 kg", arguments__l="1 m", gravity="none")
    mixed = [one[0], other[0], one[1], other[1], one[2]]
    rows = rows_of(CaseSolver(task), mixed)
    np.testing.assert_allclose([row.numbers[1] for row in rows], [10, 0, 40, 0, 20], atol=1e-13)
    assert sizes == [3, 2]


def test_cases_that_fail_say_why_as_if_alone(task: Task, sizes: list[int]) -> None:
    jobs = masses("-1 kg", "2 kg", "nan kg", "-2 kg", "1e400 kg", "3 m", "4 kg")
    rows = rows_of(CaseSolver(task), jobs)
    assert rows[1].numbers[1] == pytest.approx(20)
    assert rows[6].numbers[1] == pytest.approx(40)
    for row, values in zip(rows, jobs, strict=True):
        assert row.error == solve_case(task, values).error
    assert [bool(row.error) for row in rows] == [True, False, True, True, True, True, False]


def test_cases_of_another_branch_of_the_model_are_solved_alone(path: Path, sizes: list[int]) -> None:
    (path.parent / "pendulum.urdf.xacro").write_text(BRANCHES)
    (path.parent / "pendulum.yaml").write_text((path.parent / "pendulum.yaml").read_text().replace(", l: m", ""))
    path.write_text(path.read_text().replace("arguments: {l: 1 m}\n", ""))
    scenario = pinarm.load(path)
    task = Task.of(scenario, (Wanted.read("joint.pivot.effort"),))
    jobs = masses("1 kg", "3 kg", "1.5 kg", "4 kg", "1.9 kg", "1.8 kg")
    rows = rows_of(CaseSolver(task), jobs)
    np.testing.assert_allclose([row.numbers[1] for row in rows], [10, 90, 15, 120, 19, 18], rtol=1e-13)
    again = [row for job in jobs for row in rows_of(CaseSolver(task), [job])]
    assert [repr(row) for row in rows] == [repr(row) for row in again]


def test_where_both_ways_do_not_agree_all_are_solved_alone(
    task: Task, sizes: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Stack, "agrees", lambda stack, values, row: False)
    rows = rows_of(CaseSolver(task), masses("1 kg", "2 kg", "3 kg"))
    assert [row.numbers[1] for row in rows] == pytest.approx([10, 20, 30])
    assert sizes == []


def four_bars(*lengths: tuple[float, float, float]) -> list[dict[str, Value]]:
    """Return cases of the turning crank-rocker: lengths of crank, coupler and rocker [m]."""
    return [{f"arguments.{name}": f"{size!r} m" for name, size in zip("abc", case, strict=True)} for case in lengths]


CRANKS = four_bars((0.10003, 0.351, 0.2501), (0.0999, 0.35, 0.2498))
OPEN = {"arguments.a": "1 m"}


@pytest.fixture
def crank_rocker() -> pinarm.Scenario:
    path = Path(__file__).parents[3] / "scenarios" / "crank_rocker_turning.yaml"
    return pinarm.load(path, {"problem.time.samples": 11, "expect": []})


def test_loops_are_closed_from_those_of_the_scenario_whatever_case_comes_first(
    crank_rocker: pinarm.Scenario, sizes: list[int]
) -> None:
    """To the last digit: closed from one another they differ in it."""
    task = Task.of(crank_rocker, [Wanted.read("T"), Wanted.read("F_B")])
    rows = rows_of(CaseSolver(task), CRANKS)
    apart = [row for case in CRANKS for row in rows_of(CaseSolver(task), [case])]
    assert sizes == [2, 1, 1]
    assert [repr(row) for row in apart] == [repr(row) for row in rows]


def test_cases_are_solved_alone_where_the_anchor_does_not_close(
    crank_rocker: pinarm.Scenario, sizes: list[int]
) -> None:
    rows = rows_of(CaseSolver(Task.of(crank_rocker, [Wanted.read("T")], OPEN)), CRANKS)
    assert not any(row.error for row in rows)
    assert sizes == []
