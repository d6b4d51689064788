"""Prescribed motions of variants of a mechanism: positions, velocities and accelerations of all rows at once.

From configurations near the rows of every variant Newton's method leads to these: from row i of the first variant, or
where laws vary from a coarse continuation. The rows are one motion each, on the branch that the start chooses, if

- the first row is one step of a continuation away from the closed drawing, within the limits of joints;
- every row is near the one that velocity and acceleration predict from the row before, and moves as that predicts;
- the determinant of J keeps its sign, and its inverse about its size.

A variant of which one of these is not so is solved alone. Arrays have the shape (n, k, ..), rows and variants.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.nullspace import RANK, VANISHED
from pinarm.engine.constraints.variant_closure import VariantClosure
from pinarm.engine.kinematics.continuation import NEAR, BatchClosing, Rates
from pinarm.engine.kinematics.newton import ITERATIONS, NewtonSolver
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.singular import on_branch
from pinarm.mechanics.geometry.model_variants import VariantsDiffer
from pinarm.records import Record

STEPS = 12
"""Most steps from a row of the first variant: from an angle of 0.5 rad five or six."""

UNEVEN = 50.0
"""Largest ratio of the largest entry of J^-1 in a motion to its least: beyond it singular positions may be near, at
which rows are interpolated (``motion.singular_passage``)."""

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


class VariantMotion(Record, frozen=True):
    """Motion of variants of a mechanism by prescribed coordinates.

    Attributes:
        solver: Newton's method on one variant, for the curved rows and the units of all variants.
        closing: Newton's method on all variants and the prescribed coordinates.
    """

    solver: NewtonSolver
    own: VariantClosure
    closing: BatchClosing

    @classmethod
    def of(cls, own: VariantClosure, prescribed: PrescribedCoordinates, q: Array) -> VariantMotion:
        """Return the motion, given a configuration of the first variant, shape (nq,).

        Raises:
            VariantsDiffer: Something cannot be had of many states, or the first variant is near a singular position.
        """
        solver, whole = NewtonSolver(own.first, prescribed), own.with_guides(prescribed.names, prescribed.coordinates)
        if not solver.sliding.all():
            raise VariantsDiffer("screws, whose turns are counted")
        closing = BatchClosing.of(whole, own.size, solver.whole.rows(solver.whole.state(q)))
        if closing is None:
            raise VariantsDiffer("a motion that begins near a singular position")
        return cls(solver, own, closing)

    def follow(self, t: Array, laws: Array, near: Array, start: Array) -> VariantStates:
        """Return the states.

        Args:
            t: The parameter at the rows, shape (n,), or (n, k) where it varies.
            laws: The prescribed coordinates and their two derivatives, shape (3, n, k or 1, d).
            near: Configurations near those of the rows, shape (n, k or 1, nq).
            start: Configurations of the drawing, or of the start, shape (k or 1, nq): they choose the branch.
        """
        with np.errstate(all="ignore"):  # of variants that are to be solved alone
            q, rates, sound = self._solved(laws, near)
            good = sound.all(axis=0) & _is_one_motion(t.reshape(len(t), -1), q, rates)
            first, begun = self._begun(self._spread(start[None])[0], self._spread(laws[0, :1])[0])
            good &= begun & (np.abs(first - q[0]).max(axis=-1) <= SAME)
        return self._sound(q, rates, good)

    def follow_near(self, laws: Array, near: Array) -> VariantStates:
        """Return states each of its own, near configurations that are predicted from states of the motion."""
        with np.errstate(all="ignore"):
            q, rates, sound = self._solved(laws, near)
            good = sound & (np.abs(q - near).max(axis=-1) <= NEAR)
        return self._sound(q, rates, good.all(axis=0))

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
        knots, near = _knots(first), np.empty((len(first), len(self.own.model), first.shape[1]))
        with np.errstate(all="ignore"):
            q, _ = self._begun(self._spread(start[None])[0], self._spread(laws[0, :1])[0])
            before = self._moving(q, laws[:, :1])
            near[0] = q
            for low, high in pairwise(knots):
                h = (t[high] - t[low])[:, None]
                after = self._moving(before[0] + h * (before[1] + 0.5 * h * before[2]), laws[:, high : high + 1])
                share = np.where(h == 0.0, 1.0, (t[low + 1 : high + 1] - t[low])[..., None] / h)
                near[low + 1 : high + 1] = _between(share, h, before, after)
                before = after
        return near

    def rates(self, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        """Return velocities and accelerations, shape (n, k, nv), at configurations of the motion, shape (n, k, nq)."""
        targets = (self._spread(np.repeat(x[None], len(q), axis=0)) for x in (dw, ddw))
        rates = self.closing.rates(self.closing.at(q), *targets)
        return rates.v, rates.a

    def _spread(self, x: Array) -> Array:
        """Return an array of shape (n, k or 1, w) for all variants."""
        return np.ascontiguousarray(np.broadcast_to(x, (len(x), len(self.own.model), x.shape[-1])))

    def _solved(self, laws: Array, near: Array) -> tuple[Array, Rates, Flags]:
        """Return configurations near given ones, their rates, and where they are closed, shape (n, k)."""
        (w, dw, ddw), closing = map(self._spread, laws), self.closing
        q, _, _, done = closing.solve(self._spread(near), w, STEPS)
        measured = closing.at(q)
        return q, closing.rates(measured, dw, ddw), done & closing.closed(measured, w)

    def _moving(self, near: Array, laws: Array) -> tuple[Array, Array, Array]:
        """Return q, v and a of one row near configurations, each of shape (k, nv)."""
        q, rates, _ = self._solved(laws, near[None])
        return q[0], rates.v[0], rates.a[0]

    def _sound(self, q: Array, rates: Rates, good: Flags) -> VariantStates:
        """Return states; those of variants that are not good are the first's."""
        q, v, a = (np.where(good[:, None], x, x[:, :1]) for x in (q, rates.v, rates.a))
        return VariantStates(q, v, a, good & self.own.alike_in_size)

    def _begun(self, start: Array, w: Array) -> tuple[Array, Flags]:
        """Return first positions, shape (k, nv), and where they are one step from closed drawings."""
        drawn, good = self._assembled(start, w, np.arange(self.own.size))
        first, reached = self._assembled(drawn, w, np.arange(self.closing.rows.size))
        change = self.closing.missing(self.closing.at(drawn[None]), w[None])[..., self.own.size :].repeat(2, axis=0)
        states = np.stack([drawn, first])
        rates = self.closing.rates(self.closing.at(states), change, np.zeros_like(change))
        good &= _is_one_motion(np.array([[0.0], [1.0]]), states, rates)
        return first, good & reached & self._within(states)

    def _within(self, q: Array) -> Flags:
        """Tell in which variants configurations, shape (2, k, nq), are within the limits of joints, shape (k,)."""
        model, given = (
            self.own.first.model,
            {getattr(coordinate, "joint", None) for coordinate in self.solver.coordinates},
        )
        judged = [k for k in range(model.nq) if k not in given]
        low, high = model.lowerPositionLimit[judged], model.upperPositionLimit[judged]
        return np.asarray(((q[..., judged] >= low) & (q[..., judged] <= high)).all(axis=(0, -1)))

    def _assembled(self, q: Array, w: Array, some: Indices) -> tuple[Array, Flags]:
        """Return where damped steps on some rows lead, shape (k, nv), and where no step had to be damped, (k,)."""
        solver, whole, size = self.solver, self.closing.rows, np.full(len(q), np.inf)
        good, allowed = np.ones(len(q), dtype=bool), self.closing.allowed(w)[:, some]
        for _ in range(ITERATIONS):
            measured = self.closing.at(q[None])
            gaps = self.closing.missing(measured, w[None])[0][:, some]
            closed = (np.abs(gaps) <= allowed).all(axis=-1)
            left = np.linalg.norm(gaps / solver.measure[some], axis=-1)
            good &= closed | (left < size)
            if (closed | ~good).all():
                break
            rows = measured.matrices[0][:, some]
            counts = np.linalg.norm(rows, axis=2, keepdims=True) > VANISHED * whole.reach[some, None]
            rows = rows * counts * (solver.scale / solver.measure[some, None])
            step = np.matvec(np.linalg.pinv(rows, rcond=RANK), gaps / solver.measure[some])
            turning = rows[:, solver.curved[some]].any(axis=1)
            most = np.where(turning, np.abs(step), 0.0).max(axis=-1)
            step *= np.where(closed, 0.0, np.minimum(1.0, 0.5 / np.maximum(most, 1e-300)))[:, None]
            q, size = q + solver.scale * step, left
        return q, good & closed


def _is_one_motion(t: Array, q: Array, rates: Rates) -> Flags:
    """Tell in which variants each row follows from the one before, shape (k,), given the parameter, (n, k or 1)."""
    h, v, a = np.diff(t, axis=0)[..., None], rates.v, rates.a
    slope = v[:-1] + h * a[:-1]
    correction = np.abs(q[1:] - q[:-1] - 0.5 * h * (v[:-1] + slope)).max(axis=-1)
    near = (correction <= NEAR) & on_branch(h * (v[1:] - slope), correction) & (rates.sense[1:] == rates.sense[:-1])
    return np.asarray(near.all(axis=0) & (rates.size.max(axis=0) <= UNEVEN * rates.size.min(axis=0)))


def _knots(q: Array) -> list[int]:
    """Return the first row, the last, and evenly some between that are near each other, given rows of shape (n, nq)."""
    most = float(np.abs(np.diff(q, axis=0)).max(initial=0.0))
    step = max(1, int(COARSE / most)) if most * (len(q) - 1) > COARSE else max(1, len(q) - 1)
    return [*range(0, len(q) - 1, step), len(q) - 1]


def _between(share: Array, h: Array, before: Sequence[Array], after: Sequence[Array]) -> Array:
    """Return the polynomials of the fifth degree through two states, shape (n, k, nv), at shares of the way between.

    Args:
        share: 0 at the first state, 1 at the second, shape (n, k or 1, 1).
        h: The parameter between them, shape (k or 1, 1).
        before: q, v and a of the first, each of shape (k, nv).
        after: Those of the second.
    """
    q, v, a, s = before[0], h * before[1], 0.5 * h * h * before[2], share
    gap = np.array([after[0] - (q + v + a), h * after[1] - (v + 2.0 * a), h * h * after[2] - 2.0 * a])
    weights = (10.0, -4.0, 0.5), (-15.0, 7.0, -1.0), (6.0, -3.0, 0.5)
    third, fourth, fifth = (np.tensordot(row, gap, 1) for row in weights)
    return np.asarray(q + s * (v + s * (a + s * (third + s * (fourth + s * fifth)))))
