"""Tables of cases: the same values as those of each case, and rows that are objects only when asked for."""

import pickle
from array import array

import numpy as np

from pinarm.use.cases.case import Row
from pinarm.use.cases.case_table import CaseTable, Column, RowTable

TABLE = CaseTable((Column("m", array("d", [0.1, 2.0, 1e-7]), "kg"), Column("law", ["a", "b", "c"])))


def test_a_case_is_what_a_scenario_would_have() -> None:
    assert list(TABLE) == [
        {"m": "0.1 kg", "law": "a"}, {"m": "2.0 kg", "law": "b"}, {"m": "1e-07 kg", "law": "c"},
    ]  # fmt: skip


def test_some_cases_are_a_table_that_travels() -> None:
    some = pickle.loads(pickle.dumps(TABLE.some(np.array([2, 0]))))
    assert [*some] == [TABLE[2], TABLE[0]]
    assert isinstance(some.columns[0].values, array)


def test_a_table_of_cases_has_them_as_they_were() -> None:
    cases = [{"a": "1 m", "b": 2}, {"a": 3.0, "b": "x"}]
    assert [*CaseTable.of(cases)] == cases


def test_rows_are_plain_numbers() -> None:
    rows = RowTable(np.array([[1.0, 0.1], [2.0, np.inf]]), ("/a",))
    assert [*rows] == [Row((1.0, 0.1), "", ("/a",)), Row((2.0, np.inf), "", ("/a",))]
    assert all(type(number) is float for row in rows for number in row.numbers)
