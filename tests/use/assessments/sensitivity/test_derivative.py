"""Extrapolated differences of functions whose derivatives are known, with and without noise and kinks."""

from math import cos, exp, sin

import numpy as np
import pytest

from pinarm.errors import DynamicsError
from pinarm.use.assessments.sensitivity.derivative import Derivative, derivatives

NOTHING = np.zeros(1)


def one(function: object, step: float, noise: float = 0.0) -> Derivative:
    def numbers(h: float) -> np.ndarray:
        return np.array([function(h)])  # type: ignore[operator]

    [found] = derivatives(numbers, numbers(0.0), step, np.array([noise]))
    return found


@pytest.mark.parametrize(
    ("function", "exact"),
    [(lambda h: exp(1.0 + h), exp(1.0)), (lambda h: sin(0.7 + h), cos(0.7)), (lambda h: (2.0 + h) ** 6, 192.0),
     (lambda h: 1.0 / (1.0 + h) ** 3, -3.0), (lambda h: 5.0, 0.0)],
)  # fmt: skip
def test_it_is_exact_to_its_error(function: object, exact: float) -> None:
    found = one(function, 0.0139, 1e-13)
    assert abs(found.value - exact) <= found.error
    assert found.error < 1e-8 * max(abs(exact), 1.0)
    assert not found.kink


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_in_its_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    found = one(lambda h: exp(h) + rng.uniform(-1e-8, 1e-8), 0.07, 1e-8)
    assert abs(found.value - 1.0) <= found.error < 1e-5
    assert not found.kink


@pytest.mark.parametrize(("below", "above"), [(0.0, 1.0), (-2.0, 3.0), (1.0, 1.1)])
def test_a_kink_has_two_derivatives(below: float, above: float) -> None:
    found = one(lambda h: (above if h > 0 else below) * sin(h), 0.01, 1e-14)
    assert found.kink
    assert (found.left, found.right) == pytest.approx((below, above), abs=1e-6)
    assert found.value == pytest.approx(max(below, above, key=abs), abs=1e-6)


@pytest.mark.parametrize("distance", [0.5, 0.1, 0.02])
def test_a_kink_within_the_first_step_is_avoided_by_smaller_ones(distance: float) -> None:
    step = 0.01
    found = one(lambda h: 3.0 * h + max(h - distance * step, 0.0), step, 1e-15)
    assert found.value == pytest.approx(3.0, abs=2 * found.error)
    assert found.error < 1e-6


def test_steps_are_shortened_to_where_runs_succeed() -> None:
    def narrow(h: float) -> float:
        if abs(h) > 1e-3:
            raise DynamicsError("too far")
        return exp(h)

    assert one(narrow, 0.01, 1e-14).value == pytest.approx(1.0, abs=1e-9)
    with pytest.raises(DynamicsError, match="too far"):
        one(narrow, 10.0)


def test_each_number_has_its_own_error() -> None:
    def numbers(h: float) -> np.ndarray:
        return np.array([exp(h), exp(300.0 * h)])

    found = derivatives(numbers, numbers(0.0), 0.01, np.full(2, 1e-14))
    assert [each.value for each in found] == pytest.approx([1.0, 300.0], rel=1e-6)
    assert found[0].error < 1e-10
