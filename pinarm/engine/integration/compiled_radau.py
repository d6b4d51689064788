"""Steps of Radau IIA by the compiled library: many steps in one call."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct

from pinarm.engine.integration.compiled_steps import FEWEST, StepBuffers
from pinarm.engine.integration.integrator import Interval, Solution
from pinarm.engine.integration.methods.radau_coefficients import RadauTableau
from pinarm.engine.integration.methods.stiff import CONTRACTION, FASTEST, ITERATIONS, KEPT, SAFETY, SLOWEST, UNSOLVED
from pinarm.engine.integration.step_control import HUGE, SHORTEST, TINY
from pinarm.engine.kernel.library import contiguous, library, pointer
from pinarm.engine.kernel.structures import ControlStructure, CourseStructure, NewtonStructure, RadauStructure

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pinarm.engine.integration.methods.stiff import RadauStepper

LARGEST = 200
"""Most numbers in a state: with more, steps in Python are faster, since LAPACK eliminates by blocks. For chains of 20,
100 and 300 links with springs, 40, 200 and 600 numbers, steps here take 0.6, 1.1 and 1.4 times as long as those."""


@cache
def arrays_of(tableau: RadauTableau) -> list[NDArray[Any]]:
    """Return the coefficients of a method in the order of ``RadauStructure``, kept for as long as the library reads."""
    numbers = tableau.c, tableau.inverse, tableau.powers, tableau.error
    others = tableau.eigenvalues, tableau.forth, tableau.back
    return [*map(contiguous, numbers), *(np.ascontiguousarray(x, dtype=complex) for x in others)]


class CompiledRadau(Struct, eq=False, dict=True, weakref=True):
    """The steps that ``RadauStepper`` takes, many in one call.

    Attributes:
        solution: Where they are added.
        stepper: The present state and its slope.
    """

    solution: Solution
    stepper: RadauStepper
    _rejected: list[int] = []
    """Number of steps rejected in all before each step of the solution."""
    _evaluations: list[int] = []
    """Number of evaluations in all up to the end of each."""

    @classmethod
    def of(cls, solution: Solution, stepper: RadauStepper) -> CompiledRadau | None:
        """Return the steps of a motion; ``None`` where states need settling or are large."""
        flows = [interval.compiled for interval in solution.intervals]
        known = all(flow is not None and not flow.settles for flow in flows)
        return cls(solution, stepper) if known and len(stepper.y) <= LARGEST else None

    def __post_init__(self) -> None:
        stepper, n = self.stepper, len(self.stepper.y)
        s, m = len(stepper.method.c), len(stepper.method.eigenvalues)
        self._buffers = StepBuffers.of(FEWEST, s, n, 3)
        self._addresses = [pointer(stepper.y), *self._buffers.pointers()]
        self._slope, self._spent = np.empty(n), np.empty(FEWEST, np.intp)
        systems, pivots, right = np.empty((m, n, n), complex), np.empty((m, n), np.intp), np.empty((m, n), complex)
        self._arrays = [self._slope, np.empty((n, n)), systems, pivots, right, *np.empty((2, s, n))]
        self._newton = NewtonStructure(*map(pointer, self._arrays), promise=1.0, spent=pointer(self._spent))
        places = map(pointer, arrays_of(stepper.method))
        self._method = RadauStructure(s, m, *places, ITERATIONS, stepper.enough, CONTRACTION, KEPT)

    def take(self, index: int, span: Interval, t: float, h: float, tries: int) -> tuple[float, float]:
        """Take as many steps in an interval as there is room for."""
        compiled, flow, stepper, newton = library(), span.compiled, self.stepper, self._newton
        if compiled is None or flow is None:
            raise ValueError("the compiled library has gone")
        if stepper.slope is not self._slope:  # an interval, or what follows a sample, has begun
            self._slope[:] = stepper.slope
            stepper.slope, newton.known, newton.length = self._slope, 0, 0.0
        control = ControlStructure(
            stepper.tolerance, span.size, SAFETY, 0.0, SLOWEST, FASTEST, UNSOLVED, HUGE, TINY, SHORTEST, 0.0
        )
        course = CourseStructure(
            t, span.start, span.end, h, stepper.ceiling, tries, FEWEST, 0, 0, 0, *self._addresses
        )  # fmt: skip
        flow.ready()
        parts = self._method, flow.structure, control, course, newton
        compiled.radau_steps(*map(ctypes.byref, parts))
        self._add(index, course)
        stepper.ceiling = course.ceiling
        return course.t, course.h

    def _add(self, index: int, course: CourseStructure) -> None:
        """Add what the library has written to the solution."""
        count, written, buffers = self.solution.count, course.written, self._buffers
        self.solution.steps.extend(
            buffers.times[:, :written].T, buffers.states[:written], buffers.slopes[:written], index
        )
        self._rejected += (count.rejected + buffers.rejections[:written]).tolist()
        self._evaluations += (count.evaluations + self._spent[:written]).tolist()
        count.rejected += course.rejected
        count.evaluations += self._newton.evaluations

    def drop_after(self, index: int) -> None:
        """Take the steps after one out of the solution, and what they have cost."""
        count = self.solution.count
        count.rejected, count.evaluations = self._rejected[index], self._evaluations[index]
        del self._rejected[index + 1 :], self._evaluations[index + 1 :]
        self.solution.truncate(index + 1)

    def drop_all(self) -> None:
        """Take all steps out of the solution."""
        self._rejected.clear()
        self._evaluations.clear()
        self.solution.truncate(0)
