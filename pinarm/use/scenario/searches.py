"""Searches: solves a scenario for the values that its key ``find`` asks, and reports the optimum as a section."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import LOST
from pinarm.engine.mechanism_loading import mechanism_document
from pinarm.engine.series import Series
from pinarm.errors import InputError, NumericsError, PinarmError
from pinarm.input.roots import contained_file, root_of
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
from pinarm.use.scenario.roots import FoundValues, Refused, find_root

if TYPE_CHECKING:
    from pinarm.engine.quantities.names import Quantities
    from pinarm.use.scenario.scenario import Scenario


EXACT = 1e-6
"""Residual of a run's equations, relative to their terms, above which it cannot be an optimum: they are met to rounding
in a regular position."""

VANISHED = 1e-10
"""Size of a quantity, relative to its figure at the start, below which the figure is one of rounding."""

AT_A_PLACE = ("", "start", "end")
"""Figures that are the value of a quantity at one place."""

SQUARED = ("rms", "peak")
"""Figures that are never negative and whose squares are smooth where they vanish."""

AGREED = 1e-3
"""Difference of objectives, relative to them, below which starts have led to the same value."""


def solve_found(scenario: Scenario, search: Find) -> Result:
    """Find the unknown values and solve the problem with them.

    Raises:
        InputError: A name or a path is wrong, or what is wanted does not depend on the unknowns.
        IntegrationError: Nothing has been found.
        PinarmError: See ``Scenario.run``.
    """
    data = {key: value for key, value in scenario.document.data.items() if key != "find"}
    bare = scenario.restated(data)
    check_search(scenario, search, bare.quantities())
    with scenario.document.locating("find"):
        if search.wanted is not None:
            root = _root(bare, search)
            values, left = root.values, root.left()
        else:
            best = _best(bare, search)
            values, left = best.best.end, {}
    result = bare.varied(search.case(values)).run() if search.objective else bare.varied(search.case(values)).solve()
    result = replace(result, figures={**result.figures, **search.figures(values), **left})
    if search.objective is None:
        remarks = root.remarks(_noise(result, search, root.missed))
        return replace(result, outcome=replace(result.outcome, notes=(*result.outcome.notes, *remarks)))
    objective = search.objective.described(result.quantities, bare.concluded)
    (left,) = rounding(result, [objective.unit])
    best = replace(best, flat=best.flat or best.largest <= left)
    _, error = search.objective.value(result)
    return replace(result, known={"find": optimum_section(search, best, objective, error)})


def _root(bare: Scenario, search: Find) -> FoundValues:
    """Return the values for which quantities, at all rows, and numbers of the run are what is wanted.

    Raises:
        PinarmError: A run on the way fails, or nothing is found.
    """
    wanted = search.wanted or {}
    numbers = {name: search.number(name, bare.concluded) for name in wanted}
    taken = [Wanted(name, number) if number else RowValues(name) for name, number in numbers.items()]
    task = Task.of(bare, taken, search.case(search.start))
    of_rows, runs, sizes = sum(number is None for number in numbers.values()), count(1), list[int]()
    noises = list[float]()

    def left(row: Row) -> dict[str, Array]:
        """Return the wanted quantities less their targets, at all rows, and wanted numbers of the run less theirs."""
        rows = (len(row.taken) - len(numbers) + of_rows) // max(of_rows, 1)
        ends = np.cumsum([1 if number else rows for number in numbers.values()])
        parts = np.split(np.array(row.taken), ends[:-1])
        return {name: part - float(target) for (name, target), part in zip(wanted.items(), parts, strict=True)}

    with solving(task, bare.runners) as solve:

        def residuals(cases: Sequence[Case]) -> Iterator[dict[str, Array] | Refused]:
            for case, row in zip(cases, solve(cases), strict=True):
                tell(f"find: run {next(runs)}")
                if row.error:
                    yield partial(failure, task, case, row)
                    continue
                sizes.append(len(row.taken))
                if "energy" not in row.figures:
                    noises.append(0.0)
                yield left(row) if sizes[-1] == sizes[0] else _of_other_rows

        def floor(values: Array) -> float:
            """Return the noise of a motion that is integrated, by its first run that is asked; of others 0."""
            if not noises:
                tell(f"find: run {next(runs)}")
                noises.extend(_noise(bare.varied(search.case(values)).solve(), search, list(wanted)).values())
            return noises[0]

        return find_root(search, residuals, _angles(search, numbers), floor)


def _noise(result: Result, search: Find, wanted: Sequence[str]) -> dict[str, float]:
    """Return the noise of wanted quantities, at any row, by rounding and the tolerance of the run, in SI."""
    numbers = [search.number(name, result.numbered) or read_number(f"{name} @ start") for name in wanted]
    errors = noise(result, numbers, [measured(number, result) for number in numbers])
    return dict(zip(wanted, errors.tolist(), strict=True))


def _of_other_rows() -> PinarmError:
    """Return the error for two runs whose rows cannot be compared."""
    return InputError(
        "so_that compares runs row by row, and they have not as many rows: one ends earlier, or has other impacts",
        expected="runs with the same rows",
        hint="a number of the run, such as 'C_B @ end' or 'C_B @ max'",
    )


def _angles(search: Find, numbers: Mapping[str, AnyNumber | None]) -> list[str]:
    """Return the wanted quantities, at all rows or at one place, whose wanted values are written as angles."""
    at_places = [
        name
        for name, number in numbers.items()
        if number is None or (isinstance(number, RunNumber) and number.figure in AT_A_PLACE)
    ]
    units = {name: value.unit for name, value in (search.wanted or {}).items()}
    return [name for name in at_places if (unit := units[name]) is not None and str(unit.si) == "rad"]


def _best(bare: Scenario, search: Find) -> Optimum:
    """Return the values for which a number of the run is least or largest.

    Raises:
        InputError: A path leads nowhere, or a value between the bounds is none that may stand there.
    """
    for corner in (search.start, *_bounds(search)):
        bare.varied(search.case(corner))  # what cannot be read fails here, and not as a run that is refused
    judge, runs = _Judge.of(search), count(1)
    with solving(Task.of(bare, judge.wanted, search.case(search.start)), bare.runners) as solve:

        def trials(judge: _Judge, points: Sequence[Array]) -> list[Trial]:
            best = []
            for row in solve([search.case(values) for values in points]):
                tell(f"find: run {next(runs)}")
                best.append(judge.trial(row))
            return best

        (first,) = trials(judge, [search.start])
        if not first.refusal:
            judge = replace(judge, floor=VANISHED * abs(first.objective))
        return optimum(
            Landscape(
                *_bounds(search), search.start, partial(trials, judge),
                judge.conditions, judge.sizes(first),
                squared=judge.sign > 0.0 and judge.of_magnitudes,
            ),
            search.starts, search.seed, everywhere=search.search == "global",
        )  # fmt: skip


@dataclass(frozen=True)
class _Judge:
    """Evaluation of rows in a search for an optimum.

    Attributes:
        objective: The number that is to be least or largest.
        conditions: Conditions on other numbers.
        sign: 1 where the objective is to be least, -1 where it is to be largest.
        floor: Size of the objective's quantity below which its figure is rounding.
    """

    objective: AnyNumber
    conditions: Sequence[Condition]
    sign: float
    floor: float = 0.0

    @classmethod
    def of(cls, search: Find) -> _Judge:
        objective = search.objective
        assert objective is not None
        return cls(objective, search.conditions, 1.0 if search.minimise is not None else -1.0)

    @property
    def of_magnitudes(self) -> bool:
        """Whether the objective is never negative, and its square is smooth where it vanishes."""
        return self.objective.figure in SQUARED

    @property
    def wanted(self) -> list[Wanted]:
        """Numbers taken from each run: objective, numbers of conditions, and for a figure of magnitudes all rows."""
        numbers = [self.objective, *(condition.compared for condition in self.conditions)]
        rows = [self.objective.quantity] if isinstance(self.objective, RunNumber) and self.of_magnitudes else []
        return [*(Wanted(number.label, number) for number in numbers), *map(Wanted, rows)]

    def trial(self, row: Row) -> Trial:
        """Return objective, margins and refusal of the run of a row."""
        if row.error:
            return Trial(refusal=row.error)
        said, *numbers = row.taken
        bounds = numbers[len(self.conditions) :]
        if bounds and max(map(abs, bounds)) <= self.floor:  # rounding has no integral to any number of digits
            said = max(map(abs, bounds))
        pairs = zip(self.conditions, numbers, strict=False)
        return Trial(self.sign * said, tuple(condition.margin(x) for condition, x in pairs), refusal(row.figures))

    def sizes(self, first: Trial) -> list[float]:
        """Return the scales of the margins of conditions, from the run at the start."""
        sizes = [abs(float(condition.bound)) for condition in self.conditions]
        if not first.refusal:
            sizes = [max(size, 1e-3 * abs(size - x)) for size, x in zip(sizes, first.margins, strict=True)]
        return [size or 1.0 for size in sizes]


def _bounds(search: Find) -> tuple[Array, Array]:
    unknowns = search.unknown.values()
    return np.array([unknown.low for unknown in unknowns]), np.array([unknown.high for unknown in unknowns])


def refusal(figures: Mapping[str, float]) -> str:
    """Return why the measures of accuracy of a run do not allow it to be an optimum; empty where they do."""
    if figures.get("energy", 0.0) >= LOST:
        return f"{figures['energy']:.2g} of the energy exchanged is not accounted for"
    for name in RESIDUALS:
        if name != "energy" and figures.get(name, 0.0) > EXACT:
            return f"its residual '{name}' is {figures[name]:.1e}"
    return ""


def optimum_section(search: Find, best: Optimum, objective: Series, error: float) -> Section:
    """Return the section of a search.

    Args:
        search: What was asked.
        best: What came out.
        objective: Name and unit of the objective, without values.
        error: What its quadrature leaves of the objective at the best values [SI].
    """
    sign = 1.0 if search.minimise is not None else -1.0
    value = sign * best.best.trial.objective
    numbers = {
        path: Series(path, unknown.unit.si if unknown.unit else DIMENSIONLESS, np.array([end]))
        for (path, unknown), end in zip(search.unknown.items(), best.best.end, strict=True)
    }
    numbers["objective"] = Series(objective.name, objective.unit, np.array([value]))
    tables = [_values(search, best), _starts(search, best, sign, objective.unit), *_conditions(search, best)]
    remarks = _remarks(search, best, objective, value)
    if error:
        left = f"{error:.1e} {objective.unit or DIMENSIONLESS}"
        remarks.append(f"at these values the objective is known to {left}, beside the error of the motion")
    return Section("find", f"{'Least' if sign > 0 else 'Largest'} {objective.name}", tables, numbers, remarks,
                   errors={"objective": error})  # fmt: skip


def _values(search: Find, best: Optimum) -> SectionTable:
    """Return the values and their bounds in the units of the file."""
    rows: list[tuple[Cell, ...]] = []
    for (path, unknown), end in zip(search.unknown.items(), best.best.end, strict=True):
        low, value, high = (float(x) / unknown.factor for x in (unknown.low, end, unknown.high))
        rows.append((path, str(unknown.unit or "1"), value, low, high))
    names = ("", "unit", "best", "lower bound", "upper bound")
    return SectionTable("values", "Best values, and their bounds", names, (None,) * len(names), rows)


def _starts(search: Find, best: Optimum, sign: float, unit: Unit | None) -> SectionTable:
    """Return where every start has led, in the units of the file."""
    paths = list(search.unknown)

    def row(k: int, descent: Descent) -> tuple[Cell, ...]:
        scale = [unknown.factor for unknown in search.unknown.values()]
        points = [*(descent.start / scale).tolist(), *(descent.end / scale).tolist()]
        said: list[Cell] = ["", ""] if descent.trial.refusal else [sign * descent.trial.objective, descent.violation]
        return (str(k), *points, *said, float(descent.runs), descent.status)

    texts = [f"{path} {end} [{search.unknown[path].unit or '1'}]" for end in ("at start", "at end") for path in paths]
    names = ("start", *texts, f"objective [{unit or '1'}]", "violation", "runs", "end")
    return SectionTable("starts", "All starts, and where each has led", names, (None,) * len(names),
                        [row(k, descent) for k, descent in enumerate(best.descents, start=1)])  # fmt: skip


def _conditions(search: Find, best: Optimum) -> list[SectionTable]:
    if not search.conditions:
        return []
    rows = [
        (str(condition), float(margin), "active" if k in best.active else "")
        for k, (condition, margin) in enumerate(zip(search.conditions, best.best.trial.margins, strict=True))
    ]
    return [
        SectionTable("conditions", "Conditions and their margins in SI", ("", "margin", "active"), (None,) * 3, rows)
    ]


def _remarks(search: Find, best: Optimum, objective: Series, value: float) -> list[str]:
    """Return remarks on the optimum: conditions and bounds that hold it, starts that led there, refused runs."""
    held = [str(search.conditions[k]) for k in best.active]
    for (path, unknown), end in zip(search.unknown.items(), best.best.end, strict=True):
        for bound, name in ((unknown.low, "lower"), (unknown.high, "upper")):
            if abs(end - bound) <= 1e-6 * (unknown.high - unknown.low):
                held.append(f"{path} at its {name} bound {unknown.written(bound)}")
    held += [f"refused runs beside this value of {[*search.unknown][k]}" for k in best.refused]
    starts = [descent for descent in best.descents if descent.status != FURTHER]
    gap = AGREED * best.size
    same = sum(abs(start.trial.objective - best.best.trial.objective) <= gap for start in starts if start.valid)
    refused = sum(bool(start.trial.refusal) for start in starts)
    remarks = [
        f"{objective.name} = {value:.7g} {objective.unit or DIMENSIONLESS} after {best.runs} runs; {same} of "
        f"{len(starts)} starts led to that value" + (f", {refused} could not be run" if refused else ""),
        f"held by {'; '.join(held)}" if held else "no condition and no bound holds it",
    ]
    if best.flat:
        remarks.append(
            "the same in all runs, but for rounding: no unknown changes it between its bounds, as far as they show"
        )
    alone = search.search != "global" and len(starts) == 1
    return [*remarks, "one start only: there may be better ones"] if alone else remarks


NEAREST, MOST_PATHS = 3, 2000
"""Paths that a message names, and paths of a file that are compared with a wrong one at most."""


def check_search(scenario: Scenario, search: Find, quantities: Quantities) -> None:
    """Check names, units and paths of a search, with nothing solved.

    Raises:
        PinarmError: Something is wrong; the message says where.
    """
    with scenario.document.locating("find"):
        search.check_names(quantities, scenario.concluded, scenario.unit_at)
    check_paths(scenario, search.tried, "find", "for")


def check_paths(scenario: Scenario, values: Mapping[str, Sequence[str]], *at: str) -> None:
    """Check that paths lead to numbers of a scenario and its mechanism.

    Args:
        scenario: The scenario.
        values: Path -> values as a file would have them, at least one of which must fit there.
        at: Where the paths are keys in the scenario.

    Raises:
        PinarmError: A path leads nowhere, or no value fits; located at the path in the file, with the nearest paths.
    """
    for path, texts in values.items():
        failures = [error for text in texts if (error := _failure(scenario, path, text, *at))]
        if len(failures) < len(texts):
            continue
        error, known = failures[0], _number_paths(scenario)
        near = get_close_matches(path, known, n=NEAREST, cutoff=0.4) if path not in known else []
        near = [f"arguments.{path}"] if path in scenario.mechanism.arguments else near
        error.message = f"{path}: {error.message}"
        error.hint = f"a number of the scenario or its mechanism, such as {', '.join(near)}" if near else error.hint
        raise error


def _failure(scenario: Scenario, path: str, text: str, *at: str) -> PinarmError | None:
    """Return why a scenario cannot be prepared with a value at a path; none where it can, or numerics decide."""
    try:
        document = scenario.document.assigned(path, text, scenario.document.locate((*at, path)))
        other = scenario.with_document(document)
        other.problem.prepare(other.mechanism, other.content.accuracy, other.place)
    except NumericsError:
        return None
    except PinarmError as error:
        return error
    return None


def _number_paths(scenario: Scenario) -> list[str]:
    """Return paths of numbers that a scenario and its mechanism file have."""
    data, wanted = scenario.document.data, scenario.content.mechanism
    paths = [steps for steps in _numbers(data, []) if steps[0] not in ("pinarm", "find", "expect")]
    if scenario.given is None and Path(wanted).suffix:
        file = contained_file((scenario.folder / wanted).absolute(), root_of(scenario.folder), {})
        paths += [["changes", *steps] for steps in _numbers(mechanism_document(file).data, []) if steps[0] != "pinarm"]
    return [joined(steps) for steps in paths[:MOST_PATHS]]


def _numbers(data: Any, steps: list[str]) -> Iterator[list[str]]:
    """Yield the steps to every number in maps, with a unit or without."""
    if isinstance(data, dict):
        for key, inner in data.items():
            yield from _numbers(inner, [*steps, str(key)])
    elif isinstance(data, int | float) or (isinstance(data, str) and _is_quantity(data)):
        yield steps


def _is_quantity(text: str) -> bool:
    """Tell whether a text is a number with a unit."""
    try:
        read_quantity(text)
    except PinarmError:
        return False
    return True
