"""Sweep: a scenario solved for many values of its numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import Interrupted, NumericsError, PinarmError, require_map
from pinarm.input.roots import noting_files
from pinarm.input.yaml.document import Values, require_apart
from pinarm.records import replace
from pinarm.use.cases.case import FunctionValue, Taken, Task, Wanted
from pinarm.use.facade import Given, Scenario, load
from pinarm.use.study.sweep.axes import Cases, axes_of
from pinarm.use.study.sweep.branches import ALL, MEASURE, RAW, ModeValues
from pinarm.use.study.sweep.solving import Solving
from pinarm.use.study.sweep.table import Sweep
from pinarm.use.workers.dispatch import cores
from pinarm.use.workers.runners import Runners, check_number

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

TRIED = 9
"""Cases, spread over those of a sweep, that are checked until one is right: what all suffer from is the sweep's."""

ResultFunction = Callable[["Result"], Any]
"""Computes one number of the result of a case."""


def sweep(
    scenario: Given,
    over: Mapping[str, object] | None = None,
    *,
    values: Values | None = None,
    cases: str | Path | None = None,
    samples: int | None = None,
    seed: int = 0,
    sampling: Literal["random", "latin"] = "random",
    results: Sequence[str | ResultFunction] | str | ResultFunction = (),
    workers: int | None = None,
    executor: Executor | None = None,
    folder: str | Path | None = None,
    progress: Callable[[int, int, int], None] = lambda done, failed, total: None,
) -> Sweep:
    """Solve a scenario for many values of numbers in it or in its model.

    Args:
        scenario: The scenario, or its file.
        over: Path -> values: text such as ``"0.1:0.5:41 kg"`` or ``"normal(0.25, 0.001) m"``, a list, an array, or a
            ``Series`` in its unit. Paths are those of ``values``: ``arguments.m_A``, ``problem.time.end``,
            ``changes.forces.spring.stiffness``.
        values: Other values than those of the file, the same in all cases, such as ``{"problem.time.end": "3 s"}``; see
            ``pinarm.load``.
        cases: A CSV file whose lines are cases, with paths and units in its heading.
        samples: How many values to draw from distributions.
        seed: Of the drawing; the same seed gives the same values.
        sampling: ``random``, or ``latin`` for a Latin hypercube.
        results: What to take from each case, such as ``"C_B"`` (least and greatest row), ``"C_B @ max"``,
            ``"t @ max(C_B)"``, ``"C_B @ t=1.5 s"``, ``"C_B @ max - C_B @ min"``; or a function ``f(result)`` that
            returns one number in SI, or a ``Series`` of one value, and names its column. The outputs of the scenario
            where nothing is named.
        workers: Processes; all cores where it is left out. Of an executor, how many workers it has, where it cannot
            tell.
        executor: Who solves the cases in place of processes of this machine: any of ``concurrent.futures``, such as
            ``dask.distributed.Client(...).get_executor()``. Its workers see the same files; it is not shut down.
        folder: Where to keep what is finished; a sweep that finds its cases there does not solve them again.
        progress: Called after every case: ``progress(done, failed, total)``, numbers of cases.

    Raises:
        InputError: The sweep cannot be done as it stands. A case that fails does not raise: ``Sweep.errors`` has it.
        Interrupted: By the user; ``partial`` holds the sweep so far.
    """
    check_number(workers)
    require_map(over or {}, "paths and their values", "{'arguments.m_A': '0.1:0.5:41 kg'}")
    scenario, asked = load(scenario, values), [results] if isinstance(results, str) or callable(results) else results
    given = {path: _plain(x) for path, x in (over or {}).items()}
    definition: dict[str, Any] = {"over": given, "cases": None if cases is None else str(cases)}
    definition |= {"samples": samples, "seed": seed, "sampling": sampling}
    with noting_files() as files:
        chosen = Cases.of(axes_of(scenario.unit_at, given, cases, samples, seed, sampling))
        require_apart(scenario.document.data, values or (), (column.path for column in chosen.columns()))
        wanted, columns = measured_results(scenario, chosen, asked or scenario.content.outputs)
        solving = Solving(Task.of(scenario, wanted), chosen, columns, progress)
    solving.check(map(str, files))
    runners = Runners(workers if executor is not None else workers or cores(), executor)
    try:
        solving.run(runners, None if folder is None else Path(folder))
        interrupted = False
    except KeyboardInterrupt:
        interrupted = True
    table = swept_of(scenario, solving, definition, scenario.method_notes(scenario.content.accuracy))
    if interrupted:
        text = f"interrupted with {solving.done} of {len(chosen)} cases solved"
        hint = "the same command again: it goes on from there" if folder is not None else ""
        raise Interrupted(text, partial=table, hint=hint)
    return table


def swept_of(scenario: Scenario, solving: Solving, definition: Mapping[str, Any], notes: Sequence[str] = ()) -> Sweep:
    """Return the table of cases that have been solved; the definition says how their values were given."""
    cases, columns = solving.cases, solving.columns()
    asked = [series.name for series in solving.results if not series.name.startswith(RAW)]
    for entry in solving.task.wanted:
        if isinstance(entry, ModeValues):
            columns, of_branches = entry.followed(cases, columns)
            asked, notes = [*entry.asked, *asked], [*notes, *of_branches]
    base = {key: value for key, value in scenario.document.data.items() if key != "expect"}
    units = {column.path: column.unit for column in cases.columns() if column.unit}
    path = str(scenario.document.path or "")
    return Sweep(
        name=scenario.name,
        title=scenario.content.title,
        definition={"scenario": path, **definition, "units": units, "results": asked, "base": base},
        cases=cases,
        columns=columns,
        errors=solving.failures(),
        presentation=scenario.content.presentation,
        notes=notes,
    )


def _plain(values: object) -> object:
    """Return the values of an array as a list, those of a ``Series`` as texts with its unit."""
    if isinstance(values, Series):
        return [f"{value!r} {values.unit or ''}" for value in np.atleast_1d(values.values).tolist()]
    return values.tolist() if isinstance(values, np.ndarray) else values


def _measured_function(function: ResultFunction, scenario: Scenario) -> tuple[FunctionValue, list[Series]]:
    """Return the number of a function with the unit that it has in a case that can be solved, and its empty column."""
    value = FunctionValue.read(function)
    with suppress(NumericsError):
        measured = value.series(scenario.run()).unit
        value = replace(value, unit=measured.si if measured else None)
    return value, [Series(value.name, value.unit, np.zeros(0))]


def measured_results(
    scenario: Scenario, cases: Cases, results: Sequence[str | ResultFunction]
) -> tuple[list[Taken], list[Series]]:
    """Return the numbers taken from each case, checked at an end of the sweep, and their columns, still empty.

    Measures of modes, ``mode.1.damping`` or ``modes`` for all, are those of branches; see ``branches``.
    """
    first, sections = first_case(scenario, cases), scenario.numbered
    quantities, texts = first.quantities(), [text for text in results if isinstance(text, str)]
    modes = [text for text in texts if scenario.problem.kind == "linear" and (text == ALL or MEASURE.fullmatch(text))]
    measured: list[tuple[Taken, list[Series]]] = []
    for asked in results:
        if not isinstance(asked, str):
            measured.append(_measured_function(asked, first))
        elif asked not in modes:
            entry, empty = Wanted.read(asked, sections).measured(quantities, sections)
            measured.append((replace(entry, optional=entry.alone), empty))
    taken = [entry for entry, _ in measured]
    columns = [column for _, columns in measured for column in columns]
    if not modes:
        return taken, columns
    values = ModeValues.of(quantities, modes)
    return [values, *taken], [*values.columns(), *columns]


def first_case(scenario: Scenario, cases: Cases) -> Scenario:
    """Return the first case, or where that is refused one of several others; a sweep that has none is refused itself.

    The variants of the scenario are none of the sweep's.
    """
    errors, last = [], len(cases) - 1
    for case in dict.fromkeys(np.linspace(0, last, TRIED).astype(int).tolist()):
        try:
            end = scenario.varied(cases.values(case)).without_variants()
            end.validate()
        except PinarmError as error:
            errors.append(error)
        else:
            return end
    raise errors[0]
