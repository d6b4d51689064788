"""Structures of the compiled library, as its headers declare them, and checks of what is put into them."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


REAL, INT, SIZE, POINTER = ctypes.c_double, ctypes.c_int, ctypes.c_ssize_t, ctypes.c_void_p

SCREW = np.dtype([("axis", np.intc), ("slide", float), ("turn", float)], align=True)
"""A column of the motion subspace of a joint: it slides along, and turns about, an axis of the link's frame."""

_BODY = ("mass", float), ("moment", float, 3), ("inertia", float, 6)

BODY = np.dtype([*_BODY])
"""A rigid body."""

LINK = np.dtype([
    *((name, np.intc) for name in ("parent", "kind", "q", "v")), ("rotation", float, (3, 3)), ("translation", float, 3),
    *_BODY,
], align=True)  # fmt: skip
"""A link with its joint and its body."""

DEGREE = np.dtype(
    [
        ("screw", SCREW),
        ("sprung", np.intc),
        *((name, float) for name in ("armature", "effort", "stiffness", "damping", "rest")),
    ],
    align=True,
)
"""A velocity of a joint, and what acts along it."""

ROTATION_SPRING = np.dtype([("q", np.intc), ("v", np.intc), ("stiffness", float)], align=True)
"""A spring of a ball joint."""

POINT_SPRING = np.dtype(
    [
        ("link", np.intc, 2),
        ("place", float, (2, 3)),
        *((name, float) for name in ("stiffness", "damping", "rest", "pull")),
    ],
    align=True,
)
"""A spring between two points."""

LAW_TERMS = 8
"""Most coefficients of a law."""

LAW_BOUNDS = ["from", "until"]
"""The instants from and until which a law holds; infinite where nothing bounds it."""

LAW = np.dtype(
    [
        ("v", np.intc),
        ("q", np.intc),
        *((name, float) for name in (*LAW_BOUNDS, "steady", "start", "size", "origin", "unit", "amplitude", "phase")),
        ("coefficients", float, LAW_TERMS),
    ],
    align=True,
)
"""A law over time, of an effort or a coordinate."""

LINK_STATE = np.dtype([
    ("in_parent", float, 12), ("rotation", float, (3, 3)), ("translation", float, 3), ("velocity", float, 6),
    ("acceleration", float, 6), ("change", float, 6), ("inertia", float, 21), ("bias", float, 6),
])  # fmt: skip
"""Buffers of the recursion for a link; rotation and translation are those in the world."""

DEGREE_STATE = np.dtype((float, 7))
"""Buffers of the recursion for an unknown, a velocity or a multiplier."""

MOST_ROWS = 6
"""Most rows of a loop joint."""

LOOP = np.dtype([
    ("kind", np.intc), ("rows", np.intc), ("link", np.intc, 2),
    *((name, np.intc) for name in ("first", "end", "path", "links", "support", "degrees", "tail", "own", "coupled")),
    ("frame", [("rotation", float, (3, 3)), ("translation", float, 3)], 2),
    ("along", float, (MOST_ROWS, 3)), ("about", float, (MOST_ROWS, 3)), ("axis", float, 3), ("size", float),
], align=True)  # fmt: skip
"""A joint that closes a loop."""

LOOP_STATE, FORCE = np.dtype((float, 3 + 9 + 18 * MOST_ROWS + 12)), np.dtype((float, 6))
"""Buffers for a loop joint, and for a force."""


class TreeStructure(ctypes.Structure):
    """A tree of links with its buffers."""

    _fields_ = [
        *((name, INT) for name in ("links", "nq", "nv", "rotation_springs", "point_springs", "laws")),
        *((name, POINTER) for name in ("link", "degree", "rotation_spring", "point_spring", "law")),
        *((name, POINTER) for name in ("link_state", "degree_state", "tau")),
    ]


class SkylineStructure(ctypes.Structure):
    """A symmetric matrix whose rows are stored from their first entry on."""

    _fields_ = [
        ("rows", SIZE),
        *((name, POINTER) for name in ("first", "origin", "entry", "factor")),
    ]


class ProximalStructure(ctypes.Structure):
    """Settings of the proximal iteration for multipliers."""

    _fields_ = [("term", REAL), ("accuracy", REAL), ("repeats", INT)]


class LimitsStructure(ctypes.Structure):
    """When a position is regular, and how a singular one is passed."""

    _fields_ = [
        *((name, REAL) for name in ("usual", "near", "ahead", "blind", "vanished", "accuracy")),
        ("aside", REAL),
        ("across", REAL * 8),
        ("passed", REAL),
        ("floor", REAL),
        ("rank", INT),
    ]


class ConstraintsStructure(ctypes.Structure):
    """A tree with loops, and its buffers."""

    _fields_ = [
        ("tree", POINTER),
        ("loops", INT),
        ("inner", INT),
        *((name, POINTER) for name in ("loop", "path", "unknown", "weight_of", "loop_state")),
        ("squares", SkylineStructure),
        *((name, POINTER) for name in ("unit", "weight", "carried", "reduced", "spread")),
        *((name, POINTER) for name in ("response", "right", "multiplier", "part")),
    ]


class ClosingStructure(ctypes.Structure):
    """A motion along loops."""

    _fields_ = [
        ("rows", ConstraintsStructure),
        ("exact", ProximalStructure),
        ("tolerant", ProximalStructure),
        *((name, REAL) for name in ("projection", "closed", "stalled", "torn")),
        ("corrections", INT),
        ("limits", LimitsStructure),
        *((name, POINTER) for name in ("scale", "sum", "part", "aside", "state", "saved")),
        ("near", INT),
        *((name, REAL) for name in ("regular", "open", "t", "step", "floor")),
    ]


class PairStructure(ctypes.Structure):
    """The coefficients of an embedded Runge-Kutta pair."""

    _fields_ = [
        *((name, SIZE) for name in ("stages", "estimates", "dense_stages", "dense_terms", "order")),
        *((name, POINTER) for name in ("a", "b", "c", "error", "dense_a", "dense_c", "dense_d")),
    ]


class FlowStructure(ctypes.Structure):
    """A differential equation to integrate."""

    _fields_ = [("n", SIZE), *((name, POINTER) for name in ("rates", "settle", "floor", "system"))]


class ControlStructure(ctypes.Structure):
    """The numbers of the step control."""

    _fields_ = [
        *((name, REAL) for name in ("tolerance", "size", "safety", "gain", "slowest", "fastest")),
        *((name, REAL) for name in ("lost", "huge", "tiny", "shortest", "noise")),
    ]


class CourseStructure(ctypes.Structure):
    """A motion on an interval: where it is, and where its steps are written."""

    _fields_ = [
        *((name, REAL) for name in ("t", "start", "end", "h", "ceiling")),
        *((name, SIZE) for name in ("tries", "room", "written", "rejected", "handed")),
        *((name, POINTER) for name in ("y", "scratch", "starts", "lengths", "ends")),
        *((name, POINTER) for name in ("rejections", "floored", "states", "slopes")),
    ]


ARRAYS = (
    SCREW, BODY, LINK, DEGREE, ROTATION_SPRING, POINT_SPRING, LAW, LINK_STATE, DEGREE_STATE, LOOP, LOOP_STATE, FORCE,
)  # fmt: skip
STRUCTURES = (
    TreeStructure,
    SkylineStructure,
    ConstraintsStructure,
    ClosingStructure,
    PairStructure,
    FlowStructure,
    ControlStructure,
    CourseStructure,
)
SIZES = (*(kind.itemsize for kind in ARRAYS), *map(ctypes.sizeof, STRUCTURES))
"""Sizes [bytes], in the order of ``kernel_sizes`` in ``kernel.c``."""


def finite(records: NDArray[Any]) -> bool:
    """Return whether all numbers of records are finite, those of records in them too; bounds of laws need not be."""
    if records.dtype.names is None:
        return bool(np.isfinite(records).all())
    return all(finite(records[name]) for name in records.dtype.names if name not in LAW_BOUNDS)
