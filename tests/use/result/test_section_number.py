"""Numbers of sections are asked like numbers of curves: in keys of answers, sweeps, searches and calls."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.study.restore import restore

ROTOR, BEARINGS = "scenarios/rotor_vertical.yaml", "scenarios/slider_crank_bearings.yaml"
KNEE = "scenarios/exoskeleton_leg_knee.yaml"
CATALOGUE = "models/motors/motors.csv"
MOTORS = {"drive": "knee_motor", "catalogue": f"../{CATALOGUE}", "ratios": [100]}


@pytest.mark.parametrize("path", [BEARINGS, *(pytest.param(path, marks=pytest.mark.slow) for path in (ROTOR, KNEE))])
def test_sections_have_the_numbers_that_they_promise_in_these_units(path: str) -> None:
    more: dict[str, object] = {"problem.time.samples": 21}
    if path != BEARINGS:
        more |= {"shaking": {}} if path == ROTOR else {"shaking": {}, "sizing": MOTORS}
    result = pinarm.run(path, more)
    assert result.sections
    for key, section in result.sections.items():
        promised = result.numbered[key].units(result.quantities)
        measured = {name: str(series.unit) for name, series in section.numbers.items()}
        assert measured.items() <= {name: str(unit) for name, unit in promised.items()}.items()
        assert all(".peak" in name for name in promised.keys() - measured.keys())  # loads that are 0 have no peak


def test_an_answer_key_may_ask_for_them(scenario: Callable[..., Any]) -> None:
    """The force on a pendulum's pivot at rest is its weight."""
    right = {"quantity": "loads.pivot.radial.peak", "value": "20.000 N", "source": "m g"}
    wrong = {**right, "value": "21 N"}
    asked = {"loads": {"joints": {"pivot": {}}, "sets": []}, "expect": [right, wrong]}
    findings = pinarm.check(scenario("statics"), asked)
    assert [finding.verdict for finding in findings] == ["agrees", "MISS"]
    assert str(findings[0].unit) == "N"


def test_a_run_tells_them_with_the_error_of_their_quadrature() -> None:
    asked = ["loads.joint.A.life.time", "loads.joint.A.radial.peak"]
    result = pinarm.run(BEARINGS, {"problem.time.samples": 21, "numbers": asked})
    life, error = result.number("loads.joint.A.life.time")
    assert life == result.sections["loads"].numbers["joint.A.life.time"].values[0]
    assert 0 < error < 1e-6 * life
    peak, slack = result.number("loads.joint.A.radial.peak")
    assert 0 < slack < 1e-10 * peak
    assert result.summary()["numbers"]["loads.joint.A.life.time"] == {
        "value": life,
        "unit": "s",
        "quadrature error": error,
    }


def test_sweeps_take_them(scenario: Callable[..., Any], folder: Path) -> None:
    """The force on a pendulum's pivot at rest is its weight."""
    text = "gravity: {direction: -z, magnitude: 10 m/s^2}\nloads: {joints: {pivot: {}}, sets: []}\n"
    hung = scenario("statics", text)
    swept = pinarm.sweep(hung, {"gravity.magnitude": "5, 10, 20 m/s^2"}, results=["loads.pivot.radial.peak"], workers=1)
    assert str(swept["loads.pivot.radial.peak"].unit) == "N"
    assert swept["loads.pivot.radial.peak"].values == pytest.approx([10, 20, 40], rel=1e-14)


@pytest.mark.slow
def test_searches_take_them(scenario: Callable[..., Any]) -> None:
    text = (
        "gravity: {direction: -z, magnitude: 10 m/s^2}\nloads: {joints: {pivot: {}}, sets: []}\n"
        "find: {for: {gravity.magnitude: 1 m/s^2}, so_that: {loads.pivot.radial.peak: 60 N}}\n"
    )
    assert scenario("statics", text).run().figures["gravity.magnitude [m/s^2]"] == pytest.approx(30, rel=1e-12)
    best = text.replace("1 m/s^2}, so_that: {loads.pivot.radial.peak: 60 N}", (
        "[1 m/s^2, 9 m/s^2]}, starts: 1, maximise: loads.pivot.radial.peak, "
        "subject_to: {loads.pivot.radial.peak: < 12 N}"
    ))  # fmt: skip
    found = scenario("statics", best).run()
    assert found.number("find.objective")[0] == pytest.approx(12, rel=1e-5)
    assert found.number("find.gravity.magnitude")[0] == pytest.approx(6, rel=1e-5)


@pytest.mark.parametrize(
    ("asked", "message"),
    [("shaking.force.q.peak", "no number 'force.q.peak'"), ("loads.B.life.time", "no section 'loads'")],
)
def test_a_number_that_does_not_exist_is_told_before_anything_is_solved(asked: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        pinarm.validate(ROTOR, {"shaking": {}, "numbers": [asked]})
    with pytest.raises(InputError, match="no number"):
        pinarm.sweep(ROTOR, {"gravity": ["none"]}, values={"shaking": {}}, results=["shaking.force.q.peak"], workers=1)


def test_a_result_that_was_read_has_its_catalogue_and_its_sections(tmp_path: Path) -> None:
    result = pinarm.run(KNEE, {"sizing": MOTORS, "problem.time.samples": 21})
    folder = result.save(tmp_path / "far" / "away", plots=False)
    again = restore(folder)
    assert again.number("sizing.reserve") == result.number("sizing.reserve")
    assert (folder / "sizing_catalogue.csv").read_bytes() == Path(CATALOGUE).read_bytes()
    with open(folder / "sizing_motors.csv", newline="") as stream:
        first = next(csv.DictReader(stream))
    assert first["motor"] == str(result.sections["sizing"].tables[0].rows[0][1])
