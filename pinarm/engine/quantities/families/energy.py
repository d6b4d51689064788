"""Energies of the mechanism, and of the bodies that single joints move."""

from __future__ import annotations

from dataclasses import dataclass

from pinarm.engine.quantities.families.subtree import index_of, moved_joints
from pinarm.engine.quantities.family import JOULE, Asked, Family
from pinarm.engine.series import Series

ENERGIES = ("kinetic", "potential", "total")


@dataclass(frozen=True, eq=False)
class EnergyQuantities(Family):
    """``energy.kinetic``, of the whole mechanism; ``energy.J.kinetic``, of the bodies that joint J moves by itself."""

    def names(self) -> list[str]:
        """Return the names of its quantities."""
        return [*ENERGIES, *(f"{name}.{part}" for name in moved_joints(self.run) for part in ENERGIES[:2])]

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        kinematics = self.evaluation.kinematics
        if len(asked.words) == 1 and asked.of in ENERGIES:
            return Series(asked.name, JOULE, kinematics.energies[ENERGIES.index(asked.of)])
        if len(asked.words) != 2 or asked.part not in ENERGIES[:2]:
            raise asked.unknown
        bodies = kinematics.body_energies[:, index_of(asked, self.run)]
        return Series(asked.name, JOULE, bodies[:, ENERGIES.index(asked.part)])
