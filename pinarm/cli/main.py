"""The command line: ``run``, ``check``, ``validate``, ``explain``, ``sweep``, ``tradeoff``, ``replay``, ``report`` ...

Exit codes: 0 all is well, 1 an expectation or the wanted accuracy is missed, 2 the input has a mistake or what comes
out cannot be written, 3 the numerics failed (what was computed until then is kept) or a case of a sweep did, 4 the
program has a fault, 130 interrupted, 143 terminated (SIGTERM). Results go to stdout; progress to stderr, where that is
a terminal.
"""

from __future__ import annotations

import argparse
import gc
import io
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, NoReturn, TextIO

from pinarm import __version__
from pinarm.cli.commands import COMMANDS, OK, Answer, pairs_of
from pinarm.cli.options import COMMON
from pinarm.errors import InputError, NumericsError, PinarmError, fault, of_interrupt, printable
from pinarm.input.roots import file_root
from pinarm.language import writing

if TYPE_CHECKING:
    from types import FrameType

NUMERICS_FAILED, FAULT, INTERRUPTED, TERMINATED = 3, 4, 130, 143

EXAMPLES = """examples:
  python -m pinarm new four_bar && python -m pinarm run four_bar/scenario.yaml
  python -m pinarm new my_robot.urdf
  python -m pinarm COMMAND -h
"""
"""Examples at the end of ``-h``."""

INNERMOST = 30
"""Calls that a bug report shows: of a recursion without end all would be 180 kB."""

terminated: list[int] = []
"""SIGTERM, once it has come."""


def program() -> NoReturn:
    """Run one command as a program of its own; SIGTERM ends it as Ctrl-C does, with another exit code."""
    for name in ("MPLBACKEND", "SOURCE_DATE_EPOCH"):  # matplotlib fails over wrong ones; files have no dates
        os.environ.pop(name, None)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)
    sys.exit(main())


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    """End the program as Ctrl-C does; a second SIGTERM ends it at once."""
    signal.signal(number, signal.SIG_DFL)
    terminated.append(number)
    raise KeyboardInterrupt


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; interrupts, and faults of the program, have been reported."""
    gc.set_threshold(100_000, 20, 20)  # importing makes much that stays: looking through it for garbage costs 10 %
    words = sys.argv[1:] if arguments is None else arguments
    if "_ARGCOMPLETE" in os.environ:
        _complete(os.environ.get("COMP_LINE", ""))
    _open_streams()
    try:
        code = _ended(words)
        return TERMINATED if terminated and code == INTERRUPTED else code
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
    return TERMINATED if terminated else INTERRUPTED


def _report_fault(error: Exception) -> None:
    """Print a bug report: where in the program an error arose that no input should cause."""
    import traceback

    lines = traceback.format_exception(error, limit=-INNERMOST)
    _say(
        f"{''.join(lines)}error: pinarm {__version__} has a fault: {fault(error)}\n"
        "  expected: an answer, or a message on what to change in the input\n"
        "  try: please report it, with the lines above and the input files"
    )


def _ended(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code; what went wrong has been told."""
    options = argparse.Namespace(traceback=False)
    try:
        try:
            options = _parser(arguments).parse_args(arguments)
        except SystemExit:  # help has been printed, or what is wrong with the arguments
            _flush_output()
            raise
        with (
            file_root(options.root, pairs_of(options.packages, "--package NAME=DIR")),
            writing(getattr(options, "lang", "")),
        ):
            answer: Answer = options.command(options)
        _show(answer, as_json=options.json)
        _flush_output()
    except BrokenPipeError:  # the reader of our output has seen enough
        _give_up(sys.stdout)
        return OK
    except (PinarmError, OSError) as error:
        if options.traceback:
            raise
        with suppress(PinarmError, BrokenPipeError):
            _flush_output()
        known = _unwritable(error) if isinstance(error, OSError) else error
        _say(f"error: {known}")
        return _keep_partial(known, options)
    return answer.code


def _show(answer: Answer, *, as_json: bool) -> None:
    if as_json:
        from pinarm.use.store.files import json_text

        print(json_text(answer.data))
    elif answer.text:
        print(printable(answer.text))
    for mistake in answer.mistakes:
        _say(f"error: {mistake}")


def _complete(line: str) -> None:
    """Answer a shell that asks for completions of a line, where argcomplete is installed, and end the program."""
    with suppress(ImportError):
        import argcomplete

        argcomplete.autocomplete(_parser(line.split()))


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser: of one command where the arguments begin with it, as all together take time."""
    layout = argparse.RawDescriptionHelpFormatter
    about = "Rigid-multibody simulation of mechanisms."
    parser = argparse.ArgumentParser(prog="pinarm", description=about, epilog=EXAMPLES, formatter_class=layout)
    parser.add_argument("--version", action="version", version=f"pinarm {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", prog="pinarm")
    for name in arguments[:1] if {*arguments[:1]} & {*COMMANDS} else COMMANDS:
        command = COMMANDS[name]
        added = commands.add_parser(name, help=command.text, formatter_class=layout)
        added.set_defaults(command=command.call)
        if name in arguments:
            for add in (*command.options, *COMMON):
                add(added)
            lines = (f"  python -m pinarm {name} {example}".rstrip() for example in command.examples.split("; "))
            added.epilog = "\n".join(["examples:", *lines])
    return parser


def _keep_partial(error: PinarmError, options: argparse.Namespace) -> int:
    """Write what was computed before the numerics failed; return the exit code."""
    from pinarm.use.facade import Result

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


def _open_streams() -> None:
    """Let no character of a name be an error, and no closed stream."""
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115  (as long as the process)
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # With PYTHONUNBUFFERED, what cannot be written would fail within argparse, which passes over it.
            stream.reconfigure(errors="replace", write_through=False)


def _flush_output() -> None:
    """Write what has been printed, while its failure can still be told."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            _give_up(stream)
            if stream is sys.stdout:
                raise error if isinstance(error, BrokenPipeError) else _unwritable(error) from None


def _unwritable(error: OSError) -> InputError:
    """Return the error of a file or stream that the system refuses, in words."""
    what = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else "the output"
    return InputError(f"{what}: {error.strerror or error}")


def _give_up(stream: TextIO) -> None:
    """Send what is still to be written to the null device, so that the interpreter does not fail over it at its end."""
    with open(os.devnull, "w") as null:
        os.dup2(null.fileno(), stream.fileno())


def _say(text: str) -> None:
    """Print text on stderr, where there is room for it: the exit code says the rest."""
    try:
        print(printable(text), file=sys.stderr, flush=True)
    except OSError:
        _give_up(sys.stderr)
