"""Figures of curves with closed forms: ``M = 20 sin(alpha)`` from 0 to 180 deg, and a speed that rises and falls.

On the trapezoid from 0 to 1 rad at 1 rad/s^2 the speed is t until 1 s and 2 - t until 2 s, the acceleration 1 and -1.
"""

from collections.abc import Callable
from math import pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.special import beta, betainc

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


@pytest.mark.parametrize("name", ["rms", "p95"])
def test_figures_do_not_hang_on_the_rows_of_the_table(scenario: Callable[..., Any], name: str) -> None:
    coarse, fine = (
        scenario("inverse", "", ("samples: 9", f"samples: {samples}")).run().number(f"M @ {name}")[0]
        for samples in (2, 301)
    )
    # they are taken of the motion, integrals to 1e-10 and percentiles to the same part of the range
    assert coarse == pytest.approx(fine, rel=1e-9)


def test_a_jump_in_the_middle_of_a_run_is_no_rounding(scenario: Callable[..., Any]) -> None:
    """A swing hangs through whole periods, and drives its motor for half of each: 100 eta there, else 100/eta.

    Its 7 jumps are where panels meet: 600 panels halve those of half a second on both sides of each 21 times. What they
    do not see of a jump by 45 is within 0.22 % of the panels on either side of it.
    """
    swing = "law: harmonic, amplitude: 1 rad, pulsation: 360 deg/s, phase: 90 deg"
    hanging = ("law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 1 rad/s^2", swing)
    result = scenario("inverse", "", hanging).run()
    mean, error = result.number("joint.pivot.effort/drive.motor.torque @ mean")
    assert abs(mean - 50.0 * (0.8 + 1.0 / 0.8)) <= error < 14 * 0.0022 * 45.0 * (0.5 / 2**20) / 2.0


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


def test_points_of_tables_are_not_stepped_over(scenario: Callable[..., Any], folder: Path) -> None:
    """A law that rests but for one of its points, between the two rows: the spline of SciPy through the same ones."""
    points = [(0.001 * k, 0.4 if k == 653 else 0.0) for k in range(2001)]
    (folder / "t.csv").write_text("t [s],angle [rad]\n" + "".join(f"{t},{x}\n" for t, x in points))
    law = ("law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 1 rad/s^2", "law: table, file: t.csv")
    number, error = scenario("inverse", "", ("samples: 9", "samples: 2"), law).run().number("alpha @ integral")
    spline = CubicSpline(*np.array(points).T, bc_type="clamped")
    assert abs(number - float(spline.integrate(0.0, 2.0))) <= error + ROUNDING


def test_an_integral_has_the_unit_of_the_parameter_in_it(scenario: Callable[..., Any]) -> None:
    result = scenario("inverse", "numbers: [joint.pivot.power @ integral, M @ rms]\n").run()
    units = {text: series.unit for text, (series, _) in result.numbers().items()}
    assert units["joint.pivot.power @ integral"].dimension == units["M @ rms"].dimension  # J = W s, as N m


def test_rows_that_stand_alone_have_no_figures(scenario: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="these rows stand alone"):
        scenario("state").run().number("M @ rms")


@pytest.mark.parametrize(("pulsation", "begin"), [(7.0, -1e-5), (7.0, 3e-4), (6.7, 1e-4)])
def test_a_jump_just_beside_the_places_of_a_quadrature_is_in_the_number_or_in_its_error(
    scenario: Callable[..., Any], pulsation: float, begin: float
) -> None:
    """The sign of a velocity that turns back next to the start and at the end of each half of a period.

    Its mean is that of ``sign(cos(w (t - b)))`` over 3 s.
    """
    law = {"law": "harmonic", "amplitude": "1 rad", "pulsation": f"{pulsation} rad/s", "phase": "90 deg"}
    motion = {"problem.motion": {"pivot": {**law, "begin": f"{begin} s"}}, "problem.time": {"end": "3 s", "samples": 2}}
    result = scenario("inverse").varied(motion).run()
    number, error = result.number("joint.pivot.velocity/abs(joint.pivot.velocity) @ integral")
    turns = begin + np.pi / pulsation * np.arange(-1, 8)
    cuts = np.array([0.0, *turns[(turns > 0.0) & (turns < 3.0)], 3.0])
    exact = float(np.diff(cuts) @ -np.sign(np.sin(pulsation * (0.5 * (cuts[1:] + cuts[:-1]) - begin))))
    assert abs(number - exact) <= error < 1e-8


STEADY = {"problem.motion": {"pivot": {"law": "constant_speed", "speed": "1 rad/s"}}}


@pytest.mark.parametrize("samples", [2, 500])
@pytest.mark.parametrize(
    ("quantity", "value", "slack"),
    [
        ("abs(cos(alpha))", 2.0 - sin(3.0), 1e-9),
        ("1/sqrt(abs(cos(alpha)))", 5.10228506128805, 2e-4),  # of 2/sqrt(sinc(u^2/pi)), x = pi/2 -+ u^2, by SciPy
        ("1/sqrt(abs(sin(alpha - 1.5)))", 5.102463263113763, 2e-4),
    ],
)
def test_integrals_of_cusps_and_roots_are_within_their_errors(
    scenario: Callable[..., Any], samples: int, quantity: str, value: float, slack: float
) -> None:
    """That of the cusp ended at an error of 1e-6, beside its square, which was done; the last is infinite at a node."""
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
    with pytest.raises(InputError, match=rf"has no {name}, as its integral has no end.* infinity at t = (1\.57|0 s)"):
        result.number(f"{quantity} @ {name}")


@pytest.mark.parametrize(("end", "samples"), [(13.0, 401), (40.0, 11)])
def test_integrals_with_many_poles_are_within_their_errors(
    scenario: Callable[..., Any], end: float, samples: int
) -> None:
    """``sin(x)^(-3/5)`` from 0 to x is an incomplete beta function."""

    def from_0(x: float) -> float:
        half = beta(0.2, 0.5) / 2
        turns, rest = divmod(x, pi)
        part = half * betainc(0.2, 0.5, sin(rest) ** 2)
        return float(2 * half * turns + (part if rest < pi / 2 else 2 * half - part))

    result = scenario("inverse").varied({**STEADY, "problem.time": {"end": f"{end} s", "samples": samples}}).run()
    value, error = result.number("abs(sin(alpha - 0.31))**-0.6 @ integral")
    assert abs(value - from_0(0.31) - from_0(end - 0.31)) <= error < 0.02 * value


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
