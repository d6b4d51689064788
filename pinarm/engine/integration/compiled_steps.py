"""Steps and dense output by the compiled library: many steps of one or of many motions in one call."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
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


def kernel() -> ctypes.PyDLL:
    """Return the library, which there is where a motion is compiled."""
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
    """The steps that a stepper takes, many in one call; with ``AdaptiveStepper``, those of its pair.

    ``room`` is the largest number of steps of the next call.
    """

    def __init__(self, solution: Solution, stepper: AdaptiveStepper) -> None:
        self.solution, self.stepper = solution, stepper
        self.prepare(FEWEST, stepper.tableau.stages + 1, 2)

    def prepare(self, room: int, rows: int, scratch: int) -> None:
        """Make room for steps of some rows of slopes each.

        Starts, lengths and ends of the steps [s], shape (3, room); how many were rejected before each, and whether
        each was accepted as rounding, shape (room,); states at their starts, shape (room, n); slopes at their stages,
        and those of the step that is tried last, shape (room + 1, rows, n).
        """
        n, self.room = len(self.stepper.y), room
        self.times, self.states, self._scratch = np.empty((3, room)), np.empty((room, n)), np.empty((scratch, n))
        self.slopes, self.rejections = np.zeros((room + 1, rows, n)), np.empty(room, np.intp)
        self.floored = np.empty(room, np.intc)
        places = self.stepper.y, self._scratch, *self.times, self.rejections, self.floored
        self.course = CourseStructure(*5 * [0.0], 0, room, 0, 0, 0, *map(pointer, (*places, self.states, self.slopes)))

    def take(self, index: int, span: Interval, t: float, h: float, tries: int) -> tuple[float, float]:
        """Take as many steps in an interval as there is room for; see ``SingleSteps.take``."""
        flow, course = span.compiled, self.course
        assert flow is not None
        course.t, course.h, course.start, course.end = t, h, span.start, span.end
        course.ceiling, course.tries = self.stepper.ceiling, tries
        course.written = course.rejected = course.handed = 0
        flow.ready()
        evaluations, all_evaluations = self.call(flow, span)
        self._add(index, evaluations, all_evaluations)
        self.stepper.ceiling = course.ceiling
        self.follow(flow, span)
        return course.t, course.h

    def call(self, flow: Flow, span: Interval) -> tuple[Indices, int]:
        """Let the library take the steps; return the evaluations up to the end of each, and those of the call."""
        stepper, course, each = self.stepper, self.course, self.stepper.tableau.stages
        self.slopes[0, 0] = stepper.slopes[0]
        control = ControlStructure(
            stepper.tolerance, span.size, SAFETY, GAIN, SLOWEST, FASTEST, LOST, HUGE, TINY, SHORTEST, NOISE
        )
        kernel().pair_steps(*map(ctypes.byref, (pair_of(stepper.tableau)[0], flow.structure, control, course)))
        stepper.slopes[:] = self.slopes[course.written]
        steps = np.arange(1, course.written + 1)
        evaluations = each * (steps + self.rejections[: course.written]) + flow.settles * steps
        return evaluations, each * (course.written + course.rejected) + flow.settles * course.written

    def _add(self, index: int, evaluations: Indices, all_evaluations: int) -> None:
        """Add the steps that the library has written to the solution, and their cost."""
        count, written = self.solution.count, self.course.written
        floored = self.floored[:written].cumsum()
        work = np.stack([evaluations, self.rejections[:written], floored], axis=1)
        work += [count.evaluations, count.rejected, count.floored]
        times, states, slopes = self.times[:, :written].T, self.states[:written], self.slopes[:written]
        self.solution.steps.extend(times, states, slopes, index, work)
        count.evaluations += all_evaluations
        count.rejected += self.course.rejected
        count.floored += int(floored[-1]) if written else 0

    def follow(self, flow: Flow, interval: Interval) -> None:
        """Let the motion know which states have been settled, let it settle the last one, and make more room."""
        course = self.course
        settled = course.written - course.handed
        if flow.settles and settled:
            flow.advanced(self.times[2, :settled].tolist())
        if course.handed:
            self.stepper.settle(course.t)
            if self.floored[course.written - 1]:
                course.h = max(course.h, interval.floor())
        if course.written == self.room < MOST:
            self.prepare(min(2 * self.room, MOST), self.stepper.tableau.stages + 1, 2)


def terms(tableau: Tableau, flow: Flow, t: Array, h: Array, y: Array, slopes: Array) -> Array:
    """Return the terms of the dense output of n steps, shape (n, d, nq + nv); see ``runge_kutta.dense_terms``."""
    arrays = list(map(contiguous, (t, h, y, slopes)))
    scratch = np.empty((tableau.stages + 2 + len(tableau.dense_c), y.shape[1]))
    values = np.empty((len(y), 3 + len(tableau.dense_d), y.shape[1]))
    addresses = (ctypes.c_void_p(pointer(x)) for x in (*arrays, scratch, values))
    flow.within(float(t[0]))
    parts = map(ctypes.byref, (pair_of(tableau)[0], flow.structure, flow.held(t.tolist())))
    kernel().pair_terms(*parts, ctypes.c_ssize_t(len(y)), *addresses)
    return values
