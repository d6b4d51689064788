"""Friction that locks: joints at rest that hold any effort, however large, as a worm does that is driven at its wheel.

The effort T of a drive and the friction f of the joints at rest are in balance for ``T = T0 - J f``, with the slips J
per unit of the drive's coordinate, and they stay at rest as long as ``|f_i| <= mu_i N_i(w(f)) + c_i``. For
frictions ``f_i = -s_i r_i x`` along a ray r, with the slips' directions s, the reserve

    h_i(x) = mu_i N_i(w(- x s r)) + c_i - r_i x

is convex in x between kinks of the loads (``carried_loads``). Where it is nowhere negative, of all joints in the ray,
friction holds every effort from T0 on. Joints whose friction is constant have it throughout: with the others at 0 they
hold any part of it before. Rays are those of each joint alone and, for joints that lock together only, the one in which
their friction raises their loads most, the eigenvector of C; see ``slipping``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.friction.slipping import CONTRACTING, Slipping, least_of

ROUNDED = 1e-12
"""Part of the terms of the effort by which rounding may let a reserve be negative."""


def locks(equation: Slipping, slips: Array, effort: float) -> bool:
    """Return whether joints at rest hold any effort in the direction in which it would make them slip.

    Args:
        equation: Of the joints, all of them at rest, with their friction at rest.
        slips: Per unit of the drive's coordinate, shape (k,).
        effort: Size of the terms of the effort, which rounding is judged by [N*m or N].
    """
    if equation.contracts:
        return False
    return any(_is_held(equation, ray, slips, ROUNDED * effort) for ray in _rays(equation, slips))


def _rays(equation: Slipping, slips: Array) -> Iterator[Array]:
    """Yield r of the joints that slip and whose friction depends on their load, shape (k,) each."""
    size = np.abs(equation.direction) * (equation.mu > 0.0) * (slips != 0.0)
    for name in dict.fromkeys(equation.contacts[i].name for i in np.flatnonzero(size).tolist()):
        yield np.array([part if one.name == name else 0.0 for one, part in zip(equation.contacts, size, strict=True)])
    some = np.flatnonzero(size)
    if len(some) > 1:
        most = [size[i] * equation.mu[i] * equation.loads.most(i, equation.contacts[i].bearing)[some]
                for i in some.tolist()]  # fmt: skip
        values, vectors = np.linalg.eig(np.array(most))
        ray = np.zeros(len(size))
        ray[some] = np.abs(vectors[:, np.abs(values).argmax()])
        yield ray


def _is_held(equation: Slipping, ray: Array, slips: Array, slack: float) -> bool:
    """Return whether no reserve along a ray is negative, beyond what an effort of the size of ``slack`` does."""
    friction, size = -np.sign(equation.direction) * ray, np.abs(equation.direction)
    constant = -equation.direction * equation.constant * (equation.mu == 0.0)
    added, kinks = equation.loads.far(friction), equation.loads.crossings(constant, friction)
    for i in np.flatnonzero(ray).tolist():
        mu, bearing = size[i] * equation.mu[i], equation.contacts[i].bearing
        if mu * bearing.most(added[i]) * CONTRACTING <= ray[i]:
            return False

        def reserve(x: float, i: int = i) -> float:
            return float(size[i] * equation.resistance(constant + x * friction)[i] - ray[i] * x)

        if least_of(reserve, kinks) * abs(slips[i]) < -slack:
            return False
    return True
