"""Steps and dense output of embedded pairs by the compiled library: many steps in one call."""

from __future__ import annotations

import ctypes
from functools import cache
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from pinarm.arrays import Array, Indices
from pinarm.engine.integration.integrator import EmbeddedPair, Interval, Solution
from pinarm.engine.integration.step_control import FASTEST, GAIN, HUGE, LOST, NOISE, SAFETY, SHORTEST, SLOWEST, TINY
from pinarm.engine.integration.tableaus import Tableau
from pinarm.engine.kernel.library import Flow, contiguous, library, pointer
from pinarm.engine.kernel.structures import ControlStructure, CourseStructure, PairStructure
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pinarm.engine.integration.methods.explicit import AdaptiveStepper

FEWEST, MOST = 16, 512
"""Most steps of the first call, and of later ones: each may take twice as many as one that was full. An event that ends
the motion makes the steps after it useless, and memory is taken for all of them."""


class Coefficients(Record, frozen=True):
    """The coefficients of a pair for the library.

    Attributes:
        structure: The C structure.
        arrays: What it points to.
    """

    structure: PairStructure
    arrays: list[Array]


@cache
def coefficients_of(tableau: Tableau) -> Coefficients:
    """Return the coefficients of a pair, of which there are few."""
    names = ("a", "b", "c", "error", "dense_a", "dense_c", "dense_d")
    arrays = [contiguous(getattr(tableau, name)) for name in names]
    counts = tableau.stages, len(tableau.error), len(tableau.dense_c), len(tableau.dense_d)
    return Coefficients(PairStructure(*counts, tableau.error_order + 1, *map(pointer, arrays)), arrays)


def control_of(pair: EmbeddedPair, interval: Interval) -> ControlStructure:
    """Return the numbers of the step control for the library."""
    return ControlStructure(
        pair.tolerance, interval.size, SAFETY, GAIN, SLOWEST, FASTEST, LOST, HUGE, TINY, SHORTEST, NOISE
    )


class StepBuffers(Record, frozen=True):
    """Where the library writes up to m steps with n numbers in y.

    Attributes:
        times: Starts, lengths and ends of the steps [s], shape (3, m).
        rejections: Steps rejected before each, shape (m,).
        floored: Whether each was accepted as rounding, shape (m,).
        clear: Whether each is known to be clear of singular positions, shape (m,).
        states: y at their starts, shape (m, n).
        slopes: A row for each of their stages, and those of the step that is tried last, shape (m + 1, s, n).
        scratch: Buffer, shape (k, n).
    """

    times: Array
    rejections: Indices
    floored: NDArray[np.intc]
    clear: NDArray[np.intc]
    states: Array
    slopes: Array
    scratch: Array

    @classmethod
    def of(cls, room: int, stages: int, n: int, scratch: int) -> StepBuffers:
        """Return buffers for ``room`` steps, a row of n numbers for each of their stages, and ``scratch`` rows more."""
        slopes = np.empty((room + 1, stages, n))
        times, states = np.empty((3, room)), np.empty((room, n))
        floored, clear = np.empty((2, room), np.intc)
        return cls(times, np.empty(room, np.intp), floored, clear, states, slopes, np.empty((scratch, n)))

    def pointers(self) -> list[int]:
        """Return the addresses in the order of ``Course``, behind that of y."""
        steps = *self.times, self.rejections, self.floored, self.clear, self.states, self.slopes
        return [pointer(x) for x in (self.scratch, *steps)]


class CompiledSteps(Struct, eq=False, dict=True, weakref=True):
    """The steps that ``AdaptiveStepper`` takes, many in one call.

    Attributes:
        solution: Where they are added.
        pair: The method.
        stepper: The present state and its slope.
        room: Largest number of steps of the next call.
    """

    solution: Solution
    pair: EmbeddedPair
    stepper: AdaptiveStepper
    room: int = FEWEST
    _rejected: list[int] = []
    """Number of steps rejected in all before each step of the solution."""
    _floored: list[int] = []
    """Which of its steps were accepted as rounding."""
    _buffers: StepBuffers | None = None
    _addresses: list[int] = []
    _numbers: ControlStructure | None = None

    def __post_init__(self) -> None:
        self._coefficients = coefficients_of(self.pair.tableau)

    def take(self, index: int, span: Interval, t: float, h: float, tries: int) -> tuple[float, float]:
        """Take as many steps in an interval as there is room for."""
        stages, y = self.pair.tableau.stages, self.stepper.y
        compiled, flow = library(), span.compiled
        if compiled is None or flow is None:
            raise ValueError("the compiled library has gone")
        buffers = self._room_for(stages, len(y))
        buffers.slopes[0, 0] = self.stepper.stages.slopes[0]
        course = CourseStructure(
            t, span.start, span.end, h, self.stepper.ceiling, tries, len(buffers.states), 0, 0, 0,
            *self._addresses,
        )  # fmt: skip
        flow.ready()
        parts = self._coefficients.structure, flow.structure, self._control(span), course
        compiled.pair_steps(*map(ctypes.byref, parts))
        self._add(index, course, buffers)
        if course.written == self.room:
            self.room = min(2 * self.room, MOST)
        self.stepper.ceiling = course.ceiling
        if flow.settles and course.written:
            self._settle(span, flow, course, buffers)
        return course.t, course.h

    def _room_for(self, stages: int, n: int) -> StepBuffers:
        """Return where the library writes; what it has written is copied from there."""
        if self._buffers is None or len(self._buffers.states) != self.room:
            self._buffers = StepBuffers.of(self.room, stages + 1, n, 2)
            self._addresses = [pointer(self.stepper.y), *self._buffers.pointers()]
        return self._buffers

    def _settle(self, interval: Interval, flow: Flow, course: CourseStructure, buffers: StepBuffers) -> None:
        """Let the motion know which states have been settled, and let it settle the one that is handed back."""
        settled, count = course.written - course.handed, self.solution.count
        if settled:
            starts, _, ends = buffers.times[:, :settled].tolist()
            flow.advanced(ends, compress(starts, buffers.clear[:settled].tolist()))
        count.evaluations += settled
        if course.handed:
            count.evaluations += self.stepper.stages.settle(course.t)
            if buffers.floored[course.written - 1]:
                course.h = max(course.h, interval.floor())

    def _control(self, interval: Interval) -> ControlStructure:
        """Return the numbers of the step control; those of the last interval serve as long as its size is the same."""
        if self._numbers is None or self._numbers.size != interval.size:
            self._numbers = control_of(self.pair, interval)
        return self._numbers

    def _add(self, index: int, course: CourseStructure, buffers: StepBuffers) -> None:
        """Add what the library has written to the solution, and give the last slopes to the stepper."""
        count, written = self.solution.count, course.written
        slopes = buffers.slopes
        self.solution.steps.extend(buffers.times[:, :written].T, buffers.states[:written], slopes[:written], index)
        before = count.rejected
        self._rejected += [before + number for number in buffers.rejections[:written].tolist()]
        self._floored += buffers.floored[:written].tolist()
        count.floored += sum(buffers.floored[:written].tolist())
        count.rejected += course.rejected
        count.evaluations += (written + course.rejected) * self.pair.tableau.stages
        refused_last = not written or count.rejected > self._rejected[-1]
        self.stepper.stages.slopes[:] = slopes[written if refused_last else written - 1]
        self.stepper.stages.slopes[0] = slopes[written, 0]

    def drop_after(self, index: int) -> None:
        """Take the steps after one out of the solution, and what they have cost."""
        count = self.solution.count
        surplus = len(self.solution.steps) - index - 1 + count.rejected - self._rejected[index]
        count.rejected = self._rejected[index]
        count.floored = sum(self._floored[: index + 1])
        flow, dropped = self.solution.intervals[-1].compiled, len(self.solution.steps) - index - 1
        count.evaluations -= surplus * self.pair.tableau.stages + (dropped if flow and flow.settles else 0)
        del self._rejected[index + 1 :], self._floored[index + 1 :]
        self.solution.truncate(index + 1)

    def drop_all(self) -> None:
        """Take all steps out of the solution."""
        self._rejected.clear()
        self._floored.clear()
        self.solution.truncate(0)


def terms(tableau: Tableau, flow: Flow, t: Array, h: Array, y: Array, slopes: Array) -> Array:
    """Return the terms of the dense output of steps, see ``DenseOutput``, shape (n, d, nq + nv).

    Args:
        tableau: The coefficients.
        flow: The motion in compiled code.
        t: Starts of the steps [s], shape (n,).
        h: Lengths [s], shape (n,).
        y: States [q, v] at the starts, shape (n, nq + nv).
        slopes: Slopes at the stages, shape (n, s + 1, nq + nv).
    """
    ways = [*map(flow.way, t.tolist())]
    several = dict.fromkeys(ways)
    if len(several) == 1:
        flow.take(ways[0])
        return _terms(tableau, flow, t, h, y, slopes)
    found = np.empty((len(y), 3 + len(tableau.dense_d), y.shape[1]))
    for way in several:
        alike = [k for k, one in enumerate(ways) if one == way]
        flow.take(way)
        found[alike] = _terms(tableau, flow, t[alike], h[alike], y[alike], slopes[alike])
    return found


def _terms(tableau: Tableau, flow: Flow, t: Array, h: Array, y: Array, slopes: Array) -> Array:
    """Return the terms of steps whose further stages are taken in one way."""
    coefficients, compiled = coefficients_of(tableau), library()
    if compiled is None:
        raise ValueError("the compiled library has gone")
    arrays = list(map(contiguous, (t, h, y, slopes)))
    scratch = np.empty((tableau.stages + 2 + len(tableau.dense_c), y.shape[1]))
    found = np.empty((len(y), 3 + len(tableau.dense_d), y.shape[1]))
    addresses = (ctypes.c_void_p(pointer(x)) for x in (*arrays, scratch, found))
    held = flow.held(t.tolist())
    parts = map(ctypes.byref, (coefficients.structure, flow.structure, held))
    compiled.pair_terms(*parts, ctypes.c_ssize_t(len(y)), *addresses)
    return found
