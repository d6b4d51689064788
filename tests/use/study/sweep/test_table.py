"""Tables with a line per case, read back by the csv module, and statistics as the statistics module has them."""

import csv as reader
import io
import statistics as independent

import numpy as np
import pytest

import pinarm
from pinarm.input.units import unit
from pinarm.use.study.sweep.table import arrays, cases_csv, statistics

ERRORS = {1: 'no solution at 3.2, "really"', 3: "no solution at 17.5", 4: "another reason"}


@pytest.fixture
def series():
    """Return a function that makes a column of torques."""
    return lambda name, values: pinarm.Series(name, unit("N*m"), np.asarray(values))


@pytest.fixture
def columns(series):
    return [series("C_B", [0.1 + 0.2, np.nan, 1e-300, np.nan, np.nan, -7.0]), series("=x", np.arange(6))]


def test_every_digit_and_every_reason_is_read_back(columns):
    found = arrays(columns, ERRORS)
    assert found["=x"].tolist() == list(range(6))
    assert found["units"].tolist() == [["C_B", "N*m"], ["=x", "N*m"]]
    assert found["error"][4] == "another reason"
    rows = list(reader.reader(io.StringIO(b"".join(cases_csv(columns, ERRORS)).decode())))
    assert rows[0] == ["case", "C_B [N*m]", "'=x [N*m]", "error"]
    assert [row[0] for row in rows[1:]] == list("012345")
    assert [float(row[1]) if row[1] else None for row in rows[1:]] == [0.1 + 0.2, None, 1e-300, None, None, -7.0]
    assert {int(row[0]): row[3] for row in rows[1:] if row[3]} == ERRORS


def test_statistics_are_over_the_cases_that_have_numbers(series):
    values = [3.0, np.nan, -1.5, 8.25, 0.5]
    known = [x for x in values if not np.isnan(x)]
    found = statistics(series("x", values))
    assert (found["cases"], found["at_min"], found["at_max"], found["unit"]) == (4, 2, 3, "N*m")
    assert (found["min"], found["max"]) == (-1.5, 8.25)
    assert found["mean"] == pytest.approx(independent.fmean(known), rel=1e-15)
    assert found["deviation"] == pytest.approx(independent.stdev(known), rel=1e-14)
    assert found["median"] == pytest.approx(independent.median(known), rel=1e-15)
    assert statistics(series("x", [np.nan])) == {"unit": "N*m", "cases": 0}
    assert "deviation" not in statistics(series("x", [2.0, np.nan]))  # n - 1 = 0
