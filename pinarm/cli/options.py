"""The options of the commands."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable
from pathlib import Path

from pinarm.errors import PinarmError

EXAMPLES = """examples:
  python -m pinarm new four_bar && python -m pinarm run four_bar/scenario.yaml
  python -m pinarm new my_robot.urdf
  python -m pinarm COMMAND -h
"""
"""What ``-h`` shows at its end."""

EXAMPLES_OF = {
    "new": ["new slider_crank -o press", "new models/arm.urdf", "new four_bar/mechanism.yaml -o four_bar_urdf"],
    "run": ["run scenario.yaml", "run scenario.yaml --verify", "run scenario.yaml --plots pdf",
            "run scenario.yaml --set problem.time.end='3 s' -o results/longer"],
    "check": ["check scenarios", "check scenario.yaml"],
    "validate": ["validate scenarios"],
    "explain": ["explain scenario.yaml", "explain mechanism.yaml --draw mechanism.svg", "explain arm.urdf",
                "explain panda"],
    "quantities": ["quantities scenario.yaml --like force", "quantities arm.urdf"],
    "sweep": ["sweep scenario.yaml --over arguments.m_A='0.1:0.5:9 kg' --result 'C_B @ max'",
              "sweep scenario.yaml --over arguments.m_A='normal(0.25, 0.01) kg' --sample 1000",
              "sweep scenario.yaml --over arguments.m_A='0.1:0.5:100000 kg' --cluster tcp://10.0.0.1:8786"],
    "tradeoff": ["tradeoff scenario.yaml"],
    "replay": ["replay results/four_bar --trace P --arrows reactions", "replay results/four_bar --png t=0.5"],
    "report": ["report results/four_bar -o report.html", "report results/first results/second -o both.pdf"],
    "schema": ["schema mechanism > mechanism.schema.json"],
    "examples": ["examples -o pinarm-examples"],
    "selftest": ["selftest"],
}  # fmt: skip
"""Command -> what ``COMMAND -h`` shows at its end."""


def add(command: str, parser: ArgumentParser) -> None:
    """Add the options and examples of a command to its parser."""
    OPTIONS[command](parser)
    parser.formatter_class = RawDescriptionHelpFormatter
    parser.epilog = "\n".join(["examples:", *(f"  python -m pinarm {text}" for text in EXAMPLES_OF[command])])
    parser.add_argument("--traceback", action="store_true", help="show where in the program an error arose")
    parser.add_argument("--root", metavar="DIR", help="folder that files may refer to (default: the nearest one above "
                        "with a pyproject.toml or .pinarm-root, else the working folder)")  # fmt: skip
    parser.add_argument("--package", metavar="NAME=DIR", action="append", default=[], dest="packages",
                        help="folder of a package of ROS that models refer to")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON for machines")


def _values(command: ArgumentParser) -> None:
    given = command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="values",
                         help="replace a value of the scenario, such as problem.time.end='3 s'; a key that has dots in "
                         "quotes: 'problem.motion.\"tcp.y\".value=3 mm'")  # fmt: skip
    given.completer = _keys  # type: ignore[attr-defined]  # where argcomplete looks for it


def _plots(command: ArgumentParser) -> None:
    drawn = command.add_mutually_exclusive_group()
    drawn.add_argument("--plots", choices=["svg", "png", "pdf"], default="svg",
                       help="format of the plots (default: svg)")  # fmt: skip
    drawn.add_argument("--no-plots", action="store_const", const=False, dest="plots", help="write numbers only")
    _dpi(command)


def _workers(command: ArgumentParser, processes: str) -> None:
    who = command.add_mutually_exclusive_group()
    who.add_argument("-j", "--workers", type=int, metavar="N", help=processes)
    who.add_argument("--cluster", metavar="ADDRESS", help="solve on the cluster of this Dask scheduler, such as "
                     "tcp://10.0.0.1:8786, in place of processes here")  # fmt: skip


def _dpi(command: ArgumentParser) -> None:
    command.add_argument("--dpi", type=_resolution, default=200, metavar="N",
                         help="pixels per inch of PNG plots (default: 200)")  # fmt: skip


def _resolution(text: str) -> int:
    """Return pixels per inch.

    Raises:
        ArgumentTypeError: They are none that pictures have.
    """
    from pinarm.use.show.picture_files import COARSEST, FINEST

    if not text.isdecimal() or not COARSEST <= int(text) <= FINEST:
        raise ArgumentTypeError(f"'{text}' is no resolution: expected a whole number from {COARSEST} to {FINEST}")
    return int(text)


def _sources(prefix: str, **asked: object) -> list[str]:
    """Return how the source of ``new`` may go on: templates, folders and model files."""
    from argcomplete.completers import FilesCompleter

    from pinarm.input.robots import ENDINGS
    from pinarm.use.store.new import templates

    files = FilesCompleter([ending[1:] for ending in (*ENDINGS, ".yaml")])(prefix)
    return [*(name for name in templates() if name.startswith(prefix)), *files]


def _names(prefix: str, parsed_args: Namespace, **asked: object) -> list[str]:
    """Return the names of quantities that may go on a line which has the file of a scenario or a model already."""
    from pinarm.use.study.quantities import quantities

    file = _file(parsed_args)
    if file is None:
        return []
    try:
        known = quantities(file)
    except PinarmError:
        return []
    names = (f"{entry.name}.{part}" if part else entry.name for entry in known for part in entry.components or ("",))
    return [name for name in names if name.startswith(prefix)]


def _keys(prefix: str, parsed_args: Namespace, **asked: object) -> list[str]:
    """Return how a path of keys may go on, on a line which has the file that it leads into already."""
    from pinarm.use.study.dotted_keys import dotted_keys

    file = _file(parsed_args)
    try:
        return dotted_keys(file, prefix) if file is not None and "=" not in prefix else []
    except PinarmError:
        return []


def _file(parsed: Namespace) -> Path | None:
    """Return the scenario or model that a line has; of a result, its scenario."""
    if result := getattr(parsed, "result", None):
        return Path(result) / "scenario.yaml"
    asked = (getattr(parsed, key, None) for key in ("path", "scenario", "paths"))
    given = next(filter(None, asked), None)
    return Path(given[0] if isinstance(given, list) else given) if given else None


def _new(new: ArgumentParser) -> None:
    source = new.add_argument(
        "source", metavar="TEMPLATE|MODEL",
        help="four_bar, slider_crank, scissor_lift, cam or arm; a URDF, xacro, MJCF or SDF file; the name of a robot; "
        "or a mechanism file with a drawing, of which the URDF is written",
    )  # fmt: skip
    source.completer = _sources  # type: ignore[attr-defined]  # where argcomplete looks for it
    new.add_argument("-o", "--output", type=Path,
                     help="folder (default: TEMPLATE, or that of MODEL); files that exist are kept")  # fmt: skip


def _run(run: ArgumentParser) -> None:
    run.add_argument("scenario", type=Path)
    run.add_argument("-o", "--output", type=Path, help="result folder (default: results/SCENARIO)")
    _plots(run)
    run.add_argument("--verify", action="store_true",
                     help="bound the global error by a second solution, and check every row")  # fmt: skip
    _workers(run, "processes for the runs of find and sensitivity (default: none but this one)")
    _values(run)


def _check(check: ArgumentParser) -> None:
    check.add_argument("paths", nargs="+", type=Path, metavar="PATH", help="scenario files, or folders of them")
    _values(check)


def _validate(validate: ArgumentParser) -> None:
    validate.add_argument("paths", nargs="+", type=Path, metavar="PATH")
    _values(validate)


def _explain(explain: ArgumentParser) -> None:
    explain.add_argument("path", metavar="SCENARIO|MODEL")
    explain.add_argument("--draw", type=Path, metavar="FILE", help="draw the mechanism with the names of its parts, "
                         "joints and loops, as .svg, .png or .pdf")  # fmt: skip
    _dpi(explain)
    _values(explain)


def _quantities(quantities: ArgumentParser) -> None:
    quantities.add_argument("path", metavar="SCENARIO|MODEL")
    like = quantities.add_argument(
        "--like", default="", metavar="TEXT", help="part of a name or of a meaning, such as force"
    )
    like.completer = _names  # type: ignore[attr-defined]
    _values(quantities)


def _tradeoff(trade: ArgumentParser) -> None:
    trade.add_argument("scenario", type=Path)
    trade.add_argument("-o", "--output", type=Path, help="folder (default: results/SCENARIO-tradeoff)")
    _workers(trade, "processes for settings and variants, whose times they change (default: none but this one)")
    _plots(trade)
    _values(trade)


def _schema(schema: ArgumentParser) -> None:
    schema.add_argument("of", nargs="?", choices=["scenario", "mechanism"], default="scenario")


def _examples(examples: ArgumentParser) -> None:
    examples.add_argument("-o", "--output", type=Path, default=Path("pinarm-examples"),
                          help="folder (default: pinarm-examples); files that exist are left as they are")  # fmt: skip


def _selftest(selftest: ArgumentParser) -> None:
    """Add nothing: it takes no options of its own."""


def _sweep(sweep: ArgumentParser) -> None:
    sweep.add_argument("scenario", type=Path)
    over = sweep.add_argument("--over", action="append", default=[], metavar="PATH=VALUES",
                       help="such as arguments.m_A='0.1:0.5:41 kg', '1, 2, 3 kg' or 'normal(0.25, 0.01) kg'; "
                       "several are combined")  # fmt: skip
    over.completer = _keys  # type: ignore[attr-defined]
    sweep.add_argument("--cases", type=Path, metavar="CSV", help="a file whose lines are cases; paths in its heading")
    sweep.add_argument("--sample", type=int, metavar="N", help="how many values to draw from distributions")
    sweep.add_argument("--seed", type=int, default=0, help="of the drawing (default: 0)")
    sweep.add_argument("--lhs", action="store_const", const="latin", default="random", dest="sampling",
                       help="draw a Latin hypercube")  # fmt: skip
    taken = sweep.add_argument(
        "--result", action="append", default=[], metavar="QUANTITY[@PLACE]", dest="results",
        help="what to take from each case, such as C_B, 'C_B @ max', 't @ max(C_B)', 'C_B @ t=1.5 s' (default: least "
        "and greatest row of every output)",
    )  # fmt: skip
    taken.completer = _names  # type: ignore[attr-defined]
    _workers(sweep, "processes (default: all cores)")
    sweep.add_argument("-o", "--output", type=Path, help="folder of the sweep (default: results/SCENARIO-sweep)")
    _plots(sweep)
    sweep.add_argument("--parquet", action="store_true", help="write the table as Parquet too, in parts")
    _values(sweep)


def _replay(replay: ArgumentParser) -> None:
    replay.add_argument("result", type=Path, metavar="RESULT", help="result folder")
    replay.add_argument("-o", "--output", type=Path, help="file (default: replay.html or replay.png in the folder)")
    replay.add_argument("--trace", action="extend", nargs="+", default=[], metavar="POINT",
                        help="draw the paths of these links' origins; com: of the centre of mass")  # fmt: skip
    replay.add_argument("--arrows", action="extend", nargs="+", default=[], metavar="KIND",
                        help="draw forces, torques, reactions, or all")  # fmt: skip
    plotted = replay.add_argument("--plot", action="extend", nargs="*", metavar="QUANTITY",
                                  help="plot these beside it, or nothing (default: the outputs)")  # fmt: skip
    plotted.completer = _names  # type: ignore[attr-defined]
    replay.add_argument(
        "--names", action="store_true", help="show names of parts, points and joints; the key N does too"
    )
    instead = replay.add_mutually_exclusive_group()
    instead.add_argument("--png", metavar="t=VALUE", help="write a picture of this instant, by Chromium")
    instead.add_argument("--video", type=Path, metavar="FILE.mp4", help="write a video, by Chromium and ffmpeg")
    replay.add_argument("--fps", type=float, default=30.0, help="pictures a second of the video")
    replay.add_argument("--speed", type=float, default=1.0, help="of the video, relative to real time")


def _report(report: ArgumentParser) -> None:
    report.add_argument("results", nargs="+", type=Path, metavar="RESULT", help="result folders, a chapter each")
    report.add_argument("-o", "--output", type=Path, metavar="FILE", help="report.html with the replay, or report.pdf, "
                        "by Chromium (default: report.html in the folder of a single result)")  # fmt: skip
    report.add_argument("--title", default="", help="its heading (default: that of the first scenario)")


OPTIONS: dict[str, Callable[[ArgumentParser], None]] = {
    "new": _new, "run": _run, "check": _check, "validate": _validate, "explain": _explain, "quantities": _quantities,
    "sweep": _sweep, "tradeoff": _tradeoff, "replay": _replay, "report": _report, "schema": _schema,
    "examples": _examples, "selftest": _selftest,
}  # fmt: skip
"""Command -> what adds its own options."""
