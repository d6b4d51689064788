"""What a search for an optimum tells: values, how flat it is there, what holds it, and where every start has led."""

from __future__ import annotations

import numpy as np

from pinarm.engine.series import Series
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.use.result.section import Cell, Section, SectionTable
from pinarm.use.scenario.border import ALONG_BORDER
from pinarm.use.scenario.find import Find
from pinarm.use.scenario.optimum import EDGE, FLAT, NOWHERE, WITHOUT_SLOPES, Descent, Optimum

SAME = 1e-3
"""Difference of objectives, relative to them, below which starts have led to the same value."""

BESIDE = 1e-3
"""Distance to where runs are refused, of that between the bounds, at which this holds an optimum."""


def optimum_section(search: Find, found: Optimum, objective: Series, error: float) -> Section:
    """Return the section of a search.

    Args:
        search: What was asked.
        found: What came out.
        objective: Name and unit of the objective, without values.
        error: What its quadrature leaves of the objective at the best values [SI].
    """
    sign = 1.0 if search.minimise is not None else -1.0
    value = sign * found.best.trial.objective
    numbers = {
        path: Series(path, one.unit.si if one.unit else DIMENSIONLESS, np.array([end]))
        for (path, one), end in zip(search.unknown.items(), found.best.end, strict=True)
    }
    numbers["objective"] = Series(objective.name, objective.unit, np.array([value]))
    tables = [_values(search, found), _starts(search, found, sign, objective.unit), *_conditions(search, found)]
    remarks = _remarks(search, found, objective, value)
    if error:
        left = f"{error:.1e} {objective.unit or DIMENSIONLESS}"
        remarks.append(f"at these values the objective is known to {left}, beside the error of the motion")
    return Section("find", f"{'Least' if sign > 0 else 'Largest'} {objective.name}", tables, numbers, remarks,
                   errors={"objective": error})  # fmt: skip


def _values(search: Find, found: Optimum) -> SectionTable:
    """Return the values in the units of the file, and how far each may go with the others held."""
    rows: list[tuple[Cell, ...]] = []
    for (path, one), end, reach in zip(search.unknown.items(), found.best.end, found.reaches, strict=True):
        low, value, high = (float(x) / one.factor for x in (reach.low, end, reach.high))
        rows.append((path, str(one.unit or "1"), value, low, reach.stops[0], high, reach.stops[1]))
    names = ("", "unit", "best", "from", "stopped by", "to", "stopped by ")
    return SectionTable("values", "Best values, and how far each may go with the others held", names,
                        (None,) * len(names), rows)  # fmt: skip


def _starts(search: Find, found: Optimum, sign: float, unit: Unit | None) -> SectionTable:
    """Return where every start has led, in the units of the file."""
    paths = list(search.unknown)

    def row(k: int, one: Descent) -> tuple[Cell, ...]:
        scale = [each.factor for each in search.unknown.values()]
        points = [*(one.start / scale).tolist(), *(one.end / scale).tolist()]
        said: list[Cell] = ["", ""] if one.trial.refusal else [sign * one.trial.objective, one.violation]
        return (str(k), *points, *said, float(one.runs), one.status)

    texts = [f"{path} {end} [{search.unknown[path].unit or '1'}]" for end in ("at start", "at end") for path in paths]
    names = ("start", *texts, f"objective [{unit or '1'}]", "violation", "runs", "end")
    return SectionTable("starts", "All starts, and where each has led", names, (None,) * len(names),
                        [row(k, one) for k, one in enumerate(found.descents, start=1)])  # fmt: skip


def _conditions(search: Find, found: Optimum) -> list[SectionTable]:
    if not search.conditions:
        return []
    rows = [
        (str(condition), float(margin), "active" if k in found.active else "")
        for k, (condition, margin) in enumerate(zip(search.conditions, found.best.trial.margins, strict=True))
    ]
    return [
        SectionTable("conditions", "Conditions and their margins in SI", ("", "margin", "active"), (None,) * 3, rows)
    ]


def _edges(search: Find, found: Optimum) -> list[str]:
    """Return beside which values runs are refused: what is best there may lie beyond."""
    edges = []
    for (path, one), end, reach in zip(search.unknown.items(), found.best.end, found.reaches, strict=True):
        for edge, stop, side in zip((reach.low, reach.high), reach.stops, ("below", "above"), strict=True):
            if stop == "run refused" and abs(edge - end) <= BESIDE * (one.high - one.low):
                edges.append(f"{path}: runs with values {side} {one.written(float(end))} are refused")
    return edges


def _remarks(search: Find, found: Optimum, objective: Series, value: float) -> list[str]:
    """Return how flat the optimum is, what holds it, how many starts have led there, and what was refused."""
    held = [str(search.conditions[k]) for k in found.active]
    for (path, one), end in zip(search.unknown.items(), found.best.end, strict=True):
        for bound, name in ((one.low, "lower"), (one.high, "upper")):
            if abs(end - bound) <= 1e-6 * (one.high - one.low):
                held.append(f"{path} at its {name} bound {one.written(bound)}")
    held += _edges(search, found)
    starts = [one for one in found.descents if one.status not in (ALONG_BORDER, WITHOUT_SLOPES)]
    gap = max(SAME * abs(found.best.trial.objective), 0.1 * found.allowance)
    same = sum(abs(one.trial.objective - found.best.trial.objective) <= gap for one in starts if one.valid)
    refused = sum(bool(one.trial.refusal) for one in starts)
    unit = objective.unit or DIMENSIONLESS
    base = f"{FLAT:.0%} of the objective" if found.allowance <= 1.01 * FLAT * abs(value) else (
        f"{FLAT:.0%} of what it is at the starts, since it vanishes"
    )  # fmt: skip
    said = [
        f"{objective.name} = {value:.7g} {unit} after {found.runs} runs; {same} of {len(starts)} starts "
        "led to that value" + (f", {refused} could not be run" if refused else ""),
        f"held by {'; '.join(held)}" if held else "no condition and no bound holds it",
        f"columns 'from' and 'to': until the objective is worse by {found.allowance:.3g} {unit}, {base}; where no "
        f"bound stops them, they may go up to {EDGE:.0%} of that way, or {NOWHERE:.2g} of the bounds, farther",
    ]
    if found.flat:
        said.append(
            "the same in all runs, but for rounding: no unknown changes it between its bounds, as far as they show"
        )
    return said if search.search == "global" or len(starts) > 1 else [*said, "one start only: there may be better ones"]
