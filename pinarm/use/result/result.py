"""Result of a run: named arrays with units, a table, plots, and measures of accuracy."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from msgspec import field
from msgspec.structs import asdict

from pinarm.arrays import Array
from pinarm.engine.checks.residuals import Excess, beyond_points, excesses, highest_row
from pinarm.engine.motion.outcome import open_notes
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.engine.series import Series
from pinarm.errors import DynamicsError, InputError, PinarmError, choices
from pinarm.input.yaml.schema import plain, quantity
from pinarm.mechanics.forces.force_element import refusals
from pinarm.mechanics.joints import format_configuration
from pinarm.problems.simplification import Removal
from pinarm.use.result.measures import COSTS, MEASURES, NOT_ESTIMATED, unexplained_notes
from pinarm.use.result.presentation import FOR_PEOPLE
from pinarm.use.result.row_lookup import PLATEAU
from pinarm.use.result.run import Run

if TYPE_CHECKING:
    from pandas import DataFrame

    from pinarm.engine.linear.linear_states import Linearisation
    from pinarm.engine.quantities.names import Quantities
    from pinarm.use.result.presentation import Presentation
    from pinarm.use.result.section import Numbered, Section
    from pinarm.use.scenario.scenario import Scenario
    from pinarm.use.scenario.scenario_file import ScenarioFile


class Result(Run, frozen=True):
    """The answer to a scenario.

    Attributes:
        scenario: The question, as it was solved.
        figures: Measured accuracy and cost, by name; accuracy is measured when it is first looked at.
        errors: Bound of the global error of each output, relative to its scale (see ``output_scales``), that holds in
            99 of 100 cases; empty where none was asked for.
        number_errors: Bounds of the errors of its numbers [SI], those of sections among them, by name; likewise.
        setting: How the motion was integrated, and what the estimate rests on, in words.
        no_bound: Why errors have no bound, and are infinite; empty where all have one, or none was asked for.
        removals: Joints of the mechanism that were not solved for.
        known: Sections that are there already, by key: what the search for the values of the scenario tells, and what
            was read from a folder.
        source: The scenario file that it came of, where it was read from a folder.
    """

    scenario: Scenario
    figures: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    number_errors: Mapping[str, float] = field(default_factory=dict)
    setting: str = ""
    no_bound: str = ""
    removals: Sequence[Removal] = ()
    known: Mapping[str, Section] = field(default_factory=dict)
    source: Path | None = None

    def __repr__(self) -> str:
        outputs = ", ".join(self.content.outputs)
        return f"<Result of '{self.name}', {self.kind}: {len(self)} rows; {outputs}>"

    @property
    def kind(self) -> str:
        return self.scenario.problem.kind

    @property
    def content(self) -> ScenarioFile:
        return self.scenario.content

    @cached_property
    def presentation(self) -> Presentation:
        return self.content.presentation

    @property
    def data(self) -> Mapping[str, Any]:
        return self.scenario.document.data  # type: ignore[no-any-return]

    @property
    def folder(self) -> Path:
        return self.scenario.folder

    @property
    def error(self) -> float | None:
        """Largest of the bounds of errors; none where none was asked for."""
        return max(self.errors.values()) if self.errors else None

    @property
    def missed(self) -> bool:
        target = self.content.accuracy.target
        return target is not None and not (self.error is not None and self.error <= target)

    @property
    def shortfall(self) -> str:
        """Why the numbers are not as accurate as is wanted; empty where they are, or nothing is wanted."""
        if not self.missed:
            return ""
        if self.no_bound:
            return f"the global error has no bound: {self.no_bound}"
        return f"the global error is {self.error or np.nan:.1e}, not below its target {self.content.accuracy.target:g}"

    @property
    def events(self) -> Sequence[EventRecord]:
        return self.outcome.events

    @property
    def parameter(self) -> Series:
        return self.quantities.parameter

    def number(self, text: str) -> tuple[float, float]:
        """Return one number of the run [SI] and the error of its quadrature.

        Args:
            text: ``QUANTITY @ PLACE`` or ``QUANTITY @ FIGURE``, such as ``"C_B @ max"``, ``"t @ max(C_B)"``,
                ``"C_B @ t=1.5 s"``, ``"C_B @ rms"``, ``"C_B @ p95"``; see ``RunNumber.read``. Or a number of a section,
                such as ``"loads.B.life.time"``.

        Raises:
            InputError: It cannot be read, or the run has no such number.
        """
        from pinarm.use.result.numbers import read_number

        return read_number(text).value(self)

    def numbers(self) -> dict[str, tuple[Series, float]]:
        """Return the numbers that the scenario asks for under ``numbers``, each with the error of its quadrature."""
        return dict(self._numbers)

    @cached_property
    def _numbers(self) -> dict[str, tuple[Series, float]]:
        if not self.content.numbers:
            return {}
        from pinarm.use.result.numbers import measured, read_number

        numbers = {}
        for k, text in enumerate(self.content.numbers):
            with self.scenario.document.locating("numbers", k):
                numbers[text] = measured(read_number(text), self)
        return numbers

    @property
    def numbered(self) -> Mapping[str, Numbered]:
        return {**self._evaluated, **self.content.assessments}

    @property
    def sections(self) -> Mapping[str, Section]:
        """Sections of the search and the assessments of the scenario, by key, evaluated on first use."""
        return {key: self.section(key) for key in self.numbered}

    @property
    def shown_sections(self) -> Mapping[str, Section]:
        """The sections as people are shown them: in the units that the scenario asks for, and angles in degrees."""
        units = {**FOR_PEOPLE, **self.presentation.kinds}
        return {key: section.shown(units) for key, section in self.sections.items()}

    @property
    def written_sections(self) -> Mapping[str, Section]:
        return {key: section.shown(self.presentation.kinds) for key, section in self.sections.items()}

    def section(self, key: str) -> Section:
        """Return one section, evaluated when it is first asked for; others are left alone.

        Raises:
            InputError: There is none of that key, or the run does not have what it needs.
        """
        if key not in self.numbered:
            expected, hint = choices(str(key), self.numbered)
            raise InputError(f"there is no section '{key}'", expected=expected, hint=hint)
        if key not in self._evaluated:
            with self.scenario.document.locating(key):
                self._evaluated[key] = self.content.assessments[key].evaluate(self)
        return self._evaluated[key]

    @cached_property
    def _evaluated(self) -> dict[str, Section]:
        if not self.arrays:
            return dict(self.known)
        from pinarm.use.result.vibrations import linear_sections

        return {**linear_sections(self), **self.known}

    def columns(self) -> list[Series]:
        """Return the parameter and the outputs of the scenario."""
        outputs = dict.fromkeys(self.content.outputs)
        own = self.parameter
        return [own, *(series for series in map(self.quantities.__getitem__, outputs) if series.name != own.name)]

    def table_columns(self) -> list[Series]:
        """Return the columns of its tables: the parameter and the outputs.

        After an output that depends on how frictions at rest share a load stand its least and its greatest values.
        """
        table = dict[str, Series]()
        for series in self.columns():
            bounds = self.quantities.bounds(series.name) if self.quantities.open_rows(series.name).any() else ()
            table |= {column.name: column for column in (series, *bounds)}
        return list(table.values())

    def linearise(self, t: float | None = None, *, prescribed: Sequence[str] | None = None) -> Linearisation:
        """Return the motion linearised about the run at an instant: ``x' = A x + B u``; see ``Mechanism.linearise``.

        Drives keep the efforts that they have there, those of controllers too.

        Args:
            t: Value of the run's parameter, such as the instant [s]; the first row where it is left out.
            prescribed: Coordinates that move as they do in the run; in a forward run those that follow laws where it is
                left out, else none.

        Raises:
            InputError: The run does not come there, or has no efforts there.
            DynamicsError: The position is singular, or a joint begins to slip.
        """
        from pinarm.engine.linear.linear_states import linearised_row

        laws = (*getattr(self.scenario.problem, "motion", ()),) if self.kind == "forward" else ()
        return linearised_row(self.row_at(t).trajectory, laws if prescribed is None else prescribed)

    def row_at(self, t: float | str | None = None) -> Quantities:
        """Return the quantities at one instant, between the rows of the run too.

        Args:
            t: Value of the run's parameter, in SI or with its unit: ``1.5`` or ``1500 ms``; the first row where it is
                left out.

        Raises:
            InputError: The run does not come there, or the unit is another.
        """
        parameter, lookup = quantity(str(self.trajectory.unit)), self.lookup
        place = float(self.trajectory.grid.t[0] if t is None else parameter.read(t))
        within = [
            k for k, (start, end, _) in enumerate(lookup.intervals) if min(start, end) <= place <= max(start, end)
        ]
        if not within:
            raise InputError(f"{self.trajectory.parameter} = {place:g} is not reached in this run")
        return lookup.quantities_at(within[0], np.array([place]))

    def to_dataframe(self) -> DataFrame:
        """Return the outputs as a pandas table, one row per instant, units in the headings; see ``units:``.

        Its columns are those of ``table_columns``.
        """
        from pinarm.engine.labelled_array import dataframe

        return dataframe(
            {series.label: series.values for series in map(self.presentation.written, self.table_columns())}
        )

    def _modes_instead_of(self, name: str) -> str:
        """Return the modes of the state where a measure of a missing mode is asked for; empty otherwise."""
        if self.kind != "linear" or "mode." not in name:
            return ""
        return f"modes of the state: {', '.join(self.arrays['eigenvalues'].columns) or 'none'}"

    def _ipython_key_completions_(self) -> list[str]:
        """Return the names of its quantities, for completion in notebooks."""
        return self.quantities.names()

    @cached_property
    def _states_known(self) -> bool:
        run = self.trajectory
        return all(bool(np.isfinite(x).all()) for x in (run.q, run.v, run.a))

    def require_finite(self, name: str) -> None:
        """Raise where a quantity is not a number somewhere.

        Raises:
            DynamicsError: Says where; ``partial`` holds the result.
        """
        if self._states_known and self.quantities.is_rate(name):
            return
        bad = np.flatnonzero(~self[name].known)
        if not len(bad):
            return
        run, row = self.trajectory, int(bad[0])
        more = f", nor in {len(bad) - 1} more rows" if len(bad) > 1 else ""
        never = [
            f"{time.removesuffix('.time')} does not take place; its count is 0"
            for time, series in run.columns.items()
            if time.endswith(".time") and time in name and np.isnan(series.values).any()
        ]
        said = [note for note in self.outcome.notes if note.startswith(f"row {row + 1}: ")]
        hint = "; ".join(never[:1] or said) or self._modes_instead_of(name)
        at = format_configuration(run.mechanism.model, run.q[row])
        raise DynamicsError(
            f"{name} is not finite at {run.parameter} = {run.grid.t[row]:.9g} {run.unit}, where {at}{more}"
            f"{refusals(run.dynamics.forces, run.q[row])}",
            hint=hint or "a massless body that is free to move, a division by zero, or numbers beyond 1e150 there",
            partial=self,
            t=float(run.grid.t[row]),
            q=run.q[row],
        )

    def summary(self) -> dict[str, Any]:
        """Return the headline numbers with units, the measured accuracy, versions and the hash of the input."""
        import pinocchio

        run, mechanism = self.trajectory, self.trajectory.mechanism
        return {
            "scenario": self.name,
            "title": self.content.title,
            "mechanism": mechanism.title,
            "problem": self.kind,
            "rows": len(run),
            "range": {"of": run.parameter, "unit": str(run.unit), "from": run.grid.t[0], "to": run.grid.t[-1]},
            "arguments": {
                name: {"value": value, "unit": str(mechanism.argument_units.get(name, "?"))}
                for name, value in mechanism.arguments.items()
            },
            "payloads": {
                name: {
                    "point": payload.point,
                    "mass": {"value": float(payload.mass), "unit": "kg"},
                    "inertia": {"value": [float(x) for x in payload.inertia], "unit": "kg*m^2"},
                }
                for name, payload in mechanism.payloads.items()
            },
            "outputs": {series.name: self.headline(series) for series in self.columns()[1:]},
            "numbers": {
                text: {"value": float(series.values[0]), "unit": str(series.unit or "?"), "quadrature error": error}
                for text, (series, error) in self.numbers().items()
            },
            **{
                key: {
                    name: {"value": float(series.values[0]), "unit": str(series.unit or "?")}
                    for name, series in section.numbers.items()
                }
                for key, section in self.sections.items()
            },
            "accuracy": self._accuracy(),
            "cost": {name: int(value) for name, value in self.figures.items() if name in COSTS},
            "findings": {name: x for name, x in self.figures.items() if name not in (*MEASURES, *COSTS)},
            "limits": [
                {**asdict(excess), "unit": str(excess.unit), "sentence": excess.words(run)}
                for excess in self.excesses()
            ],
            "not solved for": [asdict(removal) for removal in self.removals],
            "notes": self.notes(),
            "versions": {
                "pinarm": import_module("pinarm").__version__,
                "pinocchio": pinocchio.__version__,
                "numpy": np.__version__,
            },
            "input": self.digest(),
        }

    def _accuracy(self) -> dict[str, Any]:
        measured: dict[str, Any] = {name: self.figures[name] for name in self.figures if name in MEASURES}
        if "evaluations" in self.figures and not self.errors:
            measured["error"] = NOT_ESTIMATED
        if self.errors:
            measured |= {"error": self.error, "error of outputs": dict(self.errors), "setting": self.setting}
            measured |= {"error of numbers": dict(self.number_errors)} if self.number_errors else {}
            measured |= {"no bound": self.no_bound} if self.no_bound else {}
        if self.content.accuracy.target is not None:
            measured |= {"target": self.content.accuracy.target, "target reached": not self.missed}
        return measured

    def headline(self, series: Series) -> dict[str, Any]:
        """Return a quantity's smallest and largest value among the rows, where they stand, and its doubt if any.

        ``start`` and ``end`` are NaN where the value there depends on how frictions at rest share a load.
        """
        t, least, greatest = self.trajectory.grid.t, *self._bounds(series)
        values = np.where(self.quantities.open_rows(series.name), np.nan, series.values) + 0.0  # -0 becomes 0
        slack = PLATEAU * max(float(np.abs(x[np.isfinite(x)]).max(initial=0.0)) for x in (least, greatest))
        low, high = (
            int((least <= np.fmin.reduce(least) + slack).argmax()),  # of NaN alone it is NaN: the first row
            int((greatest >= np.fmax.reduce(greatest) - slack).argmax()),
        )
        return {
            "unit": str(series.unit or "?"), "min": least[low], "at_min": t[low], "max": greatest[high],
            "at_max": t[high], "start": values[0], "end": values[-1],
            **({"doubt": series.doubt} if series.doubt else {}),
        }  # fmt: skip

    def _bounds(self, series: Series) -> tuple[Array, Array]:
        """Return the least and greatest values of an output in each row, in its unit."""
        bounds = self.quantities.bounds(series.name)
        least, greatest = ((bound.to(series.unit) if series.unit else bound).values + 0.0 for bound in bounds)
        return least, greatest

    def notes(self) -> list[str]:
        """Return notes on simplifications of the files, on outputs that are one choice of many, and on doubts.

        The last are residuals beyond rounding, where no global error was estimated.
        """
        run = self.trajectory
        doubts = [f"{series.name}: {series.doubt}" for series in self.columns() if series.doubt]
        rules = dict.fromkeys(self.quantities.evaluation.friction_doubts.values())
        doubts += [
            f"{rule}: what follows from its friction, such as efforts and motions, rests on this choice"
            for rule in rules
        ]
        undecided = [note for note in open_notes(self.outcome.decisions) if note not in self.no_bound]
        said = [*run.mechanism.notes, *doubts, *undecided, *self.outcome.notes]
        said += beyond_points(run)
        said += [] if self.errors else unexplained_notes(self.figures)  # a bound of the error covers them
        return list(dict.fromkeys(said))  # a result that is read from a folder brings its own along

    def excesses(self) -> list[Excess]:
        """Return the limits of joints that the run goes beyond."""
        return list(self._excesses)

    @cached_property
    def _excesses(self) -> list[Excess]:
        return excesses(self.trajectory, self._highest)

    def _highest(self, height: Callable[[Trajectory], Array]) -> Trajectory:
        """Return the row at which a function of rows is largest, between the rows too.

        Of free motions the rows are enough: what would pull in these has let go.
        """
        if self.kind != "forward":
            with suppress(PinarmError):  # it has no end, or a saved result cannot be solved any more
                return self.lookup.highest(lambda rows: height(rows.trajectory), "the pull")[0].trajectory
        return highest_row(self.trajectory, height)

    def digest(self) -> str:
        """Return a hash of what determines the numbers: the scenario and the model's text."""
        relevant = {key: value for key, value in self.data.items() if key not in ("expect", "title", "variants")}
        mechanism = self.trajectory.mechanism
        described = msgspec.to_builtins(mechanism.description, enc_hook=plain)
        text = json.dumps([relevant, described, mechanism.xml], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


MEASURED = ("name", "figures", "errors", "number_errors", "setting", "no_bound", "removals", "known")
"""Fields that do not follow from the rows."""
