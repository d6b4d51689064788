import math
import typing
from pathlib import Path

import msgspec
import numpy as np
import pytest

from pinarm.errors import InputError, UnitError
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Measured, measured_fields, reading_from
from pinarm.mechanics.laws import (
    Constant,
    ConstantAcceleration,
    ConstantSpeed,
    Cycloidal,
    Harmonic,
    Law,
    PiecewiseLinear,
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
    PiecewiseLinear: {
        "lines": PiecewiseLinear(points=[(0.3, 0.2), (0.9, 1.0), (1.4, -0.7)]),
        "lines with jumps": PiecewiseLinear(points=[(0.3, 0.0), (0.3, 0.2), (0.9, 1.0), (0.9, 0.4), (1.4, -0.7)]),
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
    "succession": [0.3, 0.8, 1.3, 1.9, 2.7], "lines": [0.3, 1.4], "lines with jumps": [0.3, 0.9, 1.4],
}  # fmt: skip
ROUNDING = 5e-13
"""Coefficients of the polynomial of degree 7 reach 100, and its derivatives multiply them by 7 and 42."""
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def inside(piece):
    """Instants within a piece, its ends left out."""
    low, high = max(piece.start, -2.0), min(piece.end, 5.0)
    return low + (high - low) * np.array([0.03, 0.2, 0.5, 0.71, 0.97])


@pytest.mark.house
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
def test_pieces_meet_but_for_the_jumps_of_the_law(law):
    """Value and speed everywhere, the acceleration but at jumps; laws of loads jump in value and speed."""
    assert law.may_jump or not law.jumps(0)
    for before, after in zip(law.pieces(), law.pieces()[1:], strict=False):
        t = np.array([after.start])
        left, right = np.array(before.function(t)), np.array(after.function(t))
        if after.start not in law.jumps(0):
            alike = slice(1 if law.may_jump else 2)
            assert left[alike] == pytest.approx(right[alike], abs=ROUNDING)
        if after.start not in law.jumps():
            assert left[2] == pytest.approx(right[2], abs=ROUNDING)


def test_jumps_are_those_of_the_acceleration():
    for name, law in LAWS.items():
        assert set(law.jumps()) <= set(law.breakpoints()), name
        assert law.jumps() == pytest.approx(JUMPS.get(name, []), abs=1e-14), name


def test_laws_from_rest_to_rest_begin_and_end_there():
    for law in (law for law in LAWS.values() if hasattr(law, "end") and len(law.pieces()) > 1):
        first, *_, last = law.pieces()
        for outer, t, level in ((first, -30.0, law.start), (last, 30.0, law.end)):
            assert [x[0] for x in outer.function(np.array([t]))] == [level, 0.0, 0.0]
        for moving, t, level in ((law.pieces()[1], law.begin, law.start), (law.pieces()[-2], last.start, law.end)):
            s, ds, _ = moving.function(np.array([t]))
            assert s == pytest.approx(level, abs=ROUNDING)
            assert ds == pytest.approx(0.0, abs=ROUNDING)


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


def marked_fields():
    return [
        (law, name, kind.order)
        for member, samples in SAMPLES.items()
        for law in list(samples.values())[:1]
        for name, kind in measured_fields(member).items()
        if kind.order is not None
    ]


@pytest.mark.parametrize("base", ["m", "rad", "N*m"])
def test_fields_accept_the_unit_of_their_derivative_only(base):
    for law, name, order in marked_fields():
        units = [base, f"{base}/s", f"{base}/s^2", f"{base}/s^3"]
        laws = [msgspec.structs.replace(law, **{name: written(getattr(law, name), text)}) for text in units]
        laws.pop(order).check_units(unit(base))
        for wrong in laws:
            with pytest.raises(UnitError, match="not a unit of this quantity"):
                wrong.check_units(unit(base))


def test_every_law_says_which_derivative_its_fields_are():
    nested = {"points", "speeds", "segments", "file", "column", "times", "values", "measured", "interpolation"}
    plain = {"law", "begin", "duration", "degree", "pulsation", "frequency", "phase"} | nested
    assert {(type(law), name) for law, name, _ in marked_fields()} == {
        (member, name) for member in MEMBERS for name in member.__struct_fields__ if name not in plain
    }


def written(number, text):
    value = Measured(number)
    value.unit = unit(text)
    return value


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


def across(law, t):
    """Return s, s', s'' at instants that ascend, s'' just after each jump."""
    return np.array([law.on(x, x + 1e-12)(np.array([x])) for x in t])[:, :, 0].T


class TestGrid:
    law = Trapezoid(start=0.0, end=1.0, acceleration=1.0, begin=0.5)

    def test_each_side_of_a_jump_has_its_own_value(self):
        grid = Grid.cover(np.linspace(0.0, 3.0, 7), [self.law])
        s, ds, dds = grid.evaluate(self.law)
        assert dds.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 0.0, 0.0]
        assert s == pytest.approx([0.0, 0.0, 0.0, 0.125, 0.5, 0.5, 0.875, 1.0, 1.0, 1.0], abs=1e-15)
        assert ds == pytest.approx([0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0], abs=1e-15)


def test_an_oscillation_is_as_fast_as_its_frequency_says() -> None:
    """Two cycles a second: the same law as with a pulsation of 4 pi rad/s; over an angle there is no frequency."""
    law, same = Harmonic(amplitude=0.3, frequency="2 Hz"), Harmonic(amplitude=0.3, pulsation=4.0 * math.pi)
    t = np.linspace(0.0, 1.0, 9)
    assert np.allclose(law.on(0.0, 1.0)(t), same.on(0.0, 1.0)(t), atol=1e-14)
    for both in ({}, {"pulsation": 1.0, "frequency": 2.0}):
        with pytest.raises(InputError, match="either a pulsation or a frequency"):
            Harmonic(amplitude=0.3, **both)
    with pytest.raises(InputError, match="cycles over time"):
        law.check_units(unit("m"), unit("rad"))
    with pytest.raises(InputError, match="not a unit of this quantity"):
        Harmonic(amplitude=0.3, frequency="2 rad/s")
