"""``pinarm.Scenario``: one question about one mechanism, in a file, and its solution."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
import pinocchio as pin
from msgspec.structs import replace as replace_fields

from pinarm.engine.checks.balance import plain, power_balance
from pinarm.engine.checks.residuals import residual_figures, unclosed
from pinarm.engine.constraints.nullspace import one_blas_thread
from pinarm.engine.integration.methods import REMOVED
from pinarm.engine.mechanism import Mechanism as MechanismParts
from pinarm.engine.mechanism_loading import acted_along, mechanism_of_data, read_mechanism
from pinarm.engine.motion.guards import acting_on_angles, between, require_turns, turned_between
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, Key, MethodError, NumericsError, PinarmError
from pinarm.input.formulas.expressions import Expression
from pinarm.input.roots import contained_file, root_of
from pinarm.input.units import unit
from pinarm.input.yaml.document import Document, Values, argument_of, value_at, varied, written_unit
from pinarm.input.yaml.schema import Measured
from pinarm.mechanics.geometry.kinematics import one_run
from pinarm.mechanics.perturbation import perturbed_numbers
from pinarm.problems import KINDS, Problem
from pinarm.problems.simplification import Simplification
from pinarm.problems.time_grid import require_memory
from pinarm.records import Record, public_face, replace
from pinarm.use.facade import Result
from pinarm.use.mechanism import Mechanism, with_methods
from pinarm.use.result.failures import failures_in_words, is_too_large, overflow
from pinarm.use.result.measures import Figures
from pinarm.use.result.presentation import UNIT_KINDS
from pinarm.use.scenario.file_kind import (
    GIVEN,
    content_of,
    declared_unit,
    mechanism_data,
    problem_of,
    refuse_changes,
    refuse_folder,
    refuse_mechanism,
    refuse_model,
    with_digits,
)
from pinarm.use.scenario.scenario_file import ScenarioFile
from pinarm.use.workers.runners import HERE, Runners

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pinarm.engine.motion.prescribed_motion import PrescribedTable
    from pinarm.mechanics.control.function import ControlFunction, FunctionControl
    from pinarm.mechanics.forces.function_effort import FunctionForce
    from pinarm.problems.accuracy import Accuracy
    from pinarm.use.result.section import Numbered

PERTURBED = "initial", "loads", "motion", "hold", "over", "velocity", "acceleration"
"""Keys of problems whose numbers have other last digits where the mechanism has."""


class Scenario(Record, frozen=True):
    """A scenario, read and checked; nothing is computed before ``run``.

    Attributes:
        document: The file with the places of its lines.
        content: The same, validated.
        problem: The question in it.
        folder: Folder that paths in it are relative to.
        seed: Of changes in the last digits of the mechanism and the problem; none for these as they are.
        given: The mechanism where it was given as such; ``None`` where a file or a name says it.
        functions: Controllers given as functions in Python.
        function_forces: Loads given as functions in Python.
        runners: Who solves the many runs that searches and sensitivities take; another process that reads the scenario
            again does so by itself.
    """

    document: Document
    content: ScenarioFile
    problem: Problem
    folder: Path
    seed: int | None = None
    given: MechanismParts | None = None
    functions: tuple[FunctionControl, ...] = ()
    function_forces: tuple[FunctionForce, ...] = ()
    runners: Runners = HERE

    __dir__ = public_face()

    @classmethod
    def load(cls, path: str | Path, values: Values | None = None) -> Self:
        """Read a scenario file; see ``pinarm.load``."""
        refuse_folder(Path(path))
        refuse_model(Path(path))
        document, folder = Document.read(Path(path), source=str(path)), Path(path).parent
        refuse_mechanism(Path(path), document.data)
        document = with_digits(document)
        if values:
            document = varied(document, values, partial(declared_unit, document.data, folder))
        return cls.of(document, folder)

    @classmethod
    def of(cls, document: Document, folder: Path) -> Self:
        """Check a scenario that has been read; paths in it are relative to ``folder``."""
        content = content_of(document)
        return cls(document, content, problem_of(document, content.problem), folder)

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the scenario of plain data, such as a file would hold; see ``pinarm.load``."""
        given = data.get("mechanism")
        if isinstance(given, pin.Model):
            raise InputError(
                "scenario: the mechanism is a model of Pinocchio",
                expected="a Mechanism, the path of a file, or the name of a robot",
                hint="pinarm.Mechanism.of(model)",
            )
        if not isinstance(given, Mapping | MechanismParts):
            return cls.of(Document.of_data(data, "scenario"), Path())
        if isinstance(given, MechanismParts):
            refuse_changes(data)
        scenario = cls.of(Document.of_data({**data, "mechanism": GIVEN}, "scenario"), Path())
        return replace(
            scenario, given=mechanism_of_data(given, scenario.acted) if isinstance(given, Mapping) else given
        )

    def __repr__(self) -> str:
        outputs = ", ".join(self.content.outputs)
        return f"<Scenario '{self.name}', {self.problem.kind} of {self.content.mechanism}; {outputs}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle its source: the parts built from it contain functions."""
        return ScenarioSource.scenario, (self.source,)

    @property
    def source(self) -> ScenarioSource:
        """Source of the scenario, with absolute paths, valid for a process in another folder."""
        path = self.document.path
        document = replace(self.document, path=path.parent.resolve() / path.name) if path else self.document
        folder = self.folder.resolve()
        return ScenarioSource(document, folder, self.seed, self.given, self.functions, self.function_forces)

    def varied(self, values: Values) -> Self:
        """Return the scenario with other values.

        Args:
            values: Path -> value as a file would have it, such as ``{"arguments.m_A": "0.2 kg"}``, or texts such as
                ``["arguments.m_A=0.2 kg"]``; see ``input.yaml.document``.

        Raises:
            InputError: A path leads nowhere, or a value is wrong there.
        """
        return self.with_document(self.varied_document(values)) if values else self

    def varied_document(self, values: Values) -> Document:
        """Return its document with other values, which is not validated; see ``varied``."""
        return varied(self.document, values, partial(declared_unit, self.document.data, self.folder))

    def restated(self, data: Mapping[str, Any]) -> Self:
        """Return the scenario of other plain data in the same place, such as ``Result.data``."""
        return self.with_document(replace(self.document, data=dict(data)))

    def with_document(self, document: Document) -> Self:
        """Return the scenario of another document; a loaded mechanism of which it says the same is kept."""
        content = content_of(document)
        other = replace(self, document=document, content=content, problem=problem_of(document, content.problem))
        same = self.loaded and self._mechanism_data == other._mechanism_data
        return other.with_mechanism(self.mechanism) if same else other

    def with_mechanism(self, mechanism: MechanismParts) -> Self:
        """Return the scenario with its mechanism as it has been loaded already."""
        other = replace(self)
        vars(other)["mechanism"] = with_methods(mechanism)
        return other

    @property
    def loaded(self) -> bool:
        """Whether its mechanism has been loaded."""
        return "mechanism" in vars(self)

    @property
    def _mechanism_data(self) -> list[Any]:
        """Entries of the document that define the mechanism, and the coordinates that the problem acts on."""
        keys = "mechanism", "arguments", "gravity", "payloads", "changes"
        return [*(self.document.data.get(key) for key in keys), self.acted]

    @property
    def acted(self) -> list[str]:
        """Names of coordinates along which loads of the problem act, or that its controllers need."""
        return acted_along(getattr(self.problem, "loads", {}).values(), getattr(self.problem, "control", ()))

    @cached_property
    def name(self) -> str:
        """Name of the file without its ending; of ``scenario.yaml``, as ``new`` writes it, that of its folder."""
        path = self.document.path
        stem = path.stem if path else ""
        if path and stem == "scenario":
            stem = path.parent.resolve().name
        return stem.strip(". ") or "scenario"  # ``...yaml`` has the stem ``..``, which is another folder

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the scenario's arguments and gravity, and controllers given in Python."""
        mechanism = self._read()
        if self.seed is not None:
            mechanism = mechanism.perturbed(self.seed)
        if self.functions:
            mechanism = replace(mechanism, control=(*mechanism.control, *self.functions))
        if not self.function_forces:
            return with_methods(mechanism)
        from pinarm.mechanics.forces.force_element import check_new
        from pinarm.problems.control import MechanismPlant

        plant, forces = MechanismPlant(mechanism, mechanism.dynamics), dict(mechanism.forces)
        for force in self.function_forces:
            check_new(force.name, forces)
            forces[force.name] = force.bind(mechanism.model, mechanism.coordinates, plant)
        return with_methods(replace(mechanism, forces=forces))

    def _read(self) -> MechanismParts:
        if self.given is not None:
            refuse_changes(self.document.data)
            return self.given
        wanted = self.content.mechanism
        with self.document.locating("mechanism"):
            return read_mechanism(
                self._file_of(wanted) if Path(wanted).suffix else wanted,
                {name: value.given for name, value in self.content.arguments.items()},
                gravity=self.content.gravity,
                payloads=self.content.payloads,
                changes=self.document.part("changes") if self.content.changes else None,
                locate=self.document.locating,
                acted=self.acted,
            )

    def _file_of(self, wanted: str) -> Path:
        """Return the file of the mechanism; of a saved scenario elsewhere, errors name the one saved beside it."""
        try:
            return contained_file((self.folder / wanted).absolute(), root_of(self.folder), {})
        except InputError as error:
            if (self.folder / "summary.json").is_file() and (self.folder / GIVEN).is_file():
                error.hint = f"mechanism: {GIVEN}, which was saved beside it; or {error.hint}"
            raise

    def number_at(self, path: str) -> Measured:
        """Return the number that a path leads to, as ``varied`` takes it: of the scenario, or else of its mechanism."""
        if (argument := argument_of(path)) in self.mechanism.arguments:
            number = Measured(self.mechanism.arguments[argument])
            own = self.content.arguments.get(argument)
            number.unit = own.unit if own is not None and own.unit else self.mechanism.argument_units.get(argument)
            return number
        value = value_at(self.document.data, path)
        if value is None and path.startswith("changes."):
            file = mechanism_data(self.document.data, self.folder) or self.mechanism.source.data
            value = value_at(file, path.removeprefix("changes."))
        try:
            return Measured.read(value)
        except InputError:
            what = "nothing stands" if value is None else f"'{str(value)[:40]}' stands"
            expected = "the path of a number, such as arguments.l2 or problem.time.end"
            raise InputError(f"no number is at '{path}': {what} there", expected=expected) from None

    def unit_at(self, path: str) -> str:
        """Return the unit of the number at a path, in the scenario or else its mechanism; empty where it has none."""
        written = written_unit(self.document.data, path)
        if path.startswith("changes."):
            return written or declared_unit(self.document.data, self.folder, path)
        name = argument_of(path)
        declared = self.mechanism.description.written_unit(name) if name else ""
        if written and declared and unit(written) != unit(declared):
            raise InputError(
                f"the argument '{name}' is in {written} here and in {declared} in the mechanism",
                expected=f"numbers with their unit, such as '1, 2, 3 {written}'",
            )
        return written or declared

    @cached_property
    def symbols(self) -> Mapping[str, Expression]:
        parsed = {}
        for name, text in self.content.symbols.items():
            with self.document.locating("symbols", name):
                parsed[name] = Expression.parse(text)
        return parsed

    @cached_property
    def _question(self) -> Problem:
        """The problem; its loads, laws and states have other last digits where the mechanism has."""
        if self.seed is None:
            return self.problem
        generator = np.random.default_rng(self.seed)
        given = {key: getattr(self.problem, key) for key in PERTURBED if hasattr(self.problem, key)}
        return cast("Problem", replace_fields(cast("Any", self.problem), **perturbed_numbers(given, generator)))

    @cached_property
    def simplification(self) -> Simplification:
        """Simplification of the problem to the part of the mechanism that it requires."""
        self.require_memory()
        if self.content.modelled == "whole":
            return Simplification.whole(self._question, self.mechanism, self.content.accuracy, self.place)
        return Simplification.required(self._question, self.mechanism, self.content.accuracy, self.place)

    def controlled(
        self, control: Mapping[str | tuple[str, ...], ControlFunction], period: float | None = None, delay: float = 0.0
    ) -> Self:
        """Return the scenario with drives whose efforts are functions; see ``run``.

        Raises:
            InputError: It is no forward problem, a function cannot be called, or the period is not positive.
        """
        from pinarm.mechanics.control.function import function_controls

        if self.problem.kind != "forward":
            raise InputError(
                f"the problem is of the kind '{self.problem.kind}': its motion is known",
                expected="a forward problem, whose drives can react",
            )
        return replace(self, functions=(*self.functions, *function_controls(control, period, delay)))

    def with_forces(self, forces: Mapping[str, tuple[str, ControlFunction]]) -> Self:
        """Return the scenario with loads that are functions; see ``run``.

        Raises:
            InputError: One is no coordinate with a function.
        """
        from pinarm.mechanics.forces.function_effort import function_forces

        return replace(self, function_forces=(*self.function_forces, *function_forces(forces)))

    def run(
        self,
        control: Mapping[str | tuple[str, ...], ControlFunction] | None = None,
        *,
        period: float | None = None,
        delay: float = 0.0,
        forces: Mapping[str, tuple[str, ControlFunction]] | None = None,
    ) -> Result:
        """Solve the problem; with ``accuracy.target``, at the cheapest setting whose error is below it.

        Args:
            control: Drives whose efforts are functions: drive, or several in a tuple, -> ``u(t, state)``, which returns
                an effort, or a sequence of them [N*m or N]; ``state["knee"]`` is a quantity of the present state [SI].
                See docs/control.md.
            period: Of sampled functions [s]: called once each period, their effort is held until the next; continuous
                where it is left out.
            delay: From a sample to the change of the effort [s].
            forces: Loads that are functions, in problems of any kind: name -> coordinate that the load acts along, and
                ``f(t, state)``, which returns an effort [N*m or N]: ``{"brake": ("knee", f)}``. It has to depend on its
                arguments only, and to be smooth in them.

        Raises:
            PinarmError: The input is impossible, or the numerics failed; then ``partial`` holds the result until there.
        """
        if control is None and (period is not None or delay):
            raise InputError(
                "a period or a delay is given, but no function", expected="control, with functions of drives"
            )
        asked = self.controlled(control, period, delay) if control is not None else self
        asked = asked.with_forces(forces) if forces else asked
        asked.check_answer_key()
        return asked._reaching_target()

    def _reaching_target(self) -> Result:
        """Return the result; with ``accuracy.target``, at the cheapest setting whose error is below it."""
        search = self.content.find
        if self.content.accuracy.target is None or (search and search.objective):  # every run of which reaches it
            return self.solve()
        from pinarm.use.accuracy.tolerance_search import reach_target

        return cast("Result", reach_target(self))

    def with_workers(self, workers: int | None = None, executor: Executor | None = None) -> Self:
        """Return the scenario whose searches and sensitivities give their runs to others; the numbers are the same.

        Args:
            workers: Processes of this machine; this process where it is left out. Of an executor, how many workers it
                has, where it cannot tell.
            executor: Who solves the runs in place of processes of this machine; see ``pinarm.sweep``. It has to live as
                long as sections of results are asked for.

        Raises:
            InputError: There are less than one.
        """
        return replace(self, runners=Runners(workers, executor))

    def verified(self) -> Result:
        """Return the result with its global error estimated, and every row of it checked.

        Raises:
            PinarmError: See ``run``.
        """
        from pinarm.use.accuracy.error_estimate import estimate_errors

        self.check_answer_key()
        result = self._reaching_target()
        run, rows = result.trajectory, len(result)
        with one_blas_thread(self.mechanism.model.nv):
            figures = plain({**power_balance(run, rows), **residual_figures(run, result.outcome.motion, rows)})
        result = replace(result, figures={**result.figures, **figures})
        if result.errors:
            return result
        scenario = self.restated(result.data) if "find" in result.known else self
        return cast("Result", estimate_errors(scenario, result))

    def solve(self) -> Result:
        """Solve the problem once, at its own setting; with ``find``, for the values that bring about what is wanted.

        Raises:
            PinarmError: See ``run``.
        """
        self.check_presentation()
        if self.problem.kind == "recorded":  # the headings say what can be asked: a long table is not read in vain
            self.document.with_each("outputs", self.content.outputs, self.quantities().__getitem__)
        if self.content.find:
            from pinarm.use.scenario.searches import solve_found

            return cast("Result", solve_found(self, self.content.find))
        try:
            with failures_in_words():
                return self.solve_once()
        except NumericsError as error:
            if isinstance(error.partial, Outcome):
                error.partial = self.broken_off(error.partial, error.message)
            raise

    def validate(self) -> None:
        """Check everything that can be checked without solving: the model, all names, all units.

        Raises:
            PinarmError: Something is wrong; the message says where.
        """
        self._check_asked()
        self.quantities().check_symbols(self.symbols, self.document.locating)
        for name in self.content.variants:
            with self.document.locating("variants", name):
                self.variant(name)._check_asked()

    def _check_asked(self) -> None:
        """Check what is solved and what is asked of it; symbols of variants that do not ask for them may be others'."""
        self.require_memory()
        with failures_in_words():
            self.problem.prepare(self.mechanism, self.content.accuracy, self.place)
            quantities = self.quantities()
            self.document.with_each("outputs", self.content.outputs, quantities.__getitem__)
            self.check_presentation()
            if self.content.numbers:
                from pinarm.use.result.numbers import read_number
            for index, text in enumerate(self.content.numbers):
                with self.document.locating("numbers", index):
                    read_number(text).described(quantities, self.numbered)
            if self.content.find:
                from pinarm.use.scenario.searches import check_search

                check_search(self, self.content.find, quantities)
            for key, assessment in self.content.assessments.items():
                with self.document.locating(key):
                    assessment.check_names(quantities, self)
        self.check_answer_key()

    def prescribed_table(self) -> PrescribedTable | None:
        """Return the prescribed motion and its rows, with nothing solved; ``None`` where laws do not determine it."""
        if not KINDS[self.problem.kind].prescribing:
            return None
        self.require_memory()
        return cast("PrescribedTable", self.problem.prepare(self.mechanism, self.content.accuracy, self.place))

    def solve_once(self) -> Result:
        """Solve the problem once, without a search; measure the accuracy, and refuse what is not finite."""
        with one_run(), one_blas_thread(self.mechanism.model.nv):
            try:
                solved = self.simplification.solve()
            except MethodError as error:
                raise error.at(self.document.locate(("accuracy", "method"))) from None
            return self.measured(*solved)

    def measured(self, solved: Outcome, whole: Outcome) -> Result:
        """Return the result with its accuracy, from the outcomes of the mechanism that was solved and of the whole."""
        self._require_turns(whole)
        known = plain(solved.figures)
        if solved.rows.mechanism.frictions:
            from pinarm.engine.quantities.friction_law import friction_figures

            known |= friction_figures(solved.rows)
        removals = self.simplification.removals if solved is not whole else ()
        noted = replace(whole, notes=(*whole.notes, *unclosed(whole.rows), *self.method_notes(self.content.accuracy)))
        result = self.result(noted)
        self.document.with_each("outputs", self.content.outputs, result.require_finite)
        if is_too_large(whole):
            raise overflow(whole)
        measure = partial(self._accuracy, solved, whole, result.quantities)
        return replace(result, figures=Figures(known, measure), removals=removals)

    def _accuracy(self, solved: Outcome, whole: Outcome, quantities: Quantities) -> dict[str, float]:
        with failures_in_words(), one_run(), one_blas_thread(self.mechanism.model.nv):
            balances = {**power_balance(solved.rows), **residual_figures(solved.rows, solved.motion)}
            balances |= solved.measures()
            measures = plain({**balances, **quantities.figures()})
        if not all(math.isfinite(measure) for measure in measures.values()):
            raise overflow(whole)
        return measures

    def _require_turns(self, outcome: Outcome) -> None:
        """Refuse angles along which something acts that leap between rows; forward runs look into their steps."""
        rows, motion = outcome.rows, outcome.motion
        if motion is None or self.problem.kind == "forward":
            return
        mechanism = rows.mechanism
        acting = acting_on_angles(mechanism.constraints, rows.dynamics.forces, coordinates=mechanism.coordinates)
        acting += turned_between(rows.dynamics.forces, rows.q)
        if acting:
            t = between(rows.grid.t)
            require_turns(mechanism.model, acting, t, motion.positions(t), rows.parameter, str(rows.unit))

    def broken_off(self, outcome: Outcome, why: str) -> Result:
        """Return the result of what there was when the numerics failed."""
        note = f"the numerics failed, and what there was by then is not checked: {why}"
        return self.result(replace(outcome, notes=(*outcome.notes, note, *self.method_notes(self.content.accuracy))))

    def method_notes(self, accuracy: Accuracy) -> list[str]:
        """Return a note where the scenario names a removed method of integration, with the setting that is used."""
        named = self.document.data.get("accuracy", {}).get("method", accuracy.method)
        if named not in REMOVED or self.problem.kind != "forward":
            return []
        by, value = accuracy.setting
        return [f"accuracy.method: {named} was removed; {accuracy.method} integrates the motion, {by} {value:g}"]

    def result(self, outcome: Outcome) -> Result:
        """Return the result of what came out for the whole mechanism; its accuracy is not measured."""
        quantities = Quantities(outcome.rows, self.symbols, self.content.undetermined)
        return Result(self.name, outcome, quantities, self)

    def check_answer_key(self) -> None:
        """Check names and units of the answer key, with nothing solved."""
        if not self.content.expect:
            return
        with failures_in_words():
            try:
                quantities = self.quantities()
            except PinarmError:  # the problem has a mistake: solving it says where
                return
            for index, expectation in enumerate(self.content.expect):
                with self.document.locating("expect", index):
                    expectation.check_names(quantities, self.numbered)

    def require_memory(self) -> None:
        """Raise where the rows that ``time.samples`` or a range asks for need too much memory."""
        ranges: dict[tuple[str, ...], Any] = {("time",): getattr(self.problem, "time", None)}
        ranges |= {("over", name): values for name, values in getattr(self.problem, "over", {}).items()}
        for path, values in ranges.items():
            with self.place(*path, "samples"):
                key = ".".join(("problem", *path, "samples"))
                if values:
                    require_memory(values.samples, self.mechanism.model, len(self.content.outputs), key)

    def check_presentation(self) -> None:
        """Refuse units and labels of what does not exist, and units of another dimension."""
        if not self.content.units and not self.content.labels:
            return
        quantities, presentation = self.quantities(), self.content.presentation
        for name in self.content.labels:
            with self.document.locating("labels", Key(name)):
                of_axis = name.startswith("changes.") or argument_of(name) in self.mechanism.arguments  # of a sweep
                if not of_axis and value_at(self.document.data, name) is None:
                    quantities[name]
        for name in presentation.units:
            with self.document.locating("units", Key(name)):
                try:
                    series = quantities[name]
                except InputError as error:
                    error.expected += f"; or a kind with a unit of it: {', '.join(UNIT_KINDS)}"
                    raise
            with self.document.locating("units", name):
                presentation.written(series)

    @property
    def numbered(self) -> Mapping[str, Numbered]:
        """Search and assessments of the scenario, by the key of their section; see ``section_number``."""
        return {**({"find": self.content.find} if self.content.find else {}), **self.concluded}

    @property
    def concluded(self) -> Mapping[str, Numbered]:
        """Assessments of the run, and its frequency response where outputs are requested."""
        outputs = getattr(self.problem, "outputs", ())
        if not outputs or getattr(self.problem, "frequencies", None) is None:
            return self.content.assessments
        from pinarm.use.result.vibrations import ResponseNumbers

        own = ResponseNumbers(self.problem, self.content.accuracy, self.place, lambda: self.mechanism, outputs)
        return {"frequency_response": own, **self.content.assessments}

    def variant(self, name: str) -> Self:
        document = self.document
        for path, value in {**self.content.variants[name], "variants": {}}.items():
            document = document.assigned(path, value, self.document.locate(("variants", name, path)))
        return self.with_document(document)

    def without_variants(self) -> Self:
        if not self.content.variants:
            return self
        return self.with_document(self.document.assigned("variants", {}, self.document.locate(("variants",))))

    def quantities(self) -> Quantities:
        """Return the quantities of one row, with nothing solved: enough to see which there are, and their units."""
        return Quantities(self.problem.schema_row(self.mechanism), self.symbols, self.content.undetermined)

    def place(self, *path: str | int) -> AbstractContextManager[None]:
        return self.document.locating("problem", *path)


class ScenarioSource(Record, frozen=True):
    """Source from which another process reads a scenario: its fields, with absolute paths."""

    document: Document
    folder: Path
    seed: int | None
    given: MechanismParts | None
    functions: tuple[FunctionControl, ...]
    function_forces: tuple[FunctionForce, ...]

    def scenario(self) -> Scenario:
        fields = {name: getattr(self, name) for name in ("seed", "given", "functions", "function_forces")}
        return replace(Scenario.of(self.document, self.folder), **fields)


Given = Scenario | str | Path | Mapping[str, Any]
"""A scenario, its file, or what such a file would hold as plain data."""


def load(scenario: Given, values: Values | None = None) -> Scenario:
    """Read and check a scenario file; nothing is computed before ``run``.

    Args:
        scenario: The file; or what such a file would hold, ``{"pinarm": 1, "mechanism": "panda", ...}``, with paths
            relative to the working folder, and a ``Mechanism``, or the data of its file, in place of the file; or a
            scenario that has been read, of which values are to be replaced.
        values: Other values than those of the file: ``{"problem.time.end": "3 s", "arguments.m_A": 0.2}``, or texts
            ``["problem.time.end=3 s"]``. A bare number is in SI, and allowed where the file has an SI unit or none.

    Raises:
        InputError: The file cannot be read or has a mistake, or a path leads nowhere; the message says where.
    """
    if isinstance(scenario, Mapping):
        scenario = Scenario.of_data(scenario)
    if isinstance(scenario, Scenario):
        return scenario.varied(values) if values else scenario
    if not isinstance(scenario, str | PathLike):
        raise InputError(
            f"a value of the type {type(scenario).__name__} is no scenario",
            expected="a Scenario, its file, or a map of what the file would hold",
        )
    return Scenario.load(scenario, values)
