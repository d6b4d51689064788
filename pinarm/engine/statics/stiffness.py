"""Stiffness of weights and loads, and small motions about an equilibrium."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.mass_matrix import MASSLESS
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.records import Record

ZERO = 1e-9
"""Stiffness, relative to the terms that make it up, below which it is 0: differences of loads leave up to 1e-12."""

STEP, LEVELS, ORDERS = 0.1237, 14, 5
"""Differences of loads: largest step, in rad or in the unit of length of the mechanism, no round number so that it hits
no special position; how often it is halved; columns of the extrapolation, up to order 10."""

KINK = 1e-2
"""Part of the slope of a load by which it may be another one to either side, over the smallest steps, or by all steps
together: where a load has an edge it is another one by its whole size."""


def force(dynamics: Dynamics, q: Array) -> Array:
    """Return f = loads - weights at rest [N*m or N], shape (nv,)."""
    model, data = dynamics.model, dynamics.data
    weights = np.asarray(pin.computeGeneralizedGravity(model, data, q))
    return np.asarray(dynamics.loads(0.0, q, np.zeros(model.nv)) - weights)


def stiffness(dynamics: Dynamics, q: Array, turns: Array, units: Array) -> tuple[Array, Array, Array]:
    """Return K = -df/dq under constant loads, the sizes of its terms, and those of f, which tell 0 from rounding.

    Args:
        dynamics: The equation of motion; every joint has one coordinate.
        q: Configuration [rad or m], shape (nv,).
        turns: 1 for joints that turn, 0 for those that slide, shape (nv,).
        units: See ``slope``.
    """
    model, data = dynamics.model, dynamics.data
    slopes = weight_slopes(model, data, q)
    size = weight_terms(model, data, q)
    sizes = np.triu(np.outer(turns, size))  # a turn of the joint before moves what the one after lifts
    sizes += np.triu(sizes, 1).T
    for element in dynamics.forces.values():
        load = partial(_load, element)
        own = slope(load, q, units)
        slopes -= own
        sizes += np.abs(own)
        size = size + np.abs(load(q[None])[0])
    return slopes, sizes, size


class Modes(Record, frozen=True):
    """Small motions about an equilibrium, those of ``M x'' + K x = 0``.

    Attributes:
        squares: ``w^2`` of ``K x = w^2 M x`` [rad^2/s^2], ascending, shape (n,); NaN where a direction has no mass.
        stiffnesses: Eigenvalues of K, ascending, shape (n,).
        stability: 1 stable, 0 indifferent, -1 unstable; that of K alone where a direction has no mass; NaN where the
            forces do not balance.
        edge: Name of a load whose slope is another one to either side: then all of these are NaN; empty for none.
    """

    squares: Array
    stiffnesses: Array
    stability: float
    edge: str = ""

    @classmethod
    def unknown(cls, count: int, edge: str = "") -> Modes:
        """Return unknown modes in so many directions."""
        return cls(np.full(count, np.nan), np.full(count, np.nan), np.nan, edge)

    @classmethod
    def of(cls, stiffness: Array, mass: Array, doubt: Array) -> Modes:
        """Return the small motions.

        Args:
            stiffness: K, shape (n, n); not symmetric under loads without a potential.
            mass: M, shape (n, n).
            doubt: How large an entry of K may be and still be 0, shape (n, n).
        """
        unit, massless = np.eye(len(mass)), _massless(mass)
        springs, _ = _modes_of(stiffness, unit, doubt)
        squares, modes = _modes_of(stiffness, unit if massless else mass, doubt)
        unsure = np.einsum("ik,ij,jk->k", np.abs(modes), doubt, np.abs(modes))
        falls = (squares.real < -unsure) | (np.abs(squares.imag) > unsure)
        stability = -1.0 if falls.any() else float((squares.real > unsure).all())
        ascending = np.full(len(mass), np.nan) if massless else np.sort(squares.real)
        return cls(ascending, np.sort(springs.real), stability)


def slope(load: Callable[[Array], Array], q: Array, units: Array) -> Array:
    """Return the Jacobian of a load at q, by central differences extrapolated to step 0 (Ridders), shape (nv, nv).

    Of all steps and orders each entry takes the one with the smallest estimate of its error, truncation and rounding
    together: near 1e-13 of the load's terms where the load is smooth over about 1e-4 rad or m and more.

    Args:
        load: Configurations, shape (m, nv), to loads, shape (m, nv).
        q: Configuration, shape (nv,).
        units: Over what changes of each coordinate loads change at most, shape (nv,): 1 rad, or the mechanism's unit of
            length, at most 1 m.
    """
    n = len(q)
    steps = STEP * 0.5 ** np.arange(LEVELS)[:, None, None] * np.minimum(units, 1.0)[:, None]
    shifts = steps * np.eye(n)
    ahead, behind = (load((q + side * shifts).reshape(-1, n)).reshape(LEVELS, n, n) for side in (1.0, -1.0))
    column = (ahead - behind) / (2.0 * steps)
    rounding = np.finfo(float).eps * np.maximum(np.abs(ahead), np.abs(behind)) / steps
    best, least = column[-1], np.full((n, n), np.inf)
    for order in range(1, ORDERS):
        finer = column[1:] + (column[1:] - column[:-1]) / (4.0**order - 1.0)
        doubt = np.maximum(np.abs(finer - column[1:]), np.abs(finer - column[:-1])) + rounding[order:]
        chosen = doubt.argmin(axis=0)[None]
        value, error = (np.take_along_axis(x, chosen, axis=0)[0] for x in (finer, doubt))
        best, least = np.where(error < least, value, best), np.minimum(error, least)
        column = finer
    return np.asarray(best.T)


def edge_at(dynamics: Dynamics, q: Array, units: Array) -> str:
    """Return the name of a load whose slope at q is another one to either side; empty where there is none.

    For ``units`` see ``slope``.
    """
    step = np.diag(STEP * 0.5 ** (LEVELS - 1) * np.minimum(units, 1.0))
    for name, element in dynamics.forces.items():
        load = partial(_load, element)
        ahead, behind, twice, back = (load(q + side * step) for side in (1.0, -1.0, 2.0, -2.0))
        here, h, finest = load(q[None])[0], np.diag(step)[:, None], (ahead - behind).T / (2.0 * np.diag(step))
        bend, wider = (ahead + behind - 2.0 * here) / h, (twice + back - 2.0 * here) / (2.0 * h)
        apart = np.maximum(np.abs(2.0 * bend - wider).T, np.abs(finest - slope(load, q, units)))  # 0 where it is smooth
        rounding = 1e3 * np.finfo(float).eps * np.maximum(np.abs(here), _terms(dynamics, element, q))[:, None] / h.T
        if (apart > KINK * np.abs(finest).max(initial=0.0) + rounding).any():
            return name
    return ""


def _modes_of(stiffness: Array, mass: Array, doubt: Array) -> tuple[Array, Array]:
    """Return the eigenvalues of ``K x = w^2 M x``, shape (n,), and x with ``x^H M x = 1`` as columns, shape (n, n).

    Where K is symmetric within ``doubt`` they are real; under loads without a potential they may be complex.
    """
    from scipy.linalg import eig, eigh

    if (np.abs(stiffness - stiffness.T) <= doubt).all():
        squares, modes = eigh(0.5 * (stiffness + stiffness.T), mass)
    else:
        squares, modes = eig(stiffness, mass)
        modes = modes / np.sqrt(np.einsum("ik,ij,jk->k", modes.conj(), mass, modes).real)
    return squares, modes


def _massless(mass: Array) -> bool:
    size = np.sqrt(np.diag(mass))
    return bool((size == 0.0).any() or np.linalg.eigvalsh(mass / np.outer(size, size))[0] < MASSLESS)


def _load(element: ForceElement, q: Array) -> Array:
    tau = np.zeros_like(q)
    element.add_load(0.0, q, np.zeros_like(q), tau)
    return tau


def _terms(dynamics: Dynamics, element: ForceElement, q: Array) -> Array:
    """Return the sizes of the terms of an element's loads on the joints [N*m or N], shape (nv,).

    Its forces on links, times how far the farther of joint and world's origin is where the joint turns. At a pivot of a
    link that a spring pulls from there they cancel.
    """
    wrenches = np.array([*element.wrenches(0.0, q, np.zeros_like(q)).values()]).reshape(-1, 2, 3)
    forces, moments = np.linalg.norm(wrenches, axis=2).sum(axis=0)
    pin.computeJointJacobians(dynamics.model, dynamics.data, q)
    ways, turns = np.linalg.norm(dynamics.data.J.reshape(2, 3, -1), axis=1)
    return np.asarray(forces * ways + moments * turns)


def weight_slopes(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Return the slopes of the efforts that hold the weights [N*m or N, per rad or m], shape (nv, nv).

    ``-g . (w_j x p_i)``, with ``p_i = sum_b m_b dc_b/dq_i`` over the centres of mass c_b beyond joint i, and w_j the
    axis of a joint j before it that turns, 0 of one that slides, in world axes. They are symmetric. Pinocchio's
    ``computeGeneralizedGravityDerivatives`` needs buffers that grow as nv^3; see ``pinocchio_data``.
    """
    pin.computeJointJacobians(model, data, q)
    tree, linear, angular = LinkTree.of(model), data.J[:3].T, data.J[3:].T
    moments = [inertia.mass * place.act(inertia.lever) for inertia, place in zip(model.inertias, data.oMi, strict=True)]
    beyond = tree.carried(np.column_stack([tree.masses, moments]))[tree.moved]
    p = beyond[:, :1] * linear + np.cross(angular, beyond[:, 1:])
    before = tree.supports[tree.moved].T  # which joints j are on the way to joint i
    slopes = np.where(before, np.cross(angular, model.gravity.linear) @ p.T, 0.0)
    return np.asarray(slopes + np.triu(slopes, 1).T)


def weight_terms(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Return ``sum_b m_b |g| |dc_b/dq_i|`` over the centres of mass c_b [N*m or N], shape (nv,)."""
    pin.computeJointJacobians(model, data, q)
    total, gravity = np.zeros(model.nv), float(np.linalg.norm(model.gravity.linear))
    for joint in range(1, model.njoints):
        jacobian = pin.getJointJacobian(model, data, joint, pin.LOCAL).reshape(6, -1)
        inertia = model.inertias[joint]
        moved = jacobian[:3] - np.cross(inertia.lever, jacobian[3:].T).T
        total += inertia.mass * gravity * np.linalg.norm(moved, axis=0)
    return total
