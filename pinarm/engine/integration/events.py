"""Events: instants at which a watched value crosses zero on the dense output, and turns near zero.

Each value is interpolated by a Chebyshev polynomial on a step, or on parts of it. Where its slope vanishes the value
turns; between two turns it is monotonic, and crosses zero where its signs differ: none of the crossings of the
polynomial is missed, however close they are. Where a value turns near zero, whether it crosses is a decision with a
margin and an error: the error of one step, times the number of steps so far, times the sensitivity of the margin, since
errors of steps add up. Where the motion is unstable, errors grow beyond that; a second solution shows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.integrator import Crossing, Solution, Turn, Watch
from pinarm.records import Record

MOST_SECANTS = 400
"""Steps to a crossing: a fourth of them halve the bracket, which takes less than 100 halvings to rounding."""

NEAR = 1e-6
"""Part of a value by which its series may keep one sign and the step still be looked at: it may come to 0 there but for
rounding."""

LEFT, ROUNDED = 1e-9, 1e-14
"""Value where a motion begins, relative to the largest in the step, and rounding [rad or m], up to which it is 0."""

SAME_INSTANT = 1e-13
"""Difference of two instants, relative to the time or the step, that is rounding of their roots: what is watched at the
instant that ends the integration is recorded, whichever comes first."""

CONVERGED, EXACT, FAR = 1e-3, 1e-9, 4.0
"""Size of the last coefficients of a series over the largest where it has converged, and where it shows crossings; and
how many times its other terms the first one is where nothing that they miss can make it cross 0."""

LEAST_PART, MOST_STATES = 2.0**-24, 500_000
"""Smallest part of a step for which a value that depends on loads has a series of its own; and states in which it is
looked at for them in one step."""

BESIDE = 1e-3
"""Part of a step up to which turns outside of it are told from those within: one at an end may be on either side."""

NEGLIGIBLE = 1e-14
"""Size of the last coefficients of a series that are rounding, over the largest; they would disturb its roots."""

REACHED, DIGITS = 1e-13, 1e-15
"""Rounding of a value, relative to the largest in the step, with that of a few impacts before it; and that of a
difference, relative to the numbers."""

SAME_PLACE = 1e-4
"""Imaginary part of roots of the slope of a series that is rounding."""

CLEAR = 10.0
"""Margin of a turn over its error from which on it is skipped where an earlier one was nearer."""


class WithinStep(Record, frozen=True):
    """A step of a solution, by its index, with the state at its end, projected onto the constraints."""

    solution: Solution
    index: int
    end: Array

    @property
    def times(self) -> tuple[float, float, float]:
        """Start, length and end of the step [s]."""
        steps, k = self.solution.steps, self.index
        return float(steps.t[k]), float(steps.h[k]), float(steps.until[k])

    @property
    def slack(self) -> float:
        """Rounding of instants [s]."""
        return SAME_INSTANT * max(map(abs, self.times[:2]))

    def evaluate(self, function: Callable[[Array, Array, Array], Any], t: Sequence[float] | Array) -> Any:
        """Return the values of a function of the states at instants t [s], shape (n,)."""
        instants = np.asarray(t)
        return function(instants, *self.solution.states_in(np.full(len(instants), self.index), instants))

    def counts(self, watch: Watch, instant: float) -> bool:
        return watch.counts is None or bool(self.evaluate(watch.counts, [instant])[0])

    def at_nodes(self, parts: Array) -> tuple[Array, Array, Array]:
        """Return instants and states at the nodes of parts of the step, given their ends from 0 to 1, shape (p, 2)."""
        return states_at_nodes(self.solution, np.full(len(parts), self.index), parts, self.end)


def states_at_nodes(solution: Solution, index: Indices, parts: Array, end: Array) -> tuple[Array, Array, Array]:
    """Return instants and states at the k nodes of each of m parts of steps, given their ends, shape (m, 2).

    At starts of steps states are known, at ends they are projected onto the constraints: ``end`` at the end of the last
    step, shape (nq + nv,).
    """
    steps, nq, x = solution.steps, solution.manifold.nq, nodes(solution.method.subdivisions)
    t = steps.t[index, None] + steps.h[index, None] * (parts[:, :1] + np.diff(parts) * x)
    begun, ended = parts[:, 0] == 0.0, parts[:, 1] == 1.0
    t[ended, -1] = steps.until[index[ended]]
    q, v = (z.reshape(*t.shape, -1) for z in solution.states_in(np.repeat(index, len(x)), t.ravel()))
    following = index[ended] + 1
    closed = np.where((following < len(steps))[:, None], steps.y[np.minimum(following, len(steps) - 1)], end)
    for place, some, states in ((0, begun, steps.y[index[begun]]), (-1, ended, closed)):
        q[some, place], v[some, place] = states[:, :nq], states[:, nq:]
    return t.ravel(), q.reshape(t.size, -1), v.reshape(t.size, -1)


def possible_crossings(solution: Solution, watches: Sequence[Watch], first: int, y: Array) -> Indices:
    """Return in which steps, from ``first`` on, a watched value may cross zero or turn near it.

    y is the state at the end of the last step, projected onto the constraints.
    """
    indices = np.arange(first, len(solution.steps))
    if len(indices) < 2:  # what would be computed here is computed again to locate them
        return indices
    states = states_at_nodes(solution, indices, np.tile([0.0, 1.0], (len(indices), 1)), y)
    calm = np.ones(len(indices), dtype=bool)
    for number, watch in enumerate(watches):
        calm &= _is_calm(solution, (number, watch), watch.value(*states).reshape(len(indices), -1), indices)
    return np.asarray(indices[~calm])


def _is_calm(solution: Solution, watched: tuple[int, Watch], values: Array, index: Indices) -> Flags:
    """Return in which steps a value surely keeps its sign, and does not turn nearer to 0 than before, shape (m,).

    Bounds on the Chebyshev series of its values at the nodes, shape (m, k), decide.
    """
    number, watch = watched
    series = series_of(values)
    calm = _is_one_sided(series) & (resolved(series) if watch.loaded else True)
    if watch.decides:
        rest = np.abs(series[:, 1:]).sum(axis=1)
        near = _is_near(solution, number, np.abs(series[:, 0]) - rest, index)
        varies = rest > NEGLIGIBLE * np.abs(series[:, 0]) + DIGITS * (watch.level or 0.0)
        calm &= ~(near & varies & ~_is_one_sided(series @ _to_slope(values.shape[-1] // 2).T))
        calm &= not watch.loaded or index > 0
    return np.asarray(calm)


def _is_near(solution: Solution, number: int, least: Array, index: Indices) -> Flags:
    """Return in which steps a value of a least size may be less certain to keep its sign than at any turn before."""
    known = solution.nearest.get(number)
    if known is None:
        return np.ones(len(index), dtype=bool)
    return np.asarray(least < np.maximum(abs(known.margin), CLEAR * known.error * (index + 1.0) / (known.step + 1.0)))


def locate_crossings(solution: Solution, watches: Sequence[Watch], index: int, y: Array) -> bool:
    """Record the zero crossings in a step, and end it at one that stops the integration; return whether one does.

    Values that depend on loads are interpolated on parts of the step, down to which the series converge: a step may be
    long where nothing moves yet. Each root is then refined on the value itself. A value of exactly 0 counts as
    positive. y is the state at the end of the step, projected onto the constraints.
    """
    within = WithinStep(solution, index, y)
    (begun, h, until), crossings, turns = within.times, list[tuple[float, int]](), list[Turn]()
    latest, states = math.inf, within.at_nodes(np.array([[0.0, 1.0]]))
    for number, watch in enumerate(watches):
        values = watch.value(*states)
        if not np.isfinite(values).all() or _is_calm(solution, (number, watch), values[None], np.array([index]))[0]:
            continue
        for part in _parts(within, watch, values):
            start, end = begun + h * part.low, begun + h * part.high
            if start > latest + within.slack:
                break
            if not part.resolved:
                solution.unresolved.append((start, end))
            places, signs = _extremes(part.values)
            near = [turn for turn in _turns(within, number, watch, part, places, signs) if within.counts(watch, turn.t)]
            turns += near
            for instant in _instants(within, watch, part, places, near):
                if watch.level is not None and _stays(solution, watch, (number, instant), crossings, turns):
                    continue
                crossings.append((instant, number))
                latest = min(latest, instant) if watch.stops else latest
    located, stop = _until_stop(crossings, watches, within.slack)
    if stop is not None or until >= solution.intervals[-1].end:
        end, last = until if stop is None else stop, {number: instant for instant, number in located}
        reached = (k for k, watch in enumerate(watches) if _reaches(within, watch, last.get(k, begun), end))
        located, stop = _until_stop([*crossings, *((end, k) for k in reached)], watches, within.slack)
    _note_nearest(solution, turns, math.inf if stop is None else stop, located[-1][1] if located else -1)
    for instant, number in located:
        (q,), (v,) = solution.states_in(np.array([index]), np.array([instant]))
        solution.crossings.append(Crossing(number, instant, q, v))
    if stop is not None:
        solution.steps.until[index] = stop
    return stop is not None


class StepPart(NamedTuple):
    """A part of a step, from ``low`` to ``high`` of it, and the values at its nodes.

    ``resolved`` tells whether their series shows the signs, or the part is so short that a kink or a jump is in it.
    """

    low: float
    high: float
    values: Array
    resolved: bool


def _parts(within: WithinStep, watch: Watch, values: Array) -> list[StepPart]:
    """Return the parts of a step on which a value is interpolated, in order of time, given its values at the nodes.

    Parts whose series do not show the signs are halved, all of one length in one call.
    """
    parts, ends, known, left = list[StepPart](), np.array([[0.0, 1.0]]), values[None], MOST_STATES
    while len(ends):
        seen = resolved(series_of(known)) | (not watch.loaded) | (ends[:, 1] - ends[:, 0] <= LEAST_PART)
        kept = seen | (left <= 0)
        parts += map(StepPart, *ends[kept].T.tolist(), known[kept], seen[kept].tolist())
        low, high = ends[~kept].T
        middle = 0.5 * (low + high)
        ends = np.stack([low, middle, middle, high], axis=1).reshape(-1, 2)
        known = watch.value(*within.at_nodes(ends)).reshape(len(ends), -1) if len(ends) else known
        left -= known.size
    return sorted(parts, key=lambda part: part.low)


def _extremes(values: Array) -> tuple[Array, Array]:
    """Return where the series of values at the nodes is extreme, in [0, 1], and 1 of minima, -1 of maxima."""
    series = series_of(values)
    slope = _to_slope(len(values) // 2) @ series
    significant = np.flatnonzero(np.abs(slope) > NEGLIGIBLE * np.abs(series).max())
    if not len(significant):
        return np.zeros(0), np.zeros(0)
    roots = chebyshev.chebroots(slope[: significant[-1] + 1])
    real = np.sort(roots.real[(np.abs(roots.imag) < SAME_PLACE) & (np.abs(roots.real) < 1.0 + 2.0 * BESIDE)])
    real = real.clip(-1.0, 1.0)
    return 0.5 + 0.5 * real, np.sign(chebyshev.chebval(real, chebyshev.chebder(slope)))


def _turns(
    within: WithinStep, number: int, watch: Watch, part: StepPart, places: Array, signs: Array
) -> Iterator[Turn]:
    """Yield where a watched value turns in a part of a step, if it may be near 0 there, in order of time.

    A value that depends on loads is decided at the start of a motion, too: it must not be negative there.
    """
    if not watch.decides:
        return
    if watch.level is None:  # crossings in one direction count
        places, signs = (x[watch.direction * signs <= 0.0] for x in (places, signs))
    if within.index == 0 and part.low == 0.0:
        places, signs = (x[places > BESIDE] for x in (places, signs))
        if watch.loaded:
            places, signs = np.append(0.0, places), np.append(1.0, signs)
    solution, (start, h, _), series = within.solution, within.times, series_of(part.values)
    rounding = 0.0 if watch.level is None else REACHED * float(np.abs(part.values).max()) + DIGITS * watch.level
    near = _is_near(
        solution, number, np.abs(chebyshev.chebval(2.0 * places - 1.0, series)), np.full(len(places), within.index)
    )
    for place, sign in zip(places[near].tolist(), signs[near].tolist(), strict=True):
        where = part.low + (part.high - part.low) * place
        t = start + where * h
        margin = float(within.evaluate(watch.margin or watch.value, [t])[0])
        wrong = solution.begun_with + solution.method.step_error(solution, within.index) * (within.index + where)
        error = wrong * within.evaluate(watch.sensitivity, [t]) if wrong and watch.sensitivity else 0.0
        yield Turn(number, within.index, t, place, sign, margin, error + rounding)


def _instants(
    within: WithinStep, watch: Watch, part: StepPart, places: Array, turns: Sequence[Turn]
) -> Iterator[float]:
    """Yield when a watched value comes to 0 in a part of a step [s], but for where it only leaves its start."""
    begun, h, _ = within.times
    start, length = begun + h * part.low, h * (part.high - part.low)
    for low, high, above in _brackets(part.values, watch, places, turns):
        bracket = start + length * low, start + length * high
        instant = _refined(within, watch, bracket, above=above) if low < high else bracket[0]
        if instant is None or not within.counts(watch, instant):
            continue
        if start == watch.begins:
            since = within.evaluate(watch.value, start + np.array([0.0, 0.5, 1.0]) * (instant - start))
            if np.abs(since).max() <= LEFT * np.abs(part.values).max() + ROUNDED:
                continue
        yield instant


def _brackets(values: Array, watch: Watch, places: Array, turns: Sequence[Turn]) -> list[tuple[float, float, bool]]:
    """Return intervals in [0, 1], each with one zero crossing, and whether the values are positive before it.

    ``places`` are those where the values, given at the nodes, are extreme. Where they turn back at 0 both ends are the
    place of the turn; the crossings just before and behind it are none.
    """
    series, touches = series_of(values), [turn for turn in turns if turn.is_open and watch.level is not None]
    size, bounds = np.abs(series).max(), np.concatenate([[0.0], places[(places > 0.0) & (places < 1.0)], [1.0]])
    between = chebyshev.chebval(2.0 * bounds - 1.0, series)
    between[0], between[-1] = values[0], values[-1]
    above = between >= 0.0
    rounded = np.abs(between) <= (NEGLIGIBLE * size if watch.level is None else REACHED * size + DIGITS * watch.level)
    rounded |= np.isin(bounds, [turn.place for turn in touches if turn.passes])
    for k in np.flatnonzero(rounded[1:-1]) + 1:  # a value that only touches 0 has rounding there
        above[k] = above[k - 1]
    brackets = [(bounds[k], bounds[k + 1], above[k]) for k in range(len(bounds) - 1) if above[k] != above[k + 1]]
    brackets += [(turn.place, turn.place, turn.sign > 0.0) for turn in touches]
    return [(float(low), float(high), bool(up)) for low, high, up in sorted(brackets) if watch.passes(positive=up)]


def _refined(within: WithinStep, watch: Watch, bracket: tuple[float, float], *, above: bool) -> float | None:
    """Return the first instant after a crossing in a bracket, to rounding [s]; ``None`` where only its series has one.

    The crossing may lie before the bracket by the rounding of the series. At the end of a step the state is closed,
    and its value counts. ``above`` tells whether the value is positive before the crossing.
    """
    (low, high), (begun, _, until) = bracket, within.times

    def value(*t: float) -> list[float]:
        return [x or math.ulp(0.0) for x in within.evaluate(watch.value, t).tolist()]

    first, at_low, at_high = value(begun, low, high)  # together: at the end of an interval, what is before its jumps
    if (at_low > 0.0) != above and (first > 0.0) == above:
        low, high, at_low, at_high = begun, low, first, at_low
    if (at_low > 0.0) == (at_high > 0.0):
        return high if (at_low > 0.0) == above and high >= until else None
    return _sign_change(lambda t: value(t)[0], (low, high), (at_low, at_high))


def _sign_change(value: Callable[[float], float], bracket: tuple[float, float], at_ends: tuple[float, float]) -> float:
    """Return the first instant behind the change of sign within a bracket, to rounding.

    By secants, of which the value at an end that stays is halved each time (the Illinois algorithm; Dowell and Jarratt,
    A modified regula falsi method for computing the root of an equation, BIT 11, 1971), with some bisections.
    """
    (low, high), (at_low, at_high), stayed = bracket, at_ends, 0
    least = math.ulp(max(abs(low), abs(high)))
    for count in range(MOST_SECANTS):
        if high - low <= least:
            break
        secant = high - at_high * (high - low) / (at_high - at_low)
        t = 0.5 * (low + high) if count % 4 == 3 else min(max(secant, low + least), high - least)
        here = value(t)
        if (here > 0.0) == (at_low > 0.0):
            low, at_low, at_high, stayed = t, here, at_high / (2.0 if stayed > 0 else 1.0), 1
        else:
            high, at_high, at_low, stayed = t, here, at_low / (2.0 if stayed < 0 else 1.0), -1
    return high


def _stays(
    solution: Solution,
    watch: Watch,
    crossing: tuple[int, float],
    crossings: Sequence[tuple[float, int]],
    turns: Sequence[Turn],
) -> bool:
    """Tell whether a value has been 0, but for its error, since it last came to 0: then it does not come to 0 again.

    The crossing is the index of the watch and an instant [s]; crossings and turns are those in the step until then.
    """
    number, instant = crossing
    known = [solution.nearest[number]] if number in solution.nearest else []
    error = max((turn.error for turn in [*known, *turns] if turn.watch == number and turn.is_open), default=0.0)
    earlier = [t for t, k in crossings if k == number and t <= instant]
    earlier = earlier or [before.t for before in solution.crossings[::-1] if before.watch == number][:1]
    if not error or not earlier:
        return False
    t = np.linspace(earlier[-1], instant, 5)
    return bool(np.abs(watch.value(t, *solution.states(t))).max() <= error)


def _reaches(within: WithinStep, watch: Watch, start: float, end: float) -> bool:
    """Tell whether a value comes to 0, but for rounding, where the integration ends [s]; see ``Watch.level``.

    ``start`` is the start of the last step, or the last crossing in it [s].
    """
    if watch.level is None or not start < end:
        return False
    middle, last = within.evaluate(watch.value, [0.5 * (start + end), end])
    soon = SAME_INSTANT * max(abs(end), abs(within.times[1])) / (end - start)
    rounding = (REACHED + soon) * abs(middle) + DIGITS * watch.level
    there = abs(last) <= rounding < abs(middle) and watch.passes(positive=middle > 0.0)
    return bool(there) and within.counts(watch, end)


def _until_stop(
    crossings: Sequence[tuple[float, int]], watches: Sequence[Watch], slack: float
) -> tuple[list[tuple[float, int]], float | None]:
    """Return the crossings up to the one that stops the integration, which comes last, and its instant.

    Of those that stop within ``slack`` [s] it is that of the first watched value. Other crossings at that instant
    count, even if rounding puts them after it.
    """
    crossings = sorted(crossings)
    stops = [(instant, number) for instant, number in crossings if watches[number].stops]
    if not stops:
        return crossings, None
    first = stops[0][0]
    instant, stopping = min((stop for stop in stops if stop[0] <= first + slack), key=lambda stop: stop[1])
    before = [(min(t, instant), number) for t, number in crossings if not watches[number].stops and t <= first + slack]
    return [*before, (instant, stopping)], instant


def _note_nearest(solution: Solution, turns: Sequence[Turn], stop: float, stopping: int) -> None:
    """Keep the turn of every watch that is the least certain; none behind a stop, but the turn that the stop cuts off.

    ``stop`` is the instant at which the integration stops [s], ``stopping`` the index of the watch that stops it.
    """
    for turn in turns:
        known = solution.nearest.get(turn.watch)
        cut_off = turn.watch == stopping and turn.passes
        if (turn.t <= stop or cut_off) and (known is None or turn.doubt > known.doubt):
            solution.nearest[turn.watch] = turn


def _is_one_sided(series: Array) -> Flags:
    """Return for which series one sign is certain: ``|c_0| > sum |c_k|``."""
    return np.asarray((1.0 - NEAR) * np.abs(series[..., 0]) > np.abs(series[..., 1:]).sum(axis=-1))


def resolved(series: Array) -> Flags:
    """Return for which Chebyshev series, shape (m, n + 1), the signs are certain; shape (m,).

    Their last coefficients are the error: of a value that is far from 0 they may be larger than where it may cross 0.
    """
    sizes = np.abs(series)
    rest, error, size = sizes[:, 1:].sum(axis=1), sizes[:, -2:].max(axis=1), sizes.max(axis=1)
    one_sign = (error <= CONVERGED * size) & (sizes[:, 0] > rest + FAR * error)
    return np.asarray((sizes[:, 0] > FAR * rest) | one_sign | (error <= EXACT * size))


@cache
def nodes(parts: int) -> Array:
    """Return the Chebyshev points of [0, 1], ends included: ``(1 - cos(pi k / n)) / 2``, n = 2 parts; (n + 1,)."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(2 * parts + 1) / (2 * parts))


def series_of(values: Array) -> Array:
    """Return the Chebyshev coefficients on [-1, 1] of values at the nodes, both of shape (.., n + 1)."""
    return np.asarray(values @ _to_series(values.shape[-1] // 2).T)


@cache
def _to_series(parts: int) -> Array:
    return np.asarray(np.linalg.inv(chebyshev.chebvander(2.0 * nodes(parts) - 1.0, 2 * parts)))


@cache
def _to_slope(parts: int) -> Array:
    """Return the matrix from the coefficients of a series to those of its slope, shape (n, n + 1)."""
    return np.asarray(chebyshev.chebder(np.eye(2 * parts + 1)))
