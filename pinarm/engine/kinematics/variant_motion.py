"""Prescribed motions of variants of a mechanism: positions, velocities and accelerations of all rows at once.

From configurations near the rows of every variant Newton's method leads to these: from row i of the first variant, or
where laws vary from a coarse continuation. That the rows are one motion each, on the branch that the start chooses, is
checked as the continuation from row to row does: the first row is one step of it away from the closed drawing, within
the limits of joints (``assembly`` follows longer ways); every row is near the one that velocity and acceleration
predict from the row before, and moves as that predicts; the free motions keep their orientation in between. A variant
of which one of these is not so is to be solved alone.

With J the independent rows of constraints and prescribed coordinates: ``J dq = gap``, ``J v = (0, w')`` and
``J a = (0, w'') - J' v``. Arrays have the states along their last axis, row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.constraint_rows import EvaluatedRows
from pinarm.engine.constraints.nullspace import RANK, VANISHED
from pinarm.engine.constraints.orthogonal_rows import REGULAR, OrthogonalRows
from pinarm.engine.constraints.variant_closure import VariantClosure
from pinarm.engine.kinematics.branch_test import ENOUGH, on_branch
from pinarm.engine.kinematics.continuation_batch import NEAR
from pinarm.engine.kinematics.newton import CLOSED, ITERATIONS, NewtonSolver
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.mechanics.geometry.model_variants import VariantsDiffer

STEPS = 12
"""Most steps from a row of the first variant: from an angle of 0.5 rad five or six."""

WEAK = 1e-3
"""Least length of what a row of J adds to those before it, relative to the length that it can have."""

COARSE = 0.25
"""Change of the first variant's coordinates from one row to the next of a coarse continuation [rad or m]: a prediction
by velocity and acceleration errs by some hundredths of it, and of twice as fast a variant by a tenth."""

SAME = 1e-6
"""Difference of configurations of one branch, that were closed from different places [rad or m]: rounding only."""


class VariantStates(NamedTuple):
    """The states of k variants at n rows.

    Attributes:
        q: Configurations, shape (n, k, nq).
        v: Velocities, shape (n, k, nv).
        a: Accelerations, shape (n, k, nv).
        sound: Which variants are on the branch of their start all along, shape (k,).
    """

    q: Array
    v: Array
    a: Array
    sound: Flags


@dataclass(frozen=True, eq=False)
class VariantMotion:
    """How variants of a mechanism follow prescribed coordinates.

    Attributes:
        solver: Newton's method on one of them: which rows are curved, and the units of all.
        own: The constraints of the variants.
        whole: The constraints, and the prescribed coordinates.
        kept: Rows of the constraints that say what all of them do, then the prescribed coordinates.
    """

    solver: NewtonSolver
    own: VariantClosure
    whole: VariantClosure
    kept: list[int]

    @classmethod
    def of(cls, own: VariantClosure, prescribed: PrescribedCoordinates, q: Array) -> VariantMotion:
        """Return the motion, given a configuration of the first variant, shape (nq,).

        Raises:
            VariantsDiffer: Something cannot be had of many states, or the first variant is near a singular position.
        """
        solver, whole = NewtonSolver(own.first, prescribed), own.with_guides(prescribed.names, prescribed.coordinates)
        if not solver.sliding.all():
            raise VariantsDiffer("screws, whose turns are counted")
        rows = solver.whole.rows(solver.whole.state(q))
        kept = [*own.independent(rows[: own.size]), *range(own.size, whole.size)]
        values = np.linalg.svd(rows[kept], compute_uv=False)
        if len(kept) != len(q) or values[-1] < REGULAR * values[0]:
            raise VariantsDiffer("a motion that begins near a singular position")
        return cls(solver, own, whole, kept)

    def follow(self, t: Array, laws: Array, near: Array, start: Array) -> VariantStates:
        """Return the states.

        Args:
            t: The parameter at the rows, shape (n,), or (n, k) where it varies.
            laws: The prescribed coordinates and their two derivatives, shape (3, n, k or 1, d).
            near: Configurations near those of the rows, shape (n, k or 1, nq).
            start: Configurations of the drawing, or of the start, shape (k or 1, nq): they choose the branch.
        """
        n, k = len(near), len(self.own.model)
        with np.errstate(all="ignore"):  # of variants that are to be solved alone
            w = self._columns(laws[0])
            states, sound, rows = self._solved(laws, near)
            q, v, a = (x.reshape(-1, n, k) for x in states)
            free = rows.basis[self.own.size - self.whole.size :].reshape(-1, len(q), n, k)
            good = sound.reshape(n, k).all(axis=0) & self._is_one_motion(t.reshape(n, -1), q, v, a, free)
            first, near_start = self._begun(self._columns(start[None]), w[:, :k])
            good &= near_start & (np.abs(first - q[:, 0]).max(axis=0) <= SAME)
        return self._told((q, v, a), good)

    def _begun(self, start: Array, w: Array) -> tuple[Array, Flags]:
        """Return first positions, shape (nv, k), and where they are one step of the continuation from closed drawings.

        Args:
            start: Configurations of the drawing, or of the start, shape (nv, k).
            w: First values of the prescribed coordinates, shape (d, k).
        """
        unguided, k = NewtonSolver(self.own.first, PrescribedCoordinates((), (), ())), w.shape[1]
        kept = [row for row in self.kept if row < self.own.size]
        drawn, good = replace(self, solver=unguided, whole=self.own, kept=kept)._assembled(start, np.zeros((0, k)))
        first, reached = self._assembled(drawn, w)
        change = np.tile(self._gaps(self._evaluated(drawn), w)[self.own.size :], 2)
        states = np.stack([drawn, first], axis=1)
        _, v, a, rows = self._rates(states.reshape(len(first), -1), change, np.zeros_like(change))
        v, a, free = (x.reshape(*x.shape[:-1], 2, k) for x in (v, a, rows.basis[self.own.size - self.whole.size :]))
        good &= self._is_one_motion(np.array([[0.0], [1.0]]), states, v, a, free)
        return first, good & reached & self._within(states)

    def _within(self, q: Array) -> Flags:
        """Tell in which variants configurations, shape (nq, 2, k), are within the limits of joints, shape (k,)."""
        model, given = self.own.first.model, {getattr(one, "joint", None) for one in self.solver.coordinates}
        judged = [k for k in range(model.nq) if k not in given]
        low, high = (x[judged, None, None] for x in (model.lowerPositionLimit, model.upperPositionLimit))
        return np.asarray(((q[judged] >= low) & (q[judged] <= high)).all(axis=(0, 1)))

    def follow_near(self, laws: Array, near: Array) -> VariantStates:
        """Return states each of its own, near configurations that are predicted from states of the motion.

        Args:
            laws: The prescribed coordinates and their two derivatives, shape (3, n, k or 1, d).
            near: The predicted configurations, shape (n, k, nq).
        """
        n, k = len(near), len(self.own.model)
        with np.errstate(all="ignore"):
            states, sound, _ = self._solved(laws, near)
            q, v, a = (x.reshape(-1, n, k) for x in states)
            good = sound.reshape(n, k) & (np.abs(q - near.transpose(2, 0, 1)).max(axis=0) <= NEAR)
        return self._told((q, v, a), good.all(axis=0))

    def continued(self, t: Array, laws: Array, first: Array, start: Array) -> Array:
        """Return configurations near those of the rows, shape (n, k, nq), where variants follow laws of their own.

        Some of the rows are solved one after the other, each predicted by velocity and acceleration of the one before;
        through the states of two such rows leads the polynomial of the fifth degree that those between are near.

        Args:
            t: The parameter at the rows, shape (n, k or 1).
            laws: The prescribed coordinates and their two derivatives, shape (3, n, k or 1, d).
            first: Configurations of the first variant, shape (n, nq).
            start: See ``follow``.
        """
        knots, found = _knots(first), np.empty((len(first), len(self.own.model), first.shape[1]))
        with np.errstate(all="ignore"):
            q, _ = self._begun(self._columns(start[None]), self._columns(laws[0, :1]))
            before = self._moving(q, laws[:, :1])
            found[0] = q.T
            for low, high in pairwise(knots):
                h = t[high] - t[low]
                after = self._moving(before[0] + h * (before[1] + 0.5 * h * before[2]), laws[:, high : high + 1])
                share = np.where(h == 0.0, 1.0, (t[low + 1 : high + 1] - t[low]) / h)
                found[low + 1 : high + 1] = _between(share, h, before, after).transpose(1, 2, 0)
                before = after
        return found

    def rates(self, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        """Return velocities and accelerations, shape (n, k, nv), at configurations of the motion, shape (n, k, nq).

        Args:
            q: The configurations.
            dw: Velocities of the prescribed coordinates, the same at every row, shape (k or 1, d).
            ddw: Their accelerations, shape (k or 1, d).
        """
        each = (self._columns(np.repeat(x[None], len(q), axis=0)) for x in (dw, ddw))
        _, v, a, _ = self._rates(self._columns(q), *each)
        return v.T.reshape(q.shape), a.T.reshape(q.shape)

    def _columns(self, x: Array) -> Array:
        """Return what n rows of the variants have, shape (n, k or 1, w), as columns, shape (w, n k)."""
        every = np.broadcast_to(x, (len(x), len(self.own.model), x.shape[-1]))
        return np.ascontiguousarray(every.reshape(-1, x.shape[-1]).T)

    def _solved(self, laws: Array, near: Array) -> tuple[list[Array], Flags, OrthogonalRows]:
        """Return q, v and a near configurations, each of shape (nv, N), where they are sound, and the rows J."""
        w, dw, ddw = map(self._columns, laws)
        q, sound = self._closed(self._columns(near), w)
        measured, v, a, rows = self._rates(q, dw, ddw)
        sound &= self._regular(rows) & (np.abs(self._gaps(measured, w)) <= self._allowed(w)).all(axis=0)
        return [q, v, a], sound, rows

    def _moving(self, near: Array, laws: Array) -> tuple[Array, Array, Array]:
        """Return q, v and a of one row near configurations, each of shape (nv, k)."""
        (q, v, a), _, _ = self._solved(laws, near.T[None])
        return q, v, a

    def _told(self, states: Sequence[Array], good: Flags) -> VariantStates:
        """Return states, shape (nv, n, k); those that are not good are the first's."""
        q, v, a = (np.where(good, x, x[..., :1]).transpose(1, 2, 0) for x in states)
        return VariantStates(q, v, a, good & self.own.alike_in_size)

    def _evaluated(self, q: Array) -> EvaluatedRows:
        return self.whole.constraint_rows.at(q.T.reshape(-1, len(self.own.model), len(q)))

    def _orthogonal(self, measured: EvaluatedRows, n: int) -> OrthogonalRows:
        """Return the kept rows J, made orthogonal, at n configurations."""
        return OrthogonalRows.of(
            measured.some(np.array(self.kept), np.arange(self.own.model.nv)).reshape(len(self.kept), -1, n)
        )

    def _gaps(self, measured: EvaluatedRows, w: Array) -> Array:
        """Return what is missing in all rows, ``(-phi(q), w - w(q))``, shape (size, n)."""
        gaps = -measured.gaps.reshape(w.shape[1], -1).T
        gaps[self.own.size :] += w
        return gaps

    def _allowed(self, w: Array) -> Array:
        """Return the gaps that are rounding, shape (size, n); of rows that repeat others, of the file."""
        slack = self.whole.slack.copy()
        slack[self.kept] = 0.0
        wanted = np.concatenate([np.zeros((self.own.size, w.shape[1])), np.abs(w)])
        places = np.maximum(self.solver.measure, self.whole.reach)
        return np.asarray(CLOSED * (places[:, None] + wanted) + slack[:, None])

    def _closed(self, q: Array, w: Array) -> tuple[Array, Flags]:
        """Return the solutions near configurations, shape (nv, N), and where they were reached, shape (N,).

        A state that is closed moves no more, so that it does not depend on the others.
        """
        done = np.zeros(q.shape[1], dtype=bool)
        for _ in range(STEPS):
            measured = self._evaluated(q)
            step = self._orthogonal(measured, q.shape[1]).shortest(self._gaps(measured, w)[self.kept])
            q = np.where(done, q, q + step)
            done |= ~(np.abs(step).max(axis=0) >= ENOUGH)  # or is no number, and no state of the motion
            if done.all():
                break
        return q, done

    def _rates(self, q: Array, dw: Array, ddw: Array) -> tuple[EvaluatedRows, Array, Array, OrthogonalRows]:
        """Return what is measured at configurations, velocities, accelerations, and the rows J."""
        measured, n, m = self._evaluated(q), q.shape[1], len(self.kept) - len(dw)
        rows, right = self._orthogonal(measured, n), np.zeros((len(self.kept), n))
        right[m:] = dw
        v = rows.shortest(right)
        right[m:] = ddw
        drifts = measured.drifts(v.T.reshape(measured.q.shape[0], -1, len(v)))
        right -= drifts.reshape(n, -1).T[self.kept]
        return measured, v, rows.shortest(right), rows

    def _regular(self, rows: OrthogonalRows) -> Flags:
        """Return where every row adds something to those before it, shape (N,)."""
        added = np.einsum("iin->in", rows.shares) / self.whole.reach[self.kept, None]
        return np.asarray((added > WEAK).all(axis=0))

    def _is_one_motion(self, t: Array, q: Array, v: Array, a: Array, free: Array) -> Flags:
        """Tell in which variants each row follows from the one before, shape (k,).

        Args:
            t: The parameter, shape (n, k or 1).
            q: Configurations, shape (nv, n, k).
            v: Velocities, likewise.
            a: Accelerations, likewise.
            free: T, orthonormal bases of the free motions, shape (f, nv, n, k).
        """
        h = np.diff(t, axis=0)
        slope = v[:, :-1] + h * a[:, :-1]
        correction = np.abs(q[:, 1:] - q[:, :-1] - 0.5 * h * (v[:, :-1] + slope)).max(axis=0)
        near = (correction <= NEAR) & on_branch(h * (v[:, 1:] - slope), correction)
        turned = np.einsum("fcnk,gcnk->nkfg", free[:, :, :-1], free[:, :, 1:])
        kept = turned[..., 0, 0] if len(free) == 1 else np.linalg.det(turned)  # slow for single numbers
        return np.asarray((near & (kept > 0.0)).all(axis=0))

    def _assembled(self, start: Array, w: Array) -> tuple[Array, Flags]:
        """Return what damped steps from starts reach, shape (nv, k), and where no step had to be damped, shape (k,).

        The steps of ``NewtonSolver.closest``; where the gap grows these would be shorter, and the variant is left.
        """
        q, solver = start, self.solver
        size, good = np.full(w.shape[1], np.inf), np.ones(w.shape[1], dtype=bool)
        for _ in range(ITERATIONS):
            measured = self._evaluated(q)
            gaps = self._gaps(measured, w)
            closed = (np.abs(gaps) <= self._allowed(w)).all(axis=0)
            left = np.linalg.norm(gaps / solver.measure[:, None], axis=0)
            good &= closed | (left < size)
            if (closed | ~good).all():
                break
            rows = measured.matrices.reshape(w.shape[1], self.whole.size, len(q)).copy()
            counts = np.linalg.norm(rows, axis=2, keepdims=True) > VANISHED * self.whole.reach[:, None]
            rows *= counts * (solver.scale / solver.measure[:, None])
            step = np.matvec(np.linalg.pinv(rows, rcond=RANK), (gaps / solver.measure[:, None]).T).T
            turning = rows[:, solver.curved].any(axis=1).T
            most = np.where(turning, np.abs(step), 0.0).max(axis=0)
            step *= np.where(closed, 0.0, np.minimum(1.0, 0.5 / np.maximum(most, 1e-300)))
            q, size = q + solver.scale[:, None] * step, left
        return q, good & closed


def _knots(q: Array) -> list[int]:
    """Return the first row, the last, and evenly some between that are near each other, given rows of shape (n, nq)."""
    most = float(np.abs(np.diff(q, axis=0)).max(initial=0.0))
    step = max(1, int(COARSE / most)) if most * (len(q) - 1) > COARSE else max(1, len(q) - 1)
    return [*range(0, len(q) - 1, step), len(q) - 1]


def _between(share: Array, h: Array, before: Sequence[Array], after: Sequence[Array]) -> Array:
    """Return the polynomials of the fifth degree through two states, shape (nv, n, k), at shares of the way between.

    Args:
        share: 0 at the first state, 1 at the second, shape (n, k or 1).
        h: The parameter between them, shape (k,) or (1,).
        before: q, v and a of the first, each of shape (nv, k).
        after: Those of the second.
    """
    (q, v, a), s = (before[0], h * before[1], 0.5 * h * h * before[2]), share
    gap = after[0] - (q + v + a), h * after[1] - (v + 2.0 * a), h * h * after[2] - 2.0 * a
    weights = (10.0, -4.0, 0.5), (-15.0, 7.0, -1.0), (6.0, -3.0, 0.5)
    third, fourth, fifth = (np.tensordot(row, np.array(gap), 1)[:, None] for row in weights)
    q, v, a = (x[:, None] for x in (q, v, a))
    return np.asarray(q + s * (v + s * (a + s * (third + s * (fourth + s * fifth)))))
