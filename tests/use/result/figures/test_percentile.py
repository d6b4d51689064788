"""Percentiles of curves whose distribution has a closed form."""

from collections.abc import Callable
from math import asin, exp, pi, sin

import numpy as np
import pytest

from pinarm.arrays import Array
from pinarm.use.result.figures.percentile import MOST, SmoothCurve, percentile

DWELL = 0.3
"""Where a curve begins to rise that is 0 before."""

CLOSED_FORMS: list[tuple[str, Callable[[Array], Array], float, float]] = [
    ("rising", np.exp, 0.7, exp(0.7)),
    ("falling", lambda t: np.exp(-t), 0.7, exp(-0.3)),
    ("there and back", lambda t: np.sin(pi * t), 0.95, sin(0.95 * pi / 2)),
    ("many turns", lambda t: np.sin(40 * pi * t), 0.75, sin(pi / 4)),
    ("kink", lambda t: np.abs(t - 1 / 3), 0.5, 0.25),
    ("kink", lambda t: np.abs(t - 1 / 3), 0.9, 2 / 3 - 0.1),
    ("dwell", lambda t: np.maximum(t - DWELL, 0.0), 0.2, 0.0),
    ("dwell", lambda t: np.maximum(t - DWELL, 0.0), 0.8, 0.5),
    ("jump within", lambda t: np.where(t < 0.377, 1.0 + t, 5.0 + t), 0.9, 5.9),
    ("root", np.sqrt, 0.5, 0.5**0.5),
    ("least", lambda t: np.cos(3 * t), 0.0, float(np.cos(3.0))),
    ("largest", lambda t: np.cos(3 * t - 1), 1.0, 1.0),
]  # fmt: skip


def between(low: float, high: float, at: Callable[[Array], Array], known: Array | None = None) -> SmoothCurve:
    rows = np.empty(0) if known is None else known
    return SmoothCurve(low, high, at, [], rows, at(rows))


@pytest.mark.parametrize(("name", "curve", "share", "value"), CLOSED_FORMS)
def test_percentiles_are_those_of_closed_forms_within_their_errors(
    name: str, curve: Callable[[Array], Array], share: float, value: float
) -> None:
    found, error = percentile([between(0.0, 1.0, curve)], share)
    # rounding of values of the size of 1 to 6, and of the roots that end the lengths
    assert abs(found - value) <= error + 1e-13
    assert error < 1e-8


def test_intervals_count_by_their_length() -> None:
    intervals = [between(0.0, 3.0, lambda t: t), between(0.0, 1.0, lambda t: 10.0 + t)]
    assert percentile(intervals, 0.25)[0] == pytest.approx(1.0, abs=1e-12)
    assert percentile(intervals, 0.95)[0] == pytest.approx(10.8, abs=1e-12)


def test_noise_ends_the_halving_and_is_in_the_error() -> None:
    points = []

    def rough(t: Array) -> Array:
        points.append(len(t))
        return np.asarray(t + 1e-6 * np.sin(1e9 * t))

    found, error = percentile([between(0.0, 1.0, rough)], 0.5)
    assert abs(found - 0.5) < 2e-6 and 1e-6 < error < 1e-3
    assert sum(points) < 17 * 4 * MOST


def test_a_sine_over_a_share_of_its_turn() -> None:
    """Below v it is for (asin(v) + pi/2)/pi of its length, which is asked of the value that is found."""
    value, _ = percentile([between(-pi / 2, pi / 2, np.sin)], 0.3)
    assert (asin(value) + pi / 2) / pi == pytest.approx(0.3, abs=1e-12)


def test_a_constant_is_not_halved_for_its_rounding() -> None:
    noise, states = np.random.default_rng(2), list[int]()

    def curve(t: Array) -> Array:
        states.append(len(t))
        return 1.0 + 2e-16 * noise.integers(0, 2, len(t))

    assert percentile([between(0.0, 1.0, curve)], 0.95)[0] == pytest.approx(1.0, abs=1e-14)
    assert sum(states) <= 51


def test_a_spike_that_a_row_is_in_is_not_missed() -> None:
    """Of 11 rows one is in it; for a thousandth of the length it is above 5: nodes of first pieces are not."""

    def spike(t: Array) -> Array:
        return np.asarray(10.0 * np.maximum(0.0, 1.0 - np.abs(t - 0.4) / 1e-3))

    found, error = percentile([between(0.0, 1.0, spike, np.linspace(0.0, 1.0, 11))], 0.999)
    assert abs(found - 5.0) <= error < 1e-6
