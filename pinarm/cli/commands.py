"""The commands: what each does, its options, and examples of it."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from pinarm.cli.options import (
    DPI,
    LANG,
    PATH,
    PLOTS,
    SCENARIO,
    VALUES,
    Option,
    arg,
    either,
    flag,
    keys,
    names,
    output,
    progress,
    sources,
    workers,
)
from pinarm.errors import InputError, NumericsError, PinarmError, choices

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pinarm.use.facade import Scenario
    from pinarm.use.output import Destination

T = TypeVar("T")

OK, MISSED, BAD_INPUT = 0, 1, 2


class Answer(NamedTuple):
    """Answer of a command: data for machines, text, exit code, and mistakes in some of its files."""

    data: Mapping[str, object]
    text: str
    code: int = OK
    mistakes: Sequence[PinarmError] = ()


class Command(NamedTuple):
    """A command: what runs it, what it does, options, examples with semicolons between."""

    call: Callable[[Namespace], Answer]
    text: str
    options: Sequence[Option]
    examples: str


COMMANDS: dict[str, Command] = {}
"""Commands by name."""

Call = Callable[[Namespace], Answer]


def command(text: str, examples: str, *options: Option) -> Callable[[Call], Call]:
    """Declare a function, named after the command, as a command."""

    def declare(call: Call) -> Call:
        COMMANDS[call.__name__.removeprefix("_")] = Command(call, text, options, examples)
        return call

    return declare


def pairs_of(texts: Sequence[str], expected: str) -> dict[str, str]:
    """Return texts such as ``PATH=VALUES`` as a map."""
    pairs: dict[str, str] = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value or name in pairs:
            message = f"'{name}' is given twice" if name in pairs else f"'{text}' has no name or no value"
            raise InputError(message, expected=expected)
        pairs[name] = value
    return pairs


def each_file(
    options: Namespace, paths: Iterable[Path], read: Callable[[Path], T]
) -> tuple[list[tuple[Path, T]], list[tuple[Path, PinarmError]]]:
    """Return the content of each file that is read, and the mistakes in the others."""
    known, mistakes = list[tuple[Path, T]](), list[tuple[Path, PinarmError]]()
    for path in paths:
        progress(f"check {path}")
        try:
            known.append((path, read(path)))
        except PinarmError as error:
            if options.traceback:
                raise
            mistakes.append((path, error))
    progress("")
    return known, mistakes


@contextmanager
def work(options: Namespace, kind: str) -> Iterator[tuple[Scenario, Destination, Executor | None]]:
    """Yield the scenario, the folder for its results, and the executor of the cluster that is named."""
    from pinarm.use.facade import load
    from pinarm.use.output import check_replaceable, destination
    from pinarm.use.show.picture_files import picture_format

    picture_format(options.plots or True, options.dpi)  # mistakes are told before the work
    scenario = load(options.scenario, options.values)
    with destination(options.output, options.scenario, scenario.name, kind) as target:
        options.output = target.folder
        if kind != "sweep":  # which goes on where it was
            check_replaceable(target.folder, kind)
        if getattr(options, "cluster", None) is None:  # a trade-off has no such option
            yield scenario, target, None
            return
        from pinarm.use.workers.dispatch import cluster

        with cluster(options.cluster) as executor:
            yield scenario, target, executor


NEW_TEXT = (
    "four_bar, slider_crank, scissor_lift, cam or arm; a URDF, xacro, MJCF or SDF file; the name of a robot; "
    "or a mechanism file with a drawing, of which the URDF is written"
)


@command(
    "write a first mechanism and scenario, from a template or a model",
    "slider_crank -o press; models/arm.urdf; four_bar/mechanism.yaml -o four_bar_urdf",
    arg("source", metavar="TEMPLATE|MODEL", help=NEW_TEXT, complete=sources),
    output("folder (default: TEMPLATE, or that of MODEL); files that exist are kept"),
)
def _new(options: Namespace) -> Answer:
    from pinarm.use.start.new import new

    folder = new(options.source, options.output)
    return Answer({"folder": str(folder)}, f"written to {folder}")


@command(
    "solve a scenario and write a result folder",
    "scenario.yaml; "
    "scenario.yaml --verify; "
    "scenario.yaml --plots pdf; "
    "scenario.yaml --set problem.time.end='3 s' -o results/longer",
    SCENARIO,
    output("result folder (default: results/SCENARIO)"),
    PLOTS,
    DPI,
    flag("--verify", "bound the global error by a second solution, and check every row"),
    workers("processes for the runs of find and sensitivity (default: none but this one)"),
    VALUES,
)
def _run(options: Namespace) -> Answer:
    import time

    from pinarm.use.progress import shown_by
    from pinarm.use.show.text import report
    from pinarm.use.store.save import save

    begin = time.perf_counter()
    with work(options, "result") as (scenario, target, executor), shown_by(progress):
        scenario = scenario.with_workers(options.workers, executor)
        result = scenario.verified() if options.verify else scenario.run()
        timing = {"solve [s]": time.perf_counter() - begin}
        save(result, target.folder, plots=options.plots, dpi=options.dpi, timing=timing)
    code = MISSED if result.missed else NumericsError.exit_code if result.no_bound else OK
    return Answer({**result.summary(), "folder": str(target.folder)}, f"{report(result)}\n{target}", code)


@command(
    "compare scenarios with their answer keys",
    "scenarios; scenario.yaml",
    arg("paths", nargs="+", type=Path, metavar="PATH", help="scenario files, or folders of them"),
    VALUES,
)
def _check(options: Namespace) -> Answer:
    from pinarm.use.study.answers.check import check, plain, verdicts
    from pinarm.use.study.run import scenario_files

    checked, mistakes = each_file(options, scenario_files(*options.paths), lambda path: check(path, options.values))
    findings, errors = [finding for _, some in checked for finding in some], [error for _, error in mistakes]
    data = {"findings": [plain(finding) for finding in findings], "errors": [*map(str, errors)]}
    missed = OK if all(finding.ok for finding in findings) else MISSED
    code = max((error.exit_code for error in errors), default=missed)
    return Answer(data, verdicts(findings) if findings or not errors else "", code, errors)


@command("read and check input only", "scenarios", arg("paths", nargs="+", type=Path, metavar="PATH"), VALUES)
def _validate(options: Namespace) -> Answer:
    from pinarm.use.study.run import input_files

    paths = input_files(*options.paths)
    read, mistakes = each_file(options, paths, lambda path: _validated(path, options.values))
    entries = [{"file": str(path), "error": str(error)} for path, error in mistakes]
    lines = [f"{path}: {verdict}" for path, verdict in read]
    if any(path.is_dir() for path in options.paths):
        lines.append(f"{len(paths)} scenarios and mechanism files, {len(mistakes)} with mistakes")
    code, errors = BAD_INPUT if mistakes else OK, [error for _, error in mistakes]
    return Answer({"mistakes": entries, "files": len(paths)}, "\n".join(lines), code, errors)


def _validated(path: Path, values: Sequence[str]) -> str:
    from pinarm.use.study.run import kind_of

    if kind_of(path) != "mechanism":
        from pinarm.use.facade import load

        load(path, values).validate()
        return "valid"
    from pinarm.use.study.explain import explain
    from pinarm.use.study.quantities import check_symbols

    explained = explain(path, values)
    check_symbols(explained.mechanism)
    loops = "its loops close, " if explained.mechanism.closure.size else ""
    mobility = f"mobility {explained.mobility.mobility} {explained.where}"
    return f"valid mechanism file: keys, names, units and the model are right, {loops}{mobility}"


SMALL_TEXT = "print them for small deviations from such values, from 0 for coordinates that are left out"
DRAW_TEXT = "draw the mechanism with the names of its parts, joints and loops, as .svg, .png or .pdf"


FOR_TEXT = (
    "which bodies to isolate, and by which theorem, for an effort, a component of a reaction or a law of motion, such "
    "as C_B, joint.B.force.x, or theta"
)
AT_TEXT = "instant of its numbers, such as t='1.5 s' or max (default: where the unknown is largest)"


@command(
    "coordinates, mobility, loops, redundancy, and a drawing; or the isolation that gives an unknown",
    "scenario.yaml; scenario.yaml --for C_B --at phi='0 deg'; mechanism.yaml --draw mechanism.svg; arm.urdf; panda",
    PATH,
    arg("--for", dest="wanted", default="", metavar="NAME", help=FOR_TEXT, complete=names),
    arg("--at", default="", metavar="PLACE", help=AT_TEXT),
    arg("--draw", type=Path, metavar="FILE", help=DRAW_TEXT),
    flag("--graph", "with --draw: draw the graph of links in place of the mechanism"),
    flag("--equations", "print the equations of motion in the model's symbols instead"),
    arg("--small", nargs="*", metavar="NAME=VALUE", help=SMALL_TEXT),
    DPI,
    LANG,
    VALUES,
)
def _explain(options: Namespace) -> Answer:
    from pinarm.use.study.explain import equations, explain, isolate

    if options.equations or options.small is not None:
        small = None if options.small is None else pairs_of(options.small, "NAME=VALUE, such as theta='90 deg'")
        known: Any = equations(options.path, options.values, small=small)
    elif options.wanted:
        known = isolate(options.path, options.wanted, options.values, at=options.at)
    else:
        known = explain(options.path, options.values)
        if options.draw is not None:
            known.draw(options.draw, dpi=options.dpi, graph=options.graph)
            return Answer(known.summary(), f"{known}\nwritten to {options.draw}")
    return Answer(known.summary() if options.json else {}, str(known))


@command(
    "a notebook with the questions of an answer key, for students",
    "scenario.yaml -o sheet.ipynb",
    PATH,
    arg("-o", "--output", type=Path, metavar="FILE", help="the notebook (default: NAME-lab.ipynb)"),
    LANG,
    VALUES,
)
def _lab(options: Namespace) -> Answer:
    from pinarm.use.study.lab import lab

    file = lab(options.path, options.output, options.values)
    return Answer({"file": str(file)}, f"written to {file}")


LIKE_TEXT = "part of a name or of a meaning, such as force"


@command(
    "names that can be asked, with units and meanings",
    "scenario.yaml --like force; arm.urdf",
    PATH,
    arg("--like", default="", metavar="TEXT", help=LIKE_TEXT, complete=names),
    VALUES,
)
def _quantities(options: Namespace) -> Answer:
    import msgspec

    from pinarm.use.study.quantities import quantities

    known = quantities(options.path, options.values, like=options.like)
    if not known:
        texts = (f"{entry.name} {entry.meaning}" for entry in quantities(options.path, options.values))
        words = re.findall(r"\w{3,}", " ".join(texts))
        raise InputError(
            f"nothing that can be asked has '{options.like}' in its name or meaning",
            expected="part of a name or of a meaning, such as force",
            hint=choices(options.like, [word for word in words if word[0].casefold() == options.like[0].casefold()])[1],
        )
    return Answer({"quantities": msgspec.to_builtins([entry._asdict() for entry in known])}, str(known))


OVER_TEXT = "such as arguments.m_A='0.1:0.5:41 kg', '1, 2, 3 kg' or 'normal(0.25, 0.01) kg'; several are combined"
TAKE_TEXT = (
    "what to take from each case, such as C_B, 'C_B @ max', 't @ max(C_B)', 'C_B @ t=1.5 s' (default: least and "
    "greatest row of every output)"
)
MANY: dict[str, Any] = {"action": "append", "default": []}


@command(
    "solve a scenario for many values",
    "scenario.yaml --over arguments.m_A='0.1:0.5:9 kg' --result 'C_B @ max'; "
    "scenario.yaml --over arguments.m_A='normal(0.25, 0.01) kg' --sample 1000; "
    "scenario.yaml --over arguments.m_A='0.1:0.5:100000 kg' --cluster tcp://10.0.0.1:8786",
    SCENARIO,
    arg("--over", metavar="PATH=VALUES", help=OVER_TEXT, complete=keys, **MANY),
    arg("--cases", type=Path, metavar="CSV", help="a file whose lines are cases; paths in its heading"),
    arg("--sample", type=int, metavar="N", help="how many values to draw from distributions"),
    arg("--seed", type=int, default=0, help="of the drawing (default: 0)"),
    flag("--lhs", "draw a Latin hypercube"),
    arg("--result", metavar="QUANTITY[@PLACE]", dest="results", help=TAKE_TEXT, complete=names, **MANY),
    workers("processes (default: all cores)"),
    output("folder of the sweep (default: results/SCENARIO-sweep)"),
    PLOTS,
    DPI,
    flag("--parquet", "write the table as Parquet too"),
    VALUES,
)
def _sweep(options: Namespace) -> Answer:
    from pinarm.use.progress import case_progress
    from pinarm.use.study.sweep.sweep import sweep
    from pinarm.use.study.sweep.table import report, require_parquet

    if options.parquet:
        require_parquet()

    with work(options, "sweep") as (scenario, target, executor):
        swept = sweep(
            scenario,
            pairs_of(options.over, "--over path.to.number='1, 2, 3 kg'"),
            values=options.values,
            cases=options.cases,
            samples=options.sample,
            seed=options.seed,
            sampling="latin" if options.lhs else "random",
            results=options.results,
            workers=options.workers,
            executor=executor,
            folder=target.folder,
            progress=case_progress(progress),
        )
        progress("")
        swept.save(target.folder, plots=options.plots, dpi=options.dpi, parquet=options.parquet)
    code = NumericsError.exit_code if swept.errors else OK
    return Answer({**swept.summary(), "folder": str(target.folder)}, f"{report(swept)}\n{target}", code)


@command(
    "error against cost of settings, of models",
    "scenario.yaml",
    SCENARIO,
    output("folder (default: results/SCENARIO-tradeoff)"),
    PLOTS,
    DPI,
    VALUES,
)
def _tradeoff(options: Namespace) -> Answer:
    from pinarm.use.study.tradeoff import report, tradeoff

    with work(options, "trade-off") as (scenario, target, _):
        trade = tradeoff(scenario)
        trade.save(target.folder, plots=options.plots, dpi=options.dpi)
    return Answer({**trade.summary(), "folder": str(target.folder)}, f"{report(trade)}\n{target}")


LIST: dict[str, Any] = {"action": "extend", "nargs": "+", "default": []}
PLOT_TEXT = "plot these beside it, or nothing (default: the outputs)"


@command(
    "show the motion of a result in a web page",
    "results/four_bar --trace P --arrows reactions; results/four_bar --png t=0.5",
    arg("result", type=Path, metavar="RESULT", help="result folder"),
    output("file (default: replay.html or replay.png in the folder)"),
    arg("--trace", metavar="POINT", help="draw the paths of these links' origins; com: of the centre of mass", **LIST),
    arg("--arrows", metavar="KIND", help="draw forces, torques, reactions, or all", **LIST),
    arg("--plot", action="extend", nargs="*", metavar="QUANTITY", help=PLOT_TEXT, complete=names),
    flag("--names", "show names of parts, points and joints; the key N does too"),
    either(
        arg("--png", metavar="t=VALUE", help="write a picture of this instant, by Chromium"),
        arg("--video", type=Path, metavar="FILE.mp4", help="write a video, by Chromium and ffmpeg"),
    ),
    arg("--fps", type=float, default=30.0, help="pictures a second of the video"),
    arg("--speed", type=float, default=1.0, help="of the video, relative to real time"),
    LANG,
)
def _replay(options: Namespace) -> Answer:
    from pinarm.use.show.replay import chromium
    from pinarm.use.study.restore import restore

    target = _replay_file(options)
    result = restore(options.result)
    shown = result.replay(traces=options.trace, arrows=options.arrows, plots=options.plot, named=options.names)
    if options.png:
        chromium.picture(shown, chromium.place(shown.run, options.png), target)
    elif options.video:
        chromium.video(shown, target, fps=options.fps, speed=options.speed, progress=progress)
    else:
        shown.save(target)
    data = {"file": str(target), "bytes": target.stat().st_size, "notes": shown.notes}
    return Answer(data, "\n".join([*(f"note: {note}" for note in shown.notes), f"written to {target}"]))


def _replay_file(options: Namespace) -> Path:
    """Return the file that ``replay`` writes, whose ending is that of its format."""
    if options.video and options.output:
        message = f"two files are named, {options.video} and {options.output}"
        raise InputError(message, expected="the video's, after --video", hint="leave -o out")
    pictured = ("a picture", ".png") if options.png else ("a video", ".mp4")
    what, ending = pictured if options.png or options.video else ("a page", ".html")
    file: Path = options.video or options.output or options.result / f"replay{ending}"
    if file.suffix.lower() != ending:
        expected = f"a file that ends in {ending}, such as {file.stem}{ending}"
        hint = "--png t=VALUE for a picture, --video FILE.mp4 for a video" if ending == ".html" else ""
        raise InputError(f"{what} is not written as '{file.name}'", expected=expected, hint=hint)
    return file


FORMS = (
    "report.html with the replay, or report.pdf, by Chromium (default: report.html in the folder of a single result)"
)


@command(
    "write one document on results, for a client",
    "results/four_bar -o report.html; results/first results/second -o both.pdf; results/four_bar-sweep; "
    "results/four_bar --student -o exercise.pdf",
    arg("results", nargs="+", type=Path, metavar="RESULT", help="folders of results and sweeps, a chapter each"),
    output(FORMS, metavar="FILE"),
    arg("--title", default="", help="its heading (default: that of the first scenario)"),
    flag("--student", "leave the answer key out: neither print nor draw expected and published values"),
    flag("--equations", "add the equations of the mechanism in letters; needs SymPy"),
    LANG,
)
def _report(options: Namespace) -> Answer:
    from pinarm.use.report.report import report

    folder = options.results[0] if len(options.results) == 1 else Path()
    target: Path = options.output or folder / "report.html"
    report(options.results, target, title=options.title, student=options.student, equations=options.equations)
    return Answer({"file": str(target), "bytes": target.stat().st_size}, f"written to {target}")


@command(
    "print the JSON Schema for editors",
    "mechanism > mechanism.schema.json",
    arg("of", nargs="?", choices=["scenario", "mechanism"], default="scenario"),
)
def _schema(options: Namespace) -> Answer:
    from pinarm.use.scenario.json_schema import schema
    from pinarm.use.store.files import json_text

    return Answer(known := schema(options.of), json_text(known))


@command(
    "copy the models, scenarios and examples of pinarm to a folder",
    "-o pinarm-examples",
    output("folder (default: pinarm-examples); files that exist are left as they are", default=Path("pinarm-examples")),
)
def _examples(options: Namespace) -> Answer:
    from pinarm.use.start.new import examples

    folder = examples(options.output)
    return Answer({"folder": str(folder)}, f"written to {folder}")


@command("test this installation: versions, and every kind of problem", "")
def _selftest(options: Namespace) -> Answer:
    from pinarm.use.study.answers.selftest import selftest

    outcome = selftest()
    return Answer(outcome.summary(), str(outcome), OK if outcome.passed else MISSED)
