"""The question of a scenario in words: what is known, what is moved and held, what acts, and what is asked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pinarm.use.report.tables import ReportTable, number, shortened, unit_text

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result

LABELS = {
    "time": "Time", "motion": "Moves by a law", "over": "Varied", "hold": "Held", "drives": "Driven along",
    "start": "Assembled near", "starts": "Sought from", "initial": "Initial state", "velocity": "Velocity",
    "acceleration": "Acceleration", "loads": "Load", "events": "Event", "end_stops": "End stop",
}  # fmt: skip
"""Key of a problem -> what a row of it is called; any other is called by its key."""

HEADS = ("law", "kind")
"""Keys that say what something is: they stand before the rest of it."""

MOST = 180
"""Characters of a value; a law of many points is told by its beginning."""


def question(result: Result) -> ReportTable:
    """Return what is given and asked: a table of what it is, of which coordinate or name, and the value."""
    rows = [*_problem(result.data["problem"]), *_given(result), *_asked(result)]
    return ReportTable(["Given", "Of", "Value"], _once(rows), texts=range(3))


def words(value: Any) -> str:
    """Return a value of a file in words: ``{law: harmonic, mean: 1 rad}`` as ``harmonic: mean 1 rad``."""
    if isinstance(value, Mapping):
        head = [str(value[key]).replace("_", " ") for key in HEADS if key in value]
        rest = [f"{str(key).replace('_', ' ')} {_inner(each)}" for key, each in value.items() if key not in HEADS]
        return ": ".join(part for part in (" ".join(head), ", ".join(rest)) if part)
    if isinstance(value, list | tuple):
        return ", ".join(map(_inner, value))
    return str(value)


def _inner(value: Any) -> str:
    return f"({words(value)})" if isinstance(value, Mapping | list | tuple) else str(value)


def _problem(problem: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    for key, value in problem.items():
        label = LABELS.get(key, key.replace("_", " ").capitalize())
        if isinstance(value, Mapping) and any(isinstance(each, Mapping) for each in value.values()):
            yield from ((label, str(name), shortened(words(each), MOST)) for name, each in value.items())
        elif isinstance(value, Mapping):
            yield label, "", shortened(", ".join(f"{name} = {words(each)}" for name, each in value.items()), MOST)
        elif key != "kind":
            yield label, "", shortened(words(value), MOST)


def _given(result: Result) -> Iterator[tuple[str, str, str]]:
    """Yield arguments of the model, payloads, gravity, what is sought, and the accuracy that is wanted."""
    mechanism, content = result.trajectory.mechanism, result.content
    if mechanism.arguments:
        yield "Parameters", "", ", ".join(_argument(mechanism, name) for name in mechanism.arguments)
    for name, payload in mechanism.payloads.items():
        yield "Payload", name, f"{number(float(payload.mass))} kg at {payload.point}"
    gravity = mechanism.model.gravity.linear
    yield "Gravity", "", f"({', '.join(number(x) for x in gravity)}) m/s²" if gravity.any() else "none"
    for key in ("changes", "find", *result.content.assessments):
        if key in result.data:
            yield key.capitalize(), "", shortened(words(result.data[key]), MOST)
    if content.accuracy.target is not None:
        yield "Accuracy wanted", "", f"global error below {content.accuracy.target:g} of the largest value"


def _argument(mechanism: Mechanism, name: str) -> str:
    unit = mechanism.argument_units.get(name)
    return f"{name} = {number(mechanism.arguments[name])} {unit_text(unit) if unit else ''}".rstrip()


def _asked(result: Result) -> Iterator[tuple[str, str, str]]:
    """Yield the quantities that are asked for: symbols with what they stand for, then the others."""
    formulas = {**result.trajectory.mechanism.description.symbols, **result.content.symbols}
    outputs = list(dict.fromkeys(result.content.outputs))
    yield from (("Asked for", name, shortened(formulas[name], MOST)) for name in outputs if name in formulas)
    others = [*(name for name in outputs if name not in formulas), *result.content.numbers]
    if others:
        yield "Asked for", "", ", ".join(others)


def _once(rows: list[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """Return rows whose first cell is empty where it repeats the one above."""
    above = ["", *(row[0] for row in rows)]
    return [(label if label != before else "", name, value)
            for (label, name, value), before in zip(rows, above, strict=False)]  # fmt: skip
