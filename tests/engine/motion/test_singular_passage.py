"""Prescribed motions through singular positions, against closed forms; motions that turn beside them are left alone."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import pinarm

G, R, D = 9.81, 0.25, 1.0
MASSES = 1.0, 2.0, 1.5

PARALLELOGRAM = """
pinarm: 1
planar:
  points: {O: [0, 0], A: [0, 250 mm], B: [1 m, 250 mm], C: [1 m, 0]}
  ground: [O, C]
  links:
    crank: {points: [O, A], mass: 1 kg}
    coupler: {points: [A, B], mass: 2 kg}
    rocker: {points: [B, C], mass: 1.5 kg}
"""

FOUR_BAR = """
pinarm: 1
gravity: none
planar:
  points: {O: [0, 0], A: [-250 mm, 0], B: [625 mm, 0], C: [%s, 0]}
  ground: [O, C]
  links:
    crank: {points: [O, A], mass: 1 kg}
    coupler: {points: [A, B], mass: 2 kg}
    rocker: {points: [B, C], mass: 1 kg}
"""
"""Drawn at its change point, where its bars are in line."""


def run(folder: Path, text: str, samples: int, end: float, first: float, **given):
    """Return a run of the crank at 1 turn a second, from an angle on."""
    (folder / "mechanism.yaml").write_text(text)
    turning = {"law": "constant_speed", "speed": "60 rpm", "from": f"{first!r} rad"}
    problem = {"kind": "inverse", "time": {"end": f"{end!r} s", "samples": samples}, "motion": {"O": turning}}
    with pinarm.file_root(folder):
        return pinarm.run({"pinarm": 1, "mechanism": str(folder / "mechanism.yaml"), "problem": {**problem, **given},
                           "outputs": ["O", "C"]})  # fmt: skip


@pytest.mark.parametrize("samples", [9, 60])
def test_the_torque_of_a_parallelogram_goes_through_its_change_points(tmp_path, samples):
    """All links go round on circles of the crank's radius: ``T = -g r sin(O) (m1/2 + m2 + m3/2)`` from the drawing."""
    result = run(tmp_path, PARALLELOGRAM, samples, 1.0, 0.0)
    most = G * R * (MASSES[0] / 2.0 + MASSES[1] + MASSES[2] / 2.0)
    angle = np.asarray(result["O"])
    assert np.asarray(result["joint.O.effort"]) == pytest.approx(-most * np.sin(angle), abs=1e-8 * most)
    assert result.number("joint.O.effort @ max")[0] == pytest.approx(most, rel=1e-8)
    assert result.number("joint.O.effort @ rms")[0] == pytest.approx(most / math.sqrt(2.0), rel=1e-8)


def run_beside(folder: Path, offset: float, frequency: float, drive: str):
    """Return a run of the parallelogram whose third row is so far beside a change point, and the load on the rocker.

    The load, of 5 N*m at C, is a harmonic of so many Hz.
    """
    loaded = """
forces:
  load: {kind: joint_effort, joint: C, effort: {law: harmonic, amplitude: 5 N*m, pulsation: %r rad/s, phase: 20 deg}}
coordinates:
  aslant: {kind: point, point: B, along: [1, 1, 0]}
"""
    pulsation = 2.0 * math.pi * frequency
    result = run(folder, PARALLELOGRAM + loaded % pulsation, 5, 2.0 * (0.15 + offset), 0.2 * math.pi, drives=[drive])
    return result, 5.0 * np.sin(pulsation * np.asarray(result["t"]) + math.radians(20.0))


@pytest.mark.parametrize("drive", ["O", "C", "aslant"])
@pytest.mark.parametrize(("frequency", "offset"), [(0.0, 0.0), (60.0, 0.0), (200.0, 1e-6)])
def test_efforts_at_change_points_carry_loads_that_change_fast(tmp_path, drive, frequency, offset):
    """The power of the drive is that of the weights and of the load, which turns with the crank."""
    result, load = run_beside(tmp_path, offset, frequency, drive)
    most, angle = G * R * (MASSES[0] / 2.0 + MASSES[1] + MASSES[2] / 2.0), np.asarray(result["O"])
    way = R * (-np.cos(angle) - np.sin(angle)) / math.sqrt(2.0) if drive == "aslant" else np.ones(5)
    effort = np.asarray(result[f"coordinate.{drive}.effort"])
    assert effort * way == pytest.approx(-most * np.sin(angle) - load, abs=1e-9 * most)
    assert any("no finite forces of the loops" in note for note in result.notes()) == (offset == 0.0)


@pytest.mark.parametrize("frequency", [0.0, 60.0])
@pytest.mark.parametrize("offset", [6e-4, 1e-7])
def test_forces_next_to_change_points_are_those_that_turn_the_rocker(tmp_path, offset, frequency):
    """The pin at B carries half of the coupler, and along its line what the moments about C ask for: without bounds."""
    result, load = run_beside(tmp_path, offset, frequency, "O")
    angle = float(np.asarray(result["O"])[2])
    x, y = -R * math.sin(angle), R * math.cos(angle)
    half = MASSES[1] * (G - (2.0 * math.pi) ** 2 * y) / 2.0
    along = (x * half + x / 2.0 * MASSES[2] * G - load[2]) / y
    assert np.asarray(result["loop.B.force.y"])[2] == pytest.approx(-half, rel=1e-7)
    assert np.asarray(result["loop.B.force.x"])[2] == pytest.approx(-along, rel=1e-7)
    assert result.figures["equilibrium"] < 1e-12
    assert not result.notes()


@pytest.mark.parametrize("offset", [0.0, -1e-6, 1e-4])
def test_accelerations_at_a_change_point_are_those_of_the_smooth_motion(tmp_path, offset):
    """Mirrored at the line O C the motion is the same one backwards: the rocker's angle is odd in the crank's, O.

    So its acceleration is ``c O w^2`` but for terms in O^3, with c = -0.115494 by differences of the closed form to 50
    digits, and the torque is odd, too.
    """
    w = 2.0 * math.pi
    end = 2.0 * (1.0 + offset) / w
    result = run(tmp_path, FOUR_BAR % "1 m", 5, end, -1.0, start={"C": "0.43 rad", "A": "0.57 rad"})
    acceleration, angle = np.asarray(result["joint.C.acceleration"])[2], np.asarray(result["O"])[2]
    assert acceleration == pytest.approx(-0.115494 * angle * w**2, abs=1e-8 * w**2 + 1e-5 * abs(angle) * w**2)
    assert abs(np.asarray(result["joint.O.effort"])[2]) < (1e-9 + abs(angle)) * w**2


@pytest.mark.parametrize("shorter", [1e-9, 1e-6])
def test_a_motion_that_turns_beside_a_singular_position_is_not_taken_for_one_that_passes_it(tmp_path, shorter):
    """With a crank so much shorter the bars are never in line: B stays on its side of the line A C.

    Where it is follows from the law of cosines; 1e-3 rad beside the line its rounding leaves 1e-10.
    """
    crank, coupler, rocker = 0.25 - shorter, 0.875, 0.375

    def b(angle):
        a = crank * np.exp(1j * angle)
        apart = abs(a - D)
        return D + (a - D) / apart * rocker * np.exp(
            1j * np.arccos((apart**2 + rocker**2 - coupler**2) / (2.0 * apart * rocker))
        )

    drawn = 2.0
    a = crank * np.exp(1j * drawn)
    points = {"A": a, "B": b(drawn)}
    places = {name: f"[{float(z.real)!r} m, {float(z.imag)!r} m]" for name, z in points.items()}
    text = FOUR_BAR % "1 m"
    text = text.replace("[-250 mm, 0]", places["A"]).replace("[625 mm, 0]", places["B"])
    beyond = math.pi - drawn + 1e-3
    result = run(tmp_path, text, 5, 2.0 * beyond / (2.0 * math.pi), 0.0)
    there = b(np.asarray(result["O"]) + drawn)
    assert np.asarray(result["point.B.position.x"]) == pytest.approx(there.real, abs=1e-8)
    assert np.asarray(result["point.B.position.y"]) == pytest.approx(there.imag, abs=1e-8)


SLIDER_CRANK = """
pinarm: 1
gravity: none
planar:
  points: {O: [0, 0], A: [250 mm, 0], B: [1 m, 0]}
  ground: [O]
  links: {crank: {points: [O, A], mass: 1 kg}, rod: {points: [A, B], mass: 1 kg}, piston: {points: [B], mass: 1 kg}}
  sliders: {x: {link: piston, along: [O, B]}}
"""
R, L = 0.25, 0.75


def told(result, what: str) -> float:
    """Return to which part of their largest values a note says that something is known; 0 where none says so."""
    for note in result.notes():
        if found := re.search(rf"{what} (?:to ([^ ,]+)|(not at all)),", note):
            return 1.0 if found[2] else float(found[1])
    return 0.0


@pytest.mark.parametrize("way", [1e-6, 1e-10])
def test_velocities_of_a_crank_that_its_piston_drives_at_the_dead_centre(tmp_path, way):
    """``1 - cos(O) = way (2 L - way) / (2 r (r + L - way))``, by the law of cosines."""
    (tmp_path / "slider_crank.yaml").write_text(SLIDER_CRANK)
    problem = {"kind": "state", "hold": {"x": f"{-way!r} m"}, "velocity": {"x": "-1 m/s"}, "drives": ["x"],
               "start": {"O": "0.1 rad", "A": "-0.13 rad"}}  # fmt: skip
    scenario = {"pinarm": 1, "mechanism": str(tmp_path / "slider_crank.yaml"), "problem": problem, "outputs": ["O"]}
    with pinarm.file_root(tmp_path):
        result = pinarm.run(scenario)
    angle = 2.0 * math.asin(math.sqrt(way * (2.0 * L - way) / (4.0 * R * (R + L - way))))
    place = R + L - way - R * math.cos(angle)
    velocity = 1.0 / (R * math.sin(angle) * (1.0 + R * math.cos(angle) / place))
    error = abs(abs(float(np.asarray(result["joint.O.velocity"])[0])) / velocity - 1.0)
    assert error <= told(result, "velocities") + 1e-9
    assert told(result, "velocities") > (0.1 * np.finfo(float).eps / way if way < 1e-7 else -1.0)
