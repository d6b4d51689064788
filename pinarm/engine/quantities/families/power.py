"""Powers of the weights, of friction that sticks, and of force elements."""

from __future__ import annotations

from dataclasses import dataclass

from pinarm.engine.quantities.family import WATT, Asked, Family
from pinarm.engine.series import Series
from pinarm.mechanics.forces.force_element import power


@dataclass(frozen=True, eq=False)
class PowerQuantities(Family):
    """``power.gravity``, ``power.friction``, and ``power.F`` of force element F."""

    def names(self) -> list[str]:
        """Return the names of its quantities."""
        return ["gravity", *(["friction"] if self.run.mechanism.frictions else []), *self.run.dynamics.forces]

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        run, wanted = self.run, ".".join(asked.words)
        if wanted == "gravity":
            return Series(asked.name, WATT, self.evaluation.kinematics.gravity_power)
        if wanted == "friction" and run.mechanism.frictions:
            self.require_efforts(asked)
            return Series(asked.name, WATT, (run.friction_loads * run.v).sum(axis=1))
        if wanted not in run.dynamics.forces:
            raise asked.unknown
        values = run.gather(
            lambda dynamics, rows: power(dynamics.forces[wanted], run.grid.t[rows], run.q[rows], run.v[rows])
        )
        return Series(asked.name, WATT, values)
