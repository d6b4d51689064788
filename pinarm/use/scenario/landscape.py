"""Objective and conditions of a search over its unknowns, scaled to [0, 1] between their bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.records import replace
from pinarm.use.result.condition import Condition

DIFFERENCE = 1e-4
"""Half width of a difference, of the scaled unknowns: slopes err by its square, and by the error of runs over it."""

KEPT = 1e-6
"""Violation of a condition, relative to its size, up to which it counts as kept."""

ACTIVE = 1e-4
"""Margin of a condition, relative to its size, up to which it holds an optimum where it is."""

REFUSED = 10.0
"""Scaled objective of runs that are refused, above the worst one that is not."""


@dataclass(frozen=True)
class Trial:
    """What one run says.

    Attributes:
        objective: What is to be least.
        margins: By how much each condition is kept, negative where it is not; of equations the difference.
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

    def trial(self, x: Array) -> Trial:
        """Return what the run at a scaled point says."""
        return self.look([x])[0]

    def look(self, points: Iterable[Array]) -> list[Trial]:
        """Return what the runs at scaled points say."""
        clipped = [np.clip(np.asarray(x, dtype=float), 0.0, 1.0) for x in points]
        new = {x.tobytes(): x for x in clipped if x.tobytes() not in self.trials}
        if new:
            trials = self.run([self.values(x) for x in new.values()])
            self.trials.update(zip(new, zip(new.values(), trials, strict=True), strict=True))
        return [self.trials[x.tobytes()][1] for x in clipped]

    def scaled(self) -> Landscape:
        """Return the same, its objective relative to the median of what has been run."""
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
        """Return which condition is violated most at a point whose run is not refused, and by how much."""
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
        """Return what points are compared by: violation that counts, then the objective."""
        violation = self.violation(x)
        return (violation if violation > KEPT else 0.0, self.height(x))
