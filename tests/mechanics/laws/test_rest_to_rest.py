"""Laws from rest to rest: times in closed form, limits that are kept, and what could never arrive."""

import math

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.laws import SCurve, Trapezoid

from .test_motion_law import LAWS

BOUNDED = [name for name, law in LAWS.items() if isinstance(law, SCurve) and len(law.pieces()) > 1]


def test_degree_seven_keeps_its_jerk_too(differentiate):
    move = LAWS["polynomial 7"].pieces()[1]
    jerk = differentiate(lambda x: move.function(x)[2], np.array([move.start, move.end]))
    assert jerk == pytest.approx(0.0, abs=1e-10)  # differences over h = 0.02


@pytest.mark.parametrize("sign", [1, -1])
def test_trapezoid_takes_the_time_of_its_closed_form(sign):
    law = Trapezoid(start=0.5, end=0.5 + sign * 1.2, acceleration=2.0, speed=0.8, begin=0.25)
    rise, total = 0.8 / 2.0, 1.2 / 0.8 + 0.8 / 2.0
    expected = [0.25, 0.25 + rise, 0.25 + total - rise, 0.25 + total]
    assert law.breakpoints() == pytest.approx(expected, abs=1e-15)
    _, ds, dds = law.on(0.8, 0.9)(np.array([0.8]))
    assert (ds[0], dds[0]) == pytest.approx((sign * 0.8, 0.0), abs=1e-15)
    assert law.on(0.25, 0.3)(np.array([0.25]))[2][0] == sign * 2.0
    assert law.on(*expected[2:])(np.array([1.8]))[2][0] == -sign * 2.0


@pytest.mark.parametrize(("kind", "broken"), [
    (Trapezoid, {"acceleration": 0.0}), (Trapezoid, {"acceleration": 1.0, "speed": 0.0}),
    (SCurve, {"jerk": 0.0}), (SCurve, {"jerk": 1.0, "acceleration": 0.0}), (SCurve, {"jerk": 1.0, "speed": 0.0}),
])  # fmt: skip
def test_what_could_never_arrive_is_refused(kind, broken):
    with pytest.raises(InputError, match="other than 0"):
        kind(start=0.0, end=1.0, **broken)


def minimal_time(distance, jerk, acceleration=math.inf, speed=math.inf):
    """Shortest time from rest to rest under the three bounds: Biagiotti and Melchiorri, section 3.4."""
    if acceleration**2 >= speed * jerk:  # the acceleration is not reached before the speed
        ramp, rise = math.sqrt(speed / jerk), 2 * math.sqrt(speed / jerk)
    else:
        ramp, rise = acceleration / jerk, acceleration / jerk + speed / acceleration
    if speed < math.inf and distance >= speed * rise:
        return distance / speed + rise
    if distance <= 2 * acceleration**3 / jerk**2:
        return 4 * (distance / (2 * jerk)) ** (1 / 3)
    ramp = acceleration / jerk
    return ramp + math.sqrt(ramp**2 + 4 * distance / acceleration)


class TestSCurve:
    @pytest.mark.parametrize("name", BOUNDED)
    def test_bounds_are_kept_and_the_time_is_minimal(self, name):
        law = LAWS[name]
        limits = {"acceleration": law.acceleration or math.inf, "speed": law.speed or math.inf}
        moving = law.pieces()[1:-1]
        total = moving[-1].end - moving[0].start
        assert total == pytest.approx(minimal_time(abs(law.end - law.start), law.jerk, **limits), rel=1e-14)
        for piece in moving:
            t = np.linspace(piece.start, piece.end, 21)
            _, ds, dds = piece.function(t)
            assert np.abs(ds).max() <= limits["speed"] * (1 + 1e-13)
            assert np.abs(dds).max() <= limits["acceleration"] * (1 + 1e-13)
            slope = (dds[-1] - dds[0]) / (t[-1] - t[0])
            # constant on each interval, and either full or none
            assert dds == pytest.approx(dds[0] + slope * (t - t[0]), abs=1e-13)
            assert min(abs(abs(slope) - law.jerk), abs(slope)) < 1e-11

    @pytest.mark.parametrize("limits", [{}, {"speed": 1.0}, {"acceleration": 2.0}, {"speed": 1.0, "acceleration": 2.0}])
    def test_it_arrives_in_minimal_time_at_any_distance(self, limits):
        for distance in (1e-9, 1e-3, 0.37, 1.0, 1e3):
            self.arrives(distance, limits)

    def arrives(self, distance, limits):
        law = SCurve(start=0.0, end=distance, jerk=5.0, **limits)
        assert law.breakpoints()[-1] == pytest.approx(minimal_time(distance, 5.0, **limits), rel=1e-12)
        moving = law.pieces()[-2]
        s, ds, dds = (float(x[0]) for x in moving.function(np.array([moving.end])))
        assert s == pytest.approx(distance, rel=1e-12)
        assert abs(ds) < 1e-12 * max(1.0, distance)
        assert abs(dds) < 1e-11 * max(1.0, distance)
