"""Steps of many motions by the compiled library: each motion in calls of its own, shared among threads.

A thread has its own buffers of the mechanism, and the library releases Python's lock while it takes steps, so that the
threads run side by side. What a motion gets does not depend on how many there are.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array, Indices
from pinarm.engine.integration.batch_solution import ActiveMotions, BatchStep, Ensemble
from pinarm.engine.integration.compiled_steps import Coefficients, coefficients_of, control_of
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.kernel.library import Flow, address, contiguous, library, pointer
from pinarm.engine.kernel.structures import CourseStructure

ROOM, FEWEST, MOST = 16384, 8, 512
"""Steps that all motions together may take in one call of the library each, and bounds of those of a single motion."""

COURSE = np.dtype(CourseStructure)
"""A motion on an interval, as an element of an array."""


@dataclass(frozen=True, eq=False)
class CompiledRounds:
    """The steps of motions within an interval, in rounds: as many of each motion as there is room for.

    Attributes:
        ensemble: Where they are recorded.
        interval: The interval, whose motion is compiled.
        index: Its index.
        flows: Its motion once for each thread, with buffers of its own.
        max_steps: Largest number of steps of a motion, rejected ones included.
    """

    ensemble: Ensemble
    interval: Interval
    index: int
    flows: tuple[Flow, ...]
    max_steps: int

    @classmethod
    def of(
        cls, ensemble: Ensemble, interval: Interval, index: int, max_steps: int, threads: int
    ) -> CompiledRounds | None:
        """Return the steps of an interval; ``None`` where the library does not know them, or motions share a state."""
        if interval.compiled is None:
            return None
        copies = [copy for _ in range(threads) if (copy := interval.compiled.copied()) is not None]
        return cls(ensemble, interval, index, tuple(copies), max_steps) if len(copies) == threads else None

    def advance(self, active: ActiveMotions, tries: Indices) -> ActiveMotions:
        """Take a round of steps and record them; return the motions at their ends.

        Args:
            active: The motions at its beginning.
            tries: Number of steps of all motions until now, rejected ones included, shape (b,); it is brought up to
                date.
        """
        record = StepRecord.of(active, self.ensemble.method.tableau.stages)
        tried = tries[active.number]
        courses = record.courses(active, self.interval.start, self.interval.end, self.max_steps - tried)
        self._take(courses)
        record.add_to(self.ensemble, courses, active.number, self.index)
        tries[active.number] += courses["written"] + courses["rejected"]
        return record.moved(active, courses)

    def _take(self, courses: NDArray[np.void]) -> None:
        """Take the steps of all motions."""
        numbers = iter(range(len(courses)))  # the threads share it: each takes the next motion that is left
        works = [partial(self._take_some, flow, courses, numbers) for flow in self.flows[: len(courses)]]
        if len(works) == 1:
            works[0]()
            return
        with ThreadPoolExecutor(len(works)) as pool:
            for done in [pool.submit(work) for work in works]:
                done.result()

    def _take_some(self, flow: Flow, courses: NDArray[np.void], numbers: Iterator[int]) -> None:
        """Take the steps of the motions whose numbers are left."""
        steps, first = self._pair_steps, courses.ctypes.data
        shared = tuple(ctypes.addressof(x) for x in (self._coefficients.structure, flow.structure, self._control))
        for number in numbers:
            steps(*shared, first + number * COURSE.itemsize)

    @cached_property
    def _pair_steps(self) -> Callable[..., Any]:
        """The function of the library, called without Python's lock."""
        compiled = library()
        if compiled is None:
            raise ValueError("the compiled library has gone")
        return ctypes.CFUNCTYPE(None, *4 * [ctypes.c_void_p])(address(compiled.pair_steps) or 0)

    @cached_property
    def _coefficients(self) -> Coefficients:
        return coefficients_of(self.ensemble.method.tableau)

    @cached_property
    def _control(self) -> ctypes.Structure:
        return control_of(self.ensemble.method, self.interval)


@dataclass(frozen=True, eq=False)
class StepRecord:
    """Where the library writes up to r steps of each of m motions, of s stages with n numbers in y.

    Attributes:
        present: Present states, shape (m, n).
        times: Starts, lengths and ends of the steps [s], shape (3, m, r).
        states: y at their starts, shape (m, r, n).
        slopes: Slopes at their stages, and of the step that is tried last, shape (m, r + 1, s + 1, n).
        unused: Rejections before each step, and whether it was accepted as rounding or is clear of singular positions,
            shape (3, m, r).
        scratch: Buffers, shape (m, 2, n).
    """

    present: Array
    times: Array
    states: Array
    slopes: Array
    unused: Indices
    scratch: Array

    @classmethod
    def of(cls, active: ActiveMotions, stages: int, room: int | None = None) -> StepRecord:
        """Return room for so many steps of each motion, or for as many as suit their number."""
        n, m = active.y.shape
        room = room or min(max(ROOM // m, FEWEST), MOST)
        slopes = np.empty((m, room + 1, stages + 1, n))
        slopes[:, 0, 0] = active.slope.T
        times, states = np.empty((3, m, room)), np.empty((m, room, n))
        return cls(contiguous(active.y.T), times, states, slopes, np.empty((3, m, room), np.intp), np.empty((m, 2, n)))

    def courses(
        self, active: ActiveMotions, start: float | Array, end: float | Array, tries: int | Indices
    ) -> NDArray[np.void]:
        """Return the motions for the library, shape (m,), each on its interval and with the steps that it may try."""
        courses = np.zeros(len(active.number), COURSE)
        courses["t"], courses["h"], courses["ceiling"] = active.t, active.h, active.ceiling
        courses["start"], courses["end"] = start, end
        courses["tries"], courses["room"] = tries, self.states.shape[1]
        starts, lengths, ends = self.times
        rejections, floored, clear = self.unused
        places = {
            "y": self.present, "scratch": self.scratch, "starts": starts, "lengths": lengths, "ends": ends,
            "rejections": rejections, "floored": floored, "clear": clear, "states": self.states, "slopes": self.slopes,
        }  # fmt: skip
        for name, array in places.items():
            courses[name] = pointer(array) + array.strides[0] * np.arange(len(courses))
        return courses

    def moved(self, active: ActiveMotions, courses: NDArray[np.void]) -> ActiveMotions:
        """Return the motions behind their steps."""
        slopes = self.slopes[np.arange(len(courses)), courses["written"], 0]
        t, h, ceiling = (courses[name].copy() for name in ("t", "h", "ceiling"))
        return ActiveMotions(active.number, t, h, ceiling, self.present.T, slopes.T)

    def add_to(self, ensemble: Ensemble, courses: NDArray[np.void], number: Indices, index: int) -> None:
        """Record the steps of motions, and where these are now."""
        written, rejected = courses["written"], courses["rejected"]
        for k in range(int(written.max(initial=0))):
            which = np.flatnonzero(written > k)
            (t, h, until), y, slopes = self.times[:, which, k], self.states[which, k], self.slopes[which, k]
            ensemble.steps.append(BatchStep(number[which], t, h, until, y.T, slopes.transpose(1, 2, 0), index))
        ensemble.evaluations[number] += (written + rejected) * ensemble.method.tableau.stages
        ensemble.rejected[number] += rejected
        moved = written > 0
        ensemble.ends[number[moved]], ensemble.last[:, number[moved]] = courses["t"][moved], self.present[moved].T
