"""Limits of an inertia that turns by a cubic, whose torques are known: peak 6 J θ/T², rms √12 J θ/T²."""

from math import isnan, pi, sqrt
from pathlib import Path
from typing import Any

import pytest

import pinarm
from pinarm.errors import PinarmError

INERTIA, ANGLE, TIME = 2.0, 0.5 * pi, 0.8
PEAK, RMS = (factor * INERTIA * ANGLE / TIME**2 for factor in (6.0, sqrt(12.0)))
ROTOR = (
    '<robot name="rotor"><link name="base"/><link name="wheel"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="turn" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint></robot>'
)


@pytest.fixture
def turned(tmp_path: Path) -> pinarm.Scenario:
    (tmp_path / "rotor.urdf").write_text(ROTOR)
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: rotor.urdf\nproblem:\n  kind: inverse\n  time: {end: 0.8 s, samples: 5}\n"
        "  motion: {turn: {law: polynomial, from: 0 deg, to: 90 deg, duration: 0.8 s, degree: 3}}\n"
        "  drives: [turn]\noutputs: [joint.turn.effort]\n"
    )
    return pinarm.load(tmp_path / "s.yaml")


def limited(scenario: pinarm.Scenario, **keep: str) -> Any:
    named = {"peak": "joint.turn.effort @ peak", "rms": "joint.turn.effort @ rms", "turn": "turn @ end"}
    return scenario.varied({"limits": {"keep": {named[key]: text for key, text in keep.items()}}})


def test_margins_are_those_of_the_closed_form(turned: pinarm.Scenario) -> None:
    result = limited(turned, peak="< 30 N*m", rms="< 10 N*m", turn="> 80 deg").run()
    for name, margin in {
        "joint_turn_effort_peak": 30.0 - PEAK, "joint_turn_effort_rms": 10.0 - RMS,
        "turn_end": ANGLE - 80.0 * pi / 180.0,
    }.items():  # fmt: skip
        assert result.number(f"limits.{name}.margin")[0] == pytest.approx(margin, rel=1e-12)
    assert result.number("limits.least_margin")[0] == pytest.approx((10.0 - RMS) / 10.0, rel=1e-12)
    assert result.number("limits.beyond")[0] == 1.0
    section = result.sections["limits"]
    assert [row[-1] for row in section.tables[0].rows] == ["kept", "beyond", "kept"]
    assert section.remarks == [f"beyond its limit: joint.turn.effort @ rms < 10 N*m is {RMS:.6g} N*m"]


def test_margins_are_told_with_the_errors_of_their_numbers(turned: pinarm.Scenario) -> None:
    result = limited(turned, peak="< 30 N*m", rms="< 10 N*m", turn="> 80 deg").run()
    margin, error = result.number("limits.joint_turn_effort_rms.margin")
    assert error == result.number("joint.turn.effort @ rms")[1] > 0.0
    assert result.number("limits.least_margin")[1] == pytest.approx(error / 10.0, rel=1e-12)
    assert abs(margin - (10.0 - RMS)) <= error


@pytest.fixture
def controlled(turned: pinarm.Scenario, tmp_path: Path) -> pinarm.Scenario:
    """An inertia that is turned by 1 rad."""
    (tmp_path / "c.yaml").write_text(
        "pinarm: 1\nmechanism: rotor.urdf\nproblem:\n  kind: forward\n  time: {end: 1 s, samples: 5}\n"
        "  control: [{kind: pid, drive: turn, follows: {law: constant, value: 1 rad}, kp: 50 N*m/rad, kd: 2 N*m*s/rad}]"
        "\noutputs: [turn]\nresponse: {of: turn, final: 1 rad, band: 0.2}\n"
    )
    return pinarm.load(tmp_path / "c.yaml")


ANY_ORDER = [{"turn @ max": "< 2 rad", "response.settling_time": "< 1 s"},
             {"response.settling_time": "< 1 s", "turn @ max": "< 2 rad"}]  # fmt: skip


@pytest.mark.parametrize("keep", ANY_ORDER)
def test_a_limit_whose_number_is_not_known_is_beyond_in_any_order(
    controlled: pinarm.Scenario, keep: dict[str, str]
) -> None:
    result = controlled.varied({"limits": {"keep": keep}, "problem.control.0.kd": "100 N*m*s/rad"}).run()
    assert isnan(result.number("limits.least_margin")[0])
    assert result.number("limits.beyond")[0] == 1.0


@pytest.mark.slow
def test_a_search_does_not_end_where_a_limit_is_not_known(controlled: pinarm.Scenario) -> None:
    """The overshoot falls with the damping, but from some on it takes too long: 100 N m s/rad / 50 N m/rad = 2 s."""
    path = "problem.control.0.kd"
    search = {"for": {path: ["2 N*m*s/rad", "100 N*m*s/rad"]}, "maximise": "limits.least_margin", "starts": 3}
    result = controlled.varied({"limits": {"keep": ANY_ORDER[0]}, "find": search}).run()
    assert result.number("limits.beyond")[0] == 0.0
    assert result.number("limits.least_margin")[0] > 0.3


FALL = """\
pinarm: 1
mechanism: rotor.urdf
problem:
  kind: forward
  time: {end: 2 s, samples: 11}
  initial: {position: {turn: 1 rad}}
  loads: {spring: {kind: joint_spring, joint: turn, stiffness: 2 N*m/rad, damping: 0 N*m*s/rad}}
outputs: [turn]
accuracy: {tolerance: 1e-4}
"""


@pytest.mark.parametrize(("shift", "verdict"), [(0.0, "within its error"), (1e-2, "kept"), (-1e-2, "beyond")])
def test_a_number_next_to_its_limit_is_not_judged(
    turned: pinarm.Scenario, tmp_path: Path, shift: float, verdict: str
) -> None:
    (tmp_path / "fall.yaml").write_text(FALL)
    scenario = pinarm.load(tmp_path / "fall.yaml")
    value = float(scenario.run()["turn"].values[-1])  # cos(2 s * 1/s) but for the error of the integration
    keep = {"turn @ t=2 s": f"< {value + shift!r} rad"}
    row = scenario.varied({"limits": {"keep": keep}}).verified().sections["limits"].tables[0].rows[0]
    assert row[-1] == verdict
    assert float(row[-2]) < 1e-2


@pytest.mark.parametrize(
    ("keep", "message"),
    [
        ({"joint.turn.effort @ rms": "30 N*m"}, "no condition"),
        ({"joint.turn.effort @ rms": "= 30 N*m"}, "'=' is no limit"),
        ({"joint.turn.effort @ rms": "< 30 m"}, "not a unit of this quantity"),
        ({"limits.least_margin": "> 0"}, "no section 'limits'"),
        ({"turn @ end": "< 1 rad", "turn  @ end": "< 2 rad"}, "name of another number"),
        ({}, "length >= 1"),
    ],
)
def test_mistakes_are_told(turned: pinarm.Scenario, keep: dict[str, str], message: str) -> None:
    with pytest.raises(PinarmError, match=message):
        _ = turned.varied({"limits": {"keep": keep}}).run().sections


ARM = (
    '<robot name="arm"><link name="base"/><joint name="q" type="continuous"><parent link="base"/><child link="arm"/>'
    '<axis xyz="0 1 0"/></joint><link name="arm"><inertial><origin xyz="0.6 0 0"/><mass value="5"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
)
HELD = "problem: {kind: statics, hold: {q: 0 rad}}\n"
PATH = "problem: {kind: statics, over: {q: {from: 0 deg, to: 70 deg, samples: 5}}}\n"
EFFORT, WEIGHT = "joint.q.effort", 5.0 * 9.81 * 0.6


def held(folder: Path, text: str) -> pinarm.Result:
    """An arm held against its weight: an effort of -29.43 N*m at the level."""
    (folder / "arm.urdf").write_text(ARM)
    (folder / "s.yaml").write_text(f"pinarm: 1\nmechanism: arm.urdf\noutputs: [{EFFORT}]\n{text}")
    return pinarm.run(folder / "s.yaml")


@pytest.mark.parametrize("problem", [HELD, PATH])
@pytest.mark.parametrize(("place", "kept"), [("largest", 0), ("peak", 0), ("max", 1)])
def test_a_bound_of_a_largest_amount_has_no_sign(tmp_path: Path, problem: str, place: str, kept: int) -> None:
    result = held(tmp_path, f"{problem}limits: {{keep: {{{EFFORT} @ {place}: < 20 N*m}}}}\n")
    assert result.number("limits.beyond")[0] == 1.0 - kept
    left, _ = result.number(f"limits.joint_q_effort_{place}.margin")
    if not kept:
        assert left == pytest.approx(20.0 - WEIGHT, rel=1e-9)
    assert result.number(f"{EFFORT} @ largest")[0] == pytest.approx(-WEIGHT, rel=1e-9)
    assert result.number(f"{EFFORT} @ peak")[0] == pytest.approx(WEIGHT, rel=1e-9)


def test_a_negative_bound_of_an_amount_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PinarmError, match=r"is a size, which is never below -20 N\*m"):
        held(tmp_path, f"{HELD}limits: {{keep: {{{EFFORT} @ largest: < -20 N*m}}}}\n")
