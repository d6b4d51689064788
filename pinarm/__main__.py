"""``python -m pinarm``."""

import atexit
import os
import signal
import sys

handler = signal.getsignal(signal.SIGINT)
if handler is signal.default_int_handler:  # Ctrl-C during the imports ends the program, without their traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from pinarm.cli.main import main  # noqa: E402

signal.signal(signal.SIGINT, handler)


def run() -> int:
    """Run a command, and let the process end as soon as its threads and exit handlers have ended; return its code.

    To free all objects one by one, which nobody sees, takes a thirtieth of a short run. What others have registered
    before, such as a measurement of coverage, goes on to be called.
    """
    codes: list[int] = []
    if not atexit._ncallbacks():
        atexit.register(_leave, codes)  # called last, as it is registered first
    codes.append(main())
    return codes[0]


def _leave(codes: list[int]) -> None:
    if codes:  # a command that has returned; others end as Python does
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(codes[0])


if __name__ == "__main__":
    raise SystemExit(run())
