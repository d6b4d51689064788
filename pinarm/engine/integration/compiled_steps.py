"""Steps and dense output of embedded pairs by the compiled library: many steps in one call."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.integration.integrator import Interval, Solution
from pinarm.engine.integration.runge_kutta import (
    FASTEST,
    GAIN,
    HUGE,
    LOST,
    NOISE,
    SAFETY,
    SHORTEST,
    SLOWEST,
    TINY,
    Tableau,
)
from pinarm.engine.kernel.library import Flow, contiguous, library, pointer
from pinarm.engine.kernel.structures import ControlStructure, CourseStructure, PairStructure

if TYPE_CHECKING:
    from pinarm.engine.integration.methods.explicit import AdaptiveStepper


FEWEST, MOST = 16, 512
"""Most steps of the first call, and of later ones: each may take twice as many as one that was full. An event that ends
the motion makes the steps after it useless, and memory is taken for all of them."""


def _kernel() -> ctypes.PyDLL:
    compiled = library()
    assert compiled is not None, "a motion is compiled"
    return compiled


@cache
def pair_of(tableau: Tableau) -> tuple[PairStructure, list[Array]]:
    """Return the coefficients of a pair for the library, and the arrays that they point to."""
    names = ("a", "b", "c", "error", "dense_a", "dense_c", "dense_d")
    arrays = [contiguous(getattr(tableau, name)) for name in names]
    counts = tableau.stages, len(tableau.error), len(tableau.dense_c), len(tableau.dense_d)
    return PairStructure(*counts, tableau.error_order + 1, *map(pointer, arrays)), arrays


class CompiledSteps:
    """The steps of ``AdaptiveStepper``, many in one call."""

    def __init__(self, solution: Solution, stepper: AdaptiveStepper) -> None:
        self.solution, self.stepper = solution, stepper
        self._make_room(FEWEST)

    def _make_room(self, room: int) -> None:
        """Make room for the steps of one call.

        Starts, lengths and ends [s], shape (3, room); how many were rejected before each, and whether each was accepted
        as rounding, shape (room,); states at their starts, shape (room, n); slopes at their stages, and those of the
        step that is tried last, shape (room + 1, s + 1, n).
        """
        n, stages = len(self.stepper.y), self.stepper.tableau.stages
        self.times, self.states, self._scratch = np.empty((3, room)), np.empty((room, n)), np.empty((2, n))
        self.slopes, self.rejections = np.zeros((room + 1, stages + 1, n)), np.empty(room, np.intp)
        self.floored = np.empty(room, np.intc)
        places = self.stepper.y, self._scratch, *self.times, self.rejections, self.floored, self.states, self.slopes
        self.course = CourseStructure(*5 * [0.0], 0, room, 0, 0, 0, *map(pointer, places))

    def take(self, index: int, span: Interval, t: float, h: float, tries: int) -> tuple[float, float]:
        """Take as many steps in a span as there is room for; see ``SingleSteps.take``."""
        flow, course, stepper = span.compiled, self.course, self.stepper
        assert flow is not None
        course.t, course.h, course.start, course.end = t, h, span.start, span.end
        course.ceiling, course.tries = stepper.ceiling, tries
        course.written = course.rejected = course.handed = 0
        flow.ready()
        self.slopes[0, 0] = stepper.slopes[0]
        control = ControlStructure(
            stepper.tolerance, span.size, SAFETY, GAIN, SLOWEST, FASTEST, LOST, HUGE, TINY, SHORTEST, NOISE
        )
        _kernel().pair_steps(*map(ctypes.byref, (pair_of(stepper.tableau)[0], flow.structure, control, course)))
        stepper.slopes[:], stepper.ceiling = self.slopes[course.written], course.ceiling
        self._add(index, flow)
        self._settle(flow, span)
        return course.t, course.h

    def _add(self, index: int, flow: Flow) -> None:
        """Add the steps that the library has written to the solution, and their cost."""
        count, written, stages = self.solution.count, self.course.written, self.stepper.tableau.stages
        steps, rejections, floored = np.arange(1, written + 1), self.rejections[:written], self.floored[:written]
        work = np.stack([stages * (steps + rejections) + flow.settles * steps, rejections, floored.cumsum()], axis=1)
        work += [count.evaluations, count.rejected, count.floored]
        self.solution.steps.extend(self.times[:, :written].T, self.states[:written], self.slopes[:written], index, work)
        count.evaluations += stages * (written + self.course.rejected) + flow.settles * written
        count.rejected += self.course.rejected
        count.floored += int(floored.sum())

    def _settle(self, flow: Flow, span: Interval) -> None:
        """Let the motion know which states have been settled, let it settle the last one, and make more room."""
        course = self.course
        settled = course.written - course.handed
        if flow.settles and settled:
            flow.advanced(self.times[2, :settled].tolist())
        if course.handed:
            self.stepper.settle(course.t)
            if self.floored[course.written - 1]:
                course.h = max(course.h, span.floor())
        if course.written == course.room < MOST:
            self._make_room(2 * course.room)


def terms(tableau: Tableau, flow: Flow, t: Array, h: Array, y: Array, slopes: Array) -> Array:
    """Return the terms of the dense output of n steps, shape (n, d, nq + nv); see ``runge_kutta.dense_terms``."""
    arrays = list(map(contiguous, (t, h, y, slopes)))
    scratch = np.empty((tableau.stages + 2 + len(tableau.dense_c), y.shape[1]))
    values = np.empty((len(y), 3 + len(tableau.dense_d), y.shape[1]))
    size = 1 if flow.changes else len(y)
    for begin in range(0, len(y), size):
        flow.within(float(t[begin]))
        some = [x[begin : begin + size] for x in arrays]
        addresses = (ctypes.c_void_p(pointer(x)) for x in (*some, scratch, values[begin:]))
        parts = map(ctypes.byref, (pair_of(tableau)[0], flow.structure))
        _kernel().pair_terms(*parts, ctypes.c_ssize_t(size), *addresses)
    return values
