"""Figures relative to their terms, of one mechanism and of variants."""

import numpy as np

from pinarm.engine.checks.figures import plain, relative


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
