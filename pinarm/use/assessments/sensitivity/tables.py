"""Tables, numbers and remarks on what numbers of a run depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.series import Series
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.use.assessments.sensitivity.derivative import Derivative
from pinarm.use.assessments.sensitivity.variation import Input
from pinarm.use.result.numbers import AnyNumber, slug
from pinarm.use.result.section import Cell, Curve, Graph, SectionTable

NOT_LINEAR = 0.1
"""Difference between a corner and the linear band, relative to the band, that is worth a word."""


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
            f"{name}.worst_case": single(unit, self.worst_case(inputs)),
            f"{name}.rss": single(unit, self.rss(inputs)),
        }
        for of, slope in zip(inputs, self.slopes, strict=True):
            numbers[f"{name}.by.{of.name}"] = single(unit_over(unit, of.si), slope.value)
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


def single(unit: Unit | None, value: float) -> Series:
    """Return a series of one value."""
    return Series("", unit, np.array([value]))
