"""Searches: solves a scenario for the values that its key ``find`` asks, and reports the optimum as a section."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import LOST
from pinarm.engine.series import Series
from pinarm.errors import InputError, NumericsError, PinarmError
from pinarm.input.units import DIMENSIONLESS, Unit, read_quantity
from pinarm.input.yaml.document import joined
from pinarm.records import replace
from pinarm.use.cases.case import Case, Row, RowValues, Task, Wanted, failure
from pinarm.use.cases.solving import solving
from pinarm.use.progress import tell
from pinarm.use.result.measures import RESIDUALS
from pinarm.use.result.number_accuracy import noise, rounding
from pinarm.use.result.numbers import AnyNumber, Condition, RunNumber, measured, read_number
from pinarm.use.result.result import Result
from pinarm.use.result.section import Cell, Section, SectionTable
from pinarm.use.scenario.find import Find
from pinarm.use.scenario.optimum import FURTHER, Descent, Landscape, Optimum, Trial, optimum
from pinarm.use.scenario.roots import FoundValues, Parts, Refused, find_root

if TYPE_CHECKING:
    from pinarm.engine.quantities.names import Quantities
    from pinarm.use.scenario.scenario import Scenario

EXACT = 1e-6
"""Residual of a run's equations, relative to their terms, above which it cannot be an optimum: they are met to rounding
in a regular position."""

AT_A_PLACE = ("", "start", "end")
"""Figures that are the value of a quantity at one place."""

AGREED = 1e-3, 1e-7
"""Difference of objectives below which starts have led to the same value, relative to it, and to that of the starts."""

NEAREST = 3
"""Paths that a message names."""


def solve_found(scenario: Scenario, search: Find) -> Result:
    """Find the unknown values and solve the problem with them."""
    bare = scenario.restated({key: value for key, value in scenario.document.data.items() if key != "find"})
    check_search(scenario, search, bare.quantities())
    with scenario.document.locating("find"):
        if search.objective is None:
            return _balanced(bare, search)
        best = _best(bare, search)
    result = bare.varied(search.case(best.best.end)).run()
    result = replace(result, figures={**result.figures, **search.figures(best.best.end)})
    section = optimum_section(search, best, *_objective(bare, search.objective, result))
    return replace(result, known={"find": section})


def _balanced(bare: Scenario, search: Find) -> Result:
    """Return the result whose quantities are what is wanted, with remainders, and a remark where they are missed."""
    root = _root(bare, search)
    result = bare.varied(search.case(root.values)).solve()
    numbers = [search.number(name, result.numbered) or read_number(f"{name} @ start") for name in root.missed]
    errors = noise(result, numbers, [measured(number, result) for number in numbers]).tolist()
    notes = *result.outcome.notes, *root.remarks(dict(zip(root.missed, errors, strict=True)))
    figures = {**result.figures, **search.figures(root.values), **root.left()}
    return replace(result, figures=figures, outcome=replace(result.outcome, notes=notes))


def _root(bare: Scenario, search: Find) -> FoundValues:
    """Return the values for which quantities, at all rows, and numbers of the run are what is wanted."""
    wanted = search.wanted or {}
    numbers = {name: search.number(name, bare.concluded) for name in wanted}
    taken = [Wanted(name, number) if number else RowValues(name) for name, number in numbers.items()]
    task = Task.of(bare, taken, search.case(search.start))
    of_rows, runs, sizes = sum(number is None for number in numbers.values()), count(1), list[int]()

    def left(row: Row) -> Parts:
        rows = (len(row.taken) - len(numbers) + of_rows) // max(of_rows, 1)
        ends = np.cumsum([1 if number else rows for number in numbers.values()])
        parts = np.split(np.array(row.taken), ends[:-1])
        return {name: part - float(target) for (name, target), part in zip(wanted.items(), parts, strict=True)}

    with solving(task, bare.runners) as solve:

        def residuals(cases: Sequence[Case]) -> Iterator[Parts | Refused]:
            for case, row in zip(cases, solve(cases), strict=True):
                tell(f"find: run {next(runs)}")
                if row.error:
                    yield partial(failure, task, case, row)
                    continue
                sizes.append(len(row.taken))
                yield left(row) if sizes[-1] == sizes[0] else _of_other_rows

        return find_root(search, residuals, _angles(search, numbers))


def _of_other_rows() -> PinarmError:
    return InputError(
        "so_that compares runs row by row, and they have not as many rows: one ends earlier, or has other impacts",
        expected="runs with the same rows",
        hint="a number of the run, such as 'C_B @ end' or 'C_B @ max'",
    )


def _angles(search: Find, numbers: Mapping[str, AnyNumber | None]) -> list[str]:
    """Return the wanted quantities, at all rows or at one place, whose wanted values are written as angles."""
    units = {name: value.unit for name, value in (search.wanted or {}).items()}
    return [
        name
        for name, number in numbers.items()
        if (number is None or (isinstance(number, RunNumber) and number.figure in AT_A_PLACE))
        and (unit := units[name]) is not None
        and str(unit.si) == "rad"
    ]


def _best(bare: Scenario, search: Find) -> Optimum:
    """Return the values for which a number of the run is least or largest."""
    low, high = search.bounds
    for corner in (search.start, low, high):
        bare.varied(search.case(corner))  # what cannot be read fails here, and not as a run that is refused
    conditions, runs = search.conditions, count(1)
    numbers = [number for number in (search.objective, *(each.compared for each in conditions)) if number]
    task = Task.of(bare, [Wanted(number.label, number) for number in numbers], search.case(search.start))
    with solving(task, bare.runners) as solve:

        def trials(points: Sequence[Array]) -> list[Trial]:
            rows = []
            for row in solve([search.case(values) for values in points]):
                tell(f"find: run {next(runs)}")
                rows.append(_trial(row, search.sign, conditions))
            return rows

        (first,) = trials([search.start])
        margins = [0.0] * len(conditions) if first.refusal else first.margins
        sizes = [abs(float(each.bound)) or abs(margin) or 1.0 for each, margin in zip(conditions, margins, strict=True)]
        landscape = Landscape(low, high, search.start, trials, conditions, sizes)
        return optimum(landscape, search.starts, search.seed, everywhere=search.search == "global")


def _trial(row: Row, sign: float, conditions: Sequence[Condition]) -> Trial:
    if row.error:
        return Trial(refusal=row.error)
    objective, *numbers = row.taken
    margins = tuple(condition.margin(x) for condition, x in zip(conditions, numbers, strict=True))
    return Trial(sign * objective, margins, refusal(row.figures))


def refusal(figures: Mapping[str, float]) -> str:
    """Return why the measures of accuracy of a run do not allow it to be an optimum; empty where they do."""
    if figures.get("energy", 0.0) >= LOST:
        return f"{figures['energy']:.2g} of the energy exchanged is not accounted for"
    for name in RESIDUALS:
        if name != "energy" and figures.get(name, 0.0) > EXACT:
            return f"its residual '{name}' is {figures[name]:.1e}"
    return ""


def _objective(bare: Scenario, number: AnyNumber, result: Result) -> tuple[Series, float, float]:
    """Return the objective without values, the error of its quadrature, and what of it is rounding [SI]."""
    objective = number.described(result.quantities, bare.concluded)
    (left,) = rounding(result, [objective.unit])
    return objective, number.value(result)[1], float(left)


def optimum_section(search: Find, best: Optimum, objective: Series, error: float, rounded: float = 0.0) -> Section:
    """Return the section of a search.

    Args:
        search: What was asked.
        best: What came out.
        objective: Name and unit of the objective, without values.
        error: What its quadrature leaves of the objective at the best values [SI].
        rounded: Size up to which the objective is rounding [SI].
    """
    value = search.sign * best.best.trial.objective
    numbers = {
        path: Series(path, unknown.unit.si if unknown.unit else DIMENSIONLESS, np.array([end]))
        for (path, unknown), end in zip(search.unknown.items(), best.best.end, strict=True)
    }
    numbers["objective"] = Series(objective.name, objective.unit, np.array([value]))
    tables = [_values(search, best), _starts(search, best, objective.unit), *_conditions(search, best)]
    remarks = _remarks(search, best, objective, value, rounded)
    if error:
        left = f"{error:.1e} {objective.unit or DIMENSIONLESS}"
        remarks.append(f"at these values the objective is known to {left}, beside the error of the motion")
    title = f"{'Least' if search.sign > 0 else 'Largest'} {objective.name}"
    return Section("find", title, tables, numbers, remarks, errors={"objective": error})


def _table(key: str, title: str, names: Sequence[str], rows: list[tuple[Cell, ...]]) -> SectionTable:
    return SectionTable(key, title, tuple(names), (None,) * len(names), rows)


def _values(search: Find, best: Optimum) -> SectionTable:
    rows: list[tuple[Cell, ...]] = []
    for (path, unknown), end in zip(search.unknown.items(), best.best.end, strict=True):
        low, value, high = (float(x) / unknown.factor for x in (unknown.low, end, unknown.high))
        rows.append((path, str(unknown.unit or "1"), value, low, high))
    return _table("values", "Best values, and their bounds", ("", "unit", "best", "lower bound", "upper bound"), rows)


def _starts(search: Find, best: Optimum, unit: Unit | None) -> SectionTable:
    """Return where every start has led, in the units of the file."""

    def row(k: int, descent: Descent) -> tuple[Cell, ...]:
        scale = [unknown.factor for unknown in search.unknown.values()]
        points = [*(descent.start / scale).tolist(), *(descent.end / scale).tolist()]
        refused = bool(descent.trial.refusal)
        reached: list[Cell] = ["", ""] if refused else [search.sign * descent.trial.objective, descent.violation]
        return (str(k), *points, *reached, float(descent.runs), descent.status)

    units = {path: unknown.unit or "1" for path, unknown in search.unknown.items()}
    texts = [f"{path} {end} [{unit}]" for end in ("at start", "at end") for path, unit in units.items()]
    names = ("start", *texts, f"objective [{unit or '1'}]", "violation", "runs", "end")
    rows = [row(k, descent) for k, descent in enumerate(best.descents, start=1)]
    return _table("starts", "All starts, and where each has led", names, rows)


def _conditions(search: Find, best: Optimum) -> list[SectionTable]:
    rows: list[tuple[Cell, ...]] = [
        (str(condition), float(margin), "active" if k in best.active else "")
        for k, (condition, margin) in enumerate(zip(search.conditions, best.best.trial.margins, strict=True))
    ]
    return [_table("conditions", "Conditions and their margins in SI", ("", "margin", "active"), rows)] if rows else []


def _remarks(search: Find, best: Optimum, objective: Series, value: float, rounded: float) -> list[str]:
    """Return remarks on the optimum: conditions and bounds that hold it, starts that led there, refused runs."""
    held = [str(search.conditions[k]) for k in best.active]
    for (path, unknown), end in zip(search.unknown.items(), best.best.end, strict=True):
        for bound, name in ((unknown.low, "lower"), (unknown.high, "upper")):
            if abs(end - bound) <= 1e-6 * (unknown.high - unknown.low):
                held.append(f"{path} at its {name} bound {unknown.written(bound)}")
    held += [f"refused runs beside this value of {[*search.unknown][k]}" for k in best.refused]
    starts = [descent for descent in best.descents if descent.status != FURTHER]
    gap = max(AGREED[0] * abs(value), AGREED[1] * best.size)
    same = sum(abs(start.trial.objective - best.best.trial.objective) <= gap for start in starts if start.valid)
    refused = sum(bool(start.trial.refusal) for start in starts)
    remarks = [
        f"{objective.name} = {value:.7g} {objective.unit or DIMENSIONLESS} after {best.runs} runs; {same} of "
        f"{len(starts)} starts led to that value" + (f", {refused} could not be run" if refused else ""),
        f"held by {'; '.join(held)}" if held else "no condition and no bound holds it",
    ]
    if best.is_flat(rounded):
        remarks.append(
            "the same in all runs, but for rounding: no unknown changes it between its bounds, as far as they show"
        )
    alone = search.search != "global" and len(starts) == 1
    return [*remarks, "one start only: there may be better ones"] if alone else remarks


def check_search(scenario: Scenario, search: Find, quantities: Quantities) -> None:
    """Check names, units and paths of a search, with nothing solved."""
    with scenario.document.locating("find"):
        search.check_names(quantities, scenario.concluded, scenario.unit_at)
    for path, unknown in search.unknown.items():
        values = [value for value in (float(unknown), unknown.low, unknown.high) if np.isfinite(value)]
        errors = [_failure(scenario, path, unknown.written(value)) for value in values]
        if None not in errors and (error := errors[0]):
            error.message = f"{path}: {error.message}"
            near = _near(scenario, path)
            error.hint = f"a number of the scenario or its mechanism, such as {', '.join(near)}" if near else error.hint
            raise error


def _failure(scenario: Scenario, path: str, text: str) -> PinarmError | None:
    """Return why a scenario cannot be prepared with a value at a path; none where it can, or numerics decide."""
    try:
        document = scenario.document.assigned(path, text, scenario.document.locate(("find", "for", path)))
        other = scenario.with_document(document)
        other.problem.prepare(other.mechanism, other.content.accuracy, other.place)
    except NumericsError:
        return None
    except PinarmError as error:
        return error
    return None


def _near(scenario: Scenario, path: str) -> list[str]:
    """Return paths of numbers like a path that leads nowhere; none for a path of a number."""
    paths = [joined(steps) for steps in _numbers(scenario.document.data, []) if steps[0] not in ("find", "expect")]
    if path in scenario.mechanism.arguments:
        return [f"arguments.{path}"]
    known = [*paths, *(f"arguments.{name}" for name in scenario.mechanism.arguments)]
    return [] if path in known else get_close_matches(path, dict.fromkeys(known), n=NEAREST, cutoff=0.4)


def _numbers(data: Any, steps: list[str]) -> Iterator[list[str]]:
    if isinstance(data, dict):
        for key, inner in data.items():
            yield from _numbers(inner, [*steps, str(key)])
    elif isinstance(data, int | float) or (isinstance(data, str) and _is_quantity(data)):
        yield steps


def _is_quantity(text: str) -> bool:
    try:
        read_quantity(text)
    except PinarmError:
        return False
    return True
