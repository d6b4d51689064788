"""Output of commands: what cannot be written ends a command with words and an exit code."""

from __future__ import annotations

import io
import os
import sys
from typing import TextIO

from pinarm.errors import InputError, printable


def open_streams() -> None:
    """Let no character of a name be an error, and no closed stream."""
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115  (as long as the process)
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # With PYTHONUNBUFFERED, what cannot be written would fail within argparse, which passes over it.
            stream.reconfigure(errors="replace", write_through=False)


def flush_output() -> None:
    """Write what has been printed, while its failure can still be told."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            give_up(stream)
            if stream is sys.stdout:
                raise error if isinstance(error, BrokenPipeError) else unwritable(error) from None


def unwritable(error: OSError) -> InputError:
    """Return the error of a file or stream that the system refuses, in words."""
    what = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else "the output"
    return InputError(f"{what}: {error.strerror or error}")


def give_up(stream: TextIO) -> None:
    """Send what is still to be written to the null device, so that the interpreter does not fail over it at its end."""
    with open(os.devnull, "w") as null:
        os.dup2(null.fileno(), stream.fileno())


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
