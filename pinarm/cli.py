"""The command line: ``run``, ``check``, ``validate``, ``explain``, ``sweep``, ``tradeoff``, ``replay``, ``schema``.

Exit codes: 0 all is well, 1 an expectation or the wanted accuracy is missed, 2 the input has a mistake, 3 the numerics
failed (what was computed until then is kept) or a case of a sweep did, 130 interrupted. Results go to stdout; progress
to stderr, where that is a terminal.
"""

from __future__ import annotations

import argparse
import gc
import io
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinarm.errors import InputError, NumericsError, PinarmError, printable
from pinarm.input.roots import rooted

if TYPE_CHECKING:
    from pinarm.use.check import Finding

OK, MISSED, BAD_INPUT, NUMERICS_FAILED, INTERRUPTED = 0, 1, 2, 3, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    gc.set_threshold(100_000, 20, 20)  # importing makes much that stays: looking through it for garbage costs 10 %
    options = _parser().parse_args(arguments)
    for stream in (sys.stdout, sys.stderr):  # a terminal without Unicode shows question marks instead of failing
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        with rooted(options.root):
            return int(options.command(options))
    except PinarmError as error:
        if options.traceback:
            raise
        _tell(error)
        return _keep_partial(error, options)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return OK


def _parser() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--traceback", action="store_true", help="show where in the program an error arose")
    common.add_argument("--root", metavar="DIR", help="folder that files may refer to (default: the nearest one above "
                        "with a pyproject.toml or .pinarm-root)")  # fmt: skip
    common.add_argument("--json", action="store_true", help="print JSON for machines")
    overrides = argparse.ArgumentParser(add_help=False)
    overrides.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="overrides",
                           help="replace a value of the scenario, such as problem.time.end='3 s'")  # fmt: skip
    parser = argparse.ArgumentParser(prog="pinarm", description="Rigid-multibody simulation of mechanisms.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", parents=[common, overrides], help="solve a scenario and write a result folder")
    run.add_argument("scenario", type=Path)
    run.add_argument("-o", "--output", type=Path, help="result folder (default: results/SCENARIO)")
    run.add_argument("--no-plots", action="store_true", help="write numbers only")
    run.add_argument("--verify", action="store_true",
                     help="estimate the global error by a second solution, and check every row")  # fmt: skip
    run.set_defaults(command=_run)

    check = commands.add_parser("check", parents=[common, overrides], help="compare scenarios with their answer keys")
    check.add_argument("paths", nargs="+", type=Path, metavar="PATH", help="scenario files, or folders of them")
    check.set_defaults(command=_check)

    validate = commands.add_parser("validate", parents=[common, overrides], help="read and check input only")
    validate.add_argument("paths", nargs="+", type=Path, metavar="PATH")
    validate.set_defaults(command=_validate)

    explain = commands.add_parser(
        "explain", parents=[common, overrides], help="coordinates, mobility, loops, redundancy"
    )
    explain.add_argument("path", metavar="SCENARIO|MODEL")
    explain.set_defaults(command=_explain)
    _add_sweep(commands, [common, overrides])

    trade = commands.add_parser(
        "tradeoff", parents=[common, overrides], help="error against cost of settings, of models"
    )
    trade.add_argument("scenario", type=Path)
    trade.add_argument("-o", "--output", type=Path, help="folder (default: results/SCENARIO-tradeoff)")
    trade.add_argument("--no-plots", action="store_true", help="write numbers only")
    trade.set_defaults(command=_tradeoff)

    _add_replay(commands, [common])

    schema = commands.add_parser("schema", parents=[common], help="print the JSON Schema for editors")
    schema.add_argument("of", nargs="?", choices=["scenario", "mechanism"], default="scenario")
    schema.set_defaults(command=_schema)
    return parser


def _add_sweep(commands: Any, parents: list[argparse.ArgumentParser]) -> None:
    sweep = commands.add_parser("sweep", parents=parents, help="solve a scenario for many values")
    sweep.add_argument("scenario", type=Path)
    sweep.add_argument("--over", action="append", default=[], metavar="PATH=VALUES",
                       help="such as arguments.m_A='0.1:0.5:41 kg', '1, 2, 3 kg' or 'normal(0.25, 0.01) kg'; "
                       "several are combined")  # fmt: skip
    sweep.add_argument("--cases", type=Path, metavar="CSV", help="a file whose lines are cases; paths in its heading")
    sweep.add_argument("--sample", type=int, metavar="N", help="how many values to draw from distributions")
    sweep.add_argument("--seed", type=int, default=0, help="of the drawing (default: 0)")
    sweep.add_argument("--lhs", action="store_const", const="latin", default="random", dest="sampling",
                       help="draw a Latin hypercube")  # fmt: skip
    sweep.add_argument("--result", action="append", default=[], metavar="QUANTITY[@PLACE]", dest="results",
                       help="what to take from each case, such as C_B, 'C_B @ max', 't @ max(C_B)', 'C_B @ t=1.5 s' "
                       "(default: least and greatest row of every output)")  # fmt: skip
    sweep.add_argument("-j", "--workers", type=int, help="processes (default: all cores)")
    sweep.add_argument("-o", "--output", type=Path, help="folder of the sweep (default: results/SCENARIO-sweep)")
    sweep.add_argument("--no-plots", action="store_true", help="write numbers only")
    sweep.set_defaults(command=_sweep)


def _add_replay(commands: Any, parents: list[argparse.ArgumentParser]) -> None:
    replay = commands.add_parser("replay", parents=parents, help="show the motion of a result in a web page")
    replay.add_argument("result", type=Path, metavar="RESULT", help="result folder")
    replay.add_argument("-o", "--output", type=Path, help="file (default: replay.html or replay.png in the folder)")
    replay.add_argument("--trace", action="extend", nargs="+", default=[], metavar="POINT",
                        help="draw the paths of these links' origins; com: of the centre of mass")  # fmt: skip
    replay.add_argument("--arrows", action="extend", nargs="+", default=[], metavar="KIND",
                        help="draw forces, torques, reactions, or all")  # fmt: skip
    replay.add_argument("--plot", action="extend", nargs="*", metavar="QUANTITY",
                        help="plot these beside it, or nothing (default: the outputs)")  # fmt: skip
    instead = replay.add_mutually_exclusive_group()
    instead.add_argument("--png", metavar="t=VALUE", help="write a picture of this instant, by Chromium")
    instead.add_argument("--video", type=Path, metavar="FILE.mp4", help="write a video, by Chromium and ffmpeg")
    replay.add_argument("--fps", type=float, default=30.0, help="pictures a second of the video")
    replay.add_argument("--speed", type=float, default=1.0, help="of the video, relative to real time")
    replay.set_defaults(command=_replay)


def _run(options: argparse.Namespace) -> int:
    from pinarm.use.report import report
    from pinarm.use.save import save
    from pinarm.use.scenario import load

    begin = time.perf_counter()
    scenario = load(options.scenario, options.overrides)
    folder = options.output or Path("results") / scenario.name
    options.output = folder
    result = scenario.verified() if options.verify else scenario.run()
    solved = time.perf_counter()
    save(result, folder, plots=not options.no_plots, timing={"solve [s]": solved - begin})
    if options.json:
        _print_json({**result.summary(), "folder": str(folder)})
    else:
        print(report(result))
        print(f"written to {folder}")
    return MISSED if result.missed else OK


def _check(options: argparse.Namespace) -> int:
    from pinarm.use.check import check, misses
    from pinarm.use.run import scenario_files
    from pinarm.use.scenario import load
    from pinarm.use.verdicts import plain, verdicts

    findings: list[Finding] = []
    failures: list[PinarmError] = []
    for path in [file for given in options.paths for file in scenario_files(given)]:
        _progress(f"check {path}")
        try:
            findings += check(load(path, options.overrides))
        except PinarmError as error:
            if options.traceback:
                raise
            failures.append(error)
    _progress("")
    if options.json:
        _print_json({"findings": [plain(finding) for finding in findings], "errors": [str(e) for e in failures]})
    else:
        print(verdicts(findings, coloured=sys.stdout.isatty()))
    for failure in failures:
        _tell(failure)
    if failures:
        return max(failure.exit_code for failure in failures)
    return MISSED if misses(findings) else OK


def _validate(options: argparse.Namespace) -> int:
    from pinarm.use.run import scenario_files
    from pinarm.use.scenario import load

    mistakes = []
    for path in [file for given in options.paths for file in scenario_files(given)]:
        try:
            load(path, options.overrides).validate()
        except PinarmError as error:
            if options.traceback:
                raise
            mistakes.append((path, error))
        else:
            if not options.json:
                print(f"{path}: valid")
    if options.json:
        _print_json({"mistakes": [{"file": str(path), "error": str(error)} for path, error in mistakes]})
    for _, mistake in mistakes:
        _tell(mistake)
    return BAD_INPUT if mistakes else OK


def _explain(options: argparse.Namespace) -> int:
    from pinarm.use.explain import explain

    found = explain(options.path, options.overrides)
    if options.json:
        import msgspec

        mobility, removals = msgspec.to_builtins((found.mobility, found.removals))
        _print_json({"mechanism": found.mechanism.title, **mobility, "not solved for": removals})
    else:
        print(printable(str(found)))
    return OK


def _sweep(options: argparse.Namespace) -> int:
    from pinarm.use.scenario import load
    from pinarm.use.sweep.report import progress_bar, report
    from pinarm.use.sweep.study import sweep
    from pinarm.use.sweep.table import summary

    scenario = load(options.scenario, options.overrides)
    folder = options.output or Path("results") / f"{scenario.name}-sweep"
    with progress_bar(sys.stderr) as progress:
        swept = sweep(
            scenario, _assignments(options.over), cases=options.cases, samples=options.sample, seed=options.seed,
            sampling=options.sampling, results=options.results, workers=options.workers, folder=folder,
            progress=progress,
        )  # fmt: skip
    swept.save(folder, plots=not options.no_plots)
    if options.json:
        _print_json({**summary(swept), "folder": str(folder)})
    else:
        print(printable(report(swept)))
        print(f"written to {folder}")
    return NUMERICS_FAILED if swept.errors else OK


def _tradeoff(options: argparse.Namespace) -> int:
    from pinarm.use.scenario import load
    from pinarm.use.tradeoff.report import report
    from pinarm.use.tradeoff.study import tradeoff

    scenario = load(options.scenario, options.overrides)
    folder = options.output or Path("results") / f"{scenario.name}-tradeoff"
    trade = tradeoff(scenario)
    trade.save(folder, plots=not options.no_plots)
    if options.json:
        _print_json({**trade.summary(), "folder": str(folder)})
    else:
        print(printable(report(trade)))
        print(f"written to {folder}")
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
    from pinarm.use.replay.page import replay
    from pinarm.use.restore import restore

    result = restore(options.result)
    shown = replay(result, traces=options.trace, arrows=options.arrows, plots=options.plot)
    target = options.output or options.result / ("replay.png" if options.png else "replay.html")
    if options.png or options.video:
        from pinarm.use.replay import pictures

        if options.png:
            pictures.picture(shown, pictures.place(result.trajectory, options.png), target)
        else:
            target = pictures.video(shown, options.video, fps=options.fps, speed=options.speed, progress=_progress)
    else:
        shown.save(target)
    if options.json:
        _print_json({"file": str(target), "bytes": target.stat().st_size, "notes": shown.notes})
    else:
        print("\n".join([*(printable(f"note: {note}") for note in shown.notes), f"written to {target}"]))
    return OK


def _schema(options: argparse.Namespace) -> int:
    from pinarm.use.schema import schema

    _print_json(schema(options.of))
    return OK


def _keep_partial(error: PinarmError, options: argparse.Namespace) -> int:
    """Write what was computed before the numerics failed; return the exit code."""
    from pinarm.use.result import Result

    partial = error.partial if isinstance(error, NumericsError) else None
    folder = getattr(options, "output", None)
    if isinstance(partial, Result) and folder is not None:
        try:
            partial.save(folder / "partial", plots=False)
            print(f"  kept: {len(partial)} rows in {folder / 'partial'}", file=sys.stderr)
        except PinarmError as second:
            print(f"  not kept: {second}", file=sys.stderr)
    return error.exit_code


def _tell(error: PinarmError) -> None:
    print(printable(f"error: {error}"), file=sys.stderr)


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[K{printable(text)}", end="", file=sys.stderr, flush=True)


def _print_json(value: object) -> None:
    from pinarm.use.files import json_text

    print(json_text(value))
