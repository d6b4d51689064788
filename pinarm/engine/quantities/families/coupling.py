"""Gears, racks, screws, belts, cams: the effort that they transmit, and the forces where their members touch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pinarm.engine.quantities.family import AXES, NEWTON, NEWTON_METRE, Asked, Offered
from pinarm.engine.quantities.transmitted import SAY_HOW, WRENCH, WrenchFamily, components
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.joints import METRE

GEOMETRY = ("pressure_angle", "curvature_radius", "eccentricity")
"""Parts that no force plays a part in."""


class CouplingQuantities(WrenchFamily, frozen=True):
    """``coupling.C...``: the multiplier, and actions of the first member on the second."""

    element: ClassVar[str] = "C"
    meanings: ClassVar[Mapping[str, str]] = {
        "effort": "multiplier: effort at its second joint, without friction",
        "force": "force of the first member on the second, where they touch, friction included",
        "moment": "moment of the first member on the second, about the point where they touch, friction included",
        "tangential": "force of the teeth along the pitch circle", "radial": "force of the teeth towards the axis",
        "axial": "force of the teeth, or of a thread with its friction, along the axis",
        "separating": "force of bevel teeth along the normal of the pitch cone",
        "torque": "moment of the thread about its axis, friction included",
        "tight": "tension of the strand that pulls", "slack": "tension of the other strand",
        "normal": "contact force of a cam on its follower, along the normal; negative where it would have to pull",
        "pressure_angle": "angle from the direction in which a cam's follower moves to the normal of the contact",
        "curvature_radius": "radius of curvature of a cam where the follower touches it, negative where it is hollow",
        "eccentricity": "distance of the contact on a cam's flat-faced follower from the face's point",
    }  # fmt: skip

    def entries(self) -> Iterator[Offered]:
        """Yield the quantities of couplings; their forces where these are known."""
        for name, coupling in self.evaluation.reactions.couplings.items():
            yield Offered(name, "effort")
            if coupling.known:
                yield from (Offered(name, part) for part in coupling.parts())
                yield from (Offered(name, part, AXES) for part in WRENCH)

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        reactions, part = self.evaluation.reactions, asked.part
        coupling = reactions.couplings.get(asked.of)
        if coupling is None or (len(asked.words) > 2) != (part in WRENCH):
            raise asked.unknown
        self.require_efforts(asked)
        lam, added = reactions.multiplier(asked.of)
        if part == "effort":
            unit = NEWTON if coupling.unit(0) == METRE else NEWTON_METRE
            return Series(asked.name, unit, lam, self.doubt(asked, added))
        if not coupling.known:
            raise InputError(f"'{asked.name}' is not known: {coupling.missing}",
                             expected=f"coupling.{asked.of}.effort", hint=SAY_HOW)  # fmt: skip
        if part in WRENCH:
            points, wrench, stresses = reactions.transmitted(asked.of)
            return self.wrench(asked, points, wrench, stresses, points)
        if part not in coupling.parts():
            raise asked.unknown
        doubt = self.doubt(asked, [] if part in GEOMETRY else added)
        values = coupling.part(part, self.run.q, lam)
        for contact, friction in reactions.friction_of(asked.of):
            values = values + contact.part(part, friction)
        return Series(asked.name, coupling.parts()[part], values, doubt)


def coupling_parts(coupling: JointRelation) -> list[str]:
    """Return what is known of a coupling, such as ``effort``, ``force.x``, ``tangential``."""
    if not coupling.known:
        return ["effort"]
    return ["effort", *coupling.parts(), *components()]
