"""Likely mistake behind a wrong answer: a factor, a term that is left out, another joint or point."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import PinarmError
from pinarm.input.units import unit
from pinarm.language import said
from pinarm.mechanics.joints import links_behind, links_of
from pinarm.mechanics.loading.model_tree import inertia
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario

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


def _without(scenario: Scenario) -> Iterator[tuple[str, str, Callable[[], Scenario]]]:
    """Yield terms, the mistake to forget them, and the scenario in which the model does not have them."""
    mechanism = scenario.mechanism
    if mechanism.gravity:
        yield said("the weights"), said("the weights are forgotten"), lambda: scenario.varied({"gravity": "none"})
    yield said("moments of inertia"), said("moments of inertia are forgotten"), lambda: _of_points(scenario)
    for name, measured in mechanism.argument_units.items():
        if measured.dimension in (MASS, INERTIA) and mechanism.arguments.get(name):
            trace = {f"arguments.{name}": f"{1e-9 * mechanism.arguments[name]!r} {measured.si}"}
            yield name, said("{name} is forgotten", name=name), partial(scenario.varied, trace)


def _of_points(scenario: Scenario) -> Scenario:
    """Return a scenario whose bodies are masses at their centres, but for a trace of inertia."""
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
