"""Runs of several threads take turns: buffers of a mechanism serve one at a time.

Python's lock does not let two compute at once in any case.
"""

from __future__ import annotations

import os
from threading import RLock

_turn = RLock()
"""Held by the thread that computes."""


def _free_turn() -> None:
    """Let a process that was forked while another thread computed compute itself."""
    global _turn
    _turn = RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free_turn)


def one_run() -> RLock:
    """Return the lock of what computes with the buffers of a mechanism, for a ``with`` block."""
    return _turn
