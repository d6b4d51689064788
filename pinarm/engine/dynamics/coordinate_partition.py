"""Linear constraints on the coordinates, ``W q = w(t)``, removed instead of enforced.

Prescribed joint coordinates, sums of them, and joints that mimic others are of this kind. With T a basis of the null
space of W the motion is ``v = T u + P w'``, ``W P = 1``: positions and velocities are those of the laws
themselves, and the equation of motion becomes ``T^T M T u' = T^T (loads - nle - M P w'')``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices, others
from pinarm.engine.constraints.nullspace import solved_positive
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.errors import InputError
from pinarm.mechanics.geometry.kinematics import with_masses
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Acceleration

Targets = Callable[[float], tuple[Array, Array, Array]]
"""``t -> w, w', w''``, each of shape (k,)."""

ManyTargets = Callable[[Array], tuple[Array, Array, Array]]
"""``Targets`` at many instants, shape (n,) to (n, k) each."""


IMMOVABLE = 1e20
"""Armature of a driven joint, relative to the largest inertia of the tree: what else acts there is below rounding."""


class CoordinatePartition(Record, frozen=True):
    """The independent part of the coordinates of one mechanism.

    Attributes:
        rows: W, shape (k, nv).
        basis: T, shape (nv, nu).
        particular: P, shape (nv, k).
        free_v: Indices in v of the independent velocities u, shape (nu,).
        free_q: Indices in q of the independent coordinates, shape (mu,).
        bound_v: Indices in v of the others, shape (k,).
        bound_q: Indices in q of the others, shape (k,).
        scalar_q: Index in q of every index in v, as far as its joint has one coordinate; shape (nv,).
    """

    model: pin.Model
    rows: Array
    basis: Array
    particular: Array
    free_v: Indices
    free_q: Indices
    bound_v: Indices
    bound_q: Indices
    scalar_q: Indices

    @classmethod
    def of(cls, model: pin.Model, rows: Array, names: Sequence[str], given: Sequence[int] = ()) -> CoordinatePartition:
        """Return the reduction by the rows W, shape (k, nv); the indices ``given`` stay free if they can."""
        bound_v = _pivots(rows, names, given)
        free_v = others(bound_v, model.nv)
        scalar_q = scalar_places(model)
        solve = np.linalg.inv(rows[:, bound_v])
        basis, particular = np.zeros((model.nv, len(free_v))), np.zeros((model.nv, len(rows)))
        basis[free_v] = np.eye(len(free_v))
        basis[bound_v] = -solve @ rows[:, free_v]
        particular[bound_v] = solve
        bound_q = scalar_q[bound_v]
        free_q = others(bound_q, model.nq)
        return cls(model, rows, basis, particular, free_v, free_q, bound_v, bound_q, scalar_q)

    def configuration(self, free: Array, w: Array) -> Array:
        """Return q from the independent coordinates, shape (..., mu), and the targets, shape (..., k)."""
        q = np.zeros((*free.shape[:-1], self.model.nq))
        q[..., self.free_q] = free
        scalars = q[..., self.scalar_q[self.free_v]]
        q[..., self.bound_q] = scalars @ self.basis[self.bound_v].T + w @ self.particular[self.bound_v].T
        return q

    def velocity(self, u: Array, dw: Array) -> Array:
        """Return v from the independent velocities, shape (..., nu), and the targets' rates, shape (..., k)."""
        return np.asarray(u @ self.basis.T + dw @ self.particular.T)

    def completed(self, q: Array, v: Array, w: Array, dw: Array) -> tuple[Array, Array]:
        """Return states with the independent part of given ones, shapes (..., nq) and (..., nv), and the targets."""
        return self.configuration(q[..., self.free_q], w), self.velocity(v[..., self.free_v], dw)

    def acceleration(self, dynamics: Dynamics, targets: Targets) -> Acceleration:
        """Return ``(t, q, v) -> a`` of one completed state: loads of one state take a ninth of the time of many."""
        model, data, basis = self.model, with_masses(self.model, dynamics.data), self.basis

        def reduced(t: float, q: Array, v: Array) -> Array:
            w, dw, ddw = targets(t)
            q, v = self.completed(q, v, w, dw)
            mass, particular = np.array(pin.crba(model, data, q)), self.particular @ ddw
            demand = dynamics.loads(t, q, v) - pin.nonLinearEffects(model, data, q, v)
            right = basis.T @ (demand - mass @ particular)
            return np.asarray(basis @ solved_positive(basis.T @ mass @ basis, right[:, None])[:, 0] + particular)

        return reduced

    def accelerations(self, dynamics: Dynamics, targets: ManyTargets) -> Callable[[Array, Array, Array], Array]:
        """Return ``(t, q, v) -> a`` of completed states, shapes (n,), (n, nq) and (n, nv) to (n, nv)."""

        def reduced(t: Array, q: Array, v: Array) -> Array:
            w, dw, ddw = targets(t)
            q, v = self.completed(q, v, w, dw)
            demand = dynamics.inverse(t, q, v, ddw @ self.particular.T)
            free = solved(self.basis.T @ dynamics.mass_matrices(q) @ self.basis, -demand @ self.basis)
            return self.velocity(free, ddw)

        return reduced


def heavy(model: pin.Model, driven: Sequence[int]) -> pin.Model:
    """Return a model with armatures that outweigh the tree at driven joints, by their indices in v."""
    copy = pin.Model(model)
    copy.armature[list(driven)] += IMMOVABLE * float(np.diag(mass_matrix(model, pin.neutral(model))).max(initial=0.0))
    return copy


def scalar_places(model: pin.Model) -> Indices:
    """Return the first place in q of the joint of every velocity, shape (nv,)."""
    places = np.zeros(model.nv, dtype=np.intp)
    for joint in model.joints.tolist()[1:]:
        places[joint.idx_v : joint.idx_v + joint.nv] = joint.idx_q
    return places


def solved(matrices: Array, right: Array) -> Array:
    """Return the solutions x of ``A x = b``, shape (n, f); not numbers where a matrix is singular."""
    try:
        return solved_positive(matrices, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        if len(right) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([solved(matrices[k : k + 1], right[k : k + 1]) for k in range(len(right))])


def _pivots(rows: Array, names: Sequence[str], given: Sequence[int]) -> Indices:
    """Choose a coordinate for each row that the others determine: the last of the largest weights left in it."""
    left, chosen = rows.astype(float).copy(), []
    for k in range(len(rows)):
        size = np.abs(left[k])
        others = size.copy()
        others[list(given)] = 0.0
        preferred = others if others.max() > 1e-9 * np.abs(rows[k]).max() else size
        pivot = len(size) - 1 - int(preferred[::-1].argmax())
        if size[pivot] < 1e-9 * np.abs(rows[k]).max():
            raise InputError(
                f"the coordinate '{names[k]}' is already determined by {', '.join(names[:k])}",
                expected="coordinates that can be prescribed independently",
            )
        chosen.append(pivot)
        left[k + 1 :] -= np.outer(left[k + 1 :, pivot] / left[k, pivot], left[k])
    return np.array(chosen, dtype=np.intp)
