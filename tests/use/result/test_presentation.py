"""Units and labels by choice: the same numbers by hand, wherever people and programs see them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError, UnitError
from pinarm.use.report.report import report as document
from pinarm.use.show.drawings import sketch
from pinarm.use.show.text import ranges, report
from pinarm.use.study.answers.check import rows as verdicts

CHOSEN = """\
units: {M: kN*mm, alpha: rad, joint.pivot.velocity: rpm, t: ms}
labels: {M: "M_\\\\alpha", joint.pivot.velocity: "\\\\dot\\\\psi_{12}"}
numbers: [M @ max, joint.pivot.velocity @ largest]
expect:
  - {quantity: alpha, at: end, value: 1 rad, source: the law}
  - {quantity: joint.pivot.velocity, at: {t: 1 s}, value: 1 rad/s, rtol: 1e-9, source: the law}
"""
OUTPUTS = ("outputs: [M, alpha]", "outputs: [M, alpha, joint.pivot.velocity]")
RPM = 30 / np.pi


@pytest.fixture
def chosen(scenario: Callable[..., Any]) -> Any:
    return scenario("inverse", CHOSEN, OUTPUTS).run()


def test_the_terminal_shows_chosen_units_and_labels(chosen: Any) -> None:
    head, moment, angle, speed = ranges(chosen)
    assert head == ["", "unit", "min", "at t [ms]", "max", "at t [ms]"]
    assert moment[:2] == ["M_α", "kN*mm"]
    assert float(moment[4]) == pytest.approx(chosen["M"].max(), rel=1e-6)  # a kilonewton millimetre is a newton metre
    assert angle[:2] == ["alpha", "rad"]
    assert angle[4:] == ["1", "2000"]
    assert speed[:2] == ["ψ̇₁₂", "rpm"]
    assert float(speed[4]) == pytest.approx(RPM, rel=1e-6)
    assert f"joint.pivot.velocity @ largest: {RPM:.7g} rpm" in report(chosen)


def test_angles_are_in_degrees_for_people_and_in_radians_for_programs(scenario: Callable[..., Any]) -> None:
    result = scenario("inverse").run()
    assert ranges(result)[2][1:] == ["deg", "0", "0", "57.29578", "2"]
    assert list(result.to_dataframe()) == ["t [s]", "M [N*m]", "alpha [rad]"]
    swept = scenario("statics").run()
    assert ranges(swept)[0][3] == "at pivot [deg]"
    assert float(ranges(swept)[2][5]) == pytest.approx(180.0)


def test_plots_replay_check_and_report_have_them(chosen: Any) -> None:
    *_, axis = chosen.plot().axes
    assert np.asarray(axis.lines[0].get_ydata()) == pytest.approx(RPM * chosen["joint.pivot.velocity"].values)
    assert axis.get_title(loc="left") == "$\\dot\\psi_{12}$ [rpm]"
    assert axis.get_xlabel() == "t [ms]"
    page = chosen.replay().html
    assert json.dumps("M_α [kN·mm]") in page
    cells = verdicts(pinarm.check(chosen.scenario))
    assert [row[4] for row in cells] == ["1 rad", f"{RPM:.9g} rpm"]
    assert "rpm" in document(chosen).html


@pytest.mark.parametrize(("keys", "error", "message"), [
    ("units: {M: kg}\n", UnitError, "units"), ("units: {M: bananas}\n", InputError, "bananas"),
    ("units: {M_x: kN}\n", InputError, "no quantity 'M_x'"), ("labels: {M_x: y}\n", InputError, "no quantity 'M_x'"),
])  # fmt: skip
def test_mistakes_are_told_with_their_place(
    scenario: Callable[..., Any], keys: str, error: type[InputError], message: str
) -> None:
    with pytest.raises(error, match=message) as caught:
        scenario("inverse", keys).run()
    assert "inverse.yaml:8:" in str(caught.value)


KINDS = "units: {length: mm, angle: rad, torque: kN*m, speed: rpm, time: ms, mass: g, alpha: deg}\n"


def test_a_kind_of_quantities_is_shown_in_its_unit_everywhere(scenario: Callable[..., Any], tmp_path: Path) -> None:
    """By factors written by hand; a quantity's own unit goes before that of its kind, and npz stays in SI."""
    outputs = "outputs: [M, alpha, joint.pivot.velocity, point.tip.position.x, joint.pivot.position]"
    result = scenario(
        "inverse", KINDS + "numbers: [M @ max, joint.pivot.velocity @ range]\n", (OUTPUTS[0], outputs)
    ).run()
    factors = {"t": 1e3, "M": 1e-3, "alpha": 180 / np.pi, "joint.pivot.velocity": RPM, "point.tip.position.x": 1e3,
               "joint.pivot.position": 1.0}  # fmt: skip
    units = ["ms", "kN*m", "deg", "rpm", "mm", "rad"]
    headings = [f"{name} [{unit}]" for name, unit in zip(factors, units, strict=True)]
    table = result.to_dataframe()
    assert list(table) == headings
    folder = result.save(tmp_path / "out", plots=False)
    assert (folder / "trajectory.csv").read_text().splitlines()[0].split(",") == headings
    for (name, factor), heading, row in zip(factors.items(), headings, [None, *ranges(result)[1:]], strict=True):
        assert table[heading].to_numpy() == pytest.approx(factor * result[name].values, rel=1e-14)
        assert row is None or float(row[4]) == pytest.approx(factor * result[name].values.max(), rel=1e-6)
    with np.load(folder / "trajectory.npz") as stored:
        assert np.array_equal(stored["point.tip.position.x"], result["point.tip.position.x"].values)
    assert f"joint.pivot.velocity @ range: {RPM:.7g} rpm" in report(result)
    assert "[mm]" in sketch(result).axes[0].get_xlabel()
    assert "mass [g]" in document(result).html
