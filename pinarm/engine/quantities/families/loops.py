"""Loop joints, cables and couplings: coordinates, wrenches that they transmit, tensions and forces of contacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar

from pinarm.arrays import Array
from pinarm.engine.quantities.family import (
    ALONG_AXIS,
    AXES,
    NEWTON,
    NEWTON_METRE,
    SAY_HOW,
    WRENCH,
    Asked,
    Offered,
    WrenchFamily,
)
from pinarm.engine.quantities.reactions import loop_axis
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.couplings.transmissions import Strands
from pinarm.mechanics.joints import METRE

if TYPE_CHECKING:
    from pinarm.mechanics.friction.contact import FrictionContact

GEOMETRY = ("pressure_angle", "curvature_radius", "eccentricity")
"""Parts of couplings that do not depend on forces."""

COORDINATES = ("angle", "position")
STRANDS = ("tight", "slack")
ROD = "rod"
"""Kind of loop joint that has a tension."""


class LoopQuantities(WrenchFamily, frozen=True):
    """``loop.L...``: actions of the first link on the second, at the second one's frame."""

    element: ClassVar[str] = "L"
    of_variants: ClassVar[bool] = True
    meanings: ClassVar[Mapping[str, str]] = {
        "force": "force of the first link on the second, at the second one's frame",
        "moment": "moment of the first link on the second, about the origin of the second one's frame",
        "angle": "how far frame 2 has turned about the axis of frame 1; turns are counted in screws and planar loops, "
        "and where forces or controllers act along it, elsewhere it is from -180 to 180 degrees",
        "position": "how far frame 2 has slid along the axis of frame 1",
        "tension": "axial force of a rod, positive where it is pulled and negative where it is pressed; of a cable",
        "length": "length of the path through the links of a cable: its own while it is taut",
    }

    def entries(self) -> Iterator[Offered]:
        known = self.run.mechanism.coordinates
        for name, loop in self.evaluation.reactions.loops.items():
            along = ALONG_AXIS if loop_axis(loop) is not None else ()
            yield from (Offered(name, part, (*AXES, *along)) for part in WRENCH)
            yield from (Offered(name, part) for part in COORDINATES if f"{name}.{part}" in known)
            if loop.kind == ROD:
                yield Offered(name, "tension")
        yield from (Offered(name, part) for name in self.evaluation.reactions.cables for part in ("tension", "length"))

    def series(self, asked: Asked) -> Series:
        reactions = self.evaluation.reactions
        loop = reactions.loops.get(asked.of)
        if asked.part == "tension" and (asked.of in reactions.cables or (loop is not None and loop.kind == ROD)):
            self.require_efforts(asked)
            lam, stresses = reactions.multiplier(asked.of)
            return Series(asked.name, NEWTON, -lam, self.doubt(asked, stresses))
        if asked.part == "length" and asked.of in reactions.cables:
            return Series(asked.name, METRE, reactions.cable_lengths(asked.of))
        if asked.of not in reactions.loops:
            raise asked.unknown
        if len(asked.words) == 2 and asked.part in COORDINATES:
            return self.rate(asked, ".".join(asked.words), "position")
        if len(asked.words) < 3 or asked.part not in WRENCH:
            raise asked.unknown
        self.require_efforts(asked)
        origins, wrench = reactions.loop_origins(asked.of), reactions.loop(asked.of)
        return self.wrench(asked, origins, wrench, reactions.stressed_loop(asked.of), origins)

    def axes(self, asked: Asked) -> Array:
        """Return the axis of a loop joint, world axes, shape (n, 3)."""
        axes = self.evaluation.reactions.loop_axes(asked.of)
        if axes is None:
            raise asked.unknown
        return axes


class CouplingQuantities(WrenchFamily, frozen=True):
    """``coupling.C...``: the multiplier, and actions of the first member on the second."""

    element: ClassVar[str] = "C"
    meanings: ClassVar[Mapping[str, str]] = {
        "effort": "multiplier: effort at its second joint, without friction",
        "force": "force of the first member on the second, where they touch, friction included",
        "moment": "moment of the first member on the second, about the point where they touch, friction included",
        "tangential": "force of the teeth along the pitch circle",
        "radial": "force of the teeth towards the axis",
        "axial": "force of the teeth, or of a thread with its friction, along the axis",
        "separating": "force of bevel teeth along the normal of the pitch cone",
        "torque": "moment of the thread about its axis, friction included",
        "tight": "tension of the strand that pulls",
        "slack": "tension of the other strand",
        "normal": "contact force of a cam on its follower, along the normal; negative where it would have to pull",
        "pressure_angle": "angle from the direction in which a cam's follower moves to the normal of the contact",
        "curvature_radius": "radius of curvature of a cam where the follower touches it, negative where it is hollow",
        "eccentricity": "distance of the contact on a cam's flat-faced follower from the face's point",
    }

    def entries(self) -> Iterator[Offered]:
        for name, coupling in self.evaluation.reactions.couplings.items():
            yield Offered(name, "effort")
            if coupling.transmission:
                yield from (Offered(name, part) for part in coupling.known.parts())
                yield from (Offered(name, part, AXES) for part in WRENCH)
        for contact, _ in self._slipping_belts():
            yield from (Offered(contact.name.partition(".")[2], part) for part in STRANDS)

    def _slipping_belts(self) -> list[tuple[FrictionContact, Array]]:
        """Return the belts that friction alone holds on their wheels, with the differences of their tensions [N]."""
        frictions = self.run.mechanism.frictions
        pairs = zip(frictions, self.run.friction.T, strict=True) if frictions else ()
        return [(contact, apart) for contact, apart in pairs if contact.replaces]

    def _tension(self, asked: Asked) -> Series | None:
        """Return the tension of a strand of a belt that may slip; ``None`` where no such is asked for."""
        for contact, apart in self._slipping_belts():
            belt = contact.coupling.transmission if isinstance(contact.coupling, Coupling) else None
            if contact.name == f"coupling.{asked.of}" and asked.part in STRANDS and isinstance(belt, Strands):
                self.require_efforts(asked)
                return Series(asked.name, NEWTON, belt.part(asked.part, self.run.q, apart / belt.difference))
        return None

    def series(self, asked: Asked) -> Series:
        if (tension := self._tension(asked)) is not None:
            return tension
        reactions, part = self.evaluation.reactions, asked.part
        coupling = reactions.couplings.get(asked.of)
        if coupling is None or (len(asked.words) > 2) != (part in WRENCH):
            raise asked.unknown
        self.require_efforts(asked)
        lam, added = reactions.multiplier(asked.of)
        if part == "effort":
            unit = NEWTON if coupling.unit(0) == METRE else NEWTON_METRE
            return Series(asked.name, unit, lam, self.doubt(asked, added))
        if not coupling.transmission:
            raise InputError(
                f"'{asked.name}' is not known: {coupling.missing}", expected=f"coupling.{asked.of}.effort", hint=SAY_HOW
            )
        if part in WRENCH:
            points, wrench, stresses = reactions.transmitted(asked.of)
            return self.wrench(asked, points, wrench, stresses, points)
        if part not in coupling.known.parts():
            raise asked.unknown
        doubt = self.doubt(asked, [] if part in GEOMETRY else added)
        values = coupling.known.part(part, self.run.q, lam)
        for contact, friction in reactions.friction_of(asked.of):
            values = values + contact.added(part, friction)
        return Series(asked.name, coupling.known.parts()[part], values, doubt)
