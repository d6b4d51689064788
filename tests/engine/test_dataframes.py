"""Tables of pandas, and what is said where it is not installed."""

import sys

import pytest

from pinarm.engine.labelled_array import dataframe
from pinarm.errors import InputError


def test_without_pandas_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"pandas is not installed(.|\n)*pip install 'pinarm\[table\]'"):
        dataframe({})
