"""Runs without ``drives``: a five-bar linkage whose tip follows laws."""

from pathlib import Path
from typing import Any

import pytest

import pinarm

MECHANISM = """pinarm: 1
planar:
  points: {A: [0, 0], B: [100 mm, 0], C: [-50 mm, 120 mm], D: [150 mm, 120 mm], P: [50 mm, 220 mm]}
  ground: [A, B]
  links:
    left: {points: [A, C], mass: 1 kg}
    right: {points: [B, D], mass: 1 kg}
    left_rod: {points: [C, P], mass: 1 kg}
    right_rod: {points: [D, P], mass: 1 kg}
coordinates:
  x: {kind: point, point: P, along: x}
  y: {kind: point, point: P, along: y}
"""

CIRCLE = """pinarm: 1
mechanism: mechanism.yaml
problem:
  kind: inverse
  time: {end: 1 s, samples: 5}
  motion:
    x: {law: harmonic, mean: 50 mm, amplitude: 20 mm, pulsation: 6.283185307179586 rad/s}
    y: {law: harmonic, mean: 220 mm, amplitude: 20 mm, pulsation: 6.283185307179586 rad/s, phase: 1.5 rad}
"""

HELD = "pinarm: 1\nmechanism: mechanism.yaml\nproblem: {kind: %s, hold: {%s}}\n"

TIP, CRANKS = "x: 50 mm, y: 220 mm", "A: 10 deg, B: -10 deg"


@pytest.fixture
def run(tmp_path: Path) -> Any:
    """Return a function that runs a scenario with a text added to the mechanism file."""

    def run_with(scenario: str, mechanism: str = "") -> Any:
        (tmp_path / "mechanism.yaml").write_text(MECHANISM + mechanism)
        (tmp_path / "s.yaml").write_text(scenario + "outputs: [energy.total]\n")
        return pinarm.run(tmp_path / "s.yaml")

    return run_with


def said(result: Any) -> list[str]:
    return [note for note in result.notes() if note.startswith("no drives are named")]


@pytest.mark.parametrize("scenario", [CIRCLE, HELD % ("statics", TIP), HELD % ("state", TIP)])
def test_laws_of_a_tip_carry_the_load_and_the_cranks_are_named(run: Any, scenario: str) -> None:
    [note] = said(run(scenario))
    assert note.startswith("no drives are named: x, y carry the load, and efforts of joints without a law are 0")
    assert note.endswith("which coordinates they act along, by the key drives")


def test_the_note_is_right_efforts_of_cranks_are_0_and_those_along_the_laws_do_their_work(run: Any) -> None:
    tip, cranks = run(CIRCLE), run(CIRCLE + "  drives: [A, B]\n")
    assert not said(cranks)
    for name in "AB":
        assert not tip[f"joint.{name}.effort"].values.any()
    power = [
        sum(result[f"{owner}.effort"].values * result[f"{owner}.velocity"].values for owner in owners)
        for result, owners in ((tip, ["coordinate.x", "coordinate.y"]), (cranks, ["joint.A", "joint.B"]))
    ]
    assert abs(power[0]).max() > 0.1
    assert power[0] == pytest.approx(power[1], rel=1e-10, abs=1e-10)


def test_drives_of_the_mechanism_file_are_named_first(run: Any) -> None:
    drives = "drives: {left: {joint: A}, right: {joint: D}}\n"
    [note] = said(run(HELD % ("statics", CRANKS), drives))
    assert note.startswith("no drives are named: 'B' carries the load")
    assert note.endswith("such as drives: [A, D]")
