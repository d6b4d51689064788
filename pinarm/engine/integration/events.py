"""Location of events: instants at which a watched value crosses zero, on the dense output."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.solution import Crossing, Solution
from pinarm.engine.integration.turns import (
    BESIDE,
    DIGITS,
    NEGLIGIBLE,
    REACHED,
    Turn,
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
        sensitivity: ``(t, q, v) -> change of the margin`` in one state by a relative error 1 of the states; ``None``
            where it is not known.
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
    """Return in which steps of a solution a watched value may cross zero, or turn near it.

    Bounds on its Chebyshev series decide.

    Args:
        solution: The solution.
        watches: The watched values.
        first: Index of the first step that is looked at; all those after it are, too.
        y: State at the end of the last one, projected onto the constraints, shape (nq + nv,).
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
    """Record the zero crossings in a step of a solution, and end the step at one that stops the integration.

    Each value is interpolated by a Chebyshev polynomial at ``2 method.subdivisions + 1`` points of the step, all of
    whose roots are computed: a coordinate that is linear in q is such a polynomial, and none of its crossings is
    missed, however close they are. What depends on loads is interpolated on parts of the step, down to which the series
    converge: a step may be long where nothing moves yet. Each root is then refined on the value itself. A value of
    exactly 0 counts as positive.

    Args:
        solution: Solution whose crossings are recorded.
        watches: The watched values.
        index: Index of the step.
        y: State at the end of the step, projected onto the constraints, shape (nq + nv,).

    Returns:
        Whether the integration stops.
    """
    step, whole = solution.steps[index], np.array([[0.0, 1.0]])
    crossings, turns = list[tuple[float, int]](), list[Turn]()
    latest, slack = math.inf, SAME_INSTANT * max(abs(step.t), abs(step.h))
    first = _states(solution, index, y, whole)
    for number, watch in enumerate(watches):
        for part in _parts(solution, index, y, watch, watch.value(*first)):
            start, length = step.t + step.h * part.low, step.h * (part.high - part.low)
            if start > latest + slack:
                break
            if not part.resolved:
                solution.unresolved.append((start, start + length))
            near = turns_in(solution, index, watch, number, part.values, (part.low, part.high))
            turns += (near := [turn for turn in near if _counts(solution, index, watch, turn.t)])
            for instant in _instants(solution, index, watch, part, near):
                if watch.level is not None and _stays(solution, watch, (number, instant), crossings, turns):
                    continue
                crossings.append((instant, number))
                latest = min(latest, instant) if watch.stops else latest
    within, stop = _until_stop(sorted(crossings), watches, slack)
    if stop is not None or step.until >= solution.intervals[-1].end:
        end, last = step.until if stop is None else stop, {number: instant for instant, number in within}
        crossings += [(end, number) for number, watch in enumerate(watches)
                      if _reaches(solution, index, watch, last.get(number, step.t), end)]  # fmt: skip
        within, stop = _until_stop(sorted(crossings), watches, slack)
    note_nearest(solution, turns, math.inf if stop is None else stop, within[-1][1] if within else -1)
    for instant, number in within:
        q, v = solution.states_in(np.array([index]), np.array([instant]))
        solution.crossings.append(Crossing(number, instant, q[0], v[0]))
    if stop is not None:
        solution.steps.end_at(index, stop)
    return stop is not None


def _instants(solution: Solution, index: int, watch: Watch, part: StepPart, turns: Sequence[Turn]) -> Iterator[float]:
    """Yield when a watched value comes to 0 in a part of a step [s], but for where it only leaves its start."""
    step = solution.steps[index]
    start, length = step.t + step.h * part.low, step.h * (part.high - part.low)
    for low, high, above in _brackets(part.values, watch.direction, watch.level, turns):
        bracket = start + length * low, start + length * high
        instant = _refined(solution, index, watch, bracket, above=above) if low < high else bracket[0]
        if instant is None or not _counts(solution, index, watch, instant):
            continue
        if start == watch.begins and _leaves(solution, index, watch, instant, part.values):
            continue
        yield instant


class StepPart(NamedTuple):
    """A part of a step on which a value is interpolated.

    Attributes:
        low: Its start, from 0 to 1.
        high: Its end.
        values: Values at the nodes.
        resolved: Whether their series shows the signs, or the part is so short that a kink or a jump is in it.
    """

    low: float
    high: float
    values: Array
    resolved: bool


def _states(solution: Solution, index: int, y: Array, parts: Array) -> tuple[Array, Array, Array]:
    """Return instants and states at the nodes of parts of a step one after the other; see ``locate_crossings``.

    Args:
        solution: The solution.
        index: Index of the step.
        y: State at its end.
        parts: Both ends of each part, from 0 to 1, in order of time, shape (p, 2).
    """
    step, nq = solution.steps[index], solution.manifold.nq
    t = step.t + step.h * (parts[:, :1] + np.diff(parts) * nodes(solution.method.subdivisions))
    if parts[-1, 1] == 1.0:
        t[-1, -1] = step.until
    q, v = solution.states_in(np.full(t.size, index), t.ravel())
    for place, end, known in ((0, parts[0, 0] == 0.0, step.y), (-1, parts[-1, 1] == 1.0, y)):
        if end:
            q[place], v[place] = known[:nq], known[nq:]
    return t.ravel(), q, v


def _parts(solution: Solution, index: int, y: Array, watch: Watch, values: Array) -> Iterator[StepPart]:
    """Yield the parts of a step on which a value is interpolated, in order of time.

    Parts whose series do not show the signs are halved, the first ones first: what follows a crossing is not looked at.
    The farther there is none, the more are halved in one call.

    Args:
        solution: The solution.
        index: Index of the step.
        y: State at its end.
        watch: What is watched.
        values: Its values at the nodes of the whole step.
    """
    known = not watch.loaded or bool(resolved(values[None])[0])
    waiting, left, at_once = [StepPart(0.0, 1.0, values, known)], MOST_STATES, 1
    while waiting:
        if waiting[-1].resolved or left <= 0:
            yield waiting.pop()
            at_once = min(2 * at_once, AT_ONCE)
            continue
        some = [waiting.pop() for _ in range(min(at_once, len(waiting)))]
        ends = np.array([half for part in some if not part.resolved for half in _halves(part)])
        found = watch.value(*_states(solution, index, y, ends)).reshape(len(ends), -1)
        seen = resolved(found) | (ends[:, 1] - ends[:, 0] <= LEAST_PART)
        halves = iter([*map(StepPart, *ends.T.tolist(), found, seen.tolist())])
        divided = [one for part in some for one in ([part] if part.resolved else [next(halves), next(halves)])]
        waiting += divided[::-1]
        left -= found.size


def _halves(part: StepPart) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ends of the halves of a part."""
    middle = 0.5 * (part.low + part.high)
    return (part.low, middle), (middle, part.high)


def _until_stop(
    crossings: Sequence[tuple[float, int]], watches: Sequence[Watch], slack: float
) -> tuple[list[tuple[float, int]], float | None]:
    """Return the crossings up to the one that stops the integration, which comes last, and its instant.

    Of those that stop at one instant it is that of the first watched value. What else is crossed at that instant
    counts, be it by rounding after it.

    Args:
        crossings: Instants and numbers of the watched values, in order of time.
        watches: The watched values.
        slack: Difference of instants that are one [s].
    """
    stops = [(instant, number) for instant, number in crossings if watches[number].stops]
    if not stops:
        return list(crossings), None
    first = stops[0][0]
    instant, stopping = min((each for each in stops if each[0] <= first + slack), key=lambda each: each[1])
    before = [(min(t, instant), number) for t, number in crossings
              if not watches[number].stops and t <= first + slack]  # fmt: skip
    return [*before, (instant, stopping)], instant


def keeps_sign(values: Array) -> Flags:
    """Return for which rows of values at the nodes the Chebyshev series has one sign: ``|c_0| > sum |c_k|``; (m,).

    Of those that it may bring to 0 but for rounding that is not said.
    """
    return _is_one_sided(series_of(values))


def _is_one_sided(series: Array) -> Flags:
    """Return the same of the series, shape (.., k) to (..)."""
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
    """Return intervals in [0, 1], each with one zero crossing in the given direction of values at the nodes.

    Also whether the values are positive before it. Where they turn back at 0 both ends are the place at which they do;
    the crossings just before and behind it are none.

    Args:
        values: The values.
        direction: See ``Watch``.
        level: See ``Watch``.
        turns: Where they turn.
    """
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
    """Return between which two neighbouring roots a place is, shape (n - 1,)."""
    return np.asarray((roots[:-1] <= place) & (place <= roots[1:]))


def _refined(
    solution: Solution, index: int, watch: Watch, bracket: tuple[float, float], *, above: bool
) -> float | None:
    """Return the first instant after a crossing in a bracket, to rounding [s]; ``None`` where only its series has one.

    At the end of a step the state is closed, and the value of that counts.

    Args:
        solution: The solution.
        index: Index of the step.
        watch: What is watched.
        bracket: Two instants [s]; the crossing may lie before the first by the rounding of the series.
        above: Whether the value is positive before the crossing.
    """
    low, high = bracket

    def value(*t: float) -> list[float]:
        found = watch.value(np.array(t), *solution.states_in(np.full(len(t), index), np.array(t)))
        return [one or math.ulp(0.0) for one in found.tolist()]

    begins = float(solution.steps.t[index])
    first, at_low, at_high = value(begins, low, high)  # together: at the end of an interval, what is before its jumps
    if (at_low > 0.0) != above and (first > 0.0) == above:
        low, high, at_low, at_high = begins, low, first, at_low
    if (at_low > 0.0) == (at_high > 0.0):
        return high if (at_low > 0.0) == above and high >= float(solution.steps.until[index]) else None
    return _sign_change(lambda t: value(t)[0], (low, high), (at_low, at_high))


def _counts(solution: Solution, index: int, watch: Watch, instant: float) -> bool:
    """Tell whether a crossing of a watched value in a step counts."""
    t = np.array([instant])
    return watch.counts is None or bool(watch.counts(t, *solution.states_in(np.array([index]), t))[0])


def _leaves(solution: Solution, index: int, watch: Watch, instant: float, values: Array) -> bool:
    """Tell whether a value only leaves 0, where the motion begins, at an instant of its first step."""
    t = watch.begins + np.array([0.0, 0.5, 1.0]) * (instant - watch.begins)
    before = watch.value(t, *solution.states_in(np.full(len(t), index), t))
    return bool(np.abs(before).max() <= LEFT * np.abs(values).max() + ROUNDED)


def _stays(
    solution: Solution, watch: Watch, found: tuple[int, float], crossings: Sequence[tuple[float, int]],
    turns: Sequence[Turn],
) -> bool:  # fmt: skip
    """Tell whether a value has been 0, but for its error, since it last came to 0: then it does not come to 0 again.

    Args:
        solution: The solution.
        watch: What is watched.
        found: Its index, and when it is 0 [s].
        crossings: Crossings in the step until then.
        turns: Turns in the step until then.
    """
    number, instant = found
    known = [solution.nearest[number]] if number in solution.nearest else []
    error = max((turn.error for turn in [*known, *turns] if turn.watch == number and turn.is_open), default=0.0)
    earlier = [t for t, k in crossings if k == number and t <= instant]
    earlier = earlier or [one.t for one in solution.crossings[::-1] if one.watch == number][:1]
    if not error or not earlier:
        return False
    t = np.linspace(earlier[-1], instant, 5)
    return bool(np.abs(watch.value(t, *solution.states(t))).max() <= error)


def _reaches(solution: Solution, index: int, watch: Watch, start: float, end: float) -> bool:
    """Tell whether a value comes to 0, but for rounding, where the integration ends; see ``Watch.level``.

    Args:
        solution: The solution.
        index: Index of the last step.
        watch: What is watched.
        start: Start of the step, or the last crossing in it [s].
        end: When the integration ends [s].
    """
    if watch.level is None or not start < end:
        return False
    t, step = np.array([0.5 * (start + end), end]), solution.steps[index]
    middle, last = watch.value(t, *solution.states_in(np.full(2, index), t))
    soon = SAME_INSTANT * max(abs(end), abs(step.h)) / (end - start)
    rounding = (REACHED + soon) * abs(middle) + DIGITS * watch.level
    there = abs(last) <= rounding < abs(middle) and watch.direction in (0, -1 if middle > 0.0 else 1)
    return bool(there) and _counts(solution, index, watch, end)


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
