"""One case: the numbers that are taken from a result, and what a case that fails says."""

import pickle
import re
from math import pi, sin

import pytest

import pinarm
from pinarm import PinarmError
from pinarm.use.cases.case import WORTH, Row, Task, Wanted, solve_case


def solved(held: pinarm.Scenario, results: list[str], **values: object) -> Row:
    wanted = tuple(Wanted.read(text).measured(held.quantities())[0] for text in results)
    task = pickle.loads(pickle.dumps(Task.of(held, wanted)))
    return solve_case(task, {name.replace("__", "."): value for name, value in values.items()})


def test_the_numbers_are_those_of_the_formula(held: pinarm.Scenario) -> None:
    results = [
        "M",
        "M @ start",
        "M @ end",
        "M @ pivot=30 deg",
        "alpha @ max(M)",
        "-M @ largest(-2*M)",
        "alpha @ max(-M)",
    ]
    row = solved(held, results, arguments__m="3 kg", arguments__l="0.5 m")
    full = 3 * 10 * 0.5
    assert row.error == ""
    assert row.numbers[:8] == pytest.approx([0, full, 0, full, full * sin(pi / 6), pi / 2, -full, 0], abs=1e-12)
    assert len(row.numbers) == 8 + len(WORTH)
    measures = dict(zip(WORTH, row.numbers[8:], strict=True))
    assert max(measures["equilibrium"], measures["power"]) < 1e-13  # a rounding each


def test_numbers_of_the_mechanism_file_can_vary(held: pinarm.Scenario) -> None:
    row = solved(held, ["M @ end"], changes__forces__spring__stiffness="4 N*m/rad", arguments__m="1 kg")
    assert row.numbers[0] == pytest.approx(10 + 4 * pi / 2, rel=1e-14)


@pytest.mark.parametrize("text", ["", "@ max", "M @ start(M)", "M @ t=1=2"])
def test_what_is_no_result_is_refused(text: str) -> None:
    with pytest.raises(PinarmError, match=r"--result .*is no number of a run|asks for nothing"):
        Wanted.read(text)


def test_an_unknown_quantity_is_refused_before_anything_is_solved(held: pinarm.Scenario) -> None:
    for text in ("N", "M @ max(N)"):
        with pytest.raises(PinarmError, match=r"--result .*there is no quantity 'N'"):
            Wanted.read(text).measured(held.quantities())


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"arguments__m": "-1 kg"}, r"pendulum.urdf.xacro:6:3: link 'rod': the mass is negative \(-1 kg\)"),
        ({"problem__over__pivot__from": "60 deg"}, "pivot = 30 deg is not reached"),
        ({"problem__kind": "static"}, "unknown kind 'static'"),
    ],
)
def test_a_case_that_fails_is_a_row_that_says_why(
    held: pinarm.Scenario, values: dict[str, object], reason: str
) -> None:
    row = solved(held, ["M @ pivot=30 deg"], **values)
    assert row.numbers == ()
    assert row.final
    assert re.search(reason, row.error)
    assert "\n" not in row.error


def test_a_fault_of_the_program_costs_one_case(held: pinarm.Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Wanted, "numbers", lambda *_: 1 / 0)
    row = solved(held, ["M"])
    assert row.error.startswith("the program failed: ZeroDivisionError: division by zero (")
    assert not row.final


FALLING = {"problem": {"kind": "forward", "time": {"end": "1 s"}, "initial": {"position": {"pivot": "30 deg"}}}}


def test_a_target_of_the_error_is_reached_or_the_case_fails(held: pinarm.Scenario) -> None:
    reached = solved(held, ["alpha @ end"], **FALLING, accuracy={"target": 1e-6})
    assert 0 < reached.figures["global error"] < 1e-6
    missed = solved(held, ["alpha @ end"], **FALLING, accuracy={"target": 1e-18})
    assert re.fullmatch(r"the global error is \d\.\de-\d\d, not below its target 1e-18", missed.error)
