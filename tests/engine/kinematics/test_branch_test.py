"""Leaps to another branch: of positions that are predicted, and through singular positions."""

import numpy as np
import pytest

from pinarm.engine.kinematics.branch_test import AIMED, NEARER, on_branch, part_of_leap


def test_a_solution_with_the_predicted_velocity_is_on_the_branch() -> None:
    """By a third-order prediction: position off by ``h^3 j / 6``, velocity times h by three times as much."""
    off = 1e-6
    turned = np.array([[3.0 * off, 0.0], [100.0 * off, 0.0]])  # the second one has another velocity
    assert on_branch(turned, np.array([off, off])).tolist() == [True, False]
    assert on_branch(np.array([1e-12, 0.0]), np.array(0.0))  # rounding


def square(least: float, sign: float = 1.0) -> np.ndarray:
    """Return J with singular values 1 and ``least``."""
    return np.diag([1.0, sign * least])


def test_a_step_that_meets_no_singular_position_is_taken() -> None:
    assert part_of_leap(square(0.5), square(0.1)) == 1.0


def test_a_step_that_leads_past_one_stops_before_it() -> None:
    """The least singular value changes evenly from 0.5 to -0.3: it is ``0.3 * 0.5`` after ``0.35 / 0.8`` of the way."""
    assert part_of_leap(square(0.5), square(0.3, -1.0)) == pytest.approx(0.5 * (1.0 - NEARER) / 0.8, rel=1e-12)


def test_from_very_near_one_the_step_goes_twice_the_way() -> None:
    least = AIMED
    assert part_of_leap(square(least), square(0.3, -1.0)) == pytest.approx(2.0 * least / (0.3 + least), rel=1e-12)
    assert part_of_leap(square(least), square(least, -1.0)) == 1.0
