"""A rod of 2.5 kg m² turned by 1 rad in 2 s along the cubic, out of gravity: all in closed form.

Its acceleration is ``1.5 (1 - t)`` rad/s², so that ``∫ a² dt = 1.5``, and its speed has the peak 0.75 rad/s at 1 s.
"""

import re
import warnings
from collections.abc import Callable
from math import exp, inf, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.assessments.duty import Duty

LOAD, SQUARES = 2.5, 1.5
HEADING = (
    "name,mass [kg],stall_torque [N*m],rated_torque [N*m],rated_speed [rad/s],peak_torque [N*m],max_speed [rad/s],"
    "rotor_inertia [g*cm^2],temperature_rise,max_temperature,time_constant [s]\n"
)
SMALL, LARGE = "small,1,0.1,0.08,100,0.3,200,1000,100,150,300\n", "large,3,1,0.8,100,3,200,10000,100,150,300\n"
MOTION = "motion: {pivot: {law: polynomial, from: 0 rad, to: 1 rad, duration: 2 s, degree: 3}}"
ROUNDING = 1e-10
"""Relative: integrals of polynomials, and formulas of them."""


@pytest.fixture
def sized(scenario: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    """``sized("ratios: [50]")``: the section of the cubic's run."""

    def build(more: str, catalogue: str = HEADING + SMALL + LARGE, *changes: tuple[str, str]) -> Any:
        (folder / "motors.csv").write_text(catalogue)
        text = f"gravity: none\nsizing: {{drive: motor, catalogue: motors.csv, {more}}}\n"
        law = "motion: {pivot: {law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 1 rad/s^2}}"
        return scenario("inverse", text, (law, MOTION), *changes).run().sections["sizing"]

    return build


def ranking(section: Any) -> list[Any]:
    """Rows of all motors and ratios: those shown first, and the others."""
    return [cells for table in section.tables if table.name in ("motors", "others") for cells in table.rows]


def row(section: Any, motor: str, ratio: float) -> dict[str, Any]:
    rows = [dict(zip(section.tables[0].columns, cells, strict=True)) for cells in ranking(section)]
    [found] = [each for each in rows if each["motor"] == motor and each["ratio"] == ratio]
    return found


def test_the_best_ratio_for_an_inertia_matches_it_to_that_of_the_rotor(sized: Callable[..., Any]) -> None:
    section = sized("ratios: [50], efficiency: 1")
    ratios = {name: (ratio, rms) for name, ratio, rms, _ in section.tables[1].rows}
    assert ratios["small"][0] == pytest.approx(sqrt(LOAD / 1e-4), rel=ROUNDING)
    assert ratios["small"][1] == pytest.approx(2 * sqrt(LOAD * 1e-4) * sqrt(SQUARES / 2), rel=ROUNDING)


@pytest.mark.parametrize("ratio", [20.0, 300.0])
def test_torques_are_those_of_the_load_with_losses_and_of_the_rotor(sized: Callable[..., Any], ratio: float) -> None:
    found = row(sized(f"ratios: [{ratio}], efficiency: 0.8, rest: 3 s"), "small", ratio)
    driving, driven = (1e-4 * ratio + LOAD * gear / ratio for gear in (1 / 0.8, 0.8))  # for 1 s each, a = 1.5 (1 - t)
    assert found["rms torque"] == pytest.approx(sqrt((driving**2 + driven**2) * SQUARES / 2 / 5), rel=ROUNDING)
    assert found["peak torque"] == pytest.approx(1.5 * driving, rel=ROUNDING)
    assert found["peak speed"] == pytest.approx(0.75 * ratio, rel=ROUNDING)
    assert found["inertia ratio"] == pytest.approx(LOAD / (1e-4 * ratio**2), rel=ROUNDING)
    energies = [0.5 * (1e-4 * ratio**2 + LOAD * gear) * 0.75**2 for gear in (1 / 0.8, 0.8)]
    assert [found["energy"], found["regenerated"]] == pytest.approx(energies, rel=ROUNDING)


SWING, SPAN = 2.1, 2.3
"""Pulsation [rad/s] and length [s] of a run of ``q = sin(w t)``, which turns back within it, at no sample."""


def of_a_swing(ratio: float, inertia: float, gear: float) -> dict[str, float]:
    """Peaks and energies by hand: ``T = (J N + I g / N) a``, g = 1/0.8 where the motor drives, 0.8 where it brakes."""
    driving, braking = (inertia * ratio**2 + LOAD * loss for loss in (1.0 / gear, gear))
    turns = [0.0, *(np.pi / SWING * np.arange(0.5, 2.0, 0.5)), SPAN]  # speed and acceleration change signs
    rise = np.diff([0.5 * (SWING * np.cos(SWING * t)) ** 2 for t in turns])
    return {
        "peak_torque": SWING**2 * driving / ratio, "peak_speed": SWING * ratio,
        "energy": driving * rise[rise > 0.0].sum(), "regenerated": -braking * rise[rise < 0.0].sum(),
    }  # fmt: skip


def test_numbers_of_the_first_are_within_their_errors(sized: Callable[..., Any]) -> None:
    swing = f"motion: {{pivot: {{law: harmonic, amplitude: 1 rad, pulsation: {SWING} rad/s}}}}"
    span = ("time: {end: 2 s, samples: 9}", f"time: {{end: {SPAN} s, samples: 9}}")
    section = sized("ratios: [40], efficiency: 0.8", HEADING + LARGE, (MOTION, swing), span)
    for name, exact in of_a_swing(40.0, 1e-3, 0.8).items():
        assert abs(section.numbers[name].values[0] - exact) <= section.errors[name] < 1e-9 * exact
    margins = 3.0 / (SWING**2 * (1e-3 * 40.0 + LOAD / 0.8 / 40.0)), 200.0 / (40.0 * SWING)
    found = row(section, "large", 40.0)
    assert [found["torque margin"], found["speed margin"]] == pytest.approx(margins, rel=1e-11)
    assert abs(section.numbers["reserve"].values[0] - min(margins)) <= section.errors["reserve"] < 1e-9
    assert [cells[0] for cells in section.tables[2].rows[3:6]] == ["peak torque", "rms torque", "peak speed"]


def test_torques_are_those_of_a_drive_with_that_motor(scenario: Callable[..., Any], sized: Callable[..., Any]) -> None:
    """Another route: the motor as the drive of the mechanism, whose torque the engine gives."""
    found = row(sized("ratios: [40]", HEADING + LARGE), "large", 40.0)
    law = "motion: {pivot: {law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 1 rad/s^2}}"
    drive = "gravity: none\nchanges: {drives: {motor: {ratio: 40, rotor_inertia: 10000 g*cm^2}}}\n"
    run = scenario("inverse", drive, (law, MOTION)).run()
    assert found["rms torque"] == pytest.approx(run.number("drive.motor.torque @ rms")[0], rel=1e-9)
    assert found["peak torque"] == pytest.approx(run.number("drive.motor.torque @ peak")[0], rel=1e-9)


def test_a_drive_that_carries_nothing_is_told_and_divides_nothing_by_nothing(sized: Callable[..., Any]) -> None:
    """At a steady 9 rad/s and a ratio of 1000 a motor has no torque left, and needs none."""
    turning = "motion: {pivot: {law: constant_speed, speed: 9 rad/s}}"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        section = sized("ratios: [1000]", HEADING + SMALL, (MOTION, turning))
    assert row(section, "small", 1000.0)["torque margin"] == inf
    assert "nothing is sized: 'pivot' carries no load and does not accelerate in this run" in section.remarks


def test_motors_that_fail_say_why_and_those_that_fit_come_by_mass(sized: Callable[..., Any]) -> None:
    section = sized("ratios: [1, 100, 400]")
    verdicts = {(cells[1], cells[2]): cells[3] for cells in ranking(section)}
    assert verdicts["small", 100.0] == verdicts["large", 100.0] == "fits"
    assert re.match(r"needs \d+ % of its peak torque", verdicts["small", 1.0])
    assert "needs 150 % of its speed" in verdicts["large", 400.0]
    assert section.tables[0].rows[0][1] == "small"
    assert section.numbers["fitting"].values[0] == 2


def test_a_winding_warms_as_its_differential_equation_says() -> None:
    """Heat 1 for 2 s, then none for 6 s, for ever: the peak is ``(1 - e^(-2/5)) / (1 - e^(-8/5))``."""
    t, zero = np.linspace(0.0, 2.0, 50), np.zeros(50)
    for rest, peak in ((6.0, (1 - exp(-0.4)) / (1 - exp(-1.6))), (0.0, 1.0)):
        duty = Duty(None, None, t, zero, zero, zero, (0.0, 0.0), (0.0, 0.0), np.zeros((2, 4)), rest=rest)
        assert duty.warmest(np.ones(50), 5.0)[0] == pytest.approx(peak, rel=1e-13)


@pytest.mark.parametrize(
    ("catalogue", "words"),
    [
        (HEADING.replace("mass [kg]", "weight [kg]") + SMALL, ["no column 'mass'", "weight"]),
        (HEADING.replace("[rad/s]", "[kg]") + SMALL, ["no unit of this quantity", "rpm"]),
        (HEADING + SMALL.replace("0.3", "nan"), ["motors.csv:2", "finite number is missing", "peak_torque"]),
        (HEADING + SMALL.replace("0.3", "1e300"), ["motors.csv:2", "1e+300"]),
        (HEADING + SMALL.replace("0.3", "0.01"), ["rated_torque is beyond peak_torque"]),
        (HEADING + SMALL + SMALL, ["'small' twice"]),
        (HEADING + SMALL.replace("0.3", "0,3"), ["motors.csv:2", "cells, the heading", "decimal point"]),
    ],
)
def test_mistakes_in_a_catalogue_are_told(sized: Callable[..., Any], catalogue: str, words: list[str]) -> None:
    with pytest.raises(InputError) as error:
        sized("ratios: [50]", catalogue)
    told = f"{error.value.location} {error.value} {error.value.expected} {error.value.hint}"
    assert all(word in told for word in words)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("ratios: [0]", "ratios"), ("ratios: [50], ambient: 40 K", "no temperature"),
        ("ratios: [50], efficiency: 2", "efficiency"), ("ratios: '200:20'", "no range of ratios"),
    ],
)  # fmt: skip
def test_mistakes_in_what_is_asked_are_told(sized: Callable[..., Any], more: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        sized(more)


def test_a_drive_that_does_not_exist_is_told_by_a_run_too(sized: Callable[..., Any]) -> None:
    with pytest.raises(InputError, match="there is no drive 'moter'"):
        sized("ratios: [50]", HEADING + SMALL, ("drive: motor", "drive: moter"))


def test_an_elastic_drive_is_refused(scenario: Callable[..., Any], folder: Path) -> None:
    """Its joint does not follow the rotor, whose share of the effort no candidate's rotor can take the place of."""
    mechanism = folder / "pendulum.yaml"
    elastic = "efficiency: 1, rotor_inertia: 1e-5 kg*m^2, elasticity: {stiffness: 1e4 N*m/rad}"
    mechanism.write_text(mechanism.read_text().replace("efficiency: 0.8", elastic))
    (folder / "motors.csv").write_text(HEADING + SMALL)
    text = "sizing: {drive: motor, catalogue: motors.csv, ratios: [50]}\n"
    with pytest.raises(InputError, match="the drive 'motor' is elastic"):
        _ = scenario("forward", text, ("end: 5 s", "end: 0.1 s")).run().sections["sizing"]


HOIST = (
    '<robot name="hoist"><link name="base"/><joint name="z" type="prismatic"><parent link="base"/><child link="load"/>'
    '<axis xyz="0 0 1"/><limit lower="-5" upper="5" effort="1e6" velocity="100"/></joint>'
    '<link name="load"><inertial><mass value="60"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
)


@pytest.mark.parametrize(
    ("start", "end", "own"), [("0.9 m", "0 m", "1"), ("0.9 m", "0 m", "0.7"), ("0 m", "0.9 m", "1")]
)
def test_an_instant_of_rest_without_acceleration_has_the_power_of_the_motion_beside_it(
    tmp_path: Path, start: str, end: str, own: str
) -> None:
    """A load of 60 kg along the cycloid, which starts and ends with v = a = 0: let down it drives the motor throughout.

    ``T = g F / N + J N a`` with ``F = m (9.81 + a) > 0``, g = 1/0.7 upwards and 0.7 downwards.
    """
    (tmp_path / "hoist.urdf").write_text(HOIST)
    (tmp_path / "motors.csv").write_text(HEADING + "only,1,10,8,1000,60,2000,3000,100,150,300\n")
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: hoist.urdf\noutputs: [drive.d.torque]\n"
        f"changes: {{drives: {{d: {{joint: z, ratio: 80, efficiency: {own}}}}}}}\n"
        "problem: {kind: inverse, time: {end: 1.2 s, samples: 31}, "
        f"motion: {{z: {{law: cycloidal, from: {start}, to: {end}, duration: 1.2 s}}}}}}\n"
        "sizing: {drive: d, catalogue: motors.csv, ratios: [80], efficiency: 0.7}\n"
    )
    t, up = np.linspace(0.0, 1.2, 1201), start == "0 m"
    a = (1.0 if up else -1.0) * 2.0 * np.pi * 0.9 / 1.2**2 * np.sin(2.0 * np.pi * t / 1.2)
    torque = 60.0 * (9.81 + a) / 80.0 * (1.0 / 0.7 if up else 0.7) + 3e-4 * 80.0 * a
    sizing = pinarm.run(tmp_path / "s.yaml").sections["sizing"]
    told = {
        name: (float(sizing.numbers[name].values[0]), sizing.errors[name]) for name in ("peak_torque", "rms_torque")
    }
    exact = {
        "peak_torque": torque.max(),
        "rms_torque": sqrt((torque[:-1] ** 2).mean()),
    }  # of a trigonometric polynomial
    for name, (value, error) in told.items():
        assert abs(value - exact[name]) <= error + 1e-13 * exact[name]
        assert error <= 1e-9 * exact[name]
