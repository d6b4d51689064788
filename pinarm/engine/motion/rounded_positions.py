"""What rounding of the positions leaves of prescribed motions next to singular positions.

Loops that are closed to rounding may be elsewhere by ``eps / s``, s being the least singular value of J, the rows of
the constraints and of what is prescribed. At a change point velocities are then known to ``eps / s^2``, accelerations
to ``eps / s^3``, and no equation of the rows shows it: all of them hold at the position beside as well. How much it is
comes of solving the worst rows again where rounding may have put them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.kinematics.abscissa import instant
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.newton import NewtonSolver
from pinarm.engine.statics.stiffness import weight_terms
from pinarm.errors import PinarmError
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.prescribed_motion import Prescription
    from pinarm.engine.motion.trajectory import Trajectory

NEAR, WORST = 1e-2, 3
"""Ratio of singular values of J below which rows are looked at, where rounding leaves 1e-10, and the least regular of
them that are: what rounding leaves grows with the nearness."""

ROUNDED = float(np.finfo(float).eps)
"""What is left open of closed loops at most, relative to what their places are sums of. Of 270 rows of random four-bars
at dead centres and change points, against closed forms to 50 digits, errors were 0.63 of what is told at most."""

KINDS = ("positions", "velocities", "accelerations", "efforts and forces")
"""What is told of, in this order."""

TOLD = 1e-9
"""Part of the largest value in the run from which on it is told: the digits of a table, and two more."""


def rounding_notes(known: Prescription, rows: Trajectory, regular: Array, pace: Array | None) -> list[str]:
    """Return what is to be said of rows next to singular positions.

    Args:
        known: What is prescribed.
        rows: The states, with efforts where these are asked for.
        regular: Least singular value of J over the largest at the rows, shape (n,).
        pace: See ``Prescription.solved``.
    """
    if not isinstance(known.motion, DeterminedMotion) or rows.mechanism.model.nv > MANY:
        return []
    if not (regular < NEAR).any():
        return []
    solver = NewtonSolver(rows.mechanism.closure, known.motion.prescribed)
    worst = np.argsort(regular, kind="stable")[:WORST]
    left = np.array([_left(known, solver, rows, row, pace) for row in worst[regular[worst] < NEAR].tolist()])
    if not (left > TOLD).any():
        return []
    at = instant(float(rows.grid.t[worst[left.max(axis=1).argmax()]]))
    parts = [f"{what} {f'to {part:.1g}' if part < 1.0 else 'not at all'}"
             for what, part in zip(KINDS, left.max(axis=0), strict=True) if part > TOLD]  # fmt: skip
    return [
        f"at {at}, next to a singular position, rounding of positions is magnified, which no residual shows: known are "
        f"{', '.join(parts)}, of their largest or of what speeds, masses and weights make of their unit"
    ]


def _left(known: Prescription, solver: NewtonSolver, rows: Trajectory, row: int, pace: Array | None) -> Array:
    """Return what rounding leaves of a row, as a part of the largest values, shape (4,): see ``KINDS``.

    1 where the row cannot be solved beside itself, or where as much as that is left.
    """
    one = rows.some(np.array([row]))
    step = _displacement(solver, one.q[0])
    turned = pin.difference(solver.model, pin.neutral(solver.model), one.q[0]) / solver.scale
    found = [np.minimum(np.abs(step).max() / (1.0 + np.abs(turned).max()), 1.0), 0.0, 0.0, 0.0]
    sizes = _sizes(rows, one, solver)
    for side in (1.0, -1.0):
        try:
            beside = _beside(known, solver, one, solver.moved(one.q[0], side * step), pace)
        except PinarmError:
            return np.array([found[0], *(float(size > 0.0) for size in sizes)])
        apart = [(beside.v - one.v) / solver.scale, (beside.a - one.a) / solver.scale,
                 _forces(beside, solver) - _forces(one, solver)]  # fmt: skip
        parts = [min(_largest(x) / size, 1.0) if size else 0.0 for x, size in zip(apart, sizes, strict=True)]
        found[1:] = np.maximum(found[1:], parts)
    return np.array(found)


def _sizes(rows: Trajectory, one: Trajectory, solver: NewtonSolver) -> tuple[float, float, float]:
    """Return how large velocities, accelerations and forces are, in the units of ``_left``.

    Accelerations of a steady motion, and forces that balance, may be 0 but for rounding: squares of velocities count,
    and what weights and inertias are by themselves.
    """
    model, data = one.mechanism.model, one.mechanism.dynamics.data
    speed = _largest(rows.v / solver.scale)
    acceleration = max(_largest(rows.a / solver.scale), speed**2)
    inertias = solver.scale[:, None] * one.dynamics.mass_matrices(one.q)[0] * solver.scale
    weights = weight_terms(model, data, one.q[0]) * solver.scale
    return (
        speed,
        acceleration,
        max(_largest(_forces(one, solver)), _largest(inertias) * acceleration, _largest(weights)),
    )


def _displacement(solver: NewtonSolver, q: Array) -> Array:
    """Return the step by which rounding may have displaced a configuration, in the units of the rows, shape (nv,)."""
    state = solver.closure.state(q)
    _, values, ways = np.linalg.svd(solver.rows(state), full_matrices=False)
    size = max([solver.whole.coarseness, *(abs(one.value(state)) for one in solver.coordinates)])
    return np.asarray(ROUNDED * size / max(float(values[-1]), 1e-300) * ways[-1])


def _beside(known: Prescription, solver: NewtonSolver, one: Trajectory, q: Array, pace: Array | None) -> Trajectory:
    """Return a row at a configuration beside its own, at which it follows the same laws.

    Raises:
        PinarmError: There is none.
    """
    state, t = solver.closure.state(one.q[0], one.v[0]), float(one.grid.t[0])
    rows = np.array([coordinate.row(state) for coordinate in solver.coordinates])
    drift = np.array([coordinate.drift(state) for coordinate in solver.coordinates])
    v, a = np.zeros_like(one.v[0]), np.zeros_like(one.a[0])
    if one.v.any() or one.a.any():  # at rest, which a singular position does not hinder
        v, a = solver.rates(q, rows @ one.v[0], rows @ one.a[0] + drift, t)
    return known.solved(replace(one, q=q[None], v=v[None], a=a[None]), pace)


def _forces(one: Trajectory, solver: NewtonSolver) -> Array:
    """Return the efforts of a row and the multipliers of its loops, lengths in the mechanism's units."""
    return np.append(one.tau[0] * solver.scale, np.asarray(one.lam)[0, : solver.closure.size] * solver.closure.measure)


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
