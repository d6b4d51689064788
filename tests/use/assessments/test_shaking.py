"""Shaking force of a rotor in closed form, and of a slider-crank against the discrete Fourier transform of its rows."""

from math import hypot, pi

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError

ROTOR, SLIDER_CRANK = "scenarios/rotor_vertical.yaml", "scenarios/slider_crank_gas.yaml"
ROUNDING = 1e-10
"""Relative: a loop closed to 1e-13 at speeds of 300 rad/s."""


@pytest.fixture(scope="module")
def rotor() -> pinarm.Result:
    return pinarm.run(ROTOR, {"shaking": {"about": "base", "harmonics": 3}, "problem.time.samples": 21})


def test_an_unbalanced_rotor_shakes_with_m_e_w2_once_a_turn(rotor: pinarm.Result) -> None:
    result = rotor
    force, moment = 12 * 0.5e-3 * (100 * pi) ** 2, hypot(2e-4, 1e-4) * (100 * pi) ** 2
    numbers = {name: float(series.values[0]) for name, series in result.sections["shaking"].numbers.items()}
    assert numbers["force.norm.peak"] == pytest.approx(force, rel=ROUNDING)
    assert numbers["force.x.rms"] == pytest.approx(force / 2**0.5, rel=ROUNDING)
    assert numbers["moment.norm.rms"] == pytest.approx(moment, rel=ROUNDING)
    section = result.sections["shaking"]
    told = {row[0]: row for row in section.tables[0].rows}["force.norm"]
    assert told[2:] == tuple(of[f"force.norm.{name}"] for name in ("peak", "rms") for of in (numbers, section.errors))
    first, *higher = np.array(result.sections["shaking"].tables[1].rows)[:, 2:]
    assert first == pytest.approx([force, force, 0, moment, moment, 0], rel=ROUNDING, abs=1e-9)
    assert np.abs(higher).max() < ROUNDING * force


@pytest.mark.slow
def test_harmonics_of_a_slider_crank_are_those_of_its_rows() -> None:
    result = pinarm.run(SLIDER_CRANK, {"shaking": {"harmonics": 8}})
    rows = np.array(result.sections["shaking"].tables[1].rows)
    # one row an angle: the sampled force of a smooth steady motion has no harmonics left beyond 360
    force = -result["dynamic.all.force.x"].values[:-1]
    amplitudes = 2 * np.abs(np.fft.rfft(force)[1:9]) / len(force)
    assert rows[:, 0].tolist() == [1, 2, 3, 4, 5, 6, 7, 8]
    assert rows[:, 1] == pytest.approx(2 * pi / 40e-3 * rows[:, 0], rel=1e-12)
    assert rows[:, 2] == pytest.approx(amplitudes, rel=1e-8, abs=1e-8 * amplitudes.max())


@pytest.mark.slow
def test_a_run_that_is_no_whole_period_has_no_harmonics() -> None:
    result = pinarm.run(SLIDER_CRANK, {"shaking": {"harmonics": 2}, "problem.time": {"end": "13 ms", "samples": 21}})
    with pytest.raises(InputError, match="no whole number of periods"):
        _ = result.sections


@pytest.mark.slow
def test_the_counterweights_of_berkof_and_lowen_are_found() -> None:
    """Crank: (m2/2 + m3/2) 100 mm at 60 mm behind it; rocker: (m4/2 + m3/2) 250 mm at 100 mm behind it."""
    weights = {"crank": {"point": "W2", "mass": "1 kg"}, "rocker": {"point": "W4", "mass": "1 kg"}}
    find = {"for": {f"payloads.{name}.mass": "1 kg" for name in weights},
            "so_that": {"dynamic.all.force.x": "0 N", "dynamic.all.force.y": "0 N"}}  # fmt: skip
    result = pinarm.run("scenarios/four_bar_shaking.yaml", {"payloads": weights, "find": find})
    assert result.figures["payloads.crank.mass [kg]"] == pytest.approx((0.5 + 1.75) * 100 / 60, rel=1e-12)
    assert result.figures["payloads.rocker.mass [kg]"] == pytest.approx((1.25 + 1.75) * 250 / 100, rel=1e-12)
    assert result.number("shaking.force.norm.peak")[0] < 1e-11
    section = result.sections["shaking"]
    assert "the shaking force is balanced: it is 0 but for rounding" in section.remarks
    assert not section.graphs  # no picture of rounding


@pytest.mark.parametrize(("model", "rotors"), [("backlash", True), ("mechanism", False)])
def test_a_remark_says_that_the_spin_of_rotors_has_no_part_in_it(model: str, rotors: bool) -> None:
    scenario = {"pinarm": 1, "mechanism": f"models/servo/{model}.yaml", "shaking": {}, "outputs": ["x"],
                "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 3}}}  # fmt: skip
    remarks = pinarm.run(scenario).sections["shaking"].remarks
    assert any("the spin of rotors" in remark for remark in remarks) == rotors
