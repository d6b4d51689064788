"""Layer 1: the vocabulary of mechanics: models, coordinates, motions, forces, drives. Importing it loads Pinocchio."""

import os
import sys

SLEEPING = {"OMP_WAIT_POLICY": "passive", "GOMP_SPINCOUNT": "20000", "OPENBLAS_THREAD_TIMEOUT": "18"}
"""Busy waiting of idle threads before they sleep. OpenMP (calls on many states): 20,000 turns of a loop, 0.1 to 0.4 ms;
OpenBLAS (linear algebra): 2^18 ticks of the processor's clock, 0.1 ms."""


def _load_pinocchio() -> None:
    """Load Pinocchio, and with it OpenMP, numpy and OpenBLAS, which read these variables only then.

    The environment stays as it was. As GNU's OpenMP waits by itself, busily for 300,000 turns, a call with two threads
    takes 10 ms of processor time in place of 5, and on a busy machine 80 ms in place of 50 (``abaInParallel``, 1,500
    states of 6 joints, two cores). To wake a thread takes 75 us. OpenBLAS's threads wait by themselves for 2^28 ticks,
    0.13 s, from when numpy is loaded and after every shared product. Whoever sets ``OMP_WAIT_POLICY``, or imports
    Pinocchio or numpy first, has it as they say.
    """
    if "pinocchio" in sys.modules or "OMP_WAIT_POLICY" in os.environ:
        return
    added = {name: value for name, value in SLEEPING.items() if name not in os.environ}
    os.environ.update(added)
    try:
        import pinocchio  # noqa: F401
    finally:
        for name in added:
            del os.environ[name]


_load_pinocchio()
