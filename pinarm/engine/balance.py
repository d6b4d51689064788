"""What a run is worth, measured in the run itself: balances by routes that the solver did not use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.integrators import Solution
from pinarm.engine.trajectory import Trajectory

Whole = Callable[[Array, Array, Array], tuple[Array, Array]]
"""Rows of integrated states to rows of those of the mechanism: ``t, q, v -> q, v``."""

SAMPLE = 64
"""Number of rows that are checked where not all are: a fixed, even choice, so that the cost of tables stays bounded."""

PARTS, GAUSS_NODES = 4, 4
"""Parts of a step at whose ends the energy is looked at: within it the dense output errs more than at its end. Nodes
of the quadrature of dissipated power over a part: degree 7, the order of the dense output."""


def power_balance(trajectory: Trajectory, most: int = SAMPLE) -> dict[str, float]:
    """Return the largest violation of d'Alembert's principle, and of the balance of power, relative to their terms.

    For every unit velocity e_k the virtual power of the efforts and loads must equal that of the bodies' momentum
    rates less their weights: ``sum_i J_i^T (I_i A_i + V_i x* I_i V_i)``, with the Jacobians J_i of the bodies and
    their twists from forward kinematics. Neither appears in the recursions that solved the motion.

    Args:
        trajectory: The motion.
        most: Largest number of rows that are checked.

    Returns:
        ``equilibrium``: largest residual, and ``power``: largest residual of power along the motion, each relative to
        the largest sum of the absolute terms over the rows; weights count with the full length of their path, so that
        a position in which every moment vanishes has terms to compare with. Nothing where no efforts were asked for.
    """
    if trajectory.unasked:
        return {}
    rows = np.linspace(0, len(trajectory) - 1, min(len(trajectory), most)).astype(int)
    model, data = trajectory.mechanism.model, trajectory.mechanism.model.createData()
    loads = trajectory.gather(lambda dynamics, part: dynamics.loads(
        trajectory.grid.t[part], trajectory.q[part], trajectory.v[part]))  # fmt: skip
    pull = float(np.linalg.norm(model.gravity.linear))
    residuals, terms = np.zeros((len(rows), model.nv)), np.zeros((len(rows), model.nv))
    closure = trajectory.closure
    for k, row in enumerate(rows):
        closure.place(trajectory.q[row])
        held = closure.load(trajectory.lam[row])
        q, v, a = trajectory.q[row], trajectory.v[row], trajectory.a[row]
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, v, a)
        supplied = trajectory.tau[row] + loads[row] + held - model.armature * a
        residuals[k], terms[k] = supplied, np.abs(supplied) + np.abs(held)
        for joint in range(1, model.njoints):
            jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL).reshape(6, -1)
            inertia, twist, acceleration = model.inertias[joint], data.v[joint], data.a[joint]
            fall = data.oMi[joint].actInv(model.gravity)
            demands = (inertia * acceleration, twist.cross(inertia * twist), inertia * -fall)
            parts = jacobian.T @ np.array([demand.vector for demand in demands]).T
            residuals[k] -= parts.sum(axis=1)
            path = jacobian[:3] - pin.skew(inertia.lever) @ jacobian[3:]  # of the mass centre, for unit velocities
            terms[k] += np.abs(parts).sum(axis=1) + inertia.mass * pull * np.sqrt((path * path).sum(axis=0))
    v = trajectory.v[rows]
    powers, scale = (residuals * v).sum(axis=1), (terms * np.abs(v)).sum(axis=1)
    return {"equilibrium": _relative(residuals, terms), "power": _relative(powers, scale)}


@dataclass(frozen=True)
class Account:
    """What the energy of an integrated motion is balanced from.

    Attributes:
        solution: The motion.
        dynamics: The equation of motion on each of its stretches.
        whole: Integrated states to those of the mechanism, where they are not the same.
    """

    solution: Solution
    dynamics: list[Dynamics]
    whole: Whole = lambda t, q, v: (q, v)

    def columns(self) -> tuple[Array, Array, Array]:
        """Return kinetic, potential and so far dissipated energy [J] at the ends of all parts, each of shape (n,)."""
        index, start, h = self._parts()
        ends, where = np.concatenate([start[:1], start + h]), np.concatenate([index[:1], index])
        kinetic, potential = self.dynamics[0].energy(*self.whole(ends, *self.solution.states_in(where, ends)))
        return kinetic, potential, np.concatenate([[0.0], np.cumsum(self._losses(index, start, h))])

    def _parts(self) -> tuple[Indices, Array, Array]:
        """Return the step of every part, its start and its length [s], each of shape (PARTS * steps,)."""
        steps = self.solution.steps
        index, part = np.repeat(np.arange(len(steps)), PARTS), np.tile(np.arange(PARTS), len(steps))
        start, h = np.array([(step.t, (step.until - step.t) / PARTS) for step in steps])[index].T
        return index, start + part * h, h

    def _losses(self, index: Indices, start: Array, h: Array) -> Array:
        """Return the energy dissipated in every part [J], shape (PARTS * steps,)."""
        if not any(part.forces for part in self.dynamics):
            return np.zeros(len(h))
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS_NODES)
        t = (start[:, None] + 0.5 * h[:, None] * (nodes + 1.0)).ravel()
        where = np.repeat(index, GAUSS_NODES)
        q, v = self.whole(t, *self.solution.states_in(where, t))
        stretch = np.array([step.stretch for step in self.solution.steps])[where]
        powers = np.zeros(len(t))
        for number in np.unique(stretch):
            rows = stretch == number
            powers[rows] = self.dynamics[number].dissipated_power(t[rows], q[rows], v[rows])
        return np.asarray(0.5 * h * (powers.reshape(-1, GAUSS_NODES) @ weights))


def energy_balance(*accounts: Account) -> dict[str, float]:
    """Return the largest change of energy that nothing accounts for, at the ends of the steps and within them.

    ``E(t) - E(0) + integral of the dissipated power``, relative to the largest energy exchanged: between kinetic and
    potential, and through dampers and drives. For a motion without loads it is the drift of the energy. Where a motion
    has several parts, what impacts between them take is none of its errors.
    """
    found = [account.columns() for account in accounts if account.solution.steps]
    if not found:
        return {}
    drift, largest = 0.0, 0.0
    for parts in found:
        here = drift + np.sum([part - part[0] for part in parts], axis=0)
        largest, drift = max(largest, float(np.abs(here).max())), float(here[-1])
    columns = [np.concatenate(column) for column in zip(*found, strict=True)]
    exchanged = max(*(float(np.ptp(column)) for column in columns), float(np.abs(columns[0]).max()))
    return {"energy": largest / exchanged if exchanged else 0.0}


def _relative(residuals: Array, terms: Array) -> float:
    largest = float(terms.max(initial=0.0))
    return float(np.abs(residuals).max(initial=0.0) / largest) if largest else 0.0
