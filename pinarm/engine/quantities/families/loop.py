"""Joints that close loops: their coordinates, and the wrenches they transmit."""

from __future__ import annotations

from dataclasses import dataclass

from pinarm.arrays import Array
from pinarm.engine.quantities.family import Asked
from pinarm.engine.quantities.joint_axes import ALONG_AXIS, loop_axis
from pinarm.engine.quantities.transmitted import WRENCH, WrenchFamily, components
from pinarm.engine.series import Series

COORDINATES = ("angle", "position")


@dataclass(frozen=True, eq=False)
class LoopQuantities(WrenchFamily):
    """``loop.L...``: actions of the first link on the second, at the second one's frame."""

    def names(self) -> list[str]:
        """Return the names of its quantities."""
        loops, known = self.evaluation.reactions.loops, self.run.mechanism.coordinates
        names = [f"{name}.{part}" for name in loops for part in components()]
        names += [f"{name}.{kind}.{part}" for name, loop in loops.items() if loop_axis(loop) is not None
                  for kind in WRENCH for part in ALONG_AXIS]  # fmt: skip
        return names + [f"{name}.{part}" for name in loops for part in COORDINATES if f"{name}.{part}" in known]

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        reactions = self.evaluation.reactions
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
