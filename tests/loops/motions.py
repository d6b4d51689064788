"""Runs of small mechanisms, and what is asked of them."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import nullcontext

import numpy as np
from linkage import GROUND, Linkage, Poses

from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

FINE = 1e-12


def anywhere(*path: object) -> nullcontext:
    """The place of mistakes in no file at all."""
    return nullcontext()


def free(mechanism: Mechanism, end=0.3, samples=4, **more) -> Trajectory:
    """The rows of ``freely``."""
    return freely(mechanism, end, samples, **more).rows


def freely(
    mechanism: Mechanism, end=0.3, samples=4, *, position=None, velocity=None, tolerance=FINE, **more
) -> Outcome:
    """Forward dynamics."""
    initial = InitialState(position=position or {}, velocity=velocity or {})
    problem = Forward(time=TimeGrid(end=end, samples=samples), initial=initial, **more)
    return problem.solve(mechanism, Accuracy(tolerance=tolerance), anywhere)


def driven(mechanism: Mechanism, motion: dict, end=1.0, samples=5, **more) -> Trajectory:
    """Inverse dynamics."""
    return (
        Inverse(time=TimeGrid(end=end, samples=samples), motion=motion, **more)
        .solve(mechanism, Accuracy(), anywhere)
        .rows
    )


def poses(linkage: Linkage, run: Trajectory) -> list[Poses]:
    """The bodies at every row."""
    return [Poses.of(linkage, run.mechanism, run.q[i], run.v[i], run.a[i]) for i in range(len(run))]


def energy(linkage: Linkage, pose: Poses, weight: float = 1.0) -> float:
    """Energy of all bodies, that of their weights as far as asked [J]."""
    total = 0.0
    for name, body in linkage.bodies.items():
        turned = pose.turn[name].T @ pose.omega[name]
        total += 0.5 * body.mass * pose.velocity[name] @ pose.velocity[name] + 0.5 * turned @ body.inertia @ turned
        total += weight * body.mass * linkage.gravity * pose.place[name][2]
    return total


def states(linkage: Linkage, run: Trajectory) -> np.ndarray:
    """All numbers of all bodies at all rows, however the linkage was cut."""
    return np.array([pose.stacked() for pose in poses(linkage, run)])


def wrench(linkage: Linkage, run: Trajectory, name: str, undetermined="refuse") -> dict[str, np.ndarray]:
    """What the first body of a joint does to the second at frame 2, component by component, over the rows.

    Components that the program refuses are left out.
    """
    asked, joint = Quantities(run, undetermined=undetermined), linkage.joints[name]
    if name in run.mechanism.closure.slices:
        prefix, sign = f"loop.{name}", 1.0
    else:
        known = run.mechanism.joints
        parts = [f"{name}_{letter}" for letter in "abcdef" if f"{name}_{letter}" in known] or [name]
        child_is_first = _parent(linkage, run.mechanism, parts[0]) != joint.first
        prefix, sign = (f"joint.{parts[0]}", -1.0) if child_is_first else (f"joint.{parts[-1]}", 1.0)
    found = {}
    for part in ("force", "moment"):
        for axis in "xyz":
            try:
                about = f".about.{name}_2" if part == "moment" else ""
                found[f"{part}.{axis}"] = sign * asked[f"{prefix}.{part}{about}.{axis}"].values
                if f"{name}_thread" in run.mechanism.closure.slices:  # of the parent on the child, or of this on that
                    found[f"{part}.{axis}"] -= asked[f"coupling.{name}_thread.{part}{about}.{axis}"].values
            except ValueError as error:
                assert "hyperstatic" in str(error)
    return found


def _parent(linkage: Linkage, mechanism: Mechanism, joint: str) -> str:
    """The body that carries a joint."""
    model = mechanism.model
    index = mechanism.joints[joint].index
    frames = {frame.name: frame.parentJoint for frame in model.frames}
    carrier = model.parents[index]
    bodies = [GROUND, *linkage.bodies]
    return next((body for body in bodies if frames[body] == carrier), GROUND)


def power(linkage: Linkage, pose: Poses) -> float:
    """Rate of kinetic and potential energy, by the motion of the bodies."""
    total = 0.0
    for name, body in linkage.bodies.items():
        turn, omega = pose.turn[name], pose.omega[name]
        inertia = turn @ body.inertia @ turn.T
        weight = np.array([0.0, 0.0, -linkage.gravity])
        total += body.mass * pose.velocity[name] @ (pose.acceleration[name] - weight)
        total += omega @ (inertia @ pose.alpha[name])
    return float(total)


def largest(parts: Iterable[np.ndarray]) -> float:
    """Largest absolute value in some arrays."""
    return max((float(np.abs(part).max(initial=0.0)) for part in parts), default=0.0)
