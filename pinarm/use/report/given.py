"""Problem statement of a report: the given values, the quantities asked for, and the mobility in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.engine.series import Series
from pinarm.language import decimals, said
from pinarm.use.show.text import ReportTable, number, shortened, unit_text

if TYPE_CHECKING:
    from pinarm.use.facade import Result

LABELS = {
    "time": "Time",
    "motion": "Moves by a law",
    "over": "Varied",
    "hold": "Held",
    "drives": "Driven along",
    "start": "Assembled near",
    "starts": "Sought from",
    "initial": "Initial state",
    "loads": "Load",
    "events": "Event",
    "end_stops": "End stop",
}
"""Key of a problem -> name of its rows; other rows have the key as their name."""

HEADS = ("law", "kind")
"""Keys of a kind: they come before the other keys."""

Row = tuple[str, str, str]


def question(result: Result) -> ReportTable:
    """Return a table of the given values and the quantities asked for: kind, coordinate or name, value."""
    rows = [*problem_rows(result.data["problem"]), *_given(result), *_asked(result)]
    above = ["", *(row[0] for row in rows)]  # a label that repeats the one above is left out
    cells = [("" if row[0] == before else row[0], *row[1:]) for row, before in zip(rows, above, strict=False)]
    return ReportTable([said("Given"), said("Of"), said("Value")], cells, range(3))


def _words(value: Any, word: Callable[[str], str] = said) -> str:
    """Return a value of a file in words: ``{law: harmonic, mean: 1 rad}`` as ``harmonic: mean 1 rad``.

    Args:
        value: The value.
        word: Translates its keys; ``str`` where these are names.
    """
    if isinstance(value, Mapping):
        head = " ".join(word(str(value[key]).replace("_", " ")) for key in HEADS if key in value)
        rest = [f"{word(str(key).replace('_', ' '))} {_inner(entry, word)}".rstrip()
                for key, entry in value.items() if key not in HEADS]  # fmt: skip
        return said(": ").join(filter(None, (head, ", ".join(rest))))
    if isinstance(value, list | tuple):
        return said(", ").join(_inner(entry, word) for entry in value)
    return decimals(str(value))


def _inner(value: Any, word: Callable[[str], str]) -> str:
    if not isinstance(value, Mapping | list | tuple):
        return decimals(str(value))
    return f"({_words(value, word)})" if value else ""


def problem_rows(problem: Mapping[str, Any]) -> Iterator[Row]:
    """Yield the entries of a problem: kind, coordinate or name, and value in words; laws with all their points."""
    for key, value in problem.items():
        label = said(LABELS.get(key, key.replace("_", " ").capitalize()))
        if isinstance(value, Mapping) and any(isinstance(entry, Mapping) for entry in value.values()):
            yield from ((label, str(name), _words(entry)) for name, entry in value.items())
        elif isinstance(value, Mapping):
            word = said if key == "time" else str  # else they are names of coordinates
            yield label, "", said(", ").join(f"{word(name)} = {_words(entry)}" for name, entry in value.items())
        elif key != "kind":
            yield label, "", _words(value)


def _given(result: Result) -> Iterator[Row]:
    mechanism, content = result.trajectory.mechanism, result.content
    if mechanism.arguments:
        arguments = (_argument(result, name, x) for name, x in mechanism.arguments.items())
        yield said("Parameters"), "", said(", ").join(arguments)
    for name, payload in mechanism.payloads.items():
        yield said("Payload"), name, said("{mass} kg at {point}", mass=number(float(payload.mass)), point=payload.point)
    gravity = mechanism.model.gravity.linear
    components = said(", ").join(map(number, gravity.tolist()))
    yield said("Gravity"), "", f"({components}) m/s²" if gravity.any() else said("none")
    for key in ("changes", "find", *content.assessments):
        if key in result.data:
            yield said(key.capitalize()), "", _words(result.data[key], str if key == "changes" else said)
    if content.accuracy.target is not None:
        bound = said("global error below {target:g} of the largest value", target=content.accuracy.target)
        yield said("Accuracy wanted"), "", bound


def _argument(result: Result, name: str, value: float) -> str:
    unit = result.trajectory.mechanism.argument_units.get(name)
    shown = result.presentation.shown(Series(name, unit, np.array([value])))
    return f"{name} = {number(shown.values[0])} {unit_text(shown.unit) if shown.unit else ''}".rstrip()


def _asked(result: Result) -> Iterator[Row]:
    formulas = {**result.trajectory.mechanism.description.symbols, **result.content.symbols}
    outputs = list(dict.fromkeys(result.content.outputs))
    yield from ((said("Asked for"), name, formulas[name]) for name in outputs if name in formulas)
    others = [*(name for name in outputs if name not in formulas), *result.content.numbers]
    if others:
        yield said("Asked for"), "", ", ".join(others)


def mobility_words(result: Result) -> str:
    """Return in a sentence how the mechanism can move where its run begins, and how it is tied."""
    mobility = mobility_of(result.trajectory.mechanism, result.trajectory.q[0])
    counts = {key: getattr(mobility, key) for key in ("mobility", "joints", "rank", "rows", "degree")}
    if not mobility.rows:
        return said("Mobility {mobility}: {joints} joint coordinates, no loop.", **counts)
    tied = said("Mobility {mobility}: {joints} joint coordinates, {rank} independent of {rows} rows of constraints",
                **counts)  # fmt: skip
    if not mobility.degree:
        return said("{tied}; isostatic.", tied=tied)
    undetermined = shortened(", ".join(mobility.undetermined), 200)
    words = "{tied}; hyperstatic of degree {degree}: rigid bodies do not determine all reactions of {undetermined}."
    return said(words, tied=tied, undetermined=undetermined, **counts)
