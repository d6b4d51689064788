"""Bands of positions that friction holds, of mechanisms with one free motion.

At a position the efforts ``lower`` and ``upper`` begin to move a free joint down and up against the friction at rest;
friction holds the mechanism there without any effort where ``lower <= 0 <= upper``. From a position that it holds the
free motion is followed both ways to the first position where one of the two efforts is 0: the ends of the band.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.friction.columns import BANDS, own_effort
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.linear.equilibrium import Modes
from pinarm.engine.linear.force_balance import ForceBalance
from pinarm.engine.motion.prescribed_motion import Prescription
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.statics.actuation import along
from pinarm.errors import AssemblyError, DynamicsError
from pinarm.input.units import unit
from pinarm.records import replace

TURN, GROWTH, STEPS = 0.05, 1.25, 150
"""Largest turn of a joint in a step [rad]; growth of the steps; steps at most."""

PARTS = np.linspace(0.0, 1.0, 9)
"""Places in a step that are looked at: a catch, in which friction does not hold, is found where it is 0.4 deg wide."""

FIRST = 0.25
"""First step, relative to the end that the stiffness at the start predicts."""

FULL_TURN = "friction holds every position of a full turn"


class PositionBand(NamedTuple):
    """The positions that friction holds about a given one.

    Attributes:
        ends: Configurations where it holds no longer [rad or m], NaN where there is no end, shape (2, nq).
        reason: Why an end is missing; empty where both are known.
    """

    ends: Array
    reason: str = ""


@dataclass(frozen=True, eq=False)
class FrictionHold:
    """Where friction holds a mechanism at rest without any effort."""

    balance: ForceBalance

    def reserve(self, q: Array, joint: str) -> float:
        """Return the smaller of ``-lower`` and ``upper`` at a position [N*m or N]; at least 0 where friction holds.

        Args:
            q: Configuration, shape (nq,).
        """
        mechanism = self.balance.mechanism
        drives = along(mechanism, [*self.balance.driven.names, joint])
        row = Trajectory.schema_row(mechanism, q, ROW, unit("1"), drives.closure)
        row = replace(row, dynamics=self.balance.dynamics, separate=True)
        nothing = PrescribedCoordinates((), (), ())
        solved = Prescription(
            mechanism, DeterminedMotion(mechanism, nothing), drives, row.dynamics, ROW, row.unit
        ).solved(row, None)
        effort = own_effort(mechanism.joints, drives.coordinates(mechanism), joint)
        lower, upper = (float(solved.columns[f"{effort}.{part}"].values[0]) for part in BANDS)
        return min(-lower, upper)

    def holds(self, q: Array) -> bool:
        return self.reserve(q, self._mover(self.balance.basis(q))) >= 0.0

    def band(self, q: Array, modes: Modes) -> PositionBand:
        """Return the band about a position that friction holds, with the stiffness there."""
        try:
            basis = self.balance.basis(q)
            reserve = self.reserve(q, self._mover(basis))
            if reserve <= 0.0:
                return PositionBand(np.array([q, q]))
            stiffness = abs(float(modes.stiffnesses[0]))
            step = FIRST * reserve * np.abs(basis).max() / stiffness if stiffness > 0.0 else np.inf
            down, why = self._end(q, -basis, step)
            up, other = (down, why) if why == FULL_TURN else self._end(q, basis, step)
        except (AssemblyError, DynamicsError) as error:
            return PositionBand(np.full((2, len(q)), np.nan), error.message)
        return PositionBand(np.array([down, up]), why or other)

    def _mover(self, basis: Array) -> str:
        return list(self.balance.mechanism.joints)[int(np.abs(basis[:, 0]).argmax())]

    def _end(self, q: Array, basis: Array, step: float) -> tuple[Array, str]:
        """Return where the band ends in the direction of a free motion, or NaN and why it does not."""
        turned, turns, nowhere = 0.0, self.balance.turns, np.full(len(q), np.nan)
        step = step if np.isfinite(step) else TURN * (1.0 + float(np.abs(q).max()))
        for _ in range(STEPS):
            joint, step = self._mover(basis), min(step, TURN / max(float((turns * np.abs(basis[:, 0])).max()), 1e-300))
            for before, end in pairwise((step * PARTS).tolist()):
                after = self.balance.nearest(q + end * basis[:, 0])
                if self.reserve(after, joint) < 0.0:
                    return self._crossing(q, basis[:, 0], (before, end), joint), ""
            turned += float((turns * np.abs(after - q)).max())
            if turned >= 2.0 * np.pi:
                return nowhere, FULL_TURN
            q, basis, step = after, self.balance.basis(after, basis), GROWTH * step
        return nowhere, "friction holds every position as far as it was followed"

    def _crossing(self, q: Array, way: Array, part: tuple[float, float], joint: str) -> Array:
        """Return the position between two, on a way from a third one, at which friction ceases to hold."""
        from scipy.optimize import brentq  # few runs need it

        s = brentq(lambda s: self.reserve(self.balance.nearest(q + s * way), joint), *part, xtol=1e-15 * part[1])
        return self.balance.nearest(q + s * way)
