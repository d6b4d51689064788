"""Instants of rest: against closed forms of slips that change their sign, touch zero, or rest for a while."""

import numpy as np
import pytest

from pinarm.engine.motion.standstill import rests_between

LOOKS = np.linspace(0.0, 1.0, 21)


def rests(*slips):
    def at(t):
        values = np.stack([slip(t) for slip in slips], axis=1)
        return values, np.full_like(values, 1e-12)

    return rests_between(at, LOOKS)


def test_reversals_are_known_to_their_last_digit():
    found = rests(lambda t: np.cos(7.0 * t), lambda t: t - 0.1234)
    assert found == pytest.approx(np.sort([0.0, 0.1234, np.pi / 14, 3 * np.pi / 14, 1.0]), rel=1e-15)


@pytest.mark.parametrize("power", [2.0, 4.0, 1.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_slip_that_touches_zero_does_so_where_it_is_least(power, sign):
    """Known to the root of the rounding, where the slip is zero but for that."""
    place = 0.4321
    found = rests(lambda t: sign * np.abs(t - place) ** power)
    assert len(found) == 3
    assert abs(found[1] - place) ** power < 1e-14


def test_a_slip_that_stays_above_zero_has_no_instant_to_be_looked_at():
    assert rests(lambda t: 1.0 + 0.2 * np.cos(3.0 * t)).tolist() == [0.0, 1.0]


def test_a_pause_has_its_ends():
    found = rests(lambda t: np.maximum(t - 0.5, 0.0))
    assert 0.0 <= found[1] <= 0.5 < found[2] <= 0.55 + 1e-15
