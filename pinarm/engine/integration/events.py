"""Location of events: instants at which a watched value crosses zero, on the dense output."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.integration.integrator import Crossing, Solution
from pinarm.records import ValueRecord

PARTS, REFINEMENTS = 16, 14
"""Parts into which a bracket is divided, and how often: 16^-14 is below the rounding of a double."""

NEGLIGIBLE = 1e-14
"""Size of the last coefficients of a series that are rounding, over the largest; they would disturb its roots."""

BESIDE = 1e-3
"""Part of a step up to which roots outside of it are told from those within: one at an end may be on either side. Signs
between the roots decide what is a crossing."""

SAME_INSTANT = 1e-13
"""Difference of two instants, relative to the time or the step, that is rounding of their roots: what is watched at the
instant that ends the integration is recorded, whichever comes first."""

CONVERGED, MOST_PARTS = 1e-3, 4096
"""Size of the last coefficients of a series that has converged, over the largest; and most steps tried for it."""


class Watch(ValueRecord, frozen=True):
    """A function of the state whose zero crossings are located along a motion.

    Attributes:
        value: ``(t, q, v) -> g`` of many states at once, shape (n,).
        direction: 1 for rising crossings, -1 for falling ones, 0 for both.
        stops: Whether the integration ends at the first crossing.
        loaded: Whether it depends on loads, and is not negative as long as the motion lasts: where loads jump at a
            sample and it is negative then, the integration ends there.
    """

    value: Callable[[Array, Array, Array], Array]
    direction: int
    stops: bool
    loaded: bool = False


def possible_crossings(solution: Solution, watches: Sequence[Watch], first: int, y: Array) -> Indices:
    """Return in which steps of a solution a watched value may cross zero: bounds on its Chebyshev series decide.

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
    kept = np.all([keeps_sign(watch.value(*flat).reshape(shape[:2])) for watch in watches], axis=0)
    return np.asarray(indices[~kept])


def locate_crossings(solution: Solution, watches: Sequence[Watch], index: int, y: Array) -> bool:
    """Record the zero crossings in a step of a solution, and end the step at one that stops the integration.

    Each value is interpolated by a Chebyshev polynomial at ``2 method.subdivisions + 1`` points of the step, all of
    whose roots are computed: a coordinate that is linear in q is such a polynomial, and none of its crossings is
    missed, however close they are. Each root is then refined on the value itself. A value of exactly 0 counts as
    positive.

    Args:
        solution: Solution whose crossings are recorded.
        watches: The watched values.
        index: Index of the step.
        y: State at the end of the step, projected onto the constraints, shape (nq + nv,).

    Returns:
        Whether the integration stops.
    """
    step, nq = solution.steps[index], solution.manifold.nq
    t = step.t + step.h * nodes(solution.method.subdivisions)
    t[-1] = step.until
    states = solution.states_in(np.full(len(t), index), t)
    states[0][0], states[1][0], states[0][-1], states[1][-1] = step.y[:nq], step.y[nq:], y[:nq], y[nq:]
    crossings = []
    for number, watch in enumerate(watches):
        for low, high, above in _brackets(watch.value(t, *states), watch.direction):
            bracket = step.t + step.h * low, step.t + step.h * high
            crossings.append((_refined(solution, index, watch, bracket, above=above), number))
    within, stop = _until_stop(sorted(crossings), watches, SAME_INSTANT * max(abs(step.t), abs(step.h)))
    for instant, number in within:
        q, v = solution.states_in(np.array([index]), np.array([instant]))
        solution.crossings.append(Crossing(number, instant, q[0], v[0]))
    if stop is not None:
        solution.steps.end_at(index, stop)
    return stop is not None


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


@cache
def nodes(parts: int) -> Array:
    """Return the Chebyshev points of [0, 1], ends included: ``(1 - cos(pi k / n)) / 2``, n = 2 parts; (n + 1,)."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(2 * parts + 1) / (2 * parts))


@cache
def _to_series(parts: int) -> Array:
    """Return the matrix from values at the nodes to Chebyshev coefficients on [-1, 1]."""
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(2.0 * nodes(parts) - 1.0, 2 * parts)))


def keeps_sign(values: Array) -> Flags:
    """Return for which rows of values at the nodes the Chebyshev series has one sign: ``|c_0| > sum |c_k|``; (m,)."""
    series = values @ _to_series(values.shape[1] // 2).T
    return np.asarray(np.abs(series[:, 0]) > np.abs(series[:, 1:]).sum(axis=1))


def resolving_parts(watches: Sequence[Watch], start: float, end: float, parts: int) -> int:
    """Return into how many equal steps to divide an interval on which nothing moves, so that no crossing is missed.

    On each step up to the first crossing the Chebyshev series of every value at the nodes has to have converged.

    Args:
        watches: The watched values, which depend on the time only.
        start: Start of the interval [s].
        end: Its end [s].
        parts: Half the number of nodes less one, ``method.subdivisions``.
    """
    nothing, count = np.zeros((2 * parts + 1, 0)), 1
    while count < MOST_PARTS:
        h = (end - start) / count
        steps = (start + h * (k + nodes(parts)) for k in range(count))
        if _shows_all(watches, steps, nothing):
            break
        count *= 2
    return count


def _shows_all(watches: Sequence[Watch], steps: Iterable[Array], nothing: Array) -> bool:
    """Return whether the series of values have converged on all steps up to the first that shows a crossing."""
    for t in steps:
        found = [watch.value(t, nothing, nothing) for watch in watches]
        if not all(_converged(each) for each in found):
            return False
        if any((each < 0.0).any() for each in found):
            break
    return True


def _converged(values: Array) -> bool:
    series = np.abs(_to_series(len(values) // 2) @ values)
    return bool(series[-2:].max() <= CONVERGED * series.max())


def _brackets(values: Array, direction: int) -> list[tuple[float, float, bool]]:
    """Return intervals in [0, 1], each with one zero crossing in the given direction of values at the nodes.

    Also whether the values are positive before it.
    """
    series = _to_series(len(values) // 2) @ values
    one_sided = abs(series[0]) > np.abs(series[1:]).sum()
    if one_sided or not np.isfinite(series).all():
        return []
    significant = np.flatnonzero(np.abs(series) > NEGLIGIBLE * np.abs(series).max())
    roots = np.polynomial.chebyshev.chebroots(series[: significant[-1] + 1]) if len(significant) else np.zeros(0)
    real = np.sort(0.5 + 0.5 * roots.real[np.abs(roots.imag) < 1e-4])
    here = np.clip(real[(real > -BESIDE) & (real < 1.0 + BESIDE)], 0.0, 1.0)
    bounds = np.concatenate([[0.0], 0.5 * (here[1:] + here[:-1]), [1.0]])
    between = np.polynomial.chebyshev.chebval(2.0 * bounds - 1.0, series)
    between[0], between[-1] = values[0], values[-1]
    above = between >= 0.0
    for k in range(1, len(bounds) - 1):  # two roots of a value that only touches 0 have rounding between them
        if abs(between[k]) <= NEGLIGIBLE * np.abs(series).max():
            above[k] = above[k - 1]
    return [
        (float(bounds[k]), float(bounds[k + 1]), bool(above[k]))
        for k in range(len(bounds) - 1)
        if above[k] != above[k + 1] and direction in (0, 1 if above[k + 1] else -1)
    ]


def _refined(solution: Solution, index: int, watch: Watch, bracket: tuple[float, float], *, above: bool) -> float:
    """Return the first instant after the crossing within a bracket, to rounding [s].

    Args:
        solution: The solution.
        index: Index of the step.
        watch: What is watched.
        bracket: Two instants [s]; the crossing may lie before the first by the rounding of the series.
        above: Whether the value is positive before the crossing.
    """
    low, high = bracket

    def value(t: Array) -> Array:
        return watch.value(t, *solution.states_in(np.full(len(t), index), t))

    begins = float(solution.steps.t[index])
    first_above, low_above = value(np.array([begins, low])) >= 0.0
    if low_above != above and first_above == above:
        low, high = begins, low
    else:
        above = bool(low_above)
    for _ in range(REFINEMENTS):
        t = np.linspace(low, high, PARTS + 1)
        beyond = np.flatnonzero((value(t[1:-1]) >= 0.0) != above)
        first = int(beyond[0]) + 1 if len(beyond) else PARTS
        low, high = float(t[first - 1]), float(t[first])
    return high
