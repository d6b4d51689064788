"""The best values between bounds: an objective least, conditions kept, from several starts.

With the unknowns scaled to [0, 1] between their bounds, every start is followed down by sequential quadratic
programming (SLSQP; Kraft, DFVLR-FB 88-28, 1988) along central differences, all side by side. Where the best of the ends
lies in a kink, as peaks of curves have them, it is searched once more without slopes (COBYQA; Ragonneau, 2022); where
runs are refused beyond it, along the border of these: see ``border``.
Global searches begin with differential evolution (Storn and Price, J. Global Optim. 11, 1997) in place of the starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import IntegrationError
from pinarm.records import replace
from pinarm.use.scenario.border import Border, along_border
from pinarm.use.scenario.landscape import ACTIVE, DIFFERENCE, KEPT, Landscape, Trial
from pinarm.use.scenario.lockstep import Run, side_by_side

FLAT = 0.01
"""Change of the objective, relative to it, by which is told how flat an optimum is."""

FIRST_STEP, EDGE, NOWHERE = 0.02, 0.05, 1e-4
"""Of the way along which flatness is told, scaled: first step, its relative accuracy, and below which it is 0."""

VANISHES = 1e-4
"""Objective at the optimum, relative to that at the starts, below which the latter is what changes are relative to."""

FINER, AGAIN = 1e-2, 5
"""Objective at the best of the ends, relative to the size that slopes are seen by, below which all ends are followed
again by slopes of its own size; and how often."""

SAME = 1e-12
"""Differences of the objective, relative to it, that are rounding."""

SETTLED, WITHOUT_SLOPES, KINK = "settled", "without slopes, from the best of the ends", 1e-2
"""Ends of searches, along slopes to where none is left and without slopes; jump of slopes, scaled, that is a kink."""

POLISH_RADII, POLISH_RUNS = (1e-3, 1e-8), 60
"""First and last radius of the search without slopes, scaled, and most runs for each unknown."""

GENERATIONS, POPULATION = 40, 8
"""Of differential evolution: most generations, and points per unknown in each."""


@dataclass(frozen=True)
class Descent:
    """Where one start has led.

    Attributes:
        start: The unknowns there, in SI, shape (k,).
        end: The best point on the way, in SI, shape (k,).
        trial: The run there.
        violation: Largest violation of a condition there, relative to its size.
        runs: How many runs it took.
        status: How it ended, in words.
    """

    start: Array
    end: Array
    trial: Trial
    violation: float
    runs: int
    status: str

    @property
    def valid(self) -> bool:
        """Whether its run counts, and keeps all conditions."""
        return not self.trial.refusal and self.violation <= KEPT


@dataclass(frozen=True)
class Reach:
    """How far one unknown may go with the others held.

    Attributes:
        low: Lowest value, in SI.
        high: Highest value, in SI.
        stops: What ends it on either side: ``objective``, ``bound``, ``condition`` or ``run refused``.
    """

    low: float
    high: float
    stops: tuple[str, str]


@dataclass(frozen=True)
class Optimum:
    """The best point, and how it was found.

    Attributes:
        best: The best end.
        descents: All starts and where they led; last, where there was one, the search from the best end without
            slopes, or along the border of refused runs.
        active: Numbers of the conditions that hold it there.
        reaches: For every unknown, how far it may go until the objective is worse by ``allowance``.
        allowance: That change of the objective.
        runs: Number of runs in all.
        flat: Whether the objective is the same in all of them, but for rounding.
        largest: Largest size of the objective in all of them.
    """

    best: Descent
    descents: Sequence[Descent]
    active: Sequence[int]
    reaches: Sequence[Reach]
    allowance: float
    runs: int
    flat: bool = False
    largest: float = math.inf


def optimum(landscape: Landscape, starts: int, seed: int, *, everywhere: bool = False) -> Optimum:
    """Return the best point.

    Args:
        landscape: What is searched.
        starts: Number of starts.
        seed: Of their choice.
        everywhere: Whether differential evolution takes the place of the starts.

    Raises:
        IntegrationError: No start can be run, or none leads to where all conditions hold.
    """
    points = spread(len(landscape.low), starts, seed)
    points[0] = (landscape.start - landscape.low) / (landscape.high - landscape.low)
    landscape.look(points)
    landscape = landscape.scaled()
    if everywhere:
        points = [_evolved(landscape, seed)]
    descents = _descents(landscape, points)
    best = _best(descents)
    for _ in range(AGAIN):
        if not _is_coarse(landscape, best):
            break
        landscape = replace(landscape, size=abs(best.trial.objective))
        descents = _followed(landscape, descents)
        best = _best(descents)
    if search := _further(landscape, best):
        descents.append(_descent(landscape, _scaled(landscape, best.end), search))
        best = descents[-1]
    if not best.valid:
        raise _nowhere(landscape, best, len(points))
    x = _scaled(landscape, best.end)
    margins = landscape.margins(x)
    active = [k for k, equal in enumerate(landscape.equations) if equal or margins[k] <= ACTIVE]
    size = abs(best.trial.objective)
    allowance = FLAT * (size if size > VANISHES * landscape.size else landscape.size)
    reaches = [_reach(landscape, x, k, best.trial.objective + allowance) for k in range(len(x))]
    told = np.array([trial.objective for _, trial in landscape.trials.values() if not trial.refusal])
    largest = float(np.abs(told).max())
    flat = bool(np.ptp(told) <= SAME * largest)
    return Optimum(best, descents, active, reaches, allowance, len(landscape.trials), flat, largest)


def spread(k: int, count: int, seed: int) -> list[Array]:
    """Return points that fill the unit cube of k dimensions evenly: a Latin hypercube, always the same for a seed."""
    rng = np.random.default_rng(seed)
    columns = [(rng.permutation(count) + 0.5) / count for _ in range(k)]
    return list(np.array(columns).T)


def _descents(landscape: Landscape, points: Sequence[Array]) -> list[Descent]:
    """Return where points lead; none of them knows of the runs of the others, which are done side by side."""
    apart = [replace(landscape, trials=dict(landscape.trials)) for _ in points]

    def follow(number: int, run: Run) -> Descent:
        return _descent(replace(apart[number], run=run), points[number], _slsqp)

    descents = side_by_side([partial(follow, number) for number in range(len(points))], landscape.run)
    for each in apart:
        landscape.trials.update(each.trials)
    return descents


def _best(descents: Sequence[Descent]) -> Descent:
    return min(descents, key=lambda one: (not one.valid, one.violation if not one.valid else 0.0, one.trial.objective))


def _further(landscape: Landscape, best: Descent) -> Callable[[Landscape, Array], str] | None:
    """Return the search that goes on from the best end; none where it is in a smooth valley."""
    if best.trial.refusal:
        return None
    x = _scaled(landscape, best.end)
    if Border.beside(landscape, x):
        return along_border
    return _cobyqa if best.status != SETTLED or landscape.kink(x) > KINK else None


def _is_coarse(landscape: Landscape, best: Descent) -> bool:
    """Tell whether slopes are seen by a size far above the objective at the best end, and it does not vanish there.

    It does where it is more than twice as large on all sides between the bounds.
    """
    least = abs(best.trial.objective)
    if not best.valid or not 0.0 < least < FINER * landscape.size:
        return False
    x = _scaled(landscape, best.end)
    sides = [x + sign * DIFFERENCE * unit for unit in np.eye(len(x)) for sign in (1.0, -1.0)]
    trials = landscape.look(side for side in sides if (np.clip(side, 0.0, 1.0) == side).all())
    return any(abs(trial.objective) <= 2.0 * least for trial in trials if not trial.refusal)


def _followed(landscape: Landscape, descents: Sequence[Descent]) -> list[Descent]:
    """Return where ends lead; what could not be run is left as it is."""
    further = _descents(landscape, [_scaled(landscape, one.end) for one in descents])
    return [
        before if one.trial.refusal else replace(one, start=before.start, runs=before.runs + one.runs)
        for before, one in zip(descents, further, strict=True)
    ]


def _descent(landscape: Landscape, start: Array, search: Callable[[Landscape, Array], str]) -> Descent:
    """Return the best point that a search comes to from a start, among all that it has run."""
    before, own = len(landscape.trials), dict(landscape.trials)
    if refusal := landscape.trial(start).refusal:
        values = landscape.values(start)
        return Descent(values, values, landscape.trial(start), math.inf, 1, f"refused: {refusal}")
    status = search(landscape, start)
    visited = [start, *(x for key, (x, _) in landscape.trials.items() if key not in own)]
    end = min((x for x in visited if not landscape.trial(x).refusal), key=landscape.rank)
    runs = len(landscape.trials) - before
    ends = landscape.values(start), landscape.values(end)
    return Descent(*ends, landscape.trial(end), landscape.violation(end), runs, status)


def _slsqp(landscape: Landscape, start: Array) -> str:
    from scipy.optimize import minimize

    parts = []
    for kind, chosen in (("eq", True), ("ineq", False)):
        rows = np.flatnonzero(np.array(landscape.equations, dtype=bool) == chosen)
        if len(rows):
            parts.append({
                "type": kind, "fun": lambda x, rows=rows: landscape.margins(x)[rows],
                "jac": lambda x, rows=rows: landscape.slopes(x)[1 + rows],
            })  # fmt: skip
    ended = minimize(
        landscape.height, start, jac=lambda x: landscape.slopes(x)[0], bounds=[(0.0, 1.0)] * len(start),
        constraints=parts, method="SLSQP", options={"maxiter": 50, "ftol": 1e-10},
    )  # fmt: skip
    return SETTLED if ended.success else f"stopped: {str(ended.message).lower()}"


def _cobyqa(landscape: Landscape, start: Array) -> str:
    from scipy.optimize import minimize

    first, last = POLISH_RADII
    minimize(
        landscape.height, start, bounds=[(0.0, 1.0)] * len(start), constraints=_constraints(landscape), method="COBYQA",
        options={"initial_tr_radius": first, "final_tr_radius": last, "maxfev": POLISH_RUNS * len(start)},
    )  # fmt: skip
    return WITHOUT_SLOPES


def _evolved(landscape: Landscape, seed: int) -> Array:
    from scipy.optimize import differential_evolution

    ended = differential_evolution(
        landscape.height, [(0.0, 1.0)] * len(landscape.low), constraints=_constraints(landscape), seed=seed,
        polish=False, maxiter=GENERATIONS, popsize=POPULATION, tol=1e-3,
        x0=(landscape.start - landscape.low) / (landscape.high - landscape.low),
    )  # fmt: skip
    return np.asarray(ended.x)


def _constraints(landscape: Landscape) -> tuple[object, ...]:
    from scipy.optimize import NonlinearConstraint

    if not landscape.sizes:
        return ()
    upper = np.where(landscape.equations, 0.0, np.inf)
    return (NonlinearConstraint(landscape.margins, np.zeros(len(upper)), upper),)


def _scaled(landscape: Landscape, values: Array) -> Array:
    return np.asarray((values - landscape.low) / (landscape.high - landscape.low))


def _reach(landscape: Landscape, x: Array, k: int, allowed: float) -> Reach:
    """Return how far an unknown may go with the others held: doubled steps until something ends it, then halves."""
    sides = [_edge(landscape, x, sign * np.eye(len(x))[k], allowed) for sign in (-1.0, 1.0)]
    (low, below), (high, above) = sides
    return Reach(landscape.values(x - low * np.eye(len(x))[k])[k], landscape.values(x + high * np.eye(len(x))[k])[k],
                 (below, above))  # fmt: skip


def _edge(landscape: Landscape, x: Array, direction: Array, allowed: float) -> tuple[float, str]:
    """Return how far it is to where the objective is worse than allowed, scaled, and what is met there."""
    room = float(1.0 - x @ direction) if direction.sum() > 0 else float(-(x @ direction))
    good, bad, met = 0.0, FIRST_STEP, ""
    while not met and good < room:
        bad = min(bad, room)
        met = _obstacle(landscape, x + bad * direction, allowed)
        good, bad = (good, bad) if met else (bad, 3.0 * bad)
    if not met:
        return room, "bound"
    while bad - good > EDGE * bad and bad > NOWHERE:
        middle = 0.5 * (good + bad)
        here = _obstacle(landscape, x + middle * direction, allowed)
        good, bad, met = (good, middle, here) if here else (middle, bad, met)
    return good, met


def _obstacle(landscape: Landscape, x: Array, allowed: float) -> str:
    trial = landscape.trial(x)
    if trial.refusal:
        return "run refused"
    if landscape.violation(x) > KEPT:
        return "condition"
    return "objective" if trial.objective > allowed else ""


def _nowhere(landscape: Landscape, best: Descent, starts: int) -> IntegrationError:
    """Return the error of a search that has not come to a point that counts."""
    if best.trial.refusal:
        return IntegrationError(
            f"none of the {starts} starts can be run: {best.trial.refusal}",
            hint="bounds between which the mechanism can be assembled and moved, or more starts",
        )
    return IntegrationError(
        f"none of the {starts} starts leads to where all conditions hold: the nearest end violates "
        f"{landscape.shortfall(_scaled(landscape, best.end))}", hint="wider bounds, a weaker condition, or more starts",
    )  # fmt: skip
