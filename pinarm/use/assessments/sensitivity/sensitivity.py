"""Sensitivity of numbers of a run: derivatives by inputs with tolerances, and the bands from these tolerances.

With the derivatives D_i of a number and the tolerances t_i, its band is ``Σ |D_i| t_i`` in the worst case, and
``(Σ D_i² t_i²)^(1/2)`` by root-sum-square, where inputs are independent. Both are linear; runs at the two worst
corners, and Monte Carlo on request, show where that is not enough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.use.assessments.sensitivity.bands import Band, DistributionName, band_table, distribution, sobol
from pinarm.use.assessments.sensitivity.derivative import Derivative, derivatives
from pinarm.use.assessments.sensitivity.variation import Input, Tolerance, Variation, inputs_of, varied_runs
from pinarm.use.result.number_accuracy import global_error, noise, rounding
from pinarm.use.result.numbers import AnyNumber, measured, read_number, slug
from pinarm.use.result.section import Section, numbered

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

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

    def requested(self, mechanism: Mechanism) -> list[str]:
        return list(self.of)

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
            corners = _corners(variation, slopes)
            bands = [
                Band(number, series, global_error(result, number), own, inputs, [row[k] for row in slopes], *corners[k])
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
