"""Tables of pandas, and what is said where it is not installed."""

import sys

import pytest

from pinarm.engine.labelled_array import dataframe
from pinarm.errors import InputError


def test_columns_and_rows_become_a_table() -> None:
    pytest.importorskip("pandas")
    assert dataframe({"a [m]": [1.0, 2.0], "b": [3.0, 4.0]})["a [m]"].tolist() == [1.0, 2.0]
    assert dataframe([("x", 1.0)], columns=["what", "much"])["much"].tolist() == [1.0]


def test_without_pandas_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"pandas is not installed(.|\n)*pip install 'pinarm\[table\]'"):
        dataframe({})
