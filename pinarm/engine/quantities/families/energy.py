"""Energies of the mechanism, and of the bodies that single joints move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pinarm.engine.quantities.families.subtree import index_of, moved_joints
from pinarm.engine.quantities.family import JOULE, Asked, Family, Offered
from pinarm.engine.series import Series

ENERGIES = ("kinetic", "potential", "total")


class EnergyQuantities(Family, frozen=True):
    """``energy.kinetic``, of the whole mechanism; ``energy.J.kinetic``, of the bodies that joint J moves by itself."""

    element: ClassVar[str] = ""
    meanings: ClassVar[Mapping[str, str]] = {
        "kinetic": "kinetic energy, rotors included; `energy.J.kinetic` of the bodies that joint J moves by itself",
        "potential": "potential energy of weights and springs; `energy.J.potential` of the weights of the same bodies",
        "total": "kinetic and potential energy",
    }

    def entries(self) -> Iterator[Offered]:
        """Yield the energies of the mechanism, then of bodies."""
        yield from (Offered("", part) for part in ENERGIES)
        yield from (Offered(name, part) for name in moved_joints(self.run) for part in ENERGIES[:2])

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        kinematics = self.evaluation.kinematics
        if len(asked.words) == 1 and asked.of in ENERGIES:
            return Series(asked.name, JOULE, kinematics.energies[ENERGIES.index(asked.of)])
        if len(asked.words) != 2 or asked.part not in ENERGIES[:2]:
            raise asked.unknown
        bodies = kinematics.body_energies[:, index_of(asked, self.run)]
        return Series(asked.name, JOULE, bodies[:, ENERGIES.index(asked.part)])
