"""Narrow parts of formulas between two places at which they switch."""

import numpy as np
import pytest

import pinarm

A, W, HALVES = 0.5, 24.8, 22
"""Amplitude and pulsation of a slide, and over how many halves of a period it is looked at."""

LEVEL = 0.02
"""Height below which ``|v|`` is looked at, relative to the largest: 1.6 ms about each of 22 reversals in 2.8 s."""


@pytest.fixture(scope="module")
def result() -> pinarm.Result:
    planar = {
        "points": {"O": [0, 0], "P": ["1 m", 0]}, "ground": ["O"],
        "links": {"c": {"points": ["P"], "mass": "2 kg"}}, "sliders": {"x": {"link": "c", "along": ["O", "P"]}},
    }  # fmt: skip
    law = {"law": "harmonic", "amplitude": f"{A} m", "pulsation": f"{W} rad/s", "phase": "0.3 rad"}
    time = {"end": f"{HALVES * np.pi / W!r} s", "samples": 2}
    return pinarm.run({
        "pinarm": 1, "mechanism": {"pinarm": 1, "planar": planar, "gravity": "none"}, "outputs": ["x"],
        "symbols": {"low": f"min(abs(joint.x.velocity), {LEVEL * A * W!r} m/s)", "fast": "abs(joint.x.velocity)"},
        "problem": {"kind": "inverse", "time": time, "motion": {"x": law}},
    })  # fmt: skip


@pytest.mark.parametrize("name", [
    "low", f"fast if fast < {LEVEL * A * W!r} m/s else {LEVEL * A * W!r} m/s",
])  # fmt: skip
class TestLeastOfASpeedAndALevel:
    """``min(V |cos p|, c)`` with ``s = asin(c/V)``: mean ``2/pi (V (1 - cos s) + c (pi/2 - s))``, and it falls to 0."""

    def test_its_mean(self, result: pinarm.Result, name: str) -> None:
        value, error = result.number(f"{name} @ mean")
        s = np.arcsin(LEVEL)
        exact = 2.0 / np.pi * A * W * ((1.0 - np.cos(s)) + LEVEL * (0.5 * np.pi - s))
        assert abs(value - exact) <= error < 1e-9 * exact

    def test_its_least_value(self, result: pinarm.Result, name: str) -> None:
        value, error = result.number(f"{name} @ min")
        assert 0.0 <= value <= error + 1e-11 < 1e-6
