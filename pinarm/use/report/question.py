"""Question of a scenario in words: known values, motions, loads, and quantities asked for."""

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
"""Key of a problem -> name of its rows; other rows have the key as their name."""

HEADS = ("law", "kind")
"""Keys of a kind: they come before the other keys."""

MOST = 180
"""Characters of a value; a law of many points is cut."""


def question(result: Result) -> ReportTable:
    """Return a table of the given values and the quantities asked for: kind, coordinate or name, value."""
    rows = [*_problem(result.data["problem"]), *_given(result), *_asked(result)]
    return ReportTable(["Given", "Of", "Value"], _once(rows), texts=range(3))


def words(value: Any) -> str:
    """Return a value of a file in words: ``{law: harmonic, mean: 1 rad}`` as ``harmonic: mean 1 rad``."""
    if isinstance(value, Mapping):
        head = [str(value[key]).replace("_", " ") for key in HEADS if key in value]
        rest = [f"{str(key).replace('_', ' ')} {_inner(entry)}" for key, entry in value.items() if key not in HEADS]
        return ": ".join(part for part in (" ".join(head), ", ".join(rest)) if part)
    if isinstance(value, list | tuple):
        return ", ".join(map(_inner, value))
    return str(value)


def _inner(value: Any) -> str:
    return f"({words(value)})" if isinstance(value, Mapping | list | tuple) else str(value)


def _problem(problem: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    for key, value in problem.items():
        label = LABELS.get(key, key.replace("_", " ").capitalize())
        if isinstance(value, Mapping) and any(isinstance(entry, Mapping) for entry in value.values()):
            yield from ((label, str(name), shortened(words(entry), MOST)) for name, entry in value.items())
        elif isinstance(value, Mapping):
            yield label, "", shortened(", ".join(f"{name} = {words(entry)}" for name, entry in value.items()), MOST)
        elif key != "kind":
            yield label, "", shortened(words(value), MOST)


def _given(result: Result) -> Iterator[tuple[str, str, str]]:
    """Yield arguments of the model, payloads, gravity, values to be found, and the wanted accuracy."""
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
    """Yield the quantities asked for: symbols with their formulas, then the others."""
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
