"""Output streams that are closed, full, or not for every character: a command ends with words and an exit code."""

from __future__ import annotations

import atexit
import io
import os
import signal
import sys
import threading
from contextlib import suppress
from typing import NoReturn, TextIO

from pinarm.errors import InputError, printable


def open_streams() -> None:
    """Replace streams that the caller has closed by the null device, and let no character of a name be an error.

    Otherwise the next file that is opened would get the number of a closed stream, and what is printed.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_WRONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, mode)
            if null != number:
                os.dup2(null, number)
                os.close(null)
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115  (as long as the process)
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal without Unicode shows question marks instead of failing. With PYTHONUNBUFFERED, what cannot be
            # written would fail within argparse, which passes over it.
            stream.reconfigure(errors="replace", write_through=False)


def flush_output() -> None:
    """Write what has been printed, while its failure can still be told.

    Raises:
        InputError: It cannot be written, as to a full disk.
        BrokenPipeError: Its reader has gone.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        give_up(sys.stdout)
        raise error if isinstance(error, BrokenPipeError) else unwritable(error) from None
    try:
        sys.stderr.flush()
    except OSError:  # the exit code says the rest
        give_up(sys.stderr)


def unwritable(error: OSError) -> InputError:
    """Return the error of a file or stream that the system refuses, in words."""
    what = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else "the output"
    return InputError(f"{what}: {error.strerror or error}")


def give_up(stream: TextIO) -> None:
    """Send what is still to be written to the null device, so that the interpreter does not fail over it at its end."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)


def leave(code: int) -> NoReturn:
    """End the program with an exit code, without taking the interpreter apart, which takes 10 ms.

    What was registered for the exit is done. Where other threads run, or a profiler or debugger has started the
    command, the program ends in the usual way. An interrupt ends it at once, as nothing is left to be told.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if threading.active_count() > 1 or sys.flags.inspect or not _started_alone():
        raise SystemExit(code)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(code)


def _started_alone() -> bool:
    """Tell whether Python was started with this program, as ``python -m pinarm`` or as its script."""
    return sys.orig_argv[1:3] == ["-m", "pinarm"] or sys.orig_argv[1:2] == sys.argv[:1] != ["-c"]


def say(text: str) -> None:
    """Print text on stderr, where there is room for it: the exit code says the rest."""
    try:
        print(printable(text), file=sys.stderr, flush=True)
    except OSError:
        give_up(sys.stderr)


def progress(text: str) -> None:
    """Show on a terminal how far a command is, in place of what was there."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{printable(text)}", end="", file=sys.stderr, flush=True)
