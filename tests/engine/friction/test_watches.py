"""Instants at which slips end or turn, by hand."""

import numpy as np
import pytest

from pinarm.engine.friction.sliding import REST, distance_from_rest, resting_speed
from pinarm.engine.friction.slip import Slip

INSTANT = 1e-13
"""Slip that rounding of the instant leaves [m/s]."""


def gap(direction, slips):
    parts = np.arange(len(direction))
    slip = Slip(tuple(direction), rest=(INSTANT,) * len(direction))
    return distance_from_rest(slip, parts, np.array(slips), np.array(slips))


def test_a_slip_ends_where_it_changes_its_sign():
    assert gap([-1.0], [[-2.0], [0.0], [1e-3]]) == pytest.approx(
        [2.0 + 2.0 * REST + INSTANT, INSTANT, INSTANT - (1.0 - REST) * 1e-3], rel=1e-15
    )
    assert (gap([0.0], [[0.0], [1e-9], [-1e-9]]) > 0.0).tolist() == [True, False, False]


def test_a_slip_with_two_components_ends_at_rest_or_where_it_has_turned_by_60_degrees():
    angles = np.radians([0.0, 59.9, 60.1, 90.0, 180.0])
    slips = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    assert (gap([1.0, 0.0], slips) > 0.0).tolist() == [True, True, False, False, False]
    assert (gap([1.0, 0.0], 1e-6 * slips) > 0.0).tolist() == [True, True, False, False, False]


def test_rest_is_relative_to_the_velocities_of_the_state():
    slip = Slip((1.0, 0.0), rest=(3e-15, 0.0))
    assert resting_speed(slip, np.array([2.0, -5.0])) == pytest.approx([3e-15 + 5.0 * REST, 5.0 * REST], rel=1e-12)
    assert resting_speed(slip, np.zeros((4, 2))).tolist() == [[3e-15, 0.0]] * 4
