"""The motion of a tree or of loops, linearised about a state: ``x' = A x + B u``.

Rows G of constraints, of joints that friction holds and of prescribed coordinates hold ``G v = E r'``, r being the
deviations of the prescribed coordinates. The velocities that they allow are ``v = N w + P r'``, w being those of d
independent joints and N having their rows equal to 1, P 0. A neighbouring motion deviates by ``delta`` in position and
``dv`` in velocity, with

    G delta = E r,    G dv + (G v)_q delta = E r'

so that ``delta = N z + P r`` and ``dv = N w + P r' + W [z; r]`` with the deviations z and w of the independent joints,
W having zeros in their rows. The acceleration of a deviation follows from the differentiated equation of motion,

    M da - G^T dlam = S du + H^T df - F_q delta - F_v dv,    G da = E r'' - (G a + G' v)_q delta - (G a + G' v)_v dv

and of the independent joints ``z' = w``, less ``omega x z`` where three of them are a ball joint, and ``w' = da``. The
curvature of the rows and the geometric stiffness of the constraint forces are in F_q and ``(G a + G' v)_q``. Rows of
rolling bind velocities alone: N and P of positions are then those of the other rows, and there are more z than w.
Friction f of joints that slip, with the rows H of the slips, depends on the motion and on the forces of constraints,
``df = f_x x + f_u u + f_f df``: it is eliminated last. States are ``x = [z; r; w; r']``, inputs ``[u; r'']``.

Source: Schiehlen and Eberhard, Applied Dynamics (2014), section 5.4 (linear equations of motion).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex, Indices
from pinarm.engine.linear.derivatives import EquationDerivatives
from pinarm.errors import DynamicsError, InputError
from pinarm.records import Record, replace

DEPENDENT = 1e-9
"""Least pivot of scaled rows, relative to the largest, above which a row is independent."""

TIE = 1e-4
"""Preference of a joint to the next one: among joints that are as good, as in symmetric mechanisms, the choice must not
depend on rounding."""

ROUNDING = 1e-13
"""Size of a row, relative to the largest, up to which it is rounding of 0, as across a plane that has been turned."""

SINGULAR = 1e-6
"""Least pivot at which a position counts as regular: between this one and ``DEPENDENT`` it is refused."""

ALIKE = 1e-6
"""Relative difference of the sizes of eigenvalues that are ordered by their real parts, such as those of one fall."""

RIGID = 10.0
"""Size of an eigenvalue, relative to its error by rounding, up to which it is 0: less than one digit of it holds."""

DEFECTIVE = 1e-6
"""Largest difference from 1 of the cosine of the angle between two mode shapes that count as one shape."""


class Rows(Record, frozen=True):
    """Rows of the derivatives: rows that hold, rows with prescribed values, and slips with friction.

    Attributes:
        holding: Rows that hold, shape (m,).
        prescribed: Rows with prescribed values, places in ``holding``, shape (p,).
        slipping: Rows H of slips with friction, shape (k,).
        rolling: Rows that bind velocities alone, places in ``holding``, shape (r,).
    """

    holding: Indices
    prescribed: Indices
    slipping: Indices
    rolling: Indices


class LinearMotion(Record, frozen=True):
    """Linearised motion: ``x' = a x + b u`` with n states and i inputs.

    Attributes:
        independent: Velocities of the independent joints, by their indices in v, shape (d,).
        placed: The same of independent positions, shape (e,): more than d where something rolls.
        position: Deviations of all joints per state, shape (nv, n).
        velocity: Deviations of all velocities per state, shape (nv, n).
        a: State matrix, shape (n, n).
        b: Input matrix of efforts at all joints and of prescribed accelerations, shape (n, i).
        whole_a: Accelerations of all joints per state and per input, shape (nv, n + i).
        whole_lam: Multipliers of the rows that hold likewise, shape (m, n + i).
        friction: Friction of joints that slip likewise, shape (k, n + i).
        terms: Sizes of the terms that a is the sum of, shape (n, n): its rounding is relative to them.
    """

    independent: Indices
    placed: Indices
    position: Array
    velocity: Array
    a: Array
    b: Array
    whole_a: Array
    whole_lam: Array
    friction: Array
    terms: Array

    @cached_property
    def free(self) -> Indices:
        """The states that are free: those of the independent joints, shape (e + d,)."""
        d, e = len(self.independent), len(self.placed)
        half = e + (len(self.a) - e - d) // 2
        return np.concatenate([np.arange(e), half + np.arange(d)])

    @cached_property
    def modes(self) -> Modes:
        """Eigenvalues and eigenvectors of A, the prescribed coordinates at rest; vectors over the free states."""
        free = np.ix_(self.free, self.free)
        return Modes.of(self.a[free], self.terms[free])

    @property
    def shapes(self) -> tuple[Complex, Complex]:
        """Deviations of all joints in the modes and of their velocities, shape (nv, k) each."""
        vectors = self.modes.vectors
        return np.asarray(self.position[:, self.free] @ vectors), np.asarray(self.velocity[:, self.free] @ vectors)


class Modes(Record, frozen=True):
    """Eigenvalues and eigenvectors of a state matrix, by ascending frequency; of conjugate pairs, the upper one.

    Those that are 0 but for rounding are 0, each for itself: the numbers of the others do not hang on rounding.

    Attributes:
        eigenvalues: lambda [1/s], shape (k,).
        vectors: Right eigenvectors of length 1, shape (2 d, k).
        errors: Errors of the eigenvalues by rounding [1/s], shape (k,): of those that are 0, how large they may be.
    """

    eigenvalues: Complex
    vectors: Complex
    errors: Array

    @classmethod
    def of(cls, a: Array, terms: Array) -> Modes:
        """Return the modes of a state matrix, balanced by its scales first.

        Args:
            a: The matrix, shape (n, n).
            terms: Sizes of the terms that it is the sum of, shape (n, n).
        """
        from scipy.linalg import eig, matrix_balance

        if not len(a):
            return cls(np.zeros(0, complex), np.zeros((0, 0), complex), np.zeros(0))
        balanced, (scales, _) = matrix_balance(a, permute=False, separate=True)
        eigenvalues, left, right = eig(balanced, left=True, right=True)
        conditions = 1.0 / np.maximum(np.abs((left.conj() * right).sum(axis=0)), np.finfo(float).tiny)
        balanced_terms = terms * scales / scales[:, None]
        errors = _errors(eigenvalues, conditions, balanced, balanced_terms, np.abs(left), np.abs(right))
        sizes = np.abs(eigenvalues)
        rigid = sizes <= RIGID * errors
        eigenvalues, errors = np.where(rigid, 0.0, eigenvalues), errors + np.where(rigid, sizes, 0.0)
        kept = np.flatnonzero(eigenvalues.imag >= 0.0)
        kept = kept[np.argsort(np.abs(eigenvalues[kept]))]
        sizes = np.abs(eigenvalues[kept])
        alike = np.cumsum(np.diff(sizes, prepend=0.0) > ALIKE * sizes)
        kept = kept[np.lexsort((eigenvalues.real[kept], alike))]
        vectors = scales[:, None] * right[:, kept]
        vectors /= np.linalg.norm(vectors, axis=0)
        return cls(eigenvalues[kept], vectors, errors[kept])

    @cached_property
    def measures(self) -> dict[str, Array]:
        """Frequency, damping and other numbers of the modes by name, shape (k,); see ``mode_measures``."""
        return mode_measures(self.eigenvalues, self.errors)

    @property
    def frequencies(self) -> Array:
        """Undamped natural frequencies ``|lambda| / (2 pi)`` [Hz], shape (k,)."""
        return self.measures["frequency"]

    @property
    def damping_ratios(self) -> Array:
        """``-Re lambda / |lambda|``, shape (k,); 0 where rounding explains it."""
        return self.measures["damping"]

    @property
    def growths(self) -> Array:
        """``Re lambda`` [1/s], shape (k,); 0 where rounding explains it."""
        return self.measures["growth"]

    @property
    def defective(self) -> list[tuple[int, int]]:
        """Pairs of modes with one shape and one eigenvalue but for their errors, by their numbers from 0."""
        alike = np.abs(self.vectors.conj().T @ self.vectors) > 1.0 - DEFECTIVE
        apart = np.abs(self.eigenvalues[:, None] - self.eigenvalues)
        first, second = np.nonzero(np.triu(alike & (apart <= self.errors[:, None] + self.errors), 1))
        return list(zip(first.tolist(), second.tolist(), strict=True))


def mode_measures(eigenvalues: Complex, errors: Array) -> dict[str, Array]:
    """Return the numbers of modes by name; NaN where an eigenvalue is.

    Args:
        eigenvalues: lambda [1/s], shape (k,).
        errors: Their errors by rounding [1/s], shape (k,).
    """
    sizes, growths = np.abs(eigenvalues), eigenvalues.real
    growths = np.where(np.abs(growths) <= errors, 0.0, growths)
    with np.errstate(divide="ignore"):
        constants = np.where(growths, -1.0 / growths, np.inf)
    return {
        "frequency": sizes / (2.0 * np.pi),
        "damped_frequency": eigenvalues.imag / (2.0 * np.pi),
        "damping": 0.0 - growths / np.where(sizes > 0.0, sizes, 1.0),
        "time_constant": constants,
        "growth": growths,
        "error": errors,
    }


def _errors(eigenvalues: Complex, conditions: Array, a: Array, terms: Array, left: Array, right: Array) -> Array:
    """Return errors of eigenvalues by rounding, to first order ``eps (|A| + |y|^T terms |x|) / |y^H x|``, shape (n,).

    The condition of m eigenvalues that meet has no bound; they move by about ``r eps^(1/m)``, r being the spectral
    radius of the terms, which no change of units changes.
    """
    eps, size = np.finfo(float).eps, float(np.linalg.norm(a, 2))
    apart = np.abs(eigenvalues[:, None] - eigenvalues)
    meeting = np.maximum((apart <= size * eps ** (1.0 / 3.0)).sum(axis=1), 2)
    rounding = size + np.einsum("ik,ij,jk->k", left, terms, right)
    fastest = float(np.abs(np.linalg.eigvals(np.abs(a) + terms)).max())
    return np.asarray(np.minimum(conditions * eps * rounding, fastest * eps ** (1.0 / meeting)))


Slopes = Callable[[LinearMotion], Array]
"""From a motion whose last k inputs are frictions to their slopes by all states and inputs, shape (k, n + i)."""


def linear_motion(
    model: pin.Model, at: EquationDerivatives, v: Array, rows: Rows, scale: Array, slopes: Slopes | None = None
) -> LinearMotion:
    """Return the linearised motion about a state.

    Args:
        v: Velocity there, shape (nv,).
        scale: Size of each joint's coordinate [rad or m], shape (nv,).
        slopes: Of friction, where joints slip.
    """
    pushes, holding = at.rows[rows.slipping], rows.holding
    at = replace(
        at,
        rows=at.rows[holding],
        rows_q=at.rows_q[:, holding],
        acceleration_q=at.acceleration_q[holding],
        acceleration_v=at.acceleration_v[holding],
    )
    _require_sizes(at, scale)
    independent, allowed = independent_joints(at.rows)
    _require_regular(at, allowed)
    placed, spread, held = independent, allowed, np.setdiff1d(np.arange(len(at.rows)), rows.rolling)
    moved = np.hstack([allowed, _prescribed(at.rows, rows.prescribed, independent, allowed)])
    reached = moved
    if len(rows.rolling):
        placed, spread = independent_joints(at.rows[held])
        own = np.searchsorted(held, rows.prescribed)
        reached = np.hstack([spread, _prescribed(at.rows[held], own, placed, spread)])
    carried = -np.linalg.lstsq(at.rows, np.einsum("kmj,j,kd->md", at.rows_q, v, reached), rcond=DEPENDENT)[0]
    carried -= allowed @ carried[independent]
    terms = np.zeros_like(carried)
    if len(rows.rolling):  # else those of independent joints are 0 exactly
        turning = np.einsum("kmj,j,kd->md", np.abs(at.rows_q), np.abs(v), np.abs(reached))
        terms = np.abs(np.linalg.pinv(at.rows, rcond=DEPENDENT)) @ turning
        terms += np.abs(allowed) @ terms[independent]
    ways = _Ways(independent, placed, moved, reached, carried, terms)
    motion = _moved(model, at, v, ways, pushes)
    return motion if slopes is None else _eliminated(motion, slopes(motion), len(pushes))


class _Ways(Record, frozen=True):
    """Deviations of all joints and velocities: ``delta = reached [z; r]``, ``dv = moved [w; r'] + carried [z; r]``."""

    independent: Indices
    placed: Indices
    moved: Array
    reached: Array
    carried: Array
    terms: Array


def _prescribed(rows: Array, prescribed: Indices, independent: Indices, allowed: Array) -> Array:
    """Return P: the motion of all joints per prescribed coordinate, independent joints at rest, shape (nv, p)."""
    wanted = np.zeros((len(rows), len(prescribed)))
    wanted[prescribed, np.arange(len(prescribed))] = 1.0
    moved = np.linalg.lstsq(rows, wanted, rcond=DEPENDENT)[0]
    if np.abs(rows @ moved - wanted).max(initial=0.0) > SINGULAR:
        raise InputError(
            "constraints hold a prescribed coordinate: it cannot move",
            expected="as many such inputs as the mechanism has freedoms, at most",
        )
    return np.asarray(moved - allowed @ moved[independent])


def _moved(model: pin.Model, at: EquationDerivatives, v: Array, ways: _Ways, pushes: Array) -> LinearMotion:
    """Return the motion, frictions being its last inputs."""
    nv, d = model.nv, len(ways.independent)
    allowed, driven = ways.moved[:, :d], ways.moved[:, d:]
    position = np.hstack([ways.reached, np.zeros_like(ways.moved)])
    velocity = np.hstack([ways.carried, ways.moved])
    force = at.force_q @ position + at.force_v @ velocity
    bend = at.acceleration_q @ position + at.acceleration_v @ velocity
    accelerated = np.linalg.lstsq(at.rows, -bend, rcond=DEPENDENT)[0]
    given = np.hstack([accelerated, np.zeros((nv, nv)), driven, np.zeros((nv, len(pushes)))])
    left = np.hstack([force, -np.eye(nv), np.zeros_like(driven), -pushes.T]) + at.mass @ given
    mass = allowed.T @ at.mass @ allowed
    whole = given - allowed @ _solved(mass, allowed.T @ left)
    multipliers = np.linalg.lstsq(at.rows.T, left + at.mass @ (whole - given), rcond=DEPENDENT)[0]
    turning = (velocity - _transport(model, v) @ position)[ways.placed]
    none = np.zeros((len(pushes), whole.shape[1]))
    none[:, whole.shape[1] - len(pushes) :] = np.eye(len(pushes))
    a, b = _state_space(whole, ways.independent, turning)
    sizes = at.terms_q @ np.abs(position) + at.terms_v @ np.abs(velocity) + np.abs(at.mass @ accelerated)
    terms, half = np.zeros_like(a), ways.reached.shape[1]
    terms[: len(ways.placed), :half] = ways.terms[ways.placed]
    terms[half : half + d] = np.abs(_solved(mass, np.eye(d))) @ np.abs(allowed).T @ sizes
    return LinearMotion(ways.independent, ways.placed, position, velocity, a, b, whole, multipliers, none, terms)


def _state_space(whole: Array, independent: Indices, turning: Array) -> tuple[Array, Array]:
    """Return A and B of accelerations per state and input, and of the rates ``turning`` of independent positions."""
    (e, size), d = turning.shape, len(independent)
    prescribed, inputs = (size - e - d) // 2, whole.shape[1] - size
    half = e + prescribed
    a, b = np.zeros((size, size)), np.zeros((size, inputs))
    a[:e] = turning
    a[e:half, half + d :] = np.eye(prescribed)
    a[half : half + d], b[half : half + d] = whole[independent, :size], whole[independent, size:]
    b[half + d :, len(whole) : len(whole) + prescribed] = np.eye(prescribed)
    return a, b


def _eliminated(motion: LinearMotion, slopes: Array, count: int) -> LinearMotion:
    """Return the motion with friction that follows from it, ``f = slopes [x; u; f]``."""
    known = slopes.shape[1] - count
    matrix = np.eye(count) - slopes[:, known:]
    if count and np.linalg.cond(matrix) > 1.0 / DEPENDENT:
        raise DynamicsError(
            "friction of joints that slip raises the load that it depends on without end: it jams",
            expected="a smaller mu",
        )
    friction = np.linalg.solve(matrix, slopes[:, :known])
    whole_a, whole_lam = (x[:, :known] + x[:, known:] @ friction for x in (motion.whole_a, motion.whole_lam))
    a, b = _state_space(whole_a, motion.independent, motion.a[: len(motion.placed)])
    return replace(motion, a=a, b=b, whole_a=whole_a, whole_lam=whole_lam, friction=friction)


def independent_joints(rows: Array) -> tuple[Indices, Array]:
    """Return independent velocities, by ascending indices, and all velocities per unit of these, shape (nv, d)."""
    from scipy.linalg import qr

    nv = rows.shape[1]
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    acting = sizes > ROUNDING * sizes.max(initial=0.0)
    scaled = np.where(acting, rows / np.where(acting, sizes, 1.0), 0.0)
    upper, order = qr(scaled * (1.0 - TIE * np.arange(nv)), mode="r", pivoting=True)
    pivots = np.abs(np.diag(upper))
    rank = int((pivots > DEPENDENT * pivots[:1]).sum()) if len(pivots) else 0
    if rank and pivots[rank - 1] < SINGULAR * pivots[0]:
        raise _singular()
    dependent, free = order[:rank], order[rank:]
    allowed = np.zeros((nv, nv - rank))
    allowed[free] = np.eye(nv - rank)
    allowed[dependent] = -np.linalg.lstsq(scaled[:, dependent], scaled[:, free], rcond=None)[0]
    ascending = np.argsort(free)
    return free[ascending], allowed[:, ascending]


def _require_sizes(at: EquationDerivatives, scale: Array) -> None:
    """Raise where a row is small in this position only: loops that close to rounding leave it undetermined."""
    sizes = np.linalg.norm(at.rows * scale, axis=1)
    changes = np.linalg.norm(at.rows_q * np.multiply.outer(scale, scale)[:, None], axis=2).max(axis=0, initial=0.0)
    if ((sizes > ROUNDING * sizes.max(initial=0.0)) & (sizes < SINGULAR * changes)).any():
        raise _singular()


def _require_regular(at: EquationDerivatives, allowed: Array) -> None:
    """Raise where rows are dependent in this position only.

    With ``mu^T G = 0`` in all positions nearby, ``mu^T G_q[n] n = 0`` for all allowed velocities n, as ``G n = 0`` is
    differentiated along the motion. Rows of one position, such as those of bars in one line, do not have that.
    """
    rank = at.rows.shape[1] - allowed.shape[1]
    if rank == len(at.rows):
        return
    left, values, _ = np.linalg.svd(at.rows)
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
    """Return ``mass^-1 force``."""
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
