"""Distributions of drawn inputs, and Sobol' indices of functions whose variances are known."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import pi
from statistics import NormalDist

import numpy as np
import pytest

from pinarm.arrays import Array
from pinarm.errors import DynamicsError, InputError
from pinarm.use.assessments.derivatives import Input
from pinarm.use.assessments.sensitivity import (
    DistributionName,
    changes_of,
    monte_carlo,
    quantile,
    sobol_indices,
)
from pinarm.use.cases.case import WORTH, Row

UNTOLD = (np.nan,) * len(WORTH)


@dataclass(frozen=True)
class Function:
    """A function of inputs about 0, in place of runs."""

    tolerances: Sequence[float]
    function: Callable[[Array], Sequence[float]]

    @property
    def inputs(self) -> list[Input]:
        return [Input(f"x{k}", f"arguments.x{k}", 0.0, t, None) for k, t in enumerate(self.tolerances)]

    def rows(self, changes: Array) -> Iterator[Row]:
        for change in changes:
            try:
                yield Row((*self.function(change), *UNTOLD))
            except DynamicsError as error:
                yield Row((), error.message)


@pytest.mark.parametrize(("distribution", "deviation"), [("normal", 1 / 3), ("uniform", 3**-0.5)])
def test_a_tolerance_is_a_distribution(distribution: DistributionName, deviation: float) -> None:
    draws = (np.arange(20000)[:, None] + 0.5) / 20000
    changes = changes_of(draws, np.array([0.6]), distribution)
    assert changes.mean() == pytest.approx(0.0, abs=1e-12)
    assert changes.std() == pytest.approx(0.6 * deviation, rel=1e-3)  # 20000 quantiles of the tails
    assert distribution == "normal" or np.abs(changes).max() <= 0.6


def test_a_sum_of_drawn_inputs_has_the_sum_of_variances() -> None:
    """n = 20000 draws know a deviation to 0.5 %: four standard errors."""
    values, _ = monte_carlo(Function([0.3, 0.4], lambda x: [x.sum(), 2 * x[0]]), 20000, 1, "normal")
    assert values.std(axis=0) == pytest.approx([0.5 / 3, 0.2], rel=0.02)


def test_runs_that_fail_are_counted() -> None:
    def half(x: Array) -> list[float]:
        if x[0] > 0:
            raise DynamicsError("torn")
        return [x[0]]

    values, failures = monte_carlo(Function([1.0], half), 500, 3, "uniform")
    assert len(values) + len(failures) == 500
    assert 200 < len(failures) < 300
    with pytest.raises(InputError, match=r"2 of 2 runs .* torn"):
        monte_carlo(Function([1.0], lambda x: half(np.ones(1))), 2, 0, "uniform")


def test_ishigami() -> None:
    """Ishigami and Homma 1990, f = sin x1 + 7 sin² x2 + 0.1 x3⁴ sin x1: its indices in closed form."""
    a, b = 7.0, 0.1
    parts = [0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8, b**2 * pi**8 * (1 / 18 - 1 / 50)]  # of x1, x2, and x1 with x3
    first, total = np.array([parts[0], parts[1], 0.0]), np.array([parts[0] + parts[2], parts[1], parts[2]])

    def ishigami(x: Array) -> list[float]:
        return [np.sin(x[0]) + a * np.sin(x[1]) ** 2 + b * x[2] ** 4 * np.sin(x[0])]

    found = sobol_indices(Function([pi] * 3, ishigami), 4096, 1, "uniform", np.zeros(1))
    assert found[0, 0] == pytest.approx(first / sum(parts), abs=0.02)
    assert found[2, 0] == pytest.approx(total / sum(parts), abs=0.02)
    assert (np.abs(found[0, 0] - first / sum(parts)) <= 1.5 * found[1, 0] + 1e-3).all()


def test_noise_has_no_indices() -> None:
    """sin² + cos² is 1: the last digits hang on x0, and are not what x0 does."""

    def numbers(x: Array) -> list[float]:
        return [np.sin(1.0 + x[0]) ** 2 + np.cos(1.0 + x[0]) ** 2, x[0] + x[1]]

    found = sobol_indices(Function([0.05, 0.05], numbers), 64, 0, "normal", np.full(2, 1e-13))
    assert np.isnan(found[:, 0]).all()
    assert np.isfinite(found[:, 1]).all()


@pytest.mark.parametrize("share", [0.025, 0.5, 0.975])
@pytest.mark.parametrize("power", [1, 2])
def test_percentiles_of_drawn_numbers_are_within_what_is_told(share: float, power: int) -> None:
    """Of normal numbers and their squares, 95 of 100 at least; of 20 numbers the ends have none."""
    point = NormalDist().inv_cdf(share if power == 1 else 0.5 + 0.5 * share) ** power
    draws = np.random.default_rng(5).normal(size=(400, 300)) ** power
    told = [quantile(each, share) for each in draws]
    assert np.mean([abs(value - point) <= error for value, error in told]) > 0.93  # 400 know it to 1 %
    assert np.median([error for _, error in told]) < 3.0
    assert np.isinf(quantile(draws[0, :20], share)[1]) == (share != 0.5)
