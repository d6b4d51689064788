"""Trade-off between accuracy and cost: settings against a reference, simpler models against the exact one.

All are solved one after the other in this process, so that their times compare.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import InputError, IntegrationError, NumericsError
from pinarm.input.units import DIMENSIONLESS
from pinarm.input.yaml.document import Values
from pinarm.use.accuracy.error_estimate import (
    common_rows,
    different_course,
    format_setting,
    output_differences,
    reason_for_no_bound,
    reference_settings,
    settings_by_method,
    step_limit,
    with_setting,
)
from pinarm.use.facade import Given, Scenario, load
from pinarm.use.output import whole_folder
from pinarm.use.result.number_accuracy import output_scales
from pinarm.use.result.result import Result
from pinarm.use.result.section import Curve, Graph
from pinarm.use.scenario.scenario import Scenario as ScenarioRecord
from pinarm.use.show.picture_files import file_name
from pinarm.use.show.text import aligned
from pinarm.use.store.files import json_text, write

if TYPE_CHECKING:
    from pinarm.use.show.picture import Picture

WANTED = (1e-3, 1e-6, 1e-9)
"""Errors that a setting is recommended for."""

MARGIN = 3.0
"""Wanted error over that of a setting which is recommended: in 98 of 100 random chains and loops it errs by at most
3 times as much where initial velocities differ by 1 % (``benchmarks/error_bound.py``)."""

LONG = 0.05
"""Time for which short solutions are repeated [s]; the shortest of their times counts."""

MOST = 5000
"""Steps that every setting may take; more, where the reference needs many."""


@dataclass(frozen=True)
class TriedSetting:
    """A setting, its error and its price.

    Attributes:
        errors: Output -> largest difference to the reference over the run, relative to the output's scale; infinite
            where the integration failed, or takes another course.
        evaluations: Number of accelerations computed; 0 where the integration failed.
        seconds: Wall time of the solution [s], the model being loaded.
    """

    method: str
    setting: str
    errors: dict[str, float]
    evaluations: int
    seconds: float

    @property
    def error(self) -> float:
        """Largest error of any output."""
        return max(self.errors.values())


@dataclass(frozen=True)
class Reference:
    """Solution that errors are measured against.

    Attributes:
        result: The tightest of some solutions that share neither tolerances nor last digits.
        bound: Largest difference to the next: the larger of both errors, but for a factor near 1.
        words: Both settings.
    """

    result: Result
    bound: float
    words: str


@dataclass(frozen=True, eq=False)
class Variant:
    """A model of the scenario, and how far its outputs are from those of the scenario's own, ``exact``.

    Attributes:
        errors: Output -> largest difference over the run, in the output's unit.
        relative: The same, relative to the output's scale in the exact model.
        where: Output -> row parameter at which that occurs.
        seconds: Wall time of the solution [s].
        failure: Why there is no result.
        course: How its events, contacts or end differ from those of the exact model; then only the rows are compared
            that both have.
    """

    name: str
    result: Result | None
    errors: dict[str, float] = field(default_factory=dict)
    relative: dict[str, float] = field(default_factory=dict)
    where: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    failure: str = ""
    course: str = ""


@dataclass(frozen=True, eq=False)
class Tradeoff:
    """Accuracy and cost of a scenario.

    Attributes:
        scenario: The scenario.
        reference: What errors of settings are measured against; none where nothing is integrated.
        points: Settings tried.
        variants: The exact model, then the simplified ones; empty where the scenario has none.
    """

    scenario: Scenario
    reference: Reference | None
    points: list[TriedSetting] = field(default_factory=list)
    variants: list[Variant] = field(default_factory=list)

    def recommended(self) -> dict[float, TriedSetting | None]:
        """Return the cheapest setting for every wanted error, with a margin; see ``recommended_setting``."""
        bound = self.reference.bound if self.reference else 0.0
        return {wanted: recommended_setting(self.points, bound, wanted) for wanted in WANTED}

    def summary(self) -> dict[str, Any]:
        """Return everything but the curves as plain data."""
        data: dict[str, Any] = {"scenario": self.scenario.name, "title": self.scenario.content.title}
        if self.reference:
            data["reference"] = {"settings": self.reference.words, "bound": self.reference.bound}
            data["settings"] = [{**vars(point), "error": point.error} for point in self.points]
            data["recommended"] = {
                f"{wanted:g}": point and {"method": point.method, "setting": point.setting}
                for wanted, point in self.recommended().items()
            }
        keys = ("seconds", "errors", "relative", "where", "failure", "course")
        data["variants"] = {variant.name: {key: getattr(variant, key) for key in keys} for variant in self.variants}
        return data

    def save(self, folder: Path, *, plots: Literal["svg", "png", "pdf"] | bool = True, dpi: int = 200) -> Path:
        """Write ``tradeoff.json`` and the plots; return the folder.

        Args:
            folder: Where to; an earlier trade-off there is replaced.
            plots: Format of the pictures, ``svg`` (the default), ``png`` or ``pdf``; ``False`` for none.
            dpi: Pixels per inch of PNG.

        Raises:
            InputError: The folder cannot be written, or holds files that are not an earlier trade-off's.
        """
        with whole_folder(folder, "trade-off", source=self.scenario.document.path) as draft:
            write(draft / "tradeoff.json", json_text(self.summary()) + "\n")
            if plots:
                from pinarm.use.show.picture_files import write_pictures

                write_pictures(self.plots().items(), draft, plots, dpi)
        return folder

    def plots(self) -> dict[str, Picture]:
        """Return the plots: error against cost of ``settings``, outputs of ``variants``."""
        drawn = {"settings": work_precision(self, self.reference)} if self.reference else {}
        return {**drawn, **(outputs(self) if self.variants else {})}

    def _repr_html_(self) -> str:
        from pinarm.use.show.text import figure, lines

        return "".join([lines(report(self)), *map(figure, self.plots().values())])


def tradeoff(scenario: Given, values: Values | None = None) -> Tradeoff:
    """Measure what accuracy costs: of settings, where the scenario is integrated over time, and of its variants.

    Args:
        scenario: The scenario, or its file.
        values: Other values than those of the file, such as ``{"problem.time.end": "3 s"}``; see ``pinarm.load``.

    Raises:
        InputError: Neither is there to be traded.
        PinarmError: The scenario cannot be solved.
    """
    scenario = load(scenario, values)
    integrated = scenario.problem.kind == "forward"
    if not integrated and not scenario.content.variants:
        raise InputError(
            f"there is nothing to trade: a problem of kind {scenario.problem.kind} is solved to rounding, "
            "whatever the setting, and the scenario has no variants",
            hint="variants: {light: {arguments.mass: 0 kg}}",
        )
    against = reference_solution(scenario) if integrated else None
    tried = _tried_settings(scenario, against) if against else []
    return Tradeoff(scenario, against, tried, solve_variants(scenario) if scenario.content.variants else [])


def reference_solution(scenario: Scenario) -> Reference:
    """Return the reference of a scenario, by two tight settings that have to get to the end and to agree."""
    solved: list[tuple[str, Result]] = []
    for seed, setting in enumerate(reference_settings()):
        most = step_limit(solved[-1][1], scenario.content.accuracy.max_steps) if solved else None
        try:
            solved.append((format_setting(setting), with_setting(scenario, setting, most, seed=seed).solve()))
        except NumericsError:
            continue
    if len(solved) < 2:
        raise IntegrationError(
            "no two tight settings get to the end: there is no reference to measure errors against",
            hint="a shorter time, away from singular positions",
        )
    (coarser, other), (finer, result) = solved[-2:]
    if why := reason_for_no_bound(result, other):
        raise IntegrationError(
            f"there is no reference to measure errors against: {why}",
            hint="an end before the instant at which they part, or other values: one event more or less is no small "
            "error",
        )
    return Reference(result, max(output_differences(result, other).values()), f"{finer}, compared with {coarser}")


def _tried_settings(scenario: Scenario, against: Reference) -> list[TriedSetting]:
    most = max(MOST, step_limit(against.result, scenario.content.accuracy.max_steps))
    tried = []
    for method, settings in settings_by_method(against.result).items():
        for setting in settings:
            result, seconds, _ = _timed(with_setting(scenario, setting, most), LONG)
            errors = output_differences(against.result, result) if result else {}
            errors = errors or dict.fromkeys(against.result.content.outputs, np.inf)
            evaluations = int(result.figures["evaluations"]) if result else 0
            tried.append(TriedSetting(method, format_setting(setting), errors, evaluations, seconds))
    return tried


def _timed(scenario: ScenarioRecord, least: float = 0.0) -> tuple[Result | None, float, NumericsError | None]:
    """Return the result, the shortest wall time of repeated solutions [s], and why there is no result."""
    assert scenario.mechanism  # loaded before the clock runs
    seconds: list[float] = []
    while not seconds or sum(seconds) < least:
        begin = time.perf_counter()
        try:
            result = scenario.run()
        except NumericsError as error:
            return None, time.perf_counter() - begin, error
        seconds.append(time.perf_counter() - begin)
    return result, min(seconds), None


def recommended_setting(points: Sequence[TriedSetting], bound: float, wanted: float) -> TriedSetting | None:
    """Return the cheapest setting whose error, and that of every finer one, is below the wanted one by ``MARGIN``.

    Settings of a method come with the coarsest first. Finer settings that failed do not count: they say so. Those that
    take another course do. Evaluations decide because they are the same on every machine.
    """
    good: list[TriedSetting] = []
    for method in dict.fromkeys(point.method for point in points):
        solved = [point for point in points if point.method == method and point.evaluations]
        good += takewhile(lambda point: MARGIN * point.error + bound <= wanted, reversed(solved))
    return min(good, key=lambda point: point.evaluations, default=None)


def solve_variants(scenario: Scenario) -> list[Variant]:
    """Return the exact model and all variants of a scenario."""
    exact, seconds, failure = _timed(scenario)
    if exact is None:
        raise failure or AssertionError
    variants = [Variant("exact", exact, seconds=seconds)]
    for name in scenario.content.variants:
        with scenario.document.locating("variants", name):
            result, seconds, failure = _timed(scenario.variant(name))
            why = failure.message if failure else ""
            variants.append(
                _compared(name, result, exact, seconds) if result else Variant(name, None, seconds=seconds, failure=why)
            )
    return variants


def _compared(name: str, result: Result, exact: Result, seconds: float) -> Variant:
    rows, others = common_rows(exact.trajectory, result.trajectory)
    if not len(rows):
        raise InputError(
            f"the rows of the variant '{name}' are not those of the scenario",
            expected="the same time or range, and as many samples",
        )
    errors, relative, where = {}, {}, {}
    for output, scale in output_scales(exact).items():
        apart = np.abs(exact[output].values[rows] - result[output].values[others])
        row = int(apart.argmax())
        errors[output], relative[output] = float(apart[row]), float(apart[row]) / scale
        where[output] = float(exact.trajectory.grid.t[rows[row]])
    return Variant(name, result, errors, relative, where, seconds, course=different_course(exact, result))


def report(trade: Tradeoff) -> str:
    """Return the tables of settings and variants, and what is recommended, as text."""
    lines = [trade.scenario.content.title or trade.scenario.name]
    if trade.reference:
        lines += [*aligned(settings(trade, trade.reference)), *advice(trade, trade.reference)]
    if trade.variants:
        lines += [*aligned(variant_rows(trade)), *remarks(trade)]
    return "\n".join(lines)


def settings(trade: Tradeoff, reference: Reference) -> list[list[str]]:
    """Return a heading and the error and cost of every setting that was tried."""
    rows = [["setting", "error", "largest in", "evaluations", "time [ms]"]]
    for point in trade.points:
        error, worst = ("other events" if point.evaluations else "failed"), ""
        if math.isfinite(point.error):
            error = f"{point.error:.1e}" if point.error > reference.bound else f"< {reference.bound:.0e}"
            worst = max(point.errors, key=lambda name: point.errors[name])[:24]
        rows.append([point.setting, error, worst, f"{point.evaluations}", f"{1e3 * point.seconds:.1f}"])
    return rows


def advice(trade: Tradeoff, reference: Reference) -> list[str]:
    """Return the reference of the errors, and the cheapest setting for every wanted error, with a margin."""
    lines = [f"reference: {reference.words}; known to {reference.bound:.1e}"]
    for wanted, point in trade.recommended().items():
        lines.append(f"for {wanted:g}: {f'{point.setting}; every finer one too' if point else 'no setting tried'}")
    return lines


def variant_rows(trade: Tradeoff) -> list[list[str]]:
    """Return a heading and the errors of the outputs of every simplified model."""
    exact = trade.variants[0].result
    parameter = exact.trajectory.parameter if exact else ""
    rows = [["variant", "output", "error", "unit", "relative", f"at {parameter}", "time [ms]"]]
    for variant in trade.variants[1:]:
        for k, (name, error) in enumerate(variant.errors.items() if variant.result else ()):
            unit = str(variant.result[name].unit or "?") if variant.result else ""
            price = f"{1e3 * variant.seconds:.1f}" if k == 0 else ""
            numbers = [f"{error:.3g}", unit, f"{variant.relative[name]:.1e}", f"{variant.where[name]:.6g}", price]
            rows.append([variant.name if k == 0 else "", name[:32], *numbers])
    return rows


def remarks(trade: Tradeoff) -> list[str]:
    """Return remarks on the variants: scale of their errors, failed variants, and variants with other events."""
    lines = [f"exact model: {1e3 * trade.variants[0].seconds:.1f} ms; relative to its largest value"]
    for variant in trade.variants[1:]:
        if variant.result is None:
            lines.append(f"{variant.name}: failed: {variant.failure}")
        if variant.course:
            lines.append(f"{variant.name}: compared only in rows that both models have: {variant.course}")
    return lines


def work_precision(trade: Tradeoff, reference: Reference) -> Picture:
    """Return the errors of all settings over their evaluations, a curve for each method; recommended ones as points.

    Errors below that of the reference are drawn as large as that.
    """
    from pinarm.use.show.picture import graph

    def curve(name: str, points: Sequence[TriedSetting], *, points_only: bool = False) -> Curve:
        known = [point for point in points if np.isfinite(point.error)]
        costs = np.array([float(point.evaluations) for point in known])
        errors = np.array([max(point.error, reference.bound, 1e-16) for point in known])
        across = Series("evaluations of the acceleration", DIMENSIONLESS, costs)
        return Curve(across, Series("largest relative error of any output", DIMENSIONLESS, errors), name, points_only)

    methods = dict.fromkeys(point.method for point in trade.points)
    curves = [curve(method, [x for x in trade.points if x.method == method]) for method in methods]
    chosen = [point for point in trade.recommended().values() if point]
    curves += [curve("recommended", chosen, points_only=True)] if chosen else []
    return graph(Graph("settings", trade.scenario.content.title or trade.scenario.name, curves, logarithmic="xy"))


def outputs(trade: Tradeoff) -> dict[str, Picture]:
    """Return a picture of each output over the run, with a curve for every variant."""
    from pinarm.use.show.picture import graph

    results = {variant.name: variant.result for variant in trade.variants if variant.result}
    pictures = {}
    for name in dict.fromkeys(trade.scenario.content.outputs):
        curves = [Curve(result.parameter, result[name], called) for called, result in results.items()]
        pictures[f"variants_{file_name(name)}"] = graph(
            Graph("variants", name, curves), trade.scenario.content.presentation
        )
    return pictures
