"""Chapter of a report on one result: question, answers, mechanism, curves, sections, accuracy and provenance."""

from __future__ import annotations

import platform
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from msgspec import field

from pinarm.arrays import Array
from pinarm.engine.constraints.self_stresses import joint_kind, mobility_of
from pinarm.engine.series import Series
from pinarm.errors import PinarmError
from pinarm.input.units import unit
from pinarm.language import Language, decimals, in_language, said, spoken, told
from pinarm.mechanics.joints import links_behind, links_of, moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.problems import KINDS
from pinarm.records import ValueRecord, replace
from pinarm.use.method.actions import bodies_of
from pinarm.use.method.torsors import LETTERS, Torsor, torsor
from pinarm.use.result.measures import CLOSURES, COSTS, MEASURES, PATHS, RESIDUALS, SOLVED
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.drawings import free_body_diagrams, sketch, worst_instants
from pinarm.use.show.picture import graph, plot
from pinarm.use.show.structure import link_graph, mechanism_tables
from pinarm.use.show.text import (
    FEW,
    ReportTable,
    accuracy_lines,
    counted,
    error_lines,
    figure,
    frame,
    number,
    part,
    ranges,
    rounded,
    sentences,
    shortened,
    tag,
    text,
    unit_text,
    with_unit,
)
from pinarm.use.study.answers.check import HEADING, finding_of
from pinarm.use.study.answers.check import remarks as verdict_remarks
from pinarm.use.study.answers.check import rows as verdict_rows

if TYPE_CHECKING:
    from pinarm.use.facade import Result
    from pinarm.use.result.section import Section, SectionTable
    from pinarm.use.show.picture import Picture

CURVES = 2
"""Quantities a picture: a page holds two pictures, and little room is lost where one does not fit."""

MOST_ROWS = 60
"""Rows of a section's first table that are printed; the file beside the result has all."""

FEW_ROWS = 24
"""Rows of its further tables, in the appendix."""

TITLE = "Static torsors of the joints"
REMARK = (
    "Action of the first body on the second, at the joint's own point, in the axes of the second; least and greatest "
    "value of the run. 0: the joint does not transmit it, or it is 0 but for rounding. Along a driven axis stands the "
    "effort of the drive."
)

MOST_JOINTS = 40
"""Joints of a table that a person reads."""

MOST_BODIES = 26
"""Bodies of a graph of links that fits on a page."""

REPLAY_HEIGHT = 420
"""Of the moving picture [px]."""


class Chapter(ValueRecord, frozen=True):
    """A chapter on one result: title, subtitle, all that is below these as HTML, and its language."""

    title: str
    subtitle: str
    body: str
    language: Language = field(default_factory=spoken)


def keyless(result: Result) -> Result:
    """Return a result without its answer key: nothing of ``expect`` is printed or drawn."""
    content = msgspec.structs.replace(result.content, expect=[])
    return replace(result, scenario=replace(result.scenario, content=content), known=result.sections)


@in_language
def chapter_on(
    result: Result, folder: Path | None, date: str, *, moving: bool, student: bool = False, equations: bool = False
) -> Chapter:
    """Return the chapter on a result.

    Args:
        result: The result.
        folder: The folder that it was read from, which tells the versions that solved it.
        date: When the report is made.
        moving: Whether the replay is wanted, which paper does not show.
        student: Whether the torsors of joints are among the answers, not in the appendix.
        equations: Whether the equations of the mechanism are in it.

    Raises:
        PinarmError: The motion of a saved result cannot be solved again, which numbers between its rows need.
    """
    mechanism = result.trajectory.mechanism
    sections = list(result.shown_sections.values())
    limits = [said("Limit: {excess}.", excess=told(excess.words(result.trajectory))) for excess in result.excesses()]
    replay, unshown = _replay(result) if moving else ("", [])
    verdicts, missed = _verdicts(result)
    asked, worst = KINDS[result.kind].question if result.kind in KINDS else "", worst_instants(result)
    own, torsors = _names(result), _joint_torsors(result)
    links = figure(link_graph(mechanism)) if 1 < mechanism.model.njoints <= MOST_BODIES else ""
    tables, along = mechanism_tables(mechanism, result.presentation), result.trajectory.parameter
    left_out = ReportTable([said("Joint"), said("how"), said("why")],
                           [(x.joint, told(x.how), told(x.why)) for x in result.removals], range(3))  # fmt: skip
    parts = [
        sentences([*_warnings(result), *missed, *limits], "box warnings"),
        sentences(_merits(result, verdicts, missed), "box merits"),
        part("Question", tag("p", text(told(asked)), "asked"), question(result)),
        part("Answers", _ranges(result), _numbers(result), _findings(result)),
        part("Actions in the joints", torsors) if student else "",
        part("Mechanism", figure(sketch(result, titled=False), "sketch"), tag("p", text(mobility_words(result)))),
        part("Equations in letters", *_equations(result, folder)) if equations else "",
        part("Motion and curves", replay, *map(figure, _curves(result))),
        *(_part(section, result.presentation, own) for section in sections),
        part("Free-body diagrams", *(figure(free_body_diagrams(result, at, titled=False)) for at in worst.values())),
        part("Comparison with independent and published values", verdicts),
        part("Accuracy", sentences(error_lines(result)), sentences(accuracy_lines(result.figures, along))),
        part("What was left out, and notes", left_out, sentences([*counted(result.notes()), *unshown])),
        appendix(
            part("Mechanism in numbers", links, *tables),
            *(part(x.title, *(_section_table(y, x.key, own, FEW_ROWS) for y in x.tables[1:])) for x in sections),
            "" if student else part("Actions in the joints", torsors),
            part("Measures of accuracy", _accuracy(result)),
            part("Provenance", _provenance(result, folder, date)),
        ),
    ]
    title, subtitle = result.content.title or result.name, f"{mechanism.title}, {told(result.kind)}"
    return Chapter(title, subtitle, "\n".join(filter(None, parts)))


def _equations(result: Result, folder: Path | None) -> Iterator[ReportTable | str]:
    """Yield the equations below their headings, what their symbols are, and how they were proved.

    A folder has the numbers of the model; its scenario leads to the file with the letters, while this is there.
    """
    from pinarm.use.study.explain import equations

    scenario: Any = result.scenario
    try:
        lettered = equations(folder / "scenario.yaml" if folder else scenario)
    except PinarmError:
        lettered = equations(scenario)
    for heading, equations_of in lettered.parts():
        yield tag("p", text(said(heading)))
        for equation in equations_of:
            yield tag(
                "p", f"{text(told(equation.of))}{text(said(': '))}{decimals(lettered.mathml(equation))}", "equation"
            )
    meanings = [(symbol, told(words)) for symbol, words in lettered.symbols.items()]
    yield ReportTable([said("symbol"), said("meaning")], meanings, range(2))
    yield sentences([str(lettered).rpartition("\n")[2]])


def appendix(*parts: str) -> str:
    """Return the appendix of a chapter from its parts, as HTML."""
    inner = "\n".join(filter(None, parts)).replace("h3>", "h4>")
    return tag("section", f"{tag('h3', said('Appendix'))}\n{inner}", "appendix")


def _warnings(result: Result) -> list[str]:
    target = result.content.accuracy.target
    reasons = (
        [said("The error of these numbers has no bound: {why}.", why=told(result.no_bound))] if result.no_bound else []
    )
    if result.missed:
        reasons.append(said("The accuracy that was wanted, {target:g}, is not reached.", target=target))
    if result.error is None and "evaluations" in result.figures:
        reasons.append("The global error of this motion was not estimated; the residuals below do not bound it.")
    return reasons


def _merits(result: Result, verdicts: ReportTable, missed: Sequence[str]) -> Iterator[str]:
    if result.error is not None and isfinite(result.error) and not result.no_bound:
        yield said("The global error of all outputs is below {error:.1e} of their largest values, in 99 of 100 cases.",
                   error=result.error)  # fmt: skip
    if verdicts.rows and not missed:
        yield said("All {count} entries of the answer key are met.", count=len(verdicts.rows))


def _ranges(result: Result) -> ReportTable:
    """Return the ranges of the outputs, as the terminal shows them, with the bound of each one's error."""
    (_, _, *columns), *rows = ranges(result, rounded)
    run, remark = result.trajectory, ""
    headings = [said("Quantity") if run.numbered else said("Quantity, at {count} rows", count=len(run)), said("unit")]
    along = said("at {place}", place=run.parameter)
    headings += [with_unit(name, run.unit) if name == along else name for name in columns]
    cells = [[name, unit_text(unit), *numbers] for name, unit, *numbers in rows]
    if result.errors:
        headings.append(said("error"))
        bounds = [result.errors.get(series.name) for series in result.columns()[1:]]
        cells = [[*row, _bound(bound)] for row, bound in zip(cells, bounds, strict=True)]
        remark = said(
            "error: bound of the global error relative to the largest value of the quantity, in 99 of 100 cases"
        )
    return ReportTable(headings, cells, range(2), remark=remark)


def _bound(error: float | None) -> str:
    return "" if error is None else f"{error:.1e}" if isfinite(error) else said("unknown")


def _numbers(result: Result) -> ReportTable:
    rows = []
    for name, (series, error) in result.numbers().items():
        shown, (scale, _) = result.presentation.shown(series), result.presentation.scale(series)
        bound = result.number_errors.get(series.name)
        bounds = [_bound(bound and bound * scale)] if result.errors else []
        value = [unit_text(shown.unit), rounded(float(shown.values[0])), f"{error * scale:.1e}" if error else "0"]
        rows.append([name, *value, *bounds])
    errors = [said("quadrature error"), *([said("error below, in 99 of 100 cases")] if result.errors else ())]
    return ReportTable([said("Number of the run"), said("unit"), said("value"), *errors], rows, range(2))


def _findings(result: Result) -> ReportTable:
    rows = [[name, f"{value:.9g}"] for name, value in result.figures.items() if name not in (*MEASURES, *COSTS)]
    return ReportTable([said("Found"), said("value")], rows)


def _curves(result: Result) -> Iterator[Picture]:
    """Yield the outputs over the parameter, a few to a picture; nothing where the answers show every row."""
    if len(result) < 2 or (result.trajectory.numbered and len(result) <= FEW):
        return
    names = [series.name for series in result.columns()[1:]]
    for first in range(0, len(names), CURVES):
        yield plot(result, tuple(names[first : first + CURVES]), titled=False)


def _part(section: Section, how: Presentation, own: Container[str]) -> str:
    tables = [_section_table(table, section.key, own) for table in section.tables]
    printed = {cell for table in tables for row in table.rows for cell in row}
    numbers = {name: how.shown(series) for name, series in section.numbers.items()}
    rows = [[name, unit_text(series.unit), rounded(float(series.values[0]))] for name, series in numbers.items()]
    rows = [row for row in rows if row[2] not in printed]
    more = ReportTable([said("Number"), said("unit"), said("value")], rows, range(2))
    return part(
        section.title, more, *tables[:1], sentences(section.remarks), *(figure(graph(x, how)) for x in section.graphs)
    )


def _section_table(table: SectionTable, key: str, own: Container[str], most: int = MOST_ROWS) -> ReportTable:
    """Return a table of a section; ``own`` are names of the user, which are no words."""
    cleared = table.cleared().rows[:most]
    rows = [[_word(cell, own) for cell in row] for row in cleared]
    if table.row_unit is not None:
        for row in rows:
            row[table.row_unit] = unit_text(row[table.row_unit])
    texts = {k for row in table.rows for k, cell in enumerate(row) if isinstance(cell, str) and cell}
    more = len(table.rows) - most
    remark = said("and {more} more rows in {file}", more=more, file=f"{key}_{table.name}.csv") if more > 0 else ""
    headings = zip(table.columns, table.units, strict=True)
    named = [told(name) if unit is None else with_unit(told(name), unit) for name, unit in headings]
    return ReportTable(named, rows, texts, table.title, remark)


def _word(cell: str | float, own: Container[str]) -> str:
    if not isinstance(cell, str):
        return rounded(cell)
    return cell if cell in own else told(cell)


def _names(result: Result) -> set[str]:
    """Return the names that a user gave to parts of a mechanism and to quantities."""
    mechanism, content = result.trajectory.mechanism, result.content
    named = (mechanism.joints, mechanism.balls, mechanism.coordinates, mechanism.drives, mechanism.forces,
             mechanism.symbols, mechanism.arguments, content.symbols, content.outputs)  # fmt: skip
    parts = [*links_of(mechanism.model), *(constraint.name for constraint in mechanism.constraints)]
    return {name for names in (*named, parts) for name in names}


def _verdicts(result: Result) -> tuple[ReportTable, list[str]]:
    """Return the answer key, compared, and the misses in it, a sentence each."""
    heading = list(map(said, ("Verdict", "quantity", *HEADING[4:], "source")))
    if not result.content.expect:
        return ReportTable(heading, []), []
    findings, rows = [finding_of(result, expectation) for expectation in result.content.expect], []
    for (verdict, _, quantity, at, *rest), finding in zip(verdict_rows(findings), findings, strict=True):
        name = quantity if at == "all rows" else f"{quantity} @ {at}"
        rest = list(map(decimals, rest))
        rows.append([told(verdict), name, *rest, finding.expectation.source])
    *misses, counts = verdict_remarks(findings)
    counted = ", ".join(map(told, counts.split("; ")))
    remark = said("{counts}. Of many rows, the one that is farthest off is shown; the difference is relative.",
                  counts=counted)  # fmt: skip
    return ReportTable(heading, rows, range(len(heading)), remark=remark), misses


def _joint_torsors(result: Result) -> ReportTable:
    """Return the table of the static torsors; without rows where the run has no efforts."""
    letters, *units = LETTERS["static"]
    scales = [result.presentation.scale(Series("", unit(each), np.zeros(0))) for each in units]
    headings = [said("Joint"), said("first body"), said("second body"), said("kind")]
    headings += [with_unit(letter, scales[k // 3][1]) for k, letter in enumerate(letters)]
    torsors = [*_torsors(result)] if not result.trajectory.no_efforts else []
    largest = max((_largest(acting.resultant) for *_, acting in torsors), default=0.0)
    rows = [[*words, *(_range(acting, k, scales[k // 3][0], largest) for k in range(6))] for *words, acting in torsors]
    return ReportTable(headings, rows, range(4), TITLE, REMARK)


def _torsors(result: Result) -> Iterator[tuple[str, str, str, str, Torsor]]:
    mechanism, model = result.trajectory.mechanism, result.trajectory.mechanism.model
    carrying = [k for k in bodies_of(mechanism) if links_behind(model)[k]]  # of a floating joint the last part does
    ties = [(str(model.names[k]), joint_kind(model, k), int(model.parents[k]), k) for k in carrying]
    for constraint in mechanism.constraints:
        if isinstance(constraint, LoopJoint):
            first, second = (int(model.frames[frame].parentJoint) for frame in (constraint.first, constraint.second))
            ties.append((constraint.name, constraint.kind, first, second))
    for name, kind, *bodies in ties[:MOST_JOINTS]:
        before, after = (moved_links(model, body)[0] if body else "" for body in bodies)
        acting = torsor(result, name, "", after, "static")
        yield name, before or said("ground"), after or said("ground"), said(kind), acting


def _largest(values: Array) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


def _range(acting: Torsor, k: int, scale: float, largest: float) -> str:
    """Return the range of a component, one number where it is constant; 0 where the joint does not transmit it.

    Args:
        acting: The torsor.
        k: The component.
        scale: From SI to the unit of the table.
        largest: Largest force in any joint [N].
    """
    if acting.shape[k] == "0":
        return "0"
    if acting.undetermined[k]:
        return said("undetermined")
    values, size = acting.components[:, k], largest * (acting.extent if k >= 3 else 1.0)
    values = np.where(np.abs(values) > SOLVED * max(size, _largest(values)), values * scale, 0.0)
    least, greatest = rounded(float(values.min())), rounded(float(values.max()))
    return least if least == greatest else f"{least} … {greatest}"


def _accuracy(result: Result) -> ReportTable:
    few, rows = {**RESIDUALS, **CLOSURES, **PATHS}, []
    for name, value in result.figures.items():
        if name in MEASURES:
            rows.append([said(name), decimals(f"{value:.1e}" if name in few else f"{value:.6g}"), said(MEASURES[name])])
    rows += [[said(name), f"{value:.0f}", said("cost")] for name, value in result.figures.items() if name in COSTS]
    return ReportTable([said("Figure"), said("value"), said("meaning")], rows, range(3))


def _provenance(result: Result, folder: Path | None, date: str) -> str:
    """Return scenario, versions and digest of a result, those of a saved one as its folder has them; not this host."""
    summary = msgspec.json.decode((folder / "summary.json").read_bytes()) if folder else result.summary()
    versions = ", ".join(f"{name} {version}" for name, version in dict(summary.get("versions", {})).items())
    entries = {
        said("Scenario"): said("{name}, {count} rows", name=result.name, count=len(result)),
        said("Solved with"): versions,
        said("SHA-256 of the input"): str(summary.get("input", "")),
    }
    return provenance(entries, date)


def provenance(entries: Mapping[str, str], date: str) -> str:
    """Return the origin of a result, and version, host and date of the report, as HTML."""
    host = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    made = said(
        "pinarm {version}, on {host}, {date}", version=import_module("pinarm").__version__, host=host, date=date
    )
    entries = {**entries, said("Report made with"): made}
    return tag("dl", "\n".join(tag("dt", text(term)) + tag("dd", text(words)) for term, words in entries.items()))


def _replay(result: Result) -> tuple[str, list[str]]:
    """Return the replay in a frame and nothing, or nothing and why there is none."""
    try:
        page = result.replay(plots=()).html
    except PinarmError as error:
        return "", [said("no replay: {why}", why=error.message)]
    return tag("div", frame(page, height=REPLAY_HEIGHT), "replay"), []


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
