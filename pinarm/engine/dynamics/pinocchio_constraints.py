"""Pinocchio's own route for loops that are closed by points: proximal constraint dynamics, 2 to 5 us an evaluation.

A loop joint whose frames are tied by points that coincide (a ball joint one, a revolute two on its axis, a rigid
connection three) has the same acceleration as its rows. Points that add nothing to the rank at any configuration, such
as the second one of a revolute in a planar loop, are left out; the joint's own gap tells whether it is closed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RANK, VANISHED
from pinarm.engine.dynamics.coordinate_partition import Targets
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import LowerPair
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint import Constraint
    from pinarm.engine.integration.integrator import Acceleration

TiedPoint = tuple[int, pin.SE3, int, pin.SE3]
"""Joint of a link and a frame there, whose origin coincides with that of another: joint, and frame on its link."""

PROXIMAL, ITERATIONS = 1e-10, 3
"""Proximal term of accelerations, relative to the smallest Delassus diagonal, and iterations."""

BESIDE = 20
"""Iterations next to singular positions, where the least eigenvalue of the Delassus matrix comes down to the proximal
term: each leaves that term, over the sum of both, of what is missing. With 3 of them free four-bars whose masses are
1e3 apart lost up to 1e-3 of their speed beside change points, at every tolerance."""

MET = 1e-12
"""What the iteration may leave of the rows, where it ends [m/s^2]."""

TOLERANT, REPEATS = 1e-3, 8
"""The same where redundant points are not quite closed, relative to the least eigenvalue of the Delassus matrix that
is not 0: what contradicts itself by the gap is not magnified, and the iterations find what the rest determines."""

LEVEL = 1e-12
"""Distance along the axis of a pin, relative to how far the frames are apart, at which a mechanism lies in a plane."""

NOISE = 1e-11
"""Singular value of redundant rows, relative to the largest, that rounding of the file may leave: the proximal term
lets through 3 ``NOISE**2 / PROXIMAL`` of the acceleration. Loops that are rounded more go by their rows."""

PROJECTION = 1e-10
"""Proximal term of projections: little beside the least eigenvalue where loops are still closed, 1e-6 of the largest;
Newton's iteration removes what it leaves of gaps."""


SPREAD: Array = np.array([
    0.2739233746429086, -0.4604265724722594, -0.9180529521276106, -0.9669447289429418,
    0.6265404784005448, 0.8255111545554434, 0.21327155153435973, 0.4589931219679968,
    0.08724998293084574, 0.8701448475755365, 0.6317071082430643, -0.9945229996597038,
    0.7148085531751387, -0.9328288493890713, 0.45931089285988813, -0.648688758794882,
])  # fmt: skip
"""The first numbers of ``numpy.random.default_rng(0).uniform(-1, 1)``, which takes 6 ms to import."""


class CoincidentPoints(Record, frozen=True):
    """Pairs of coinciding points that say the same as the loops of one mechanism.

    Attributes:
        model: Pinocchio's model, with an armature at the joints whose acceleration is prescribed.
        needed: Pinocchio's constraints.
        driven: Indices in v of these joints.
        inertia: The armature that holds each of them to it, shape (k,).
        rank: Rank of the rows at a configuration of no special kind.
        regularity: Smallest singular value of the rows there, relative to the largest.
    """

    unshown = ("model", "needed")

    model: pin.Model
    needed: pin.StdVec_RigidConstraintModel
    driven: Indices
    inertia: Array
    rank: int
    regularity: float

    @staticmethod
    @lru_cache(maxsize=16)  # the same for all runs of a mechanism
    def of(closure: Closure, driven: tuple[int, ...]) -> CoincidentPoints | None:
        """Return the points of a closure; see ``PointConstraints.of``."""
        model, data, held = pin.Model(closure.model), closure.model.createData(), np.array(driven, dtype=np.intp)
        inertia = np.full(len(held), HEAVY * np.diag(mass_matrix(model, pin.neutral(model))).max())
        model.armature[held] += inertia
        tied = [_points_of(model, constraint) for constraint in closure.constraints]
        if not tied or any(points is None for points in tied):
            return None
        needed, rank, regularity = _independent(
            model, data, [point for points in tied for point in points or ()], VANISHED * max(1.0, closure.extent)
        )
        if not needed or _unevenness(model, data, needed, rank) > UNEVEN:
            return None
        points = pin.StdVec_RigidConstraintModel()
        points.extend(needed)
        return CoincidentPoints(model, points, held, inertia, rank, regularity)

    @cached_property
    def acting(self) -> Flags:
        """Which rows are not 0 at all configurations, such as those across the plane of a linkage, shape (m,)."""
        data, rows = self.model.createData(), 0.0
        for q in places_of(self.model):
            rows = np.maximum(rows, np.abs(_rows(self.model, data, list(self.needed), q)).max(axis=1))
        return np.asarray(rows > NOISE * np.max(rows))


class PointConstraints(Record, frozen=True):
    """Loops of one mechanism as pairs of coinciding points, ready for evaluation.

    Attributes:
        tied: The points.
        data: Pinocchio's buffers.
        states: Those of the constraints.
        cholesky: Decomposition of the mass matrix and the rows together.
        scale: Smallest Delassus diagonal that is not 0 [1/kg].
    """

    unshown = ("data", "states", "cholesky")

    tied: CoincidentPoints
    data: pin.Data
    states: pin.StdVec_RigidConstraintData
    cholesky: pin.ConstraintCholeskyDecomposition
    scale: float

    @classmethod
    def of(cls, closure: Closure, q: Array, driven: Sequence[int] = ()) -> PointConstraints | None:
        """Return the loops as points near a configuration; ``None`` where a constraint is not one of points.

        Also where the mass matrix of the tree is singular, or where the loops feel some bodies so much less than
        others (``UNEVEN``) that this route is not exact. The joints at the indices ``driven`` in v get an armature of
        1e12 times the inertia of the tree, so that a load of armature times acceleration prescribes their acceleration
        to 1e-12 of it.
        """
        tied = CoincidentPoints.of(closure, tuple(driven))
        if tied is None:
            return None
        model, data, states = tied.model, tied.model.createData(), pin.StdVec_RigidConstraintData()
        for point in tied.needed:
            states.append(point.createData())
        pin.initConstraintDynamics(model, data, tied.needed, states)
        inverse = inverse_mass(model, q)
        if inverse is None:
            return None
        rows = _rows(model, data, list(tied.needed), q)
        rows[:, tied.driven] = 0.0
        diagonal = np.einsum("ij,jk,ik->i", rows, inverse, rows)
        scale = float(diagonal[diagonal > RANK**2 * diagonal.max()].min())
        return cls(tied, data, states, pin.ConstraintCholeskyDecomposition(model, data, tied.needed, states), scale)

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
        return pin.ProximalSettings(MET, TOLERANT * self._least(q.tobytes(), rank), REPEATS)

    @cached_property
    def _least(self) -> Callable[[bytes, int], float]:
        """Least eigenvalue of ``G M^-1 G^T``, of so many, at configurations: that of a start serves all its runs."""
        model, data = self.tied.model, self.data

        def least(content: bytes, rank: int) -> float:
            q = np.frombuffer(content)
            rows, mass = _rows(model, data, list(self.tied.needed), q), mass_matrix(model, q)
            return float(np.linalg.eigvalsh(rows @ np.linalg.solve(mass, rows.T))[-rank])

        return lru_cache(maxsize=4)(least)

    def acceleration(self, dynamics: Dynamics, targets: Targets, settings: pin.ProximalSettings) -> Acceleration:
        """Return the constrained motion's ``(t, q, v) -> a`` under the forces of ``dynamics`` and the given laws."""
        model, data, points, states = self.tied.model, self.data, self.tied.needed, self.states
        solve, load, driven, inertia = pin.constraintDynamics, dynamics.load(), self.tied.driven, self.tied.inertia

        def constrained(t: float, q: Array, v: Array) -> Array:
            tau = load(t, q, v)
            if len(driven):
                tau = tau.copy()
                tau[driven] += inertia * targets(t)[2]
            return solve(model, data, q, v, tau, points, states, settings)  # type: ignore[no-any-return]

        return constrained

    @cached_property
    def pairs(self) -> list[tuple[pin.RigidConstraintModel, pin.RigidConstraintData]]:
        """Return references to the points and their buffers: walking Pinocchio's vectors costs more than they do."""
        return [(self.tied.needed[k], self.states[k]) for k in range(len(self.states))]

    def factorise(self, q: Array) -> None:
        """Decompose mass matrix and rows at a configuration."""
        pin.crba(self.tied.model, self.data, q, pin.Convention.WORLD)
        for point, state in self.pairs:
            point.calc(self.tied.model, self.data, state)
        self.cholesky.compute(self.tied.model, self.data, self.tied.needed, self.states, PROJECTION * self.scale)

    def gap(self) -> Array:
        """Return how far the points are apart at the configuration last factorised [m], shape (m,)."""
        return np.concatenate([state.c1Mc2.translation for _, state in self.pairs])

    def rows(self) -> Array:
        """Return the rows at the configuration last factorised; their product with v is minus the gap's rate."""
        model = self.tied.model
        rows = pin.getConstraintsJacobian(model, self.data, self.tied.needed, self.states)
        return np.asarray(rows).reshape(-1, model.nv)

    def right(self) -> Array:
        """Return what the rows ask of the acceleration last computed, ``-G' v``, shape (m,)."""
        return np.asarray(self.data.primal_rhs_contact).ravel()

    def squares(self) -> Array:
        """Return the squares of the singular values of the rows, ascending, shape (m,)."""
        rows = self.rows()
        return np.asarray(np.linalg.eigvalsh(rows @ rows.T))  # quicker than singular values, and exact enough

    def step(self, right: Array) -> Array:
        """Return the least change x, measured by the masses, with ``rows x = right``, shape (nv,)."""
        m, both = len(right), self._right
        both[:m] = right
        return np.asarray(self.cholesky.solve(both)[m:])

    @cached_property
    def _right(self) -> Array:
        return np.zeros(3 * len(self.states) + self.tied.model.nv)


def joint_at(model: pin.Model, index: int) -> pin.JointModel:
    """Return the joint whose velocity stands at an index in v."""
    return next(joint for joint in model.joints if joint.idx_v == index)


def tied_points(model: pin.Model, constraint: Constraint) -> list[TiedPoint] | None:
    """Return the pairs of points that tie the links of a loop joint; ``None`` where it is not one of points."""
    if not isinstance(constraint, LoopJoint) or constraint.pair.points is None or not _meet(model, constraint):
        return None
    one, two = model.frames[constraint.first], model.frames[constraint.second]
    shifts = [pin.SE3(np.eye(3), np.asarray(point, float)) for point in constraint.pair.points]
    return [(one.parentJoint, one.placement * shift, two.parentJoint, two.placement * shift) for shift in shifts]


def _meet(model: pin.Model, joint: LoopJoint) -> bool:
    """Return whether the origins of a loop joint's frames coincide where its rows are closed.

    A ``pin`` holds them in its plane only: along its axis they have to be together already, whatever the tree does.
    """
    if not isinstance(joint.pair, LowerPair):
        return True
    along, held = joint.pair.axis, joint.pair.e
    if np.linalg.norm(along - along @ held.T @ held) < LEVEL:
        return True
    data = model.createData()
    for q in places_of(model):
        pin.framesForwardKinematics(model, data, q)
        apart = data.oMf[joint.first].actInv(data.oMf[joint.second]).translation
        if abs(float(along @ apart)) > LEVEL * float(np.abs(apart).max()):
            return False
    return True


def _points_of(model: pin.Model, constraint: Constraint) -> list[pin.RigidConstraintModel] | None:
    tied = tied_points(model, constraint)
    if tied is None:
        return None
    return [pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.LOCAL) for ends in tied]


def _rows(model: pin.Model, data: pin.Data, points: Sequence[pin.RigidConstraintModel], q: Array) -> Array:
    pin.computeJointJacobians(model, data, q)
    rows = []
    for point in points:
        state = point.createData()
        point.calc(model, data, state)
        rows.append(np.asarray(pin.getConstraintJacobian(model, data, point, state)).reshape(-1, model.nv))
    return np.vstack(rows)


def _independent(
    model: pin.Model, data: pin.Data, points: Sequence[pin.RigidConstraintModel], least: float
) -> tuple[list[pin.RigidConstraintModel], int, float]:
    """Leave out points that add nothing to the rank, at two configurations of no special kind.

    Returns:
        What is left, the rank, and the better regularity of the two; nothing where the rows of those left contradict
        each other by more than ``NOISE``.
    """
    places = places_of(model)
    rows = [_rows(model, data, points, q).reshape(len(points), 3, -1) for q in places]
    bases = [np.zeros((0, model.nv)) for _ in places]
    kept: list[pin.RigidConstraintModel] = []
    for k, point in enumerate(points):
        grown = [_grown(basis, part[k], least) for basis, part in zip(bases, rows, strict=True)]
        if any(len(new) > len(old) for new, old in zip(grown, bases, strict=True)):
            kept.append(point)
            bases = grown
    if not kept:
        return [], 0, 0.0
    values, rank = [np.linalg.svd(_rows(model, data, kept, q), compute_uv=False) for q in places], len(bases[0])
    if any((value[rank:] > NOISE * value[0]).any() for value in values):
        return [], 0, 0.0
    return kept, rank, max(float(value[rank - 1] / value[0]) for value in values)


def places_of(model: pin.Model) -> list[Array]:
    """Return two configurations of no special kind."""
    n = 2 * model.nv
    spread = SPREAD[:n] if n <= len(SPREAD) else np.random.default_rng(0).uniform(-1.0, 1.0, n)
    return [pin.integrate(model, pin.neutral(model), part) for part in np.split(spread, 2)]


def _unevenness(model: pin.Model, data: pin.Data, points: Sequence[pin.RigidConstraintModel], rank: int) -> float:
    """Return the condition number of ``G M^-1 G^T``, scaled to a diagonal of ones and cut at the rank of G.

    The larger one of two configurations of no special kind, so that it tells of masses and not of singular positions.
    """
    found = 1.0
    for q in places_of(model):
        rows, inverse = _rows(model, data, points, q), inverse_mass(model, q)
        if inverse is None:
            continue
        delassus = rows @ inverse @ rows.T
        size = np.sqrt(np.diag(delassus))
        scale = 1.0 / np.where(size > RANK * size.max(), size, np.inf)
        values = np.linalg.eigvalsh(scale[:, None] * delassus * scale)[-rank:]
        found = max(found, float(values[-1] / max(values[0], TINY)))
    return found


def _grown(basis: Array, rows: Array, least: float) -> Array:
    """Return orthonormal rows, shape (r, nv), that span those of a basis and further ones that are not 0."""
    left = rows - rows @ basis.T @ basis
    left -= left @ basis.T @ basis  # once more: what is left may be small
    _, s, vt = np.linalg.svd(left, full_matrices=False)
    return np.vstack([basis, vt[s > max(RANK * float(np.linalg.norm(rows)), least)]])


def inverse_mass(model: pin.Model, q: Array) -> Array | None:
    """Return the inverse of M, shape (nv, nv); ``None`` where M is singular."""
    mass = mass_matrix(model, q)
    size = np.sqrt(np.diag(mass))
    if (size == 0.0).any() or np.linalg.eigvalsh(mass / np.outer(size, size))[0] < TRUSTED:
        return None
    return np.asarray(np.linalg.inv(mass))


HEAVY = 1e12
"""Armature that prescribes an acceleration, relative to the largest inertia of the tree."""

TRUSTED = 1e-10
"""Smallest eigenvalue of M, scaled to a diagonal of ones, for which the tree's own inverse is trusted."""

UNEVEN = 1e6
"""Condition number of the Delassus matrix, but for singular positions, from which on this route is not trusted: it
magnifies rounding. Bodies of one linkage reach 1e4; one that is 1e8 times lighter than its neighbours, 1e9."""

TINY = 1e-300
"""Keeps a quotient finite."""
