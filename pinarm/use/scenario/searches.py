"""Searches: solves a scenario for the values that its key ``find`` asks, by root finding or optimisation.

With x the unknown numbers and r(x) the wanted quantities less their targets over all rows of the run, x minimises
``|r(x)|^2`` by Levenberg-Marquardt steps (MINPACK; More, Garbow and Hillstrom, ANL-80-74, 1980) with slopes by central
differences whose widths follow the numbers. Quantities are taken as they are reported: an angle that jumps from 180 to
-180 degrees is found on that side of the jump from which the search comes. Of an optimum see ``optimum``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import LOST
from pinarm.engine.series import Series
from pinarm.errors import InputError, IntegrationError, NumericsError, PinarmError, choices
from pinarm.input.units import DIMENSIONLESS
from pinarm.input.yaml.document import joined
from pinarm.records import replace
from pinarm.use.cases.case import Case, Row, RowValues, Taken, Task, Wanted, failure
from pinarm.use.cases.solving import solving
from pinarm.use.progress import tell
from pinarm.use.result.measures import RESIDUALS
from pinarm.use.result.number_accuracy import noise, rounding
from pinarm.use.result.numbers import measured, read_number
from pinarm.use.result.result import Result
from pinarm.use.result.section import Cell, Section, SectionTable
from pinarm.use.scenario.find import Find
from pinarm.use.scenario.optimum import Optimum, Run, Runs

if TYPE_CHECKING:
    from pinarm.engine.quantities.names import Quantities
    from pinarm.use.scenario.scenario import Scenario

EXACT = 1e-6
"""Residual of a run's equations, relative to their terms, above which it cannot be an optimum: they are met to rounding
in a regular position."""

AGREED = 1e-3, 1e-7
"""Difference of objectives below which starts have led to the same value, relative to it, and to that of the starts."""

ITERATIONS, SETTLED = 200, 1e-13
"""Largest number of runs of a search, slopes apart; change of the values, relative to them, at which it ends."""

BARRIER, BARRED = 1e3, 1e-3
"""Relative to the residuals at the start: those of refused runs, from which the search turns back; those above which a
refused run is reported as what stopped the search."""

MET = 1e-9
"""Largest remainder of a wanted quantity that is met, relative to its remainder at the start."""

INDEPENDENT = 1e-9
"""Smallest singular value of the scaled Jacobian, relative to the largest, with which the values are determined."""

WIDTH = 1e-3
"""Half width of differences, relative to the size of the number, which is at least this part of its start."""


def solve_found(scenario: Scenario, search: Find) -> Result:
    """Find the unknown values and solve the problem with them."""
    bare = scenario.restated({key: value for key, value in scenario.document.data.items() if key != "find"})
    check_search(scenario, search, bare.quantities())
    with scenario.document.locating("find"):
        if search.objective is None:
            return _balanced(bare, search)
        optimum = _best(bare, search)
    values = optimum.values(optimum.best)
    result = bare.varied(search.case(values)).run()
    objective = search.objective.described(result.quantities, bare.concluded)
    error, (rounded,) = search.objective.value(result)[1], rounding(result, [objective.unit])
    section = optimum_section(search, optimum, objective, error, float(rounded))
    return replace(result, figures={**result.figures, **search.figures(values)}, known={"find": section})


def _balanced(bare: Scenario, search: Find) -> Result:
    """Return the result whose quantities, at all rows, and numbers of the run are what is wanted.

    Its figures tell the remainders; a remark names quantities that are missed by more than rounding and the tolerance
    of runs explain.
    """
    wanted = search.wanted or {}
    numbers = {name: search.number(name, bare.concluded) for name in wanted}
    of_rows = sum(number is None for number in numbers.values())

    def remainders(row: Row) -> Run:
        rows = (len(row.taken) - len(numbers) + of_rows) // max(of_rows, 1)
        names = [name for name, number in numbers.items() for _ in range(1 if number else rows)]
        return Run(np.array(row.taken) - [float(wanted[name]) for name in names], names)

    taken = [Wanted(name, number) if number else RowValues(name) for name, number in numbers.items()]
    with _searching(bare, search, taken, search.case, remainders) as runs:
        root = find_root(search, runs)
    result = bare.varied(search.case(root.values)).solve()
    numbered = {name: number or read_number(f"{name} @ start") for name, number in numbers.items()}
    missed = [numbered[name] for name in root.missed]
    known = noise(result, missed, [measured(number, result) for number in missed]).tolist()
    errors = dict(zip(root.missed, known, strict=True))
    left, remainder = list[str](), dict[str, float]()
    for name, value in wanted.items():
        unit = value.unit or numbered[name].described(result.quantities, result.numbered).unit or DIMENSIONLESS
        before, rest = root.before[name] / unit.factor, root.residuals[name] / unit.factor
        remainder[f"left of {name} [{unit}] (started with {before:.3g})"] = rest
        if root.residuals[name] > errors.get(name, np.inf):
            left.append(f"{name} by {rest:.3g} {unit}")
    notes = [f"so_that is not met: the closest values that were found miss {', '.join(left)}"] if left else []
    figures = {**result.figures, **search.figures(root.values), **remainder}
    return replace(result, figures=figures, outcome=replace(result.outcome, notes=(*result.outcome.notes, *notes)))


def _best(bare: Scenario, search: Find) -> Optimum:
    (low, high), conditions = search.bounds, search.conditions
    numbers = [number for number in (search.objective, *(each.compared for each in conditions)) if number]

    def margins(row: Row) -> Run:
        pairs = zip(conditions, row.taken[1:], strict=True)
        margins = [condition.margin(x) for condition, x in pairs]
        return Run(np.array([search.sign * row.taken[0], *margins]), refusal=refusal(row.figures))

    taken = [Wanted(number.label, number) for number in numbers]
    with _searching(bare, search, taken, lambda x: search.case(scaled.values(x)), margins) as runs:
        scaled = Optimum(low, high, search.start, runs, conditions)
        return scaled.solved(search.starts, search.seed, everywhere=search.search == "global")


@contextmanager
def _searching(
    bare: Scenario,
    search: Find,
    taken: Sequence[Taken],
    case_of: Callable[[Array], Case],
    read: Callable[[Row], Run],
) -> Iterator[Runs]:
    """Yield the runs of a search, and tell their number while they are solved."""
    task, number = Task.of(bare, taken, search.case(search.start)), count(1)
    with solving(task, bare.runners) as solve:

        def run(points: Sequence[Array]) -> Iterator[Run]:
            cases = [case_of(x) for x in points]
            for case, row in zip(cases, solve(cases), strict=True):
                tell(f"find: run {next(number)}")
                yield Run.refused(row.error, partial(failure, task, case, row)) if row.error else read(row)

        yield Runs(run)


def refusal(figures: Mapping[str, float]) -> str:
    """Return why the measures of accuracy of a run do not allow it to be an optimum; empty where they do."""
    if figures.get("energy", 0.0) >= LOST:
        return f"{figures['energy']:.2g} of the energy exchanged is not accounted for"
    for name in RESIDUALS:
        if name != "energy" and figures.get(name, 0.0) > EXACT:
            return f"its residual '{name}' is {figures[name]:.1e}"
    return ""


def optimum_section(search: Find, optimum: Optimum, objective: Series, error: float, rounded: float = 0.0) -> Section:
    """Return the section of a search.

    Args:
        search: What was asked.
        optimum: The best unknowns, and how they were found.
        objective: Name and unit of the objective, without values.
        error: What its quadrature leaves of the objective at the best values [SI].
        rounded: Size up to which the objective is rounding [SI].
    """
    value = search.sign * optimum.run(optimum.best).numbers[0]
    numbers = {
        path: Series(path, unknown.unit.si if unknown.unit else DIMENSIONLESS, np.array([end]))
        for (path, unknown), end in zip(search.unknown.items(), optimum.values(optimum.best), strict=True)
    }
    numbers["objective"] = Series(objective.name, objective.unit, np.array([value]))
    remarks = _remarks(search, optimum, objective, value, rounded)
    if error:
        left = f"{error:.1e} {objective.unit or DIMENSIONLESS}"
        remarks.append(f"at these values the objective is known to {left}, beside the error of the motion")
    title = f"{'Least' if search.sign > 0 else 'Largest'} {objective.name}"
    return Section("find", title, _tables(search, optimum), numbers, remarks, errors={"objective": error})


def _tables(search: Find, optimum: Optimum) -> list[SectionTable]:
    """Return the best values with their bounds in the units of the file, and the margins of conditions."""
    factors = np.array([unknown.factor for unknown in search.unknown.values()])
    units = [str(unknown.unit or "1") for unknown in search.unknown.values()]
    ends = (optimum.values(optimum.best) / factors, optimum.low / factors, optimum.high / factors)
    values = [*zip(search.unknown, units, *(end.tolist() for end in ends), strict=True)]
    pairs = zip(search.conditions, optimum.run(optimum.best).numbers[1:].tolist(), strict=True)
    rows = [(str(condition), margin, "active" * (k in optimum.active)) for k, (condition, margin) in enumerate(pairs)]
    table = _table(
        "values", "Best values, and their bounds", ["", "unit", "best", "lower bound", "upper bound"], values
    )
    kept = _table("conditions", "Conditions and their margins in SI", ["", "margin", "active"], rows)
    return [table, kept] if rows else [table]


def _table(key: str, title: str, names: Sequence[str], rows: Sequence[tuple[Cell, ...]]) -> SectionTable:
    return SectionTable(key, title, tuple(names), (None,) * len(names), rows)


def _remarks(search: Find, optimum: Optimum, objective: Series, value: float, rounded: float) -> list[str]:
    """Return remarks on the optimum: conditions and bounds that hold it, starts that led there, refused runs."""
    held = [str(search.conditions[k]) for k in optimum.active]
    for (path, unknown), end in zip(search.unknown.items(), optimum.values(optimum.best), strict=True):
        for bound, name in ((unknown.low, "lower"), (unknown.high, "upper")):
            if abs(end - bound) <= 1e-6 * (unknown.high - unknown.low):
                held.append(f"{path} at its {name} bound {unknown.written(bound)}")
    held += [f"refused runs beside this value of {[*search.unknown][k]}" for k in optimum.beside_refused]
    *ends, _ = optimum.ends
    gap, best = max(AGREED[0] * abs(value), AGREED[1] * optimum.sizes[0]), optimum.run(optimum.best).numbers[0]
    same = sum(optimum.rank(x)[:2] == (False, 0.0) and abs(optimum.run(x).numbers[0] - best) <= gap for x in ends)
    refused = sum(bool(optimum.run(end).refusal) for end in ends)
    remarks = [
        f"{objective.name} = {value:.7g} {objective.unit or DIMENSIONLESS} after {len(optimum.runs.known)} runs; "
        f"{same} of {len(ends)} starts led to that value" + (f", {refused} could not be run" if refused else ""),
        f"held by {'; '.join(held)}" if held else "no condition and no bound holds it",
    ]
    if optimum.is_flat(rounded):
        remarks.append(
            "the same in all runs, but for rounding: no unknown changes it between its bounds, as far as they show"
        )
    alone = search.search != "global" and len(ends) == 1
    return [*remarks, "one start only: there may be better ones"] if alone else remarks


def check_search(scenario: Scenario, search: Find, quantities: Quantities) -> None:
    """Check names, units and paths of a search, with nothing solved."""
    with scenario.document.locating("find"):
        search.check_names(quantities, scenario.concluded, scenario.unit_at)
    for path, unknown in search.unknown.items():
        try:
            document = scenario.document.assigned(
                path, unknown.written(float(unknown)), scenario.document.locate(("find", "for", path))
            )
            start = scenario.with_document(document)
            start.problem.prepare(start.mechanism, start.content.accuracy, start.place)
        except NumericsError:  # other values may be solved
            continue
        except PinarmError as error:
            error.message = f"{path}: {error.message}"
            if near := _near(scenario, path):
                error.hint = f"a number of the scenario or its mechanism, such as {near}"
            raise


def _near(scenario: Scenario, path: str) -> str:
    """Return the path of the scenario like one that leads nowhere; empty for a path of the scenario."""
    arguments, places = scenario.mechanism.arguments, scenario.document.places
    if path in arguments:
        return f"arguments.{path}"
    known = [joined(steps) for steps in places if steps and steps[0] not in ("find", "expect")]
    near = choices(path, [*known, *(f"arguments.{name}" for name in arguments)])[1]
    return near if near != path else ""


@dataclass(frozen=True)
class FoundValues:
    """Result of a search.

    Attributes:
        values: Values in SI, shape (k,).
        residuals: Quantity -> largest remainder over the rows, in SI.
        before: The same at the start.
    """

    values: Array
    residuals: Mapping[str, float]
    before: Mapping[str, float]

    @property
    def missed(self) -> list[str]:
        """Quantities that are not met."""
        return [name for name, left in self.residuals.items() if left > MET * self.before[name]]


def find_root(search: Find, runs: Runs) -> FoundValues:
    """Return the values that a search finds from its start.

    Args:
        search: Unknown numbers and wanted quantities.
        runs: Remainders of the wanted quantities, each with the name of its quantity.
    """
    from scipy.optimize import least_squares

    start, tried = search.start, len(runs.known)
    (begin,) = runs.at([start])
    if begin.error:
        raise begin.error()
    first = begin.numbers
    barrier = BARRIER * np.maximum(np.abs(first), np.linalg.norm(first) or 1.0)

    def residuals(x: Array) -> Array:
        (run,) = runs.at([x])
        return barrier if run.error else _same_rows(run, begin)

    def slopes(x: Array) -> Array:
        return runs.slopes(lambda run: _same_rows(run, begin), x, WIDTH * _sizes(search, x))

    if len(first) < len(start) or not slopes(start).any():
        raise _stopped(search, runs, tried) or _undetermined([*search.unknown])
    options = {"ftol": 1e-15, "xtol": SETTLED, "gtol": 1e-15, "max_nfev": ITERATIONS}
    ended = least_squares(residuals, start, slopes, method="lm", x_scale=_sizes(search, start), **options)
    if not ended.status:
        raise IntegrationError(
            f"the values of {', '.join(search.unknown)} do not settle in {ITERATIONS} steps",
            hint="other starts, or quantities that depend on them more smoothly",
        )
    if tied := _tied(search, ended.jac):
        raise _undetermined(tied)
    if np.sqrt(2.0 * ended.cost) > BARRED * np.linalg.norm(first) and (error := _stopped(search, runs, tried)):
        raise error
    (end,) = runs.at([ended.x])
    after, before = (
        {name: float(np.abs(run.numbers[np.array(begin.names) == name]).max()) for name in begin.names}
        for run in (end, begin)
    )
    return FoundValues(ended.x, after, before)


def _same_rows(run: Run, begin: Run) -> Array:
    """Return the numbers of a run that has as many as that at the start, or raise."""
    if len(run.numbers) != len(begin.numbers):
        raise InputError(
            "so_that compares runs row by row, and they have not as many rows: one ends earlier, or has other impacts",
            expected="runs with the same rows",
            hint="a number of the run, such as 'C_B @ end' or 'C_B @ max'",
        )
    return run.numbers


def _sizes(search: Find, x: Array) -> Array:
    """Return the sizes of the numbers at a point, shape (k,): of 0 that of its unit."""
    units = np.array([unknown.factor for unknown in search.unknown.values()])
    sizes = np.maximum(np.abs(x), WIDTH * np.abs(search.start))
    return np.where(sizes > 0.0, sizes, units)


def _stopped(search: Find, runs: Runs, tried: int) -> PinarmError | None:
    """Return the error of the first refused run after those that have been tried before; none where there is none."""
    for x, run in [*runs.known.values()][tried:]:
        if run.error:
            error, values = run.error(), search.figures(x).items()
            where = ", ".join(f"{path} = {value:.6g}" for path, value in values)
            error.message = f"the search is stopped by a run that is refused, at {where}: {error.message}"
            error.hint = error.hint or "another start, or a wish that runs on this side can meet"
            return error
    return None


def _tied(search: Find, jacobian: Array) -> list[str]:
    """Return the paths of numbers that slopes, shape (rows, k), do not determine."""
    columns = np.linalg.norm(jacobian, axis=0)
    _, s, vt = np.linalg.svd(jacobian / np.where(columns > 0.0, columns, 1.0))
    if (s > INDEPENDENT * s[0]).all():
        return []
    return [path for path, share in zip(search.unknown, vt[-1], strict=True) if abs(share) > 0.1]


def _undetermined(paths: Sequence[str]) -> InputError:
    return InputError(
        f"what is wanted does not determine {', '.join(paths)}",
        expected="unknowns that change what is wanted, each in its own way",
        hint="fewer unknowns, another start, or more quantities in so_that",
    )
