"""Coordinates with their derivatives, and the efforts of drives along them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from pinarm.engine.quantities.families.joint import JointQuantities
from pinarm.engine.quantities.family import NEWTON, NEWTON_METRE, RATES, Asked, Offered
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.mechanics.joints import METRE


class CoordinateQuantities(JointQuantities, frozen=True):
    """``coordinate.C...``: of coordinates of joints, and of those defined beside them."""

    element: ClassVar[str] = "C"
    meanings: ClassVar[Mapping[str, str]] = {
        "position": "coordinate", "velocity": "its rate", "acceleration": "its second derivative",
        "effort": "effort of the drive along it",
    }  # fmt: skip

    def entries(self) -> Iterator[Offered]:
        """Yield all coordinates, and the efforts of drives along those that are no joint's."""
        run = self.run
        guided = run.closure.slices.keys() - run.mechanism.closure.slices.keys()
        for name in run.mechanism.coordinates:
            yield from (Offered(name, rate) for rate in RATES)
            if name in guided or run.effort_along(name) is not None:
                yield Offered(name, "effort")

    def series(self, asked: Asked) -> Series:
        """Return a quantity; see ``Family.series``."""
        along = ".".join(asked.words[:-1])
        if asked.words[-1] == "effort" and along in self.run.mechanism.coordinates:
            return self._effort(asked, along)
        return self.rate(asked, along, asked.words[-1])

    def _effort(self, asked: Asked, along: str) -> Series:
        """Return the effort of a drive along a coordinate: of joints, or one that has a multiplier of its own."""
        run = self.run
        self.require_efforts(asked)
        unit = NEWTON if run.mechanism.coordinates[along].unit == METRE else NEWTON_METRE
        if (effort := run.effort_along(along)) is not None:
            return Series(asked.name, unit, effort)
        if along in run.mechanism.joints:
            return super().series(Asked(asked.name, (along, "effort")))
        rows = run.closure.slices.get(along)
        if rows is None or along in run.mechanism.closure.slices:
            raise InputError(f"no drive acts along '{along}'", expected="a coordinate named in drives:")
        return Series(asked.name, unit, run.lam.along[:, rows.start - run.mechanism.closure.size])
