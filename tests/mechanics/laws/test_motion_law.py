import math
import typing
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from pinarm.errors import InputError, UnitError
from pinarm.input.units import unit
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.schema import Measured, measured_fields, reading_from
from pinarm.mechanics.laws import (
    Constant,
    ConstantAcceleration,
    ConstantSpeed,
    Cycloidal,
    Harmonic,
    Law,
    Polynomial,
    SCurve,
    Segment,
    SpeedPoints,
    Spline,
    Steps,
    Succession,
    Table,
    Trapezoid,
)
from pinarm.mechanics.laws.interpolated import cached_table
from pinarm.mechanics.laws.motion_law import Grid

MEMBERS = typing.get_args(Law)
HERE = Path(__file__).parent


def table(folder, text=None, **fields):
    """Return the law of a CSV file in a folder, which is written where its text is given."""
    if text is not None:
        (folder / "table.csv").write_text(text)
    with reading_from(folder):
        return Table(**{"file": "table.csv", **fields})


def segments(*parts):
    return [Segment(duration=duration, motion=motion) for duration, motion in parts]


SAMPLES = {
    Constant: {"constant": Constant(value=0.3)},
    ConstantSpeed: {"constant speed": ConstantSpeed(start=0.2, speed=-1.5, begin=0.4)},
    ConstantAcceleration: {
        "constant acceleration": ConstantAcceleration(start=0.2, speed=0.5, acceleration=-2.0, begin=0.3)
    },
    Trapezoid: {
        "trapezoid": Trapezoid(start=0.1, end=1.3, acceleration=2.0, speed=0.8, begin=0.25),
        "falling trapezoid": Trapezoid(start=1.3, end=0.1, acceleration=2.0, speed=0.8, begin=0.25),
        "triangle": Trapezoid(start=0.1, end=1.3, acceleration=2.0, begin=0.25),
        "triangle below its limit": Trapezoid(start=0.1, end=1.3, acceleration=2.0, speed=9.0, begin=0.25),
        "standing trapezoid": Trapezoid(start=0.4, end=0.4, acceleration=2.0, speed=0.8),
    },
    Polynomial: {
        f"polynomial {degree}": Polynomial(start=0.7, end=-0.5, duration=1.6, degree=degree, begin=0.3)
        for degree in (3, 5, 7)
    },
    Cycloidal: {"cycloidal": Cycloidal(start=0.7, end=-0.5, duration=1.6, begin=0.3)},
    Harmonic: {"harmonic": Harmonic(mean=0.2, amplitude=0.9, pulsation=3.0, phase=0.4, begin=0.1)},
    SCurve: {
        "s-curve": SCurve(start=0.1, end=2.3, jerk=9.0, acceleration=3.0, speed=1.5, begin=0.25),
        "falling s-curve": SCurve(start=2.3, end=0.1, jerk=9.0, acceleration=3.0, speed=1.5, begin=0.25),
        "s-curve without limits": SCurve(start=0.1, end=1.3, jerk=9.0, begin=0.25),
        "s-curve below its limits": SCurve(start=0.1, end=1.3, jerk=9.0, acceleration=30.0, speed=15.0, begin=0.25),
        "s-curve below its speed": SCurve(start=0.1, end=2.3, jerk=9.0, acceleration=2.0, speed=15.0, begin=0.25),
        "s-curve below its acceleration": SCurve(start=0.1, end=2.3, jerk=9.0, acceleration=9.0, speed=1.5, begin=0.25),
        "standing s-curve": SCurve(start=0.4, end=0.4, jerk=9.0),
    },
    SpeedPoints: {
        "speed points": SpeedPoints(start=0.2, points=[(0.3, 0.0), (1.1, 0.8), (2.0, 0.8), (2.5, -0.4)]),
        "one speed point": SpeedPoints(start=0.2, points=[(0.3, 0.7)]),
    },
    Steps: {"steps": Steps(points=[(0.3, 0.2), (0.9, 1.0), (1.4, -0.7)])},
    Spline: {
        "spline": Spline(points=[(0.3, 0.2), (0.9, 1.0), (1.4, 0.7), (2.2, 1.5)], speeds=(0.4, -0.6)),
        "spline of two points": Spline(points=[(0.3, 0.2), (1.9, 1.0)]),
    },
    Table: {"table": table(HERE, speeds=(0.3, 0.0))},
    Succession: {
        "succession": Succession(start=0.4, begin=0.2, segments=segments(
            (1.2, Trapezoid(start=0.0, end=0.5, acceleration=2.0, begin=0.1)),
            (0.5, Constant(value=0.9)),
            (0.8, ConstantAcceleration(acceleration=1.5)),
            (0.6, ConstantSpeed(speed=1.2)),
        )),
        "succession of one": Succession(segments=segments((1.5, Cycloidal(start=0.0, end=1.0, duration=1.0)))),
    },
}  # fmt: skip
LAWS = {name: law for samples in SAMPLES.values() for name, law in samples.items()}
JUMPS = {
    "trapezoid": [0.25, 0.65, 1.75, 2.15], "falling trapezoid": [0.25, 0.65, 1.75, 2.15],
    "triangle": [0.25, 0.25 + math.sqrt(0.6), 0.25 + math.sqrt(2.4)],
    "triangle below its limit": [0.25, 0.25 + math.sqrt(0.6), 0.25 + math.sqrt(2.4)],
    "polynomial 3": [0.3, 1.9], "speed points": [0.3, 1.1, 2.0, 2.5],
    "steps": [0.9, 1.4], "spline": [0.3, 2.2], "spline of two points": [0.3, 1.9], "table": [0.3, 2.0],
    "succession": [0.3, 0.8, 1.3, 1.9, 2.7],
}  # fmt: skip
FROM_REST_TO_REST = [name for name, law in LAWS.items() if hasattr(law, "end") and len(law.pieces()) > 1]
BOUNDED = [name for name, law in LAWS.items() if isinstance(law, SCurve) and len(law.pieces()) > 1]
ROUNDING = 5e-13
"""Coefficients of the polynomial of degree 7 reach 100, and its derivatives multiply them by 7 and 42."""
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def inside(piece):
    """Instants within a piece, its ends left out."""
    low, high = max(piece.start, -2.0), min(piece.end, 5.0)
    return low + (high - low) * np.array([0.03, 0.2, 0.5, 0.71, 0.97])


def test_every_law_of_the_union_has_a_sample():
    assert set(SAMPLES) == set(MEMBERS)
    assert all(type(law) is member for member, samples in SAMPLES.items() for law in samples.values())


@every_law
def test_derivatives_are_those_of_the_value(law, differentiate):
    for piece in law.pieces():
        t = inside(piece)
        _, ds, dds = piece.function(t)
        # differences of order 8 with h = 0.02: 1e-13 from the formula, a little more from rounding over h
        assert differentiate(lambda x: piece.function(x)[0], t) == pytest.approx(ds, abs=1e-11)  # noqa: B023
        assert differentiate(lambda x: piece.function(x)[1], t) == pytest.approx(dds, abs=1e-11)  # noqa: B023


@every_law
def test_pieces_stand_end_to_end_over_all_times(law):
    pieces = law.pieces()
    assert pieces[0].start == -math.inf
    assert pieces[-1].end == math.inf
    assert all(piece.start < piece.end for piece in pieces)
    assert [piece.end for piece in pieces[:-1]] == [piece.start for piece in pieces[1:]] == law.breakpoints()


@pytest.mark.parametrize("law", [law for law in LAWS.values() if not isinstance(law, Steps)])
def test_value_and_speed_are_continuous(law):
    assert not law.value_jumps()
    for before, after in zip(law.pieces(), law.pieces()[1:], strict=False):
        t = np.array([after.start])
        left, right = np.array(before.function(t)), np.array(after.function(t))
        assert left[:2] == pytest.approx(right[:2], abs=ROUNDING)


def test_steps_hold_each_value_from_its_instant_on():
    law = LAWS["steps"]
    assert law.value_jumps() == law.breakpoints() == [0.9, 1.4]
    t = np.array([-1.0, 0.5, 0.9, 1.2, 1.4, 9.0])
    grid = Grid.cover(t, [law])
    assert grid.t.tolist() == [-1.0, 0.5, 0.9, 0.9, 1.2, 1.4, 1.4, 9.0]
    assert grid.evaluate(law)[0].tolist() == [0.2, 0.2, 0.2, 1.0, 1.0, 1.0, -0.7, -0.7]
    assert not np.array(grid.evaluate(law)[1:]).any()


@pytest.mark.parametrize("name", ["polynomial 5", "polynomial 7", "cycloidal", *BOUNDED])
def test_smooth_laws_keep_their_acceleration(name):
    law = LAWS[name]
    for before, after in zip(law.pieces(), law.pieces()[1:], strict=False):
        t = np.array([after.start])
        assert before.function(t)[2] == pytest.approx(after.function(t)[2], abs=ROUNDING)


def test_degree_seven_keeps_its_jerk_too(differentiate):
    move = LAWS["polynomial 7"].pieces()[1]
    jerk = differentiate(lambda x: move.function(x)[2], np.array([move.start, move.end]))
    assert jerk == pytest.approx(0.0, abs=1e-10)  # differences over h = 0.02


@every_law
def test_jumps_are_those_of_the_acceleration(law):
    name = next(name for name, other in LAWS.items() if other is law)
    expected = JUMPS.get(name, [])
    assert set(law.jumps()) <= set(law.breakpoints())
    assert law.jumps() == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("duration", [1e-3, 0.01, 0.1, 0.3, 1.0, 30.0, 1e3])
@pytest.mark.parametrize("begin", [0.0, 0.3, 1.7])
def test_jumps_do_not_depend_on_the_time_scale(duration, begin):
    common = {"start": 0.1, "end": 1.3, "duration": duration, "begin": begin}
    stop = begin + duration
    assert Polynomial(**common, degree=3).jumps() == [begin, stop]
    assert Polynomial(**common, degree=5).jumps() == []
    assert Polynomial(**common, degree=7).jumps() == []
    assert Cycloidal(**common).jumps() == []


@pytest.mark.parametrize("name", FROM_REST_TO_REST)
def test_laws_from_rest_to_rest_begin_and_end_there(name):
    law = LAWS[name]
    first, *_, last = law.pieces()
    for outer, t, level in ((first, -30.0, law.start), (last, 30.0, law.end)):
        assert [x[0] for x in outer.function(np.array([t]))] == [level, 0.0, 0.0]
    for moving, t, level in ((law.pieces()[1], law.begin, law.start), (law.pieces()[-2], last.start, law.end)):
        s, ds, _ = moving.function(np.array([t]))
        assert s == pytest.approx(level, abs=ROUNDING)
        assert ds == pytest.approx(0.0, abs=ROUNDING)


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


@pytest.mark.parametrize(("acceleration", "speed"), [(-2.0, 0.8), (2.0, -0.8), (-2.0, -0.8)])
def test_signs_of_the_limits_do_not_matter(acceleration, speed):
    law = Trapezoid(start=0.1, end=1.3, acceleration=acceleration, speed=speed, begin=0.25)
    assert law.breakpoints() == LAWS["trapezoid"].breakpoints()


def test_triangle_reaches_its_closed_form_peak():
    law = LAWS["triangle"]
    half = math.sqrt(1.2 / 2.0)
    assert law.breakpoints() == pytest.approx([0.25, 0.25 + half, 0.25 + 2 * half])
    s, ds, _ = law.on(0.25, 0.25 + half)(np.array([0.25 + half]))
    assert (s[0], ds[0]) == pytest.approx((0.7, math.sqrt(1.2 * 2.0)))


@pytest.mark.parametrize(
    ("law", "t", "expected"),
    [
        (LAWS["constant"], 7.0, (0.3, 0.0, 0.0)),
        (LAWS["constant speed"], 1.4, (-1.3, -1.5, 0.0)),
        (LAWS["constant acceleration"], 1.3, (-0.3, -1.5, -2.0)),
        (LAWS["harmonic"], 0.1, (0.2 + 0.9 * math.sin(0.4), 2.7 * math.cos(0.4), -8.1 * math.sin(0.4))),
        (LAWS["polynomial 3"], 1.1, (0.1, -1.2 / 1.6 * 1.5, 0.0)),
        (LAWS["polynomial 5"], 1.1, (0.1, -1.2 / 1.6 * 1.875, 0.0)),
        (LAWS["polynomial 7"], 1.1, (0.1, -1.2 / 1.6 * 2.1875, 0.0)),
        (LAWS["cycloidal"], 1.1, (0.1, -1.2 / 1.6 * 2.0, 0.0)),
    ],
)
def test_values_by_hand(law, t, expected):
    found = law.on(t - 1e-3, t + 1e-3)(np.array([t]))
    assert [x[0] for x in found] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("broken", [{"acceleration": 0.0}, {"acceleration": 1.0, "speed": 0.0}])
def test_trapezoid_that_could_never_arrive_is_refused(broken):
    with pytest.raises(InputError, match="other than 0"):
        Trapezoid(start=0.0, end=1.0, **broken)


def marked_fields():
    return [
        (law, name, kind.order)
        for member, samples in SAMPLES.items()
        for law in list(samples.values())[:1]
        for name, kind in measured_fields(member).items()
        if kind.order is not None
    ]


@pytest.mark.parametrize(("law", "name", "order"), marked_fields())
@pytest.mark.parametrize("base", ["m", "rad", "N*m"])
def test_fields_accept_the_unit_of_their_derivative_only(law, name, order, base):
    def changed(text):
        return msgspec.structs.replace(law, **{name: written(getattr(law, name), text)})

    units = [base, f"{base}/s", f"{base}/s^2", f"{base}/s^3"]
    changed(units[order]).check_units(unit(base))
    for wrong in units[:order] + units[order + 1 :]:
        with pytest.raises(UnitError, match="not a unit of this quantity"):
            changed(wrong).check_units(unit(base))


def test_every_law_says_which_derivative_its_fields_are():
    nested = {"points", "speeds", "segments", "file", "times", "values", "measured"}
    plain = {"law", "begin", "duration", "degree", "pulsation", "phase"} | nested
    assert {(type(law), name) for law, name, _ in marked_fields()} == {
        (member, name) for member in MEMBERS for name in member.__struct_fields__ if name not in plain
    }


def written(number, text):
    value = Measured(number)
    value.unit = unit(text)
    return value


NESTED = {
    "speed of a point": lambda x: SpeedPoints(points=[(0.0, 0.0), (1.0, x)]),
    "point of a spline": lambda x: Spline(points=[(0.0, 0.0), (1.0, x)]),
    "first speed of a spline": lambda x: Spline(points=[(0.0, 0.0), (1.0, 0.0)], speeds=(x, 0.0)),
    "last speed of a spline": lambda x: Spline(points=[(0.0, 0.0), (1.0, 0.0)], speeds=(0.0, x)),
    "first speed of a table": lambda x: table(HERE, speeds=(x, 0.0)),
    "last speed of a table": lambda x: table(HERE, speeds=(0.0, x)),
    "level in a segment": lambda x: Succession(segments=segments((1.0, Constant(value=x)))),
    "acceleration in a segment": lambda x: Succession(
        segments=segments((1.0, Constant(value=0.0)), (1.0, ConstantAcceleration(acceleration=x)))
    ),
    "speed in a segment of a segment": lambda x: Succession(
        segments=segments((1.0, Succession(segments=segments((1.0, SpeedPoints(points=[(0.0, 0.0), (1.0, x)]))))))
    ),
}


@pytest.mark.parametrize("name", NESTED)
def test_nested_values_accept_the_unit_of_their_derivative_only(name):
    right = {"point": "rad", "level": "rad", "acceleration": "rad/s^2"}.get(name.split()[0], "rad/s")
    NESTED[name](written(1.0, right)).check_units(unit("rad"))
    for wrong in {"rad", "rad/s", "rad/s^2", "m"} - {right}:
        with pytest.raises(UnitError, match="not a unit of this quantity"):
            NESTED[name](written(1.0, wrong)).check_units(unit("rad"))


@pytest.mark.parametrize("field", ["begin", "duration"])
def test_times_are_refused_in_other_units(field):
    law = Polynomial(**{"start": 0.0, "end": 1.0, "duration": 1.0, field: "2 m"})
    law.check_units(unit("rad"), along=unit("m"))
    with pytest.raises(UnitError, match="not a unit of this quantity") as caught:
        law.check_units(unit("rad"))
    assert caught.value.path == (field,)


def test_rates_of_a_profile_are_per_unit_of_what_it_runs_along():
    law = Trapezoid(start="0 mm", end="2 mm", acceleration="1 mm/rad^2", speed="1 mm/deg", begin="30 deg")
    law.check_units(unit("m"), along=unit("rad"))
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        law.check_units(unit("m"))
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        law.check_units(unit("m"), along=unit("m"))
    Harmonic(amplitude="1 mm", pulsation="3 1/m").check_units(unit("m"), along=unit("m"))
    points = Succession(segments=segments(("20 deg", SpeedPoints(points=[("0 deg", 0.0), ("9 deg", "1 mm/rad")]))))
    points.check_units(unit("m"), along=unit("rad"))
    with pytest.raises(UnitError, match="not a unit") as caught:
        points.check_units(unit("m"), along=unit("m"))
    assert caught.value.path == ("segments", 0, "duration")


@every_law
def test_shape_of_the_instants_is_kept(law):
    for t in (np.array(0.5), np.linspace(0.31, 0.4, 3), np.zeros((2, 3))):
        assert [np.shape(x) for x in law.on(0.31, 0.4)(t)] == [t.shape] * 3


def test_on_takes_the_side_of_the_stretch():
    law = LAWS["trapezoid"]
    jump = np.array([0.25])
    assert law.on(0.0, 0.25)(jump)[2] == 0.0
    assert law.on(0.25, 0.3)(jump)[2] == 2.0


def across(law, t):
    """Return s, s', s'' at instants that ascend, s'' just after each jump."""
    return np.array([law.on(x, x + 1e-12)(np.array([x])) for x in t])[:, :, 0].T


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

    @pytest.mark.parametrize(
        ("name", "intervals"),
        [
            ("s-curve", 7), ("s-curve without limits", 4), ("s-curve below its limits", 4),
            ("s-curve below its speed", 6), ("s-curve below its acceleration", 5),
        ],
    )  # fmt: skip
    def test_as_many_stretches_as_limits_are_reached(self, name, intervals):
        # without a full acceleration two intervals of equal jerk meet in the middle
        assert len(LAWS[name].pieces()) - 2 == intervals

    @pytest.mark.parametrize("distance", [1e-9, 1e-3, 0.37, 1.0, 1e3])
    @pytest.mark.parametrize("limits", [{}, {"speed": 1.0}, {"acceleration": 2.0}, {"speed": 1.0, "acceleration": 2.0}])
    def test_it_arrives_in_minimal_time_at_any_distance(self, distance, limits):
        law = SCurve(start=0.0, end=distance, jerk=5.0, **limits)
        assert law.breakpoints()[-1] == pytest.approx(minimal_time(distance, 5.0, **limits), rel=1e-12)
        moving = law.pieces()[-2]
        s, ds, dds = (float(x[0]) for x in moving.function(np.array([moving.end])))
        assert s == pytest.approx(distance, rel=1e-12)
        assert abs(ds) < 1e-12 * max(1.0, distance)
        assert abs(dds) < 1e-11 * max(1.0, distance)

    @pytest.mark.parametrize("distance", [2 * 2.0**3 / 5.0**2, 1.0 * (1.0 / 2.0 + 2.0 / 5.0)])
    def test_limits_that_are_only_just_reached(self, distance):
        law = SCurve(start=0.0, end=distance, jerk=5.0, acceleration=2.0, speed=1.0)
        assert law.breakpoints()[-1] == pytest.approx(minimal_time(distance, 5.0, 2.0, 1.0), rel=1e-12)
        assert law.jumps() == []

    @pytest.mark.parametrize("signs", [(-1, 1, 1), (1, -1, 1), (1, 1, -1)])
    def test_signs_of_the_limits_do_not_matter(self, signs):
        j, a, v = signs
        law = SCurve(start=0.1, end=2.3, jerk=9.0 * j, acceleration=3.0 * a, speed=1.5 * v, begin=0.25)
        assert law.breakpoints() == LAWS["s-curve"].breakpoints()

    @pytest.mark.parametrize("broken", [{"jerk": 0.0}, {"jerk": 1.0, "acceleration": 0.0}, {"jerk": 1.0, "speed": 0.0}])
    def test_one_that_could_never_arrive_is_refused(self, broken):
        with pytest.raises(InputError, match="other than 0"):
            SCurve(start=0.0, end=1.0, **broken)


class TestSpeedPoints:
    def test_a_ramp_of_speed_by_hand(self):
        """A carousel: 0 to 0.84 rad/s within 9 s, then steady: 0.84 * 9 / 2 + 0.84 * 8 = 10.5 rad after 17 s."""
        law = SpeedPoints(points=[(0.0, 0.0), (9.0, 0.84)])
        s, ds, dds = across(law, [-1.0, 4.5, 9.0, 17.0])
        assert s == pytest.approx([0.0, 0.945, 3.78, 10.5], abs=1e-14)
        assert ds == pytest.approx([0.0, 0.42, 0.84, 0.84], abs=1e-15)
        assert dds == pytest.approx([0.0, 0.84 / 9, 0.0, 0.0], abs=1e-15)

    def test_speed_is_kept_before_the_first_point_and_after_the_last(self):
        law = SpeedPoints(start=2.0, points=[(1.0, 0.5), (2.0, -0.25)])
        s, ds, _ = across(law, [0.0, 1.0, 2.0, 4.0])
        assert s == pytest.approx([1.5, 2.0, 2.125, 1.625], abs=1e-15)
        assert ds == pytest.approx([0.5, 0.5, -0.25, -0.25], abs=1e-15)


class TestSpline:
    def test_it_reproduces_a_cubic(self):
        cubic = np.polynomial.Polynomial([0.3, -0.7, 0.4, 0.25])
        t = [0.0, 0.4, 1.0, 1.3, 2.2]
        ends = (float(cubic.deriv()(t[0])), float(cubic.deriv()(t[-1])))
        law = Spline(points=[(x, float(cubic(x))) for x in t], speeds=ends)
        x = np.linspace(0.0, 2.2, 45)
        found = law.pieces()[1].function(x)
        for values, derivative in zip(found, (cubic, cubic.deriv(), cubic.deriv(2)), strict=True):
            assert values == pytest.approx(derivative(x), abs=1e-13)

    def test_its_second_derivative_is_continuous_inside(self):
        law = LAWS["spline"]
        for t, _ in law.points[1:-1]:
            before, after = (law.pieces()[1].function(np.array([t + h])) for h in (-1e-9, 1e-9))
            assert before[2] == pytest.approx(after[2], abs=1e-6)  # the third derivative is below 100

    def test_it_meets_its_points_with_the_given_end_speeds(self):
        law = LAWS["spline"]
        s, ds, dds = across(law, [t for t, _ in law.points] + [3.2])
        assert s == pytest.approx([*(value for _, value in law.points), 1.5 - 0.6], abs=1e-15)
        assert (ds[0], ds[3], ds[4]) == pytest.approx((0.4, -0.6, -0.6), abs=1e-14)
        assert dds[4] == 0.0
        assert across(law, [-0.7])[0] == pytest.approx(0.2 - 0.4, abs=1e-15)


@pytest.mark.parametrize("member", [Spline, SpeedPoints])
@pytest.mark.parametrize("times", [(0.0, 0.0), (1.0, 0.0), (0.0, 2.0, 1.0), (0.0, 1.0, 1.0)])
def test_points_that_do_not_ascend_are_refused(member, times):
    with pytest.raises(InputError, match=rf"do not ascend.*\(point {len(times)}\)"):
        member(points=[(t, 0.0) for t in times])


class TestTable:
    def test_it_is_the_spline_through_its_rows_in_si(self, tmp_path):
        law = table(tmp_path, "t [ms],theta [deg],note\n0,0,x\n500,90,y\n\n2000,180,z\n", speeds=(0.1, 0.2))
        points = [(0.0, 0.0), (0.5, math.pi / 2), (2.0, math.pi)]
        t = np.linspace(-1.0, 3.0, 41)
        assert across(law, t) == pytest.approx(across(Spline(points=points, speeds=(0.1, 0.2)), t), abs=1e-14)
        law.check_units(unit("rad"))
        with pytest.raises(UnitError, match=r"column 2 of the table table\.csv is in deg/s"):
            table(tmp_path, "t [s],w [deg/s]\n0,0\n1,1\n").check_units(unit("m"))
        with pytest.raises(UnitError, match=r"column 1 of the table table\.csv is in deg"):
            table(tmp_path, "crank [deg],x [m]\n0,0\n1,1\n").check_units(unit("m"))

    @pytest.mark.parametrize("text", ["\ufefft [s],x [m]\r\n0,0\r\n1,1\r\n", '"t [s]","x [m]",\n 0 , 0,\n"1",+1e0,\n'])
    def test_what_spreadsheets_write_is_read(self, tmp_path, text):
        assert cached_table(table(tmp_path, text).file)[1] == (0.0, 1.0)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("t [s],x [m]\n0,0\n2,1\n1,2\n", r"table\.csv:4:1: the first column does not increase"),
            ("t [s],x [m]\n0,0\n0,1\n", r"table\.csv:3:1: the first column does not increase"),
            ("t [s],x [m]\n0,0\nnan,1\n", r"table\.csv:3:1: a finite number is missing"),
            ("t [s],x [m]\n0,0\n1,nan\n", r"table\.csv:3:1: a finite number is missing"),
            ("t [s],x [m]\n0,0\n1,-inf\n", r"table\.csv:3:1: a finite number is missing"),
            ("t [s],x [m]\n0,0\n1,1e999\n", r"table\.csv:3:1: a finite number is missing"),
            ("t [s],x [m]\n0,zero\n1,1\n", r"table\.csv:2:1: a finite number is missing"),
            ("t [s],x [m]\n0,0\n1,\n", r"table\.csv:3:1: a finite number is missing"),
            ("t [s],x [m]\n0,0\n1\n", r"table\.csv:3:1: a finite number is missing"),
            ("t [s],x [m]\n0,0\n0,5,0,1\n", r"table\.csv:3:1: the row has 4 cells, the heading 2"),
            ("t [s];x [m]\n0;0\n1;1\n", "separated by commas"),
            ("t [s],x [m]\n0;0\n1;1\n", r"table\.csv:2:1: a finite number is missing"),
            ("t,x [m]\n0,0\n1,1\n", r"table\.csv:1:1: the heading 't' has no unit"),
            ("t [s],x\n0,0\n1,1\n", r"table\.csv:1:1: the heading 'x' has no unit"),
            ("0,0\n1,1\n2,2\n", r"table\.csv:1:1: the heading '0' has no unit"),
            ("t [s],x [cubits]\n0,0\n1,1\n", "unknown unit 'cubits'"),
            ("t [s],x [m]\n0,0\n", "too short"),
            ("t [s],x [m]\n0,0\n\n", "too short"),
            ("t [s]\n0\n1\n", "too short"),
            ("", "too short"),
        ],
    )  # fmt: skip
    def test_bad_tables_are_refused_with_their_line(self, tmp_path, text, message):
        with pytest.raises(InputError, match=message):
            table(tmp_path, text)

    def test_the_line_of_the_table_is_told_to_who_names_it_in_a_file(self, tmp_path):
        (tmp_path / "table.csv").write_text("t [s],x [m]\n0,0\n1,one\n")
        scenario = Document.parse("law: table\nfile: table.csv\n", source="s.yaml", path=tmp_path / "s.yaml")
        with pytest.raises(InputError, match=r"table\.csv:3"):
            scenario.validate(Table)

    def test_what_is_no_text_is_refused(self, tmp_path):
        (tmp_path / "table.csv").write_bytes(b"t [s],x [m]\n0,\xff\xfe\n1,1\n")
        with pytest.raises(InputError, match="not CSV text"):
            table(tmp_path)

    def test_a_missing_file_is_refused_with_the_one_that_was_meant(self, tmp_path):
        (tmp_path / "tabel.csv").touch()
        with pytest.raises(InputError, match=r"table\.csv' does not exist[\s\S]*try: .*tabel\.csv"):
            table(tmp_path)

    @pytest.mark.parametrize("marker", [True, False])
    def test_a_file_outside_the_root_is_refused(self, tmp_path, marker):
        folder = tmp_path / "root"
        folder.mkdir()
        if marker:
            (folder / ".pinarm-root").touch()
        (tmp_path / "table.csv").write_text("t [s],x [m]\n0,0\n1,1\n")
        (folder / "link.csv").symlink_to(tmp_path / "table.csv")
        for file in ("../table.csv", "link.csv", str(tmp_path / "table.csv")):
            with pytest.raises(InputError, match="leads out of the root folder"):
                table(folder, file=file)

    def test_a_file_that_never_ends_is_refused(self, tmp_path):
        with open(tmp_path / "table.csv", "wb") as stream:
            stream.truncate(200_000_000)  # takes no room on the disk
        with pytest.raises(InputError, match="too large"):
            table(tmp_path)


class TestSuccession:
    def test_position_and_speed_by_hand(self):
        law = LAWS["succession"]
        # 0.5 m by the triangle, rest, then 1.5 m/s^2 for 0.8 s and 1.2 m/s from there on
        s, ds, dds = across(law, [0.0, 1.3, 1.6, 1.9, 2.3, 2.7, 3.3, 5.3])
        assert s == pytest.approx([0.4, 0.9, 0.9, 0.9, 1.02, 1.38, 2.1, 4.5], abs=1e-14)
        assert ds == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.6, 1.2, 1.2, 1.2], abs=1e-14)
        assert dds == pytest.approx([0.0, 0.0, 0.0, 1.5, 1.5, 0.0, 0.0, 0.0], abs=1e-14)

    def test_it_is_continuous_where_laws_meet(self):
        law = LAWS["succession"]
        for before, after in pairwise(law.pieces()):
            left, right = (np.array(piece.function(np.array([after.start])))[:2, 0] for piece in (before, after))
            assert left == pytest.approx(right, abs=1e-14)

    def test_a_law_cut_short_goes_on_with_the_speed_that_it_had(self):
        law = Succession(segments=segments((0.5, Cycloidal(start=0.0, end=1.0, duration=1.0))))
        s, ds, dds = across(law, [0.5, 1.5])
        assert s == pytest.approx([0.5, 2.5], abs=1e-15)
        assert ds == pytest.approx([2.0, 2.0], abs=1e-14)
        assert dds == pytest.approx([0.0, 0.0], abs=1e-14)

    def test_it_begins_where_its_first_law_does_and_goes_on_from_there(self):
        rise = Cycloidal(start=2.0, end=3.0, duration=1.0)
        law = Succession(segments=segments((1.0, rise), (1.0, Cycloidal(start=3.0, end=1.5, duration=1.0))))
        assert across(law, [-1.0, 0.0, 1.0, 2.0, 5.0])[0] == pytest.approx([2.0, 2.0, 3.0, 1.5, 1.5], abs=1e-14)

    @pytest.mark.parametrize(
        ("start", "parts", "message"),
        [
            (None, [(1.0, Constant(value=4.0)), (1.0, Constant(value=-7.0))], "begins at -7, .* end at 4"),
            (None, [(1.0, Constant(value=4.0)), (1.0, Constant(value=0.0))], "begins at 0, .* end at 4"),
            (1.0, [(1.0, Cycloidal(start=2.0, end=3.0, duration=1.0))], "begins at 2, .* end at 1"),
            (None, [(1.0, Cycloidal(start=0.0, end=1.0, duration=1.0)),
                    (1.0, Cycloidal(start=3.0, end=1.0, duration=1.0))], "begins at 3, .* end at 1"),
        ],
    )  # fmt: skip
    def test_a_value_that_would_not_be_had_is_refused(self, start, parts, message):
        with pytest.raises(InputError, match=message):
            Succession(start=start, segments=segments(*parts))

    @pytest.mark.parametrize(
        ("parts", "message"),
        [
            ([(1.0, ConstantSpeed(speed=0.5))], "from 0 to 0.5 where segment 1 begins"),
            ([(1.0, Constant(value=0.0)), (1.0, ConstantSpeed(speed=-0.5))], "from 0 to -0.5 where segment 2 begins"),
            ([(1.0, ConstantAcceleration(acceleration=1.0)), (1.0, Constant(value=0.0))],
             "from 1 to 0 where segment 2 begins"),
            ([(0.3, Cycloidal(start=0.0, end=1.0, duration=1.0)), (1.0, Constant(value=0.0))],
             "to 0 where segment 2 begins"),
        ],
    )  # fmt: skip
    def test_a_speed_that_jumps_is_refused(self, parts, message):
        with pytest.raises(InputError, match=message):
            Succession(segments=segments(*parts)).pieces()


class TestGrid:
    law = Trapezoid(start=0.0, end=1.0, acceleration=1.0, begin=0.5)

    def test_instants_of_jumps_stand_twice(self):
        grid = Grid.cover(np.linspace(0.0, 3.0, 7), [self.law])
        assert grid.t.tolist() == [0.0, 0.5, 0.5, 1.0, 1.5, 1.5, 2.0, 2.5, 2.5, 3.0]
        assert grid.cuts == (0.0, 0.5, 1.5, 2.5, 3.0)
        assert grid.rows == (0, 2, 5, 8, 10)

    def test_jumps_between_the_instants_are_added(self):
        grid = Grid.cover(np.array([0.0, 1.0, 3.0]), [self.law])
        assert grid.t.tolist() == [0.0, 0.5, 0.5, 1.0, 1.5, 1.5, 2.5, 2.5, 3.0]

    def test_jumps_outside_and_at_the_ends_are_not(self):
        grid = Grid.cover(np.linspace(0.5, 1.5, 5), [self.law])
        assert grid.t.tolist() == [0.5, 0.75, 1.0, 1.25, 1.5]
        assert grid.evaluate(self.law)[2].tolist() == [1.0] * 5

    def test_each_side_of_a_jump_has_its_own_value(self):
        grid = Grid.cover(np.linspace(0.0, 3.0, 7), [self.law])
        s, ds, dds = grid.evaluate(self.law)
        assert dds.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 0.0, 0.0]
        assert s == pytest.approx([0.0, 0.0, 0.0, 0.125, 0.5, 0.5, 0.875, 1.0, 1.0, 1.0], abs=1e-15)
        assert ds == pytest.approx([0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0], abs=1e-15)

    def test_a_law_without_jumps_is_evaluated_across_its_pieces(self):
        quintic = Polynomial(start=0.0, end=1.0, duration=1.0, begin=1.0)
        grid = Grid.cover(np.linspace(0.0, 3.0, 7), [quintic])
        s, ds, dds = grid.evaluate(quintic)
        assert (grid.cuts, len(grid.t)) == ((0.0, 1.0, 2.0, 3.0), 7)
        assert s.tolist() == [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0]
        assert ds == pytest.approx([0.0, 0.0, 0.0, 1.875, 0.0, 0.0, 0.0], abs=1e-14)
        assert dds == pytest.approx(0.0, abs=1e-13)

    @every_law
    def test_every_row_of_every_law_is_a_value_of_one_of_its_pieces(self, law):
        grid = Grid.cover(np.linspace(-0.5, 4.0, 46), LAWS.values())
        s, ds, dds = grid.evaluate(law)
        for k in range(len(grid.cuts) - 1):
            rows = slice(grid.rows[k], grid.rows[k + 1])
            middle = 0.5 * (grid.cuts[k] + grid.cuts[k + 1])
            piece = next(piece for piece in law.pieces() if piece.start <= middle <= piece.end)
            inner = (grid.t[rows] >= piece.start) & (grid.t[rows] <= piece.end)
            expected = piece.function(grid.t[rows][inner])
            for found, wanted in zip((s, ds, dds), expected, strict=True):
                # neighbouring pieces without a jump between them agree to rounding where they meet
                assert found[rows][inner] == pytest.approx(wanted, abs=1e-13)

    def test_jumps_of_several_laws_are_merged(self):
        other = Trapezoid(start=0.0, end=1.0, acceleration=4.0, begin=0.5)
        grid = Grid.cover(np.array([0.0, 3.0]), [self.law, other])
        assert grid.cuts == (0.0, 0.5, 1.0, 1.5, 2.5, 3.0)

    def test_a_falling_parameter_keeps_its_values(self):
        assert Grid.cover(np.linspace(1.0, -1.0, 5), []).t.tolist() == [1.0, 0.5, 0.0, -0.5, -1.0]
