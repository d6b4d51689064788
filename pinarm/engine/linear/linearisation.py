"""The motion of a tree or of loops, linearised about a state: ``x' = A x + B u``.

The velocities that the constraints allow are ``v = N w``, w being those of d independent joints and N having their rows
equal to 1. A neighbouring motion deviates by ``delta`` in position and ``dv`` in velocity, with

    G delta = 0,    G dv + (G v)_q delta = 0

so that ``delta = N z`` and ``dv = N w + W z`` with the deviations z and w of the independent joints, W having zeros in
their rows. The acceleration of a deviation follows from the differentiated equation of motion,

    M da - G^T dlam = S du - F_q delta - F_v dv,    G da = -(G a + G' v)_q delta - (G a + G' v)_v dv

and of the independent joints ``z' = w``, less ``omega x z`` where three of them are a ball joint, and ``w' = da``. The
curvature of the rows and the geometric stiffness of the constraint forces are in F_q and ``(G a + G' v)_q``.

Source: Schiehlen and Eberhard, Applied Dynamics (2014), section 5.4 (linear equations of motion).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex, Indices
from pinarm.engine.linear.derivatives import EquationDerivatives
from pinarm.errors import DynamicsError
from pinarm.records import Record

DEPENDENT = 1e-9
"""Least pivot of scaled rows, relative to the largest, above which a row is independent."""

SINGULAR = 1e-6
"""Least pivot at which a position counts as regular: between this one and ``DEPENDENT`` it is refused."""


class LinearMotion(Record, frozen=True):
    """Linearised motion: ``x = [z; w]``, ``x' = a x + b u``.

    Attributes:
        independent: Velocities of the independent joints, by their indices in v, shape (d,).
        allowed: N, shape (nv, d).
        carried: W, shape (nv, d).
        a: State matrix, shape (2 d, 2 d).
        b: Input matrix of efforts at all joints, shape (2 d, nv).
        whole_a: Accelerations of all joints per state and per input, shape (nv, 2 d + nv).
        whole_lam: Multipliers likewise, shape (m, 2 d + nv).
    """

    independent: Indices
    allowed: Array
    carried: Array
    a: Array
    b: Array
    whole_a: Array
    whole_lam: Array

    @cached_property
    def modes(self) -> Modes:
        """Eigenvalues and eigenvectors of A."""
        return Modes.of(self.a)

    def motions(self, vectors: Complex) -> Complex:
        """Return the deviations of all joints for states, shape (2 d, k), as an array of shape (nv, k)."""
        return np.asarray(self.allowed @ vectors[: len(self.independent)])


class Modes(Record, frozen=True):
    """Eigenvalues and eigenvectors of a state matrix, by ascending frequency; of conjugate pairs, the upper one.

    Attributes:
        eigenvalues: lambda [1/s], shape (k,).
        vectors: Right eigenvectors of length 1, shape (2 d, k).
        conditions: Changes of eigenvalues per change of A, ``1/|y^H x|``, shape (k,).
        error: Backward error of the eigenvalues [1/s]: rounding of A.
    """

    eigenvalues: Complex
    vectors: Complex
    conditions: Array
    error: float

    @classmethod
    def of(cls, a: Array) -> Modes:
        """Return the modes of a state matrix, balanced by its scales first."""
        from scipy.linalg import eig, matrix_balance

        balanced, scales = matrix_balance(a, permute=False)
        eigenvalues, left, right = eig(balanced, left=True, right=True)
        kept = np.flatnonzero(eigenvalues.imag >= 0.0)
        kept = kept[np.lexsort((eigenvalues.real[kept], np.abs(eigenvalues[kept])))]
        conditions = 1.0 / np.maximum(np.abs((left[:, kept].conj() * right[:, kept]).sum(axis=0)), np.finfo(float).tiny)
        vectors = scales @ right[:, kept]
        error = float(np.finfo(float).eps * np.linalg.norm(balanced, 2))
        return cls(eigenvalues[kept], vectors / np.linalg.norm(vectors, axis=0), conditions, error)

    @property
    def frequencies(self) -> Array:
        """Undamped natural frequencies ``|lambda| / (2 pi)`` [Hz], shape (k,)."""
        return np.asarray(np.abs(self.eigenvalues) / (2.0 * np.pi))

    @property
    def damped_frequencies(self) -> Array:
        """Frequencies of the damped oscillations ``Im lambda / (2 pi)`` [Hz], shape (k,)."""
        return np.asarray(self.eigenvalues.imag / (2.0 * np.pi))

    @property
    def damping_ratios(self) -> Array:
        """``-Re lambda / |lambda|``, shape (k,); 0 of an eigenvalue 0."""
        size = np.abs(self.eigenvalues)
        return np.asarray(-self.eigenvalues.real / np.where(size > 0.0, size, 1.0))

    @property
    def errors(self) -> Array:
        """Errors of the eigenvalues by rounding, to first order: condition times backward error [1/s], shape (k,)."""
        return self.conditions * self.error


def linear_motion(model: pin.Model, at: EquationDerivatives, v: Array) -> LinearMotion:
    """Return the linearised motion about a state.

    Args:
        model: Pinocchio's model.
        at: Derivatives of the equation of motion there.
        v: Velocity there, shape (nv,).

    Raises:
        DynamicsError: The position is singular, or something without mass is free.
    """
    independent, allowed = independent_joints(at.rows)
    _require_regular(at, allowed)
    carried = -np.linalg.lstsq(at.rows, np.einsum("kmj,j,kd->md", at.rows_q, v, allowed), rcond=DEPENDENT)[0]
    carried -= allowed @ carried[independent]
    position, velocity = np.hstack([allowed, np.zeros_like(allowed)]), np.hstack([carried, allowed])
    force = at.force_q @ position + at.force_v @ velocity
    bend = at.acceleration_q @ position + at.acceleration_v @ velocity
    mass = allowed.T @ at.mass @ allowed
    accelerated = np.linalg.lstsq(at.rows, -bend, rcond=DEPENDENT)[0]
    pushed = np.hstack([-force - at.mass @ accelerated, np.eye(model.nv)])
    solved = _solved(mass, allowed.T @ pushed)
    whole = np.pad(accelerated, ((0, 0), (0, model.nv))) + allowed @ solved
    held = at.mass @ whole + np.hstack([force, -np.eye(model.nv)])
    multipliers = np.linalg.lstsq(at.rows.T, held, rcond=DEPENDENT)[0]
    turning = (velocity - _transport(model, v) @ position)[independent]
    size = position.shape[1]
    a = np.vstack([turning, whole[independent, :size]])
    b = np.vstack([np.zeros((len(independent), model.nv)), whole[independent, size:]])
    return LinearMotion(independent, allowed, carried, a, b, whole, multipliers)


def independent_joints(rows: Array) -> tuple[Indices, Array]:
    """Return independent velocities, by their indices ascending, and all velocities per unit of these, shape (nv, d).

    Raises:
        DynamicsError: The position is singular.
    """
    from scipy.linalg import qr

    nv = rows.shape[1]
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    upper, order = qr(rows / np.where(sizes > 0.0, sizes, 1.0), mode="r", pivoting=True)
    pivots = np.abs(np.diag(upper))
    rank = int((pivots > DEPENDENT * pivots[:1]).sum()) if len(pivots) else 0
    if rank and pivots[rank - 1] < SINGULAR * pivots[0]:
        raise _singular()
    dependent, free = order[:rank], order[rank:]
    allowed = np.zeros((nv, nv - rank))
    allowed[free] = np.eye(nv - rank)
    allowed[dependent] = -np.linalg.solve(upper[:rank, :rank], upper[:rank, rank:])
    ascending = np.argsort(free)
    return free[ascending], allowed[:, ascending]


def _require_regular(at: EquationDerivatives, allowed: Array) -> None:
    """Raise where rows are dependent in this position only.

    With ``mu^T G = 0`` in all positions nearby, ``mu^T G_q[n] n = 0`` for all allowed velocities n, as ``G n = 0`` is
    differentiated along the motion. Rows of one position, such as those of bars in one line, do not have that.

    Raises:
        DynamicsError: The position is singular.
    """
    left, values, _ = np.linalg.svd(at.rows)
    rank = at.rows.shape[1] - allowed.shape[1]
    turning = np.einsum("mr,kmj,kd,je->rde", left[:, rank:], at.rows_q, allowed, allowed)
    if np.abs(turning).max(initial=0.0) > SINGULAR * max(values.max(initial=0.0), np.abs(at.rows_q).max(initial=0.0)):
        raise _singular()


def _singular() -> DynamicsError:
    return DynamicsError(
        "the position is singular, or so near one that it is not told from it: several motions meet there, and none "
        "of them is linear",
        hint="a position beside it",
    )


def _solved(mass: Array, force: Array) -> Array:
    """Return ``mass^-1 force``.

    Raises:
        DynamicsError: Something without mass is free.
    """
    from scipy.linalg import LinAlgError, cho_factor, cho_solve

    try:
        return np.asarray(cho_solve(cho_factor(mass), force)) if len(mass) else np.zeros_like(force)
    except LinAlgError:
        raise DynamicsError(
            "something without mass is free to move: its acceleration is undetermined",
            hint="a mass, an armature, or fewer degrees of freedom",
        ) from None


def _transport(model: pin.Model, v: Array) -> Array:
    """Return the matrix C of ``delta' = dv - C delta``, shape (nv, nv): ``omega x`` of ball joints, 0 of all others."""
    transport = np.zeros((model.nv, model.nv))
    for joint in model.joints.tolist()[1:]:
        if joint.nv in (joint.nq, 1):
            continue
        part = slice(joint.idx_v, joint.idx_v + 3)
        transport[part, part] = pin.skew(v[part])
    return transport
