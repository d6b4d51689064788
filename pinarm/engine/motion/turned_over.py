"""What is to be said where springs, drives or controllers act along an angle that is told up to half a turn.

Joints of the tree count their turns. An angle of a ball joint, or of a loop in space, jumps from 180 to -180 deg, and
what acts along it with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import RADIAN

if TYPE_CHECKING:
    from pinarm.engine.motion.integrated_motion import IntegratedMotion


def turned_over_remarks(motion: IntegratedMotion) -> list[str]:
    """Return a remark on each element and controller whose angle jumps by a turn between two steps of a motion."""
    users = list(_angles(motion))
    if not users:
        return []
    t, model = motion.steps(), motion.mechanism.model
    states, found = [Kinematics.at(model, q) for q in motion.positions(t)], list[str]()
    for user, angle in users:
        jumps = np.flatnonzero(np.abs(np.diff([angle.value(state) for state in states])) > np.pi)
        if len(jumps):
            found.append(
                f"{user} acts along an angle that is told from -180 to 180 deg, and jumps by a turn where it passes "
                f"180 deg, first at t = {t[jumps[0] + 1]:.6g} s: as a joint of the tree it would count its turns"
            )
    return found


def _angles(motion: IntegratedMotion) -> Iterator[tuple[str, Coordinate]]:
    """Yield what acts along coordinates that may go round, and these."""
    mechanism, hybrid = motion.mechanism, motion.hybrid
    acting = [(f"'{name}'", getattr(force, "coordinate", None)) for name, force in hybrid.dynamics.forces.items()]
    acting += [
        (f"drive '{name}'", mechanism.coordinate(drive.along))
        for name, drive in mechanism.drives.items()
        if drive.along
    ]
    if hybrid.controls:
        from pinarm.mechanics.control.signals import CoordinateSignal

        acting += [
            (f"the controller of {', '.join(one.drives)}", signal.coordinate)
            for one in hybrid.controls.controllers for signal in one.signals if isinstance(signal, CoordinateSignal)
        ]  # fmt: skip
    for user, coordinate in acting:
        if coordinate is not None and not isinstance(coordinate, LinearCoordinate) and coordinate.unit == RADIAN:
            yield user, coordinate
