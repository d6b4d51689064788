"""The compiled library, which an installation may lack."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kernel.structures import SIZES, FlowStructure
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

SWITCH = "PINARM_KERNEL"
"""Environment variable: ``off`` leaves the library out, when pinarm is built and when it runs."""

PATH = Path(__file__).parent / "c" / ("kernel.dylib" if sys.platform == "darwin" else "kernel.so")
"""The library, as the build writes it; beside the sources, where Python does not take it for one of its modules."""


PLACES = ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p
RATES, SETTLE = ctypes.PYFUNCTYPE(None, *PLACES), ctypes.PYFUNCTYPE(ctypes.c_int, *PLACES)
"""Functions ``rates`` and ``settle`` of a flow, by their addresses: system, time, y and its slope."""


class Flow(Record, frozen=True):
    """Differential equation for the library: y = [q, v], with the slope ``[velocity(q, v), a(q, v)]``."""

    unshown: ClassVar[tuple[str, ...]] = ("system",)
    changes: ClassVar[bool] = False
    """Whether its loads may be others in each step; see ``within``."""

    structure: FlowStructure
    system: Any

    @property
    def settles(self) -> bool:
        """Whether accepted states are brought back onto constraints."""
        return bool(self.structure.settle)

    def ready(self) -> None:
        """Bring the system to the present state of the motion."""

    def slope(self, t: float, y: Array) -> Array:
        self.ready()
        return self.rates(t, y)

    def slopes(self, starts: Array, t: Array, y: Array) -> Array:
        """Return the slopes of n states at instants t [s], within steps by their starts [s]."""
        slopes = np.empty_like(y)
        for k, (start, instant) in enumerate(zip(starts.tolist(), t.tolist(), strict=True)):
            self.within(start)
            slopes[k] = self.rates(instant, y[k])
        return slopes

    def rates(self, t: float, y: Array) -> Array:
        rates, state, slope, places = self._evaluation
        state[:] = y
        rates(self.structure.system, t, *places)
        return slope.copy()

    @cached_property
    def _evaluation(self) -> tuple[Any, Array, Array, tuple[int, int]]:
        state, slope = np.zeros((2, self.structure.n))
        return RATES(self.structure.rates), state, slope, (pointer(state), pointer(slope))

    def within(self, start: float) -> None:
        """Let rates be those of further stages in the step that begins at an instant [s]."""

    def advanced(self, ends: Sequence[float]) -> None:
        """Note that steps have been taken to, and settled at, these instants [s]."""


LEFT_OUT = "not built: no C compiler, one that failed, or PINARM_KERNEL=off"


@cache
def library() -> ctypes.PyDLL | None:
    """Return the library; ``None`` where there is none, it does not fit, or ``PINARM_KERNEL=off`` switches it off.

    It keeps Python's lock while it computes: the buffers of a mechanism serve one thread at a time.
    """
    if os.environ.get(SWITCH) == "off" or not PATH.exists():
        return None
    try:
        loaded = ctypes.PyDLL(str(PATH))
        if ctypes.c_int.in_dll(loaded, "kernel_sizes").value != len(SIZES):
            return None
        sizes = (ctypes.c_int * (1 + len(SIZES))).in_dll(loaded, "kernel_sizes")
    except (OSError, ValueError):  # it is of another system, or of another version
        return None
    return loaded if tuple(sizes[1:]) == SIZES else None


def absence() -> str:
    """Return why the library is not used, in words; empty where it is."""
    if library() is not None:
        return ""
    if os.environ.get(SWITCH) == "off":
        return f"switched off by {SWITCH}=off"
    return f"{PATH.name} is of another version or system" if PATH.exists() else LEFT_OUT


def address(function: Any) -> int | None:
    """Return the address of a function of the library; ``None`` for none."""
    return ctypes.cast(function, ctypes.c_void_p).value


def pointer(array: NDArray[Any]) -> int:
    """Return the address of the numbers of an array, which follow one another."""
    if not array.flags.c_contiguous:
        raise ValueError("the numbers of an array that the library reads must follow one another")
    return int(array.ctypes.data)


def contiguous(values: Array) -> Array:
    """Return numbers as the library reads them: one after another, of 64 bits."""
    return np.ascontiguousarray(values, dtype=np.float64)
