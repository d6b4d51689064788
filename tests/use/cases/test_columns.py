"""Which cases may be solved together."""

from pinarm.use.cases.case_table import CaseTable, kind_of, moving


def test_the_kind_of_a_case_is_what_is_no_argument_and_no_law() -> None:
    assert kind_of({"gravity": "none"}) is None
    assert kind_of({"problem.time.samples": 5}) is None
    assert kind_of({"arguments.m": "1 kg", "problem.start.A": "1 rad"}) == kind_of(
        {"arguments.m": "2 kg", "problem.start.A": "1 rad"}
    )
    assert kind_of({"problem.motion.A.speed": 1.0, "arguments.m": 1.0}) == kind_of(
        {"problem.motion.A.speed": 2.0, "arguments.m": 3.0}
    )
    assert kind_of({"arguments.m": 1.0, "gravity": "none"}) != kind_of({"arguments.m": 1.0})


def test_what_says_how_a_case_moves_are_laws_rows_and_initial_states() -> None:
    values = {"arguments.m": 1.0, "problem.time.end": "1 s", "problem.initial.velocity.A": 2.0, "gravity": "none"}
    assert [column.path for column in moving(CaseTable.of([values]))] == [
        "problem.time.end",
        "problem.initial.velocity.A",
    ]
