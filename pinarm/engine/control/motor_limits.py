"""What a run says of the limits of its motors: how long they give their peak torque, and whether they may do so."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.control.controlled_system import CONTROL
from pinarm.engine.control.efforts import RecordedEfforts
from pinarm.mechanics.control.motor_control import MotorController
from pinarm.mechanics.motors import TorqueSource

if TYPE_CHECKING:
    from pinarm.engine.motion.segmented.segments import SegmentedMotion

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Quadrature within a step, where efforts are smooth: degree 7, the order of the dense output."""

AT_LIMIT = {"margin": "gives its peak torque", "current_margin": "is at its current limit"}
"""Distance of a motor to a limit -> what it does where that is 0."""

ROUNDING = 1e-9
"""Of such a distance, relative to the largest of the run: a current is integrated."""

TOUCHING = 1e-9
"""Part of the motion by which two stretches are apart that are told as one."""


class Nodes(NamedTuple):
    """The inside of all steps of a motion, m nodes each.

    Attributes:
        start: Starts of the n steps [s], shape (n,).
        h: Their lengths [s], shape (n,).
        t: Instants of the nodes [s], shape (n m,).
        q: Configurations of the mechanism there, shape (n m, nq).
        v: Velocities, shape (n m, nv).
    """

    start: Array
    h: Array
    t: Array
    q: Array
    v: Array

    @classmethod
    def of(cls, motion: SegmentedMotion) -> Nodes:
        """Return the nodes of an integrated motion."""
        parts = []
        for segment in motion.segments:
            steps = segment.solution.steps
            start, end = steps.t, steps.until
            t = (start[:, None] + 0.5 * (end - start)[:, None] * (NODES + 1.0)).ravel()
            index = np.repeat(np.arange(len(start)), len(NODES))
            states = segment.system.whole(t, *segment.solution.states_in(index, t))
            parts.append((start, end - start, t, *states))
        return cls(*map(np.concatenate, zip(*parts, strict=True)))

    def mean(self, values: Array) -> float:
        """Return the mean over time of a value at the nodes, shape (n m,)."""
        inside = 0.5 * values.reshape(len(self.h), -1) @ WEIGHTS
        return float(inside @ self.h / self.h.sum())

    def stretches(self, inside: Flags) -> list[tuple[float, float]]:
        """Return the stretches of time [s] of steps in which nodes, shape (n m,), have a property."""
        slack, found = TOUCHING * float(self.h.sum()), list[tuple[float, float]]()
        for k in np.flatnonzero(inside.reshape(len(self.h), -1).any(axis=1)).tolist():
            start, end = float(self.start[k]), float(self.start[k] + self.h[k])
            if found and start - found[-1][1] <= slack:
                start = found.pop()[0]
            found.append((start, end))
        return found


def motor_remarks(motion: SegmentedMotion) -> list[str]:
    """Return what is to be said of the motors of an integrated motion; see ``recorded`` of ``controlled_motion``."""
    record = motion.dynamics.forces[CONTROL]
    assert isinstance(record, RecordedEfforts)
    motors = [one for one in record.continuous if isinstance(one, MotorController)]
    if not motors:
        return []
    nodes = Nodes.of(motion)
    parts = record.parts(nodes.t, nodes.q, nodes.v)[len(record.sampled) :]
    return [line for one, part in zip(record.continuous, parts, strict=True) for line in _remarks(one, part, nodes)]


def _remarks(one: object, part: dict[str, Array], nodes: Nodes) -> Iterator[str]:
    """Yield the remarks of the motors of one controller."""
    if not isinstance(one, MotorController):
        return
    for k, (drive, motor) in enumerate(zip(one.drives, one.actuators, strict=True)):
        for name, does in AT_LIMIT.items():
            margin = part[name][:, k] if name in part else np.full(len(nodes.t), np.nan)
            if stretches := nodes.stretches(margin <= ROUNDING * np.nanmax(margin, initial=1.0)):
                yield _at_limit(f"{drive} {does}", stretches)
        if isinstance(motor, TorqueSource) and motor.continuous is not None:
            torque = part["torque"][:, k]
            rms, speed = nodes.mean(torque**2) ** 0.5, nodes.mean(np.abs(motor.ratio * nodes.v[:, one.joints[k].v]))
            if rms > (allowed := float(motor.continuous.at(np.array(speed)))):
                yield (
                    f"{drive} gives a torque of {rms:.3g} N*m rms at a mean speed of {speed:.3g} rad/s, more than "
                    f"its continuous torque there, {allowed:.3g} N*m"
                )


def _at_limit(words: str, stretches: list[tuple[float, float]]) -> str:
    """Return how long a drive is at a limit, by the words for it."""
    (start, end), total = stretches[0], sum(end - start for start, end in stretches)
    if len(stretches) == 1:
        return f"{words} from t = {start:.6g} s to {end:.6g} s"
    first = f"the first from t = {start:.6g} s to {end:.6g} s"
    return f"{words} for {total:.6g} s in {len(stretches)} stretches, {first}"
