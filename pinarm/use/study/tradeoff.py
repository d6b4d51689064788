"""Trade-off of a scenario between accuracy and cost: of settings, and of simpler models."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pinarm.errors import InputError
from pinarm.input.yaml.document import Values
from pinarm.use.facade import Given, Scenario, load
from pinarm.use.output import whole_folder
from pinarm.use.store.files import json_text, write
from pinarm.use.study.trials import (
    WANTED,
    Reference,
    TriedSetting,
    Variant,
    recommended_setting,
    reference_solution,
    solve_variants,
    solving_trials,
    tried_settings,
)

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pinarm.use.show.picture import Picture


@dataclass(frozen=True, eq=False)
class Tradeoff:
    """What accuracy costs in a scenario.

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
        found: dict[str, Any] = {"scenario": self.scenario.name, "title": self.scenario.content.title}
        if self.reference:
            found["reference"] = {"settings": self.reference.words, "bound": self.reference.bound}
            found["settings"] = [
                {"method": point.method, "setting": point.setting, "error": point.error, "errors": point.errors,
                 "evaluations": point.evaluations, "seconds": point.seconds} for point in self.points
            ]  # fmt: skip
            found["recommended"] = {
                f"{wanted:g}": point and {"method": point.method, "setting": point.setting}
                for wanted, point in self.recommended().items()
            }
        found["variants"] = {
            variant.name: {"seconds": variant.seconds, "errors": variant.errors, "relative": variant.relative,
                           "where": variant.where, "failure": variant.failure, "course": variant.course}
            for variant in self.variants
        }  # fmt: skip
        return found

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
        from pinarm.use.study.tradeoff_view import plots

        return plots(self)

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


def tradeoff(
    scenario: Given, values: Values | None = None, *, workers: int | None = None, executor: Executor | None = None
) -> Tradeoff:
    """Measure what accuracy costs: of settings, where the scenario is integrated over time, and of its variants.

    Args:
        scenario: The scenario, or its file.
        values: Other values than those of the file, such as ``{"problem.time.end": "3 s"}``; see ``pinarm.load``.
        workers: Processes that solve settings and variants; this process where it is left out. Errors and numbers of
            evaluations are the same, but times are those of cores that others are using too.
        executor: Who solves them in place of processes of this machine; see ``pinarm.sweep``.

    Raises:
        InputError: Neither is there to be traded.
        PinarmError: The scenario cannot be solved.
    """
    scenario = load(scenario, values).with_workers(workers, executor)
    integrated = scenario.problem.kind == "forward"
    if not integrated and not scenario.content.variants:
        raise InputError(
            f"there is nothing to trade: a problem of kind {scenario.problem.kind} is solved to rounding, "
            "whatever the setting, and the scenario has no variants",
            hint="variants: {light: {arguments.mass: 0 kg}}",
        )
    against = reference_solution(scenario) if integrated else None
    with solving_trials(scenario) as solve:
        tried = tried_settings(scenario, against, solve) if against else []
        return Tradeoff(scenario, against, tried, solve_variants(scenario, solve) if scenario.content.variants else [])
