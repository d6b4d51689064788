"""What force elements tell of themselves: lengths, tensions, displacements, forces."""

from __future__ import annotations

from dataclasses import dataclass

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.quantities.family import AXES, Asked, Family
from pinarm.engine.series import Series


@dataclass(frozen=True, eq=False)
class ForceQuantities(Family):
    """``force.F...``: the measures of force element F."""

    def names(self) -> list[str]:
        """Return the names of its quantities."""
        return [
            f"{name}.{part}{axis}" for name, force in self.run.dynamics.forces.items()
            for part, measure in force.measures().items()
            for axis in ([f".{axis}" for axis in AXES] if measure.vector else [""])
        ]  # fmt: skip

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        run, force = self.run, self.run.dynamics.forces.get(asked.of)
        measure = force.measures().get(asked.part) if force else None
        if measure is None or (len(asked.words) > 2) != measure.vector or "about" in asked.words[2:]:
            raise asked.unknown

        def values(dynamics: Dynamics, rows: slice) -> Array:
            here = dynamics.forces[asked.of].measures()[asked.part]
            return here.values(run.grid.t[rows], run.q[rows], run.v[rows])

        measured = run.gather(values)
        return Series(asked.name, measure.unit, self.component(asked, measured) if measure.vector else measured)
