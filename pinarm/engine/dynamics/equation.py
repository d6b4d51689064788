"""The equation of motion under constraints, and its one solve.

With the rows G of all constraints (loop joints, couplings, coordinates that follow laws) the motion satisfies

    M(q) a + nle(q, v) = tau + loads + G^T lam        (1)
    G(q) a = b,    b = -G' v, plus w'' in the row of a coordinate that follows the law w(t)        (2)

Let T be a basis of the velocities that the rows allow, ``G T = 0``, and a_p the shortest solution of (2), both from the
singular values of G (``engine.constraints.nullspace``). All solutions of (2) are ``a = a_p + T u``. The multipliers do
no work along T, ``T^T G^T = 0``; so with the force ``f = tau + loads - nle`` equation (1), multiplied by T^T, gives

    T^T M T u = T^T (f - M a_p)        (3)

and what is left of (1) the multipliers, ``G^T lam = M a - f``: the least ones where rows are redundant. This is Gauss's
principle: of all accelerations that satisfy (2), a has the least ``(a - a0)^T M (a - a0)``, ``M a0 = f``. M has to be
positive along T only; an open chain has no rows, ``T = 1``. With velocities in place of accelerations the same solve
projects them onto the constraints, ``f = M v`` and ``b = w'``, and gives the velocities after an impact.

Other routes to the same numbers are faster where they apply, and tested against this one:

- ``Dynamics.forward`` (``aba``) and ``Dynamics.inverse`` (``rnea``) for open chains;
- ``engine.kernel``, in C, for one state after another of trees, loops and couplings.

Source: Udwadia and Kalaba, A new perspective on constrained motion, Proc. R. Soc. Lond. A 439 (1992), 407-410; closed
loops, Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 8.
"""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import Decomposition, solved_positive
from pinarm.engine.dynamics.dynamics import Dynamics

NUMBERS = 20_000_000
"""Numbers of the mass matrices that are computed together."""


def solve(rows: Decomposition, mass: Array, force: Array, right: Array) -> Array:
    """Return the a of (1) and (2): the one that minimises ``a^T M a / 2 - f . a`` while ``G a = b``, shape (.., nv).

    Args:
        rows: G, decomposed.
        mass: M, shape (.., nv, nv).
        force: f, shape (.., nv).
        right: b, shape (.., m).
    """
    a = rows.particular(right)
    if count := rows.free.shape[-1]:
        transposed = rows.free.swapaxes(-1, -2)
        wanted = np.matvec(transposed, force - (mass @ a[..., None])[..., 0])
        reduced = transposed @ (mass @ rows.free)
        if (rows.freedom < count).any():  # columns of T that are 0
            reduced = reduced + np.eye(count) * (np.arange(count) >= rows.freedom[..., None])[..., None]
        a = a + (rows.free @ solved_positive(reduced, wanted[..., None]))[..., 0]
    return a


def accelerations(dynamics: Dynamics, closure: Closure, t: Array | float, q: Array, v: Array, tau: Array) -> Array:
    """Return the accelerations of a mechanism under efforts of its drives, shape (n, nv).

    Args:
        t: Instants [s], shape (n,), or one for all.
        q: Configurations, shape (n, nq), at which the constraints are closed.
        v: Velocities, shape (n, nv), that they allow.
        tau: Efforts [N*m or N], shape (n, nv).
    """
    most = max(1, NUMBERS // max(1, q.shape[1] ** 2))
    if len(q) > most:
        t = np.broadcast_to(t, len(q))
        parts = (slice(start, start + most) for start in range(0, len(q), most))
        return np.concatenate([accelerations(dynamics, closure, t[k], q[k], v[k], tau[k]) for k in parts])
    rows = closure.split_at(q)
    force = tau - dynamics.inverse(t, q, v, np.zeros_like(v))
    return solve(rows, dynamics.mass_matrices(q), force, -closure.drifts(q, v))
