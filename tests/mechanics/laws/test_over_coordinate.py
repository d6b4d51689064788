"""Laws over a coordinate: chain rule, instants at which breakpoints are passed, turns of a cam, what is refused."""

import math

import numpy as np
import pytest

from pinarm.errors import InputError, UnitError
from pinarm.input.units import unit
from pinarm.mechanics.laws import (
    Constant,
    ConstantSpeed,
    Cycloidal,
    Harmonic,
    Over,
    Polynomial,
    Segment,
    Spline,
    Succession,
    Trapezoid,
)
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.mechanics.laws.over_coordinate import reversals

CAM = Succession(segments=[
    Segment(duration=1.0, motion=Cycloidal(start=0.0, end=0.02, duration=1.0)),
    Segment(duration=0.5, motion=Constant(value=0.02)),
    Segment(duration=1.5, motion=Cycloidal(start=0.0, end=-0.02, duration=1.5)),
])  # fmt: skip
"""Rise, dwell and return within 3 rad; then it rests to 4 rad."""


def driven(profile, drive, end=4.0, period=None):
    return Over(of="crank", profile=profile, period=period).along(drive, 0.0, end)


def values(law, t):
    """Return s, s' and s'' at instants that are no breakpoints, shape (3, n)."""
    return np.array([law.on(x - 1e-9, x + 1e-9)(np.array([x])) for x in t])[:, :, 0].T


DRIVES = {
    "turning": ConstantSpeed(speed=0.9, start=-0.3),
    "turning back": ConstantSpeed(speed=-0.9, start=3.1),
    "swinging": Harmonic(mean=1.2, amplitude=1.6, pulsation=2.0, phase=0.3),
    "stopping": Polynomial(start=-0.2, end=2.9, duration=3.0, degree=5, begin=0.5),
}
PROFILES = {
    "cycloidal": Cycloidal(start=0.1, end=0.7, duration=2.0, begin=0.4),
    "trapezoid": Trapezoid(start=0.0, end=1.0, acceleration=1.5, speed=0.8, begin=0.2),
    "cubic": Spline(points=[(0.0, 0.0), (2.6, 0.5)], speeds=(0.3, -0.4)),
    "cam": CAM,
}


@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_it_is_the_profile_at_the_drive_and_its_derivatives_are_those_of_time(profile, drive, differentiate):
    law = driven(profile, drive)
    t = np.linspace(0.05, 3.95, 31)
    cuts = np.array(law.breakpoints())
    t = t[np.abs(t[:, None] - cuts).min(axis=1, initial=9.0) > 0.021]  # the differences below stay on one piece
    assert len(t) > 15
    s, ds, dds = values(law, t)
    place = values(drive, t)[0]
    assert s == pytest.approx(values(profile, place)[0], abs=1e-14)
    assert ds == pytest.approx(differentiate(lambda x: values(law, x)[0], t, h=0.02), abs=1e-8)
    assert dds == pytest.approx(differentiate(lambda x: values(law, x)[1], t, h=0.02), abs=1e-7)


def test_rows_stand_on_both_sides_of_where_the_drive_passes_a_jump_of_the_profile():
    """A triangle of speed over 0.5 .. 1.5 rad at 2 rad/s: s'' = 4 f'' jumps at 0.25, 0.5 and 0.75 s."""
    law = driven(Trapezoid(start=0.0, end=1.0, acceleration=4.0, begin=0.5), ConstantSpeed(speed=2.0))
    assert law.jumps() == pytest.approx([0.25, 0.5, 0.75], abs=1e-15)
    grid = Grid.cover(np.linspace(0.0, 1.0, 3), [law])
    _, _, dds = grid.evaluate(law)
    assert grid.t == pytest.approx([0.0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1.0], abs=1e-15)
    assert dds == pytest.approx([0.0, 0.0, 16.0, 16.0, -16.0, -16.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("beyond", [0.0, 1e-14, -1e-14])
def test_a_drive_that_only_touches_a_breakpoint_does_not_pass_it(beyond):
    touching = driven(Cycloidal(start=0.0, end=1.0, duration=1.0), Harmonic(amplitude=1.0 + beyond, pulsation=1.0), 3.0)
    assert touching.breakpoints() == []
    s, ds, dds = touching.on(0.0, 3.0)(np.array([math.pi / 2]))
    assert (s, ds, dds) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_a_cam_repeats_with_every_turn_of_its_drive(speed):
    law = driven(CAM, ConstantSpeed(speed=speed, start=0.3), end=10.0, period=4.0)
    t = np.linspace(0.03, 9.97, 313)
    once = values(CAM, np.mod(0.3 + speed * t, 4.0))
    assert values(law, t) == pytest.approx(once * np.array([[1.0], [speed], [speed**2]]), abs=1e-13)
    assert len(law.breakpoints()) == 4 * 5 or len(law.breakpoints()) == 4 * 5 - 1
    assert all(np.diff([0.0, *law.breakpoints(), 10.0]) > 1e-3)


@pytest.mark.parametrize(("profile", "says"), [
    (ConstantSpeed(speed=0.1), "its value is 0 at 0 and 0.1 after a period"),
    (Harmonic(amplitude=1.0, pulsation=math.pi), "its slope is 3.14159 at 0 and -3.14159"),
])  # fmt: skip
def test_a_profile_that_does_not_close_is_refused(profile, says):
    with pytest.raises(InputError, match=says):
        Over(of="crank", profile=profile, period=1.0)


def test_units_are_those_of_both_coordinates():
    cam = Over(of="crank", profile=Constant(value="20 mm"), period="360 deg")
    cam.check_units(unit("m"), unit("rad"))
    for of, along, path in (("rad", "rad", ("profile", "value")), ("m", "m", ("period",))):
        with pytest.raises(UnitError) as caught:
            cam.check_units(unit(of), unit(along))
        assert caught.value.path == path


@pytest.mark.parametrize("swings", [8, 2048])
def test_all_reversals_of_a_swing_are_found_however_fast(swings):
    """``sin 2 pi n t`` turns back at ``(2 k + 1)/(4 n)``; 2049 even instants see nothing of 1024 or 2048 swings."""
    drive = Harmonic(amplitude=0.01, pulsation=2.0 * math.pi * swings)
    known = (2.0 * np.arange(2 * swings) + 1.0) / (4.0 * swings)
    assert reversals(drive, 0.0, 1.0) == pytest.approx(known, abs=1e-7 / swings)
