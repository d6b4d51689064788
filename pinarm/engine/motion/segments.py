"""A motion from end to end: legs of smooth motion, with an impact or a change of contact where one meets the next."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import Account, energy_balance
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.equation import Dynamics
from pinarm.engine.integration.integrator import Solution
from pinarm.engine.motion.systems import Motion, System
from pinarm.engine.motion.trajectory import Happening
from pinarm.mechanics.laws.motion_law import Grid


@dataclass(frozen=True, eq=False)
class Leg:
    """A part of a motion during which the same constraints hold.

    Attributes:
        system: What was integrated.
        solution: The integrated states.
    """

    system: System
    solution: Solution


@dataclass(frozen=True, eq=False)
class Course:
    """Legs, end to end.

    Attributes:
        dynamics: The equation of motion.
        legs: In order of time.
        happenings: In order of time.
    """

    dynamics: Dynamics
    legs: list[Leg] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)

    @property
    def end(self) -> float:
        """Return the last instant reached [s]."""
        return self.legs[-1].solution.end

    @property
    def seams(self) -> list[float]:
        """Return the instants at which one leg meets the next [s]."""
        return [leg.solution.end for leg in self.legs[:-1]]

    def complete(self, grid: Grid) -> Motion:
        """Return the motion at the rows of a grid whose intervals do not reach over seams."""
        bounds = np.array(self.seams)
        middles = 0.5 * (np.array(grid.cuts[1:]) + np.array(grid.cuts[:-1]))
        owners = np.searchsorted(bounds, middles)
        motions = []
        for number in sorted(set(owners.tolist())):
            leg, local = self.legs[number], grid.part(*np.flatnonzero(owners == number)[[0, -1]])
            motions.append(leg.system.complete(self.dynamics, local, *leg.solution.states(local.t)))
        q, v, a, tau = map(np.concatenate, zip(*((one.q, one.v, one.a, one.tau) for one in motions), strict=True))
        return Motion(q, v, a, tau, Multipliers.joined([one.lam for one in motions]))

    def positions(self, t: Array) -> Array:
        """Return the configurations at instants, shape (n,), as they have been integrated, shape (n, nq)."""
        owners = np.searchsorted(np.array(self.seams), t)
        found = np.empty((len(t), self.dynamics.model.nq))
        for number in sorted(set(owners.tolist())):
            leg, here = self.legs[number], owners == number
            found[here] = leg.system.whole(t[here], *leg.solution.states(t[here]))[0]
        return found

    def cost(self) -> dict[str, float]:
        """Return the work done, by name."""
        counts = [leg.solution.count for leg in self.legs]
        cost = {
            "steps": float(sum(len(leg.solution.steps) for leg in self.legs)),
            "evaluations": float(sum(count.evaluations for count in counts)),
            "rejected steps": float(sum(count.rejected for count in counts)),
        }
        floored = sum(count.floored for count in counts)
        return {**cost, "steps at the noise floor": float(floored)} if floored else cost

    def energy(self) -> dict[str, float]:
        """Return the largest change of energy within legs that nothing accounts for."""
        return energy_balance(*(self._account(leg) for leg in self.legs))

    def _account(self, leg: Leg) -> Account:
        local = [self.dynamics.on(interval.start, interval.end) for interval in leg.solution.intervals]
        return Account(leg.solution, local, leg.system.whole)

    def diagnose(self) -> list[str]:
        """Return what says that the integrator was a poor choice."""
        return list(dict.fromkeys(doubt for leg in self.legs for doubt in leg.solution.method.diagnose(leg.solution)))
