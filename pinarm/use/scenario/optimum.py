"""Runs of searches; optimisation: least value of a number of the run between bounds of the unknowns, with conditions.

With the unknowns scaled to [0, 1] between their bounds, every start is followed down by sequential quadratic
programming (SLSQP; Kraft, DFVLR-FB 88-28, 1988) with slopes by central differences. The best end is improved without
slopes (COBYQA; Ragonneau, 2022): it may be in a kink, as peaks of curves have them, or beside refused runs. Global
searches begin with differential evolution (Storn and Price, J. Global Optim. 11, 1997) in place of the starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.errors import IntegrationError, PinarmError
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

POLISH_RUNS, POLISH = 60, {"initial_tr_radius": 1e-3, "final_tr_radius": 1e-8}
"""Most runs for each unknown of the search without slopes; its first and last radius, scaled."""

GENERATIONS, POPULATION = 40, 8
"""Of differential evolution: most generations, and points per unknown in each."""


class Run(NamedTuple):
    """One run of a search.

    Attributes:
        numbers: Its numbers [SI]; none of a run that failed.
        names: What the numbers are of, where this is asked.
        refusal: Why the run does not count; empty where it does.
        error: Makes the error of a run that failed.
    """

    numbers: Array
    names: Sequence[str] = ()
    refusal: str = ""
    error: Callable[[], PinarmError] | None = None

    @classmethod
    def refused(cls, refusal: str, error: Callable[[], PinarmError]) -> Run:
        return cls(np.zeros(0), (), refusal, error)


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs at points of the unknowns, shape (k,): no point is run twice, several are run at once.

    Attributes:
        solve: Runs several points.
        known: Points that have been run, by their bytes.
    """

    solve: Callable[[Sequence[Array]], Iterable[Run]]
    known: dict[bytes, tuple[Array, Run]] = field(default_factory=dict)

    def at(self, points: Iterable[Array]) -> list[Run]:
        asked = [np.array(x, dtype=float) for x in points]
        new = {x.tobytes(): x for x in asked if x.tobytes() not in self.known}
        if new:
            for (key, x), run in zip(new.items(), self.solve([*new.values()]), strict=True):
                self.known[key] = x, run
        return [self.known[x.tobytes()][1] for x in asked]

    def slopes(
        self, of: Callable[[Run], Array], x: Array, widths: Array, low: float = -np.inf, high: float = np.inf
    ) -> Array:
        """Return the slopes of numbers m of runs at a point, shape (m, k), by central differences between bounds.

        Beside a refused run the difference is that of the other side; it is 0 between two refused runs.
        """
        sides = [np.clip(x + sign * step, low, high) for step in np.diag(widths) for sign in (1.0, -1.0)]
        here, *runs = self.at([x, *sides])
        near = [(x, here) if run.refusal else (side, run) for side, run in zip(sides, runs, strict=True)]
        columns = []
        for k, ((ahead, far), (behind, back)) in enumerate(zip(near[::2], near[1::2], strict=True)):
            way, change = ahead[k] - behind[k], of(far) - of(back)
            columns.append(change / way if way else np.zeros_like(change))
        return np.ascontiguousarray(np.array(columns).T)  # SLSQP of scipy 1.17 reads others wrongly


@dataclass(frozen=True, eq=False)
class Optimum:
    """The least value of a number between bounds; at first only what is asked.

    Attributes:
        low: Lower bounds in SI, shape (k,).
        high: Upper bounds, shape (k,).
        start: The first start, in SI, shape (k,).
        runs: Runs at scaled points: the objective, which is to be least, and the margin of each condition, negative
            where it is violated, of an equation the difference.
        sizes: Sizes of the objective and of each margin, which scale them: the median of the objective at the starts;
            the bound of a condition, or where it is 0 its margin at the first start.
        ends: Scaled points to which the starts led; last that of the search from the best of them.
    """

    low: Array
    high: Array
    start: Array
    runs: Runs
    conditions: Sequence[Condition] = ()
    sizes: Sequence[float] = ()
    ends: Sequence[Array] = ()

    @property
    def objectives(self) -> list[float]:
        """Objectives of all runs that are not refused."""
        return [float(run.numbers[0]) for _, run in self.runs.known.values() if not run.refusal]

    def values(self, x: Array) -> Array:
        return np.clip(self.low + x * (self.high - self.low), self.low, self.high)

    def run(self, x: Array) -> Run:
        return self.runs.at([np.clip(x, 0.0, 1.0)])[0]

    def levels(self, run: Run) -> Array:
        """Return the objective and the margins of a run, scaled; of a refused one above all others, and -1."""
        if not run.refusal:
            return np.asarray(run.numbers / np.array(self.sizes))
        worst = REFUSED * max(map(abs, self.objectives), default=1.0) / self.sizes[0]
        return np.array([worst, *-np.ones(len(self.conditions))])

    def slopes(self, x: Array) -> Array:
        """Return the gradients of objective and margins, shape (1 + conditions, k)."""
        return self.runs.slopes(self.levels, x, np.full(len(x), DIFFERENCE), 0.0, 1.0)

    @property
    def equations(self) -> Flags:
        """For every condition, whether it is an equation."""
        return np.array([condition.relation == "=" for condition in self.conditions], dtype=bool)

    def violations(self, x: Array) -> Array:
        """Return the violations of all conditions at a point, relative to their sizes."""
        margins = self.levels(self.run(x))[1:]
        return np.where(self.equations, np.abs(margins), -margins)

    def rank(self, x: Array) -> tuple[bool, float, float]:
        """Return the sort key of a point: whether it is refused, the violation, 0 where tolerated, the objective."""
        violation = float(np.max(self.violations(x), initial=0.0))
        return bool(self.run(x).refusal), violation if violation > KEPT else 0.0, float(self.levels(self.run(x))[0])

    @property
    def best(self) -> Array:
        """The best end, scaled."""
        return min(self.ends, key=self.rank)

    @property
    def active(self) -> list[int]:
        """Numbers of the conditions that hold the best end."""
        margins = self.levels(self.run(self.best))[1:]
        return [int(k) for k in np.flatnonzero(self.equations | (margins <= ACTIVE))]

    @property
    def beside_refused(self) -> list[int]:
        """Numbers of the unknowns beside whose best values runs were refused."""
        steps = [np.abs(x - self.best) for x, run in self.runs.known.values() if run.refusal]
        return sorted({int(step.argmax()) for step in steps if step.max() <= BESIDE})

    def is_flat(self, rounding: float = 0.0) -> bool:
        """Tell whether the objective is the same in all runs but for rounding [SI]."""
        return float(np.ptp(self.objectives)) <= max(SAME * self.sizes[0], rounding)

    def solved(self, starts: int, seed: int, *, everywhere: bool = False) -> Optimum:
        """Return the optimum with the ends of its starts.

        Args:
            starts: Number of starts, which fill the bounds evenly: a Latin hypercube, always the same for a seed.
            seed: Seed of their choice.
            everywhere: Whether differential evolution takes the place of the starts.
        """
        rng = np.random.default_rng(seed)
        points = [*np.array([(rng.permutation(starts) + 0.5) / starts for _ in self.low]).T]
        points[0] = (self.start - self.low) / (self.high - self.low)
        first, *_ = self.runs.at(points)
        least = np.zeros(len(self.conditions)) if first.refusal else first.numbers[1:]
        bounds = zip(self.conditions, least.tolist(), strict=True)
        sizes = [float(np.median(np.abs(self.objectives or 0.0))), *(float(x.bound) or margin for x, margin in bounds)]
        scaled = replace(self, sizes=[abs(size) or 1.0 for size in sizes])
        if everywhere:
            points = [scaled._evolved(points[0], seed)]
        optimum = replace(scaled, ends=[scaled._end(x, "SLSQP", maxiter=50, ftol=1e-10) for x in points])
        if not optimum.run(optimum.best).refusal:
            further = optimum._end(optimum.best, "COBYQA", maxfev=POLISH_RUNS * len(self.low), **POLISH)
            optimum = replace(optimum, ends=[*optimum.ends, further])
        if optimum.rank(optimum.best)[:2] != (False, 0.0):
            raise optimum._nowhere(len(points))
        return optimum

    def _end(self, start: Array, method: str, **options: Any) -> Array:
        """Return the best point that a method comes to from a start, among all that it has run."""
        from scipy.optimize import minimize

        before = len(self.runs.known)
        if not self.run(start).refusal:
            slopes = (lambda x: self.slopes(x)[0]) if method == "SLSQP" else None
            kept, bounds = self._kept(with_slopes=method == "SLSQP"), [(0.0, 1.0)] * len(start)
            minimize(self._height, start, jac=slopes, bounds=bounds, constraints=kept, method=method, options=options)
        return min([start, *(x for x, _ in [*self.runs.known.values()][before:])], key=self.rank)

    def _evolved(self, start: Array, seed: int) -> Array:
        from scipy.optimize import differential_evolution

        settings = {"polish": False, "maxiter": GENERATIONS, "popsize": POPULATION, "tol": 1e-3}
        bounds, kept = [(0.0, 1.0)] * len(start), self._kept()
        return np.asarray(
            differential_evolution(self._height, bounds, constraints=kept, seed=seed, x0=start, **settings).x
        )

    def _height(self, x: Array) -> float:
        return float(self.levels(self.run(x))[0])

    def _kept(self, *, with_slopes: bool = False) -> list[object]:
        from scipy.optimize import NonlinearConstraint

        kept = []
        for k, upper in enumerate(np.where(self.equations, 0.0, np.inf), start=1):
            more: dict[str, Any] = {"jac": lambda x, k=k: self.slopes(x)[k]} if with_slopes else {}
            kept.append(NonlinearConstraint(lambda x, k=k: self.levels(self.run(x))[k], 0.0, upper, **more))
        return kept

    def _nowhere(self, starts: int) -> IntegrationError:
        best = self.run(self.best)
        if best.refusal:
            return IntegrationError(
                f"none of the {starts} starts can be run: {best.refusal}",
                hint="bounds between which the mechanism can be assembled and moved, or more starts",
            )
        k = int(np.argmax(self.violations(self.best)))
        condition = self.conditions[k]
        return IntegrationError(
            f"none of the {starts} starts leads to where all conditions hold: the nearest end violates "
            f"'{condition}' by {condition.measured(abs(best.numbers[1 + k]))}",
            hint="wider bounds, a weaker condition, or more starts",
        )
