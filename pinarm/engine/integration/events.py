"""Location of events: instants at which a watched value crosses zero, on the dense output."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.integrator import Crossing, Solution
from pinarm.engine.integration.turns import (
    BESIDE,
    DIGITS,
    NEGLIGIBLE,
    REACHED,
    Turn,
    WithinStep,
    may_turn,
    nodes,
    note_nearest,
    series_of,
    turns_in,
)
from pinarm.records import ValueRecord

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

LEAST_PART, MOST_STATES, AT_ONCE = 2.0**-24, 500_000, 256
"""Smallest part of a step for which a value that depends on loads has a series of its own; states in which it is looked
at for them in one step; and parts that are halved in one call."""


class Watch(ValueRecord, frozen=True):
    """A function of the state whose zero crossings are located along a motion.

    Attributes:
        value: ``(t, q, v) -> g`` of many states at once, shape (n,).
        direction: 1 for rising crossings, -1 for falling ones, 0 for both.
        stops: Whether the integration ends at the first crossing.
        loaded: Whether it depends on loads, which steps may be much longer than, and is not negative as long as the
            motion lasts: where loads jump at a sample and it is negative then, the integration ends there.
        counts: ``(t, q, v) -> whether`` a crossing at these states counts, shape (n,); all do where it is ``None``.
        begins: Instant at which the motion begins [s]: a value that is 0 there does not cross it in leaving it.
        level: Size of the numbers whose difference the value is. Where it turns back at 0 but for the error of the
            solution, or the integration ends at 0 but for the rounding of these numbers, it comes to 0 there, once.
            ``None`` where it has to cross 0.
        what: What happens where the value comes to 0, or ends there where ``loaded``; empty where nothing is decided.
        unit: Unit of the margin.
        margin: Distance to the threshold, of the sign of the value; ``None`` where it is the value.
        sensitivity: ``(t, q, v) -> change of the margin`` in one state by a relative error 1 of the states, if known.
    """

    value: Callable[[Array, Array, Array], Array]
    direction: int
    stops: bool
    loaded: bool = False
    counts: Callable[[Array, Array, Array], Flags] | None = None
    begins: float = -math.inf
    level: float | None = None
    what: str = ""
    unit: str = ""
    margin: Callable[[Array, Array, Array], Array] | None = None
    sensitivity: Callable[[Array, Array, Array], float] | None = None

    @property
    def decides(self) -> bool:
        """Whether something is decided where the value turns near 0."""
        return bool(self.what) or self.level is not None


def possible_crossings(solution: Solution, watches: Sequence[Watch], first: int, y: Array) -> Indices:
    """Return in which steps, from ``first`` on, a watched value may cross zero or turn near it.

    Bounds on its Chebyshev series decide. y is the state at the end of the last step, projected onto the constraints.
    """
    steps, nq, x = solution.steps, solution.manifold.nq, nodes(solution.method.subdivisions)
    indices = np.arange(first, len(steps))
    if len(indices) < 2:  # what would be computed here is computed again to locate them
        return indices
    instants = steps.t[first:, None] + steps.h[first:, None] * x
    instants[:, -1] = steps.until[first:]
    ends = np.concatenate([steps.y[first:], y[None]])
    shape = (len(indices), len(x), -1)
    q, v = (z.reshape(shape) for z in solution.states_in(np.repeat(indices, len(x)), instants.ravel()))
    for end, states in ((0, ends[:-1]), (-1, ends[1:])):
        q[:, end], v[:, end] = states[:, :nq], states[:, nq:]
    flat = instants.ravel(), q.reshape(-1, nq), v.reshape(len(instants.ravel()), -1)
    kept = np.ones(len(indices), dtype=bool)
    for number, watch in enumerate(watches):
        values = watch.value(*flat).reshape(shape[:2])
        kept &= keeps_sign(values) & (resolved(values) if watch.loaded else True)
        kept &= ~may_turn(solution, watch, number, values, indices)
    return np.asarray(indices[~kept])


def locate_crossings(solution: Solution, watches: Sequence[Watch], index: int, y: Array) -> bool:
    """Record the zero crossings in a step, and end it at one that stops the integration; return whether one does.

    Each value is interpolated by a Chebyshev polynomial at ``2 method.subdivisions + 1`` points of the step, all of
    whose roots are computed: a coordinate that is linear in q is such a polynomial, and none of its crossings is
    missed, however close they are. Values that depend on loads are interpolated on parts of the step, down to which the
    series converge: a step may be long where nothing moves yet. Each root is then refined on the value itself. A value
    of exactly 0 counts as positive. y is the state at the end of the step, projected onto the constraints.
    """
    within = WithinStep(solution, index, y)
    step, crossings, turns = within.step, list[tuple[float, int]](), list[Turn]()
    latest, slack = math.inf, SAME_INSTANT * max(abs(step.t), abs(step.h))
    states = within.at_nodes(np.array([[0.0, 1.0]]))
    for number, watch in enumerate(watches):
        for part in _parts(within, watch, watch.value(*states)):
            start, length = step.t + step.h * part.low, step.h * (part.high - part.low)
            if start > latest + slack:
                break
            if not part.resolved:
                solution.unresolved.append((start, start + length))
            near = turns_in(within, watch, number, part.values, (part.low, part.high))
            turns += (near := [turn for turn in near if _counts(within, watch, turn.t)])
            for instant in _instants(within, watch, part, near):
                if watch.level is not None and _stays(solution, watch, (number, instant), crossings, turns):
                    continue
                crossings.append((instant, number))
                latest = min(latest, instant) if watch.stops else latest
    located, stop = _until_stop(sorted(crossings), watches, slack)
    if stop is not None or step.until >= solution.intervals[-1].end:
        end, last = step.until if stop is None else stop, {number: instant for instant, number in located}
        crossings += [
            (end, number)
            for number, watch in enumerate(watches)
            if _reaches(within, watch, last.get(number, step.t), end)
        ]
        located, stop = _until_stop(sorted(crossings), watches, slack)
    note_nearest(solution, turns, math.inf if stop is None else stop, located[-1][1] if located else -1)
    for instant, number in located:
        (q,), (v,) = solution.states_in(np.array([index]), np.array([instant]))
        solution.crossings.append(Crossing(number, instant, q, v))
    if stop is not None:
        solution.steps.until[index] = stop
    return stop is not None


def _instants(within: WithinStep, watch: Watch, part: StepPart, turns: Sequence[Turn]) -> Iterator[float]:
    """Yield when a watched value comes to 0 in a part of a step [s], but for where it only leaves its start."""
    step = within.step
    start, length = step.t + step.h * part.low, step.h * (part.high - part.low)
    for low, high, above in _brackets(part.values, watch.direction, watch.level, turns):
        bracket = start + length * low, start + length * high
        instant = _refined(within, watch, bracket, above=above) if low < high else bracket[0]
        if instant is None or not _counts(within, watch, instant):
            continue
        if start == watch.begins and _leaves(within, watch, instant, part.values):
            continue
        yield instant


class StepPart(NamedTuple):
    """A part of a step, from ``low`` to ``high`` of it, and the values at its nodes.

    ``resolved`` tells whether their series shows the signs, or the part is so short that a kink or a jump is in it.
    """

    low: float
    high: float
    values: Array
    resolved: bool


def _parts(within: WithinStep, watch: Watch, values: Array) -> Iterator[StepPart]:
    """Yield the parts of a step on which a value is interpolated, in order of time, given its values at the nodes."""
    known = not watch.loaded or bool(resolved(values[None])[0])
    waiting, left, at_once = [StepPart(0.0, 1.0, values, known)], MOST_STATES, 1
    while waiting:
        if waiting[-1].resolved or left <= 0:
            yield waiting.pop()
            at_once = min(2 * at_once, AT_ONCE)
            continue
        some = [waiting.pop() for _ in range(min(at_once, len(waiting)))]
        ends = np.array([half for part in some if not part.resolved for half in _halves(part)])
        found = watch.value(*within.at_nodes(ends)).reshape(len(ends), -1)
        seen = resolved(found) | (ends[:, 1] - ends[:, 0] <= LEAST_PART)
        halves = iter([*map(StepPart, *ends.T.tolist(), found, seen.tolist())])
        divided = [each for part in some for each in ([part] if part.resolved else [next(halves), next(halves)])]
        waiting += divided[::-1]
        left -= found.size


def _halves(part: StepPart) -> tuple[tuple[float, float], tuple[float, float]]:
    middle = 0.5 * (part.low + part.high)
    return (part.low, middle), (middle, part.high)


def _until_stop(
    crossings: Sequence[tuple[float, int]], watches: Sequence[Watch], slack: float
) -> tuple[list[tuple[float, int]], float | None]:
    """Return the crossings up to the one that stops the integration, which comes last, and its instant."""
    stops = [(instant, number) for instant, number in crossings if watches[number].stops]
    if not stops:
        return list(crossings), None
    first = stops[0][0]
    instant, stopping = min((stop for stop in stops if stop[0] <= first + slack), key=lambda each: each[1])
    before = [(min(t, instant), number) for t, number in crossings if not watches[number].stops and t <= first + slack]
    return [*before, (instant, stopping)], instant


def keeps_sign(values: Array) -> Flags:
    """Return for which rows of values at the nodes the Chebyshev series has one sign: ``|c_0| > sum |c_k|``; (m,).

    Of those that it may bring to 0 but for rounding that is not said.
    """
    return _is_one_sided(series_of(values))


def _is_one_sided(series: Array) -> Flags:
    return np.asarray((1.0 - NEAR) * np.abs(series[..., 0]) > np.abs(series[..., 1:]).sum(axis=-1))


def resolved(values: Array) -> Flags:
    """Return for which rows of values at the nodes the Chebyshev series shows their signs; shape (m,).

    Its last coefficients are the error: of a value that is far from 0 they may be larger than where it may cross 0.
    """
    series = np.abs(series_of(values))
    rest, error, size = series[:, 1:].sum(axis=1), series[:, -2:].max(axis=1), series.max(axis=1)
    one_sign = (error <= CONVERGED * size) & (series[:, 0] > rest + FAR * error)
    return np.asarray((series[:, 0] > FAR * rest) | one_sign | (error <= EXACT * size))


def _brackets(
    values: Array, direction: int, level: float | None = None, turns: Sequence[Turn] = ()
) -> list[tuple[float, float, bool]]:
    """Return intervals in [0, 1], each with one zero crossing, and whether the values are positive before it."""
    series, touches = series_of(values), [turn for turn in turns if turn.is_open and level is not None]
    if not np.isfinite(series).all() or (_is_one_sided(series) and not touches):
        return []
    size = np.abs(series).max()
    significant = np.flatnonzero(np.abs(series) > NEGLIGIBLE * size)
    roots = np.polynomial.chebyshev.chebroots(series[: significant[-1] + 1]) if len(significant) else np.zeros(0)
    real = np.sort(0.5 + 0.5 * roots.real[np.abs(roots.imag) < 1e-4])
    here = np.clip(real[(real > -BESIDE) & (real < 1.0 + BESIDE)], 0.0, 1.0)
    bounds = np.concatenate([[0.0], 0.5 * (here[1:] + here[:-1]), [1.0]])
    between = np.polynomial.chebyshev.chebval(2.0 * bounds - 1.0, series)
    between[0], between[-1] = values[0], values[-1]
    above = between >= 0.0
    rounded = np.abs(between) <= (NEGLIGIBLE * size if level is None else REACHED * size + DIGITS * level)
    for turn in (turn for turn in touches if turn.passes):
        rounded[1:-1] |= _is_between(here, turn.place)
    for k in np.flatnonzero(rounded[1:-1]) + 1:  # two roots of a value that only touches 0 have rounding between them
        above[k] = above[k - 1]
    found = [(bounds[k], bounds[k + 1], above[k]) for k in range(len(bounds) - 1) if above[k] != above[k + 1]]
    found += [(turn.place, turn.place, turn.sign > 0.0) for turn in touches]
    return [
        (float(low), float(high), bool(one)) for low, high, one in sorted(found) if direction in (0, -1 if one else 1)
    ]


def _is_between(roots: Array, place: float) -> Flags:
    return np.asarray((roots[:-1] <= place) & (place <= roots[1:]))


def _refined(within: WithinStep, watch: Watch, bracket: tuple[float, float], *, above: bool) -> float | None:
    """Return the first instant after a crossing in a bracket, to rounding [s]; ``None`` where only its series has one.

    The crossing may lie before the bracket by the rounding of the series. At the end of a step the state is closed,
    and its value counts. ``above`` tells whether the value is positive before the crossing.
    """
    low, high = bracket

    def value(*t: float) -> list[float]:
        return [x or math.ulp(0.0) for x in within.evaluate(watch.value, t).tolist()]

    begins = within.step.t
    first, at_low, at_high = value(begins, low, high)  # together: at the end of an interval, what is before its jumps
    if (at_low > 0.0) != above and (first > 0.0) == above:
        low, high, at_low, at_high = begins, low, first, at_low
    if (at_low > 0.0) == (at_high > 0.0):
        return high if (at_low > 0.0) == above and high >= within.step.until else None
    return _sign_change(lambda t: value(t)[0], (low, high), (at_low, at_high))


def _counts(within: WithinStep, watch: Watch, instant: float) -> bool:
    return watch.counts is None or bool(within.evaluate(watch.counts, [instant])[0])


def _leaves(within: WithinStep, watch: Watch, instant: float, values: Array) -> bool:
    """Tell whether a value only leaves 0, where the motion begins, at an instant of its first step."""
    before = within.evaluate(watch.value, watch.begins + np.array([0.0, 0.5, 1.0]) * (instant - watch.begins))
    return bool(np.abs(before).max() <= LEFT * np.abs(values).max() + ROUNDED)


def _stays(
    solution: Solution,
    watch: Watch,
    found: tuple[int, float],
    crossings: Sequence[tuple[float, int]],
    turns: Sequence[Turn],
) -> bool:
    """Tell whether a value has been 0, but for its error, since it last came to 0: then it does not come to 0 again.

    ``found`` is the index of the watch and the instant at which its value is 0 [s]; crossings and turns are those in
    the step until then.
    """
    number, instant = found
    known = [solution.nearest[number]] if number in solution.nearest else []
    error = max((turn.error for turn in [*known, *turns] if turn.watch == number and turn.is_open), default=0.0)
    earlier = [t for t, k in crossings if k == number and t <= instant]
    earlier = earlier or [crossing.t for crossing in solution.crossings[::-1] if crossing.watch == number][:1]
    if not error or not earlier:
        return False
    t = np.linspace(earlier[-1], instant, 5)
    return bool(np.abs(watch.value(t, *solution.states(t))).max() <= error)


def _reaches(within: WithinStep, watch: Watch, start: float, end: float) -> bool:
    """Tell whether a value comes to 0, but for rounding, where the integration ends [s]; see ``Watch.level``."""
    if watch.level is None or not start < end:
        return False
    middle, last = within.evaluate(watch.value, [0.5 * (start + end), end])
    soon = SAME_INSTANT * max(abs(end), abs(within.step.h)) / (end - start)
    rounding = (REACHED + soon) * abs(middle) + DIGITS * watch.level
    there = abs(last) <= rounding < abs(middle) and watch.direction in (0, -1 if middle > 0.0 else 1)
    return bool(there) and _counts(within, watch, end)


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
        found = value(t)
        if (found > 0.0) == (at_low > 0.0):
            low, at_low, at_high, stayed = t, found, at_high / (2.0 if stayed > 0 else 1.0), 1
        else:
            high, at_high, at_low, stayed = t, found, at_low / (2.0 if stayed < 0 else 1.0), -1
    return high
