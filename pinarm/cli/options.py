"""Options that several commands share, how a shell completes them, and how far a command is."""

from __future__ import annotations

import sys
from argparse import Namespace, _ActionsContainer
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pinarm.errors import PinarmError, printable

Option = Callable[[_ActionsContainer], None]
"""Adds an option to a parser."""


def arg(*names: str, complete: Callable[..., list[str]] | None = None, **settings: Any) -> Option:
    """Return an option; see ``argparse``. ``complete`` tells argcomplete how it may go on."""

    def add(parser: _ActionsContainer) -> None:
        parser.add_argument(*names, **settings).completer = complete  # type: ignore[attr-defined]

    return add


def flag(name: str, text: str) -> Option:
    """Return an option without a value."""
    return arg(name, action="store_true", help=text)


def either(*options: Option) -> Option:
    """Return options of which a line has one at most."""

    def add(parser: _ActionsContainer) -> None:
        group = parser.add_mutually_exclusive_group()
        for option in options:
            option(group)

    return add


def output(text: str, **settings: Any) -> Option:
    """Return the option that names the file or folder to write."""
    return arg("-o", "--output", type=Path, help=text, **settings)


def workers(processes: str) -> Option:
    """Return the options for processes here, or a cluster."""
    text = "solve on the cluster of this Dask scheduler, such as tcp://10.0.0.1:8786, in place of processes here"
    return either(
        arg("-j", "--workers", type=int, metavar="N", help=processes), arg("--cluster", metavar="ADDRESS", help=text)
    )


def sources(prefix: str, **_: object) -> list[str]:
    """Return completions of the source of ``new``: templates, folders and model files."""
    from argcomplete.completers import FilesCompleter

    from pinarm.input.roots import ENDINGS
    from pinarm.use.start.new import templates

    files = FilesCompleter([ending[1:] for ending in (*ENDINGS, ".yaml")])(prefix)
    return [*(name for name in templates() if name.startswith(prefix)), *files]


def names(prefix: str, parsed_args: Namespace, **_: object) -> list[str]:
    """Return the names of quantities that may go on a line which has the file of a scenario or a model already."""
    from pinarm.use.study.quantities import quantities

    file = _file(parsed_args)
    try:
        entries = quantities(file) if file is not None else ()
    except PinarmError:
        return []
    texts = (f"{entry.name}.{part}" if part else entry.name for entry in entries for part in entry.components or ("",))
    return [text for text in texts if text.startswith(prefix)]


def keys(prefix: str, parsed_args: Namespace, **_: object) -> list[str]:
    """Return completions of a path of keys into the file that the line already has."""
    from pinarm.use.study.quantities import dotted_keys

    file = _file(parsed_args)
    try:
        return dotted_keys(file, prefix) if file is not None and "=" not in prefix else []
    except PinarmError:
        return []


def _file(parsed: Namespace) -> Path | None:
    if result := getattr(parsed, "result", None):
        return Path(result) / "scenario.yaml"
    named = (getattr(parsed, key, None) for key in ("path", "scenario", "paths"))
    first = next(filter(None, named), None)
    return Path(first[0] if isinstance(first, list) else first) if first else None


DOTS = "a key that has dots in quotes: 'problem.motion.\"tcp.y\".value=3 mm'"
SET_TEXT = f"replace a value of the scenario, such as problem.time.end='3 s'; {DOTS}"

SCENARIO, PATH = arg("scenario", type=Path), arg("path", metavar="SCENARIO|MODEL")

VALUES = arg("--set", action="append", default=[], metavar="KEY=VALUE", dest="values", help=SET_TEXT, complete=keys)

LANG_TEXT = "language of the document: en or fr (default: the scenario's key lang, else en)"

LANG = arg("--lang", choices=["en", "fr"], default="", help=LANG_TEXT)

DPI = arg("--dpi", type=int, default=200, metavar="N", help="pixels per inch of PNG plots (default: 200)")

PLOTS = either(
    arg("--plots", choices=["svg", "png", "pdf"], default="svg", help="format of the plots (default: svg)"),
    arg("--no-plots", action="store_const", const=False, dest="plots", help="write numbers only"),
)

ROOT_TEXT = "the nearest one above with a pyproject.toml or .pinarm-root, else the working folder"

COMMON = (
    flag("--traceback", "show where in the program an error arose"),
    arg("--root", metavar="DIR", help=f"folder that files may refer to (default: {ROOT_TEXT})"),
    arg(
        "--package",
        metavar="NAME=DIR",
        action="append",
        default=[],
        dest="packages",
        help="folder of a package of ROS that models refer to",
    ),
    flag("--json", "print JSON for machines"),
)
"""Options of all commands."""


def progress(text: str) -> None:
    """Show on a terminal how far a command is, in place of what was there."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{printable(text)}", end="", file=sys.stderr, flush=True)
