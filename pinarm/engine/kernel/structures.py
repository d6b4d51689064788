"""The structures of the compiled library, as its headers declare them: ``spatial.h`` to ``runge_kutta.h``."""

from __future__ import annotations

import ctypes

import numpy as np

REAL, INT, SIZE, POINTER = ctypes.c_double, ctypes.c_int, ctypes.c_ssize_t, ctypes.c_void_p

SCREW = np.dtype([("axis", np.intc), ("slide", float), ("turn", float)], align=True)
"""A column of the motion subspace of a joint: it slides along, and turns about, an axis of the link's frame."""

LINK = np.dtype([
    *((name, np.intc) for name in ("parent", "kind", "q", "v")), ("rotation", float, (3, 3)), ("translation", float, 3),
    ("mass", float), ("moment", float, 3), ("inertia", float, 6),
], align=True)  # fmt: skip
"""A link with its joint and its body."""

DEGREE = np.dtype([
    ("screw", SCREW), ("sprung", np.intc),
    *((name, float) for name in ("armature", "effort", "stiffness", "damping", "rest")),
], align=True)  # fmt: skip
"""A velocity of a joint, and what acts along it."""

ROTATION_SPRING = np.dtype([("q", np.intc), ("v", np.intc), ("stiffness", float)], align=True)
"""A spring of a ball joint."""

LINK_STATE, DEGREE_STATE = np.dtype((float, 12 + 18 + 21 + 6)), np.dtype((float, 8))
"""Buffers of the recursion for a link, and for a velocity."""


class TreeStructure(ctypes.Structure):
    """A tree of links with its buffers."""

    _fields_ = [
        *((name, INT) for name in ("links", "nq", "nv", "rotation_springs")), ("gravity", REAL * 3),
        *((name, POINTER) for name in ("link", "degree", "rotation_spring", "link_state", "degree_state", "tau")),
    ]  # fmt: skip


class PairStructure(ctypes.Structure):
    """The coefficients of an embedded Runge-Kutta pair."""

    _fields_ = [
        *((name, SIZE) for name in ("stages", "estimates", "dense_stages", "dense_terms", "order")),
        *((name, POINTER) for name in ("a", "b", "c", "error", "dense_a", "dense_c", "dense_d")),
    ]


class FlowStructure(ctypes.Structure):
    """What is integrated."""

    _fields_ = [("n", SIZE), ("rates", POINTER), ("system", POINTER)]


class ControlStructure(ctypes.Structure):
    """The numbers of the step control."""

    _fields_ = [
        (name, REAL)
        for name in ("tolerance", "size", "safety", "gain", "slowest", "fastest", "lost", "huge", "tiny", "shortest")
    ]


class CourseStructure(ctypes.Structure):
    """A motion on an interval: where it is, and where its steps are written."""

    _fields_ = [
        *((name, REAL) for name in ("t", "start", "end", "h", "ceiling")),
        *((name, SIZE) for name in ("tries", "room", "written", "rejected")),
        *((name, POINTER) for name in ("y", "scratch", "starts", "lengths", "ends", "rejections", "states", "slopes")),
    ]


ARRAYS = (SCREW, LINK, DEGREE, ROTATION_SPRING, LINK_STATE, DEGREE_STATE)
STRUCTURES = (TreeStructure, PairStructure, FlowStructure, ControlStructure, CourseStructure)
SIZES = (*(one.itemsize for one in ARRAYS), *map(ctypes.sizeof, STRUCTURES))
"""Sizes [bytes], in the order of ``kernel_sizes`` in ``kernel.c``."""
