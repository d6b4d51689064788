"""The rows that are checked: all of a short table, an even choice of a long one, its ends among them."""

import numpy as np

from pinarm.engine.checks.sample import SAMPLE, sampled


def test_all_rows_of_a_short_table_are_checked():
    assert sampled(0).tolist() == [] and sampled(3).tolist() == [0, 1, 2]
    assert sampled(SAMPLE).tolist() == list(range(SAMPLE))
    assert sampled(1001, 1001).tolist() == list(range(1001)) and sampled(5, 0).tolist() == []


def test_those_of_a_long_table_are_evenly_spread():
    rows = sampled(1001)
    assert len(set(rows.tolist())) == SAMPLE and rows[0] == 0 and rows[-1] == 1000
    assert set(np.diff(rows).tolist()) <= {15, 16}, "1000 / 63 apart, but for whole numbers"
