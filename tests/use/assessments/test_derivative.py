"""Extrapolated differences of functions whose derivatives are known, with and without noise and kinks."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import cos, exp, sin

import numpy as np
import pytest

from pinarm.arrays import Array
from pinarm.errors import DynamicsError
from pinarm.use.assessments.derivatives import Derivative, Input, derivatives
from pinarm.use.assessments.sensitivity import LEVEL
from pinarm.use.cases.case import WORTH, Row

UNTOLD = (np.nan,) * len(WORTH)


@dataclass(frozen=True)
class Function:
    """A function of inputs about 0, in place of runs."""

    function: Callable[..., Sequence[float]]
    inputs: Sequence[Input]

    def rows(self, changes: Array) -> Iterator[Row]:
        for change in changes.tolist():
            try:
                yield Row((*self.function(*change), *UNTOLD))
            except DynamicsError as error:
                yield Row((), error.message)


def by_inputs(
    function: Callable[..., Sequence[float]], step: float, noise: Array, count: int
) -> list[list[Derivative]]:
    varied = Function(function, [Input(f"x{k}", f"x{k}", 0.0, 1.0, None) for k in range(count)])
    return derivatives(varied, np.array(function(*[0.0] * count)), lambda _: step, noise)


def one(function: Callable[[float], float], step: float, noise: float = 0.0) -> Derivative:
    [[found]] = by_inputs(lambda h: [function(h)], step, np.array([noise]), 1)
    return found


@pytest.mark.parametrize(
    ("function", "exact"),
    [(lambda h: exp(1.0 + h), exp(1.0)), (lambda h: sin(0.7 + h), cos(0.7)), (lambda h: (2.0 + h) ** 6, 192.0),
     (lambda h: 1.0 / (1.0 + h) ** 3, -3.0), (lambda h: 5.0, 0.0)],
)  # fmt: skip
def test_it_is_exact_to_its_error(function: Callable[[float], float], exact: float) -> None:
    found = one(function, 0.0139, 1e-13)
    assert abs(found.value - exact) <= found.error
    assert found.error < 1e-8 * max(abs(exact), 1.0)
    assert not found.kink


@pytest.mark.parametrize("seed", range(3))
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


@pytest.mark.parametrize("bound", [1e-2, 1e-5, 1e-9])
def test_steps_that_a_bound_of_noise_makes_too_large_are_not_believed(bound: float) -> None:
    """``Σ a sin(w h + p)`` and ``cos(p (1 + h)^(1/2))`` with a 30th of the noise, or less, that steps are chosen by."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        scattered, (a, w, p) = rng.uniform(0.0, bound / 30.0), rng.uniform((0.0, 1.0, 0.0), (1.0, 12.0, 6.0), (3, 3)).T
        turned = rng.uniform(2.0, 200.0)
        for function, exact in (
            (lambda h, a=a, w=w, p=p: float(a @ np.sin(w * h + p)), float((a * w) @ np.cos(p))),
            (lambda h, turned=turned: cos(turned * (1.0 + h) ** 0.5), -0.5 * turned * sin(turned)),
        ):
            found = one(lambda h, of=function, s=scattered: of(h) + s * rng.uniform(-1.0, 1.0), bound**LEVEL, bound)
            assert not found.kink
            assert abs(found.value - exact) <= found.error
