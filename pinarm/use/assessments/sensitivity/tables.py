"""Tables, numbers and remarks on what numbers of a run depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.use.assessments.sensitivity.derivative import Derivative
from pinarm.use.assessments.sensitivity.sampling import DEVIATION, DistributionName, Samples, SobolIndices
from pinarm.use.assessments.sensitivity.variation import DRAWN, Input
from pinarm.use.result.numbers import AnyNumber, slug
from pinarm.use.result.section import Cell, Curve, Graph, SectionTable

NOT_LINEAR = 0.1
"""Difference between a corner and the linear band, relative to the band, that is worth a word."""

ENOUGH = 64
"""Base samples of Sobol' indices with which about 95 % are within their intervals: measured on sums, products and
Ishigami's function, 30 % are not with 2, up to 28 % with 16, and up to 15 % with 64."""

CERTAIN = 4.0
"""Standard errors of a drawn deviation, if the number is linear, beyond which it is another than that of
root-sum-square."""


def unit_over(unit: Unit | None, by: Unit) -> Unit | None:
    """Return the unit of a derivative, written as both are: ``N*m/kg``."""
    if unit is None or str(by) == "1":
        return unit
    quotient = Unit(unit.factor / by.factor, (unit / by).dimension)
    simple = "/" not in str(by)
    return Unit(quotient.factor, quotient.dimension, f"{unit}/{str(by).replace('*', '/')}") if simple else quotient


@dataclass(frozen=True)
class Band:
    """Band of one number from the tolerances of all inputs.

    Attributes:
        number: The number.
        measured: Its value in the run.
        error: Bound of its numerical error [SI]; ``None`` where it is not estimated.
        noise: Irregular change of the number from run to run [SI].
        slopes: Its derivatives by the inputs.
        low: Its value at the corner of the tolerances where it is least if it is linear [SI].
        high: Its value at the corner where it is largest [SI].
        unsolved: Why a corner has no value; empty where both have one.
    """

    number: AnyNumber
    measured: Series = field(repr=False)
    error: float | None
    noise: float
    slopes: Sequence[Derivative]
    low: float
    high: float
    unsolved: str = ""

    @property
    def value(self) -> float:
        return float(self.measured.values[0])

    def parts(self, inputs: Sequence[Input]) -> Array:
        """Return ``|D_i| t_i`` [SI], shape (k,)."""
        slopes = np.array([slope.value for slope in self.slopes])
        return np.asarray(np.abs(slopes) * np.array([of.tolerance for of in inputs]))

    def worst_case(self, inputs: Sequence[Input]) -> float:
        return float(self.parts(inputs).sum())

    def rss(self, inputs: Sequence[Input]) -> float:
        return float(np.linalg.norm(self.parts(inputs)))

    def is_rounding(self, inputs: Sequence[Input]) -> bool:
        """Tell whether all that the tolerances make of it may be errors of its derivatives."""
        errors = [slope.error * of.tolerance for of, slope in zip(inputs, self.slopes, strict=True)]
        return bool(self.rss(inputs) <= np.linalg.norm(errors))

    def doubt(self, inputs: Sequence[Input]) -> float:
        """Return the possible difference of bands and runs of a linear number: errors of slopes, and noise."""
        return sum(
            (slope.error * of.tolerance for of, slope in zip(inputs, self.slopes, strict=True)), 2.0 * self.noise
        )

    def numbers(self, inputs: Sequence[Input]) -> dict[str, Series]:
        """Return bands and derivatives by name."""
        name, unit = slug(self.number), self.measured.unit
        numbers = {
            f"{name}.worst_case": _single(unit, self.worst_case(inputs)),
            f"{name}.rss": _single(unit, self.rss(inputs)),
        }
        for of, slope in zip(inputs, self.slopes, strict=True):
            numbers[f"{name}.by.{of.name}"] = _single(unit_over(unit, of.si), slope.value)
        return numbers

    def errors(self, inputs: Sequence[Input]) -> dict[str, float]:
        """Return the errors of bands and derivatives by name: those of bands are what errors of derivatives make."""
        name, wrong = slug(self.number), np.array([slope.error for slope in self.slopes])
        parts = wrong * np.array([of.tolerance for of in inputs])
        errors = {f"{name}.worst_case": float(parts.sum()), f"{name}.rss": float(np.linalg.norm(parts))}
        return errors | {f"{name}.by.{of.name}": slope.error for of, slope in zip(inputs, self.slopes, strict=True)}

    def ranking(self, inputs: Sequence[Input]) -> list[tuple[str, float]]:
        """Return the inputs from the strongest on, each with its share in words, and its part ``|D_i| t_i`` [SI].

        There is none where all parts are rounding, and of one input.
        """
        if self.is_rounding(inputs) or len(inputs) < 2:
            return []
        parts = self.parts(inputs)
        shares = 100.0 * (parts / self.rss(inputs)) ** 2
        return [(f"{inputs[k].name} {shares[k]:.3g} %", float(parts[k])) for k in np.argsort(-parts, kind="stable")]

    def remarks(self, inputs: Sequence[Input]) -> list[str]:
        """Return where the linear band is not the whole answer."""
        label, worst = self.number.label, self.worst_case(inputs)
        ranked = self.ranking(inputs)
        said = [f"{label} depends on {', '.join(words for words, _ in ranked)} of root-sum-square"] if ranked else []
        said += [
            f"{label} has a kink in {of.name}: its derivative is {slope.left:.6g} below and {slope.right:.6g} above; "
            "the steeper one counts"
            for of, slope in zip(inputs, self.slopes, strict=True)
            if slope.kink
        ]
        if self.is_rounding(inputs):
            said.append(
                f"all that the tolerances make of {label} may be errors of its derivatives: no input has a share"
            )
        if self.unsolved:
            return [*said, f"{label} has no value at a corner of the tolerances: {self.unsolved}"]
        off = max(abs(self.value - self.low - worst), abs(self.high - self.value - worst))
        if off > NOT_LINEAR * worst + self.doubt(inputs) and off > 1e-9 * abs(self.value):
            said.append(f"{label} is not linear within the tolerances: see its values at the corners")
        return said


def drawn_remarks(band: Band, inputs: Sequence[Input], prescribed: Sequence[str]) -> list[str]:
    """Return a remark on the held coordinates where moving a point of the drawing does not change a number.

    Args:
        band: The number and its derivatives.
        inputs: The inputs.
        prescribed: Coordinates that the problem prescribes.
    """
    still = [
        of.name
        for of, slope in zip(inputs, band.slopes, strict=True)
        if DRAWN in of.path and abs(slope.value) <= slope.error
    ]
    if not still:
        return []
    held = f"the prescribed coordinates ({', '.join(prescribed)})" if prescribed else "the initial coordinates"
    return [
        f"{band.number.label} does not change to first order with {', '.join(still)}, while {held} keep their values: "
        "these count from the drawing with the moved point, and the lengths of its links follow the point"
    ]


def band_table(bands: Sequence[Band], inputs: Sequence[Input]) -> SectionTable:
    """Return value, numerical error and bands of every number."""
    rows: list[tuple[Cell, ...]] = [
        (band.number.label, str(band.measured.unit or "?"), band.value,
         "not estimated" if band.error is None else band.error, band.worst_case(inputs), band.rss(inputs), band.low,
         band.high)
        for band in bands
    ]  # fmt: skip
    columns = ("", "unit", "value", "numerical error", "± worst case", "± root-sum-square", "at least corner",
               "at largest corner")  # fmt: skip
    return SectionTable(
        "bands", "Values, and their bands by the tolerances", columns, (None,) * len(columns), rows, row_unit=1
    )


def effect_table(band: Band, inputs: Sequence[Input]) -> SectionTable:
    """Return the table of the effect of every input on a number; shares are NaN where all effects are rounding."""
    parts, unit = band.parts(inputs), band.measured.unit
    shares = 100.0 * parts**2 / (np.nan if band.is_rounding(inputs) else band.rss(inputs) ** 2)
    rows: list[tuple[Cell, ...]] = []
    for of, slope, part, share in zip(inputs, band.slopes, parts.tolist(), shares.tolist(), strict=True):
        factor = of.unit.factor if of.unit else 1.0
        derivative = f"kink: {slope.left:.6g}, {slope.right:.6g}" if slope.kink else slope.value
        cells: list[Cell] = [of.name, str(of.unit or "1"), of.value / factor, of.tolerance / factor]
        effect: list[Cell] = [str(unit_over(unit, of.si) or "?"), derivative, slope.error, part]
        rows.append((*cells, *effect, share))
    columns = ("", "unit", "value", "± tolerance", "unit of derivative", "derivative", "its error", "± of the number",
               "% of root-sum-square")  # fmt: skip
    units = (None, None, None, None, None, None, None, unit, None)
    name = f"effects_{slug(band.number)}"
    return SectionTable(name, f"{band.number.label}: what it depends on", columns, units, rows)


def ranking_graph(band: Band, inputs: Sequence[Input]) -> Graph:
    """Return a bar graph of the largest effects of tolerances on a number, in descending order."""
    names, parts = zip(*band.ranking(inputs)[:MOST_BARS], strict=True)
    label = f"± {band.number.label}"
    bars = Curve(
        Series(label, band.measured.unit, np.array(parts)),
        Series("rank", DIMENSIONLESS, np.arange(1.0, len(parts) + 1.0)),
    )
    return Graph(
        f"ranking_{slug(band.number)}",
        f"{band.number.label}: what it depends on, with % of root-sum-square",
        [bars],
        bars=names,
    )


MOST_BARS = 20
"""Inputs that a ranking draws, the strongest."""


def distribution_table(
    bands: Sequence[Band], inputs: Sequence[Input], samples: Samples, distribution: DistributionName
) -> tuple[SectionTable, dict[str, Series], dict[str, float]]:
    """Return a table of the distributions over drawn runs, the standard deviations by name, and their errors.

    Errors are half widths of 95 % intervals, plus the error of each number itself.
    """
    rows, numbers, errors = list[tuple[Cell, ...]](), dict[str, Series](), dict[str, float]()
    for band, values in zip(bands, samples.values.T, strict=True):
        deviation, linear = float(values.std(ddof=1)), DEVIATION[distribution] * band.rss(inputs)
        own, wide = max(band.noise, band.error or 0.0), _student(len(values))
        of_mean, of_deviation = deviation / len(values) ** 0.5, deviation_error(values)
        name = f"{slug(band.number)}.deviation"
        numbers[name], errors[name] = _single(band.measured.unit, deviation), wide * of_deviation + own
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
    return table, numbers, errors


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


def distribution_remarks(
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


def distribution_graph(band: Band, inputs: Sequence[Input], values: Array, distribution: DistributionName) -> Graph:
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


def sobol_remarks(bands: Sequence[Band], indices: SobolIndices, count: int) -> list[str]:
    """Return remarks on Sobol' indices: too few base samples for their intervals, and numbers without indices."""
    few = f"± 95 % of Sobol' indices by fewer than {ENOUGH} base samples are too small: two indices of three are within"
    return [few] * (count < ENOUGH) + [
        f"{band.number.label} does not vary within the tolerances but for its numerical error: it has no Sobol' indices"
        for band, first in zip(bands, indices.first, strict=True)
        if np.isnan(first).all()
    ]


def sobol_table(
    bands: Sequence[Band], inputs: Sequence[Input], indices: SobolIndices
) -> tuple[SectionTable, dict[str, Series], dict[str, float]]:
    """Return the Sobol' indices of all numbers, the same by name, and half widths of their 95 % intervals."""
    rows, numbers, errors = list[tuple[Cell, ...]](), dict[str, Series](), dict[str, float]()
    parts = indices.first, indices.first_error, indices.total, indices.total_error
    for m, band in enumerate(bands):
        for k, of in enumerate(inputs):
            cells = [float(part[m, k]) for part in parts]
            rows.append((band.number.label, of.name, *cells))
            for kind, at in (("first", 0), ("total", 2)):
                name = f"{slug(band.number)}.{kind}.{of.name}"
                numbers[name], errors[name] = _single(DIMENSIONLESS, cells[at]), cells[at + 1]
    columns = ("of", "to", "first order", "first order ± 95 %", "total", "total ± 95 %")
    return SectionTable("sobol", "Sobol' indices", columns, (None,) * len(columns), rows), numbers, errors


def _single(unit: Unit | None, value: float) -> Series:
    return Series("", unit, np.array([value]))
