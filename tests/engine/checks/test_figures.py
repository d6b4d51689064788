"""Figures relative to their terms, of one mechanism and of variants."""

import numpy as np

from pinarm.engine.checks.figures import SAMPLE, plain, relative, sampled


def test_the_largest_residual_is_relative_to_the_largest_term_of_any_row() -> None:
    residuals, terms = np.array([1.0, 3.0, 2.0]), np.array([4.0, 5.0, 12.0])
    assert plain({"one": relative(residuals, terms)}) == {"one": 0.25}
    several = relative(np.stack([residuals, 2.0 * residuals], axis=1), np.stack([terms, terms], axis=1))
    np.testing.assert_array_equal(several, [0.25, 0.5])


def test_without_terms_it_is_zero_and_what_is_no_number_stays_none() -> None:
    zero, nothing = np.zeros(3), np.zeros(0)
    assert relative(zero, zero) == 0.0
    assert relative(nothing, nothing) == 0.0
    assert np.isnan(relative(np.array([1.0, np.nan]), np.array([2.0, np.nan])))


def test_all_rows_of_a_short_table_are_checked():
    assert sampled(0).tolist() == [] and sampled(3).tolist() == [0, 1, 2]
    assert sampled(SAMPLE).tolist() == list(range(SAMPLE))
    assert sampled(1001, 1001).tolist() == list(range(1001)) and sampled(5, 0).tolist() == []


def test_those_of_a_long_table_are_evenly_spread():
    rows = sampled(1001)
    assert len(set(rows.tolist())) == SAMPLE and rows[0] == 0 and rows[-1] == 1000
    assert set(np.diff(rows).tolist()) <= {15, 16}, "1000 / 63 apart, but for whole numbers"
