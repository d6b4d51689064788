"""Threads: screws that close loops, and screws and worms between joints.

On the mean radius r a thread rises with the lead angle ``tan L = h / r``, h being the way per angle. The parts slip
along the thread, with ``u = r cos L omega + sin L z'``. The axial force Q that holds way and angle together is that of
the normal force of the flanks, ``N = Q / (cos L cos A)``; the angle A of the flank in the section normal to the thread
follows from that in the axial section, ``tan A = tan flank cos L``. With friction ``mu N`` along the thread the torque
that raises a load W is ``W r tan(L + atan(mu / cos A))``. A worm is such a screw, its wheel, of radius R, the nut, with
``h = R q2 / q1``.
Source: Shigley, Mechanical Engineering Design, sections 8-2 (power screws) and 13-17 (worm gears).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, cos, sin, tan
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.couplings.coupling import outwards
from pinarm.mechanics.couplings.transmissions import ThreadContact
from pinarm.mechanics.friction.coupling_contact import ConstantSlip
from pinarm.mechanics.geometry.link_placements import LinkPlacements

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class ThreadGeometry:
    """The mean helix of a thread.

    Attributes:
        radius: r [m].
        pitch: h, way per angle [m/rad], negative of a left-handed thread.
        flank: Angle of the flank in the axial section [rad]: 0 of a square thread, 30 deg of a metric one.
    """

    radius: float
    pitch: float
    flank: float

    @property
    def lead_angle(self) -> float:
        """L [rad], of the sign of the pitch."""
        return atan(self.pitch / self.radius)

    @property
    def along(self) -> tuple[float, float]:
        return self.radius * cos(self.lead_angle), sin(self.lead_angle)

    @property
    def lever(self) -> float:
        """Normal force of the flanks per axial force, ``1 / (cos L cos A)``."""
        normal = atan(tan(self.flank) * cos(self.lead_angle))
        return 1.0 / (cos(self.lead_angle) * cos(normal))


@dataclass(frozen=True, eq=False, kw_only=True)
class ThreadFriction(ConstantSlip):
    """The slip along the thread of a screw, or of a worm and its wheel, that couple two joints.

    Attributes:
        along: Slip along the thread per angle of the first joint [m/rad], and per way of the second.
    """

    along: tuple[float, float]

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        """Return the force along the axis and the moment about it on the nut, and what reacts on the screw.

        Nothing where the coupling says nothing of its bodies: it then acts as efforts at the coupled joints.
        """
        known, (turning, sliding) = self.coupling.transmission, self.along
        if not isinstance(known, ThreadContact):
            return {}
        force, moment = sliding * known.along, -turning / known.pitch * known.about
        wrench = np.concatenate([force, moment + np.cross(known.point, force)])
        second = outwards(links, known.carrier, np.multiply.outer(f, wrench))
        return {known.second: second, known.first: -second}

    def part(self, name: str, f: Array) -> Array:
        """Return what friction adds to the force on the nut along its joint, or to the moment about the screw, (n,)."""
        turning, sliding = self.along
        return np.asarray((sliding if name == "axial" else -turning) * f)
