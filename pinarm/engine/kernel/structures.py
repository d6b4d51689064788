"""The structures of the compiled library, as its headers declare them: ``spatial.h`` to ``runge_kutta.h``."""

from __future__ import annotations

import ctypes

REAL, INT, SIZE, POINTER = ctypes.c_double, ctypes.c_int, ctypes.c_ssize_t, ctypes.c_void_p


class ScrewStructure(ctypes.Structure):
    """A column of the motion subspace of a joint: it slides along, and turns about, an axis of the link's frame."""

    _fields_ = [("axis", INT), ("slide", REAL), ("turn", REAL)]


class LinkStructure(ctypes.Structure):
    """A link with its joint and its body."""

    _fields_ = [
        *((name, INT) for name in ("parent", "kind", "q", "v")), ("rotation", REAL * 9), ("translation", REAL * 3),
        ("mass", REAL), ("moment", REAL * 3), ("inertia", REAL * 6),
    ]  # fmt: skip


class DegreeStructure(ctypes.Structure):
    """A velocity of a joint, and what acts along it."""

    _fields_ = [
        ("screw", ScrewStructure), ("sprung", INT),
        *((name, REAL) for name in ("armature", "effort", "stiffness", "damping", "rest")),
    ]  # fmt: skip


class RotationSpringStructure(ctypes.Structure):
    """A spring of a ball joint."""

    _fields_ = [("q", INT), ("v", INT), ("stiffness", REAL)]


class LinkStateStructure(ctypes.Structure):
    """Buffers of the recursion for a link."""

    _fields_ = [("numbers", REAL * (12 + 18 + 21 + 6))]


class DegreeStateStructure(ctypes.Structure):
    """Buffers of the recursion for a velocity."""

    _fields_ = [("numbers", REAL * 8)]


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


STRUCTURES = (
    ScrewStructure,
    LinkStructure,
    DegreeStructure,
    RotationSpringStructure,
    LinkStateStructure,
    DegreeStateStructure,
    TreeStructure,
    PairStructure,
    FlowStructure,
    ControlStructure,
    CourseStructure,
)
"""In the order of ``kernel_sizes`` in ``kernel.c``."""
