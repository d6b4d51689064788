"""Inputs drawn within their tolerances: how numbers are distributed, and which input makes them vary.

A tolerance ±t is that of a normal distribution with the standard deviation ``t/3``, or of a uniform one from -t to t,
with ``t/√3``. Independent inputs make of a number f, where it is linear, the variance ``Σ (df/dx_i)² σ_i²``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.use.assessments.sensitivity.variation import Varied
from pinarm.use.cases.case import Row

DistributionName = Literal["normal", "uniform"]

DEVIATION: dict[DistributionName, float] = {"normal": 1.0 / 3.0, "uniform": 3.0**-0.5}
"""Standard deviation of an input, relative to its tolerance."""


SOBOL = ("S1", "S1_conf", "ST", "ST_conf")
"""Names by which SALib tells indices and their intervals."""


@dataclass(frozen=True)
class Samples:
    """Numbers of runs with drawn inputs.

    Attributes:
        values: Of the runs that could be solved [SI], shape (n, m).
        failures: Why others could not.
    """

    values: Array
    failures: Sequence[str]


def changes_of(draws: Array, tolerances: Array, distribution: DistributionName) -> Array:
    """Return changes of inputs, shape (n, k), from numbers that are spread evenly between 0 and 1, of that shape."""
    if distribution == "uniform":
        return np.asarray((2.0 * draws - 1.0) * tolerances)
    from scipy.special import ndtri

    return np.asarray(ndtri(draws) * tolerances * DEVIATION["normal"])


def monte_carlo(varied: Varied, count: int, seed: int, distribution: DistributionName) -> Samples:
    """Return the numbers of runs whose inputs are drawn independently."""
    tolerances = np.array([of.tolerance for of in varied.inputs])
    draws = np.random.default_rng(seed).random((count, len(tolerances)))
    values, failures = list[tuple[float, ...]](), list[str]()
    for row in varied.rows(changes_of(draws, tolerances, distribution)):
        if row.error:
            failures.append(row.error)
        else:
            values.append(row.taken)
    if len(values) < 2:
        raise InputError(
            f"{len(failures)} of {count} runs within the tolerances cannot be solved: {failures[0]}",
            hint="smaller tolerances",
        )
    return Samples(np.array(values), failures)


@dataclass(frozen=True)
class SobolIndices:
    """Sobol' indices of numbers by inputs, each of shape (m, k), with half widths of their 95 % intervals.

    Those of numbers that do not vary but for noise are NaN.

    Attributes:
        first: Part of the variance that an input makes by itself.
        first_error: Its interval.
        total: Part of the variance that it has any share in.
        total_error: Its interval.
    """

    first: Array
    first_error: Array
    total: Array
    total_error: Array


def sobol_indices(varied: Varied, count: int, seed: int, distribution: DistributionName, noise: Array) -> SobolIndices:
    """Return the Sobol' indices of the numbers, from ``count * (k + 2)`` runs by Saltelli's scheme.

    ``noise``, shape (m,), is what may change irregularly in the numbers from run to run: how far it is shared among the
    inputs says nothing.

    Source: Saltelli et al., Variance based sensitivity analysis of model output, Computer Physics Communications 181
    (2010), by SALib (Herman and Usher, Journal of Open Source Software, 2017).
    """
    try:
        from SALib.analyze import sobol as analysis
        from SALib.sample import sobol as sampling
    except ImportError:
        raise InputError(
            "Sobol' indices need SALib, which is not installed",
            hint="pip install 'pinarm[sensitivity]', or leave sobol out",
        ) from None
    k = len(varied.inputs)
    problem = {"num_vars": k, "names": [str(j) for j in range(k)], "bounds": [[0.0, 1.0]] * k}
    draws = sampling.sample(problem, count, calc_second_order=False, seed=seed)
    inner = np.clip(draws, 1e-12, 1.0 - 1e-12)  # Sobol's first point is 0, where a normal distribution has no end
    changes = changes_of(inner, np.array([column.tolerance for column in varied.inputs]), distribution)
    values = np.array([_taken(row) for row in varied.rows(changes)])
    varies = values.std(axis=0) > noise
    if not varies.any():
        raise InputError("no number varies within the tolerances: there are no Sobol' indices")
    centred = (values - values.mean(axis=0))[:, varies] / values.std(axis=0)[varies]
    always = [seed]  # SALib takes 0 for no seed, and a list with it for one
    analyses = [analysis.analyze(problem, column, calc_second_order=False, seed=always) for column in centred.T]
    indices = [np.full((len(varies), k), np.nan) for _ in SOBOL]
    for name, index in zip(SOBOL, indices, strict=True):
        index[varies] = [result[name] for result in analyses]
    return SobolIndices(*indices)


def _taken(row: Row) -> tuple[float, ...]:
    if row.error:
        raise InputError(
            f"a run within the tolerances cannot be solved: {row.error}",
            hint="smaller tolerances, or uniform ones, which end there",
        )
    return row.taken
