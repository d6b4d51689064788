"""Figures of curves with closed forms: ``M = 20 sin(alpha)`` from 0 to 180 deg, and a speed that rises and falls.

On the trapezoid from 0 to 1 rad at 1 rad/s^2 the speed is t until 1 s and 2 - t until 2 s, the acceleration 1 and -1.
"""

from collections.abc import Callable
from math import pi, sin, sqrt
from typing import Any

import pytest

import pinarm
from pinarm.errors import InputError

ROUNDING = 1e-13
"""Relative: sums of a few hundred numbers of double precision."""

CLOSED_FORMS = [
    ("statics", "M", "mean", 40 / pi), ("statics", "M", "rms", 20 / sqrt(2)), ("statics", "M", "integral", 40.0),
    ("statics", "-M", "peak", 20.0), ("statics", "M", "p95", 20 * sin(0.95 * pi / 2)),
    ("statics", "abs(alpha - 1)", "integral", 0.5 + (pi - 1) ** 2 / 2),
    ("inverse", "joint.pivot.velocity", "mean", 0.5), ("inverse", "joint.pivot.velocity", "rms", sqrt(1 / 3)),
    ("inverse", "joint.pivot.acceleration", "rms", 1.0), ("inverse", "joint.pivot.velocity", "p25", 0.25),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "quantity", "name", "value"), CLOSED_FORMS)
def test_figures_are_those_of_closed_forms_within_their_errors(
    scenario: Callable[..., Any], kind: str, quantity: str, name: str, value: float
) -> None:
    number, error = scenario(kind).run().number(f"{quantity} @ {name}")
    assert abs(number - value) <= error + ROUNDING * max(abs(value), 1.0)
    assert error <= 1e-4 * max(abs(value), 1.0)


@pytest.mark.parametrize("way", ["from: 0 deg, to: 180 deg", "from: 180 deg, to: 0 deg"])
def test_what_the_rows_see_an_integral_does_not_miss(scenario: Callable[..., Any], way: str) -> None:
    """A peak of 1e-3 rad in pi rad, of which a few of the 3142 rows tell; backwards it counts with the sign of ds."""
    result = scenario("statics", "", ("from: 0 deg, to: 180 deg, samples: 8", f"{way}, samples: 3142")).run()
    sign = 1.0 if way.endswith("180 deg") else -1.0
    value, error = result.number("exp(-((alpha - 1)/0.001)**2) @ integral")
    assert abs(value - sign * 1e-3 * sqrt(pi)) <= error + ROUNDING
    assert error < 1e-12
    mean, _ = result.number("exp(-((alpha - 1)/0.001)**2) @ mean")
    assert mean == pytest.approx(1e-3 * sqrt(pi) / pi, rel=1e-9)


def test_an_integral_has_the_unit_of_the_parameter_in_it(scenario: Callable[..., Any]) -> None:
    result = scenario("inverse", "numbers: [joint.pivot.power @ integral, M @ rms]\n").run()
    units = {text: series.unit for text, (series, _) in result.numbers().items()}
    assert units["joint.pivot.power @ integral"].dimension == units["M @ rms"].dimension  # J = W s, as N m


def test_rows_that_stand_alone_have_no_figures(scenario: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="these rows stand alone"):
        scenario("state").run().number("M @ rms")


STEADY = {"problem.motion": {"pivot": {"law": "constant_speed", "speed": "1 rad/s"}}}


@pytest.mark.parametrize("samples", [2, 500])
@pytest.mark.parametrize(
    ("quantity", "value", "slack"),
    [
        ("abs(cos(alpha))", 2.0 - sin(3.0), 1e-9),
        ("1/sqrt(abs(cos(alpha)))", 5.10228506128805, 2e-4),  # of 2/sqrt(sinc(u^2/pi)), x = pi/2 -+ u^2, by SciPy
    ],
)
def test_integrals_of_cusps_and_roots_are_within_their_errors(
    scenario: Callable[..., Any], samples: int, quantity: str, value: float, slack: float
) -> None:
    result = scenario("inverse").varied({**STEADY, "problem.time": {"end": "3 s", "samples": samples}}).run()
    number, error = result.number(f"{quantity} @ integral")
    assert abs(number - value) <= error < slack


@pytest.mark.parametrize(
    ("quantity", "name"),
    [
        ("tan(alpha)", "integral"), ("1/sqrt(abs(cos(alpha)))", "rms"), ("5 + 1e-6/cos(alpha)", "mean"),
        ("1/sin(alpha)", "rms"),
    ],
)  # fmt: skip
def test_an_integral_without_end_is_refused(scenario: Callable[..., Any], quantity: str, name: str) -> None:
    result = scenario("inverse").varied({**STEADY, "problem.time": {"end": "3 s", "samples": 7}}).run()
    with pytest.raises(InputError, match=f"has no {name}"):
        result.number(f"{quantity} @ {name}")


@pytest.mark.parametrize("method", ["dop853", "stiff"])
def test_a_blow_that_only_the_steps_see_counts(method: str) -> None:
    """A slide of 2 kg at 1 m/s is hit over 4 um of its way: the work ``A h`` is its kinetic energy, in 0.02 J."""
    planar = {
        "points": {"O": [0, 0], "P": ["1 m", 0]}, "ground": ["O"],
        "links": {"block": {"points": ["P"], "mass": "2 kg"}}, "sliders": {"x": {"link": "block", "along": ["O", "P"]}},
    }  # fmt: skip
    rise = {"law": "cycloidal", "from": "0 N", "to": "10 kN", "duration": "2 um"}
    fall = {"law": "cycloidal", "from": "10 kN", "to": "0 N", "duration": "2 um"}
    parts = [({"law": "constant", "value": "0 N"}, "0.37 m"), (rise, "2 um"), (fall, "2 um")]
    blow = {"law": "succession", "segments": [{"duration": way, "motion": law} for law, way in parts]}
    result = pinarm.run({
        "pinarm": 1, "mechanism": {"pinarm": 1, "title": "slide", "planar": planar, "gravity": "none"},
        "outputs": ["x"], "accuracy": {"method": method},
        "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 2}, "initial": {"velocity": {"x": "1 m/s"}},
                    "loads": {"blow": {"kind": "joint_effort", "joint": "x", "over": "x", "effort": blow}}},
    })  # fmt: skip
    speed = sqrt(1.0 + 0.02)
    # positions of 1 m are known to 1e-11 m, of 4 um
    assert result.number("joint.x.velocity @ end")[0] == pytest.approx(speed, rel=1e-6)
    assert result.number("power.blow @ integral")[0] == pytest.approx(0.02, rel=1e-5)
    assert result.number("force.blow.effort @ integral")[0] == pytest.approx(2.0 * (speed - 1.0), rel=1e-5)
    assert result.number("force.blow.effort @ max")[0] == pytest.approx(1e4, rel=1e-9)
