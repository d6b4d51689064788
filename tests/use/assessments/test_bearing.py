"""Bearings against printed worked examples, and against closed forms of an unbalanced rotor and a sliding pin."""

from math import pi
from pathlib import Path

import pytest

import pinarm
from pinarm.errors import InputError

SHAFT = """<robot name="shaft">
  <link name="base"/>
  <link name="shaft"><inertial><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="spin" type="continuous"><parent link="base"/><child link="shaft"/><axis xyz="0 0 1"/></joint>
</robot>"""
LOADED = """pinarm: 1
mechanism: shaft.urdf
gravity: none
problem:
  kind: inverse
  time: {end: 60 s, samples: 61}
  motion: {spin: {law: constant_speed, speed: 600 rpm}}
  drives: [spin]
  loads: {radial: {kind: wrench, point: shaft, force: [1 N, 0 N, 0 N], factor: {law: constant, value: 1 1}}}
outputs: [joint.spin.force.radial]
loads: {joints: {spin: {bearing: {C: 5590 N}}}, sets: []}
"""
ROUNDING = 1e-9
"""Relative: closed forms against quadrature at 1e-10."""


@pytest.fixture
def shaft(tmp_path: Path):
    (tmp_path / "shaft.urdf").write_text(SHAFT)
    (tmp_path / "shaft.yaml").write_text(LOADED)

    def numbers(values):
        section = pinarm.run(tmp_path / "shaft.yaml", values).sections["loads"]
        return {name: float(series.values[0]) for name, series in section.numbers.items()}, section

    return numbers


def test_mott_varying_load(shaft) -> None:
    """Mott, Machine Elements in Mechanical Design, example 14-6: mean effective load 597 lb at 600 rpm.

    650 lb for 30 min, 750 lb for 10 min, 250 lb for 20 min; here newtons and seconds.
    """
    steps = {"law": "steps", "points": [["0 s", "650 1"], ["30 s", "750 1"], ["40 s", "250 1"]]}
    found, _ = shaft({"problem.loads.radial.factor": steps})
    assert found["spin.load.mean"] == pytest.approx(597, abs=0.5)  # printed to three digits
    assert found["spin.load.mean"] == pytest.approx(
        ((30 * 650**3 + 10 * 750**3 + 20 * 250**3) / 60) ** (1 / 3), rel=ROUNDING
    )
    assert found["spin.rate.mean"] == pytest.approx(20 * pi, rel=ROUNDING)
    assert found["spin.load.peak"] == pytest.approx(750, rel=ROUNDING)


def test_jindal_combined_load(shaft) -> None:
    """Jindal, Machine Design, example 18-2: F_r 1250 N, F_a 625 N, X 0.56, Y 1.2, C 5590 N: 57.3 million turns."""
    found, section = shaft({
        "problem.loads.radial.force": ["1250 N", "0 N", "-625 N"],
        "loads.joints.spin.bearing": {"C": "5590 N", "X": 0.56, "Y": 1.2},
    })  # fmt: skip
    assert found["spin.load.mean"] == pytest.approx(1450, rel=ROUNDING)
    assert found["spin.life.turns"] / 1e6 == pytest.approx(57.3, abs=0.05)  # printed to three digits
    assert found["spin.life.time"] == pytest.approx(found["spin.life.turns"] / 10, rel=ROUNDING)  # 600 rpm
    assert any("57.3 million turns" in remark and "at 600 rpm" in remark for remark in section.remarks)


def test_exponent_of_rollers_and_the_limit_e(shaft) -> None:
    loads = {"problem.loads.radial.force": ["1250 N", "0 N", "-625 N"]}
    bearing = {"C": "5590 N", "p": "10/3", "X": 0.4, "Y": 1.5, "e": 0.6}
    found, _ = shaft(loads | {"loads.joints.spin.bearing": bearing})
    assert found["spin.life.turns"] == pytest.approx(1e6 * (5590 / 1250) ** (10 / 3), rel=ROUNDING)
    found, _ = shaft(loads | {"loads.joints.spin.bearing": bearing | {"e": 0.4}})
    assert found["spin.life.turns"] == pytest.approx(1e6 * (5590 / 1437.5) ** (10 / 3), rel=ROUNDING)


def test_the_mean_weighs_loads_by_turns_not_by_time(shaft) -> None:
    """A load that grows with the angle's rate n = 2 t: P = t, so that P_m³ = ∫ t³ 2t dt / ∫ 2t dt = 2/5 T³."""
    found, _ = shaft({
        "problem.motion.spin": {"law": "constant_acceleration", "acceleration": "2 rad/s^2"},
        "problem.loads.radial.factor": {"law": "constant_speed", "speed": "1 1/s"},
    })  # fmt: skip
    assert found["spin.load.mean"] == pytest.approx(60 * 0.4 ** (1 / 3), rel=ROUNDING)
    assert found["spin.rate.mean"] == pytest.approx(60, rel=ROUNDING)


def test_turns_of_an_oscillation_are_counted_in_both_directions(shaft) -> None:
    """Amplitude 1 rad, pulsation 2 pi: 4 rad a second, and kinks where the rate changes its sign."""
    found, _ = shaft({
        "problem.time": {"end": "2 s", "samples": 81},
        "problem.motion.spin": {"law": "harmonic", "amplitude": "1 rad", "pulsation": f"{2 * pi} rad/s"},
    })  # fmt: skip
    assert found["spin.rate.mean"] == pytest.approx(4, rel=ROUNDING)
    assert found["spin.load.mean"] == pytest.approx(1, rel=ROUNDING)
    assert found["spin.life.time"] == pytest.approx(1e6 * 5590**3 * 2 * pi / 4, rel=ROUNDING)


def test_a_bushing_wears_by_pressure_and_speed(shaft) -> None:
    """F = 100 |sin| N on 20 mm x 25 mm at 20 pi rad/s: mean of p v 2/pi of its peak."""
    wave = {"law": "harmonic", "amplitude": "100 1", "pulsation": f"{2 * pi / 60} rad/s"}
    found, _ = shaft({
        "problem.loads.radial.factor": wave,
        "loads.joints.spin": {"bushing": {"diameter": "20 mm", "length": "25 mm"}},
    })  # fmt: skip
    assert found["spin.pressure.peak"] == pytest.approx(100 / 5e-4, rel=ROUNDING)
    assert found["spin.speed.peak"] == pytest.approx(0.2 * pi, rel=ROUNDING)
    assert found["spin.pv.peak"] == pytest.approx(4e4 * pi, rel=ROUNDING)
    assert found["spin.pv.mean"] == pytest.approx(8e4, rel=ROUNDING)


@pytest.mark.parametrize(("values", "said"), [
    ({"problem.motion.spin": {"law": "constant", "value": "0 rad"}}, "does not turn"),
    ({"problem.loads": {}}, "carries no load"),
])  # fmt: skip
def test_without_turns_or_load_there_is_no_life(shaft, values, said) -> None:
    with pytest.raises(InputError, match=said):
        shaft(values)


def test_a_load_that_is_not_determined_has_no_life() -> None:
    bearing = {"C": "20 kN", "Y": 1.5}
    values = {"loads": {"joints": {"A": {"bearing": bearing}}, "sets": []}}
    with pytest.raises(InputError, match=r"joint.A.force.axial.*hyperstatic"):
        _ = pinarm.run("scenarios/slider_crank_gas.yaml", values).sections
