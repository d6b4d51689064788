"""Many loops as pairs of coinciding points, by sparse matrices: ``pinocchio_constraints`` is dense in the rows.

Accelerations and multipliers solve

    [M  G^T] [  a ]   [tau + loads - nle]
    [G  -mu] [-lam] = [  -G' v + mu lam']

again and again with the lam' before, the proximal iteration of Carpentier, Budhiraja and Mansard (2021); changes that
close positions and velocities solve it with mu alone. M and the motion of the points are Pinocchio's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.sparse import block_array, csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RANK
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.pinocchio_constraints import (
    BESIDE,
    ITERATIONS,
    MET,
    NOISE,
    PROJECTION,
    PROXIMAL,
    REPEATS,
    TOLERANT,
    UNEVEN,
    places_of,
    tied_points,
)
from pinarm.mechanics.geometry.buffers import give_back, take
from pinarm.mechanics.geometry.link_tree import LinkTree, states_first
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.dynamics.coordinate_partition import Targets
    from pinarm.engine.integration.integrator import Acceleration


class PointPair(NamedTuple):
    """Points of two links that coincide; names as of ``pin.RigidConstraintModel``."""

    joint1_id: int
    joint1_placement: pin.SE3
    joint2_id: int
    joint2_placement: pin.SE3


class PointTable(NamedTuple):
    """Which velocities move which points, and where these are on their links.

    Attributes:
        joints: Joints of the first and of the second points, shape (2, k).
        places: Where they are on their links, shape (2, k, 3).
        turns: Rotations of the first frames on their links, shape (k, 3, 3).
        points: Pair of every entry, shape (e,).
        columns: Velocity of every entry, shape (e,).
        sides: 0 where it moves the first point, 1 the second, shape (e,).
    """

    joints: Indices
    places: Array
    turns: Array
    points: Indices
    columns: Indices
    sides: Indices

    @classmethod
    def of(cls, model: pin.Model, pairs: Sequence[PointPair]) -> PointTable:
        """Return the table of pairs; velocities that move both links alike are in none."""
        supports = [one.tolist() for one in model.supports]
        starts, counts = model.idx_vs.tolist(), model.nvs.tolist()
        entries: list[tuple[int, int, int]] = []
        for k, pair in enumerate(pairs):
            one, two = supports[pair.joint1_id], supports[pair.joint2_id]
            common = next(
                (i for i, (a, b) in enumerate(zip(one, two, strict=False)) if a != b), min(len(one), len(two))
            )
            entries += [
                (k, starts[joint] + i, side)
                for side, path in enumerate((one, two)) for joint in path[common:] for i in range(counts[joint])
            ]  # fmt: skip
        points, columns, sides = np.array(entries, dtype=np.intp).reshape(-1, 3).T
        joints = np.array([[pair.joint1_id for pair in pairs], [pair.joint2_id for pair in pairs]], dtype=np.intp)
        places = [[pair.joint1_placement.translation for pair in pairs],
                  [pair.joint2_placement.translation for pair in pairs]]  # fmt: skip
        turns = np.array([pair.joint1_placement.rotation for pair in pairs])
        return cls(joints, np.array(places), turns, points, columns, sides)

    def moved(self, model: pin.Model, q: Array, v: Array) -> MovedPoints:
        """Return the points in a state."""
        data, still = take(model), np.zeros(model.nv)
        pin.forwardKinematics(model, data, q, v, still)
        links = np.array([place.homogeneous for place in data.oMi])
        twists = np.array([twist.vector for twist in data.v]).reshape(-1, 2, 3)
        accelerations = np.array([one.vector for one in data.a]).reshape(-1, 2, 3)
        columns = np.array(pin.computeJointJacobians(model, data, q)).reshape(6, -1)
        give_back(model, data)
        turned = links[self.joints, :3, :3]
        arms = np.matvec(turned, self.places)
        axes = (turned[0] @ self.turns).swapaxes(1, 2)
        places = links[self.joints, :3, 3] + arms
        v, omega = (np.matvec(turned, twists[self.joints, i]) for i in (0, 1))
        a, alpha = (np.matvec(turned, accelerations[self.joints, i]) for i in (0, 1))
        bent = a + np.cross(alpha, arms) + np.cross(omega, v + np.cross(omega, arms))
        chosen = columns[:, self.columns].T
        sign = np.where(self.sides, -1.0, 1.0)[:, None]
        speeds = sign * (chosen[:, :3] + np.cross(chosen[:, 3:], places[self.sides, self.points]))
        return MovedPoints(
            np.matvec(axes, places[1] - places[0]).ravel(), np.matvec(axes[self.points], speeds),
            np.matvec(axes, bent[0] - bent[1]).ravel(),
        )  # fmt: skip

    def matrix(self, entries: Array, nv: int) -> csr_array:
        """Return G, shape (3 k, nv), with the entries of ``MovedPoints``."""
        rows = (3 * self.points[:, None] + np.arange(3)).ravel()
        size = 3 * self.joints.shape[1], nv
        return csr_array((entries.ravel(), (rows, np.repeat(self.columns, 3))), shape=size)


class MovedPoints(NamedTuple):
    """Pairs of points in a state, in the axes of the first one's frame.

    Attributes:
        gap: The second one as seen from the first [m], shape (3 k,).
        entries: What velocities add to the velocity of the first relative to the second, shape (e, 3).
        drift: Their relative acceleration without those of the joints [m/s^2], shape (3 k,).
    """

    gap: Array
    entries: Array
    drift: Array


@dataclass(frozen=True, eq=False)
class ManyCoincidentPoints:
    """Pairs of coinciding points that say the same as the loops of one mechanism.

    Attributes:
        model: Pinocchio's model.
        needed: The pairs, without those that repeat others.
        table: What moves them.
        acting: Which rows are not 0 at all configurations, shape (3 k,).
        rank: Their number: they are independent.
        regularity: Smallest singular value of the rows at a configuration of no special kind, relative to the largest.
    """

    model: pin.Model
    needed: Sequence[PointPair]
    table: PointTable
    acting: Flags
    rank: int
    regularity: float
    driven: Sequence[int] = ()

    @staticmethod
    @lru_cache(maxsize=16)  # the same for all runs of a mechanism
    def of(closure: Closure) -> ManyCoincidentPoints | None:
        """Return the points of a closure; ``None`` where a constraint is not one of points, or where rows depend."""
        model, tied = closure.model, [tied_points(closure.model, constraint) for constraint in closure.constraints]
        if not tied or any(points is None for points in tied):
            return None
        pairs = [PointPair(*pair) for points in tied for pair in points or ()]
        pairs = _different(model, pairs)
        table = PointTable.of(model, pairs)
        found = [table.matrix(table.moved(model, q, np.zeros(model.nv)).entries, model.nv) for q in places_of(model)]
        size = np.max([abs(rows).max(axis=1).toarray().ravel() for rows in found], axis=0)
        acting = size > NOISE * size.max()
        values = [np.linalg.svd(rows[np.flatnonzero(acting)].toarray(), compute_uv=False) for rows in found]
        if any(len(value) < acting.sum() or not value[-1] > RANK * value[0] for value in values):
            return None
        return ManyCoincidentPoints(
            model, pairs, table, acting, int(acting.sum()), max(float(value[-1] / value[0]) for value in values)
        )


def _different(model: pin.Model, pairs: Sequence[PointPair]) -> list[PointPair]:
    """Leave out pairs whose rows are those of another pair at two configurations of no special kind."""
    table, numbers = PointTable.of(model, pairs), []
    for q in places_of(model):
        entries = table.moved(model, q, np.zeros(model.nv)).entries
        numbers.append(np.round(entries / (NOISE * np.abs(entries).max())))
    known, found = set(), []
    for k, pair in enumerate(pairs):
        own = table.points == k
        rows = (*table.columns[own].tolist(), *np.concatenate([one[own].ravel() for one in numbers]).tolist())
        if rows not in known:
            known.add(rows)
            found.append(pair)
    return found


COLUMNS = 256
"""Rows of G that are multiplied with the inverse of M at once."""


@dataclass(eq=False)
class ManyPointConstraints:
    """Loops of one mechanism as pairs of coinciding points, ready for evaluation.

    Attributes:
        tied: The points.
        scale: Smallest Delassus diagonal that is not 0 [1/kg].
    """

    tied: ManyCoincidentPoints
    scale: float
    _moved: MovedPoints | None = field(default=None, repr=False)
    _factors: Any = field(default=None, repr=False)
    _right: Array | None = field(default=None, repr=False)

    @classmethod
    def of(cls, closure: Closure, q: Array) -> ManyPointConstraints | None:
        """Return the loops as points near a configuration; ``None`` as in ``PointConstraints.of``."""
        tied = ManyCoincidentPoints.of(closure)
        if tied is None:
            return None
        found = cls(tied, 1.0)
        for place in places_of(closure.model):
            diagonal = found._diagonal(place)
            if diagonal is None or not found._unevenness(place, diagonal) <= UNEVEN:  # NaN included
                return None
        if (diagonal := found._diagonal(q)) is None:
            return None
        found.scale = float(diagonal[diagonal > NOISE * diagonal.max()].min())
        return found

    def _diagonal(self, q: Array) -> Array | None:
        """Return the diagonal of ``G M^-1 G^T``, acting rows only, shape (m,); ``None`` where M is singular."""
        self._place(q, np.zeros(self.tied.model.nv))
        rows, mass = self._acting_rows(), sparse_mass_matrix(self.tied.model, q)
        if not (mass.diagonal() > 0.0).all():
            return None
        solve, found = splu(mass).solve, []
        for start in range(0, rows.shape[0], COLUMNS):
            some = rows[start : start + COLUMNS].toarray()
            found.append(np.vecdot(some, solve(some.T).T))
        diagonal = np.concatenate(found)
        return diagonal if (diagonal >= 0.0).all() and np.isfinite(diagonal).all() else None

    def _unevenness(self, q: Array, diagonal: Array) -> float:
        """Return the condition number of ``G M^-1 G^T``, scaled to a diagonal of ones, acting rows only.

        Args:
            q: The configuration at which the rows are in place, shape (nq,).
            diagonal: See ``_diagonal``.
        """
        rows, mass = self._acting_rows(), sparse_mass_matrix(self.tied.model, q)
        scaled = diags_array(1.0 / np.sqrt(diagonal)) @ rows
        solve, m, nv = splu(mass).solve, rows.shape[0], self.tied.model.nv
        whole = splu(csc_array(block_array([[mass, scaled.T], [scaled, None]])))
        largest = largest_eigenpair(m, lambda x: scaled @ solve(scaled.T @ x))[0]
        inverse = largest_eigenpair(m, lambda x: -whole.solve(np.concatenate([np.zeros(nv), x]))[nv:])[0]
        return largest * inverse

    def _acting_rows(self) -> csr_array:
        return self.rows()[np.flatnonzero(self.tied.acting)]

    def _place(self, q: Array, v: Array) -> None:
        self._moved = self.tied.table.moved(self.tied.model, q, v)

    def _factorised(self, q: Array, term: float) -> Any:
        """Return M and the rows at a configuration, which are in place, taken apart; the term is relative."""
        rows, mass = self.rows(), sparse_mass_matrix(self.tied.model, q)
        return splu(csc_array(block_array([[mass, rows.T], [rows, -term * self.scale * eye_array(rows.shape[0])]])))

    @property
    def exact(self) -> pin.ProximalSettings:
        """How accelerations are solved for."""
        return pin.ProximalSettings(MET, PROXIMAL * self.scale, ITERATIONS)

    @property
    def beside(self) -> pin.ProximalSettings:
        """The same next to singular positions."""
        return pin.ProximalSettings(MET, PROXIMAL * self.scale, BESIDE)

    def tolerant(self, q: Array, rank: int) -> pin.ProximalSettings:
        """Return the same for states whose redundant points are not quite closed, as they are within steps.

        Args:
            q: A closed configuration that is not close to a singular one, shape (nq,).
            rank: Rank of the rows there.
        """
        return pin.ProximalSettings(MET, TOLERANT * self.scale, REPEATS)

    def acceleration(self, dynamics: Dynamics, targets: Targets, settings: pin.ProximalSettings) -> Acceleration:
        """Return the constrained motion's ``(t, q, v) -> a`` under the forces of ``dynamics``."""
        model, load, nv = self.tied.model, dynamics.load(), self.tied.model.nv

        def constrained(t: float, q: Array, v: Array) -> Array:
            self._place(q, v)
            assert self._moved is not None
            factors, right = self._factorised(q, settings.mu / self.scale), -self._moved.drift
            force = load(t, q, v) - pin.nonLinearEffects(model, dynamics.data, q, v)
            x, lam = np.zeros(nv), np.zeros(len(right))
            for _ in range(settings.max_iter):
                x = factors.solve(np.concatenate([force, right + settings.mu * lam]))
                lam, before = -x[nv:], lam
                if settings.mu * np.abs(lam - before).max(initial=0.0) <= settings.absolute_accuracy:
                    break
            self._right = right
            return np.asarray(x[:nv])

        return constrained

    def factorise(self, q: Array) -> None:
        """Decompose mass matrix and rows at a configuration."""
        self._place(q, np.zeros(self.tied.model.nv))
        self._factors = self._factorised(q, PROJECTION)

    def gap(self) -> Array:
        """Return how far the points are apart at the configuration last factorised [m], shape (3 k,)."""
        assert self._moved is not None
        return self._moved.gap

    def rows(self) -> csr_array:
        """Return the rows at the configuration last factorised; their product with v is minus the gap's rate."""
        assert self._moved is not None
        return self.tied.table.matrix(self._moved.entries, self.tied.model.nv)

    def right(self) -> Array:
        """Return what the rows ask of the acceleration last computed, ``-G' v``, shape (3 k,)."""
        assert self._right is not None
        return self._right

    def squares(self) -> Array:
        """Return the squares of the singular values of the rows, ascending: the largest and the last that is not 0."""
        values, acting = np.zeros(self.tied.model.nv), self._acting_rows().toarray()
        values[: len(acting)] = np.linalg.svd(acting, compute_uv=False)
        return np.asarray(values[::-1] ** 2)

    def step(self, right: Array) -> Array:
        """Return the least change x, measured by the masses, with ``rows x = right``, shape (nv,)."""
        nv = self.tied.model.nv
        return np.asarray(self._factors.solve(np.concatenate([np.zeros(nv), right]))[:nv])


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
