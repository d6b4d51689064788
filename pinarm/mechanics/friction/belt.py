"""Belts that slip on their wheels.

On the wheel with the smaller angle of wrap theta the tensions of the strands differ at most by the factor
``exp(mu theta)`` (Euler, Eytelwein). With ``T1 + T2 = 2 F0``, F0 being the pretension, the pull on the wheels' rims is
at most ``T1 - T2 = 2 F0 tanh(mu theta / 2)``, whatever else acts: a dry friction with this constant, against the slip
``r2 q2' - r1 q1'`` of the belt. Up to it the belt sticks and ties the wheels; beyond, each is free. The belt has no
mass, so that no speed loosens it; creep of elastic belts is left out.
Source: Shigley's Mechanical Engineering Design, section 17-2 (flat- and round-belt drives).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.couplings.coupling import Coupling, Kink, outwards
from pinarm.mechanics.couplings.transmissions import Strands
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.coupling_contact import ConstantSlip
from pinarm.mechanics.friction.law import FrictionLaw
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.records import replace


@dataclass(frozen=True, eq=False, kw_only=True)
class BeltFriction(ConstantSlip):
    """The slip of a belt; it takes the place of the coupling, which ties the wheels no more.

    Attributes:
        radius: r2, of the second wheel [m].
    """

    radius: float

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        known = self.coupling.transmission
        assert isinstance(known, Strands)
        lam = self.radius * f
        return {body: outwards(links, known.carrier, wrench) for body, wrench in known.wrenches(lam).items()}

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        return [Kink(kink.at / self.radius, {joint: self.radius * wrench for joint, wrench in kink.wrenches.items()})
                for kink in self.coupling.kinks(links)]  # fmt: skip

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        """Return nothing: the friction depends on the pretension only."""
        return np.zeros((len(joints), 6))


def belt_friction(coupling: Coupling, law: FrictionLaw) -> BeltFriction:
    """Return the friction of a belt.

    Args:
        coupling: The belt.
        law: Of friction on the wheels.

    Raises:
        InputError: The belt has no pretension.
    """
    known = coupling.transmission
    if not isinstance(known, Strands) or not known.pretension:
        raise InputError(f"without a pretension the belt '{coupling.name}' has no grip", expected="its pretension")

    def grip(mu: float) -> float:
        return 2.0 * known.pretension * float(np.tanh(0.5 * mu * known.wrap))

    pull = replace(
        law, mu=0.0, static_mu=0.0, constant=law.constant + grip(law.mu),
        static_constant=law.static_constant + grip(law.static_mu),
    )  # fmt: skip
    radius = 1.0 / abs(known.difference)
    slip = radius * coupling.coordinate.weights
    return BeltFriction(
        f"coupling.{coupling.name}", unit("N"), coupling, pull, Bearing.none(), slip=slip, radius=radius
    )
