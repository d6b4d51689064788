"""Links, single or with all beyond a joint: motion of their origins, rotation, momenta and energies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.family import AXES, JOULE, SECOND, Asked, Family, Offered
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import Unit, unit
from pinarm.mechanics.joints import METRE, links_of

ENERGIES = ("kinetic", "potential", "total")

ALL = "all"
"""The whole mechanism, in place of a joint."""


class PointQuantities(Family, frozen=True):
    """``point.P...``: of the origin of link P."""

    element: ClassVar[str] = "P"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "position": "position of the link's origin",
        "velocity": "its velocity",
        "acceleration": "its acceleration",
    }
    first: ClassVar[int] = 0
    units: ClassVar[tuple[Unit, ...]] = (METRE, METRE / SECOND, METRE / SECOND**2)

    def entries(self) -> Iterator[Offered]:
        return (Offered(name, part, AXES) for name in links_of(self.run.mechanism.model) for part in self.meanings)

    def series(self, asked: Asked) -> Series:
        if len(asked.words) < 3 or asked.part not in self.meanings:
            raise asked.unknown
        order = [*self.meanings].index(asked.part)
        vectors = self.evaluation.frame(asked.of)[..., self.first + order, :]
        return Series(asked.name, self.units[order], self.component(asked, vectors))


class BodyQuantities(PointQuantities, frozen=True):
    """``body.B...``: of the rotation of link B."""

    element: ClassVar[str] = "B"
    meanings: ClassVar[Mapping[str, str]] = {
        "angular_velocity": "angular velocity of the link",
        "angular_acceleration": "its angular acceleration",
    }
    first: ClassVar[int] = 3
    units: ClassVar[tuple[Unit, ...]] = (unit("rad/s"), unit("rad/s^2"))


class MomentumQuantities(Family, frozen=True):
    """``momentum.S...``: of a joint S and everything beyond it, or of ``all``."""

    element: ClassVar[str] = "S"
    meanings: ClassVar[Mapping[str, str]] = {
        "linear": "momentum of a joint's body and of all beyond it",
        "angular": "angular momentum of the same, about the world's origin; rotors have no part in it",
    }

    order: ClassVar[int] = 0

    def entries(self) -> Iterator[Offered]:
        return (Offered(name, part, AXES) for name in (ALL, *_moved_joints(self.run)) for part in self.meanings)

    def series(self, asked: Asked) -> Series:
        if len(asked.words) < 3 or asked.part not in self.meanings:
            raise asked.unknown
        total = self.evaluation.momenta[self.order][:, _beyond(asked, self.run)].sum(axis=1)
        vectors, measured = total[:, :3], unit("kg*m/s") / SECOND if self.order else unit("kg*m/s")
        if asked.part == [*self.meanings][1]:
            about = self.about(asked, np.zeros((len(total), 3)))
            vectors, measured = total[:, 3:] - np.cross(about, total[:, :3]), METRE * measured
        return Series(asked.name, Unit(1.0, measured.dimension), self.component(asked, vectors))


class DynamicQuantities(MomentumQuantities, frozen=True):
    """``dynamic.S...``: rates of the momenta of the same bodies, as a force and a moment."""

    meanings: ClassVar[Mapping[str, str]] = {
        "force": "rate of the momentum of a joint's body and of all beyond it",
        "moment": "rate of the angular momentum of the same, about the world's origin; rotors have no part in it",
    }
    order: ClassVar[int] = 1


class EnergyQuantities(Family, frozen=True):
    """``energy.kinetic``, of the whole mechanism; ``energy.J.kinetic``, of the bodies that joint J moves by itself."""

    element: ClassVar[str] = ""
    meanings: ClassVar[Mapping[str, str]] = {
        "kinetic": "kinetic energy, rotors included; `energy.J.kinetic` of the bodies that joint J moves by itself",
        "potential": "potential energy of weights and springs; `energy.J.potential` of the weights of the same bodies",
        "total": "kinetic and potential energy",
    }

    def entries(self) -> Iterator[Offered]:
        yield from (Offered("", part) for part in ENERGIES)
        yield from (Offered(name, part) for name in _moved_joints(self.run) for part in ENERGIES[:2])

    def series(self, asked: Asked) -> Series:
        if len(asked.words) == 1 and asked.of in ENERGIES:
            return Series(asked.name, JOULE, self.evaluation.energies[ENERGIES.index(asked.of)])
        if len(asked.words) != 2 or asked.part not in ENERGIES[:2]:
            raise asked.unknown
        energies = self.evaluation.body_energies[ENERGIES.index(asked.part)]
        return Series(asked.name, JOULE, energies[:, _index_of(asked, self.run)])


def _moved_joints(run: Trajectory) -> list[str]:
    return [*run.mechanism.joints, *run.mechanism.balls]


def _index_of(asked: Asked, run: Trajectory) -> int:
    joint = run.mechanism.joints.get(asked.of) or run.mechanism.balls.get(asked.of)
    if joint is None:
        raise asked.unknown
    return joint.index


def _beyond(asked: Asked, run: Trajectory) -> list[int]:
    if asked.of != ALL:
        return [int(joint) for joint in run.mechanism.model.subtrees[_index_of(asked, run)]]
    if ALL in _moved_joints(run):
        raise InputError(
            f"'{asked.name}': '{ALL}' is a joint, and the whole mechanism",
            expected="one meaning",
            hint="another name of the joint",
        )
    return list(range(1, run.mechanism.model.njoints))
