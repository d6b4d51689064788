"""The compiled library, which an installation may lack, and its structures, as its headers declare them."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Sequence
from functools import cache, cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pinarm.arrays import Array, in_one
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pinarm.mechanics.forces.force_element import HeldLoad

SWITCH = "PINARM_KERNEL"
"""Environment variable: ``off`` leaves the library out, when pinarm is built and when it runs."""

PATH = Path(__file__).parent / "c" / ("kernel.dylib" if sys.platform == "darwin" else "kernel.so")
"""The library, as the build writes it; beside the sources, where Python does not take it for one of its modules."""

LEFT_OUT = "not built: no C compiler, one that failed, or PINARM_KERNEL=off"

REAL, INT, SIZE, POINTER = ctypes.c_double, ctypes.c_int, ctypes.c_ssize_t, ctypes.c_void_p


def _fields(kind: Any, names: str, *shape: Any) -> list[Any]:
    return [(name, kind, *shape) for name in names.split()]


SCREW = np.dtype([*_fields(np.intc, "axis"), *_fields(float, "slide turn")], align=True)
"""A column of the motion subspace of a joint: it slides along, and turns about, an axis of the link's frame."""

_FRAME = [("rotation", float, (3, 3)), ("translation", float, 3)]
_BODY = [("mass", float), ("moment", float, 3), ("inertia", float, 6)]

BODY = np.dtype(_BODY)
"""A rigid body."""

LINK = np.dtype([*_fields(np.intc, "parent kind q v"), *_FRAME, *_BODY], align=True)
"""A link with its joint and its body."""

DEGREE = np.dtype(
    [("screw", SCREW), ("sprung", np.intc), *_fields(float, "armature effort stiffness damping rest")], align=True
)
"""A velocity of a joint, and what acts along it."""

ROTATION_SPRING = np.dtype([*_fields(np.intc, "q v"), ("stiffness", float)], align=True)
"""A spring of a ball joint."""

POINT_SPRING = np.dtype(
    [("link", np.intc, 2), ("place", float, (2, 3)), *_fields(float, "stiffness damping rest pull")], align=True
)
"""A spring between two points."""

LAW_TERMS = 8
"""Most coefficients of a law."""

LAW_BOUNDS = "from until"
"""The instants from and until which a law holds; infinite where nothing bounds it."""

LAW_NUMBERS = "start size origin unit amplitude phase"

LAW = np.dtype(
    [
        *_fields(np.intc, "v q"),
        *_fields(float, f"{LAW_BOUNDS} steady {LAW_NUMBERS}"),
        ("coefficients", float, LAW_TERMS),
    ],
    align=True,
)
"""A law over time, of an effort or a coordinate."""

LINK_STATE = np.dtype([
    ("in_parent", float, 12), *_FRAME, *_fields(float, "velocity acceleration change", 6), ("inertia", float, 21),
    ("bias", float, 6),
])  # fmt: skip
"""Buffers of the recursion for a link; rotation and translation are those in the world."""

DEGREE_STATE = np.dtype((float, 7))
"""Buffers of the recursion for an unknown, a velocity or a multiplier."""

MOST_ROWS = 6
"""Most rows of a loop joint."""

LOOP = np.dtype(
    [
        *_fields(np.intc, "kind rows"),
        ("link", np.intc, 2),
        *_fields(np.intc, "first end path links support degrees tail own coupled"),
        ("frame", _FRAME, 2),
        *_fields(float, "along about", (MOST_ROWS, 3)),
        ("axis", float, 3),
        ("size", float),
    ],
    align=True,
)
"""A joint that closes a loop."""

LOOP_STATE, FORCE = np.dtype((float, 3 + 9 + 18 * MOST_ROWS + 12)), np.dtype((float, 6))
"""Buffers for a loop joint, and for a force."""


class TreeStructure(ctypes.Structure):
    """A tree of links with its buffers."""

    _fields_ = [
        *_fields(INT, "links nq nv rotation_springs point_springs laws"),
        *_fields(POINTER, "link degree rotation_spring point_spring law link_state degree_state tau"),
    ]


class SkylineStructure(ctypes.Structure):
    """A symmetric matrix whose rows are stored from their first entry on."""

    _fields_ = [("rows", SIZE), *_fields(POINTER, "first origin entry factor")]


class ProximalStructure(ctypes.Structure):
    """Settings of the proximal iteration for multipliers."""

    _fields_ = [*_fields(REAL, "term accuracy"), ("repeats", INT)]


class LimitsStructure(ctypes.Structure):
    """When a position is regular, and how a singular one is passed."""

    _fields_ = [
        *_fields(REAL, "usual near ahead blind vanished accuracy aside"),
        ("across", REAL * 8),
        *_fields(REAL, "passed floor"),
        ("rank", INT),
    ]


class ConstraintsStructure(ctypes.Structure):
    """A tree with loops, and its buffers."""

    _fields_ = [
        ("tree", POINTER),
        *_fields(INT, "loops inner"),
        *_fields(POINTER, "loop path unknown weight_of loop_state"),
        ("squares", SkylineStructure),
        *_fields(POINTER, "unit weight carried reduced spread response right multiplier part"),
    ]


class ClosingStructure(ctypes.Structure):
    """A motion along loops."""

    _fields_ = [
        ("rows", ConstraintsStructure),
        *_fields(ProximalStructure, "exact tolerant"),
        *_fields(REAL, "projection closed stalled torn"),
        ("corrections", INT),
        ("limits", LimitsStructure),
        *_fields(POINTER, "scale sum part aside state saved"),
        *_fields(INT, "near met"),
        *_fields(REAL, "regular open t step floor"),
    ]


class PairStructure(ctypes.Structure):
    """The coefficients of an embedded Runge-Kutta pair."""

    _fields_ = [
        *_fields(SIZE, "stages estimates order"),
        *_fields(POINTER, "a b c error"),
    ]


class FlowStructure(ctypes.Structure):
    """A differential equation to integrate."""

    _fields_ = [("n", SIZE), *_fields(POINTER, "rates settle floor system")]


class ControlStructure(ctypes.Structure):
    """The numbers of the step control."""

    _fields_ = _fields(REAL, "tolerance size safety gain slowest fastest lost huge tiny shortest noise")


class CourseStructure(ctypes.Structure):
    """A motion on an interval: where it is, and where its steps are written."""

    _fields_ = [
        *_fields(REAL, "t start end h ceiling"),
        *_fields(SIZE, "tries room written rejected handed"),
        *_fields(POINTER, "y scratch starts lengths ends rejections floored states slopes"),
    ]


ARRAYS = (
    SCREW, BODY, LINK, DEGREE, ROTATION_SPRING, POINT_SPRING, LAW, LINK_STATE, DEGREE_STATE, LOOP, LOOP_STATE, FORCE,
)  # fmt: skip
STRUCTURES = (
    TreeStructure, SkylineStructure, ConstraintsStructure, ClosingStructure, PairStructure, FlowStructure,
    ControlStructure, CourseStructure,
)  # fmt: skip
SIZES = (*(kind.itemsize for kind in ARRAYS), *map(ctypes.sizeof, STRUCTURES))
"""Sizes [bytes], in the order of ``kernel_sizes`` in ``kernel.c``."""

PLACES = ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p
RATES, SETTLE = ctypes.PYFUNCTYPE(None, *PLACES), ctypes.PYFUNCTYPE(ctypes.c_int, *PLACES)
"""Functions ``rates`` and ``settle`` of a flow, by their addresses: system, time, y and its slope."""

SLOPES = ctypes.PYFUNCTYPE(None, ctypes.c_void_p, ctypes.c_ssize_t, *3 * [ctypes.c_void_p])
"""Function ``flow_slopes`` by its address: flow, number of rows, times, y and slopes."""


class HeldEfforts(Record, frozen=True):
    """Loads that are held between samples, the sum of the steady ones, and efforts as the library reads them, (nv,)."""

    loads: HeldLoad
    steady: Array
    efforts: Array


class Flow(Record, frozen=True):
    """Differential equation for the library: y = [q, v], with the slope ``[velocity(q, v), a(q, v)]``.

    ``system`` is what the structure points to; ``held`` are loads that are held between samples.
    """

    unshown: ClassVar[tuple[str, ...]] = ("system",)

    structure: FlowStructure
    system: Any
    held: HeldEfforts | None

    @property
    def settles(self) -> bool:
        """Whether accepted states are brought back onto constraints."""
        return bool(self.structure.settle)

    @property
    def begun(self) -> bool:
        """Whether the library knows where the motion is, or need not."""
        return True

    def ready(self) -> None:
        """Bring the system to the present state of the motion, with the loads in force."""
        if self.held:
            np.add(self.held.steady, self.held.loads.present, out=self.held.efforts)

    def slope(self, t: float, y: Array) -> Array:
        self.ready()
        return self.rates(t, y)

    def slopes(self, starts: Array, t: Array, y: Array) -> Array:
        """Return the slopes of n states at instants t [s], within steps by their starts [s]."""
        alone = range(1, len(t)) if self.held else ()  # each step has its own loads
        parts = []
        for some in (slice(*ends) for ends in pairwise((0, *alone, len(t)))):
            self.within(float(starts[some.start]))
            parts.append(self.all_rates(t[some], y[some]))
        return in_one(parts)

    def all_rates(self, t: Array, y: Array) -> Array:
        """Return the slopes of n states at instants t [s], with the loads in force."""
        call, (times, states, slopes), places = self._many(len(t))
        times[:], states[:] = t, y
        call(ctypes.addressof(self.structure), len(t), *places)
        return slopes.copy()

    @cached_property
    def _many(self) -> Callable[[int], tuple[Any, tuple[Array, Array, Array], tuple[int, ...]]]:
        """The function for some number of states, its arrays, and the addresses of their numbers."""

        def room(count: int) -> tuple[Any, tuple[Array, Array, Array], tuple[int, ...]]:
            compiled, n = library(), self.structure.n
            function = address(compiled.flow_slopes) if compiled else None
            assert function is not None
            arrays = np.empty(count), np.empty((count, n)), np.empty((count, n))
            return SLOPES(function), arrays, tuple(map(pointer, arrays))

        return lru_cache(maxsize=4)(room)

    def rates(self, t: float, y: Array) -> Array:
        return np.asarray(self.all_rates(np.array([t]), y[None])[0])

    def within(self, start: float) -> None:
        """Let rates be those of further stages in the step that begins at an instant [s]."""
        if self.held:
            loads = self.held.loads
            self.held.efforts[:] = self.held.steady + loads.load_of(np.array([loads.piece(start)]))[0]

    def advanced(self, ends: Sequence[float]) -> None:
        """Note that steps have been taken to, and settled at, these instants [s]."""


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


def finite(records: NDArray[Any]) -> bool:
    """Return whether all numbers of records are finite, those of records in them too; bounds of laws need not be."""
    if records.dtype.names is None:
        return bool(np.isfinite(records).all())
    return all(finite(records[name]) for name in records.dtype.names if name not in LAW_BOUNDS.split())
