"""Where a quantity is asked: instants, crossings, sides of a jump, extremes; all solved, none interpolated.

The trapezoid from 0 to 1 rad at 1 rad/s^2 turns round at t = 1 s and ends at 2 s; M = 2.5 a + 20 sin(alpha), as the
inertia about the pivot is 0.5 + 2 kg m^2. On the sweep from 0 to 180 deg in 8 samples no sample is at 90 deg.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.result.row_lookup import MOST_INTERVALS
from pinarm.use.study.restore import restore

SCENARIOS = Path(pinarm.__file__).parents[1] / "scenarios"

ROUNDING = 1e-13
"""Relative: a few operations on numbers of double precision."""


@pytest.fixture
def ask(scenario: Callable[..., Any]) -> Callable[..., float]:
    def asked(kind: str, where: Any, name: str) -> float:
        [value] = scenario(kind).run().lookup.at(where, name)[name].values
        return float(value)

    return asked


@pytest.mark.parametrize(
    ("kind", "where", "name", "value"),
    [
        ("inverse", {"t": "300 ms"}, "alpha", 0.045), ("inverse", {"t": 0}, "alpha", 0.0),
        ("inverse", "end", "alpha", 1.0), ("statics", {"M": "10 N*m", "occurrence": 1}, "alpha", math.pi / 6),
        ("inverse", {"t": "1 s", "side": "left"}, "M", 2.5 + 20 * math.sin(0.5)),
        ("inverse", {"t": "1 s", "side": "right"}, "M", -2.5 + 20 * math.sin(0.5)),
        ("inverse", "start", "drive.motor.torque", 2.5 / 80),
        ("inverse", "max", "drive.motor.torque", (-2.5 + 20 * math.sin(1.0)) / 80),
        ("inverse", {"alpha": "0.125 rad"}, "t", 0.5),
        ("inverse", {"joint.pivot.velocity": "0.5 rad/s", "occurrence": 2}, "t", 1.5),
        ("statics", {"pivot": "10 deg"}, "M", 20 * math.sin(math.radians(10))),
        ("statics", {"M": "10 N*m", "occurrence": 2}, "alpha", 5 * math.pi / 6),
        ("statics", "largest", "M", 20.0), ("statics", "min", "-M", -20.0),
    ],
)  # fmt: skip
def test_places(ask: Callable[..., float], kind: str, where: Any, name: str, value: float) -> None:
    assert ask(kind, where, name) == pytest.approx(value, rel=ROUNDING, abs=1e-14)


@pytest.mark.parametrize("below", [1e-2, 1e-10, 1e-14])
@pytest.mark.parametrize("name", ["alpha", "cos(alpha)"])
def test_where_a_curve_is_level_the_place_of_its_value_is_told_with_its_error(
    scenario: Callable[..., Any], name: str, below: float
) -> None:
    """``M = 20 sin(alpha)`` is 20 (1 - d) at ``pi/2 - 2 asin(sqrt(d/2))``: next to the top rounding moves that much."""
    value, error = scenario("statics").run().number(f"{name} @ M={20.0 * (1.0 - below)!r} N*m, occurrence=1")
    half = math.asin(math.sqrt(0.5 * below))
    true = math.pi / 2 - 2.0 * half if name == "alpha" else math.sin(2.0 * half)
    assert abs(value - true) <= error <= 1e-11 / math.sqrt(max(below, 1e-12))


def test_the_error_of_an_instant_that_is_given_is_none(scenario: Callable[..., Any]) -> None:
    assert scenario("inverse").run().number("alpha @ t=0.3 s") == (pytest.approx(0.045, rel=ROUNDING), 0.0)


KEY = """\
expect:
  - {quantity: M, at: {t: 2.5 s}, value: 0.0 N*m, published: 20 N*m, source: s}
  - {quantity: M, at: {t: 2 s}, value: 0 N*m, rtol: 1, atol: 100 N*m, source: s}
  - {quantity: M, at: {alpha: 1.5 rad}, value: 0.0 N*m, source: s}
"""


def test_an_entry_that_is_not_reached_stops_nothing(scenario: Callable[..., Any], folder: Path) -> None:
    given = scenario("inverse", KEY)
    result = given.run()
    notes = ["t = 2.5 s is not reached in this run; entry 1 of expect asks for it",
             "alpha = 1.5 rad is not reached in this run; entry 3 of expect asks for it"]  # fmt: skip
    assert [note for note in result.notes() if "expect" in note] == notes
    saved = result.save(folder / "out")
    assert list((saved / "plots").glob("*.svg"))
    assert [note for note in restore(saved).notes() if "expect" in note] == notes
    assert [(found.verdict, found.reason[-11:]) for found in pinarm.check(given, result=result)] == [
        ("MISS", "in this run"), ("agrees", ""), ("MISS", "in this run"),
    ]  # fmt: skip


@pytest.mark.parametrize(("which", "sign"), [("max", 1), ("min", -1), ("largest", 1), ("largest", -1)])
def test_an_extreme_is_found_between_the_samples(ask: Callable[..., float], which: str, sign: int) -> None:
    """sin(a) + 0.2 a has its maximum at cos(a) = -0.2: its value is exact, its place known to half of the digits."""
    place = math.acos(-0.2)
    top = math.sin(place) + 0.2 * place
    formula = f"{sign}*(sin(alpha) + 0.2*alpha)"
    assert ask("statics", which, formula) == pytest.approx(sign * top, rel=ROUNDING)


def test_the_row_of_an_extreme_answers_other_questions_too(scenario: Callable[..., Any]) -> None:
    row = scenario("statics").run().lookup.at("max", "M")
    assert row["alpha"].values == pytest.approx([math.pi / 2], abs=1e-7)  # a flat top: sqrt(eps) in its place


def test_an_extreme_at_the_end_of_the_run(ask: Callable[..., float]) -> None:
    assert ask("statics", "max", "alpha") == pytest.approx(math.pi, rel=1e-15)
    assert ask("statics", "min", "alpha") == 0.0


def test_an_extreme_beside_a_jump_is_that_of_its_side(ask: Callable[..., float]) -> None:
    """M grows to 2.5 + 20 sin(1/2) just before t = 1 s; its maximum is at the end, where it is 20 sin(1) - 2.5."""
    assert ask("inverse", "max", "M") == pytest.approx(20 * math.sin(1.0) - 2.5, rel=ROUNDING)
    jump = ask("inverse", "max", "joint.pivot.acceleration")
    assert jump == 1.0
    assert ask("inverse", "min", "joint.pivot.acceleration") == -1.0


def test_forward_motion_is_asked_of_the_dense_output(ask: Callable[..., float]) -> None:
    """The pendulum released at 30 deg swings as far to the other side; energy 1e-9 a step gives 1e-8 in the angle."""
    assert ask("forward", "min", "alpha") == pytest.approx(-math.pi / 6, abs=1e-8)
    first, _, third = (ask("forward", {"alpha": "0 rad", "occurrence": n}, "t") for n in (1, 2, 3))
    period = third - first
    k = math.sin(math.pi / 12)
    a, b = 1.0, math.sqrt(1 - k * k)
    while a - b > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    assert period == pytest.approx(2 * math.pi * math.sqrt(2.5 / 20) / a, rel=1e-8)  # the mean of Gauss; see above


@pytest.mark.parametrize(
    ("kind", "where", "name", "says"),
    [
        ("inverse", {"t": "3 s"}, "M", "t = 3 s is not reached"), ("statics", {"M": "21 N*m"}, "alpha", "not reached"),
        ("statics", {"M": "10 N*m"}, "alpha", "reached 2 times"),
        ("statics", {"M": "10 N*m", "occurrence": 3}, "alpha", "2 times only"),
        ("inverse", {"t": "1 s"}, "M", "M jumps at t = 1 s"),
        ("inverse", {"t": "1 s", "side": "centre"}, "M", "no side 'centre'"),
        ("inverse", {"t": "1 s", "alpha": "0 rad"}, "M", "one coordinate"), ("inverse", {"t": math.nan}, "M", ""),
        ("inverse", {}, "M", "one coordinate"), ("inverse", {"t": "1 m"}, "M", "not a unit"),
        ("inverse", {"t": 1.0}, "M", "no unit"), ("inverse", {"alpa": "1 rad"}, "M", "no quantity 'alpa'"),
        ("statics", {"M": "10 N*m", "occurrence": 0}, "alpha", ""),
        ("statics", {"M": "10 N*m", "occurrence": "first"}, "alpha", ""),
        ("statics", "max", "M*sqrt(-1 - alpha)", ""),
    ],
)  # fmt: skip
def test_places_that_do_not_exist(ask: Callable[..., float], kind: str, where: Any, name: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        ask(kind, where, name)
    assert says in str(caught.value)


@pytest.mark.parametrize("samples", [3, 5, 41])
def test_extremes_and_crossings_between_few_rows_are_found(scenario: Callable[..., Any], samples: int) -> None:
    """At 3 samples all rows are at passages through 0 of ``alpha = sin(2 pi t)``, which is 0.9 at 0.178 and 0.322 s."""
    law = {"law": "harmonic", "amplitude": "1 rad", "pulsation": "1 rev/s"}
    changes = {"problem.motion": {"pivot": law}, "problem.time": {"end": "1 s", "samples": samples}}
    lookup = scenario("inverse").varied(changes).run().lookup
    assert lookup.at("max", "alpha")["alpha"].values == pytest.approx([1.0], rel=1e-14)
    assert lookup.at("min", "alpha")["alpha"].values == pytest.approx([-1.0], rel=1e-14)
    first = math.asin(0.9) / (2.0 * math.pi)
    for number, t in enumerate((first, 0.5 - first), 1):
        found = lookup.at({"alpha": "0.9 rad", "occurrence": number}, "t")
        assert found["t"].values == pytest.approx([t], rel=1e-13)
    with pytest.raises(InputError, match="2 times only"):
        lookup.at({"alpha": "0.9 rad", "occurrence": 3}, "t")


STEADY = {"problem.motion": {"pivot": {"law": "constant_speed", "speed": "1 rad/s"}}}


@pytest.fixture(scope="module")
def change_point():
    """A four-bar that passes its aligned position at every turn: beside it rounding decides about accelerations."""
    return pinarm.run(SCENARIOS / "change_point_four_bar_free.yaml")


@pytest.mark.parametrize("name", ["joint.theta4.acceleration", "joint.theta2.force.x"])
def test_an_extreme_is_no_less_than_a_row_or_is_refused(change_point, name):
    """The search found peaks of rounding, where the state alone had another value: -17 rad/s^2 beside rows of 305."""
    try:
        value, error = change_point.number(f"{name} @ max")
    except InputError as refused:
        assert "rounding decides what it is at t" in str(refused) or "infinity at t" in str(refused)
    else:
        assert value + error >= change_point[name].max()


def test_extremes_beside_a_singular_position_that_rounding_leaves_are_told(change_point):
    """The velocity of the crank, whose square follows from the energy, is largest where the rows say."""
    value, _ = change_point.number("omega2 @ max")
    assert 0.0 <= value / change_point["omega2"].max() - 1.0 < 0.01


@pytest.mark.parametrize("samples", [7, 500])
@pytest.mark.parametrize(
    ("name", "which"), [("tan(alpha)", "max"), ("tan(alpha)", "min"), ("1/sqrt(abs(cos(alpha)))", "largest")]
)
def test_a_quantity_that_passes_through_infinity_has_no_extreme(
    scenario: Callable[..., Any], samples: int, name: str, which: str
) -> None:
    """It had one of 1e6 to 1e15, by where the rows are."""
    lookup = scenario("inverse").varied({**STEADY, "problem.time": {"end": "3 s", "samples": samples}}).run().lookup
    with pytest.raises(InputError, match=r"it passes through infinity at t = 1\.57079633 s"):
        lookup.at(which, name)
    assert lookup.at("min", "1/cos(alpha)**2")["t"].values == pytest.approx([0.0], abs=1e-7)


@pytest.mark.parametrize("samples", [3, 300])
def test_a_spike_between_rows_is_found_at_any_number_of_them(scenario: Callable[..., Any], samples: int) -> None:
    """It is as wide as two rows of 1500, and at 300 between two of them."""
    lookup = scenario("inverse").varied({**STEADY, "problem.time": {"end": "3 s", "samples": samples}}).run().lookup
    found = lookup.at("max", "sin(alpha) + 5/(1 + ((alpha - 0.5123)/0.004)**2)")
    assert found["t"].values == pytest.approx([0.5123], abs=1e-5)
    assert lookup.extreme("max", "1e3/(1 + ((alpha - 0.5123)/0.004)**2)")[1] > 0.9e-9  # of the peak, not of the rows


class TestPlacesOfExtremes:
    """``x = sin(w t)`` has the top ``t = pi / (2 w)``; rows that are 1e-12 below it count as the top."""

    @staticmethod
    def run(law: str, end: str) -> pinarm.Result:
        planar = {
            "points": {"O": [0, 0], "P": ["1 m", 0]}, "ground": ["O"],
            "links": {"c": {"points": ["P"], "mass": "2 kg"}}, "sliders": {"x": {"link": "c", "along": ["O", "P"]}},
        }  # fmt: skip
        motion = {"x": dict(pair.split(": ") for pair in law.split(", "))}
        return pinarm.run({
            "pinarm": 1, "mechanism": {"pinarm": 1, "planar": planar, "gravity": "none"}, "outputs": ["x"],
            "problem": {"kind": "inverse", "time": {"end": end, "samples": 3}, "motion": motion},
        })  # fmt: skip

    @pytest.mark.parametrize("off", [0.0, -3e-7, 1e-4])
    def test_are_known_to_what_is_told(self, off: float) -> None:
        """A row in the middle is so far from the top; 1e-12 of it are 7e-7 in the angle."""
        top = 0.5 * np.pi / 3.0
        result = self.run("law: harmonic, amplitude: 1 m, pulsation: 3 rad/s", f"{2.0 * (top + off)!r} s")
        for asked, true, most in (("t @ max(x)", top, 2e-6), ("joint.x.velocity @ max(x)", 0.0, 2e-5)):
            value, error = result.number(asked)
            assert abs(value - true) <= error + 1e-14 and error < most

    def test_are_nowhere_of_what_is_constant(self) -> None:
        value, error = self.run("law: constant, value: 0.3 m", "2 s").number("t @ max(x)")
        assert (value, error) == (0.0, pytest.approx(2.0))

    def test_are_exact_at_ends_to_which_a_motion_rises(self) -> None:
        value, error = self.run("law: constant_speed, speed: 2 m/s", "2 s").number("t @ max(x)")
        assert value == 2.0 and error < 1e-8

    @pytest.mark.parametrize("below", [1e-3, 1e-10])
    def test_and_values_next_to_them_are_known_to_what_the_quantity_that_is_located_is(self, below: float) -> None:
        """``x = 1 - below`` where the velocity is ``3 cos``: 1e-12 in x are as much in t, and more near the top."""
        result = self.run("law: harmonic, amplitude: 1 m, pulsation: 3 rad/s", f"{np.pi / 3.0!r} s")
        place = f"x={1.0 - below!r} m, occurrence=1"
        x = 1.0 - below
        angle, change = np.arcsin(x), 1e-12 / (3.0 * np.sqrt((1.0 - x) * (1.0 + x)))
        for asked, true in (("t", angle / 3.0), ("joint.x.velocity", 3.0 * np.cos(angle))):
            value, error = result.number(f"{asked} @ {place}")
            assert abs(value - true) <= error + 1e-14
        assert change < result.number(f"t @ {place}")[1] < 4.0 * change

    def test_and_values_at_rest_are_known_to_the_length_of_it(self) -> None:
        value, error = self.run("law: constant, value: 0.3 m", "2 s").number("t @ x=0.3 m, occurrence=1")
        assert (value, error) == (0.0, pytest.approx(2.0))


@pytest.mark.parametrize("samples", [5, 6])
def test_both_sides_of_a_reversal_count(samples: int) -> None:
    """``mu m g sign v - m a`` is largest just before the block turns back, whether that is a row, as of 5, or not."""
    planar = {
        "points": {"O": [0, 0], "X": ["1 m", 0], "P": [0, 0]}, "ground": ["O", "X"],
        "links": {"block": {"points": ["P"], "mass": "2 kg"}}, "sliders": {"x": {"link": "block", "along": ["O", "X"]}},
    }  # fmt: skip
    law = {"law": "harmonic", "amplitude": "0.05 m", "pulsation": "5 rad/s"}
    end = f"{0.4 * math.pi!r} s"
    result = pinarm.run({
        "pinarm": 1, "outputs": ["joint.x.effort"],
        "mechanism": {"pinarm": 1, "title": "slide", "planar": planar, "friction": {"x": {"mu": 0.2}}},
        "problem": {"kind": "inverse", "motion": {"x": law}, "time": {"end": end, "samples": samples}},
    })  # fmt: skip
    number, error = result.number("joint.x.effort - (4 kg)*joint.x.acceleration @ max")
    assert number == pytest.approx(2.0 * 0.05 * 25.0 + 0.2 * 2.0 * 9.81, rel=1e-11)
    assert error < 1e-11


def test_tops_of_many_bounces_between_two_rows_are_found() -> None:
    """A ball that leaves the ground at 1 m/s rises by ``v^2/(2 g)``; after bounce n its speed is 0.99^n m/s."""
    planar = {
        "points": {"O": [0, 0], "P": [0, "1 m"]}, "ground": ["O"],
        "links": {"ball": {"points": ["P"], "mass": "1 kg"}}, "sliders": {"z": {"link": "ball", "along": ["O", "P"]}},
    }  # fmt: skip
    ball = pinarm.run({
        "pinarm": 1, "mechanism": {"pinarm": 1, "title": "ball", "planar": planar}, "outputs": ["z"],
        "problem": {"kind": "forward", "time": {"end": "14 s", "samples": 2},
                    "initial": {"velocity": {"z": "1 m/s"}}, "end_stops": {"z": {"lower": "0 m", "restitution": 0.99}}},
    })  # fmt: skip
    assert len(ball.lookup.intervals) > MOST_INTERVALS
    assert ball.number("z @ max")[0] == pytest.approx(1.0 / (2.0 * 9.81), rel=1e-12)
    number, _ = ball.number("joint.z.velocity @ z=40 mm, occurrence=3")  # on the way up after the first bounce
    assert number == pytest.approx(math.sqrt(0.99**2 - 2.0 * 9.81 * 0.04), rel=1e-9)


def test_numbers_of_efforts_that_are_held_between_samples_are_those_of_all_samples():
    """Three rows tell the sums over samples, and what is greatest just before an effort jumps: a coarse encoder."""
    control = {"period": "1 ms", "resolution": "3e-5 rad", "limits": "null",
               "follows": "{law: constant_speed, speed: 0.01 rad/s}"}  # fmt: skip
    changes = [f"problem.control.0.{key}={value}" for key, value in control.items()]
    few, every = (
        pinarm.load(SCENARIOS / "servo_step.yaml", [*changes, f"problem.time={{end: 1 s, samples: {n}}}"]).run()
        for n in (3, 1001)
    )
    effort, velocity = every["control.x.effort"].values, every["joint.x.velocity"].values
    assert few.number("control.x.effort @ rms")[0] == pytest.approx(np.sqrt((effort[:-1] ** 2).mean()), rel=1e-12)
    assert few.number("control.x.effort @ mean")[0] == pytest.approx(effort[:-1].mean(), rel=1e-11)
    power = few.number("control.x.effort * joint.x.velocity @ max")[0]
    assert power == pytest.approx((effort[:-1] * velocity[1:]).max(), rel=1e-9)
    assert few.number("control.x.effort @ max")[0] == pytest.approx(effort.max(), rel=1e-12)


@pytest.fixture(scope="module")
def spinning() -> pinarm.Result:
    """A brick that turns about its vertical axis at 100 deg/s from 90 deg on: through 180 deg at 0.9 s, 0 at 2.7 s."""
    events = {name: {"when": "root.yaw", "reaches": f"{value} deg", "direction": direction}
              for name, value, direction in (("zero", 0, "any"), ("back", 90, "falling"), ("half", 180, "rising"),
                                             ("late", 179.9, "any"))}  # fmt: skip
    return pinarm.run({
        "pinarm": 1, "mechanism": str(SCENARIOS.parent / "models/brick/mechanism.yaml"), "outputs": ["joint.root.yaw"],
        "gravity": "none",
        "problem": {"kind": "forward", "time": {"end": "3 s", "samples": 31}, "events": events,
                    "initial": {"position": {"root.yaw": "90 deg"},
                                "velocity": {"root.angular_velocity.z": "100 deg/s"}}},
    })  # fmt: skip


@pytest.mark.parametrize(("degrees", "instants"), [(0, [2.7]), (90, [0.0]), (-179.9, [0.901]), (200, [])])
def test_an_angle_that_goes_around_is_where_it_is_only(
    spinning: pinarm.Result, degrees: float, instants: list[float]
) -> None:
    """From 180 to -180 deg it passes no value between."""
    found = [spinning.number(f"t @ joint.root.yaw={degrees} deg, occurrence={k + 1}")[0] for k in range(len(instants))]
    assert found == pytest.approx(instants, abs=1e-7)  # as the motion is integrated
    with pytest.raises(InputError, match="reached"):
        spinning.number(f"t @ joint.root.yaw={degrees} deg, occurrence={len(instants) + 1}")


def test_events_of_an_angle_that_goes_around_are_where_it_is_only(spinning: pinarm.Result) -> None:
    found = {event.name: event.t for event in spinning.events}
    assert found == pytest.approx({"zero": 2.7, "half": 0.9, "late": 0.899}, abs=1e-7)


@pytest.mark.parametrize("rows", [2, 31])
def test_an_angle_of_several_turns_is_reached_once_however_few_rows(rows: int) -> None:
    """A drive at 900 deg/s is at 90 deg once, after 0.1 s, and at 450 deg later; it never turns back to -90 deg."""
    motion = {"x": {"law": "constant_speed", "speed": "900 deg/s"}}
    result = pinarm.run({
        "pinarm": 1, "mechanism": str(SCENARIOS.parent / "models/servo/mechanism.yaml"), "outputs": ["x"],
        "problem": {"kind": "inverse", "time": {"end": "1 s", "samples": rows}, "motion": motion},
    })  # fmt: skip
    assert result.number("t @ x=90 deg")[0] == pytest.approx(0.1, rel=1e-12)
    assert result.number("t @ x=450 deg")[0] == pytest.approx(0.5, rel=1e-12)
    with pytest.raises(InputError, match="not reached"):
        result.number("t @ x=-90 deg")


@pytest.mark.parametrize(("quantity", "place", "exact"), [
    ("cos(alpha - 8e-7)", "max", 1.0), ("1 - cos(alpha - 8e-7)", "min", 0.0), ("-cos(alpha - 8e-7)", "peak", 1.0),
])  # fmt: skip
def test_a_row_that_counts_as_the_extreme_is_told_with_what_it_is_below_it(
    scenario: Callable[..., Any], quantity: str, place: str, exact: float
) -> None:
    """The first row is 3.2e-13 from the extreme, which is 8e-7 s behind it: rows within 1e-12 are taken."""
    run = scenario("inverse").varied({**STEADY, "problem.time": {"end": "1 s", "samples": 11}}).run()
    value, error = run.number(f"{quantity} @ {place}")
    assert 1e-13 < abs(value - exact) <= error < 1e-11
