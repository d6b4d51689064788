"""Limits of joints: a run is not held to them, but what goes beyond them is told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.input.units import Unit, unit
from pinarm.mechanics.forces.joint_definitions import effort_unit
from pinarm.mechanics.joints import RADIAN, Joint

ROUNDING = 1e-9
"""Part of a limit by which it may be passed: a motion that ends at a limit ends there to rounding."""


@dataclass(frozen=True)
class Excess:
    """A limit of a joint that a run goes beyond.

    Attributes:
        joint: Name of the joint.
        of: ``position``, ``velocity`` or ``effort``.
        unit: Unit of the limit.
        limit: The limit; that of velocities and efforts holds both ways.
        value: What is farthest beyond it, with its sign.
        at: Parameter of the first row beyond it.
        rows: Number of rows beyond it.
    """

    joint: str
    of: str
    unit: Unit
    limit: float
    value: float
    at: float
    rows: int

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        passes = "is below" if self.of == "position" and self.value < self.limit else "exceeds"
        where = f"{run.parameter} = {self.at:.6g} {'' if str(run.unit) == '1' else run.unit}".rstrip()
        return (f"joint {self.joint}: {self.of} {self.value:.6g} {self.unit} {passes} its limit {self.limit:.6g} "
                f"{self.unit}, first at {where} ({self.rows} of {len(run)} rows)")  # fmt: skip


def excesses(run: Trajectory) -> list[Excess]:
    """Return the limits that a run goes beyond, joint by joint; efforts are those of drives, or of couplings."""
    return [excess for joint in run.mechanism.joints.values() for excess in _of(run, joint)]


def _of(run: Trajectory, joint: Joint) -> Iterator[Excess]:
    model, q = run.mechanism.model, run.q[:, joint.q]
    v, most = run.v[:, joint.v], model.effortLimit[joint.v]
    tau = run.effort(joint.v) if np.isfinite(most) else run.tau[:, joint.v]
    rate = unit("rad/s") if joint.unit == RADIAN else joint.unit / unit("s")
    for of, measured, limit, values, beyond in (
        ("position", joint.unit, model.lowerPositionLimit[joint.q], q, model.lowerPositionLimit[joint.q] - q),
        ("position", joint.unit, model.upperPositionLimit[joint.q], q, q - model.upperPositionLimit[joint.q]),
        ("velocity", rate, model.velocityLimit[joint.v], v, np.abs(v) - model.velocityLimit[joint.v]),
        ("effort", effort_unit(joint), most, tau, np.abs(tau) - most),
    ):
        rows = np.flatnonzero(beyond > ROUNDING * max(abs(limit), 1e-3))  # infinite limits are not passed
        if len(rows):
            farthest = float(values[beyond.argmax()])
            yield Excess(joint.name, of, measured, float(limit), farthest, float(run.grid.t[rows[0]]), len(rows))
