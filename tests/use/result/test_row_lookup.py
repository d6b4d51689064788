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


def test_the_error_of_an_instant_that_is_given_is_none(scenario: Callable[..., Any]) -> None:
    assert scenario("inverse").run().number("alpha @ t=0.3 s") == (pytest.approx(0.045, rel=ROUNDING), 0.0)


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


@pytest.mark.parametrize(
    ("name", "which", "value"),
    [
        ("log(abs(cos(alpha)))", "max", 0.0), ("1/cos(alpha)**2", "min", 1.0), ("log(alpha)", "max", math.log(3.0)),
        ("alpha > 1 rad", "max", 1.0), ("alpha > 1 rad", "min", 0.0), ("alpha > 1 rad", "mean", 2 / 3),
    ],
)  # fmt: skip
def test_extremes_on_the_side_without_infinity_are_known_and_those_of_comparisons(
    scenario: Callable[..., Any], name: str, which: str, value: float
) -> None:
    run = scenario("inverse").varied({**STEADY, "problem.time": {"end": "3 s", "samples": 7}}).run()
    assert run.number(f"({name}) @ {which}") == (pytest.approx(value, abs=1e-11), pytest.approx(0.0, abs=1e-9))


@pytest.mark.parametrize("samples", [3, 300])
def test_a_spike_between_rows_is_found_at_any_number_of_them(scenario: Callable[..., Any], samples: int) -> None:
    """It is as wide as two rows of 1500, and at 300 between two of them."""
    lookup = scenario("inverse").varied({**STEADY, "problem.time": {"end": "3 s", "samples": samples}}).run().lookup
    found = lookup.at("max", "sin(alpha) + 5/(1 + ((alpha - 0.5123)/0.004)**2)")
    assert found["t"].values == pytest.approx([0.5123], abs=1e-5)
    assert (
        lookup.extreme("max", "1e3/(1 + ((alpha - 0.5123)/0.004)**2)")[0].error > 0.9e-9
    )  # of the peak, not of the rows


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


@pytest.mark.slow
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


def test_an_extreme_of_rounding_has_the_error_that_its_state_alone_shows():
    """The effort of a balanced arm is 0: what rounding leaves of it differs between one state and many together."""
    result = pinarm.run(SCENARIOS / "manipulator_counterweight.yaml")
    efforts = result["joint.alpha.effort"].values
    for which, sign in (("max", 1.0), ("min", -1.0)):
        value, error = result.number(f"joint.alpha.effort @ {which}")
        assert sign * value + error >= (sign * efforts).max()
        assert error < 1e-10
