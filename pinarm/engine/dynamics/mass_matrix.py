"""The mass matrix M(q), of which Pinocchio computes the upper half only."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.one_run import kept_in_a_run
from pinarm.mechanics.geometry.buffers import give_back, take
from pinarm.mechanics.geometry.link_tree import LinkTree, states_first
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.pinocchio_data import with_masses
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.records import Record

if TYPE_CHECKING:
    from scipy.sparse import csc_array

KEPT = 64
"""Number of configurations up to which mass matrices are kept until the end of a run."""


def mass_matrix(model: pin.Model, q: Array) -> Array:
    """Return M at a configuration, shape (nq,), as an array of shape (nv, nv); armatures are in it."""
    return np.asarray(mass_matrices(model, q[None])[0])


def mass_matrices(model: pin.Model, q: Array) -> Array:
    """Return M at configurations, shape (n, nq), as an array of shape (n, nv, nv); armatures are in it."""
    upper, data = np.empty((len(q), model.nv, model.nv)), with_masses(model, take(model))
    for matrix, configuration in zip(upper, q, strict=True):
        matrix[:] = pin.crba(model, data, configuration).reshape(matrix.shape)
    give_back(model, data)
    return symmetric(upper)


def symmetric(upper: Array) -> Array:
    """Return the matrices with given upper halves, shape (.., nv, nv), whatever is below their diagonals."""
    half = upper * _half(upper.shape[-1])
    return np.asarray(half + half.swapaxes(-1, -2))


def shared_mass_matrices(model: pin.Model, q: Array) -> Array:
    """Return the same, to be read only: what closes the states of a table and what checks it ask for the same few.

    The model must not have changed since, as for all that is kept of it; q is an array of doubles.
    """
    return _kept_matrices(model, q.tobytes(), len(q)) if 1 < len(q) <= KEPT else mass_matrices(model, q)


@kept_in_a_run(1)
def _kept_matrices(model: pin.Model, content: bytes, n: int) -> Array:
    """Return the same at n configurations, given by the bytes of their array."""
    found = mass_matrices(model, np.frombuffer(content).reshape(n, -1))
    found.flags.writeable = False
    return found


@cache
def _half(n: int) -> Array:
    """Return what keeps half of the diagonal of a matrix and what is above it: ``numpy.triu`` costs 10 us."""
    return np.triu(np.ones((n, n)), 1) + 0.5 * np.eye(n)


class MassProducts(Record, frozen=True):
    """M of many joints at n configurations, known by its products.

    Attributes:
        model: Pinocchio's model.
        q: Configurations, shape (n, nq), or one, shape (nq,).
    """

    model: pin.Model
    q: Array

    def __getitem__(self, rows: Indices) -> MassProducts:
        """Return M at some of the configurations."""
        return MassProducts(self.model, self.q[rows])

    def __matmul__(self, x: Array) -> Array:
        """Return ``M x`` of columns, shape (n, nv, k), or (nv, k) of one configuration."""
        if self.q.ndim == 1:
            return mass_times(self.model, self.q, x)
        return np.array([mass_times(self.model, *each) for each in zip(self.q, x, strict=True)])


Masses = Array | MassProducts
"""M, shape (.., nv, nv), or its products with columns."""


def masses(model: pin.Model, q: Array) -> Masses:
    """Return M at configurations, shape (n, nq), or at one, (nq,): a matrix, or of many joints its products."""
    if model.nv > MANY:
        return MassProducts(model, q)
    return shared_mass_matrices(model, q) if q.ndim > 1 else mass_matrix(model, q)


def largest_eigenpair(size: int, product: Callable[[Array], Array], near: Array | None = None) -> tuple[float, Array]:
    """Return the largest eigenvalue of a symmetric positive matrix, given as its products, and its eigenvector.

    Lanczos' method; where an eigenvector nearby is known it takes a third of the products.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    start, kept = (np.cos(np.arange(1.0, size + 1.0)), None) if near is None else (near, 5)
    values, vectors = eigsh(LinearOperator((size, size), product), 1, v0=start, ncv=kept, tol=1e-3)
    return float(values[0]), vectors[:, 0]


def sparse_mass_matrix(model: pin.Model, q: Array) -> csc_array:
    """Return M at a configuration, with entries for joints on one path from the world only, shape (nv, nv).

    The composite rigid body algorithm in the axes of the links, all joints of one depth together: with the inertia I^c
    of all that lies beyond a joint, ``M_ij = S_i^T F_j`` for the force ``F_j = I^c_j S_j`` passed on to the link i.

    Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 6.2.
    """
    from scipy.sparse import csc_array

    pattern, tree = _pattern(model), LinkTree.of(model)
    ((outwards,), (motions,), (composite,)) = _carried(model, q[None])
    forces, values = np.matvec(composite[tree.moved], motions), []
    for step in pattern.steps:
        values.append(np.vecdot(motions[step.before], forces[step.beyond]))
        forces[step.passed] = np.matvec(outwards[step.links], forces[step.passed])
    found = np.concatenate(values)
    found[pattern.own] += model.armature
    return csc_array((found[pattern.entries], pattern.rows, pattern.starts), shape=(model.nv, model.nv))


def _carried(model: pin.Model, q: Array) -> tuple[Array, Array, Array]:
    """Return what the composite rigid body algorithm begins with, at configurations, shape (n, nq).

    Returns:
        What gives a force [f; m] on every link at the origin of its parent, shape (n, njoints, 6, 6); the motions S of
        the joints in the axes of their links, shape (n, nv, 6); and the inertia of every link with all that lies
        beyond it, shape (n, njoints, 6, 6).
    """
    tree = LinkTree.of(model)
    turns, arms = (states_first(part, tail) for part, tail in zip(tree.relative(q), (3, 2), strict=True))
    outwards, motions = np.zeros((*turns.shape[:2], 6, 6)), tree.subspace.T
    outwards[..., :3, :3] = outwards[..., 3:, 3:] = turns
    outwards[..., 3:, :3] = crossed(arms[..., None, :], turns.swapaxes(-2, -1)).swapaxes(-2, -1)  # r x its columns
    composite = np.tile(tree.inertias, (len(q), 1, 1, 1))
    for links in _levels(model):
        passed = outwards[:, links] @ composite[:, links] @ outwards[:, links].swapaxes(-2, -1)
        np.add.at(composite.swapaxes(0, 1), tree.parents[links], passed.swapaxes(0, 1))
    return outwards, np.broadcast_to(motions, (len(q), *motions.shape)), composite


class _Step(Record, frozen=True):
    """Entries of M between joints that are a number of joints apart.

    Attributes:
        before: First velocity of every entry, shape (e,).
        beyond: Second one, whose force has been passed on to the link of the first, shape (e,).
        passed: Velocities whose force goes on to a further link, shape (p,).
        links: Links that it leaves, shape (p,).
    """

    before: Indices
    beyond: Indices
    passed: Indices
    links: Indices


class _Pattern(Record, frozen=True):
    """Where M has entries.

    Attributes:
        steps: How the entries are computed.
        own: Computed entry on the diagonal, of every velocity, shape (nv,).
        entries: Computed entry of every entry of M in its columns, shape (z,).
        rows: Their rows, shape (z,).
        starts: First entry of every column, shape (nv + 1,).
    """

    steps: tuple[_Step, ...]
    own: Indices
    entries: Indices
    rows: Indices
    starts: Indices


@cached_by_model
def _pattern(model: pin.Model) -> _Pattern:
    tree = LinkTree.of(model)
    counts = np.bincount(tree.moved, minlength=len(tree.parents))
    starts = np.searchsorted(tree.moved, np.arange(len(tree.parents)))
    beyond, links, steps = np.arange(model.nv), tree.moved, list[_Step]()
    while len(beyond):
        many = counts[links]
        pairs = np.repeat(np.arange(len(beyond)), many)
        before = np.arange(len(pairs)) + np.repeat(starts[links] - np.cumsum(many) + many, many)
        upper = before <= beyond[pairs]
        going = tree.parents[links] > 0
        steps.append(_Step(before[upper], beyond[pairs][upper], beyond[going], links[going]))
        beyond, links = beyond[going], tree.parents[links[going]]
    before = np.concatenate([step.before for step in steps])
    after = np.concatenate([step.beyond for step in steps])
    apart = np.flatnonzero(before != after)
    rows, columns = np.append(before, after[apart]), np.append(after, before[apart])
    order = np.lexsort((rows, columns))
    own = np.flatnonzero(before == after)
    return _Pattern(
        tuple(steps), own[np.argsort(before[own])], np.append(np.arange(len(before)), apart)[order],
        rows[order], np.searchsorted(columns[order], np.arange(model.nv + 1)),
    )  # fmt: skip


@cached_by_model
def _levels(model: pin.Model) -> tuple[Indices, ...]:
    """Return the links of every depth but the world, from the deepest."""
    tree = LinkTree.of(model)
    depth = np.zeros(len(tree.parents), dtype=np.intp)
    for link, parent in enumerate(tree.parents[1:].tolist(), 1):
        depth[link] = depth[parent] + 1
    order = np.argsort(depth, kind="stable")
    return tuple(np.split(order, np.searchsorted(depth[order], np.arange(1, depth.max() + 1)))[:0:-1])


def mass_times(model: pin.Model, q: Array, x: Array) -> Array:
    """Return ``M x``, of shape (nv,), or of columns, shape (nv, k), by recursion; armatures are in M."""
    light, data = weightless(model), take(model)
    still = np.zeros(model.nv)
    found = [pin.rnea(light, data, q, still, one).copy() for one in x.reshape(model.nv, -1).T]
    give_back(model, data)
    return np.reshape(np.array(found).T, x.shape)


def mass_solved(model: pin.Model, q: Array, force: Array) -> Array:
    """Return ``M^-1 force`` of shape (nv,), by recursion."""
    data, still = take(model), np.zeros(model.nv)
    found = pin.aba(weightless(model), data, q, still, force).copy()
    give_back(model, data)
    return np.asarray(found)


@cached_by_model
def weightless(model: pin.Model) -> pin.Model:
    """Return the model without gravity."""
    found = pin.Model(model)  # its method ``copy`` takes twice the memory
    found.gravity.vector[:] = 0.0
    return found


def mass_diagonals(model: pin.Model, q: Array) -> Array:
    """Return the diagonal of M at configurations, shape (n, nq), as an array of shape (n, nv).

    It is that of the inertia of all that lies beyond each joint.
    """
    _, motions, composite = _carried(model, q)
    forces = np.matvec(composite[:, LinkTree.of(model).moved], motions)
    return np.asarray(model.armature + np.vecdot(motions, forces))
