"""The command line: ``run``, ``check``, ``validate``, ``explain``, ``sweep``, ``tradeoff``, ``replay``, ``report`` ...

Exit codes: 0 all is well, 1 an expectation or the wanted accuracy is missed, 2 the input has a mistake or what comes
out cannot be written, 3 the numerics failed (what was computed until then is kept) or a case of a sweep did, 4 the
program has a fault, 130 interrupted, 143 terminated (SIGTERM). Results go to stdout; progress to stderr, where that is
a terminal.
"""

from __future__ import annotations

import argparse
import gc
import os
import re
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from pinarm import __version__
from pinarm.cli.options import EXAMPLES, add
from pinarm.cli.streams import flush_output, give_up, leave, open_streams, unwritable
from pinarm.errors import InputError, NumericsError, PinarmError, choices, fault, of_interrupt, printable
from pinarm.input.roots import file_root

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from types import FrameType

    from pinarm.use.study.answers.check import Findings

OK, MISSED, BAD_INPUT, NUMERICS_FAILED, FAULT, INTERRUPTED, TERMINATED = 0, 1, 2, 3, 4, 130, 143

INNERMOST = 30
"""Calls that a bug report shows: of a recursion without end all would be 180 kB."""


def program() -> NoReturn:
    """Run one command as a program of its own; SIGTERM ends it as Ctrl-C does, with another exit code."""
    sys.unraisablehook = _once_more
    for name in ("MPLBACKEND", "SOURCE_DATE_EPOCH"):  # matplotlib fails over wrong ones; files have no dates
        os.environ.pop(name, None)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)
    leave(main())


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    """End the program as Ctrl-C does; a second SIGTERM ends it at once."""
    signal.signal(number, signal.SIG_DFL)
    terminated.append(number)
    raise KeyboardInterrupt


terminated: list[int] = []
"""SIGTERM, once it has come."""


def _once_more(lost: sys.UnraisableHookArgs) -> None:
    """Raise an interrupt again that came where nothing can be raised, as in a callback at the end of an import."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.01)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    gc.set_threshold(100_000, 20, 20)  # importing makes much that stays: looking through it for garbage costs 10 %
    given = sys.argv[1:] if arguments is None else arguments
    if "_ARGCOMPLETE" in os.environ:
        _complete(os.environ.get("COMP_LINE", ""))
    open_streams()
    code = _code_of(given)
    return TERMINATED if terminated and code == INTERRUPTED else code


def _code_of(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code; interrupts, and faults of the program, have been reported."""
    try:
        return _ended(arguments)
    except KeyboardInterrupt:
        pass
    except MemoryError as error:
        _say(f"error: this machine has not enough memory for it ({error})")
        return NUMERICS_FAILED
    except Exception as error:
        if not of_interrupt(error):
            _report_fault(error)
            return FAULT
    _say("terminated (SIGTERM)" if terminated else "interrupted")
    return INTERRUPTED


def _report_fault(error: Exception) -> None:
    """Print a bug report: where in the program an error arose that no input should cause."""
    import traceback

    lines = traceback.format_exception(error, limit=-INNERMOST)
    _say(f"{''.join(lines)}error: pinarm {__version__} has a fault: {fault(error)}\n"
         "  expected: an answer, or a message on what to change in the input\n"
         "  try: please report it, with the lines above and the input files")  # fmt: skip


def _packages(texts: Sequence[str]) -> dict[str, str]:
    """Return the folders of packages that options such as ``ur_description=../ur`` name.

    Raises:
        InputError: One has no name or no folder.
    """
    pairs = [text.partition("=")[::2] for text in texts]
    for name, folder in pairs:
        if not name or not folder:
            raise InputError(f"--package {name}: the folder of a package is missing", expected="--package NAME=DIR")
    return dict(pairs)


def _ended(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code; what went wrong has been told."""
    options = argparse.Namespace(traceback=False)
    try:
        try:
            options = _parser(arguments).parse_args(arguments)
        except SystemExit:  # help has been printed, or what is wrong with the arguments
            flush_output()
            raise
        with file_root(options.root, _packages(options.packages)):
            code = int(options.command(options))
        flush_output()
    except BrokenPipeError:  # the reader of our output has seen enough
        give_up(sys.stdout)
        return OK
    except (PinarmError, OSError) as error:
        if options.traceback:
            raise
        with suppress(PinarmError, BrokenPipeError):
            flush_output()
        known = unwritable(error) if isinstance(error, OSError) else error
        _tell(known)
        return _keep_partial(known, options)
    return code


def _complete(line: str) -> None:
    """Answer a shell that asks for completions of a line, where argcomplete is installed, and end the program."""
    with suppress(ImportError):
        import argcomplete

        argcomplete.autocomplete(_parser(line.split()))


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser: of one command where the arguments begin with it, as all together take time."""
    parser = argparse.ArgumentParser(
        prog="pinarm", description="Rigid-multibody simulation of mechanisms.", epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"pinarm {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", prog="pinarm")
    for name in arguments[:1] if {*arguments[:1]} & {*COMMANDS} else COMMANDS:
        call, explained = COMMANDS[name]
        command = commands.add_parser(name, help=explained)
        command.set_defaults(command=call)
        if name in arguments:
            add(name, command)
    return parser


def _run(options: argparse.Namespace) -> int:
    from pinarm.use.output.destination import destination
    from pinarm.use.output.folder import check_replaceable
    from pinarm.use.progress import shown_by
    from pinarm.use.scenario.scenario import load
    from pinarm.use.show.terminal import report
    from pinarm.use.store.save import save

    begin = time.perf_counter()
    scenario = load(options.scenario, options.values)
    with (
        destination(options.output, options.scenario, scenario.name) as target, _executor(options.cluster) as executor,
        shown_by(_progress),
    ):  # fmt: skip
        options.output = target.folder
        check_replaceable(target.folder, "result")  # before the work
        scenario = scenario.with_workers(options.workers, executor)
        result = scenario.verified() if options.verify else scenario.run()
        solved = time.perf_counter()
        save(result, target.folder, plots=options.plots, dpi=options.dpi, timing={"solve [s]": solved - begin})
    if options.json:
        _print_json({**result.summary(), "folder": str(target.folder)})
    else:
        print(report(result))
        print(target)
    if result.missed:
        return MISSED
    return NumericsError.exit_code if result.no_bound else OK


def _check(options: argparse.Namespace) -> int:
    from pinarm.use.study.answers.check import check, misses, told_apart
    from pinarm.use.study.answers.verdict_table import plain, verdicts
    from pinarm.use.study.run import scenario_files

    solved: dict[Path, Findings] = {}
    failures: list[PinarmError] = []
    for path in scenario_files(*options.paths):
        _progress(f"check {path}")
        try:
            solved[path] = check(path, options.values)
        except PinarmError as error:
            if options.traceback:
                raise
            failures.append(error)
    _progress("")
    findings = told_apart(solved)
    if options.json:
        _print_json({"findings": [plain(finding) for finding in findings], "errors": [str(e) for e in failures]})
    elif findings or not failures:
        print(verdicts(findings, coloured=sys.stdout.isatty()))
    for failure in failures:
        _tell(failure)
    if failures:
        return max(failure.exit_code for failure in failures)
    return MISSED if misses(findings) else OK


def _validate(options: argparse.Namespace) -> int:
    from pinarm.use.study.run import input_files

    found = [input_files(path) for path in options.paths]
    paths, others = [path for own, _ in found for path in own], sum(other for _, other in found)
    if not paths:
        raise InputError(f"there are no scenarios and no mechanism files in {', '.join(map(str, options.paths))}",
                         expected="files ending in .yaml, with a 'problem:', a 'robot:' or 'planar:'")  # fmt: skip
    mistakes = []
    for path in paths:
        try:
            said = _validated(path, options.values)
        except PinarmError as error:
            if options.traceback:
                raise
            mistakes.append((path, error))
        else:
            if not options.json:
                print(f"{path}: {said}")
    if options.json:
        told = [{"file": str(path), "error": str(error)} for path, error in mistakes]
        _print_json({"mistakes": told, "files": len(paths), "passed over": others})
    elif any(path.is_dir() for path in options.paths):
        counts = f"{len(paths)} scenarios and mechanism files, {len(mistakes)} with mistakes"
        print(f"{counts}; {others} other files passed over")
    for _, mistake in mistakes:
        _tell(mistake)
    return BAD_INPUT if mistakes else OK


def _validated(path: Path, values: Sequence[str]) -> str:
    """Return what has been checked of a scenario, or a mechanism file, that is valid.

    Raises:
        PinarmError: It is not; the message says where.
    """
    from pinarm.use.study.run import is_mechanism_file

    if not is_mechanism_file(path):
        from pinarm.use.scenario.scenario import load

        load(path, values).validate()
        return "valid"
    from pinarm.use.study.explain import explain
    from pinarm.use.study.quantities import check_symbols

    found = explain(path, values)
    check_symbols(found.mechanism)
    loops = "its loops close, " if found.mechanism.closure.size else ""
    return (f"valid mechanism file: keys, names, units and the model are right, {loops}"
            f"mobility {found.mobility.mobility} {found.where}")  # fmt: skip


def _quantities(options: argparse.Namespace) -> int:
    from pinarm.use.study.quantities import quantities

    known = quantities(options.path, options.values, like=options.like)
    if not known:
        texts = (f"{entry.name} {entry.meaning}" for entry in quantities(options.path, options.values))
        words = {word for text in texts for word in re.findall(r"\w{3,}", text)}
        alike = {word for word in words if word[0].casefold() == options.like[0].casefold()}
        raise InputError(f"nothing that can be asked has '{options.like}' in its name or meaning",
                         expected="part of a name or of a meaning, such as force",
                         hint=choices(options.like, alike)[1])  # fmt: skip
    if options.json:
        import msgspec

        _print_json({"quantities": msgspec.to_builtins([entry._asdict() for entry in known])})
    else:
        print(printable(str(known)))
    return OK


def _explain(options: argparse.Namespace) -> int:
    from pinarm.use.study.explain import explain

    found = explain(options.path, options.values)
    if options.json:
        _print_json(found.summary())
    else:
        print(printable(str(found)))
    if options.draw is not None:
        found.draw(options.draw, dpi=options.dpi)
        print(f"written to {options.draw}", file=sys.stderr if options.json else sys.stdout)
    return OK


def _sweep(options: argparse.Namespace) -> int:
    from pinarm.use.output.destination import destination
    from pinarm.use.scenario.scenario import load
    from pinarm.use.study.sweep.sweep import sweep
    from pinarm.use.study.sweep.sweep_text import progress_bar, report

    scenario = load(options.scenario, options.values)
    with (
        destination(options.output, options.scenario, scenario.name, "sweep") as target,
        _executor(options.cluster) as executor, progress_bar(sys.stderr) as progress,
    ):  # fmt: skip
        swept = sweep(
            scenario, _assignments(options.over), values=options.values, cases=options.cases, samples=options.sample,
            seed=options.seed, sampling=options.sampling, results=options.results, workers=options.workers,
            executor=executor, folder=target.folder, parquet=options.parquet, progress=progress,
        )  # fmt: skip
        swept.save(target.folder, plots=options.plots, dpi=options.dpi, parquet=options.parquet)
    if options.json:
        _print_json({**swept.summary(), "folder": str(target.folder)})
    else:
        print(printable(report(swept)))
        print(target)
    return NUMERICS_FAILED if swept.errors else OK


def _executor(address: str | None) -> AbstractContextManager[Executor | None]:
    """Return the executor of a cluster; none where no address is given."""
    if address is None:
        return nullcontext()
    from pinarm.use.workers.cluster import cluster

    return cluster(address)


def _tradeoff(options: argparse.Namespace) -> int:
    from pinarm.use.output.destination import destination
    from pinarm.use.output.folder import check_replaceable
    from pinarm.use.scenario.scenario import load
    from pinarm.use.study.accuracy.tradeoff import tradeoff
    from pinarm.use.study.accuracy.tradeoff_view import report

    scenario = load(options.scenario, options.values)
    with (
        destination(options.output, options.scenario, scenario.name, "trade-off") as target,
        _executor(options.cluster) as executor,
    ):  # fmt: skip
        check_replaceable(target.folder, "trade-off")
        trade = tradeoff(scenario, workers=options.workers, executor=executor)
        trade.save(target.folder, plots=options.plots, dpi=options.dpi)
    if options.json:
        _print_json({**trade.summary(), "folder": str(target.folder)})
    else:
        print(printable(report(trade)))
        print(target)
    return OK


def _assignments(texts: Sequence[str]) -> dict[str, str]:
    """Return what stands left and right of the first equals sign of each text.

    Raises:
        InputError: There is none, or the same stands left twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        path, equals, values = (part.strip() for part in text.partition("="))
        if not path or not equals or path in found:
            said = f"'{path}' is varied twice" if path in found else f"'--over {text}' says no values"
            raise InputError(said, expected="--over path.to.number='1, 2, 3 kg'")
        found[path] = values
    return found


def _replay(options: argparse.Namespace) -> int:
    from pinarm.use.store.restore import restore

    target = _replay_file(options)
    result = restore(options.result)
    shown = result.replay(traces=options.trace, arrows=options.arrows, plots=options.plot, named=options.names)
    if options.png or options.video:
        from pinarm.use.show.replay import pictures

        if options.png:
            pictures.picture(shown, pictures.place(shown.run, options.png), target)
        else:
            pictures.video(shown, target, fps=options.fps, speed=options.speed, progress=_progress)
    else:
        shown.save(target)
    if options.json:
        _print_json({"file": str(target), "bytes": target.stat().st_size, "notes": shown.notes})
    else:
        print("\n".join([*(printable(f"note: {note}") for note in shown.notes), f"written to {target}"]))
    return OK


def _replay_file(options: argparse.Namespace) -> Path:
    """Return the file that ``replay`` writes.

    Raises:
        InputError: Two files are named, or one whose ending is that of another format.
    """
    if options.video and options.output:
        raise InputError(
            f"two files are named, {options.video} and {options.output}",
            expected="the video's, after --video",
            hint=f"leave -o out; replay {options.result} -o {options.output}, by itself, writes the other one",
        )
    what, ending = (
        ("a picture", ".png") if options.png else ("a video", ".mp4") if options.video else ("a page", ".html")
    )
    file: Path = options.video or options.output or options.result / f"replay{ending}"
    if file.suffix.lower() != ending:
        raise InputError(
            f"{what} is not written as '{file.name}'",
            expected=f"a file that ends in {ending}, such as {file.stem}{ending}",
            hint="" if options.png or options.video else "--png t=VALUE for a picture, --video FILE.mp4 for a video",
        )
    return file


def _report(options: argparse.Namespace) -> int:
    from pinarm.use.report.report import report

    folder = options.results[0] if len(options.results) == 1 else Path()
    target = options.output or folder / "report.html"
    report(options.results, target, title=options.title)
    if options.json:
        _print_json({"file": str(target), "bytes": target.stat().st_size})
    else:
        print(f"written to {target}")
    return OK


def _schema(options: argparse.Namespace) -> int:
    from pinarm.use.scenario.json_schema import schema

    _print_json(schema(options.of))
    return OK


def _examples(options: argparse.Namespace) -> int:
    from pinarm.use.store.examples import examples

    folder = examples(options.output)
    if options.json:
        _print_json({"folder": str(folder)})
    else:
        print(f"written to {folder}")
    return OK


def _new(options: argparse.Namespace) -> int:
    from pinarm.use.store.new import new

    folder = new(options.source, options.output)
    if options.json:
        _print_json({"folder": str(folder)})
    else:
        print(f"written to {folder}")
    return OK


def _selftest(options: argparse.Namespace) -> int:
    from pinarm.use.study.answers.selftest import selftest

    found = selftest()
    if options.json:
        _print_json(found.summary())
    else:
        print(printable(str(found)))
    return OK if found.passed else MISSED


def _keep_partial(error: PinarmError, options: argparse.Namespace) -> int:
    """Write what was computed before the numerics failed; return the exit code."""
    from pinarm.use.result.result import Result

    partial = error.partial if isinstance(error, NumericsError) else None
    folder = getattr(options, "output", None)
    if isinstance(partial, Result) and folder is not None:
        import numpy as np

        try:
            with np.errstate(all="ignore"):  # that it is not finite has been told
                partial.save(folder / "partial", plots=False)
            _say(f"  kept: {len(partial)} rows in {folder / 'partial'}")
        except PinarmError as second:
            _say(f"  not kept: {second}")
    return error.exit_code


def _tell(error: PinarmError) -> None:
    _say(f"error: {error}")


def _say(text: str) -> None:
    """Print text on stderr, where there is room for it: the exit code says the rest."""
    try:
        print(printable(text), file=sys.stderr, flush=True)
    except OSError:
        give_up(sys.stderr)


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[K{printable(text)}", end="", file=sys.stderr, flush=True)


def _print_json(value: object) -> None:
    from pinarm.use.store.files import json_text

    print(json_text(value))


COMMANDS = {
    "new": (_new, "write a first mechanism and scenario, from a template or a model"),
    "run": (_run, "solve a scenario and write a result folder"),
    "check": (_check, "compare scenarios with their answer keys"),
    "validate": (_validate, "read and check input only"),
    "explain": (_explain, "coordinates, mobility, loops, redundancy, and a drawing"),
    "quantities": (_quantities, "names that can be asked, with units and meanings"),
    "sweep": (_sweep, "solve a scenario for many values"),
    "tradeoff": (_tradeoff, "error against cost of settings, of models"),
    "replay": (_replay, "show the motion of a result in a web page"),
    "report": (_report, "write one document on results, for a client"),
    "schema": (_schema, "print the JSON Schema for editors"),
    "examples": (_examples, "copy the models, scenarios and examples of pinarm to a folder"),
    "selftest": (_selftest, "test this installation: versions, and every kind of problem"),
}
"""Name -> what does it, and what it does."""
