"""Motions of variants of a system, each with a flow of its own, integrated by the compiled library.

Every motion takes the steps that it takes alone, in calls of its own. What Python does is done for the steps of all of
them at once. Configurations are those of flat spaces, without quaternions.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.batch_solution import ActiveMotions
from pinarm.engine.integration.compiled_batch import StepRecord
from pinarm.engine.integration.compiled_steps import coefficients_of
from pinarm.engine.integration.dense_output import DenseOutput
from pinarm.engine.integration.divided_steps import DEFECT, PARTS
from pinarm.engine.integration.first_step import first_step
from pinarm.engine.integration.integrator import EmbeddedPair
from pinarm.engine.integration.step_control import FASTEST, GAIN, HUGE, LOST, NOISE, SAFETY, SHORTEST, SLOWEST, TINY
from pinarm.engine.integration.tableaus import Tableau
from pinarm.engine.kernel.library import address, contiguous, library, pointer
from pinarm.engine.kernel.structures import ControlStructure, HeldStructure

CONTROL = np.dtype(ControlStructure)
"""The numbers of a step control, as an element of an array."""


class Flows(Protocol):
    """Motions of k variants in compiled code."""

    def places(self, motions: Indices) -> list[int]:
        """Return the addresses of some of the motions."""
        ...

    def slopes(self, motions: Indices, y: Array) -> Array:
        """Return the slopes of states [q, v], each of one of the motions, shape (n, nq + nv)."""
        ...


@dataclass(frozen=True, eq=False)
class VariantSolution:
    """The steps of k motions, those of each one after the other, and their states in between.

    Attributes:
        pair: The method.
        flows: The motions.
        size: What errors of steps are relative to besides the states, of each motion, shape (k,).
        arrived: Which motions have come to their ends, shape (k,).
        motion: The motion of each of n steps, ascending, shape (n,).
        t: Starts of the steps [s], shape (n,).
        h: Lengths [s], shape (n,).
        until: Ends [s], shape (n,).
        y: States at the starts, shape (n, w).
        slopes: Slopes at the stages, shape (n, s + 1, w).
    """

    pair: EmbeddedPair
    flows: Flows = field(repr=False)
    size: Array
    arrived: Flags
    motion: Indices
    t: Array
    h: Array
    until: Array
    y: Array = field(repr=False)
    slopes: Array = field(repr=False)

    @cached_property
    def counts(self) -> Indices:
        """Number of steps of each motion, shape (k,)."""
        return np.bincount(self.motion, minlength=len(self.arrived))

    @cached_property
    def firsts(self) -> Indices:
        """The first step of each motion, shape (k,)."""
        return np.cumsum(self.counts) - self.counts

    @property
    def sizes(self) -> Array:
        """Largest coordinate or velocity of each motion at the starts of its steps, in SI, shape (k,)."""
        sizes = np.zeros(len(self.arrived))
        np.maximum.at(sizes, self.motion, np.abs(self.y).max(axis=1))
        return sizes

    @property
    def displacements(self) -> Array:
        """Largest change of a coordinate, or velocity, of each motion at the starts of its steps, in SI, shape (k,)."""
        change, nq = self.y.copy(), self.y.shape[1] // 2
        change[:, :nq] -= self.y[self.firsts[self.motion], :nq]
        found = np.zeros(len(self.arrived))
        np.maximum.at(found, self.motion, np.abs(change).max(axis=1))
        return found

    def with_finer(self, motions: Indices, others: VariantSolution) -> VariantSolution:
        """Return the solution with others in the place of some of the motions, as far as they have come to their ends.

        Args:
            motions: Which motions they are of, shape (m,).
            others: The others.
        """
        better = motions[others.arrived]
        kept, given = np.isin(self.motion, better, invert=True), others.arrived[others.motion]
        motion = np.concatenate([self.motion[kept], motions[others.motion[given]]])
        order = np.argsort(motion, kind="stable")
        names = "t", "h", "until", "y", "slopes"
        steps = [np.concatenate([getattr(self, name)[kept], getattr(others, name)[given]])[order] for name in names]
        size = self.size.copy()
        size[better] = others.size[others.arrived]
        return VariantSolution(self.pair, self.flows, size, self.arrived, motion[order], *steps)

    def located(self, motions: Indices, t: Array) -> Indices:
        """Return the steps of some motions in which instants are, of all or of each, shape (n,) or (n, m): (n, m)."""
        found = np.empty((len(t), len(motions)), dtype=np.intp)
        columns = np.broadcast_to(t.reshape(len(t), -1), found.shape)
        starts = [*zip(self.firsts[motions].tolist(), self.counts[motions].tolist(), strict=True)]
        for column, (first, count) in enumerate(starts):
            found[:, column] = self.t[first : first + count].searchsorted(columns[:, column], side="right")
        return np.clip(found - 1, 0, np.maximum(self.counts[motions] - 1, 0)) + self.firsts[motions]

    def within(self, step: Indices, t: Array) -> Flags:
        """Return which instants are within their steps, and not at their starts, both of shape (..)."""
        return np.asarray((t - self.t[step]) / self.h[step] != 0.0)

    def states_in(self, step: Indices, t: Array) -> Array:
        """Return the states at instants in steps, both of shape (..), as an array of shape (.., w)."""
        x = (t - self.t[step]) / self.h[step]
        return self._output.states(step.ravel(), x.ravel()).reshape(*step.shape, -1)

    @cached_property
    def _output(self) -> DenseOutput:
        """The dense output of all steps; see ``divided_steps.divided``."""
        terms = _terms(self.pair.tableau.examined, self.flows, self.motion, self.t, self.h, self.y, self.slopes)
        defects, largest = np.abs(terms[:, -1]).max(axis=1), np.abs(self.y).max(axis=1)
        poor = np.flatnonzero(defects > DEFECT * self.pair.tolerance * (self.size[self.motion] + largest))
        whole = DenseOutput.whole(self.y, terms[:, :-1])
        if not len(poor):
            return whole
        base, parts, ends = self._parts(poor)
        apart = np.abs(ends - (self.y[poor] + terms[poor, 0])).max(axis=1)
        better = apart < defects[poor]
        counts = whole.counts.copy()
        counts[poor[better]] = PARTS
        divided = np.repeat(counts, counts) > 1
        joined = [np.repeat(x, counts, axis=0) for x in (whole.base, whole.terms)]
        for all_parts, own in zip(joined, (base, parts), strict=True):
            all_parts[divided] = own[better].reshape(-1, *own.shape[2:])
        return DenseOutput(joined[0], joined[1], counts)

    def _parts(self, steps: Indices) -> tuple[Array, Array, Array]:
        """Return states at the starts of equal parts of m steps and their terms, and the states at the ends.

        Shapes (m, p, w), (m, p, d, w) and (m, w).
        """
        t, h, motion = self.t[steps], self.h[steps] / PARTS, self.motion[steps]
        y, alike = self.y[steps], np.ones(len(steps))
        active = ActiveMotions(motion, t, h, alike, y.T.copy(), self.slopes[steps, 0].T)
        record = StepRecord.of(active, self.pair.tableau.stages, PARTS)
        courses = record.courses(active, t, t + 2.0 * PARTS * h, PARTS)
        _Calls(self.pair.tableau, self.flows).take(courses, motion, _even(len(steps)))
        record.present[courses["written"] < PARTS] = np.nan
        starts, base, slopes = record.times[0], record.states, record.slopes[:, :PARTS]
        flat = (x.reshape(-1, *x.shape[2:]) for x in (starts, np.repeat(h[:, None], PARTS, axis=1), base, slopes))
        terms = _terms(self.pair.tableau, self.flows, np.repeat(motion, PARTS), *flat)
        return base, terms.reshape(len(steps), PARTS, *terms.shape[1:]), record.present


def integrate_variants(
    flows: Flows, pair: EmbeddedPair, start: Array, end: Array, y: Array, size: Array, most: int
) -> VariantSolution:
    """Integrate motions of variants, each with the steps that ``integrate`` takes of it.

    Args:
        flows: The motions.
        pair: The method.
        start: First instants [s], shape (k,).
        end: Last instants [s], shape (k,).
        y: Initial states [q, v], shape (k, w).
        size: What errors of steps are relative to besides the states, shape (k,).
        most: Largest number of steps of a motion, rejected ones included.
    """
    calls, every, control = _Calls(pair.tableau, flows), np.arange(len(y)), _controls(pair, size)
    slope, order = flows.slopes(every, y), pair.tableau.error_order
    h = first_step(
        start, end, y, slope, lambda t, states: flows.slopes(every, states), pair.tolerance, order, size[:, None]
    )
    arrived, tries = np.zeros(len(y), dtype=bool), np.zeros(len(y), dtype=np.intp)
    active, rounds = ActiveMotions(every, start, h, np.full(len(y), FASTEST), y.T.copy(), slope.T), list[_Steps]()
    active = active.subset(np.isfinite(slope).all(axis=1) & np.isfinite(h))
    while len(number := active.number):
        record = StepRecord.of(active, pair.tableau.stages)
        courses = record.courses(active, start[number], end[number], most - tries[number])
        calls.take(courses, number, control[number])
        rounds.append(_Steps.of(record, courses, number))
        tries[number] += courses["written"] + courses["rejected"]
        active = record.moved(active, courses)
        there = active.t >= end[number]
        arrived[number[there]] = True
        shortest = SHORTEST * np.spacing(np.maximum(np.abs(active.t), end[number] - start[number]))
        active = active.subset(~there & (active.h >= shortest) & (tries[number] < most))
    return VariantSolution(pair, flows, size, arrived, *_Steps.sorted(rounds))


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps of several motions; see ``VariantSolution``."""

    motion: Indices
    times: Array
    states: Array
    slopes: Array

    @classmethod
    def of(cls, record: StepRecord, courses: NDArray[np.void], number: Indices) -> _Steps:
        """Return the steps that the library has written."""
        taken = np.arange(record.states.shape[1]) < courses["written"][:, None]
        row, _ = np.nonzero(taken)
        return cls(number[row], record.times[:, taken], record.states[taken], record.slopes[:, :-1][taken])

    @classmethod
    def sorted(cls, rounds: Sequence[_Steps]) -> Iterator[NDArray[Any]]:
        """Yield the motions, starts, lengths and ends, states and slopes of all steps, motion by motion."""
        order = np.argsort(np.concatenate([each.motion for each in rounds]), kind="stable")
        yield np.concatenate([each.motion for each in rounds])[order]
        yield from np.concatenate([each.times for each in rounds], axis=1)[:, order]
        yield np.concatenate([each.states for each in rounds])[order]
        yield np.concatenate([each.slopes for each in rounds])[order]


@dataclass(frozen=True, eq=False)
class _Calls:
    """Calls of the library, one for each motion.

    Attributes:
        tableau: The coefficients.
        flows: The motions.
    """

    tableau: Tableau
    flows: Flows

    def take(self, courses: NDArray[np.void], motions: Indices, controls: NDArray[np.void]) -> None:
        """Take the steps of m courses, each of a motion, by a step control of its own."""
        steps, pair = _function("pair_steps", 4), ctypes.addressof(coefficients_of(self.tableau).structure)
        rows = zip(self.flows.places(motions), _rows(controls), _rows(courses), strict=True)
        for flow, control, course in rows:
            steps(pair, flow, control, course)


def _terms(
    tableau: Tableau, flows: Flows, motion: Indices, t: Array, h: Array, y: Array, slopes: Array
) -> Array:  # fmt: skip
    """Return the terms of the dense output of n steps, those of one motion together, shape (n, d, w)."""
    call, coefficients = _function("pair_terms", 10, count=3), coefficients_of(tableau)
    found = np.empty((len(t), 3 + len(tableau.dense_d), y.shape[1]))
    scratch, held = np.empty((tableau.stages + 2 + len(tableau.dense_c), y.shape[1])), HeldStructure(None, 0, 0, None)
    arrays = [contiguous(x) for x in (t, h, y, slopes)]
    firsts = np.flatnonzero(np.diff(motion, prepend=-1))
    counts = np.diff(np.append(firsts, len(t))).tolist()
    same = ctypes.addressof(coefficients.structure), ctypes.addressof(held), pointer(scratch)
    places = ((pointer(x) + x.strides[0] * firsts).tolist() for x in (*arrays, found))
    for flow, count, times, lengths, states, known, terms in zip(
        flows.places(motion[firsts]), counts, *places, strict=True
    ):
        call(same[0], flow, same[1], count, times, lengths, states, known, same[2], terms)
    return found


def _rows(array: NDArray[np.void]) -> range:
    """Return the addresses of the elements of an array."""
    first = pointer(array)
    return range(first, first + array.nbytes, array.itemsize)


def _function(name: str, arguments: int, count: int = -1) -> Callable[..., Any]:
    """Return a function of the library whose arguments are addresses, but for one that is a number."""
    compiled = library()
    if compiled is None:
        raise ValueError("the compiled library has gone")
    kinds = [ctypes.c_ssize_t if k == count else ctypes.c_void_p for k in range(arguments)]
    return ctypes.PYFUNCTYPE(None, *kinds)(address(getattr(compiled, name)) or 0)


def _controls(pair: EmbeddedPair, size: Array) -> NDArray[np.void]:
    """Return the step controls of motions, which differ in their sizes, shape (k,) of ``CONTROL``."""
    numbers = pair.tolerance, 1.0, SAFETY, GAIN, SLOWEST, FASTEST, LOST, HUGE, TINY, SHORTEST, NOISE
    controls = np.repeat(np.array([numbers], CONTROL), len(size))
    controls["size"] = size
    return controls


def _even(count: int) -> NDArray[np.void]:
    """Return step controls by which all steps are as long as the first, whatever their errors."""
    numbers = np.inf, 1.0, SAFETY, GAIN, 1.0, 1.0, LOST, HUGE, TINY, SHORTEST, NOISE
    return np.repeat(np.array([numbers], CONTROL), count)
