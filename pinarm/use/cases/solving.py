"""Solution of cases: those that differ by numbers of the model or of laws only as one array, the others one by one.

The numbers of a case do not depend on those that are solved with it. They are the same to the last digit however cases
are spread over workers: all cases of a kind are solved beside one base, the scenario with the values of the kind.

The base is solved as any other: its checks of names and units hold for all. Masses, inertias and
placements of the others are arrays over the cases, and so are positions, efforts, quantities and measured figures, by
the same functions; laws are read case by case.

A number of a run, such as a maximum between rows or a mean, is found by functions that ask for states at instants which
follow from the states before. They are called for every case; one that lacks states is interrupted and says which, the
states that any case lacks are solved as one array, and the interrupted ones begin anew with these. So the numbers are
found by the same steps as those of a case alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.checks.balance import power_balance, sampled
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.mechanism import alike_variants, mechanism_variants, require_joint_forces, some_variants
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.motion.variants import PrescribedVariants, follows_alike
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, PinarmError, UnitError
from pinarm.input.units import DIMENSIONLESS, Unit, read_quantity
from pinarm.input.yaml.document import varied
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace
from pinarm.use.cases.case import (
    ARGUMENT,
    COLUMNS,
    QUADRATURE,
    WORTH,
    Case,
    Row,
    Taken,
    Task,
    Value,
    is_column,
    solve_case,
    solved_case,
)
from pinarm.use.result.curve import Spots
from pinarm.use.result.failures import failures_in_words
from pinarm.use.result.measures import COSTS
from pinarm.use.result.numbers import SectionNumber
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.workers.runners import Runners
from pinarm.use.workers.worker import LostJob

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result

NUMBERS = 800_000
"""Most numbers of one array over the cases of a stack: larger ones leave the caches of processors."""

JUDGED = 4
"""Rows of each case at which it is looked which components of reactions rigid bodies determine: that belongs to the
structure. The base is looked at as any other case."""

AGREED = 1e-10
"""Least difference of a case solved with others from the same alone, relative to the largest of its numbers, that makes
all of them be solved alone."""

KINDS = 8
"""Kinds of cases whose stacks are kept."""


class StatesMissing(Exception):
    """States of a case that have not been solved: ``places`` are intervals, and values of the parameter as bytes."""

    def __init__(self, places: Sequence[tuple[int, bytes]]) -> None:
        self.places = places


class CaseQuantities(Quantities, kw_only=True):
    """The quantities of one of several cases: ``shared`` are those of all, ``case`` is its place among them."""

    shared: Quantities
    case: int

    def __getitem__(self, name: str) -> Series:
        series = self.shared[name]
        values, terms = series.values, np.broadcast_to(series.terms, series.values.shape)
        case = min(self.case, values.shape[1] - 1)
        return replace(series, values=values[:, case], terms=terms[:, case])


class CaseLookup(Lookup, frozen=True):
    """A run of one of several cases: ``solved`` are the quantities by interval and values of the parameter."""

    solved: dict[tuple[int, bytes], Quantities] = {}

    def quantities_at(self, interval: int, t: Array) -> Quantities:
        self.announce([(interval, t)])
        return self.solved[interval, t.tobytes()]

    def heights(self, height: Callable[[Quantities], Array], spots: Spots) -> list[Array]:
        self.announce(spots)
        return [height(self.solved[interval, t.tobytes()]) for interval, t in spots]

    def announce(self, places: Spots) -> None:
        """Ask for states at places."""
        asked = [(interval, t.tobytes()) for interval, t in places]
        if missing := [place for place in asked if place not in self.solved]:
            raise StatesMissing(missing)


class Place(NamedTuple):
    """Instants in an interval of the grid of a case, as bytes, whose states are asked for."""

    case: int
    interval: int
    t: bytes

    @property
    def instants(self) -> Array:
        return np.frombuffer(self.t)


@dataclass(frozen=True, eq=False)
class VariantNumbers:
    """Cases that have been solved together, of which numbers are wanted.

    Attributes:
        variants: Their motions.
        run: The rows.
        quantities: Their quantities.
        block: Number of rows -> the number of cases whose states are solved at once.
    """

    variants: PrescribedVariants
    run: Trajectory
    quantities: Quantities
    block: Callable[[int], int]

    def told(self, wanted: Sequence[Taken], sound: Flags) -> tuple[list[Array], Array, Flags]:
        """Return numbers of the cases that are sound so far.

        Returns:
            The numbers that are wanted, in order [SI], each of shape (k,); the largest error of a quadrature relative
            to its number, NaN where there is none, shape (k,); and which cases have them, shape (k,).
        """
        numbers, quadrature, sound = list[Array](), np.full(len(sound), np.nan), sound.copy()
        of_curves = self._of_curves(wanted, sound)
        for place, entry in enumerate(wanted):
            if place not in of_curves:
                numbers += entry.of_rows(self.quantities)
                continue
            value, error = of_curves[place].T
            numbers.append(value)
            both = (value != 0.0) & (error != 0.0)
            quadrature = np.fmax(quadrature, np.where(both, error / np.abs(value), np.nan))
        return numbers, quadrature, sound

    def _of_curves(self, wanted: Sequence[Taken], sound: Flags) -> dict[int, Array]:
        """Return numbers of a run with the errors of their quadratures, by their places, each of shape (k, 2).

        Cases that have no such number are not sound.
        """
        numbers = [(place, entry.number) for place, entry in enumerate(wanted)]
        asked = {place: number for place, number in numbers if number and not isinstance(number, SectionNumber)}
        known = {place: np.full((len(sound), 2), np.nan) for place in asked}
        left = [(place, case) for place in asked for case in np.flatnonzero(sound).tolist()]
        while left:
            lacking, missing = list[tuple[int, int]](), dict[Place, None]()
            for place, case in left:
                try:
                    known[place][case] = asked[place].told(self._lookups[case])
                except StatesMissing as states:
                    lacking.append((place, case))
                    missing |= dict.fromkeys(Place(case, *spot) for spot in states.places)
                except InputError:  # the case alone says why
                    sound[case] = False
            self._solve([*missing], sound)
            left = [(place, case) for place, case in lacking if sound[case]]
        return known

    @cached_property
    def _lookups(self) -> list[CaseLookup]:
        rows = (replace(self.run, grid=grid) for grid in self.variants.grids)
        each = (CaseQuantities(run, shared=self.quantities, case=case) for case, run in enumerate(rows))
        return [CaseLookup(quantities, self.variants.motion) for quantities in each]

    def _solve(self, places: Sequence[Place], sound: Flags) -> None:
        """Solve states of cases: as many at once, with one number of instants, as suits processors."""
        alike = defaultdict[int, list[Place]](list)
        for place in places:
            alike[len(place.instants)].append(place)
        for count, some in alike.items():
            size = self.block(count)
            for start in range(0, len(some), size):
                self._solve_alike(some[start : start + size], sound)

    def _solve_alike(self, places: Sequence[Place], sound: Flags) -> None:
        """Solve states at as many instants of each case.

        One place is solved beside itself: NumPy adds up the numbers of a single state in another order, and they would
        have other last digits alone than beside others.
        """
        places = places if len(places) > 1 else [*places, *places]
        cases, grids = np.array([place.case for place in places]), [self.variants.grids[place.case] for place in places]
        parts = [
            Grid(place.instants, grid.cuts[place.interval : place.interval + 2], (0, len(place.instants)))
            for place, grid in zip(places, grids, strict=True)
        ]
        near = np.stack([self._near(*some) for some in zip(places, grids, strict=True)], axis=1)
        run, good = self.variants.some(some_variants(self.variants.mechanism, cases), cases, parts).at(near)
        quantities = self.quantities.of(run)
        sound[cases[~good]] = False
        for k, place in enumerate(places):
            solved = CaseQuantities(self.variants.run, shared=quantities, case=k)
            self._lookups[place.case].solved[place.interval, place.t] = solved

    def _near(self, place: Place, grid: Grid) -> Array:
        """Return configurations near those at a place, shape (n, nq): of the nearest rows, moved on by their rates."""
        first, end = grid.rows[place.interval : place.interval + 2]
        first, end = (first, end) if first < end else (0, len(grid.t))
        row = first + np.abs(grid.t[first:end] - place.instants[:, None]).argmin(axis=1)
        q, v, a = (x[row, min(place.case, x.shape[1] - 1)] for x in (self.run.q, self.run.v, self.run.a))
        h = (place.instants - grid.t[row])[:, None]
        return np.asarray(q if self.run.separate else q + h * (v + 0.5 * h * a))


@dataclass(frozen=True, eq=False)
class Stack:
    """The base of cases that are solved together: its result, solved alone, and its motion.

    Attributes:
        task: What is the same in all cases.
        files: The files that cases refer to.
    """

    task: Task
    base: Result
    motion: PrescribedMotion
    files: tuple[str, ...]

    @classmethod
    def begin(cls, task: Task, kind: Case) -> Stack | None:
        """Return the stack beside the task's anchor with values of a kind; ``None`` where none can be solved so."""
        columns = {path: task.anchor[path] for path in kind if path in task.anchor and is_column(path)}
        row, result = solved_case(task, {path: x for path, x in kind.items() if not is_column(path)} | columns)
        if row.error or result is None or any(entry.alone for entry in task.wanted):
            return None
        content, motion = result.content, result.outcome.motion
        asks = content.find or content.accuracy.target is not None or result.trajectory.columns
        if asks or result.outcome.figures or not isinstance(motion, PrescribedMotion):
            return None
        prescription = motion.prescription
        whole = prescription.mechanism is result.scenario.mechanism
        determined = isinstance(prescription.motion, DeterminedMotion)
        return cls(task, result, motion, row.files) if whole and determined else None

    def rows(self, cases: Sequence[Case]) -> list[Row | None]:
        """Return the rows of cases, ``None`` of those that are to be solved alone.

        What one of them raises costs the others time only, and is told when it is solved alone.
        """
        try:
            with failures_in_words():
                return self._solved(cases)
        except Exception:
            half = len(cases) // 2
            return [*self.rows(cases[:half]), *self.rows(cases[half:])] if half else [None]

    def agrees(self, case: Case, alone: Row) -> bool | None:
        """Tell whether a case has the same numbers here as alone; ``None`` where it has none here."""
        try:
            with failures_in_words():
                (row,) = self._solved([case])
        except VariantsDiffer:
            return False
        except PinarmError:
            return None
        except Exception:  # a fault of the program too costs time only
            return False
        if row is None or alone.error:
            return None if row is None else False
        here, there = np.array(row.numbers), np.array(alone.numbers)
        size, apart = (np.nanmax(np.abs(x), initial=0.0) for x in (there, here - there))
        return bool((np.isnan(here) == np.isnan(there)).all() and apart <= AGREED * size)

    def _solved(self, cases: Sequence[Case]) -> list[Row | None]:
        """Return the rows of cases, whose model is expanded at once."""
        mechanism, possible = self._mechanism(cases)
        require_joint_forces(self.motion.prescription.dynamics.forces)
        size, rows = self._block(len(self.base.trajectory)), dict[int, Row]()
        for start in range(1, 1 + len(cases), size):
            tables = self._followed(cases, range(start, min(start + size, 1 + len(cases))))
            chosen = np.array([*tables])  # the base is the variant 0, with which the others are compared
            numbers, finite = self._numbers(some_variants(mechanism, chosen), [*tables.values()])
            for k in np.flatnonzero(possible[chosen] & finite).tolist():
                rows[int(chosen[k])] = Row(tuple((numbers[k] + 0.0).tolist()), "", self.files)  # -0 becomes 0
        return [rows.get(variant) for variant in range(1, 1 + len(cases))]

    def _block(self, rows: int) -> int:
        """Return the number of cases with so many rows whose arrays are of a size that suits processors."""
        return max(1, NUMBERS // (rows * int(self.base.trajectory.mechanism.model.njoints) * 6))

    def _mechanism(self, cases: Sequence[Case]) -> tuple[Mechanism, Flags]:
        """Return the mechanism in the base and in cases, and which of them can be followed so."""
        mechanism, arguments = self.base.scenario.mechanism, self.base.content.arguments
        numbers = dict[str, list[float]]()
        for path in cases[0]:
            if path.startswith(ARGUMENT):
                name = path.removeprefix(ARGUMENT)
                written = arguments[name].unit if name in arguments else None
                unit = mechanism.argument_units.get(name, written)
                numbers[name] = [float(mechanism.arguments[name]), *(_number(case[path], unit) for case in cases)]
        if not numbers:
            return alike_variants(mechanism, 1 + len(cases)), np.ones(1 + len(cases), dtype=bool)
        known = {
            name: argument.given if argument.word is not None else mechanism.arguments[name]
            for name, argument in arguments.items()
        }
        return mechanism_variants(mechanism, known, numbers)

    def _followed(self, cases: Sequence[Case], variants: range) -> dict[int, PrescribedTable]:
        """Return the laws and rows of the base and of some cases, by their place among the variants.

        Those that fail, or have other rows, are left out: what is wrong with them is told where they are solved alone.
        """
        scenario, tables = self.base.scenario, {0: self._table}
        moving = [path for path in cases[0] if path.startswith(COLUMNS[1:])]
        if not moving:
            return tables | dict.fromkeys(variants, self._table)
        for variant in variants:
            with suppress(PinarmError):
                document = varied(scenario.document, {path: cases[variant - 1][path] for path in moving})
                table = scenario.with_document(document).prescribed_table()
                if table is not None and follows_alike(table, self._table):
                    tables[variant] = table
        return tables

    @cached_property
    def _table(self) -> PrescribedTable:
        return PrescribedTable(self.motion.prescription, self.base.trajectory.grid, self.motion.start)

    def _numbers(self, mechanism: Mechanism, tables: Sequence[PrescribedTable]) -> tuple[Array, Flags]:
        """Return results and measures of accuracy, shape (k, columns), and which cases are finite."""
        scenario, count = self.base.scenario, len(tables)
        variants = PrescribedVariants(self.motion, self.base.trajectory, mechanism, tables)
        run, sound = variants.rows()
        judged = Quantities(run.some(sampled(len(run), JUDGED)), scenario.symbols, scenario.content.undetermined)
        quantities, finite = judged.of(run), sound.copy()
        numbers, quadrature, sound = VariantNumbers(variants, run, quantities, self._block).told(
            self.task.wanted, finite
        )
        for values in (*(quantities[name].values for name in scenario.content.outputs), *numbers):
            finite &= np.isfinite(values).all(axis=0) if values.ndim > 1 else np.isfinite(values)
        figures = self._figures(run, quantities, finite) if self.task.measured else {}
        figures[QUADRATURE] = quadrature
        columns = [*numbers, *(figures.get(name, np.nan) for name in WORTH)]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=1), finite & sound

    def _figures(self, run: Trajectory, quantities: Quantities, finite: Flags) -> dict[str, Array]:
        """Return the measures of accuracy of variants, each of shape (k,) or (1,), and note which are finite."""
        figures = {**power_balance(run), **residual_figures(run), **quantities.figures()}
        for figure in figures.values():
            finite &= np.isfinite(figure)
        measured = {name for name, figure in figures.items() if not np.isnan(figure.flat[0])}
        if measured != self.base.figures.keys() - COSTS:
            raise VariantsDiffer("which figures can be measured")
        return figures


def _number(value: Value, unit: Unit | None) -> float:
    """Return the number of an argument [SI]."""
    try:
        number, measured = read_quantity(str(value))
    except UnitError:
        raise VariantsDiffer("words") from None
    if unit is not None and (measured or DIMENSIONLESS).dimension != unit.dimension:
        raise VariantsDiffer("numbers with other units")
    return number


Kind = tuple[tuple[str, Value], ...] | None
"""Values common to cases that may be solved together; ``None`` for a case that varies no ``column``."""


def kind_of(values: Case) -> Kind:
    """Return the kind of a case: its values but for those of columns."""
    kept = tuple([(path, "" if is_column(path) else value) for path, value in values.items()])
    return kept if any(map(is_column, values)) else None


@dataclass(eq=False)
class _Known:
    """A kind of cases: its stack, if there is one, and whether a case was the same solved by it and alone."""

    stack: Stack | None
    agreed: bool = False


@dataclass(frozen=True)
class CaseSolver:
    """Solves the cases of a task, in this process or in a worker."""

    task: Task

    def __call__(self, case: Case) -> Row:
        return solve_case(self.task, case)

    def together(self, cases: Sequence[Case]) -> Iterator[tuple[list[int], list[Row]]]:
        """Yield places of cases and their rows: of those that are solved at once, or of one."""
        groups = dict[Kind, dict[int, Case]]()
        for place, case in enumerate(cases):
            groups.setdefault(kind_of(case), {})[place] = case
        for kind, some in groups.items():
            stack = None if kind is None else self._stack(kind, [*some.values()])
            rows = dict(zip(some, stack.rows([*some.values()]), strict=True)) if stack else {}
            solved = {place: row for place, row in rows.items() if row is not None}
            if solved:
                yield [*solved], [*solved.values()]
            yield from (([place], [self(case)]) for place, case in some.items() if place not in solved)

    def _stack(self, kind: Kind, cases: Sequence[Case]) -> Stack | None:
        """Return the stack of a kind, compared with one of its cases alone; ``None`` where there is none.

        Where both ways differ, all cases of the kind are solved one by one. A case that fails decides nothing.
        """
        known = self._begun(kind)
        for place in dict.fromkeys((len(cases) - 1, 0, len(cases) // 2)):
            if known.agreed or not known.stack:
                break
            agreed = known.stack.agrees(cases[place], self(cases[place]))
            known.agreed, known.stack = bool(agreed), None if agreed is False else known.stack
        return known.stack if known.agreed else None

    @cached_property
    def _begun(self) -> Callable[[Kind], _Known]:
        """Return the function that begins the stack of a kind, its base first; a few kinds are kept."""
        return lru_cache(KINDS)(lambda kind: _Known(Stack.begin(self.task, dict(kind or ()))))


SolveCases = Callable[[Iterable[Case]], Iterator[Row]]
"""Cases -> their rows, in their order, each solved when it is asked for or before."""


@contextmanager
def solving(task: Task, runners: Runners) -> Iterator[SolveCases]:
    """Yield a function that solves cases, as often as it is called; workers end with the block."""
    with runners.applying(CaseSolver(task)) as apply:
        yield lambda cases: map(row_of, apply(cases))


def row_of(answer: Row | LostJob) -> Row:
    """Return the row of a case, also of one that has no answer."""
    return Row((), answer.reason, final=False) if isinstance(answer, LostJob) else answer
