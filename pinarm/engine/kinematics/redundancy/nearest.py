"""The configuration nearest to a posture on a prescribed path, with its velocity and acceleration.

Of a mechanism with more freedoms than prescribed coordinates w, at every instant t,

    q(t) = argmin |W (q - q0)|^2 / 2    subject to    phi(q) = 0,  w(q) = w_d(t),

with J the rows of phi and w, and multipliers lam. The solution, its velocity and its acceleration obey

    W^2 (q - q0) = J^T lam,    H v = J^T lam',    H a = J^T lam'' + 2 J'^T lam' + J''^T lam,
    J v = (0, w_d'),    J a = (0, w_d'') - J' v,    H = W^2 - sum_k lam_k Hess(w_k),

J' and J'' being derivatives of J along v. With Z a basis of the null space of J, lam is eliminated: ``Z^T`` times the
equations of the first line. The solution is a strict minimum, and smooth, where J has its full rank and ``Z^T H Z`` is
positive definite (Nocedal and Wright, Numerical Optimization, theorem 12.6; Fiacco, Introduction to Sensitivity and
Stability Analysis in Nonlinear Programming, theorem 3.2.2). It depends on the path's present point only, so that a
closed path closes in the joints as well.

J is exact. Its derivatives along Z and v are central differences of order 8 of J over ``STEP``: with J made of sines of
the joints they are off by 1e-13 relative to J. The path and its rates do not depend on them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.kinematics.abscissa import instant
from pinarm.engine.kinematics.newton import (
    CONTRACTION,
    CUTS_A_ROW,
    REACH,
    SINGULAR,
    SMALLEST,
    NewtonSolver,
    dependent,
    tied,
)
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.redundancy.posture import Posture
from pinarm.errors import AssemblyError
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.kinematics import Kinematics

STEP = 0.02
"""Distance of the configurations between which J is differentiated [rad, or units of length of the mechanism]."""

FIRST = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280]), np.array([3 / 4, -3 / 20, 1 / 60, 0.0])
SECOND = np.array([8 / 5, -1 / 5, 8 / 315, -1 / 560]), np.array([3 / 2, -3 / 20, 1 / 90, 0.0])
"""Weights of the central differences of order 8, and of order 6 beside them, at 1 to 4 steps to either side; of second
differences the weight in the middle is minus twice their sum. (Fornberg, Math. Comp. 51 (1988), table 1.)"""

DIFFERED = 1e-6
"""Largest disagreement of the two orders, relative to J. That of order 8 is smaller by another factor of 1e-3."""

SETTLED = 1e-12
"""Correction of a configuration that is the last; rounding of multipliers leaves 1e-14."""

CURVED = 1e-5
"""Least eigenvalue of ``Z^T H Z``, which is 1 where the path does not bend, at which the nearest configuration still
counts as determined: it moves as its reciprocal."""

FELL = 0.3
"""Least part of the least eigenvalue that may be left after a step: it is not to lead past a configuration from which
the nearest one leaps to another."""

WEAK, FLAT = 1e-3, 0.1
"""Ratio of singular values of J, and least eigenvalue of ``Z^T H Z``, below which they are why a branch ends."""

ITERATIONS, MOST = 60, 0.5
"""Most steps to the nearest configuration from a rough one, and their largest length [rad, or units of length]."""

Target = Callable[[float], tuple[Array, Array, Array]]
"""t -> w_d, w_d' and w_d'', each of shape (k,)."""


class NearestState(Record, frozen=True):
    """The nearest configuration at one instant.

    Attributes:
        t: The instant.
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        a: Acceleration, shape (nv,).
        lam: Multipliers of all rows, in the units of the solver, shape (m,).
        lam_rate: Their rates, shape (m,).
        bent: ``H Z Z^T``, shape (nv, nv), and the least eigenvalue of ``Z^T H Z``.
    """

    t: float
    q: Array
    v: Array
    a: Array
    lam: Array
    lam_rate: Array
    bent: tuple[Array, float]


class _Point(Record, frozen=True):
    """What holds at a configuration: its rows J taken apart, ``J = U S V^T``, and the pull of the posture.

    Attributes:
        q: Configuration, shape (nq,).
        state: The same, evaluated.
        rows: J, shape (m, nv).
        inverse: Its pseudo-inverse, shape (nv, m).
        free: Z, shape (nv, f).
        pull: W (q - q0), shape (nv,).
    """

    q: Array
    state: Kinematics
    rows: Array
    inverse: Array
    free: Array
    pull: Array

    @property
    def lam(self) -> Array:
        """Multipliers with the least ``|W (q - q0) - J^T lam|``, shape (m,)."""
        return np.asarray(self.pull @ self.inverse)


class NearestSolver:
    """Newton's method on the equations of the nearest configuration, some joints being held at their limits.

    All is in the coordinates ``q / unit``, in which W^2 is 1 for every joint that is pulled, and 0 for the others.

    Args:
        closure: The constraints.
        prescribed: The prescribed coordinates, those held at limits among them.
        posture: What is to be near.
        mobility: Degrees of freedom of the mechanism.
    """

    def __init__(self, closure: Closure, prescribed: PrescribedCoordinates, posture: Posture, mobility: int) -> None:
        self.newton, self.posture = NewtonSolver(closure, prescribed), posture
        self.unit = posture.unit(closure.scale)
        self.finer = self.unit / closure.scale
        self.square = posture.pulled.astype(np.float64)
        self.freedom = mobility - len(prescribed.names)
        self.rank = closure.model.nv - self.freedom

    def rows(self, state: Kinematics) -> Array:
        """Return J, shape (m, nv)."""
        return np.asarray(self.newton.rows(state) * self.finer)

    def moved(self, q: Array, step: Array) -> Array:
        """Return the configuration a step away."""
        return self.newton.moved(q, self.finer * step)

    def point(self, q: Array, t: float) -> _Point:
        """Return what holds at a configuration.

        Raises:
            AssemblyError: It is singular: J has lost rank.
        """
        state = self.newton.closure.state(q)
        rows = self.rows(state)
        u, s, vt = np.linalg.svd(rows)
        r = self.rank
        if len(s) < r or (r and not s[r - 1] > SINGULAR * s[0]):
            raise self._singular(rows, min(len(s), r), t)
        return _Point(q, state, rows, vt[:r].T @ (u[:, :r] / s[:r]).T, vt[r:].T, self.posture.pull(q))

    def settled(self, q: Array, w: Array, t: float) -> Array:
        """Return the nearest configuration in the neighbourhood of a rough one, shape (nq,).

        Raises:
            AssemblyError: The path is out of reach, or steps from there do not lead to a minimum.
        """
        q = self.newton.assemble(q, w, t)
        for _ in range(ITERATIONS):
            point = self.point(q, t)
            bent, least = self._bent(point, t)
            if least <= CURVED:
                raise self._undetermined(point, bent, t)
            step = self._step(point, self.newton.gap(point.state, w) / self.newton.measure, bent)
            size = float(np.abs(self.finer * step).max())
            q = self.moved(q, min(1.0, MOST / max(size, 1e-300)) * step)
            if size < SETTLED:
                return q
        raise AssemblyError(
            f"no configuration nearest to the posture is reached at {instant(t)}: the last step is {size:.2g}",
            expected="a path and a posture from which the nearest configuration is determined",
            hint="start: joint values near the wanted configuration", t=t, q=q,
        )  # fmt: skip

    def at(self, q: Array, t: float, dw: Array, ddw: Array) -> NearestState:
        """Return the velocity and the acceleration at a nearest configuration.

        Args:
            q: The configuration, shape (nq,).
            t: The instant, for messages.
            dw: Velocities of the prescribed coordinates, shape (k,).
            ddw: Their accelerations, shape (k,).

        Raises:
            AssemblyError: The position is singular, or not determined.
        """
        newton, point = self.newton, self.point(q, t)
        lam, (bent, least) = point.lam, self._bent(point, t)
        if least <= CURVED:
            raise self._undetermined(point, bent, t)
        own = np.zeros(newton.closure.size)
        v = self._with_null_motion(
            point, bent, newton.agreed(point.rows, _stack(own, dw) / newton.measure, 0.0, t), 0.0
        )
        rate, second = self._derivatives(point, v, t)
        lam_rate = (self.square * v - rate.T @ lam) @ point.inverse
        velocity = self.unit * v
        state = newton.closure.state(q, velocity)
        drift = np.array([coordinate.drift(state) for coordinate in newton.coordinates])
        right = _stack(-newton.closure.drift(state), ddw - drift) / newton.measure
        particular = newton.agreed(point.rows, right, float(np.abs(v).max(initial=0.0)) ** 2, t)
        a = self._with_null_motion(point, bent, particular, point.free.T @ (2.0 * rate.T @ lam_rate + second.T @ lam))
        return NearestState(t, q, velocity, self.unit * a, lam, lam_rate, (bent, least))

    def advance(self, state: NearestState, to: float, target: Target) -> NearestState:
        """Return the nearest configuration at another instant, on the same branch.

        Raises:
            AssemblyError: The branch cannot be continued.
        """
        states, error = self.steps(state, to, target)
        if error is not None:
            raise error
        return states[-1]

    def steps(self, state: NearestState, to: float, target: Target) -> tuple[list[NearestState], AssemblyError | None]:
        """Return the states of all steps to another instant, the first one included, as far as the branch goes.

        Steps are cut where predictions are poor.

        Returns:
            The states, and why there are none beyond the last; ``None`` where that is at the other instant.
        """
        pending, smallest, states = [to], SMALLEST * abs(to - state.t), [state]
        self.newton.cuts += CUTS_A_ROW
        while pending:
            further = self._stepped(states[-1], pending[-1], target)
            if further is not None:
                states.append(further)
                pending.pop()
                continue
            h = pending[-1] - states[-1].t
            self.newton.cuts -= 1
            if abs(h) <= smallest or self.newton.cuts < 0:
                return states, self._stuck(states[-1], to, target)
            pending.append(states[-1].t + 0.5 * h)
        return states, None

    def _stepped(self, state: NearestState, to: float, target: Target) -> NearestState | None:
        """Return the state at another instant, ``None`` where the prediction is not near, or another branch is met."""
        newton, h = self.newton, to - state.t
        w, dw, ddw = target(to)
        predicted = newton.moved(state.q, (h * state.v + 0.5 * h * h * state.a) / newton.scale)
        try:
            q = self._corrected(predicted, w, to, state.bent[0])
            further = None if q is None else self.at(q, to, dw, ddw)
        except (AssemblyError, np.linalg.LinAlgError):
            return None
        if further is None or further.bent[1] < FELL * state.bent[1]:
            return None
        turned = h * (further.v - state.v - h * state.a)
        return further if newton.continues(turned, predicted, further.q) else None

    def _corrected(self, q: Array, w: Array, t: float, bent: Array) -> Array | None:
        """Return the nearest configuration by a prediction, ``None`` where it is not near or does not come.

        H is that of the state before: the path is met quadratically, the minimum with the change of H.
        """
        size, total = np.inf, 0.0
        while size > SETTLED:
            point = self.point(q, t)
            gap = self.newton.gap(point.state, w)
            step = self._step(point, gap / self.newton.measure, bent)
            size, before = float(np.abs(self.finer * step).max()), size
            total += size
            if not total < REACH or not (size < CONTRACTION * before or size < SETTLED):
                return None
            q = self.moved(q, step)
        state = self.newton.closure.state(q)
        return q if self.newton.closed(state, self.newton.gap(state, w), w) else None

    def _step(self, point: _Point, gap: Array, bent: Array) -> Array:
        """Return the step that closes the gap, and makes ``Z^T (W (q - q0) + H step)`` vanish, shape (nv,)."""
        return self._with_null_motion(point, bent, point.inverse @ gap, -point.free.T @ point.pull)

    def _with_null_motion(self, point: _Point, bent: Array, particular: Array, right: Array | float) -> Array:
        """Return ``x = particular + Z y`` with ``Z^T H x = right``, shape (nv,)."""
        turned = bent @ point.free
        reduced = point.free.T @ turned
        return np.asarray(particular + point.free @ np.linalg.solve(reduced, right - turned.T @ particular))

    def _bent(self, point: _Point, t: float) -> tuple[Array, float]:
        """Return ``H Z Z^T``, shape (nv, nv), and the least eigenvalue of ``Z^T H Z``, infinite without freedom."""
        lam, free = point.lam, point.free
        columns = [self._derivatives(point, direction, t)[0].T @ lam for direction in free.T]
        turned = self.square[:, None] * free - np.array(columns).reshape(-1, len(free)).T
        reduced = free.T @ turned
        values = np.linalg.eigvalsh(0.5 * (reduced + reduced.T))
        return np.asarray(turned @ free.T), float(values[0]) if len(values) else np.inf

    def _derivatives(self, point: _Point, direction: Array, t: float) -> tuple[Array, Array]:
        """Return the first and the second derivative of J along a direction, each of shape (m, nv).

        Raises:
            AssemblyError: J is not smooth enough there to be differentiated.
        """
        length = float(np.abs(self.finer * direction).max(initial=0.0))
        if not length:
            return np.zeros_like(point.rows), np.zeros_like(point.rows)
        h = STEP / length
        ahead, behind = (self._along(point.q, sign * h * direction) for sign in (1.0, -1.0))
        (first, coarse), (second, rough) = (
            [np.tensordot(weights, part, 1) / h**order for weights in pair]
            for order, pair, part in ((1, FIRST, ahead - behind), (2, SECOND, ahead + behind - 2.0 * point.rows))
        )
        off = max(np.abs(first - coarse).max() / length, np.abs(second - rough).max() / length**2)
        if not off <= DIFFERED * np.abs(point.rows).max():
            raise AssemblyError(
                f"at {instant(t)} a prescribed coordinate bends too sharply for the nearest configuration to have an "
                "acceleration", expected="rotations that keep clear of half a turn, distances that keep clear of 0",
                hint="relative_to: a reference that is turned as the body is wanted", t=t,
            )  # fmt: skip
        return first, second

    def _along(self, q: Array, step: Array) -> Array:
        """Return J one to four steps further, shape (4, m, nv)."""
        closure = self.newton.closure
        return np.array([self.rows(closure.state(self.moved(q, k * step))) for k in range(1, len(FIRST[0]) + 1)])

    def _stuck(self, state: NearestState, to: float, target: Target) -> AssemblyError:
        """Return why the branch cannot be continued to an instant."""
        try:
            self.newton.assemble(state.q, target(to)[0], to)
            point = self.point(state.q, state.t)
        except AssemblyError as error:
            return error
        s = np.linalg.svd(point.rows, compute_uv=False)
        if self.rank and s[self.rank - 1] < WEAK * s[0]:
            return self._singular(point.rows, self.rank, state.t)
        if state.bent[1] < FLAT:
            return self._undetermined(point, state.bent[0], state.t)
        return AssemblyError(
            f"the motion cannot be followed from {instant(state.t)} to {instant(to)}", t=to, q=state.q,
            expected="a path that moves by less than a turn between two rows", hint="more samples, or a slower law",
        )  # fmt: skip

    def _singular(self, rows: Array, rank: int, t: float) -> AssemblyError:
        found = tied(rows, rank, self.newton.names)
        return AssemblyError(
            f"the position is singular at {instant(t)}: {dependent(found)} there",
            expected="a path on which the prescribed coordinates, and joints held at their limits, are independent",
            hint="a path that keeps clear of the stretched or folded arm, or another posture", t=t,
        )  # fmt: skip

    def _undetermined(self, point: _Point, bent: Array, t: float) -> AssemblyError:
        free = point.free
        reduced = free.T @ bent @ free
        weak = np.abs(self.finer * (free @ np.linalg.eigh(0.5 * (reduced + reduced.T))[1][:, 0]))
        moving = [name for name, size in zip(self.posture.names, weak, strict=True) if size > 0.3 * weak.max()]
        return AssemblyError(
            f"the configuration nearest to the posture is not determined at {instant(t)}: {', '.join(moving)} can move "
            "and leave the distance to it as it is",
            expected="a posture that names enough joints, and that is nearer than half-way to another configuration",
            hint="more joints in nearest_to, another posture, or another start", t=t,
        )  # fmt: skip


def _stack(own: Array, prescribed: Array) -> Array:
    """Return right-hand sides of the constraints and of the prescribed coordinates, shape (m,)."""
    return np.concatenate([own, prescribed])
