"""Momenta of bodies, and their rates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from pinarm.engine.quantities.families.subtree import ALL, beyond, moved_joints
from pinarm.engine.quantities.family import AXES, SECOND, Asked, Family, Offered
from pinarm.engine.series import Series
from pinarm.input.units import Unit, unit
from pinarm.mechanics.joints import METRE


class MomentumQuantities(Family, frozen=True):
    """``momentum.S...``: of a joint S and everything beyond it, or of ``all``."""

    element: ClassVar[str] = "S"
    meanings: ClassVar[Mapping[str, str]] = {
        "linear": "momentum of a joint's body and of all beyond it",
        "angular": "angular momentum of the same, about the world's origin; rotors have no part in it",
    }

    parts: ClassVar[tuple[str, str]] = ("linear", "angular")
    order: ClassVar[int] = 0

    def entries(self) -> Iterator[Offered]:
        """Yield the quantities of the mechanism, then of subtrees."""
        return (Offered(name, part, AXES) for name in (ALL, *moved_joints(self.run)) for part in self.parts)

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        if len(asked.words) < 3 or asked.part not in self.parts:
            raise asked.unknown
        total = self.evaluation.kinematics.momenta[:, beyond(asked, self.run), self.order].sum(axis=1)
        vectors, measured = total[:, :3], unit("kg*m/s") / SECOND if self.order else unit("kg*m/s")
        if asked.part == self.parts[1]:
            about = self.about(asked, np.zeros((len(total), 3)))
            vectors, measured = total[:, 3:] - np.cross(about, total[:, :3]), METRE * measured
        return Series(asked.name, Unit(1.0, measured.dimension), self.component(asked, vectors))


class DynamicQuantities(MomentumQuantities, frozen=True):
    """``dynamic.S...``: rates of the momenta of the same bodies, as a force and a moment."""

    meanings: ClassVar[Mapping[str, str]] = {
        "force": "rate of the momentum of a joint's body and of all beyond it",
        "moment": "rate of the angular momentum of the same, about the world's origin; rotors have no part in it",
    }
    parts: ClassVar[tuple[str, str]] = ("force", "moment")
    order: ClassVar[int] = 1
