"""Sensitivity of numbers of a run: derivatives by inputs with tolerances, and the bands that tolerances make.

With the derivatives D_i of a number and the tolerances t_i, its band is ``Σ |D_i| t_i`` in the worst case, and
``(Σ D_i² t_i²)^(1/2)`` by root-sum-square, where inputs are independent. Both are linear; runs at the two worst
corners, and drawn runs and Sobol' indices on request, show where that is not enough.

A tolerance ±t is that of a normal distribution with the standard deviation ``t/3``, or of a uniform one from -t to t,
with ``t/√3``. Independent inputs make of a number f, where it is linear, the variance ``Σ (df/dx_i)² σ_i²``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.records import Record
from pinarm.use.assessments.derivatives import (
    Derivative,
    Input,
    Tolerance,
    Variation,
    derivatives,
    inputs_of,
    varied_runs,
)
from pinarm.use.cases.case import Row
from pinarm.use.result.curve_figures import CurveFigure
from pinarm.use.result.number_accuracy import noise, rounding
from pinarm.use.result.numbers import AnyNumber, measured, read_number, slug
from pinarm.use.result.section import Cell, Curve, Graph, Section, SectionTable, numbered

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

DistributionName = Literal["normal", "uniform"]

DEVIATION: dict[DistributionName, float] = {"normal": 1.0 / 3.0, "uniform": 3.0**-0.5}
"""Standard deviation of an input, relative to its tolerance."""

NOT_LINEAR = 0.1
"""Difference between a corner and the linear band, relative to the band, that is worth a word."""

MOST_BARS = 20
"""Inputs that a ranking draws, the strongest."""

ENOUGH = 64
"""Base samples of Sobol' indices with which about 95 % are within their intervals: measured on sums, products and
Ishigami's function, 30 % are not with 2, up to 28 % with 16, and up to 15 % with 64."""

FEW_DRAWN = 100
"""Drawn runs with which about 95 % are within the intervals of means and deviations: of squares of normal numbers 93 %
and 83 % are then, and 89 % and 68 % with 20."""

CERTAIN = 4.0
"""Standard errors of a drawn deviation, if the number is linear, beyond which it is another than that of
root-sum-square."""

SHARES = (0.025, 0.5, 0.975)
"""Percentiles of drawn numbers, as parts of one."""

SOBOL = ("S1", "S1_conf", "ST", "ST_conf")
"""Names by which SALib tells indices and their intervals."""


class Band(Record, frozen=True):
    """Band of one number from the tolerances of all inputs.

    Attributes:
        number: The number.
        measured: Its value in the run.
        error: Bound of its numerical error [SI]; ``None`` where it is not estimated.
        noise: Irregular change of the number from run to run [SI].
        inputs: The inputs, k of them.
        slopes: Its derivatives by these.
        low: Its value at the corner of the tolerances where it is least if it is linear [SI].
        high: Its value at the corner where it is largest [SI].
        unsolved: Why a corner has no value; empty where both have one.
    """

    number: AnyNumber
    measured: Series
    error: float | None
    noise: float
    inputs: Sequence[Input]
    slopes: Sequence[Derivative]
    low: float
    high: float
    unsolved: str = ""

    @property
    def value(self) -> float:
        return float(self.measured.values[0])

    @property
    def unit(self) -> Unit | None:
        return self.measured.unit

    @cached_property
    def parts(self) -> Array:
        """``|D_i| t_i`` [SI], shape (k,)."""
        return np.array([abs(slope.value) * of.tolerance for of, slope in zip(self.inputs, self.slopes, strict=True)])

    @cached_property
    def doubts(self) -> Array:
        """Errors of a band by those of derivatives [SI], shape (k,)."""
        return np.array([slope.error * of.tolerance for of, slope in zip(self.inputs, self.slopes, strict=True)])

    @property
    def worst_case(self) -> CurveFigure:
        return CurveFigure(float(self.parts.sum()), float(self.doubts.sum()), self.unit)

    @property
    def rss(self) -> CurveFigure:
        return CurveFigure(float(np.linalg.norm(self.parts)), float(np.linalg.norm(self.doubts)), self.unit)

    @property
    def is_rounding(self) -> bool:
        """Whether all that the tolerances make of it may be errors of its derivatives."""
        return self.rss.value <= self.rss.error

    @property
    def doubt(self) -> float:
        """Possible difference of bands and runs of a linear number [SI]: errors of slopes, and noise."""
        return self.worst_case.error + 2.0 * self.noise

    def numbers(self) -> dict[str, CurveFigure]:
        """Return bands and derivatives by name."""
        name = slug(self.number)
        numbers = {f"{name}.worst_case": self.worst_case, f"{name}.rss": self.rss}
        for of, slope in zip(self.inputs, self.slopes, strict=True):
            numbers[f"{name}.by.{of.name}"] = CurveFigure(slope.value, slope.error, _unit_over(self.unit, of.si))
        return numbers

    @cached_property
    def ranking(self) -> list[tuple[str, float]]:
        """Inputs from the strongest on, each with its share in words, and its part ``|D_i| t_i`` [SI].

        There is none where all parts are rounding, and of one input.
        """
        if self.is_rounding or len(self.inputs) < 2:
            return []
        order, shares = np.argsort(-self.parts, kind="stable"), 100.0 * (self.parts / self.rss.value) ** 2
        return [(f"{self.inputs[k].name} {shares[k]:.3g} %", float(self.parts[k])) for k in order]

    def remarks(self) -> list[str]:
        """Return where the linear band is not the whole answer."""
        label, worst = self.number.label, self.worst_case.value
        ranked = ", ".join(words for words, _ in self.ranking)
        said = [f"{label} depends on {ranked} of root-sum-square"] if ranked else []
        said += [
            f"{label} has a kink in {of.name}: its derivative is {slope.left:.6g} below and {slope.right:.6g} above; "
            "the steeper one counts"
            for of, slope in zip(self.inputs, self.slopes, strict=True)
            if slope.kink
        ]
        if self.is_rounding:
            said.append(
                f"all that the tolerances make of {label} may be errors of its derivatives: no input has a share"
            )
        if self.unsolved:
            return [*said, f"{label} has no value at a corner of the tolerances: {self.unsolved}"]
        off = max(abs(self.value - self.low - worst), abs(self.high - self.value - worst))
        if off > NOT_LINEAR * worst + self.doubt and off > 1e-9 * abs(self.value):
            said.append(f"{label} is not linear within the tolerances: see its values at the corners")
        return said

    def effects(self) -> SectionTable:
        """Return the table of the effect of every input; shares are NaN where all effects are rounding."""
        shares = 100.0 * self.parts**2 / (np.nan if self.is_rounding else self.rss.value**2)
        rows: list[tuple[Cell, ...]] = []
        for of, slope, part, share in zip(self.inputs, self.slopes, self.parts.tolist(), shares.tolist(), strict=True):
            factor = of.unit.factor if of.unit else 1.0
            derivative = f"kink: {slope.left:.6g}, {slope.right:.6g}" if slope.kink else slope.value
            given = (of.name, str(of.unit or "1"), of.value / factor, of.tolerance / factor)
            rows.append((*given, str(_unit_over(self.unit, of.si) or "?"), derivative, slope.error, part, share))
        columns = ("", "unit", "value", "± tolerance", "unit of derivative", "derivative", "its error",
                   "± of the number", "% of root-sum-square")  # fmt: skip
        units = (*(None,) * 7, self.unit, None)
        title = f"{self.number.label}: what it depends on"
        return SectionTable(f"effects_{slug(self.number)}", title, columns, units, rows)

    def ranking_graph(self) -> Graph:
        """Return a bar graph of the largest effects of tolerances, in descending order."""
        label, (names, parts) = self.number.label, zip(*self.ranking[:MOST_BARS], strict=True)
        rank = Series("rank", DIMENSIONLESS, np.arange(1.0, len(parts) + 1.0))
        bars = Curve(Series(f"± {label}", self.unit, np.array(parts)), rank)
        title = f"{label}: what it depends on, with % of root-sum-square"
        return Graph(f"ranking_{slug(self.number)}", title, [bars], bars=names)


def _unit_over(unit: Unit | None, by: Unit) -> Unit | None:
    """Return the unit of a derivative, written as both are: ``N*m/kg``."""
    if unit is None or str(by) == "1":
        return unit
    quotient = Unit(unit.factor / by.factor, (unit / by).dimension)
    simple = "/" not in str(by)
    return Unit(quotient.factor, quotient.dimension, f"{unit}/{str(by).replace('*', '/')}") if simple else quotient


def band_table(bands: Sequence[Band]) -> SectionTable:
    """Return value, numerical error and bands of every number."""
    rows: list[tuple[Cell, ...]] = []
    for band in bands:
        error = "not estimated" if band.error is None else band.error
        ends = (band.worst_case.value, band.rss.value, band.low, band.high)
        rows.append((band.number.label, str(band.unit or "?"), band.value, error, *ends))
    columns = ("", "unit", "value", "numerical error", "± worst case", "± root-sum-square", "at least corner",
               "at largest corner")  # fmt: skip
    title = "Values, and their bands by the tolerances"
    return SectionTable("bands", title, columns, (None,) * len(columns), rows, row_unit=1)


def changes_of(draws: Array, tolerances: Array, distribution: DistributionName) -> Array:
    """Return changes of inputs, shape (n, k), from numbers that are spread evenly between 0 and 1, of that shape."""
    if distribution == "uniform":
        return np.asarray((2.0 * draws - 1.0) * tolerances)
    from scipy.special import ndtri

    return np.asarray(ndtri(draws) * tolerances * DEVIATION["normal"])


def monte_carlo(
    varied: Variation, count: int, seed: int, distribution: DistributionName
) -> tuple[Array, Sequence[str]]:
    """Return the numbers of runs whose inputs are drawn independently [SI], shape (n, m), and why others failed."""
    tolerances = np.array([of.tolerance for of in varied.inputs])
    draws = np.random.default_rng(seed).random((count, len(tolerances)))
    rows = [*varied.rows(changes_of(draws, tolerances, distribution))]
    values, failures = [row.taken for row in rows if not row.error], [row.error for row in rows if row.error]
    if len(values) < 2:
        raise InputError(
            f"{len(failures)} of {count} runs within the tolerances cannot be solved: {failures[0]}",
            hint="smaller tolerances",
        )
    return np.array(values), failures


def distribution(varied: Variation, bands: Sequence[Band], count: int, seed: int, kind: DistributionName) -> Section:
    """Return the distributions of numbers over drawn runs, with remarks, graphs, and standard deviations by name.

    Errors are half widths of 95 % intervals, plus the error of each number itself: of means by Student's distribution.
    """
    from scipy.special import stdtrit

    drawn, failures = monte_carlo(varied, count, seed, kind)
    solved, third = len(drawn), {"normal": "a third", "uniform": "1/√3"}[kind]
    wide = float(stdtrit(solved - 1, 0.975))
    remarks = [f"drawn inputs are {kind}, with {third} of the tolerance as standard deviation, seed {seed}"]
    if failures:
        most = max(set(failures), key=failures.count)
        remarks.append(f"{len(failures)} of {count} drawn runs cannot be solved, and are left out: {most}")
    if solved < FEW_DRAWN:
        remarks.append(f"± 95 % by fewer than {FEW_DRAWN} drawn runs are too small where numbers are skewed")
    rows, numbers, graphs = list[tuple[Cell, ...]](), dict[str, CurveFigure](), list[Graph]()
    for band, values in zip(bands, drawn.T, strict=True):
        deviation, linear = float(values.std(ddof=1)), DEVIATION[kind] * band.rss.value
        own, off = max(band.noise, band.error or 0.0), _deviation_error(values)
        known = CurveFigure(deviation, wide * off + own, band.unit)
        numbers[f"{slug(band.number)}.deviation"] = known
        mean = (float(values.mean()), wide * deviation / solved**0.5 + own)
        shares = [(x, apart + own) for x, apart in (quantile(values, share) for share in SHARES)]
        cells = (cell for pair in (mean, (deviation, known.error), (linear,), *shares) for cell in pair)
        rows.append((band.number.label, str(band.unit or "?"), *cells))
        graphs.append(_distribution_graph(band, values, linear))
        if abs(deviation - linear) > CERTAIN * linear / (2.0 * (solved - 1)) ** 0.5 + band.doubt:
            remarks.append(
                f"{band.number.label}: the deviation is {deviation:.4g} ± {off:.1g} and that of root-sum-square "
                f"{linear:.4g}: it is not linear within the tolerances"
            )
    columns = ["", "unit", "mean", "mean ± 95 %", "deviation", "deviation ± 95 %", "by root-sum-square"]
    columns += [name for end in ("2.5 %", "median", "97.5 %") for name in (end, f"{end} ± 95 %")]
    title = f"Monte Carlo, {solved} runs"
    table = SectionTable("monte_carlo", title, columns, (None,) * len(columns), rows, row_unit=1)
    return Section("", "", [table], remarks=remarks, graphs=graphs, **numbered(numbers))


def quantile(values: Array, share: float) -> tuple[float, float]:
    """Return a percentile of drawn numbers, shape (n,), and the half width of its 95 % interval, by the binomial test.

    Of too few numbers the interval has no end, and its half width is infinite.
    """
    from scipy.stats import quantile_test

    value, ends = float(np.quantile(values, share)), quantile_test(values, p=share).confidence_interval(0.95)
    width = float(np.max([value - ends.low, ends.high - value]))  # NaN without an end
    return value, np.inf if np.isnan(width) else width


def _deviation_error(values: Array) -> float:
    """Return the standard error of the standard deviation of drawn numbers, shape (n,), by their fourth moment.

    The variance of ``s^2`` is ``(m4 - s^4 (n - 3)/(n - 1))/n``: of numbers that are distributed normally about
    ``2 s^4/n``, of squares of these seven times as much.
    """
    n, deviation = len(values), float(values.std(ddof=1))
    if deviation == 0.0:
        return 0.0
    fourth = float((((values - values.mean()) / deviation) ** 4).mean())
    return float(0.5 * deviation * ((fourth - (n - 3) / (n - 1)) / n) ** 0.5)


def _distribution_graph(band: Band, values: Array, deviation: float) -> Graph:
    """Return the share of drawn runs below a value, and that of a normal distribution by root-sum-square."""
    from scipy.special import ndtr

    label, across = band.number.label, np.sort(values)

    def curve(x: Array, share: Array, name: str) -> Curve:
        return Curve(Series(label, band.unit, x), Series("share of runs below", DIMENSIONLESS, share), name)

    curves = [curve(across, (np.arange(len(across)) + 0.5) / len(across), "Monte Carlo")]
    if deviation > 0.0:
        reach = 3.5 * deviation
        x = np.linspace(min(across[0], band.value - reach), max(across[-1], band.value + reach), 200)
        curves.append(curve(x, ndtr((x - band.value) / deviation), "normal, by root-sum-square"))
    return Graph(f"distribution_{slug(band.number)}", f"Distribution of {label}", curves)


def sobol_indices(varied: Variation, count: int, seed: int, distribution: DistributionName, noise: Array) -> Array:
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
    changes = changes_of(inner, np.array([of.tolerance for of in varied.inputs]), distribution)
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


def sobol(varied: Variation, bands: Sequence[Band], count: int, seed: int, kind: DistributionName) -> Section:
    """Return the Sobol' indices of all numbers, by name too, with half widths of their 95 % intervals."""
    indices = sobol_indices(varied, count, seed, kind, np.array([band.noise for band in bands]))
    rows, numbers = list[tuple[Cell, ...]](), dict[str, CurveFigure]()
    for m, band in enumerate(bands):
        for k, of in enumerate(varied.inputs):
            first, first_error, total, total_error = cells = indices[:, m, k].tolist()
            rows.append((band.number.label, of.name, *cells))
            numbers[f"{slug(band.number)}.first.{of.name}"] = CurveFigure(first, first_error, DIMENSIONLESS)
            numbers[f"{slug(band.number)}.total.{of.name}"] = CurveFigure(total, total_error, DIMENSIONLESS)
    columns = ("of", "to", "first order", "first order ± 95 %", "total", "total ± 95 %")
    few = f"± 95 % of Sobol' indices by fewer than {ENOUGH} base samples are too small: two indices of three are within"
    remarks = [few] * (count < ENOUGH) + [
        f"{band.number.label} does not vary within the tolerances but for its numerical error: it has no Sobol' indices"
        for band, first in zip(bands, indices[0], strict=True)
        if np.isnan(first).all()
    ]
    table = SectionTable("sobol", "Sobol' indices", columns, (None,) * 6, rows)
    return Section("", "", [table], remarks=remarks, **numbered(numbers))


LEVEL = 1.0 / 7.0
"""Exponent of the relative error of the numbers that makes the best step; see ``derivative``."""

ZEROS = 10.0
"""Size of an input, in its tolerances, that steps are relative to at least: inputs may be 0."""


class Sensitivity(InputStruct, frozen=True):
    """What numbers of the run depend on.

    Attributes:
        of: Numbers of the run, such as ``[C_B @ max, loads.B.life.time]``.
        to: Numbers of the scenario and their tolerances: argument of the model, or path as ``--set`` writes it ->
            ``250 ± 0.1 mm``, ``0.1 mm`` or ``5 %``.
        monte_carlo: How many runs with drawn inputs are compared with root-sum-square, such as ``1000``; 0 for none.
        sobol: Base samples of Sobol' indices, a power of 2, such as ``64``, which take that many runs times the inputs
            and two; 0 for none. Needs SALib.
        distribution: Of drawn inputs: ``normal``, with a third of the tolerance as standard deviation, or ``uniform``
            within the tolerance.
        seed: Of the drawing: a whole number, such as ``1``. The same number draws the same inputs.
    """

    of: Annotated[tuple[str, ...], msgspec.Meta(min_length=1, max_length=100)]
    to: Annotated[dict[str, Tolerance], msgspec.Meta(min_length=1, max_length=1000)]
    monte_carlo: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)] = 0
    sobol: Annotated[int, msgspec.Meta(ge=0, le=2**20)] = 0
    distribution: DistributionName = "normal"
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 0

    def check(self) -> None:
        if self.monte_carlo == 1:
            with within("monte_carlo"):
                raise InputError("one run has no distribution", expected="0 for none, or at least 2")
        if self.sobol & (self.sobol - 1) or self.sobol == 1:
            with within("sobol"):
                raise InputError(f"{self.sobol} is no power of 2", expected="0 for none, or 64, 128, 256, ...")
        slugs = [slug(number) for number in self._asked()]
        for index, name in enumerate(slugs):
            with within("of", index):
                if name in slugs[:index]:
                    raise InputError(f"'{self.of[index]}' has the name of another number, '{name}'")

    def _asked(self) -> list[AnyNumber]:
        numbers = []
        for index, text in enumerate(self.of):
            with within("of", index):
                numbers.append(read_number(text))
        return numbers

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        units = dict[str, Unit | None]()
        for number in self._asked():
            known = number.described(quantities, {}).unit if number.of_curves else None
            bands = ("worst_case", "rss", *(("deviation",) if self.monte_carlo else ()))
            units |= {f"{slug(number)}.{name}": known for name in bands}
            units |= {f"{slug(number)}.by.{name}": None for name in self.to}
            if self.sobol:
                units |= {f"{slug(number)}.{kind}.{name}": None for kind in ("first", "total") for name in self.to}
        return units

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        others = {key: asked for key, asked in scenario.numbered.items() if asked is not self}
        for index, number in enumerate(self._asked()):
            with within("of", index):
                number.described(quantities, others)
        inputs_of(scenario, self.to)

    def evaluate(self, result: Result) -> Section:
        """Return derivatives, bands and distributions: see ``Assessment``."""
        self.check_names(result.quantities, result.scenario)
        inputs, asked = inputs_of(result.scenario, self.to), self._asked()
        taken = [measured(number, result) for number in asked]
        centre = np.array([float(series.values[0]) for series, _ in taken])
        errors = noise(result, asked, taken)
        with varied_runs(result.scenario, inputs, asked) as variation:
            zero = np.abs(centre) <= rounding(result, [series.unit for series, _ in taken])
            sizes = np.where(zero, 0.0, np.abs(centre))
            slopes = derivatives(variation, centre, partial(_step, sizes, errors), errors)
            corners, bounds = _corners(variation, slopes), [result.number_errors.get(number.label) for number in asked]
            bands = [
                Band(number, series, bounds[k], own, inputs, [row[k] for row in slopes], *corners[k])
                for k, (number, (series, _), own) in enumerate(zip(asked, taken, errors.tolist(), strict=True))
            ]
            return self._section(variation, bands)

    def _section(self, variation: Variation, bands: Sequence[Band]) -> Section:
        remarks = [
            "bands are what the tolerances make of a number; its numerical error is another thing, and in none of them"
        ]
        remarks += [text for band in bands for text in band.remarks()]
        graphs = [band.ranking_graph() for band in bands if band.ranking]
        linear = numbered({name: number for band in bands for name, number in band.numbers().items()})
        parts = [Section("", "", [band_table(bands)], remarks=remarks, graphs=graphs, **linear)]
        for count, drawn in ((self.monte_carlo, distribution), (self.sobol, sobol)):
            parts += [drawn(variation, bands, count, self.seed, self.distribution)] if count else []
        estimated = all(band.error is not None for band in bands)
        untold = () if estimated else ("numerical errors are not estimated; run --verify bounds them",)
        parts.append(Section("", "", [band.effects() for band in bands], remarks=untold))
        return Section(
            "sensitivity",
            "Sensitivity to tolerances",
            [table for part in parts for table in part.tables],
            {name: number for part in parts for name, number in part.numbers.items()},
            [remark for part in parts for remark in part.remarks],
            [graph for part in parts for graph in part.graphs],
            {name: error for part in parts for name, error in part.errors.items()},
        )


def _step(size: Array, errors: Array, of: Input) -> float:
    """Return the first change of an input, by the errors of the numbers relative to their sizes; 0 has none."""
    relative = float(np.max(errors / np.where(size > 0.0, size, np.inf), initial=np.finfo(float).eps))
    return float(min(relative, 1.0) ** LEVEL * max(abs(of.value), ZEROS * of.tolerance))


def _corners(variation: Variation, slopes: Sequence[Sequence[Derivative]]) -> list[tuple[float, float, str]]:
    """Return every number at the two corners of the tolerances where it is least and largest if it is linear.

    Args:
        variation: The numbers, m of them.
        slopes: Their derivatives by every input.

    Returns:
        Both [SI], NaN where the scenario has no solution there, and why it has none.
    """
    tolerances = np.array([varied.tolerance for varied in variation.inputs])
    signs = np.sign([[slope.value for slope in row] for row in slopes]).T
    rows = [*variation.rows(np.concatenate([-signs * tolerances, signs * tolerances]))]
    corners = []
    for k, (low, high) in enumerate(zip(rows[: len(signs)], rows[len(signs) :], strict=True)):
        ends = [np.nan if row.error else row.taken[k] for row in (low, high)]
        corners.append((ends[0], ends[1], high.error or low.error))
    return corners
