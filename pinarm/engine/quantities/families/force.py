"""What force elements tell of themselves: lengths, tensions, displacements, forces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.quantities.family import AXES, Asked, Family, Offered
from pinarm.engine.series import Series


@dataclass(frozen=True, eq=False)
class ForceQuantities(Family):
    """``force.F...``: the measures of force element F."""

    element: ClassVar[str] = "F"
    meanings: ClassVar[Mapping[str, str]] = {
        "length": "distance of the ends of a point spring", "tension": "pull of a point spring on its ends",
        "effort": "effort along the coordinate that the element acts along",
        "displacement": "of a bushing: of its second frame from the first",
        "rotation": "of a bushing: rotation vector of its second frame from the first",
        "force": "of a bushing: force of the first link on the second, at the second one's frame",
        "moment": "of a bushing: moment of the first link on the second, about the second one's frame",
    }  # fmt: skip

    def entries(self) -> Iterator[Offered]:
        """Yield the measures of the force elements."""
        for name, force in self.run.dynamics.forces.items():
            for part, measure in force.measures().items():
                yield Offered(name, part, AXES if measure.vector else ())

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
