"""Problem statement of a report: the question in words, the mechanism in tables, and its graph of links."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.series import Series
from pinarm.language import decimals, said
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.use.show.document import ReportTable, number, shortened, text, unit_text
from pinarm.use.show.mechanism_tables import body_name

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
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
        return _listed(_inner(entry, word) for entry in value)
    return decimals(str(value))


def _inner(value: Any, word: Callable[[str], str]) -> str:
    if not isinstance(value, Mapping | list | tuple):
        return decimals(str(value))
    return f"({_words(value, word)})" if value else ""


def _listed(words: Iterable[str]) -> str:
    """Return words with commas between them, or semicolons where numbers have a comma."""
    return said(", ").join(words)


def problem_rows(problem: Mapping[str, Any]) -> Iterator[Row]:
    """Yield the entries of a problem: kind, coordinate or name, and value in words; laws with all their points."""
    for key, value in problem.items():
        label = said(LABELS.get(key, key.replace("_", " ").capitalize()))
        if isinstance(value, Mapping) and any(isinstance(entry, Mapping) for entry in value.values()):
            yield from ((label, str(name), _words(entry)) for name, entry in value.items())
        elif isinstance(value, Mapping):
            word = said if key == "time" else str  # else they are names of coordinates
            yield label, "", _listed(f"{word(name)} = {_words(entry)}" for name, entry in value.items())
        elif key != "kind":
            yield label, "", _words(value)


def _given(result: Result) -> Iterator[Row]:
    """Yield arguments of the model, payloads, gravity, values to be found, and the wanted accuracy."""
    mechanism, content = result.trajectory.mechanism, result.content
    if mechanism.arguments:
        yield said("Parameters"), "", _listed(_argument(result, name, x) for name, x in mechanism.arguments.items())
    for name, payload in mechanism.payloads.items():
        yield said("Payload"), name, said("{mass} kg at {point}", mass=number(float(payload.mass)), point=payload.point)
    gravity = mechanism.model.gravity.linear
    yield said("Gravity"), "", f"({_listed(number(x) for x in gravity)}) m/s²" if gravity.any() else said("none")
    for key in ("changes", "find", *content.assessments):
        if key in result.data:
            yield said(key.capitalize()), "", _words(result.data[key], str if key == "changes" else said)
    if content.accuracy.target is not None:
        bound = said("global error below {target:g} of the largest value", target=content.accuracy.target)
        yield said("Accuracy wanted"), "", bound


def _argument(result: Result, name: str, value: float) -> str:
    """Return a number of the model in the units of the run."""
    unit = result.trajectory.mechanism.argument_units.get(name)
    shown = result.presentation.shown(Series(name, unit, np.array([value])))
    return f"{name} = {number(shown.values[0])} {unit_text(shown.unit) if shown.unit else ''}".rstrip()


def _asked(result: Result) -> Iterator[Row]:
    """Yield the quantities asked for: symbols with their formulas, then the others."""
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


COLUMN, ROW, WIDE, HIGH, MARGIN = 150.0, 54.0, 104.0, 22.0, 6.0
"""Distances between boxes, their size, and the margin [px]."""

BESIDE, FARTHER = 34.0, 26.0
"""Distance of the line of a loop joint from the boxes, and distance to the line of the next joint [px]."""

MOST_BODIES = 26
"""Bodies of a graph that fits on a page."""

MOST_LETTERS = 17
"""Letters of a name in a box."""

Places = list[tuple[float, float]]


def link_graph(mechanism: Mechanism) -> str:
    """Return the graph of a mechanism; nothing where it has too many bodies for a page."""
    model = mechanism.model
    if not 1 < model.njoints <= MOST_BODIES:
        return ""
    places = _places(model)
    closing = [joint for joint in mechanism.constraints if isinstance(joint, LoopJoint)]
    right = max(x for x, _ in places) + WIDE / 2
    drawn = [_loop(model, places, joint, right + BESIDE + FARTHER * k) for k, joint in enumerate(closing)]
    drawn += [_joint(model, places, index) for index in range(1, model.njoints)]
    drawn += [_box(body_name(model, index), *places[index], frame=not index) for index in range(model.njoints)]
    width = right + (BESIDE + FARTHER * len(closing) + 5.5 * MOST_LETTERS if closing else COLUMN - WIDE + MARGIN)
    height = max(y for _, y in places) + HIGH / 2 + MARGIN
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    return f'<svg class="links" role="img" aria-label="{text(said("Graph of links"))}" {size}>{"".join(drawn)}</svg>'


def _places(model: pin.Model) -> Places:
    """Return the centres of the boxes: by their distance from the frame, each above the middle of those it carries."""
    carried: list[list[int]] = [[] for _ in range(model.njoints)]
    depth = [0] * model.njoints
    for index in range(1, model.njoints):
        carried[model.parents[index]].append(index)
        depth[index] = depth[model.parents[index]] + 1
    column, leaves, left = [0.0] * model.njoints, 0, [0]
    while left:  # bodies that carry none, from left to right
        index = left.pop()
        if not carried[index]:
            column[index], leaves = float(leaves), leaves + 1
        left += reversed(carried[index])
    for index in reversed(range(model.njoints)):
        if carried[index]:
            column[index] = sum(column[k] for k in carried[index]) / len(carried[index])
    across, down = MARGIN + WIDE / 2, MARGIN + HIGH / 2
    return [(across + COLUMN * x, down + ROW * y) for x, y in zip(column, depth, strict=True)]


def _text(kind: str, x: float, y: float, name: str) -> str:
    middle = ' text-anchor="middle"' if kind == "box" else ""
    return f'<text class="{kind}"{middle} x="{x}" y="{y}">{text(shortened(name, MOST_LETTERS))}</text>'


def _box(name: str, x: float, y: float, *, frame: bool) -> str:
    kind = ' class="frame"' if frame else ""
    place = f'x="{x - WIDE / 2}" y="{y - HIGH / 2}" width="{WIDE}" height="{HIGH}"'
    return f'<rect {place} rx="3"{kind}/>{_text("box", x, y + 3.5, name)}'


def _joint(model: pin.Model, places: Places, index: int) -> str:
    (x, y), (u, w) = places[model.parents[index]], places[index]
    line = f'<line x1="{x}" y1="{y + HIGH / 2}" x2="{u}" y2="{w - HIGH / 2}"/>'
    return line + _text("joint", u + 5, w - HIGH / 2 - 7, model.names[index])


def _loop(model: pin.Model, places: Places, closing: LoopJoint, right: float) -> str:
    """Return the line of a loop joint: from the side of one box around all others to that of the other."""
    (x, y), (u, w) = (places[model.frames[frame].parentJoint] for frame in (closing.first, closing.second))
    start, end = x + WIDE / 2, u + WIDE / 2
    path = f"M{start:.1f} {y + 5:.1f} C{right:.1f} {y + 5:.1f} {right:.1f} {w - 5:.1f} {end:.1f} {w - 5:.1f}"
    return f'<path d="{path}"/>' + _text("loop", (start + 6 * right + end) / 8 + 3, (y + w) / 2 + 3, closing.name)
