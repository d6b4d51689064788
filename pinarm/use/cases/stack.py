"""Cases that differ by numbers of the model or of laws, solved together as one array.

The first case is solved as any other: its checks of names and units hold for all. Masses, inertias and placements of
the others are arrays over the cases, and so are positions, efforts, quantities and measured figures, by the same
functions; laws are read case by case. The last case of the first stack is solved alone too, and compared.

A number of a run, such as a maximum between rows or a mean, is found by functions that ask for states at instants which
follow from the states before. They are called for every case; one that lacks states is interrupted and says which, the
states that any case lacks are solved as one array, and the interrupted ones begin anew with these. So the numbers are
found by the same steps as those of a case alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.checks.balance import power_balance
from pinarm.engine.checks.figures import sampled
from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.mechanism import alike_variants, mechanism_variants, require_joint_forces, some_variants
from pinarm.engine.motion.prescribed_motion import PrescribedMotion, PrescribedTable
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.motion.variants import PrescribedVariants, follows_alike
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, PinarmError
from pinarm.input.yaml.document import varied
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace
from pinarm.use.cases.case import QUADRATURE, WORTH, Case, Row, Taken, Task, solved_case
from pinarm.use.cases.case_table import ARGUMENT, CaseTable, RowTable, moving, number_of, numbers_of
from pinarm.use.result.curve import Spots
from pinarm.use.result.failures import failures_in_words
from pinarm.use.result.measures import COSTS
from pinarm.use.result.numbers import SectionNumber
from pinarm.use.result.row_lookup import Lookup

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result


class Place(NamedTuple):
    """States of a case that are asked for.

    Attributes:
        case: The case.
        interval: An interval of its grid.
        t: Values of the parameter there, as bytes.
    """

    case: int
    interval: int
    t: bytes

    @property
    def instants(self) -> Array:
        """The values, shape (n,)."""
        return np.frombuffer(self.t)


class StatesMissing(Exception):
    """States of a case that have not been solved: ``places`` are intervals, and values of the parameter as bytes."""

    def __init__(self, places: Sequence[tuple[int, bytes]]) -> None:
        self.places = places


class CaseQuantities(Quantities, kw_only=True):
    """The quantities of one of several cases: ``shared`` are those of all, ``case`` is its place among them."""

    shared: Quantities
    case: int

    def __getitem__(self, name: str) -> Series:
        """Return a quantity of the case; see ``Quantities``."""
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
        """Ask for states at places.

        Raises:
            StatesMissing: Some have not been solved.
        """
        asked = [(interval, t.tobytes()) for interval, t in places]
        if missing := [place for place in asked if place not in self.solved]:
            raise StatesMissing(missing)


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
        """The runs of all cases."""
        rows = (replace(self.run, grid=grid) for grid in self.variants.grids)
        each = (CaseQuantities(run, shared=self.quantities, case=case) for case, run in enumerate(rows))
        return [CaseLookup(quantities, self.variants.motion) for quantities in each]

    def _solve(self, places: Sequence[Place], sound: Flags) -> None:
        """Solve states of cases, as many of one number of rows at once as suits processors."""
        alike = dict[int, list[Place]]()
        for place in places:
            alike.setdefault(len(place.t), []).append(place)
        for some in alike.values():
            size = self.block(len(some[0].instants))
            for start in range(0, len(some), size):
                self._solve_alike(some[start : start + size], sound)

    def _solve_alike(self, places: Sequence[Place], sound: Flags) -> None:
        """Solve states at as many instants of each case.

        One place is solved beside itself: NumPy adds up the numbers of a single state in another order, and they would
        have other last digits alone than beside others.
        """
        places = places if len(places) > 1 else [*places, *places]
        cases = np.array([place.case for place in places])
        grids = [_at(self.variants.grids[place.case], place) for place in places]
        mechanism = some_variants(self.variants.mechanism, cases)
        run, good = self.variants.some(mechanism, cases, grids).at(self._near(places, cases))
        quantities = self.quantities.of(run)
        sound[cases[~good]] = False
        for k, place in enumerate(places):
            solved = CaseQuantities(self.variants.run, shared=quantities, case=k)
            self._lookups[place.case].solved[place.interval, place.t] = solved

    def _near(self, places: Sequence[Place], cases: Indices) -> Array:
        """Return configurations near those at places, shape (n, places, nq): those of rows, moved on to the places."""
        q, v, a = (x[:, np.minimum(cases, x.shape[1] - 1)] for x in (self.run.q, self.run.v, self.run.a))
        rows, steps = zip(*(_nearest(self.variants.grids[place.case], place) for place in places), strict=True)
        row, h = np.stack(rows, axis=1), np.stack(steps, axis=1)[..., None]
        every = np.arange(len(places))
        if self.run.separate:
            return np.asarray(q[row, every])
        return np.asarray(q[row, every] + h * (v[row, every] + 0.5 * h * a[row, every]))


def _at(grid: Grid, place: Place) -> Grid:
    """Return the grid of instants of one interval."""
    t = place.instants
    return Grid(t, (grid.cuts[place.interval], grid.cuts[place.interval + 1]), (0, len(t)))


def _nearest(grid: Grid, place: Place) -> tuple[Indices, Array]:
    """Return the rows of a grid that are nearest to instants of an interval, and how far from these [s], shape (n,)."""
    first, end = grid.rows[place.interval], grid.rows[place.interval + 1]
    first, end = (first, end) if first < end else (0, len(grid.t))
    known, t = grid.t[first:end], place.instants
    rows = np.abs(known - t[:, None]).argmin(axis=1)
    return first + rows, t - known[rows]


NUMBERS = 800_000
"""Most numbers of one array over the cases of a stack: larger ones leave the caches of processors."""

EXPANDED = 10_000
"""Cases whose model is expanded at once: to read it for one takes as long as for many."""

JUDGED = 4
"""Rows of each case at which it is looked which components of reactions rigid bodies determine: that belongs to the
structure. The first case is looked at as any other."""

AGREED = 1e-10
"""Least difference of a case solved with others from the same alone, relative to the largest of its numbers, that makes
all of them be solved alone."""

Numbers = list[tuple[Indices, Array]]
"""Places of cases that can be solved, and their rows of numbers, block by block."""


@dataclass(frozen=True, eq=False)
class Stack:
    """The first of the cases that are solved together.

    Attributes:
        task: What is the same in all cases.
        values: The values of the first case.
        first: Its result, solved alone.
        motion: Its motion.
        files: The files that cases refer to.
    """

    task: Task
    values: Case
    first: Result
    motion: PrescribedMotion
    files: tuple[str, ...]

    @classmethod
    def begin(cls, task: Task, values: Case) -> tuple[Stack | None, Row]:
        """Solve a first case alone; return its stack, ``None`` where others cannot be solved with it, and its row."""
        row, result = solved_case(task, values)
        if row.error or result is None or any(entry.alone for entry in task.wanted):
            return None, row
        content, outcome = result.content, result.outcome
        asks = content.find or content.accuracy.target is not None or result.trajectory.columns or outcome.figures
        if asks or not isinstance(outcome.motion, PrescribedMotion):
            return None, row
        prescription = outcome.motion.prescription
        whole = prescription.mechanism is result.scenario.mechanism
        if not whole or not isinstance(prescription.motion, DeterminedMotion):
            return None, row
        return cls(task, values, result, outcome.motion, row.files), row

    @property
    def follows(self) -> bool:
        """Whether loops of the others are closed from the first case."""
        return bool(self.first.trajectory.mechanism.closure.size)

    @cached_property
    def _table(self) -> PrescribedTable:
        """The laws and rows of the first case."""
        return PrescribedTable(self.motion.prescription, self.first.trajectory.grid, self.motion.start)

    def block_of(self, rows: int) -> int:
        """Return the number of cases with so many rows whose arrays are of a size that suits processors."""
        return max(1, NUMBERS // (rows * int(self.first.trajectory.mechanism.model.njoints) * 6))

    def rows(self, cases: CaseTable) -> tuple[Indices, RowTable]:
        """Return the places of the cases that can be solved so, and their rows; the others are to be solved alone.

        What one of them raises costs the others time only, and is told when it is solved alone.
        """
        parts = _tried(partial(self._solved, cases), np.arange(len(cases)))
        if not parts:
            return np.zeros(0, np.intp), RowTable(np.zeros((0, 0)), self.files)
        places, numbers = zip(*parts, strict=True)
        return np.concatenate(places), RowTable(np.concatenate(numbers), self.files)

    def _solved(self, cases: CaseTable, places: Indices) -> Numbers:
        """Return the numbers of some of the cases, whose model is expanded at once.

        Raises:
            VariantsDiffer: The cases differ in more than numbers of the model.
            PinarmError: A file may not be read any more, or something cannot be computed in one of them.
        """
        some = cases.some(places)
        mechanism, possible = self._mechanism(some)
        require_joint_forces(self.motion.prescription.dynamics.forces)
        size, parts = self.block_of(len(self.first.trajectory)), []
        for start in range(0, len(some), size):
            tables = self._followed(some, range(1 + start, 1 + min(start + size, len(some))))
            chosen = np.array([*tables])  # the first case is the one that the others are compared with
            numbers, finite = self._numbers(some_variants(mechanism, chosen), [*tables.values()])
            sound = possible[chosen] & finite & (chosen > 0)
            parts.append((places[chosen[sound] - 1], numbers[sound] + 0.0))  # -0 becomes 0
        return parts

    def _mechanism(self, cases: CaseTable) -> tuple[Mechanism, Flags]:
        """Return the mechanism in the first case and in others, and which of them can be followed so."""
        scenario = self.first.scenario
        known = {
            name: argument.given if argument.word is not None else scenario.mechanism.arguments[name]
            for name, argument in scenario.content.arguments.items()
        }
        numbers = dict[str, Array]()
        for column in cases.columns:
            if column.path.startswith(ARGUMENT):
                first = self.values[column.path]
                both = np.append(number_of(first, first), numbers_of(column, first))
                numbers[column.path.removeprefix(ARGUMENT)] = both
        if numbers:
            return mechanism_variants(scenario.mechanism, known, numbers)
        return alike_variants(scenario.mechanism, 1 + len(cases)), np.ones(1 + len(cases), dtype=bool)

    def _followed(self, cases: CaseTable, variants: range) -> dict[int, PrescribedTable]:
        """Return the laws and rows of the first case and of some others, by their place among the variants.

        Those that fail, or have other rows, are left out: what is wrong with them is told where they are solved alone.
        """
        columns, tables = moving(cases), {0: self._table}
        if not columns:
            return tables | dict.fromkeys(variants, self._table)
        scenario = self.first.scenario
        for variant in variants:
            with suppress(PinarmError):
                document = varied(scenario.document, {column.path: column.at(variant - 1) for column in columns})
                table = scenario.with_document(document).prescribed_table(scenario)
                if table is not None and follows_alike(table, self._table):
                    tables[variant] = table
        return tables

    def _numbers(self, mechanism: Mechanism, tables: Sequence[PrescribedTable]) -> tuple[Array, Flags]:
        """Return results and measures of accuracy, shape (k, columns), and which cases are finite."""
        scenario, count = self.first.scenario, len(tables)
        variants = PrescribedVariants(self.motion, self.first.trajectory, mechanism, tables)
        run, sound = variants.rows()
        judged = Quantities(run.some(sampled(len(run), JUDGED)), scenario.symbols, scenario.content.undetermined)
        quantities, finite = judged.of(run), sound.copy()
        numbers, quadrature, sound = VariantNumbers(variants, run, quantities, self.block_of).told(
            self.task.wanted, finite
        )
        for values in (*(quantities[name].values for name in scenario.content.outputs), *numbers):
            finite &= np.isfinite(values).all(axis=0) if values.ndim > 1 else np.isfinite(values)
        figures = self._figures(run, quantities, finite) if self.task.measured else {}
        figures[QUADRATURE] = quadrature
        columns = [*numbers, *(figures.get(name, np.nan) for name in WORTH)]
        return np.stack([np.broadcast_to(column, count) for column in columns], axis=1), finite & sound

    def _figures(self, run: Trajectory, quantities: Quantities, finite: Flags) -> dict[str, Array]:
        """Return the measures of accuracy of variants, each of shape (k,) or (1,), and note which are finite.

        Raises:
            VariantsDiffer: They are not those of the first case.
        """
        figures = {**power_balance(run), **residual_figures(run), **quantities.figures()}
        for figure in figures.values():
            finite &= np.isfinite(figure)
        if {name for name, figure in figures.items() if not np.isnan(figure.flat[0])} != (
            self.first.figures.keys() - COSTS
        ):
            raise VariantsDiffer("which figures can be measured")
        return figures

    def agrees(self, values: Case, alone: Row) -> bool | None:
        """Tell whether a case has the same numbers here as alone; ``None`` where it has none here.

        Raises:
            VariantsDiffer: No cases of its kind have.
        """
        try:
            with failures_in_words():
                ((places, numbers),) = self._solved(CaseTable.of([values]), np.arange(1))
        except PinarmError:
            return None
        if not len(places) or alone.error:
            return False if len(places) else None
        here, there = numbers[0], np.array(alone.numbers)
        size, apart = (np.nanmax(np.abs(x), initial=0.0) for x in (there, here - there))
        return bool((np.isnan(here) == np.isnan(there)).all() and apart <= AGREED * size)


def _tried(solve: Callable[[Indices], Numbers], cases: Indices) -> Numbers:
    """Return the numbers of cases, without those for which something is raised."""
    try:
        with failures_in_words():
            return solve(cases)
    except Exception:
        half = len(cases) // 2
        return [*_tried(solve, cases[:half]), *_tried(solve, cases[half:])] if half else []
