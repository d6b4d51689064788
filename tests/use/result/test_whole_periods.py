"""Notes on figures that are not taken over whole periods of a cam."""

from pathlib import Path

import pytest

import pinarm

CAM = """pinarm: 1
planar:
  points: {O: [0, 0], R: [0, 60 mm], P: [0, 300 mm]}
  ground: [O]
  links: {shaft: {points: [O], mass: 4 kg, inertia: 0.004 kg*m^2}, slide: {points: [R, P], mass: 3 kg}}
  sliders: {lift: {link: slide, along: [R, P]}}
"""

TURN = """pinarm: 1
mechanism: cam.yaml
problem:
  kind: inverse
  time: {end: 0.5 s, samples: 21}
  motion:
    O: {law: constant_speed, speed: 120 rpm}
    lift: {law: over, of: O, period: 360 deg, profile: {law: harmonic, amplitude: 10 mm, pulsation: 1 rad/rad}}
outputs: [lift]
numbers: [%s]
"""


@pytest.fixture
def turn(tmp_path: Path) -> Path:
    (tmp_path / "cam.yaml").write_text(CAM)
    (tmp_path / "s.yaml").write_text(TURN % "lift @ rms, lift @ peak")
    return tmp_path / "s.yaml"


def said(result: pinarm.Result) -> list[str]:
    return [note for note in result.notes() if "repeats with a period" in note]


@pytest.mark.parametrize(("end", "count"), [("0.5 s", ""), ("1.5 s", ""), ("0.625 s", "1.25"), ("0.3 s", "0.6")])
def test_a_run_of_no_whole_turns_is_told(turn: Path, end: str, count: str) -> None:
    result = pinarm.run(turn, {"problem.time.end": end})
    notes = said(result)
    assert len(notes) == bool(count)
    if count:
        assert f"'lift' repeats with a period of 'O', which passes {count} of them" in notes[0]
        assert "lift @ rms hold" in notes[0] and "peak" not in notes[0]
    else:  # of the cycle: amplitude over the root of 2
        assert result.number("lift @ rms")[0] == pytest.approx(0.01 / 2**0.5, rel=1e-9)


def test_sweeps_tell_of_their_first_and_last_case(turn: Path) -> None:
    found = pinarm.sweep(turn, {"problem.motion.O.speed": "120, 240, 150 rpm"}, results=["lift @ rms"], workers=1)
    [note] = found.notes
    assert note.startswith("case 2: 'lift' repeats with a period of 'O', which passes 1.25 of them")
