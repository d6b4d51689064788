"""Numbers that a motion is reduced to, of functions whose numbers are known."""

import numpy as np
import pytest

from pinarm.use.study.batch.reductions import ColumnReduction

T = np.linspace(0.0, 2.0 * np.pi, 4001)
WAVE = 2.0 + 3.0 * np.sin(T)


@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        ("min", -1.0), ("max", 5.0), ("largest", 5.0), ("mean", 2.0), ("rms", np.sqrt(4.0 + 4.5)), ("median", 2.0),
        ("start", 2.0), ("end", 2.0), (0, -1.0), (100, 5.0), (75.0, 2.0 + 3.0 * np.sin(np.pi / 4)),
    ],
)  # fmt: skip
def test_of_a_wave_in_closed_form(measure: str | float, expected: float) -> None:
    assert ColumnReduction("x", "largest").of(T, -WAVE) == pytest.approx(5.0, abs=1e-5)  # of both signs
    # one in 4000 instants: extremes off by 1e-6, shares of instants by 1e-3
    assert ColumnReduction("x", measure).of(T, WAVE) == pytest.approx(expected, abs=2e-3)


def test_a_mean_is_over_time_not_over_instants() -> None:
    t = np.array([0.0, 0.1, 0.2, 3.0])
    assert ColumnReduction("x", "mean").of(t, t) == pytest.approx(1.5, rel=1e-14)
    assert ColumnReduction("x", "rms").of(np.array([1.0]), np.array([-4.0])) == 4.0


def test_measures_are_asked_alone_or_in_a_list() -> None:
    asked = ColumnReduction.read({"a": "max", "b": ["min", 95]})
    assert [one.label for one in asked] == ["max a", "min b", "95 % b"]
