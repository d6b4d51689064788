"""Joints that close loops: their coordinates, and the wrenches they transmit; rods and cables: their tension."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pinarm.arrays import Array
from pinarm.engine.quantities.family import AXES, NEWTON, Asked, Offered
from pinarm.engine.quantities.joint_axes import ALONG_AXIS, loop_axis
from pinarm.engine.quantities.transmitted import WRENCH, WrenchFamily
from pinarm.engine.series import Series
from pinarm.mechanics.joints import METRE

COORDINATES = ("angle", "position")
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
        """Yield the quantities of the loop joints."""
        known = self.run.mechanism.coordinates
        for name, loop in self.evaluation.reactions.loops.items():
            along = ALONG_AXIS if loop_axis(loop) is not None else ()
            yield from (Offered(name, part, (*AXES, *along)) for part in WRENCH)
            yield from (Offered(name, part) for part in COORDINATES if f"{name}.{part}" in known)
            if loop.kind == ROD:
                yield Offered(name, "tension")
        yield from (Offered(name, part) for name in self.evaluation.reactions.cables for part in ("tension", "length"))

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        reactions = self.evaluation.reactions
        if asked.part == "tension" and self._pulls(asked.of):
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

    def _pulls(self, name: str) -> bool:
        """Return whether something is a rod or a cable."""
        reactions = self.evaluation.reactions
        return name in reactions.cables or (name in reactions.loops and reactions.loops[name].kind == ROD)

    def axes(self, asked: Asked) -> Array:
        """Return the axis of a loop joint, world axes, shape (n, 3)."""
        axes = self.evaluation.reactions.loop_axes(asked.of)
        if axes is None:
            raise asked.unknown
        return axes
