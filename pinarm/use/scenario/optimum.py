"""Optimisation: least value of a number of the run between bounds of the unknowns, with conditions.

With the unknowns scaled to [0, 1] between their bounds, every start is followed down by sequential quadratic
programming (SLSQP; Kraft, DFVLR-FB 88-28, 1988) with slopes by central differences. The best end is improved without
slopes (COBYQA; Ragonneau, 2022): it may be in a kink, as peaks of curves have them, or beside refused runs. Global
searches begin with differential evolution (Storn and Price, J. Global Optim. 11, 1997) in place of the starts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import IntegrationError
from pinarm.records import replace
from pinarm.use.result.numbers import Condition

DIFFERENCE = 1e-4
"""Half width of a difference, of the scaled unknowns: slopes err by its square, and by the error of runs over it."""

KEPT, ACTIVE = 1e-6, 1e-4
"""Relative to the size of a condition: violation up to which it is kept; margin up to which it holds an optimum."""

REFUSED = 10.0
"""Scaled objective of runs that are refused, above the worst one that is not."""

BESIDE = 1e-3
"""Largest distance of refused runs from the best point, scaled, at which they may hold it where it is."""

SAME = 1e-12
"""Differences of the objective, relative to it, that are rounding."""

FURTHER = "once more, from the best of the ends"
"""Name of the search without slopes among the starts."""

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
    """

    low: Array
    high: Array
    start: Array
    run: Callable[[Sequence[Array]], Sequence[Trial]]
    conditions: Sequence[Condition] = ()
    sizes: Sequence[float] = ()
    size: float = 1.0
    trials: dict[bytes, tuple[Array, Trial]] = field(default_factory=dict)

    @property
    def equations(self) -> Flags:
        """For every condition, whether it is an equation."""
        return np.array([condition.relation == "=" for condition in self.conditions], dtype=bool)

    @property
    def counted(self) -> list[float]:
        """Objectives of all runs that are not refused."""
        return [trial.objective for _, trial in self.trials.values() if not trial.refusal]

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

    def height(self, x: Array) -> float:
        """Return the scaled objective at a point; above all others where the run is refused."""
        trial = self.trial(x)
        if trial.refusal:
            return REFUSED * max(map(abs, self.counted), default=1.0) / self.size
        return trial.objective / self.size

    def margins(self, x: Array) -> Array:
        """Return the scaled margins of all conditions at a point; -1 where the run is refused."""
        trial = self.trial(x)
        return -np.ones(len(self.sizes)) if trial.refusal else np.array(trial.margins) / np.array(self.sizes)

    def violations(self, x: Array) -> Array:
        """Return the violations of all conditions at a point, relative to their sizes."""
        margins = self.margins(x)
        return np.where(self.equations, np.abs(margins), -margins)

    def violation(self, x: Array) -> float:
        """Return the largest violation of a condition at a point, relative to its size."""
        return float(np.max(self.violations(x), initial=0.0))

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
        descents: All starts and where they led; last, where it led further, the search from the best end.
        active: Numbers of the conditions that hold it there.
        refused: Numbers of the unknowns beside whose best values runs were refused.
        runs: Number of runs in all.
        size: Median size of the objective at the starts.
        change: Difference of the largest and the least objective in all runs.
    """

    best: Descent
    descents: Sequence[Descent]
    active: Sequence[int]
    refused: Sequence[int]
    runs: int
    size: float
    change: float

    def is_flat(self, rounding: float = 0.0) -> bool:
        """Tell whether the objective is the same in all runs but for rounding [SI]."""
        return self.change <= max(SAME * self.size, rounding)


def optimum(landscape: Landscape, starts: int, seed: int, *, everywhere: bool = False) -> Optimum:
    """Return the best point.

    Args:
        landscape: Objective and conditions.
        starts: Number of starts.
        seed: Seed of their choice.
        everywhere: Whether differential evolution takes the place of the starts.
    """
    points = spread(len(landscape.low), starts, seed)
    points[0] = landscape.scaled_point(landscape.start)
    landscape.look(points)
    landscape = replace(landscape, size=float(np.median(np.abs(landscape.counted or 0.0))) or 1.0)
    if everywhere:
        points = [_evolved(landscape, seed)]
    descents = [_descent(landscape, point, _slsqp) for point in points]
    best = min(descents, key=_rank)
    if not best.trial.refusal:
        further = _descent(landscape, landscape.scaled_point(best.end), _cobyqa)
        if _rank(further) < _rank(best):
            best = further
            descents.append(best)
    if not best.valid:
        raise _nowhere(landscape, best, len(points))
    return _optimum(landscape, best, descents)


def _optimum(landscape: Landscape, best: Descent, descents: Sequence[Descent]) -> Optimum:
    """Return the best point with its active conditions and the refused runs beside it."""
    x = landscape.scaled_point(best.end)
    margins = landscape.margins(x)
    active = [k for k, equal in enumerate(landscape.equations) if equal or margins[k] <= ACTIVE]
    steps = [np.abs(point - x) for point, trial in landscape.trials.values() if trial.refusal]
    refused = sorted({int(step.argmax()) for step in steps if step.max() <= BESIDE})
    change = float(np.ptp(landscape.counted))
    return Optimum(best, descents, active, refused, len(landscape.trials), landscape.size, change)


def spread(k: int, count: int, seed: int) -> list[Array]:
    """Return points that fill the unit cube of k dimensions evenly: a Latin hypercube, always the same for a seed."""
    rng = np.random.default_rng(seed)
    columns = [(rng.permutation(count) + 0.5) / count for _ in range(k)]
    return list(np.array(columns).T)


def _rank(descent: Descent) -> tuple[bool, float, float]:
    return not descent.valid, 0.0 if descent.valid else descent.violation, descent.trial.objective


def _descent(landscape: Landscape, start: Array, search: Callable[[Landscape, Array], str]) -> Descent:
    """Return the best point that a search comes to from a start, among all that it has run."""
    before, known = len(landscape.trials), set(landscape.trials)
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
    for kind, rows in (("eq", np.flatnonzero(landscape.equations)), ("ineq", np.flatnonzero(~landscape.equations))):
        if len(rows):
            margins = {"fun": lambda x, rows=rows: landscape.margins(x)[rows]}
            parts.append({"type": kind, **margins, "jac": lambda x, rows=rows: landscape.slopes(x)[1 + rows]})
    ended = minimize(
        landscape.height,
        start,
        jac=lambda x: landscape.slopes(x)[0],
        bounds=[(0.0, 1.0)] * len(start),
        constraints=parts,
        method="SLSQP",
        options={"maxiter": 50, "ftol": 1e-10},
    )
    return "settled" if ended.success else f"stopped: {str(ended.message).lower()}"


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
        landscape.height,
        [(0.0, 1.0)] * len(landscape.low),
        constraints=_constraints(landscape),
        seed=seed,
        polish=False,
        maxiter=GENERATIONS,
        popsize=POPULATION,
        tol=1e-3,
        x0=landscape.scaled_point(landscape.start),
    )
    return np.asarray(ended.x)


def _constraints(landscape: Landscape) -> tuple[object, ...]:
    from scipy.optimize import NonlinearConstraint

    if not landscape.sizes:
        return ()
    upper = np.where(landscape.equations, 0.0, np.inf)
    return (NonlinearConstraint(landscape.margins, np.zeros(len(upper)), upper),)


def _nowhere(landscape: Landscape, best: Descent, starts: int) -> IntegrationError:
    if best.trial.refusal:
        return IntegrationError(
            f"none of the {starts} starts can be run: {best.trial.refusal}",
            hint="bounds between which the mechanism can be assembled and moved, or more starts",
        )
    k = int(np.argmax(landscape.violations(landscape.scaled_point(best.end))))
    condition = landscape.conditions[k]
    return IntegrationError(
        f"none of the {starts} starts leads to where all conditions hold: the nearest end violates "
        f"'{condition}' by {condition.measured(abs(best.trial.margins[k]))}",
        hint="wider bounds, a weaker condition, or more starts",
    )
