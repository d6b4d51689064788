"""Batch: free motions of one scenario from many initial states, a sweep over ``problem.initial``."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array, Indices
from pinarm.engine.motion.free_motions import follow, free_interval
from pinarm.engine.motion.integrated_motion import IntegratedMotion
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
from pinarm.engine.quantities.state_arrays import columns_of
from pinarm.engine.series import Series
from pinarm.errors import InputError, PinarmError, choices, require_map, require_name
from pinarm.input.units import DIMENSIONLESS, unit
from pinarm.input.yaml.document import Values, joined
from pinarm.mechanics.laws.motion_law import ROUNDING, Grid
from pinarm.problems.forward import Forward
from pinarm.records import replace
from pinarm.use.cases.case import UNMEASURED, Case, Row, Taken, Task, Wanted, solved_case
from pinarm.use.cases.solving import row_of
from pinarm.use.facade import Given, Result, Scenario, load
from pinarm.use.output import whole_folder
from pinarm.use.result.result import Result as ResultRecord
from pinarm.use.scenario.scenario import Scenario as ScenarioRecord
from pinarm.use.store.files import write, write_arrays
from pinarm.use.store.save import arrays, csv
from pinarm.use.study.sweep.axes import Axis, Cases, Column
from pinarm.use.study.sweep.solving import Solving
from pinarm.use.study.sweep.sweep import first_case, measured_results, swept_of
from pinarm.use.study.sweep.table import Sweep
from pinarm.use.workers.runners import HERE, Runners
from pinarm.use.workers.worker import LostJob

Measure = str | float
"""A name of ``REDUCTIONS``, or a percentage: the value below which so many of the instants are."""


def _mean(t: Array, x: Array) -> float:
    return float(np.trapezoid(x, t) / (t[-1] - t[0])) if len(t) > 1 else float(x[0])


REDUCTIONS: Mapping[str, Callable[[Array, Array], float]] = {
    "min": lambda t, x: x.min(),
    "max": lambda t, x: x.max(),
    "largest": lambda t, x: np.abs(x).max(),
    "mean": _mean,
    "rms": lambda t, x: _mean(t, x * x) ** 0.5,
    "median": lambda t, x: np.percentile(x, 50.0),
    "start": lambda t, x: x[0],
    "end": lambda t, x: x[-1],
}
"""Name -> a number of values x at instants t, both of shape (n,)."""


@dataclass(frozen=True)
class InstantValues(Taken):
    """Values of a quantity at the instants of the table, NaN where a motion does not come to them.

    Without a quantity they are configurations and velocities, one after the other.
    """

    quantity: str = ""
    broken_off: ClassVar[bool] = True

    def numbers(self, result: ResultRecord) -> list[tuple[float, float]]:
        run = result.trajectory
        states = np.hstack([run.q, run.v]) if not self.quantity else result.quantities.determined(self.quantity).values
        return [(value, 0.0) for value in _at_instants(result, states).ravel().tolist()]


def _measures(asked: Mapping[str, Measure | Sequence[Measure]]) -> list[tuple[str, Measure]]:
    """Return the pairs of a quantity and a measure of a map."""
    require_map(asked, "quantities and measures", "{'A_y': ['max', 95]}")
    pairs = list[tuple[str, Measure]]()
    for name, measures in asked.items():
        pairs += [(name, measure) for measure in ([measures] if isinstance(measures, str | int | float) else measures)]
    for name, measure in pairs:
        if isinstance(measure, str) and measure not in REDUCTIONS:
            names, hint = choices(measure, REDUCTIONS)
            expected = f"{names}, or a percentage such as 95"
            raise InputError(f"there is no measure '{measure}' of {name}", hint=hint, expected=expected)
        if not isinstance(measure, str) and not 0.0 <= measure <= 100.0:
            raise InputError(f"{measure} is no percentage of {name}", expected="a number from 0 to 100")
    return pairs


def _reduced(measure: Measure, t: Array, x: Array) -> float:
    return float(REDUCTIONS[measure](t, x) if isinstance(measure, str) else np.percentile(x, measure))


def _instants(scenario: ScenarioRecord) -> Array:
    return cast("Forward", scenario.problem).time.instants()


def _at_instants(result: ResultRecord, values: Array) -> Array:
    """Return values of the rows of a motion, shape (rows, ..), at the instants, shape (n, ..)."""
    t = _instants(result.scenario)
    values_there = np.full((len(t), *values.shape[1:]), np.nan)
    rows, reached = _rows(result.trajectory.grid.t, t)
    values_there[reached] = values[rows]
    return values_there


def _rows(table: Array, t: Array) -> tuple[Indices, Indices]:
    """Return the rows at instants, the last one where there are two, and which instants these are.

    Args:
        table: Instants of a table, shape (n,); where a law jumps they may differ from those asked by rounding.
        t: Instants that are asked [s], shape (m,).
    """
    slack = 2.0 * ROUNDING * (t[-1] - t[0])
    rows = np.maximum(np.searchsorted(table, t + slack, side="right") - 1, 0)
    there = np.abs(table[rows] - t) <= slack
    return rows[there], np.flatnonzero(there)


@dataclass(frozen=True, eq=False, repr=False)
class Batch:
    """Motions of one scenario from b initial states, at its n instants.

    Every question solves them anew, together where ``docs/many_cases.md`` says so: several quantities are best asked at
    once, by ``values``.

    Attributes:
        scenario: What is the same in all of them.
        cases: The initial values that were given.
        runners: Who solves them.
    """

    scenario: Scenario
    cases: Cases
    runners: Runners = HERE
    _failures: list[dict[int, str]] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"<Batch of '{self.scenario.name}': {len(self)} motions, {len(self.t)} instants>"

    def __len__(self) -> int:
        return len(self.cases)

    @property
    def t(self) -> Array:
        """Return the instants [s], shape (n,)."""
        return _instants(self.scenario)

    def run(self, number: int) -> Result:
        """Return the result of one motion, as the scenario with its initial values has it.

        Raises:
            InputError: There is no motion of that number.
            NumericsError: It could not be followed to its end; ``partial`` holds it until then.
        """
        try:
            number = range(len(self))[number]
        except (IndexError, TypeError):
            raise InputError(f"there is no motion {number!r}", expected=f"a number from 0 to {len(self) - 1}") from None
        return self.scenario.varied(self.cases.values(number)).run()

    @property
    def failures(self) -> dict[int, str]:
        """Return why motions could not be followed to their end, by their number."""
        if not self._failures:
            self._solved([])
        return dict(self._failures[0])

    def __getitem__(self, name: str) -> Series:
        """Return a quantity of all motions with its unit, shape (b, n), not a number beyond the end of a motion.

        Args:
            name: A quantity, a symbol or a formula, as of a result.

        Raises:
            InputError: There is no quantity of that name.
        """
        require_name(name)
        known = self._known([name])[name]
        return replace(known, name=name, values=self.values(name)[0])

    def values(self, *names: str) -> Array:
        """Return several quantities of all motions in SI, shape (k, b, n), solved for at once; see ``batch[name]``.

        Raises:
            InputError: There is no quantity of a name.
        """
        self._known(names)
        width = len(names) * len(self.t)
        table = self._solved([InstantValues(name) for name in names], width).numbers
        return np.moveaxis(table[:, :width].reshape(len(self), len(names), -1), 1, 0)

    def states(self) -> tuple[Array, Array]:
        """Return q, shape (b, n, nq), and v, shape (b, n, nv), of the whole mechanism; not a number beyond an end."""
        model, n = self.scenario.mechanism.model, len(self.t)
        width = n * (model.nq + model.nv)
        states = self._solved([InstantValues()], width).numbers[:, :width].reshape(len(self), n, -1)
        return states[..., : model.nq], states[..., model.nq :]

    def reduced(self, asked: Mapping[str, str | float | Sequence[str | float]]) -> Sweep:
        """Return a few numbers of every motion: ``reduced({"A_y": ["max", 95], "joint.B.velocity": "rms"})``.

        They are taken over the instants of the table that a motion reached, means over time by the trapezoidal rule.
        Motions that could not be followed to their end have none.

        Args:
            asked: Quantity, symbol or formula -> ``min``, ``max``, ``largest`` (in size), ``mean``, ``rms``,
                ``median``, ``start``, ``end``, or a percentage of the instants; one, or several.

        Raises:
            InputError: There is no such quantity, or no such measure.
        """
        pairs = _measures(asked)
        known, columns = self._known([name for name, _ in pairs]), list[Series]()
        t, *tables = self.values("t", *known)
        values, whole = dict(zip(known, tables, strict=True)), set(range(len(self))) - self.failures.keys()
        for name, measure in pairs:
            label, numbers = measure if isinstance(measure, str) else f"{measure:g} %", np.full(len(self), np.nan)
            for k in whole:
                reached = np.isfinite(t[k])
                numbers[k] = _reduced(measure, self.t[reached], values[name][k, reached])
            columns.append(Series(f"{label} {name}", known[name].unit, numbers))
        solving = Solving(Task.of(self.scenario, ()), self.cases, columns, errors=self.failures)
        solving.numbers[:, : len(columns)] = np.transpose([series.values for series in columns])
        solving.solved[:] = True
        return self._table(solving)

    def numbers(self, *texts: str) -> Sweep:
        """Return numbers of every motion as its own run tells them: ``numbers("C_B @ rms", "limits.least_margin")``.

        Figures of a curve are integrated between the rows, and every section of the scenario has its numbers, which
        takes some ten times as long as ``reduced``. Motions that could not be followed to their end have none, nor have
        those that lack one of the numbers, as at a place that they do not come to.

        Args:
            texts: Numbers as in ``Result.number``.

        Raises:
            InputError: A number cannot be read, or no run has it.
        """
        for text in texts:
            require_name(text)
        return self._table(self._solving(*measured_results(self.scenario, self.cases, texts)))

    def save(self, folder: str | Path) -> Path:
        """Write every motion, and a table of all, as of a sweep.

        The folder gets ``cases.csv`` and ``cases.npz`` (a line per motion: its initial values, the least and greatest
        value of every output, its accuracy, and why it failed if it did), ``sweep.yaml``, ``summary.json``, and in
        ``motions`` the outputs of each as ``000042.csv`` and ``000042.npz``, as ``run`` writes them.

        Raises:
            InputError: The folder cannot be written, or holds something else.
        """
        outputs = list(dict.fromkeys(self.scenario.content.outputs))
        wanted, columns = measured_results(self.scenario, self.cases, outputs)
        solving = Solving(Task.of(self.scenario, wanted), self.cases, columns)
        with whole_folder(Path(folder), "batch") as draft, self.runners.applying(MotionFiles(solving.task)) as apply:
            (draft / "motions").mkdir()
            for number, motion in enumerate(apply(map(self.cases.values, range(len(self))))):
                row, *files = (row_of(motion),) if isinstance(motion, LostJob) else motion
                solving.take(number, row)
                for name, content in zip(("csv", "npz"), files, strict=False):
                    if content:
                        write(draft / "motions" / f"{number:06d}.{name}", [content])
            self._table(solving).write_tables(draft, Path(folder))
        return Path(folder)

    def _solved(self, wanted: Sequence[Taken], width: int = 0) -> Solving:
        return self._solving(wanted, [Series("", DIMENSIONLESS, np.zeros(0))] * width, measured=False)

    def _solving(self, wanted: Sequence[Taken], columns: Sequence[Series], *, measured: bool = True) -> Solving:
        task = Task.of(self.scenario, wanted, measured=measured)
        vars(task)["scenario"] = self.scenario  # whose mechanism is loaded
        solving = Solving(task, self.cases, columns)
        if not measured and len(self) > 1:
            self._take_together(solving, [entry for entry in wanted if isinstance(entry, InstantValues)])
        solving.run(self.runners)
        if not any(isinstance(entry, Wanted) for entry in wanted):  # which a motion may lack that is whole
            self._failures[:] = [solving.failures()]
        return solving

    def _take_together(self, solving: Solving, wanted: Sequence[InstantValues]) -> None:
        """Take the rows of motions that are followed together: free ones of a tree; see ``free_motions``.

        The first motion is solved alone, and has to be the same.
        """
        try:
            base = self.run(0)
        except PinarmError:  # which is told where it is solved among the others
            return
        motion, t = base.outcome.motion, self.t
        if not isinstance(motion, IntegratedMotion) or motion.mechanism is not self.scenario.mechanism:
            return
        if (interval := free_interval(motion)) is None:
            return
        q, v = self._starts(motion.hybrid)
        for begin in range(0, len(self), TOGETHER):
            cases = np.arange(begin, min(begin + TOGETHER, len(self)))
            states, good = follow(motion.hybrid, interval, q[cases], v[cases], t)
            if begin == 0 and not (good[0] and _close(states[0], np.hstack([base.trajectory.q, base.trajectory.v]))):
                return
            values = [_of_states(base, motion, t, states[good], entry.quantity) for entry in wanted]
            row = np.concatenate([np.zeros((len(values[0]), 0)), *(x.reshape(len(x), -1) for x in values)], axis=1)
            for case, numbers in zip(cases[good].tolist(), row, strict=True):
                if np.isfinite(numbers).all():
                    solving.take(case, Row((*numbers.tolist(), *UNMEASURED)))

    def _starts(self, hybrid: HybridSystem) -> tuple[Array, Array]:
        """Return the initial states of all motions, shape (b, nq) and (b, nv)."""
        joints, (q, v) = self.scenario.mechanism.joints, (np.tile(x, (len(self), 1)) for x in hybrid.start)
        columns = {column.path: column.as_array for column in self.cases.columns()}
        for name, joint in joints.items():
            for states, place, what in ((q, joint.q, "position"), (v, joint.v, "velocity")):
                if (column := columns.get(joined(["problem", "initial", what, name]))) is not None:
                    states[:, place] = column
        return q, v

    def _table(self, solving: Solving) -> Sweep:
        return swept_of(self.scenario, solving, {"over": {x.path: list(x.values) for x in self.cases.columns()}})

    def _known(self, names: Sequence[str]) -> dict[str, Series]:
        """Return quantities, of no motion yet, or raise where there is none of a name."""
        quantities = self.scenario.quantities()
        with np.errstate(all="ignore"):
            return {name: quantities[name] for name in names}


TOGETHER = 256
"""Motions that are followed together: all their steps are held at once."""

AGREED = 1e-12
"""Largest difference between a motion that is followed with others and the same one alone, over its size."""


def _close(states: Array, alone: Array) -> bool:
    return states.shape == alone.shape and bool(np.abs(states - alone).max() <= AGREED * np.abs(alone).max())


def _of_states(base: ResultRecord, motion: IntegratedMotion, t: Array, states: Array, quantity: str) -> Array:
    """Return a quantity of states, shape (b, n, nq + nv), at n instants; without a name these states."""
    count, nq = len(states), motion.mechanism.model.nq
    if not quantity or not count:
        return states
    rows, cuts = states.reshape(count * len(t), -1), base.trajectory.grid.cuts
    grid = Grid(np.tile(t, count), cuts, (0, len(rows)))
    complete = motion.hybrid.closed_system.complete(motion.motion.dynamics, grid, rows[:, :nq], rows[:, nq:])
    values = base.quantities.of(motion.table(grid, complete)).determined(quantity).values
    return np.asarray(values.reshape(count, len(t)))


@dataclass(frozen=True)
class MotionFiles:
    """Solves a motion; returns its row, and its table as CSV and npz, of one that failed until then."""

    task: Task

    def __call__(self, case: Case) -> tuple[Row, bytes, bytes]:
        row, result = solved_case(self.task, case)
        if result is None:
            return row, b"", b""
        table, packed = result.table_columns(), io.BytesIO()
        lines = csv([result.presentation.written(series) for series in table], result.presentation.csv)
        write_arrays(packed, arrays(result, table))
        return row, b"".join(lines), packed.getvalue()


def batch(
    scenario: Given,
    position: Mapping[str, ArrayLike] | None = None,
    velocity: Mapping[str, ArrayLike] | None = None,
    *,
    values: Values | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
) -> Batch:
    """Ask a scenario of kind ``forward`` from many initial states.

    Args:
        scenario: The scenario, or its file.
        position: Joint -> its initial coordinates [rad or m], shape (b,) or one for all; other joints begin as in the
            scenario.
        velocity: Joint -> its initial velocities [rad/s or m/s], likewise.
        values: Other values than those of the file, such as ``{"problem.time.end": "3 s"}``; see ``pinarm.load``.
        workers: Processes that solve the motions, as pays where loops are taken one by one; the numbers are the same.
            Of an executor, how many workers it has, where it cannot tell.
        executor: Who solves them in place of processes of this machine; see ``pinarm.sweep``.

    Raises:
        InputError: The scenario is of another kind or looks for something, a joint has not one coordinate or follows a
            law, or the numbers of values differ.
        PinarmError: What the first motion suffers from, where all suffer from something.
    """
    runners, scenario = Runners(None if workers == 1 else workers, executor), load(scenario, values)
    content, problem = scenario.content, scenario.problem
    if not isinstance(problem, Forward):
        raise InputError(f"the scenario '{scenario.name}' is of kind {problem.kind}", expected="kind: forward")
    if content.find or content.accuracy.target is not None:
        said = f"the scenario '{scenario.name}' looks for numbers, or for the setting that reaches an error"
        raise InputError(said, expected="neither find nor accuracy.target", hint="accuracy.tolerance")
    cases = Cases.of([Axis(tuple(_columns(scenario, problem, {"position": position, "velocity": velocity})))])
    first_case(scenario, cases)
    return Batch(scenario, cases, runners)


def _columns(scenario: Scenario, problem: Forward, given: Mapping[str, Mapping[str, ArrayLike] | None]) -> list[Column]:
    """Return the initial values by their paths, those of single numbers the same for all, or raise as in ``batch``."""
    joints, values, units = scenario.mechanism.joints, dict[str, ArrayLike](), {}
    free = [name for name in joints if name not in problem.motion]
    for what, per in (("position", ""), ("velocity", "/s")):
        starts = given[what] or {}
        require_map(starts, what, f"{what}={{'knee': [0.1, 0.2]}}")
        for name, x in starts.items():
            if name not in free:
                expected, hint = choices(name, free)
                said = f"no free joint '{name}' with one coordinate can begin elsewhere"
                raise InputError(said, expected=expected, hint=hint)
            values[f"{what} {name}"], units[f"{what} {name}"] = x, [unit(f"{joints[name].unit}{per}")]
    shape, columns = columns_of(values, units)
    if len(shape) > 1:
        raise InputError(f"the arrays have {len(shape)} axes", expected="one: a value for every motion")
    for name, column in columns.items():
        if not np.isfinite(column).all():
            raise InputError(f"{name} is not finite", expected="a finite number for every motion")
    if shape == (0,) or not columns:
        raise InputError("there are no initial values", expected="one motion or more")
    return [_column(name, np.array(x, ndmin=1), str(units[name][0])) for name, x in columns.items()]


def _column(name: str, values: Array, measured: str) -> Column:
    what, _, joint = name.partition(" ")
    return Column(joined(["problem", "initial", what, joint]), values.tolist(), measured)
