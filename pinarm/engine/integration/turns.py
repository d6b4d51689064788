"""Turns of watched values near zero: whether the value crosses zero there is a decision with a margin and an error.

The error of a margin is the error of one step, times the number of steps so far, times the sensitivity of the margin:
errors of steps add up. Where the motion is unstable, errors grow beyond that; a second solution shows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.methods.explicit import FixedStep
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.integration.events import Watch
    from pinarm.engine.integration.integrator import Solution, Step

BESIDE = 1e-3
"""Part of a step up to which roots outside of it are told from those within: one at an end may be on either side."""

NEGLIGIBLE = 1e-14
"""Size of the last coefficients of a series that are rounding, over the largest; they would disturb its roots."""

REACHED, DIGITS = 1e-13, 1e-15
"""Rounding of a value, relative to the largest in the step, with that of a few impacts before it; and that of a
difference, relative to the numbers."""

SAME_PLACE = 1e-4
"""Imaginary part of roots of a slope that is rounding."""

BENDS = 0.01
"""Part of the range of a value in a step by which it may be nearer to 0 between the places of ``fine_values`` than at
them; of a parabola it is a tenth of that."""

CLEAR = 10.0
"""Margin of a turn over its error from which on it is skipped where an earlier one was nearer."""


class Turn(NamedTuple):
    """Where a watched value turns, or is decided at the start of a motion.

    Attributes:
        watch: Index of the watch.
        t: When [s].
        place: Where in its part of the step, from 0 to 1.
        sign: 1 where the value is least, -1 where it is greatest.
        margin: Its margin there; see ``Watch.margin``.
        error: Error of the margin.
        state: Error of the states there, relative to ``size + |y|``.
        step: What one step adds to it.
    """

    watch: int
    t: float
    place: float
    sign: float
    margin: float
    error: float
    state: float
    step: float

    @property
    def is_open(self) -> bool:
        """Whether the value may be 0 there."""
        return abs(self.margin) <= self.error

    @property
    def passes(self) -> bool:
        """Whether the value is beyond 0 there, so that it crosses 0 before and behind."""
        return self.margin * self.sign < 0.0

    @property
    def doubt(self) -> float:
        return self.error / abs(self.margin) if self.margin else math.inf


class WithinStep(Record, frozen=True):
    """A step of a solution, by its index, with the state at its end, projected onto the constraints."""

    solution: Solution
    index: int
    end: Array

    @property
    def step(self) -> Step:
        return self.solution.steps[self.index]

    def evaluate(self, function: Callable[[Array, Array, Array], Any], t: Sequence[float] | Array) -> Any:
        """Return the values of a function of the states at instants t [s], shape (n,)."""
        instants = np.asarray(t)
        return function(instants, *self.solution.states_in(np.full(len(instants), self.index), instants))

    def at_nodes(self, parts: Array) -> tuple[Array, Array, Array]:
        """Return instants and states at the nodes of parts of the step one after the other.

        Both ends of each part are given, from 0 to 1, in order of time, shape (p, 2).
        """
        step, nq = self.step, self.solution.manifold.nq
        t = step.t + step.h * (parts[:, :1] + np.diff(parts) * nodes(self.solution.method.subdivisions))
        if parts[-1, 1] == 1.0:
            t[-1, -1] = step.until
        q, v = self.solution.states_in(np.full(t.size, self.index), t.ravel())
        for place, end, known in ((0, parts[0, 0] == 0.0, step.y), (-1, parts[-1, 1] == 1.0, self.end)):
            if end:
                q[place], v[place] = known[:nq], known[nq:]
        return t.ravel(), q, v


def may_turn(solution: Solution, watch: Watch, number: int, values: Array, indices: Indices) -> Flags:
    """Return in which steps a watched value may turn nearer to 0 than ever, or so near that it may be 0, shape (m,).

    Values at the nodes have the shape (m, k), indices of the steps the shape (m,).
    """
    if not watch.decides:
        return np.zeros(len(values), dtype=bool)
    fine = fine_values(values)
    rates, range_ = np.diff(fine, axis=1), np.ptp(fine, axis=1)
    sizes, least = np.abs(rates), np.abs(fine).min(axis=1)
    inside = (rates[:, :-1] * rates[:, 1:] <= 0.0).any(axis=1)
    at_ends = (sizes[:, 0] < 0.5 * sizes[:, 1]) | (sizes[:, -1] < 0.5 * sizes[:, -2])
    varies = range_ > NEGLIGIBLE * np.abs(fine).max(axis=1) + DIGITS * (watch.level or 0.0)
    found = ((inside | at_ends) & varies) | ((indices == 0) & watch.loaded)
    known = solution.nearest.get(number)
    if known is None:
        return np.asarray(found)
    states = solution.begun_with + known.step * (indices + 1.0)
    errors = known.error / known.state * states if known.state else np.inf
    near = least - BENDS * range_ < np.maximum(abs(known.margin), CLEAR * errors)
    return np.asarray(found & near)


def turns_in(within: WithinStep, watch: Watch, number: int, values: Array, part: tuple[float, float]) -> list[Turn]:
    """Return where a watched value turns in a part of a step, if it may be near 0 there, in order of time.

    A value that depends on loads is decided at the start of a motion, too: it must not be negative there. Values are
    those at the nodes of the part, whose ends are from 0 to 1 in the step.
    """
    solution, index = within.solution, within.index
    if not watch.decides or not may_turn(solution, watch, number, values[None], np.array([index]))[0]:
        return []
    places, signs = _extremes(values)
    if watch.level is None:  # crossings in one direction count
        places, signs = (x[watch.direction * signs <= 0.0] for x in (places, signs))
    if index == 0 and part[0] == 0.0:
        places, signs = (x[places > BESIDE] for x in (places, signs))
        if watch.loaded:
            places, signs = np.append(0.0, places), np.append(1.0, signs)
    rounding = 0.0 if watch.level is None else REACHED * float(np.abs(values).max()) + DIGITS * watch.level
    wheres = part[0] + (part[1] - part[0]) * places
    return [
        _turn(within, watch, number, (where, place, sign), rounding)
        for where, place, sign in zip(wheres.tolist(), places.tolist(), signs.tolist(), strict=True)
    ]


def _extremes(values: Array) -> tuple[Array, Array]:
    """Return where the series of values at the nodes is extreme, in [0, 1], and 1 of minima, -1 of maxima."""
    series = series_of(values)
    slope = np.polynomial.chebyshev.chebder(series)
    significant = np.flatnonzero(np.abs(slope) > NEGLIGIBLE * np.abs(series).max())
    roots = np.polynomial.chebyshev.chebroots(slope[: significant[-1] + 1]) if len(significant) else np.zeros(0)
    real = np.sort(roots.real[(np.abs(roots.imag) < SAME_PLACE) & (np.abs(roots.real) < 1.0 + 2.0 * BESIDE)])
    real = real.clip(-1.0, 1.0)
    bend = np.polynomial.chebyshev.chebval(real, np.polynomial.chebyshev.chebder(slope))
    return 0.5 + 0.5 * real, np.sign(bend)


def _turn(within: WithinStep, watch: Watch, number: int, place: tuple[float, float, float], rounding: float) -> Turn:
    """Return the turn at a place: where in the step, where in its part, and its sign."""
    step, solution, (where, in_part, sign) = within.step, within.solution, place
    t, each = step.t + where * step.h, step_error(solution, within.index)
    margin = float(within.evaluate(watch.margin or watch.value, [t])[0])
    wrong = solution.begun_with + each * (within.index + where)
    error = wrong * within.evaluate(watch.sensitivity, [t]) if wrong and watch.sensitivity else 0.0
    return Turn(number, t, in_part, sign, margin, error + rounding, wrong, each)


def step_error(solution: Solution, index: int) -> float:
    """Return the error of a step, relative to ``size + |y|``: the tolerance, or what two half steps change."""
    method = solution.method
    if not isinstance(method, FixedStep):
        return method.tolerance
    return method.error(solution, solution.steps[index], min(solution.size, 1.0))


def note_nearest(solution: Solution, turns: Sequence[Turn], stop: float, stopping: int) -> None:
    """Keep the turn of every watch that is the least certain; none behind a stop, but the turn that the stop cuts off.

    ``stop`` is the instant at which the integration stops [s], ``stopping`` the index of the watch that stops it.
    """
    for turn in turns:
        known = solution.nearest.get(turn.watch)
        cut_off = turn.watch == stopping and turn.passes
        if (turn.t <= stop or cut_off) and (known is None or turn.doubt > known.doubt):
            solution.nearest[turn.watch] = turn


@cache
def nodes(parts: int) -> Array:
    """Return the Chebyshev points of [0, 1], ends included: ``(1 - cos(pi k / n)) / 2``, n = 2 parts; (n + 1,)."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(2 * parts + 1) / (2 * parts))


def series_of(values: Array) -> Array:
    """Return the Chebyshev coefficients on [-1, 1] of values at the nodes, both of shape (.., n + 1)."""
    return np.asarray(values @ _to_series(values.shape[-1] // 2).T)


def fine_values(values: Array) -> Array:
    """Return the values of the series at ``FINE`` even places of the step, shape (.., n + 1) to (.., FINE)."""
    return np.asarray(values @ _to_fine(values.shape[-1] // 2).T)


FINE = 33
"""Places at which a series is looked at for turns: four to eight between two nodes."""


@cache
def _to_series(parts: int) -> Array:
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * nodes(parts) - 1.0, 2 * parts)))


@cache
def _to_fine(parts: int) -> Array:
    return np.asarray(np.polynomial.chebyshev.chebvander(np.linspace(-1.0, 1.0, FINE), 2 * parts) @ _to_series(parts))
