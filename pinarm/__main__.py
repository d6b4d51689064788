"""``python -m pinarm``."""

import signal

handler = signal.getsignal(signal.SIGINT)
if handler is signal.default_int_handler:  # Ctrl-C during the imports ends the program, without their traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from pinarm.cli.main import program  # noqa: E402

signal.signal(signal.SIGINT, handler)

if __name__ == "__main__":
    program()
