"""What a terminal shows of numbers: a zero where the rest is rounding."""

from math import inf, pi, sqrt
from pathlib import Path

import pytest

import pinarm
from pinarm.input.units import unit
from pinarm.use.result.section import SectionTable
from pinarm.use.show.text import counted, ranges, remarks, report, rounded, without_rounding
from pinarm.use.study.restore import restore


@pytest.mark.parametrize(("given", "wanted"), [
    ((-902.7, 5e-15), (-902.7, 0.0)), ((-3e-18, 0.5), (0.0, 0.5)), ((-1e-9, 2.0), (-1e-9, 2.0)),
    ((-4e-16, 5e-16), (-4e-16, 5e-16)),  # nothing tells of what these are the rounding
    ((0.0, 0.0), (0.0, 0.0)), ((-2.0, inf), (-2.0, inf)), ((-inf, -inf), (-inf, -inf)),
    ((1e-300, 2e-300), (1e-300, 2e-300)),
])  # fmt: skip
def test_what_is_rounding_of_the_other_end_is_zero(given: tuple[float, float], wanted: tuple[float, float]) -> None:
    """The relative error of what is solved for is 1e-13: less than that of the largest value is none."""
    assert without_rounding(*given) == wanted


DROPPED = """pinarm: 1
mechanism: m.yaml
problem:
  kind: forward
  time: {end: 2 s}
  events: {down: {when: fall, reaches: 2 m}, below: {when: fall, reaches: 30 m}}
outputs: [fall]
numbers: [%s]
"""


@pytest.fixture
def dropped(tmp_path: Path) -> Path:
    """Return a scenario of a body that falls from rest: 2 m after sqrt(2*2/9.81) s."""
    (tmp_path / "m.yaml").write_text(
        "pinarm: 1\nplanar: {points: {A: [0, 0], B: [0, -1 m], C: [0, 0]}, ground: [A, B],\n"
        "  links: {body: {points: [C], mass: 1 kg}}, sliders: {fall: {link: body, along: [A, B]}}}\n"
    )
    (tmp_path / "s.yaml").write_text(DROPPED % "event.down.time, event.down.count, event.below.time")
    return tmp_path / "s.yaml"


def test_events_are_told_with_their_times(dropped: Path) -> None:
    result, time = pinarm.run(dropped), sqrt(4 / 9.81)
    assert result.number("event.down.time")[0] == pytest.approx(time, rel=1e-9)  # of the integration
    lines = remarks(result)
    assert f"event down: t = {time:.7g} s" in lines
    assert "event below: does not take place" in lines
    assert [f"event.down.time: {time:.7g} s", "event.down.count: 1", "event.below.time: no value in this run"] == lines[
        :3
    ]


TURNED = """pinarm: 1
planar: {points: {O: [0, 0], A: [2 m, 0]}, ground: [O], links: {arm: {points: [O, A], mass: 1 kg, inertia: 1 kg*m^2}}}
drives: {motor: {joint: O}}
"""


def test_tables_of_sections_are_in_the_units_of_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(TURNED)
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\noutputs: [O]\nshaking: {}\nunits: {force: kN}\n"
        "problem: {kind: inverse, time: {end: 1 s}, motion: {O: {law: constant_speed, speed: 300 rpm}}}\n"
    )
    result = pinarm.run(tmp_path / "s.yaml")
    [own], [shown] = ([row for row in section.tables[0].rows if row[0] == "force.norm"]
                      for section in (result.sections["shaking"], result.shown_sections["shaking"]))  # fmt: skip
    assert own[1] == "N" and own[2] == pytest.approx((10 * pi) ** 2, rel=1e-6)  # m r w², r = 1 m
    assert shown[1] == "kN" and shown[2] == pytest.approx(own[2] / 1000, rel=1e-15)
    moments = {row[1] for row in result.shown_sections["shaking"].tables[0].rows if row[0].startswith("moment")}
    assert moments == {"N*m"}
    assert f"{shown[2]:.7g}" in report(result)
    folder = result.save(tmp_path / "out", plots=False)
    assert f"force.norm,kN,{shown[2]!r}" in (folder / "shaking_figures.csv").read_text()
    again = restore(folder)
    assert again.shown_sections["shaking"].tables[0].rows[0] == shown


def test_notes_that_differ_in_numbers_alone_are_printed_once_with_their_count() -> None:
    notes = ["at t = 0.1 s: slips", "the spring F1 is slack", "at t = -2.5e-3 s: slips", "the spring F2 is slack"]
    assert counted(notes) == ["at t = 0.1 s: slips (and 1 more like it)", *notes[1::2]]


def test_numbers_that_are_rounding_are_zero() -> None:
    """A force without a cause, beside weights of 16 N; and in a column of a section, but not in that of errors."""
    assert [row[2::2] for row in ranges(pinarm.run("scenarios/gen411_arm_static.yaml")) if row[0] == "F_Bx"] == [
        ["0", "0"]
    ]
    rows = [("a", 3e-17, 2e-17, 2e-17), ("b", 2.0, 1e-9, 5.0), ("c", -1e-12, inf, 0.0)]
    table = SectionTable("t", "", ("", "x", "error of x", "y"), (None, unit("N"), unit("N"), None), rows)
    assert [tuple(row) for row in table.cleared().rows] == [("a", 0.0, *rows[0][2:]), *rows[1:]]


@pytest.mark.parametrize(("value", "text"), [
    (1.23456, "1.235"), (123456.7, "123457"), (1234567.8, "1.235e+06"), (-0.0, "0"), (0.00012349, "0.0001235"),
    (1e-9, "1e-09"), (9999.6, "10000"), (1000.0, "1000"),
])  # fmt: skip
def test_results_in_reports_have_four_digits(value: float, text: str) -> None:
    assert rounded(value) == text
