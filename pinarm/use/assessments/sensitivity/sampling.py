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
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.use.assessments.sensitivity.tables import Band, single
from pinarm.use.assessments.sensitivity.variation import Input, Varied
from pinarm.use.cases.case import Row
from pinarm.use.result.numbers import slug
from pinarm.use.result.section import Cell, Curve, Graph, Section, SectionTable

DistributionName = Literal["normal", "uniform"]

DEVIATION: dict[DistributionName, float] = {"normal": 1.0 / 3.0, "uniform": 3.0**-0.5}
"""Standard deviation of an input, relative to its tolerance."""


ENOUGH = 64
"""Base samples of Sobol' indices with which about 95 % are within their intervals: measured on sums, products and
Ishigami's function, 30 % are not with 2, up to 28 % with 16, and up to 15 % with 64."""

CERTAIN = 4.0
"""Standard errors of a drawn deviation, if the number is linear, beyond which it is another than that of
root-sum-square."""

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


def distribution(varied: Varied, bands: Sequence[Band], count: int, seed: int, kind: DistributionName) -> Section:
    """Return the distributions of numbers over drawn runs, with remarks, graphs, and standard deviations by name.

    Errors are half widths of 95 % intervals, plus the error of each number itself.
    """
    samples, inputs = monte_carlo(varied, count, seed, kind), varied.inputs
    rows, numbers, errors = list[tuple[Cell, ...]](), dict[str, Series](), dict[str, float]()
    for band, values in zip(bands, samples.values.T, strict=True):
        deviation, linear = float(values.std(ddof=1)), DEVIATION[kind] * band.rss(inputs)
        own, wide = max(band.noise, band.error or 0.0), _student(len(values))
        of_mean, of_deviation = deviation / len(values) ** 0.5, deviation_error(values)
        name = f"{slug(band.number)}.deviation"
        numbers[name], errors[name] = single(band.measured.unit, deviation), wide * of_deviation + own
        shares = [(x, off + own) for x, off in (quantile(values, share) for share in SHARES)]
        pairs = [(float(values.mean()), wide * of_mean + own), (deviation, errors[name]), (linear,), *shares]
        unit = str(band.measured.unit or "?")
        rows.append((band.number.label, unit, *(cell for pair in pairs for cell in pair)))
    named = ("mean", "deviation", "by root-sum-square", "2.5 %", "median", "97.5 %")
    columns = ["", "unit"]
    for k, heading in enumerate(named):
        columns += [heading] if k == 2 else [heading, f"{heading} ± 95 %"]
    title = f"Monte Carlo, {len(samples.values)} runs"
    table = SectionTable("monte_carlo", title, columns, (None,) * len(columns), rows, row_unit=1)
    graphs = [_graph(band, inputs, values, kind) for band, values in zip(bands, samples.values.T, strict=True)]
    return Section("", "", [table], numbers, _remarks(bands, inputs, samples, kind, seed), graphs, errors)


SHARES = (0.025, 0.5, 0.975)
"""Percentiles of drawn numbers, as parts of one."""

FEW_DRAWN = 100
"""Drawn runs with which about 95 % are within the intervals of means and deviations: of squares of normal numbers 93 %
and 83 % are then, and 89 % and 68 % with 20."""


def _student(count: int) -> float:
    """Return the half width of a 95 % interval of a mean by some numbers, in its standard errors."""
    from scipy.special import stdtrit

    return float(stdtrit(count - 1, 0.975))


def quantile(values: Array, share: float) -> tuple[float, float]:
    """Return a percentile of drawn numbers, shape (n,), and the half width of its 95 % interval, whatever they are.

    How many numbers are below the percentile of the distribution is binomial: the interval is from one of them to
    another. Of too few it has no end.

    Source: Conover, Practical Nonparametric Statistics, section 3.2.
    """
    from scipy.special import bdtrik

    n, value = len(values), float(np.quantile(values, share))
    low, high = (int(np.ceil(bdtrik(end, n, share))) for end in (0.025, 0.975))
    ends = np.concatenate([[-np.inf], np.sort(values), [np.inf]])
    return value, float(max(value - ends[low], ends[min(high, n) + 1] - value))


def _remarks(
    bands: Sequence[Band], inputs: Sequence[Input], samples: Samples, distribution: DistributionName, seed: int
) -> list[str]:
    """Return remarks on drawn runs: distribution, failed runs, small samples, and numbers that are not linear."""
    count, share = len(samples.values), {"normal": "a third", "uniform": "1/√3"}[distribution]
    said = [f"drawn inputs are {distribution}, with {share} of the tolerance as standard deviation, seed {seed}"]
    if samples.failures:
        failed, most = len(samples.failures), max(set(samples.failures), key=samples.failures.count)
        said.append(f"{failed} of {failed + count} drawn runs cannot be solved, and are left out: {most}")
    if count < FEW_DRAWN:
        said.append(f"± 95 % by fewer than {FEW_DRAWN} drawn runs are too small where numbers are skewed")
    for band, values in zip(bands, samples.values.T, strict=True):
        deviation, linear = float(values.std(ddof=1)), DEVIATION[distribution] * band.rss(inputs)
        if abs(deviation - linear) > CERTAIN * linear / (2.0 * (count - 1)) ** 0.5 + band.doubt(inputs):
            known = f"{deviation:.4g} ± {deviation_error(values):.1g}"
            said.append(
                f"{band.number.label}: the deviation is {known} and that of root-sum-square {linear:.4g}: "
                "it is not linear within the tolerances"
            )
    return said


def deviation_error(values: Array) -> float:
    """Return the standard error of the standard deviation of drawn numbers, shape (n,), by their fourth moment.

    The variance of ``s^2`` is ``(m4 - s^4 (n - 3)/(n - 1))/n``: of numbers that are distributed normally about
    ``2 s^4/n``, of squares of these seven times as much.
    """
    n, deviation = len(values), float(values.std(ddof=1))
    if deviation == 0.0:
        return 0.0
    fourth = float((((values - values.mean()) / deviation) ** 4).mean())
    return float(0.5 * deviation * ((fourth - (n - 3) / (n - 1)) / n) ** 0.5)


def _graph(band: Band, inputs: Sequence[Input], values: Array, distribution: DistributionName) -> Graph:
    """Return the share of drawn runs below a value, and that of a normal distribution by root-sum-square."""
    from scipy.special import ndtr

    label, deviation = band.number.label, DEVIATION[distribution] * band.rss(inputs)
    across = np.sort(values)
    shares = (np.arange(len(across)) + 0.5) / len(across)

    def curve(x: Array, share: Array, name: str) -> Curve:
        return Curve(Series(label, band.measured.unit, x), Series("share of runs below", DIMENSIONLESS, share), name)

    curves = [curve(across, shares, "Monte Carlo")]
    if deviation > 0.0:
        reach = 3.5 * deviation
        x = np.linspace(min(across[0], band.value - reach), max(across[-1], band.value + reach), 200)
        curves.append(curve(x, ndtr((x - band.value) / deviation), "normal, by root-sum-square"))
    return Graph(f"distribution_{slug(band.number)}", f"Distribution of {label}", curves)


def sobol_indices(varied: Varied, count: int, seed: int, distribution: DistributionName, noise: Array) -> Array:
    """Return the Sobol' indices of the numbers, from ``count * (k + 2)`` runs by Saltelli's scheme, shape (4, m, k).

    These are the part of the variance that an input makes by itself, the half width of its 95 % interval, the part that
    the input has any share in, and its half width; NaN of numbers that do not vary but for noise.

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
    indices = np.full((len(SOBOL), len(varies), k), np.nan)
    for name, index in zip(SOBOL, indices, strict=True):
        index[varies] = [result[name] for result in analyses]
    return indices


def _taken(row: Row) -> tuple[float, ...]:
    if row.error:
        raise InputError(
            f"a run within the tolerances cannot be solved: {row.error}",
            hint="smaller tolerances, or uniform ones, which end there",
        )
    return row.taken


def sobol(varied: Varied, bands: Sequence[Band], count: int, seed: int, kind: DistributionName) -> Section:
    """Return the Sobol' indices of all numbers, by name too, with half widths of their 95 % intervals."""
    indices = sobol_indices(varied, count, seed, kind, np.array([band.noise for band in bands]))
    rows, numbers, errors = list[tuple[Cell, ...]](), dict[str, Series](), dict[str, float]()
    for m, band in enumerate(bands):
        for k, of in enumerate(varied.inputs):
            cells = indices[:, m, k].tolist()
            rows.append((band.number.label, of.name, *cells))
            for order, at in (("first", 0), ("total", 2)):
                name = f"{slug(band.number)}.{order}.{of.name}"
                numbers[name], errors[name] = single(DIMENSIONLESS, cells[at]), cells[at + 1]
    columns = ("of", "to", "first order", "first order ± 95 %", "total", "total ± 95 %")
    few = f"± 95 % of Sobol' indices by fewer than {ENOUGH} base samples are too small: two indices of three are within"
    remarks = [few] * (count < ENOUGH) + [
        f"{band.number.label} does not vary within the tolerances but for its numerical error: it has no Sobol' indices"
        for band, first in zip(bands, indices[0], strict=True)
        if np.isnan(first).all()
    ]
    return Section("", "", [SectionTable("sobol", "Sobol' indices", columns, (None,) * 6, rows)], numbers, remarks,
                   errors=errors)  # fmt: skip
