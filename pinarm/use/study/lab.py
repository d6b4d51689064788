"""Sheets for a lab: a notebook that asks the questions of an answer key, and tells what is wrong with an answer."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cached_property, partial
from os.path import relpath
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, PinarmError
from pinarm.input.formulas.expressions import Expression
from pinarm.input.units import unit
from pinarm.input.yaml.document import Values
from pinarm.language import document, in_language, said, spoken, told
from pinarm.mechanics.joints import links_behind, links_of
from pinarm.mechanics.loading.model_tree import inertia
from pinarm.use.facade import Scenario, load
from pinarm.use.result.expectation import Expectation
from pinarm.use.result.presentation import Presentation
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario as ScenarioRecord
from pinarm.use.study.answers.check import compare, computed_rows, wanted_rows

NUMBER, FORMULA = 0.01, 1e-6
"""Difference of an answer that is right, a number or a formula, relative to the largest value."""

RANDOM, SPREAD = 2, 0.1
"""Runs with random arguments in which a formula must hold too, and how far these are from the file's, relatively."""


NUMBER_TEXT = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)(?:\s*([^\W\d].*)|\s+([\w%°].*))?")
"""A number with a unit, or without one."""

COMPUTED = ("effort", "force", "moment", "torque", "energy", "power")
"""Words of quantities that are no answer, but what is asked for."""


PARTLY = "Right for these numbers, but not for others: a number stands in it where a symbol belongs."


class Sheet:
    """The questions of a scenario's answer key, and answers to them.

    Args:
        path: The scenario.
        values: Other values than those of the file; see ``pinarm.load``.

    Raises:
        InputError: The scenario has no answer key.
    """

    def __init__(self, path: str | Path, values: Values | None = None) -> None:
        self._scenario: Scenario = load(path, values)
        self._key = [entry for entry in self._scenario.content.expect if entry.value is not None or entry.formula]
        if not self._key:
            raise InputError(f"{path} has no answer key", expected="a list 'expect', with values or formulas")

    @property
    def presentation(self) -> Presentation:
        """Units, labels and language of the scenario."""
        return self._scenario.content.presentation

    @property
    @in_language
    def questions(self) -> list[str]:
        """The questions, in words."""
        return [_question(self._result, entry) for entry in self._key]

    @in_language
    def check(self, number: int, answer: str | float) -> str:
        """Return the verdict on an answer, in words.

        Args:
            number: Number of the question, from 1.
            answer: A number with its unit, such as ``1.47 N*m``, or a formula of symbols, arguments and quantities;
                in French ``1,47 N*m`` too.

        Raises:
            InputError: There is no such question.
        """
        if not 1 <= number <= len(self._key):
            raise InputError(f"there is no question {number}", expected=f"1 to {len(self._key)}")
        text = str(answer).strip()
        if spoken() == "fr":  # arguments of functions have a space after their comma
            text = re.sub(r"(?<=\d),(?=\d)", ".", text)
        if not text or text == "...":
            return said("no answer yet")
        entry = self._key[number - 1]
        try:
            return self._judged(entry, text)
        except PinarmError as error:
            with suppress(PinarmError):
                if self._judged(entry, f"g*({text})") == said("Right."):
                    return said("Not right: {mistake}.", mistake=said("a mass stands where its weight belongs"))
            return said("This cannot be compared: {why}", why=told(error.message)) + (
                f" ({told(error.expected)})" if error.expected else ""
            )

    def explore(self, *names: str) -> Any:
        """Return sliders for the numbers of the model, and a plot that follows them.

        Args:
            names: Quantities to plot; the outputs of the scenario where none is given.

        Raises:
            InputError: ipywidgets is not installed.
        """
        try:
            import ipywidgets
        except ModuleNotFoundError:
            raise InputError("ipywidgets is not installed", hint="pip install 'pinarm[lab]'") from None
        from IPython.display import display

        def plotted(**numbers: float) -> None:
            try:
                display(self._changed(numbers).solve().plot(*names))  # type: ignore[no-untyped-call]
            except PinarmError as error:  # such as a mechanism that does not close with these lengths
                print(told(error.message))

        sliders = {name: ipywidgets.FloatSlider(**_slider(name, value)) for name, value in self._numbers.items()}
        return ipywidgets.interactive(plotted, **sliders)

    @cached_property
    def _result(self) -> Result:
        return self._scenario.solve()

    @property
    def _numbers(self) -> dict[str, float]:
        mechanism = self._scenario.mechanism
        return {name: mechanism.arguments[name] for name in mechanism.argument_units if mechanism.arguments.get(name)}

    def _changed(self, numbers: Mapping[str, float]) -> Scenario:
        units = self._scenario.mechanism.argument_units
        return self._scenario.varied(
            {f"arguments.{name}": f"{value!r} {units[name].si}" for name, value in numbers.items()}
        )

    def _judged(self, entry: Expectation, text: str) -> str:
        number = NUMBER_TEXT.fullmatch(text)
        is_number = number is not None
        if number is None:
            self._require_derived(entry, text)
        else:
            text = " ".join(filter(None, number.groups()))
        tolerance = NUMBER if is_number else FORMULA
        given: dict[str, Any] = {"value": text} if is_number else {"formula": text}
        answer = Expectation(quantity=entry.quantity, source="an answer", at=entry.at, rtol=tolerance, **given)
        quantities, series, _ = computed_rows(self._result, answer)
        values, _ = wanted_rows(quantities, answer, series.unit, 0.0)
        assert values is not None
        if compare(self._result, answer).ok:
            return self._generally(answer) if not is_number else said("Right.")

        def rows(run: Result) -> Array:
            return computed_rows(run, answer)[1].values

        mistake = likely_mistake(values, series.values, self._result, entry.quantity, rows, tolerance)
        return said("Not right: {mistake}.", mistake=mistake) if mistake else said("Not right.")

    def _require_derived(self, entry: Expectation, text: str) -> None:
        """Refuse a formula with the quantity that is asked for in it, or an effort, a force, an energy or a power."""
        symbols = self._scenario.mechanism.symbols
        names = Expression.parse(text).names
        asked = {entry.quantity, *Expression.parse(entry.quantity).names} - {*self._numbers}
        for name in names:
            meant = symbols[name].text if name in symbols else name
            if name in asked or any(word in COMPUTED for word in meant.split(".")):
                expected = "lengths, masses, coordinates and their rates"
                raise InputError(f"'{name}' is what the program computes", expected=expected)

    def _generally(self, answer: Expectation) -> str:
        """Return whether a formula that holds for the file's numbers does so for others."""
        random = np.random.default_rng(0)
        for _ in range(RANDOM):
            numbers = {name: value * (1.0 + random.uniform(-SPREAD, SPREAD)) for name, value in self._numbers.items()}
            try:
                run = self._changed(numbers).solve()
            except PinarmError:  # a loop may not close with these
                continue
            if not compare(run, answer).ok:
                return said(PARTLY)
        return said("Right.")


def _slider(name: str, value: float) -> dict[str, Any]:
    low, high = sorted((0.5 * value, 1.5 * value))
    settings = {"readout_format": ".4g", "continuous_update": False, "step": abs(value) / 50.0}
    return {"value": value, "min": low, "max": high, "description": name, **settings}


def _question(result: Result, entry: Expectation) -> str:
    unit = computed_rows(result, entry)[1].unit
    if entry.at == "all":
        place = ""
    elif isinstance(entry.at, dict):
        values = ", ".join(f"{told(name)} = {told(str(value))}" for name, value in entry.at.items())
        place = said(" at {values}", values=values)
    else:
        place = said(", {place} of the run", place=told(entry.at))
    wanted = "a formula, or a number if it is constant" if entry.at == "all" else "a number with its unit, or a formula"
    return f"{entry.quantity}{place}{said(': ')}{said(wanted)} [{unit or '1'}]"


def lab(path: str | Path, file: str | Path | None = None, values: Values | None = None) -> Path:
    """Write a notebook with the questions of a scenario's answer key left blank, and return its file.

    It has sliders for the numbers of the model, and a cell for each question that tells whether an answer is right and
    what kind of mistake it looks like. The key is not in it: right is what the scenario gives.

    Args:
        path: The scenario, beside the notebook for those who work on it.
        file: The notebook; ``NAME-lab.ipynb`` in the working folder where it is left out.
        values: Other values than those of the file; see ``pinarm.load``.

    Raises:
        InputError: The scenario has no answer key, or the file ends otherwise than in ``.ipynb``.
        PinarmError: It has a mistake, or cannot be solved.
    """
    target = Path(file) if file is not None else Path(f"{Path(path).stem}-lab.ipynb")
    if target.suffix != ".ipynb":
        raise InputError(f"'{target.name}' is no notebook", expected="a file that ends in .ipynb")
    sheet = Sheet(path, values)
    with document(sheet.presentation.lang):
        cells = _cells(sheet, Path(relpath(path, target.parent)).as_posix(), values)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(_notebook(cells), indent=1) + "\n", encoding="utf-8")
    return target


def _cells(sheet: Sheet, shown: str, values: Values | None) -> list[tuple[str, str]]:
    changed = dict(values) if isinstance(values, Mapping) else {}
    changed |= {"lang": spoken()} if spoken() != (sheet.presentation.lang or "en") else {}
    changes = f", {changed!r}" if changed else ""
    cells = [
        ("markdown", f"# {sheet._scenario.content.title or sheet._scenario.name}"),
        ("code", f'import pinarm\n\nsheet = pinarm.Sheet("{shown}"{changes})'),
    ]
    if sheet._numbers:
        words = said("Move the sliders: how do the results depend on the numbers of the model?")
        cells += [("markdown", words), ("code", "sheet.explore()")]
    for number, question in enumerate(sheet.questions, 1):
        heading = said("**Question {number}.** {question}", number=number, question=question)
        cells += [("markdown", heading), ("code", f'sheet.check({number}, "...")')]
    return cells


def _notebook(cells: list[tuple[str, str]]) -> dict[str, Any]:
    blank: dict[str, Any] = {"execution_count": None, "outputs": []}
    return {
        "cells": [
            {"cell_type": kind, "id": f"cell-{k}", "metadata": {}, "source": text.splitlines(keepends=True),
             **(blank if kind == "code" else {})}
            for k, (kind, text) in enumerate(cells)
        ],
        "metadata": {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }  # fmt: skip


GRAVITY = 9.81
"""Weight over mass that people calculate with [m/s^2]."""

FACTORS = {
    "the sign is the other one": -1.0,
    "it is twice as large: a factor of 2": 2.0,
    "it is half as large: a factor of 2": 0.5,
    "degrees stand where radians belong": 180.0 / math.pi,
    "radians stand where degrees belong": math.pi / 180.0,
    "a mass stands where its weight belongs": 1.0 / GRAVITY,
    "a weight stands where its mass belongs": GRAVITY,
    "revolutions stand where radians belong": 0.5 / math.pi,
    "radians stand where revolutions belong": 2.0 * math.pi,
    "it is a thousand times as large: a prefix of the unit": 1e3,
    "it is a thousandth: a prefix of the unit": 1e-3,
}
"""Mistake -> the answer over what is right."""

SIGN_IN, FACTOR_IN = "a wrong sign in these terms: {terms}", "a wrong factor in these terms: {terms}"

ROWS = 3
"""Rows from which on an answer that is wrong by a multiple of some terms is so by no chance."""

MASS, INERTIA = unit("kg").dimension, unit("kg*m^2").dimension

Rows = Callable[[Result], Array]
"""Values of the quantity that is asked for, where it is asked for."""


def likely_mistake(answer: Array, right: Array, result: Result, quantity: str, rows: Rows, tolerance: float) -> str:
    """Return the mistake that leads to an answer, in words; empty where none that is known does.

    Args:
        answer: The answer [SI], shape (n,) or (1,).
        right: What is right, shape (n,).
        result: The run that the quantity is asked of.
        quantity: The quantity.
        rows: Its values in another run of the scenario.
        tolerance: Largest difference that is none, relative to the largest value.
    """
    answer = np.broadcast_to(answer, right.shape)

    def meets(values: Array) -> bool:
        return bool(np.abs(answer - values).max() <= tolerance * np.abs(values).max())

    for words, factor in FACTORS.items():
        if meets(factor * right):
            return said(words)
    parts: list[tuple[str, Array]] = []
    for words, values, terms in _others(result, quantity, right, rows):
        if np.abs(values - right).max() > tolerance * np.abs(right).max():
            if meets(values) or meets(-values):
                return words if meets(values) else said("{mistake}, and the sign is the other one", mistake=words)
            parts += [(terms, right - values)] if terms else []
    for terms, part in parts if len(right) >= ROWS else ():
        share = float((answer - right) @ part / (part @ part))
        if meets(right + share * part):
            return said(SIGN_IN if abs(share + 2.0) < tolerance else FACTOR_IN, terms=terms)
    return ""


def _others(result: Result, quantity: str, right: Array, rows: Rows) -> Iterator[tuple[str, Array, str]]:
    """Yield values that mistakes lead to, of runs without terms, with these, and at other joints and points."""
    scenario = result.scenario
    for terms, words, changed in _without(scenario):
        with suppress(PinarmError):
            values = rows(changed().solve())
            if values.shape == right.shape:
                yield words, values, terms
                if terms == said("the weights"):
                    alone = said("what accelerations ask for is forgotten: these are the weights alone")
                    yield alone, right - values, said("accelerations")
    for other, words in _elsewhere(result, quantity):
        with suppress(PinarmError):
            yield words, result.quantities[other].values, ""


def _without(scenario: ScenarioRecord) -> Iterator[tuple[str, str, Callable[[], ScenarioRecord]]]:
    """Yield terms, the mistake to forget them, and the scenario in which the model does not have them."""
    mechanism = scenario.mechanism
    if mechanism.gravity:
        yield said("the weights"), said("the weights are forgotten"), lambda: scenario.varied({"gravity": "none"})
    yield said("moments of inertia"), said("moments of inertia are forgotten"), lambda: _of_points(scenario)
    for name, measured in mechanism.argument_units.items():
        if measured.dimension in (MASS, INERTIA) and mechanism.arguments.get(name):
            trace = {f"arguments.{name}": f"{1e-9 * mechanism.arguments[name]!r} {measured.si}"}
            yield name, said("{name} is forgotten", name=name), partial(scenario.varied, trace)


def _of_points(scenario: ScenarioRecord) -> ScenarioRecord:
    model = pin.Model(scenario.mechanism.model)
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        model.inertias[joint] = inertia(body.mass, body.lever, 1e-9 * body.inertia)
    return scenario.with_mechanism(scenario.mechanism.with_model(model))


def _elsewhere(result: Result, quantity: str) -> Iterator[tuple[str, str]]:
    """Yield formulas of the same at other joints, and of a joint's moment about other points."""
    mechanism = result.scenario.mechanism
    formula = mechanism.symbols[quantity].text if quantity in mechanism.symbols else quantity
    kind, _, rest = formula.partition(".")
    joint, _, word = rest.partition(".")
    if kind != "joint" or joint not in mechanism.joints:
        return
    for other in mechanism.joints:
        if other != joint:
            words = said("that is the {what} at the joint {joint}", what=said(word.split(".")[0]), joint=other)
            yield f"joint.{other}.{word}", words
    if not word.startswith(("effort", "moment")):
        return
    model, index = mechanism.model, mechanism.joints[joint].index
    own = next(
        (link for link in links_behind(model)[index] if model.frames[model.getFrameId(link)].placement.isIdentity()), ""
    )
    for link in links_of(model) if own else ():
        x, y = (f"(point.{own}.position.{axis} - point.{link}.position.{axis})" for axis in "xy")
        moment = f"joint.{joint}.moment.z + {x}*joint.{joint}.force.y - {y}*joint.{joint}.force.x"
        yield moment, said("that is the moment about {point}", point=link)
