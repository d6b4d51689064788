"""A scenario: one question about one mechanism, in a file; the record that ``use.facade.Scenario`` solves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np
import pinocchio as pin
from msgspec.structs import replace as replace_fields

from pinarm.engine.checks.balance import plain, power_balance
from pinarm.engine.checks.residuals import residual_figures, unclosed
from pinarm.engine.constraints.nullspace import one_blas_thread
from pinarm.engine.integration.methods import REMOVED
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.mechanism_loading import acted_along, mechanism_document, mechanism_of_data, read_mechanism
from pinarm.engine.motion.guards import acting_on_angles, between, require_turns, turned_between
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, Key, MethodError, PinarmError
from pinarm.input.formulas.expressions import Expression
from pinarm.input.roots import contained_file, root_of
from pinarm.input.units import unit
from pinarm.input.yaml.document import Document, Values, argument_of, value_at, varied, written_unit
from pinarm.input.yaml.schema import Measured
from pinarm.mechanics.geometry.kinematics import one_run
from pinarm.mechanics.perturbation import perturbed_numbers
from pinarm.problems import KINDS, Problem, problem_class
from pinarm.problems.simplification import Simplification
from pinarm.problems.time_grid import require_memory
from pinarm.records import Record, replace
from pinarm.use.result.failures import failures_in_words, is_too_large, overflow
from pinarm.use.result.measures import Figures
from pinarm.use.result.presentation import UNIT_KINDS
from pinarm.use.result.result import Result
from pinarm.use.scenario.file_kind import (
    GIVEN,
    refuse_changes,
    refuse_folder,
    refuse_mechanism,
    refuse_misplaced_keys,
    refuse_model,
)
from pinarm.use.scenario.scenario_file import ScenarioFile
from pinarm.use.workers.runners import HERE, Runners

if TYPE_CHECKING:
    from pinarm.engine.motion.prescribed_motion import PrescribedTable
    from pinarm.mechanics.control.function import FunctionControl
    from pinarm.mechanics.forces.function_effort import FunctionForce
    from pinarm.problems.accuracy import Accuracy
    from pinarm.use.result.section import Numbered

KEYS = ScenarioFile.__struct_encode_fields__
"""Keys of scenario files."""

PERTURBED = "initial", "loads", "motion", "hold", "over", "velocity", "acceleration"
"""Keys of problems whose numbers have other last digits where the mechanism has."""


class Scenario(Record, frozen=True):
    """A scenario, read and checked.

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
    given: Mechanism | None = None
    functions: tuple[FunctionControl, ...] = ()
    function_forces: tuple[FunctionForce, ...] = ()
    runners: Runners = HERE

    @classmethod
    def load(cls, path: str | Path, values: Values | None = None) -> Self:
        """Read a scenario file; see ``pinarm.load``."""
        refuse_folder(Path(path))
        refuse_model(Path(path))
        document, folder = Document.read(Path(path), source=str(path)), Path(path).parent
        refuse_mechanism(Path(path), document.data)
        document = _with_digits(document)
        if values:
            document = varied(document, values, partial(declared_unit, document.data, folder))
        return cls.of(document, folder)

    @classmethod
    def of(cls, document: Document, folder: Path) -> Self:
        """Check a scenario that has been read; paths in it are relative to ``folder``."""
        content = _content(document)
        return cls(document, content, _problem(document, content.problem), folder)

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
        if not isinstance(given, Mapping | Mechanism):
            return cls.of(Document.of_data(data, "scenario"), Path())
        if isinstance(given, Mechanism):
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
        return ScenarioSource(type(self), document, folder, self.seed, self.given, self.functions, self.function_forces)

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
        content = _content(document)
        other = replace(self, document=document, content=content, problem=_problem(document, content.problem))
        same = self.loaded and self._mechanism_data == other._mechanism_data
        return other.with_mechanism(self.mechanism) if same else other

    def with_mechanism(self, mechanism: Mechanism) -> Self:
        """Return the scenario with its mechanism as it has been loaded already."""
        other = replace(self)
        vars(other)["mechanism"] = mechanism
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
        return self.read_mechanism()

    def read_mechanism(self) -> Mechanism:
        """Return the mechanism, read anew; see ``mechanism``."""
        mechanism = self._read()
        if self.seed is not None:
            mechanism = mechanism.perturbed(self.seed)
        if self.functions:
            mechanism = replace(mechanism, control=(*mechanism.control, *self.functions))
        if not self.function_forces:
            return mechanism
        from pinarm.mechanics.forces.force_element import check_new
        from pinarm.problems.control import MechanismPlant

        plant, forces = MechanismPlant(mechanism, mechanism.dynamics), dict(mechanism.forces)
        for force in self.function_forces:
            check_new(force.name, forces)
            forces[force.name] = force.bind(mechanism.model, mechanism.coordinates, plant)
        return replace(mechanism, forces=forces)

    def _read(self) -> Mechanism:
        if self.given is not None:
            refuse_changes(self.document.data)
            return self.given
        wanted = self.content.mechanism
        with self.document.locating("mechanism"):
            file = Path(wanted).suffix and contained_file((self.folder / wanted).absolute(), root_of(self.folder), {})
            return read_mechanism(
                file or wanted,
                {name: value.given for name, value in self.content.arguments.items()},
                gravity=self.content.gravity,
                payloads=self.content.payloads,
                changes=self.document.part("changes") if self.content.changes else None,
                locate=self.document.locating,
                acted=self.acted,
            )

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

    def run(self) -> Result:
        raise NotImplementedError

    def solve(self) -> Result:
        raise NotImplementedError

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
    """Source from which another process reads a scenario: its class and fields, with absolute paths."""

    kind: type[Scenario]
    document: Document
    folder: Path
    seed: int | None
    given: Mechanism | None
    functions: tuple[FunctionControl, ...]
    function_forces: tuple[FunctionForce, ...]

    def scenario(self) -> Scenario:
        fields = {name: getattr(self, name) for name in ("seed", "given", "functions", "function_forces")}
        return replace(self.kind.of(self.document, self.folder), **fields)


def _with_digits(document: Document) -> Document:
    """Return a scenario whose answer key has its values as text, the last digit of which says how exact they are.

    Of ``1.50`` and ``1.5e3`` a number keeps 1.5 and 1500.0.
    """
    entries = document.data.get("expect") if isinstance(document.data, dict) else None
    if not isinstance(entries, list):
        return document
    written = list(entries)
    for k, entry in enumerate(entries):
        value = entry.get("value") if isinstance(entry, dict) else None
        if isinstance(value, float) and math.isfinite(value):
            written[k] = {**entry, "value": document.written(("expect", k, "value"))}
    return replace(document, data={**document.data, "expect": written})


def declared_unit(data: Mapping[str, Any], folder: Path, path: str) -> str:
    """Return the unit that a scenario's mechanism file has at a path below ``arguments`` or ``changes``, if any."""
    if path.startswith("changes."):
        return written_unit(mechanism_data(data, folder), path.removeprefix("changes."))
    if not path.startswith("arguments."):
        return ""
    file, name = mechanism_data(data, folder), argument_of(path)
    declared = file.get("arguments")
    unit_of_model = str(declared.get(name, "")) if isinstance(declared, dict) else ""
    return unit_of_model or written_unit(file, f"parameters.{name}")


def mechanism_data(data: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """Return the content of the mechanism file of a scenario, a drawing included; empty where there is no such file."""
    wanted = data.get("mechanism")
    if not isinstance(wanted, str) or not Path(wanted).suffix:
        return {}
    try:
        file = mechanism_document(contained_file((folder / wanted).absolute(), root_of(folder), {})).data
    except InputError:  # whoever needs the mechanism says what is wrong with it
        return {}
    return file if isinstance(file, dict) else {}


def _content(document: Document) -> ScenarioFile:
    """Validate a scenario; of keys that belong elsewhere, say where."""
    try:
        return document.validate(ScenarioFile)
    except InputError:
        refuse_misplaced_keys(document, KEYS)
        raise


def _problem(document: Document, given: object) -> Problem:
    """Validate the part of the document that holds the question, by the class of its kind."""
    if not isinstance(given, dict) or "kind" not in given:
        missing = "the key 'kind' is missing: it says which kind of problem this is"
        raise InputError(missing, expected=", ".join(KINDS)).at(document.locate(("problem",)))
    with document.locating("problem", "kind"):
        model = problem_class(given["kind"])
    try:
        problem: Problem = document.validate(model, "problem")
    except InputError:
        refuse_misplaced_keys(document, KEYS, "problem")
        raise
    return problem
