"""Optimisation: least value of a number of the run between bounds of the unknowns, with conditions.

With the unknowns scaled to [0, 1] between their bounds, every start is followed down by sequential quadratic
programming (SLSQP; Kraft, DFVLR-FB 88-28, 1988) with slopes by central differences. Where the best end is in a kink, as
peaks of curves have them, or beside refused runs, it is improved without slopes (COBYQA; Ragonneau, 2022). Global
searches begin with differential evolution (Storn and Price, J. Global Optim. 11, 1997) in place of the starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import IntegrationError
from pinarm.records import replace
from pinarm.use.result.numbers import Condition

DIFFERENCE = 1e-4
"""Half width of a difference, of the scaled unknowns: slopes err by its square, and by the error of runs over it."""

KEPT = 1e-6
"""Violation of a condition, relative to its size, up to which it counts as kept."""

ACTIVE = 1e-4
"""Margin of a condition, relative to its size, up to which it holds an optimum where it is."""

REFUSED = 10.0
"""Scaled objective of runs that are refused, above the worst one that is not."""

VANISHES = 1e-4
"""Objective at the optimum, relative to that at the starts, below which the latter is what changes are relative to."""

BESIDE = 1e-3
"""Largest distance of refused runs from the best point, scaled, at which they may hold it where it is."""

SMALLEST = 1e-6
"""Least size of an objective, relative to that at the starts, by which the best end is followed again."""

SAME = 1e-12
"""Differences of the objective, relative to it, that are rounding."""

SETTLED, FURTHER, KINK = "settled", "once more, from the best of the ends", 1e-2
"""Ends of searches; jump of slopes, scaled, that is a kink."""

POLISH_RADII, POLISH_RUNS = (1e-3, 1e-8), 60
"""First and last radius of the search without slopes, scaled, and most runs for each unknown."""

GENERATIONS, POPULATION = 40, 8
"""Of differential evolution: most generations, and points per unknown in each."""


@dataclass(frozen=True)
class Trial:
    """Objective and margins of one run.

    Attributes:
        objective: Value to minimise.
        margins: Margin of each condition, negative where it is violated; of equations the difference.
        refusal: Why the run does not count; empty where it does.
    """

    objective: float = math.inf
    margins: tuple[float, ...] = ()
    refusal: str = ""


@dataclass(frozen=True, eq=False)
class Landscape:
    """Objective and conditions over the scaled unknowns; every point is run once, several at once.

    Attributes:
        low: Lower bounds in SI, shape (k,).
        high: Upper bounds, shape (k,).
        start: The first start, in SI, shape (k,).
        run: Values in SI of several points -> what a run with each says.
        conditions: What others must keep to.
        sizes: What margins are relative to, one for every condition.
        size: Size of the objective.
        squared: Whether the square of the objective is searched, which is smooth where an rms value or a peak vanishes.
    """

    low: Array
    high: Array
    start: Array
    run: Callable[[Sequence[Array]], Sequence[Trial]]
    conditions: Sequence[Condition] = ()
    sizes: Sequence[float] = ()
    squared: bool = False
    size: float = 1.0
    trials: dict[bytes, tuple[Array, Trial]] = field(default_factory=dict)

    @cached_property
    def equations(self) -> Flags:
        """For every condition, whether it is an equation."""
        return np.array([condition.relation == "=" for condition in self.conditions], dtype=bool)

    def values(self, x: Array) -> Array:
        """Return the unknowns in SI at a scaled point."""
        return np.clip(self.low + x * (self.high - self.low), self.low, self.high)

    def scaled_point(self, values: Array) -> Array:
        """Return the scaled point of unknowns in SI."""
        return np.asarray((values - self.low) / (self.high - self.low))

    def trial(self, x: Array) -> Trial:
        """Return the trial of the run at a scaled point."""
        return self.look([x])[0]

    def look(self, points: Iterable[Array]) -> list[Trial]:
        """Return the trials of the runs at scaled points; no point is run twice."""
        clipped = [np.clip(np.asarray(x, dtype=float), 0.0, 1.0) for x in points]
        new = {x.tobytes(): x for x in clipped if x.tobytes() not in self.trials}
        if new:
            trials = self.run([self.values(x) for x in new.values()])
            self.trials.update(zip(new, zip(new.values(), trials, strict=True), strict=True))
        return [self.trials[x.tobytes()][1] for x in clipped]

    def scaled(self) -> Landscape:
        """Return a copy with the objective relative to the median over the runs so far."""
        sizes = [abs(trial.objective) for _, trial in self.trials.values() if not trial.refusal]
        return replace(self, size=float(np.median(sizes)) if sizes and np.median(sizes) > 0.0 else 1.0)

    def height(self, x: Array) -> float:
        """Return the scaled objective at a point; above all others where the run is refused."""
        trial = self.trial(x)
        if trial.refusal:
            worst = max((abs(other.objective) for _, other in self.trials.values() if not other.refusal), default=1.0)
            return REFUSED * self._scaled(worst)
        return self._scaled(trial.objective)

    def _scaled(self, objective: float) -> float:
        return (objective / self.size) ** 2 if self.squared else objective / self.size

    def margins(self, x: Array) -> Array:
        """Return the scaled margins of all conditions at a point; -1 where the run is refused."""
        trial = self.trial(x)
        return -np.ones(len(self.sizes)) if trial.refusal else np.array(trial.margins) / np.array(self.sizes)

    def violation(self, x: Array) -> float:
        """Return the largest violation of a condition at a point, relative to its size."""
        return float(np.max(self._violations(x), initial=0.0))

    def _violations(self, x: Array) -> Array:
        margins = self.margins(x)
        return np.where(self.equations, np.abs(margins), -margins)

    def shortfall(self, x: Array) -> str:
        """Return the most violated condition at a point whose run is not refused, and the violation."""
        k = int(np.argmax(self._violations(x)))
        return f"'{self.conditions[k]}' by {self.conditions[k].measured(abs(self.trial(x).margins[k]))}"

    def slopes(self, x: Array) -> Array:
        """Return the gradients of objective and margins, shape (1 + conditions, k): differences of runs that count."""
        columns, units = [], np.eye(len(x))
        beside = [[np.clip(x + sign * DIFFERENCE * unit, 0.0, 1.0) for sign in (1.0, -1.0)] for unit in units]
        self.look([x, *(side for sides in beside for side in sides)])
        for unit, sides in zip(units, beside, strict=True):
            ahead, behind = (x if self.trial(side).refusal else side for side in sides)
            way = float((ahead - behind) @ unit)
            change = self._levels(ahead) - self._levels(behind)
            columns.append(change / way if way else np.zeros(len(change)))
        return np.ascontiguousarray(np.array(columns).T)  # SLSQP of scipy 1.17 reads others wrongly

    def kink(self, x: Array) -> float:
        """Return the largest jump of a slope at a point: of the slopes ahead and behind, less what curvature makes."""
        if not (np.abs(x - 0.5) + DIFFERENCE < 0.5).all():
            return 0.0
        jumps, units = [0.0], DIFFERENCE * np.eye(len(x))
        self.look([x, *(x + scale * unit for unit in units for scale in (1.0, -1.0, 0.5, -0.5))])
        for unit in units:
            wide, near = (self._bend(x, scale * unit) for scale in (1.0, 0.5))
            jumps.append(float(np.abs(4.0 * near - wide).max()) / DIFFERENCE)
        return max(jumps)

    def _bend(self, x: Array, step: Array) -> Array:
        return self._levels(x + step) + self._levels(x - step) - 2.0 * self._levels(x)

    def _levels(self, x: Array) -> Array:
        return np.array([self.height(x), *self.margins(x)])

    def rank(self, x: Array) -> tuple[float, float]:
        """Return the sort key of a point: the violation, 0 where it is tolerated, then the objective."""
        violation = self.violation(x)
        return (violation if violation > KEPT else 0.0, self.height(x))


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
class Optimum:
    """The best point, and how it was found.

    Attributes:
        best: The best end.
        descents: All starts and where they led; last, where there was one, the search from the best end without
            slopes, or along the border of refused runs.
        active: Numbers of the conditions that hold it there.
        refused: Numbers of the unknowns beside whose best values runs were refused.
        size: Size of the objective at the best point, at the starts where it vanishes.
        runs: Number of runs in all.
        flat: Whether the objective is the same in all of them, but for rounding.
        largest: Largest size of the objective in all of them.
    """

    best: Descent
    descents: Sequence[Descent]
    active: Sequence[int]
    refused: Sequence[int]
    size: float
    runs: int
    flat: bool = False
    largest: float = math.inf


def optimum(landscape: Landscape, starts: int, seed: int, *, everywhere: bool = False) -> Optimum:
    """Return the best point.

    Args:
        landscape: Objective and conditions.
        starts: Number of starts.
        seed: Seed of their choice.
        everywhere: Whether differential evolution takes the place of the starts.

    Raises:
        IntegrationError: No start can be run, or none leads to where all conditions hold.
    """
    points = spread(len(landscape.low), starts, seed)
    points[0] = landscape.scaled_point(landscape.start)
    landscape.look(points)
    landscape = landscape.scaled()
    if everywhere:
        points = [_evolved(landscape, seed)]
    descents = [_descent(landscape, point, _slsqp) for point in points]
    best = min(descents, key=_rank)
    if best.valid and best.trial.objective:
        size = max(abs(best.trial.objective), SMALLEST * landscape.size)
        landscape = replace(landscape, size=size)
        best = min(best, _descent(landscape, landscape.scaled_point(best.end), _slsqp), key=_rank)
    if not best.trial.refusal and _is_sharp(landscape, best):
        best = _descent(landscape, landscape.scaled_point(best.end), _cobyqa)
    if all(best is not end for end in descents):
        best = replace(best, status=FURTHER)
        descents.append(best)
    if not best.valid:
        raise _nowhere(landscape, best, len(points))
    return _optimum(landscape, best, descents)


def _optimum(landscape: Landscape, best: Descent, descents: Sequence[Descent]) -> Optimum:
    """Return the best point with its active conditions, refused runs beside it, and whether the objective is flat."""
    x = landscape.scaled_point(best.end)
    margins = landscape.margins(x)
    active = [k for k, equal in enumerate(landscape.equations) if equal or margins[k] <= ACTIVE]
    steps = [point - x for point, trial in landscape.trials.values() if trial.refusal]
    near = [np.abs(step) for step in steps if np.abs(step).max() <= BESIDE]
    refused = sorted({int(step.argmax()) for step in near})
    values = np.array([trial.objective for _, trial in landscape.trials.values() if not trial.refusal])
    size, largest = abs(best.trial.objective), float(np.abs(values).max())
    return Optimum(
        best,
        descents,
        active,
        refused,
        size if size > VANISHES * landscape.size else landscape.size,
        len(landscape.trials),
        bool(np.ptp(values) <= SAME * largest),
        largest,
    )


def spread(k: int, count: int, seed: int) -> list[Array]:
    """Return points that fill the unit cube of k dimensions evenly: a Latin hypercube, always the same for a seed."""
    rng = np.random.default_rng(seed)
    columns = [(rng.permutation(count) + 0.5) / count for _ in range(k)]
    return list(np.array(columns).T)


def _rank(descent: Descent) -> tuple[bool, float, float]:
    return not descent.valid, 0.0 if descent.valid else descent.violation, descent.trial.objective


def _is_sharp(landscape: Landscape, best: Descent) -> bool:
    """Return whether slopes say little at the best end: it is in a kink, beside refused runs, or not settled."""
    x = landscape.scaled_point(best.end)
    return best.status != SETTLED or landscape.kink(x) > KINK


def _descent(landscape: Landscape, start: Array, search: Callable[[Landscape, Array], str]) -> Descent:
    """Return the best point that a search comes to from a start, among all that it has run."""
    before, known = len(landscape.trials), dict(landscape.trials)
    if refusal := landscape.trial(start).refusal:
        values = landscape.values(start)
        return Descent(values, values, landscape.trial(start), math.inf, 1, f"refused: {refusal}")
    status = search(landscape, start)
    visited = [start, *(x for key, (x, _) in landscape.trials.items() if key not in known)]
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
            parts.append(
                {
                    "type": kind,
                    "fun": lambda x, rows=rows: landscape.margins(x)[rows],
                    "jac": lambda x, rows=rows: landscape.slopes(x)[1 + rows],
                }
            )
    ended = minimize(
        landscape.height, start, jac=lambda x: landscape.slopes(x)[0], bounds=[(0.0, 1.0)] * len(start),
        constraints=parts, method="SLSQP", options={"maxiter": 50, "ftol": 1e-10},
    )  # fmt: skip
    return SETTLED if ended.success else f"stopped: {str(ended.message).lower()}"


def _cobyqa(landscape: Landscape, start: Array) -> str:
    from scipy.optimize import minimize

    first, last = POLISH_RADII
    minimize(
        landscape.height,
        start,
        bounds=[(0.0, 1.0)] * len(start),
        constraints=_constraints(landscape),
        method="COBYQA",
        options={"initial_tr_radius": first, "final_tr_radius": last, "maxfev": POLISH_RUNS * len(start)},
    )
    return FURTHER


def _evolved(landscape: Landscape, seed: int) -> Array:
    from scipy.optimize import differential_evolution

    ended = differential_evolution(
        landscape.height, [(0.0, 1.0)] * len(landscape.low), constraints=_constraints(landscape), seed=seed,
        polish=False, maxiter=GENERATIONS, popsize=POPULATION, tol=1e-3,
        x0=landscape.scaled_point(landscape.start),
    )  # fmt: skip
    return np.asarray(ended.x)


def _constraints(landscape: Landscape) -> tuple[object, ...]:
    from scipy.optimize import NonlinearConstraint

    if not landscape.sizes:
        return ()
    upper = np.where(landscape.equations, 0.0, np.inf)
    return (NonlinearConstraint(landscape.margins, np.zeros(len(upper)), upper),)


def _nowhere(landscape: Landscape, best: Descent, starts: int) -> IntegrationError:
    """Return the error of a search that has not come to a point that counts."""
    if best.trial.refusal:
        return IntegrationError(
            f"none of the {starts} starts can be run: {best.trial.refusal}",
            hint="bounds between which the mechanism can be assembled and moved, or more starts",
        )
    return IntegrationError(
        f"none of the {starts} starts leads to where all conditions hold: the nearest end violates "
        f"{landscape.shortfall(landscape.scaled_point(best.end))}",
        hint="wider bounds, a weaker condition, or more starts",
    )
