"""Powers of the weights, of friction that sticks, and of force elements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pinarm.engine.quantities.family import WATT, Asked, Family, Offered
from pinarm.engine.series import Series
from pinarm.mechanics.forces.force_element import power


class PowerQuantities(Family, frozen=True):
    """``power.gravity``, ``power.friction``, and ``power.F`` of force element F."""

    element: ClassVar[str] = ""
    meanings: ClassVar[Mapping[str, str]] = {
        "gravity": "power of the weights", "friction": "power of all friction that sticks",
        "": "power of the force element on the mechanism",
    }  # fmt: skip

    def entries(self) -> Iterator[Offered]:
        """Yield the powers."""
        yield Offered("", "gravity")
        if self.run.mechanism.frictions:
            yield Offered("", "friction")
        yield from (Offered(name, "") for name in self.run.dynamics.forces)

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
