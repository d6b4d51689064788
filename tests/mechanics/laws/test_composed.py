"""Laws one after the other: continuous where they meet, refused where they cannot be."""

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.laws import (
    Constant,
    ConstantAcceleration,
    ConstantSpeed,
    Cycloidal,
    Harmonic,
    Segment,
    Succession,
)

from .test_motion_law import LAWS, across, segments


class TestSuccession:
    def test_position_and_speed_by_hand(self):
        law = LAWS["succession"]
        # 0.5 m by the triangle, rest, then 1.5 m/s^2 for 0.8 s and 1.2 m/s from there on
        s, ds, dds = across(law, [0.0, 1.3, 1.6, 1.9, 2.3, 2.7, 3.3, 5.3])
        assert s == pytest.approx([0.4, 0.9, 0.9, 0.9, 1.02, 1.38, 2.1, 4.5], abs=1e-14)
        assert ds == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.6, 1.2, 1.2, 1.2], abs=1e-14)
        assert dds == pytest.approx([0.0, 0.0, 0.0, 1.5, 1.5, 0.0, 0.0, 0.0], abs=1e-14)

    def test_what_jumps_in_value_or_in_speed_is_refused(self):
        with pytest.raises(InputError, match=r"begins at 0, .* end at 4"):
            Succession(segments=segments((1.0, Constant(value=4.0)), (1.0, Constant(value=0.0))))
        with pytest.raises(InputError, match=r"begins at 2, .* end at 1"):
            Succession(start=1.0, segments=segments((1.0, Cycloidal(start=2.0, end=3.0, duration=1.0))))
        for parts, message in (
            ([ConstantSpeed(speed=0.5)], "from 0 to 0.5 where segment 1 begins"),
            ([ConstantAcceleration(acceleration=1.0), Constant(value=0.0)], "from 1 to 0 where segment 2 begins"),
        ):
            with pytest.raises(InputError, match=message):
                Succession(segments=segments(*((1.0, part) for part in parts))).pieces()


def test_a_speed_that_is_rounding_is_no_jump():
    """A harmonic rise begins with ``cos(-90 deg)``, 6e-17 of its largest speed, and a dwell follows."""
    rise = Harmonic(amplitude=0.01, pulsation=1.0, mean=0.01, phase=-np.pi / 2)
    law = Succession(
        segments=[Segment(duration=np.pi, motion=rise), Segment(duration=1.0, motion=Constant(value=0.02))]
    )
    law.check()
    assert law.breakpoints()
