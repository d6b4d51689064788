"""Links: the motion of their origins, and their rotation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pinarm.engine.quantities.family import AXES, RATES, SECOND, Asked, Family, Offered
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.mechanics.joints import METRE, links_of

TURNS = ("angular_velocity", "angular_acceleration")


class PointQuantities(Family, frozen=True):
    """``point.P...``: of the origin of link P."""

    element: ClassVar[str] = "P"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "position": "position of the link's origin", "velocity": "its velocity", "acceleration": "its acceleration",
    }  # fmt: skip

    def entries(self) -> Iterator[Offered]:
        """Yield position, velocity and acceleration of every link's origin."""
        return (Offered(name, rate, AXES) for name in links_of(self.run.mechanism.model) for rate in RATES)

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        if len(asked.words) < 3 or asked.part not in RATES:
            raise asked.unknown
        order = RATES.index(asked.part)
        vectors = self.evaluation.kinematics.frame(asked.of)[..., order, :]
        return Series(asked.name, METRE / SECOND**order if order else METRE, self.component(asked, vectors))


class BodyQuantities(Family, frozen=True):
    """``body.B...``: of the rotation of link B."""

    element: ClassVar[str] = "B"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "angular_velocity": "angular velocity of the link", "angular_acceleration": "its angular acceleration",
    }  # fmt: skip

    def entries(self) -> Iterator[Offered]:
        """Yield angular velocity and acceleration of every link."""
        return (Offered(name, rate, AXES) for name in links_of(self.run.mechanism.model) for rate in TURNS)

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        if len(asked.words) < 3 or asked.part not in TURNS:
            raise asked.unknown
        order = TURNS.index(asked.part)
        vectors = self.evaluation.kinematics.frame(asked.of)[..., 3 + order, :]
        return Series(asked.name, unit("rad/s^2" if order else "rad/s"), self.component(asked, vectors))
