"""Links: the motion of their origins, and their rotation."""

from __future__ import annotations

from dataclasses import dataclass

from pinarm.engine.quantities.family import AXES, RATES, SECOND, Asked, Family, links
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.mechanics.joints import METRE

TURNS = ("angular_velocity", "angular_acceleration")


@dataclass(frozen=True, eq=False)
class PointQuantities(Family):
    """``point.P...``: of the origin of link P."""

    def names(self) -> list[str]:
        """Return the names of its quantities."""
        return [f"{name}.{rate}.{axis}" for name in links(self.run) for rate in RATES for axis in AXES]

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        if len(asked.words) < 3 or asked.part not in RATES:
            raise asked.unknown
        order = RATES.index(asked.part)
        vectors = self.evaluation.kinematics.frame(asked.of)[:, order]
        return Series(asked.name, METRE / SECOND**order if order else METRE, self.component(asked, vectors))


@dataclass(frozen=True, eq=False)
class BodyQuantities(Family):
    """``body.B...``: of the rotation of link B."""

    def names(self) -> list[str]:
        """Return the names of its quantities."""
        return [f"{name}.{rate}.{axis}" for name in links(self.run) for rate in TURNS for axis in AXES]

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        if len(asked.words) < 3 or asked.part not in TURNS:
            raise asked.unknown
        order = TURNS.index(asked.part)
        vectors = self.evaluation.kinematics.frame(asked.of)[:, 3 + order]
        return Series(asked.name, unit("rad/s^2" if order else "rad/s"), self.component(asked, vectors))
