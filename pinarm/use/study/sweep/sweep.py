"""Sweep: a scenario solved for many values of its numbers, and the table of the results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from pinarm.engine.dynamics.dynamics import cores
from pinarm.engine.series import Series
from pinarm.errors import InputError, Interrupted, NumericsError, PinarmError, require_map, require_name
from pinarm.input.roots import noting_files
from pinarm.input.yaml.document import Values, require_apart
from pinarm.records import replace
from pinarm.use.cases.case import WORTH, FunctionValue, Taken, Task, Wanted
from pinarm.use.facade import Given, Scenario, load
from pinarm.use.result.numbers import read_number
from pinarm.use.store.line_table import LineTable
from pinarm.use.study.sweep.axes import MOST, Axis, Cases, Distribution, Sampling, UnitOf, draw, read_axis, read_cases
from pinarm.use.study.sweep.branches import ALL, MEASURE, RAW, ModeValues
from pinarm.use.study.sweep.parquet import require_parquet
from pinarm.use.study.sweep.solving import Solving
from pinarm.use.workers.runners import Runners, check_number

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.show.picture import Picture

TRIED = 9
"""Cases, spread over those of a sweep, that are checked until one is right: what all suffer from is the sweep's."""

ANCHORS = 5
"""Cases, spread over those of a sweep, from the first of which that can be solved loops of all others are closed."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Sweep(LineTable):
    """Results of a sweep; ``columns`` are results and measures of accuracy, NaN where a case does not come to them.

    Attributes:
        title: Title of the scenario.
        definition: What was asked, as plain data.
        cases: The values of every case.
        notes: What to know of the results.
    """

    title: str
    definition: Mapping[str, Any]
    cases: Cases
    notes: Sequence[str] = ()
    of: ClassVar[str] = "case"

    def __len__(self) -> int:
        return len(self.cases)

    @property
    def given(self) -> list[Series]:
        """The columns that were varied, in the units they were given in."""
        return self.cases.table()

    def __getitem__(self, name: str) -> Series:
        """Return a column by name; that of a number as it may be asked for: ``C_B @ max(C_B)`` is ``C_B @ max``.

        Raises:
            InputError: There is none of that name; the message lists those there are.
        """
        require_name(name)
        return super().__getitem__(read_number(name).label if "@" in name and name not in self.table else name)

    def results(self) -> list[Series]:
        """Return the columns that were asked for, without the measures of accuracy."""
        return [series for series in self.columns if series.name not in WORTH]

    @property
    def missing(self) -> dict[str, list[int]]:
        """Return the results that are not finite in cases that did not fail, and which these are."""
        empty = {series.name: np.flatnonzero(np.isnan(series.values)).tolist() for series in self.results()}
        known = {name: [case for case in cases if case not in self.errors] for name, cases in empty.items()}
        return {name: cases for name, cases in known.items() if cases}

    def summary(self) -> dict[str, Any]:
        """Return statistics of every result, the worst measures of accuracy, cases without a result, and failures."""
        from pinarm.use.study.sweep.sweep_files import summary

        return summary(self)

    def plot(self, name: str | None = None) -> Picture:
        """Return a plot of a column over what was varied: curves, a map, or how often which value came out.

        Args:
            name: The column; the first result where it is left out. ``mode.1.damping`` draws all branches of modes,
                ``root_locus`` their eigenvalues.
        """
        from pinarm.use.study.sweep.plots import pictured, plot

        if name is None:
            return plot(self, self.columns[0])
        pictures = {series.name: series for series in pictured(self)}
        return plot(self, pictures[name] if name in pictures else self[name])

    def save(
        self,
        folder: str | Path,
        *,
        plots: Literal["svg", "png", "pdf"] | bool = True,
        dpi: int = 200,
        parquet: bool = False,
    ) -> Path:
        """Write ``sweep.yaml``, ``cases.csv``, ``cases.npz``, ``summary.json`` and plots; return the folder.

        Args:
            folder: The folder; see ``sweep_files.save``.
            plots: Format of the pictures, ``svg`` (the default), ``png`` or ``pdf``; ``False`` for none.
            dpi: Pixels per inch of PNG.
            parquet: Whether the table is written as Parquet too, in parts of 10,000 cases, by pyarrow.
        """
        from pinarm.use.study.sweep.sweep_files import save

        return save(self, Path(folder), plots=plots, dpi=dpi, parquet=parquet)

    def _repr_html_(self) -> str:
        """Return statistics and a plot, for notebooks."""
        from pinarm.use.show.notebook import blocks, heading, lines, picture, table
        from pinarm.use.study.sweep.sweep_files import ranges, remarks

        parts = heading(self.title or self.name), table(ranges(self)), lines(remarks(self)), picture(self.plot())
        return blocks(*parts)


def sweep(
    scenario: Given,
    over: Mapping[str, object] | None = None,
    *,
    values: Values | None = None,
    cases: str | Path | None = None,
    samples: int | None = None,
    seed: int = 0,
    sampling: Literal["random", "latin"] = "random",
    results: Sequence[str | Callable[[Result], Any]] | str | Callable[[Result], Any] = (),
    workers: int | None = None,
    executor: Executor | None = None,
    folder: str | Path | None = None,
    parquet: bool = False,
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
        parquet: Whether the table appears as Parquet in ``folder/partial/cases.parquet`` while cases are solved, each
            part of 10,000 cases as soon as all of them are, by pyarrow; ``save`` removes it.
        progress: Called after every case: ``progress(done, failed, total)``, numbers of cases.

    Raises:
        InputError: The sweep cannot be done as it stands. A case that fails does not raise: ``Sweep.errors`` has it.
        Interrupted: By the user; ``partial`` holds the sweep so far.
    """
    check_number(workers)
    require_map(over or {}, "paths and their values", "{'arguments.m_A': '0.1:0.5:41 kg'}")
    if parquet:
        require_parquet()
    scenario = load(scenario, values)
    given = {path: _plain(x) for path, x in (over or {}).items()}
    with noting_files() as files:
        chosen = Cases.of(axes_of(scenario.unit_at, given, cases, samples, seed, sampling))
        require_apart(scenario.document.data, values or (), (column.path for column in chosen.columns()))
        wanted, columns = measured_results(scenario, chosen, _listed(results) or scenario.content.outputs)
    solving = Solving(_task(scenario, chosen, wanted), chosen, columns, progress, parquet)
    solving.sources.check(tuple(map(str, files)))
    definition = {"over": given, "cases": None if cases is None else str(cases), "samples": samples, "seed": seed,
                  "sampling": sampling}  # fmt: skip
    interrupted = False
    try:
        runners = Runners(workers if executor is not None else workers or cores(), executor)
        solving.run(runners, None if folder is None else Path(folder))
    except KeyboardInterrupt:
        interrupted = True
    swept = swept_of(scenario, solving, definition, _notes(scenario, chosen, wanted))
    if interrupted:
        said = f"interrupted with {solving.done} of {len(chosen)} cases solved"
        hint = "the same command again: it goes on from there" if folder is not None else ""
        raise Interrupted(said, partial=swept, hint=hint)
    return swept


def swept_of(scenario: Scenario, solving: Solving, definition: Mapping[str, Any], notes: Sequence[str] = ()) -> Sweep:
    """Return the table of cases that have been solved.

    Args:
        scenario: What was solved.
        solving: The cases.
        definition: How their values were given.
        notes: What to know of the results.
    """
    cases, columns, found = solving.cases, solving.columns(), list(notes)
    asked = [series.name for series in solving.results if not series.name.startswith(RAW)]
    for entry in solving.task.wanted:
        if isinstance(entry, ModeValues):
            columns, more = entry.followed(cases, columns)
            asked, found = [*entry.asked, *asked], [*found, *more]
    base = {key: value for key, value in scenario.document.data.items() if key != "expect"}
    units = {column.path: column.unit for column in cases.columns() if column.unit}
    whole = {"scenario": str(scenario.document.path or ""), **definition, "units": units,
             "results": asked, "base": base}  # fmt: skip
    return Sweep(
        name=scenario.name, title=scenario.content.title, definition=whole, cases=cases, columns=columns,
        errors=solving.failures(), presentation=scenario.content.presentation, notes=found,
    )  # fmt: skip


def _plain(given: object) -> object:
    """Return the values of an array as a list, those of a ``Series`` as texts with its unit."""
    if isinstance(given, Series):
        return [f"{value!r} {given.unit or ''}" for value in np.atleast_1d(given.values).tolist()]
    return given.tolist() if isinstance(given, np.ndarray) else given


ResultFunction = Callable[["Result"], Any]
"""Computes one number of the result of a case."""


def _listed(results: Sequence[str | ResultFunction] | str | ResultFunction) -> list[str | ResultFunction]:
    return [results] if isinstance(results, str) or callable(results) else [*results]


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
    """Return what is taken from each case, checked at an end of the sweep, and the columns of it, still empty.

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


def _task(scenario: Scenario, cases: Cases, wanted: Sequence[Taken]) -> Task:
    """Return what workers do: closed loops are continued from cases spread over the sweep."""
    anchors = np.unique(np.linspace(0, len(cases) - 1, ANCHORS).astype(int)).tolist()
    return Task.of(scenario, wanted, *map(cases.values, anchors))


def _notes(scenario: Scenario, cases: Cases, wanted: Sequence[Taken]) -> list[str]:
    """Return notes of the first and the last case: figures not over whole periods, a removed method of integration."""
    numbers = [entry.number for entry in wanted if entry.number is not None]
    notes = []
    for case in (0, len(cases) - 1):
        with suppress(PinarmError):  # a case that fails says why itself
            varied = scenario.varied(cases.values(case))
            notes += [f"case {case}: {note}" for note in varied.method_notes(varied.content.accuracy)]
            if numbers:
                from pinarm.use.result.whole_periods import whole_period_notes

                notes += [
                    f"case {case}: {note}" for note in whole_period_notes(varied.problem, varied.mechanism, numbers)
                ]
    return list(dict.fromkeys(notes))


def axes_of(
    unit_of: UnitOf,
    over: Mapping[str, object],
    cases: str | Path | None,
    samples: int | None,
    seed: int,
    how: Sampling,
) -> Iterator[Axis]:
    """Yield the axes: the lines of a file, then what is drawn, then each list or grid.

    Args:
        unit_of: Path -> the unit of bare numbers.
        over: Path -> values; see ``sweep``, as for the others.
        cases: A file of cases.
        samples: How many values to draw.
        seed: Of the drawing.
        how: Of the drawing.

    Raises:
        InputError: Something is to be drawn and it is not said how often, or the other way round.
    """
    if cases is not None:
        yield read_cases(Path(cases), unit_of)
    read = [read_axis(path, given, unit_of) for path, given in over.items()]
    drawn = [values for values in read if isinstance(values, Distribution)]
    if drawn and (samples is None or not 1 <= samples <= MOST):
        raise InputError(
            f"'{drawn[0].path}' is to be drawn",
            expected=f"how many samples to draw, 1 to {MOST:,}",
            hint="--sample 1000",
        )
    if seed < 0:
        raise InputError(f"the seed is {seed}", expected="a whole number from 0")
    if (samples is not None or how != "random") and not drawn:
        raise InputError("there is nothing to draw samples of", expected="a distribution, such as normal(0.25, 0.01) m")
    if drawn and samples is not None:
        yield draw(drawn, samples, seed, how)
    yield from (values for values in read if isinstance(values, Axis))


def first_case(scenario: Scenario, cases: Cases) -> Scenario:
    """Return the first case, or where that is refused one of several others; a sweep that has none is refused itself.

    The variants of the scenario are none of the sweep's.

    Raises:
        PinarmError: What the first case suffers from.
    """
    errors, last = [], len(cases) - 1
    for case in dict.fromkeys([0, last, *np.linspace(0, last, TRIED).astype(int).tolist()]):
        try:
            end = scenario.varied(cases.values(case)).without_variants()
            end.validate()
        except PinarmError as error:
            errors.append(error)
        else:
            return end
    raise errors[0]
