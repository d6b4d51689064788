"""Trade-off between accuracy and cost: settings against a reference, simpler models against the exact one.

All are solved one after the other in this process, so that their times compare.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pinarm.errors import InputError, IntegrationError, NumericsError
from pinarm.input.yaml.document import Values
from pinarm.use.accuracy.error_estimate import common_rows, different_course, output_differences, reason_for_no_bound
from pinarm.use.accuracy.integration_settings import (
    format_setting,
    reference_settings,
    settings_by_method,
    step_limit,
    with_setting,
)
from pinarm.use.facade import Given, Scenario, load
from pinarm.use.output import whole_folder
from pinarm.use.result.number_accuracy import output_scales
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario as ScenarioRecord
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
        method: The method of integration: a curve of the plot.
        setting: The setting in words.
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
    """A model of the scenario, and how far its outputs are from those of the scenario's own.

    Attributes:
        name: As the scenario has it; ``exact`` for the scenario itself.
        result: Its result; none where it could not be solved.
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
            keys = ("method", "setting", "error", "errors", "evaluations", "seconds")
            data["settings"] = [{key: getattr(point, key) for key in keys} for point in self.points]
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
        """Return what there is to draw: error against cost of ``settings``, outputs of ``variants``."""
        from pinarm.use.study.tradeoff_view import outputs, work_precision

        drawn = {"settings": work_precision} if self.reference else {}
        drawn |= {"variants": outputs} if self.variants else {}
        return {name: draw(self) for name, draw in drawn.items()}

    def _repr_html_(self) -> str:
        """Return tables and plots, for notebooks."""
        from pinarm.use.show.notebook import blocks, folded, heading, lines, picture, table
        from pinarm.use.study.tradeoff_view import advice, remarks, settings, variant_rows

        drawn = {name: picture(figure) for name, figure in self.plots().items()}
        parts = [heading(self.scenario.content.title or self.scenario.name)]
        if self.reference:
            parts += [lines(advice(self)), drawn["settings"], folded("all settings", table(settings(self)))]
        if self.variants:
            parts += [table(variant_rows(self)), lines(remarks(self)), drawn["variants"]]
        return blocks(*parts)


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
    """Return the reference of a scenario.

    Raises:
        IntegrationError: Fewer than two tight settings get to the end, or these contradict each other.
    """
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
    """Return all settings that are tried, method by method, the coarsest first."""
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

    Finer settings that failed do not count: they say so. Those that take another course do. Evaluations decide because
    they are the same on every machine.

    Args:
        points: Settings, those of a method the coarsest first.
        bound: Error of the reference.
        wanted: Error that is wanted.
    """
    good: list[TriedSetting] = []
    for method in dict.fromkeys(point.method for point in points):
        solved = [point for point in points if point.method == method and point.evaluations]
        good += takewhile(lambda point: MARGIN * point.error + bound <= wanted, reversed(solved))
    return min(good, key=lambda point: point.evaluations, default=None)


def solve_variants(scenario: Scenario) -> list[Variant]:
    """Return the exact model and all variants of a scenario.

    Raises:
        PinarmError: The scenario itself cannot be solved, or a variant has a mistake.
    """
    exact, seconds, failure = _timed(scenario)
    if exact is None:
        raise failure or AssertionError
    variants = [Variant("exact", exact, seconds=seconds)]
    for name in scenario.content.variants:
        with scenario.document.locating("variants", name):
            result, seconds, failure = _timed(scenario.variant(name))
            if result is None:
                variants.append(Variant(name, None, seconds=seconds, failure=failure.message if failure else ""))
            else:
                variants.append(_compared(name, result, exact, seconds))
    return variants


def _compared(name: str, result: Result, exact: Result, seconds: float) -> Variant:
    """Return a variant with its differences to the exact model."""
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
