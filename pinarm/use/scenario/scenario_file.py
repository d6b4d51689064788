"""Content of scenario files."""

# Annotations are no text here (``from __future__ import annotations``): msgspec would compile each in every run.

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self

import msgspec

from pinarm.errors import InputError, within
from pinarm.input.units import argument_word, read_quantity, unit
from pinarm.input.yaml.schema import Deferred, InputStruct, Measured
from pinarm.language import Language
from pinarm.mechanics.description import Gravity
from pinarm.problems.accuracy import Accuracy
from pinarm.use.assessments import ASSESSMENTS
from pinarm.use.result.expectation import Expectation
from pinarm.use.result.presentation import CsvForm, Presentation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pinarm.engine.quantities.names import Quantities
    from pinarm.input.units import Unit
    from pinarm.mechanics.points import Payload
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Section
    from pinarm.use.scenario.find import Find
    from pinarm.use.scenario.scenario import Scenario

    class Assessment(Protocol):
        """Assessment of a run, as the scenario file requests it."""

        def units(self, quantities: Quantities) -> Mapping[str, Unit | None]: ...

        def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
            """Check its names and units against the quantities of one row, with nothing solved."""

        def evaluate(self, result: Result) -> Section:
            """Return the section with the findings in a result; an InputError where the run lacks what it needs."""

else:  # imported where a scenario has the key, see ScenarioFile.deferred
    Assessment = Find = Payload = Any


class Argument(Measured):
    """A value of an argument: a number, with a unit where the mechanism asks for one, or a word such as ``right_``.

    Attributes:
        word: The word; ``None`` for a number.
    """

    word: str | None = None

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read a number with or without a unit, a word, or a truth value."""
        if not isinstance(value, str | int | float):
            raise InputError("an argument is a number, with a unit where it has one, or a word")
        word = value.word if isinstance(value, cls) else argument_word(value)
        number, written = (0.0, None) if word is not None else read_quantity(str(value))
        measured = cls(number)
        measured.unit, measured.word = value.unit if isinstance(value, Measured) else written, word
        return measured

    @property
    def given(self) -> float | str:
        """The word, or the number."""
        return self if self.word is None else self.word

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle a word as its text, a number as the base class does."""
        return (Argument.read, (self.word,)) if self.word is not None else super().__reduce__()


class ScenarioFile(InputStruct, frozen=True):
    r"""Content of a scenario file.

    Attributes:
        pinarm: Version of the format.
        title: For headings, such as ``Slider-crank with gas force``.
        mechanism: A mechanism file, a URDF or xacro file, relative to this one, such as ``arm.yaml``; or the name of a
            robot of example-robot-data, such as ``panda``.
        arguments: Values for the model's arguments, with units, such as ``{m_A: 0.2 kg}``, or words such as
            ``{prefix: right_}``.
        gravity: Replaces that of the mechanism; ``none`` for none.
        payloads: What links carry in this run, beside the payloads of the mechanism.
        changes: Values that replace others of the mechanism file, such as ``{drives: {knee: {ratio: 100}}}``.
        problem: The question.
        symbols: Names for quantities or formulas, beside those of the mechanism.
        outputs: Quantities of the table and the plots.
        units: Quantity -> the unit that it is shown in, such as ``{N_m: rpm, F: kN}``, or a kind of quantities, such as
            ``{length: mm, force: kN, speed: rpm}``: in the terminal, plots, drawings, replays, reports, checks, CSV
            files and tables of pandas. Without it angles are shown to people in degrees, all else in SI.
        labels: Quantity -> what stands for its name in plots, legends, replays and the terminal: text, TeX, such as
            ``{psid: \dot\psi}``, or text with TeX in it, such as ``{C: torque $C_A$}``. The path of a number that a
            sweep varies may have a label too, such as ``{problem.time.end: duration}``.
        lang: Language of reports, plots, replays, torsors, isolations and lab sheets, such as ``fr``, with a decimal
            comma; English where it is left out. Errors, the terminal and names of the files stay as they are.
        csv: ``semicolons`` between the columns of CSV files of the result, and a decimal comma, as spreadsheets in many
            countries read them; or ``commas``, and a decimal point.
        numbers: Numbers of the run to print, such as ``[C_B @ rms, loads.B.life.time]``: a quantity at a place or as a
            figure of its curve, or a number of an assessment.
        shaking: Shaking force and moment on the frame over the run, such as ``{harmonics: 3}``.
        sizing: Motor and gear of a drive, out of a catalogue, such as ``{drive: knee, catalogue: motors.csv, ratios:
            [20, 40, 80]}``.
        loads: Loads of joints, lives of bearings, balance of rotors, sets of loads for FEM, such as ``{joints: {O:
            {bushing: {diameter: 20 mm, length: 25 mm}}}}``.
        path_error: How far a point passes from wanted ones, such as ``{point: B, wanted: {x: [20 mm, 30 mm], y: [0, 5
            mm]}}``.
        limits: What numbers of the run must keep to, such as ``{keep: {joint.O.effort @ rms: < 20 N*m}}``.
        response: Overshoot, rise and settling time of a step response, such as ``{of: theta, final: 30 deg}``.
        sensitivity: What numbers of the run depend on, and bands from tolerances, such as ``{of: [C_B @ max], to:
            {arguments.m_A: 5 %}}``.
        modelled: ``required``, what the question requires: joints that it holds still are locked; or the ``whole``
            mechanism. The answer is the same.
        undetermined: What to do with reactions that rigid bodies do not determine: ``refuse`` them, or give those of
            the least multipliers (``minimum_norm``), marked as such.
        accuracy: How accurate the answer is wanted.
        variants: Simplified models that the command ``tradeoff`` compares with this one: name -> values replaced, by
            their path, such as ``{massless_rod: {arguments.m_BA: 0 kg}}``.
        find: Numbers of the scenario to find first, and what they are to bring about.
        expect: The answer key: what the answer must be, and what was published, such as ``[{quantity: theta, at: end,
            value: 30 deg, atol: 0.01 deg, source: closed form}]``.
    """

    deferred: ClassVar[Deferred] = {
        "payloads": ("pinarm.mechanics.points", "Payload"),
        "find": ("pinarm.use.scenario.find", "Find"),
        **ASSESSMENTS,
    }

    pinarm: Literal[1]
    mechanism: str
    problem: Any
    outputs: Annotated[list[str], msgspec.Meta(min_length=1)]
    title: str = ""
    arguments: dict[str, Argument] = {}
    gravity: Gravity | Literal["none"] | None = None
    payloads: dict[str, Payload] = {}
    changes: dict[str, Any] = {}
    symbols: dict[str, str] = {}
    units: dict[str, str] = {}
    labels: dict[str, str] = {}
    lang: Language | None = None
    csv: CsvForm = "commas"
    numbers: list[str] = []
    shaking: Assessment | None = None
    sizing: Assessment | None = None
    loads: Assessment | None = None
    path_error: Assessment | None = None
    limits: Assessment | None = None
    response: Assessment | None = None
    sensitivity: Assessment | None = None
    modelled: Literal["required", "whole"] = "required"
    undetermined: Literal["refuse", "minimum_norm"] = "refuse"
    accuracy: Accuracy = msgspec.field(default_factory=Accuracy)
    variants: dict[str, dict[str, Any]] = {}
    find: Find | None = None
    expect: list[Expectation] = []

    def check(self) -> None:
        """Refuse units that there are not, and numbers of the run among the outputs, which are series."""
        for name, text in self.units.items():
            with within("units", name):
                unit(text)
        for index, text in enumerate(self.outputs):
            if "@" in text or text.partition(".")[0] in self.assessments:
                with within("outputs", index):
                    raise InputError(
                        f"'{text[:200]}' is one number of the run, and outputs are quantities at every row",
                        expected="such a number under the key 'numbers', which stands beside 'outputs'",
                        hint=f"numbers: [{text[:200]}]",
                    )

    @property
    def presentation(self) -> Presentation:
        """In which units, and by which labels, quantities are shown."""
        return Presentation.of(self.units, self.labels, self.lang, self.csv)

    @property
    def assessments(self) -> dict[str, Assessment]:
        """Key -> what the scenario asks to conclude from the run."""
        asked = ((key, getattr(self, key)) for key in ASSESSMENTS)
        return {key: assessment for key, assessment in asked if assessment is not None}
