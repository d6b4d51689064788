"""Newton's method at many states at once, of one mechanism or of variants, and branches of solutions through rows.

As many rows of J as unknowns are chosen at one regular configuration by pivots; other rows repeat them. Each state is
solved by LU factors of these rows, independently of the states beside it. Arrays have the states, and variants, along
their leading axes: q has the shape (n, nv), of variants (n, k, nv). Mechanisms with ball joints are not solved so.

From a solved row of a table, the rows ahead are predicted by its velocity and the last accelerations, and corrected
together, as far ahead as this surely stays on the branch: the prediction is near, every correction is much smaller than
the one before, the velocity is that of a smooth motion, and the determinant of J keeps its sign and a good part of its
size. The next sweep begins where one ends. Rows that are singular or out of reach are left to ``NewtonSolver.steps``.

States without order are each reached from one start, while their coordinates go straight to their values, in 1 step,
and where that may leave the branch in 4, 16 and 64. Motions that the coordinates leave free rest: ``d . (q - q0) = 0``
for every free direction d at the start. Where there are more coordinates than degrees of freedom, independent ones are
followed, and all have their values at the end. A state depends on no other.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import EvaluatedRows
from pinarm.engine.constraints.nullspace import independent_rows
from pinarm.engine.kinematics.assembly import beside, null_space
from pinarm.engine.kinematics.newton import CLOSED, CONTRACTION, NewtonSolver
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.singular import ENOUGH, instant, on_branch
from pinarm.errors import InputError
from pinarm.input.units import DIMENSIONLESS
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

REGULAR = 1e-4
"""Smallest ratio of singular values of J at which rows are chosen that serve other configurations, too."""

ROUNDING = 1e-15
"""Correction that would change nothing any more [rad or m]."""


NEAR, ITERATIONS = 0.1, 5
"""Largest correction of a prediction that is accepted [rad or m], and most corrections."""


class Rates(NamedTuple):
    """Velocities and accelerations, shape (.., nv), and how regular the chosen rows are.

    Attributes:
        size: Largest entry of J^-1, shape (..).
        sense: Sign of the determinant of J, shape (..): another one is beyond a singular position.
    """

    v: Array
    a: Array
    size: Array
    sense: Array


class Corrected(NamedTuple):
    """Solutions near predictions.

    Attributes:
        correction: Size of the first correction, shape (n,).
        near: Where the chosen rows are closed, surely on the branch of the prediction, shape (n,).
        closed: Where all rows are closed, shape (n,).
    """

    q: Array
    rates: Rates
    correction: Array
    near: Flags
    closed: Flags


class BatchClosing(Record, frozen=True):
    """Independent rows of J.

    Attributes:
        rows: The constraints, then the prescribed coordinates.
        own: Number m of rows of the constraints.
        kept: Chosen rows, ascending.
        size: Largest entry of J^-1 where they were chosen.
        sense: Sign of the determinant of J there.
    """

    rows: Closure
    own: int
    kept: list[int]
    size: float
    sense: float

    @classmethod
    def of(cls, rows: Closure, own: int, matrix: Array) -> BatchClosing | None:
        """Return the rows chosen where all rows are a matrix, shape (m + k, nv); ``None`` at a singular position."""
        values, nv = np.linalg.svd(matrix, compute_uv=False), matrix.shape[1]
        if len(values) < nv or values[-1] < REGULAR * values[0]:
            return None
        kept = independent_rows(matrix, nv, rows.reach)
        size = float(np.abs(np.linalg.inv(matrix[kept])).max(initial=0.0))
        return cls(rows, own, kept, size, float(np.linalg.slogdet(matrix[kept])[0]))

    def at(self, q: Array) -> EvaluatedRows:
        return self.rows.constraint_rows.at(q)

    def missing(self, measured: EvaluatedRows, w: Array) -> Array:
        """Return ``(-phi(q), w - w(q))`` [m or rad], shape (.., m + k)."""
        missing = -measured.gaps
        missing[..., self.own :] += w
        return missing

    def allowed(self, w: Array) -> Array:
        """Return the gaps that are rounding, shape (.., m + k); of rows that repeat the chosen ones, of the file."""
        slack, wanted = self.rows.slack.copy(), np.zeros((*w.shape[:-1], self.rows.size))
        slack[self.kept], wanted[..., self.own :] = 0.0, np.abs(w)
        return np.asarray(CLOSED * (np.maximum(self.rows.measure, self.rows.reach) + wanted) + slack)

    def closed(self, measured: EvaluatedRows, w: Array) -> Flags:
        """Return where all rows are closed to ``allowed``."""
        return np.asarray((np.abs(self.missing(measured, w)) <= self.allowed(w)).all(axis=-1))

    def solve(self, q: Array, w: Array, steps: int) -> tuple[Array, Array, Flags, Flags]:
        """Return the solutions near configurations.

        A state that is solved moves no more, so that it does not depend on the states beside it.

        Args:
            q: Configurations, shape (.., nv).
            w: Wanted values of the prescribed coordinates, shape (.., k).

        Returns:
            The solutions, shape (.., nv); the sizes of the first corrections, shape (..); where every correction was
            much smaller than the one before; and where the corrections vanish, or are no numbers.
        """
        size, first = np.full(w.shape[:-1], np.inf), np.zeros(0)
        steady, done = np.ones(w.shape[:-1], dtype=bool), np.zeros(w.shape[:-1], dtype=bool)
        for iteration in range(steps):
            measured = self.at(q)
            step = _solved(self._matrices(measured), self.missing(measured, w)[..., self.kept])
            size, before = np.abs(step).max(axis=-1), size
            steady &= (size <= CONTRACTION * before) | (size < ENOUGH)
            q = np.where(done[..., None], q, q + step)
            left = size * (size / before) ** 2 if iteration else size  # the next one: errors are squared at every step
            first = first if iteration else size
            done |= ~((size >= ENOUGH) & (left >= ROUNDING))
            if done.all():
                break
        return q, first, steady, done

    def corrected(self, predicted: Array, slope: Array, h: Array, laws: Array) -> Corrected:
        """Return the solutions near predictions.

        Args:
            predicted: Configurations, shape (n, nv).
            slope: Predicted velocities, likewise.
            h: Times of the predictions [s], shape (n,).
            laws: Prescribed coordinates and their two derivatives, shape (3, n, k).
        """
        q, correction, steady, done = self.solve(predicted, laws[0], ITERATIONS)
        measured = self.at(q)
        rates = self.rates(measured, laws[1], laws[2])
        near = done & steady & (correction <= NEAR) & on_branch(h[:, None] * (rates.v - slope), correction)
        return Corrected(q, rates, correction, near, self.closed(measured, laws[0]))

    def rates(self, measured: EvaluatedRows, dw: Array, ddw: Array) -> Rates:
        """Return v with ``J v = (0, dw)`` and a with ``J a = (0, ddw) - J' v``; dw and ddw of shape (.., k)."""
        matrices = self._matrices(measured)
        sense = np.linalg.slogdet(matrices)[0]
        matrices[sense == 0.0] = np.nan
        inverse = np.linalg.inv(matrices)
        right = np.zeros((*dw.shape[:-1], self.rows.size))
        right[..., self.own :] = dw
        v = np.matvec(inverse, right[..., self.kept])
        right[..., self.own :] = ddw
        a = np.matvec(inverse, (right - measured.drifts(v))[..., self.kept])
        return Rates(v, a, np.abs(inverse).max(axis=(-2, -1), initial=0.0), sense)

    def _matrices(self, measured: EvaluatedRows) -> Array:
        """Return the chosen rows, shape (.., nv, nv)."""
        return np.ascontiguousarray(np.moveaxis(measured.columns[self.kept], (0, 1), (-2, -1)))


def _solved(matrices: Array, right: Array) -> Array:
    """Return x with ``J x = right``, shape (.., nv); no numbers where J is exactly singular."""
    matrices[np.linalg.det(matrices) == 0.0] = np.nan
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])


SHORTEST = 4
"""Smallest number of rows that is tried at once."""

WANTED = 1e-2
"""Correction of a prediction that the length of sweeps aims at [rad or m]."""
KNOWN = 3
"""Accelerations that a prediction is made of: of the rows before, as many as there are since the laws last jumped."""

WORSE = 10.0
"""Largest entry of J^-1, over that where rows of J were chosen, up to which they serve."""

BLOCK = 2048
"""Number of rows that are tried at once at most."""

SIZES = (1e-4, 1e4)
"""Lengths of mechanisms that are solved in metres [m]."""


class Ahead:
    """Sweeps over the rows of one table."""

    def __init__(self, rows: Closure, own: int) -> None:
        self.rows, self.own = rows, own
        self._chosen: BatchClosing | None = None
        self._length = BLOCK

    @classmethod
    def of(cls, closure: Closure, prescribed: PrescribedCoordinates) -> Ahead | None:
        """Return the sweeps of a mechanism; ``None`` where configurations are not numbers, as of ball joints.

        Nor for the very small or large, which only ``NewtonSolver`` measures in a unit of their own.
        """
        if not SIZES[0] < closure.extent < SIZES[1] or closure.model.nq > closure.model.nv:
            return None
        return cls(closure.with_guides(prescribed.names, prescribed.coordinates), closure.size)

    def ahead(self, t: Array, w: Array, q: Array, v: Array, before: Array, a: Array) -> tuple[Array, ...]:
        """Return q, v and a, shape (m, nv), at as many of the instants after the first as surely are on its branch."""
        h, wanted = t[: self._length] - t[0], w[:, : self._length]
        if (chosen := self._chosen_at(q)) is None:
            return ()
        with np.errstate(all="ignore"):  # beyond the branch anything may come out: it is not accepted
            predicted, slope = _predicted(h[:, None], q, v, before, a)
            states = chosen.corrected(predicted, slope, h, wanted)
            n = self._leading(chosen, states.rates, states.near & states.closed)
            self._length = _next_length(n, states.correction, 2 + len(a))
        return (states.q[1:n], states.rates.v[1:n], states.rates.a[1:n]) if n > 1 else ()

    def _chosen_at(self, q: Array) -> BatchClosing | None:
        """Return the rows that determine the motion: the last ones, or else those of a regular configuration."""
        if self._chosen is None:
            self._chosen = BatchClosing.of(self.rows, self.own, self.rows.rows(self.rows.state(q)))
        return self._chosen

    def _leading(self, chosen: BatchClosing, rates: Rates, good: Flags) -> int:
        """Return the number of good rows at the beginning; drop chosen rows that no longer determine the motion."""
        served = (rates.sense == chosen.sense) & (rates.size <= WORSE * chosen.size)
        if not served.all():
            self._chosen = None
        good = good & served
        return len(good) if good.all() else int(good.argmin())


def follow_branch(
    mechanism: Mechanism, prescribed: PrescribedCoordinates, grid: Grid, start: Array
) -> tuple[Array, Array, Array]:
    """Continue the branch that begins near a configuration, shape (nq,): in sweeps, row by row where these cannot."""
    solver, sweep = NewtonSolver(mechanism.closure, prescribed), Ahead.of(mechanism.closure, prescribed)
    t, w = grid.t, np.zeros((3, len(grid.t), len(prescribed.laws)))
    for k, law in enumerate(prescribed.laws):
        w[:, :, k] = grid.evaluate(law)
    q, (v, a) = np.empty((len(t), len(start))), np.empty((2, len(t), solver.model.nv))
    q[0] = solver.assemble(start, w[0, 0], float(t[0]))
    _check_begun(mechanism, prescribed, q[0], float(t[0]))
    v[0], a[0] = solver.rates(q[0], w[1, 0], w[2, 0], t[0])
    before = 0
    for interval, (begin, end, part) in enumerate(grid.intervals()):
        row, target, within = max(part.start, 1), _across(prescribed, grid, before, interval), prescribed.on(begin, end)
        while row < part.stop:
            last, ahead = (q[row - 1], v[row - 1], a[row - 1]), slice(row - 1, part.stop)
            known, states = slice(max(part.start, row - KNOWN), row), tuple[Array, ...]()
            if sweep and row > part.start:
                states = sweep.ahead(t[ahead], w[:, ahead], *last[:2], t[known], a[known])
            states = states or tuple(x[None] for x in solver.advance(*last, t[row - 1], t[row], target))
            rows = slice(row, row + len(states[0]))
            (q[rows], v[rows], a[rows]), row = states, rows.stop
            before, target = interval, within
    return q, v, a


def _across(
    prescribed: PrescribedCoordinates, grid: Grid, first: int, last: int
) -> Callable[[float], tuple[Array, Array, Array]]:
    """Return ``t -> w, w', w''`` on several intervals, by the pieces of the laws on each; the later where two meet."""
    pieces = [prescribed.on(*grid.cuts[k : k + 2]) for k in range(first, last + 1)]
    meetings = grid.cuts[first + 1 : last + 1]
    return lambda t: pieces[bisect_right(meetings, t)](t)


def _check_begun(mechanism: Mechanism, prescribed: PrescribedCoordinates, q: Array, t: float) -> None:
    """Raise where laws do not determine a motion, or it begins at a singular position, beside which they do."""
    closure, laws = mechanism.closure, len(prescribed.names)
    freedom = closure.split_at(q).free.shape[1]
    usual = min(closure.split_at(other).free.shape[1] for other in beside(mechanism, q)) if freedom > laws else freedom
    if usual == laws < freedom:
        raise InputError(
            f"at {instant(t)} the motion begins exactly at a singular position, such as a change point: there the "
            f"mechanism has {freedom} degrees of freedom, beside it {usual}; the motions that meet there obey the same "
            "laws",
            expected=f"a motion that begins beside it, from which it is passed smoothly: {', '.join(prescribed.names)} "
            "from another value",
            hint="a time that starts earlier",
        )
    if freedom != laws:
        raise prescribed.miscounted(mechanism, freedom)


def _predicted(h: Array, q: Array, v: Array, t: Array, a: Array) -> tuple[Array, Array]:
    """Return configurations and velocities ahead, shape (n, nv), by the polynomial through the last accelerations.

    Args:
        h: Times from the last instant [s], shape (n, 1).
        t: The last instants, ascending, at most three, shape (p,).
        a: Accelerations there, shape (p, nv).
    """
    slopes, derivatives = np.diff(a, axis=0) / np.diff(t)[:, None], [a[-1]]
    if len(a) == 2:
        derivatives.append(slopes[0])
    elif len(a) > 2:
        bend = (slopes[1] - slopes[0]) / (t[2] - t[0])
        derivatives += [slopes[1] + (t[2] - t[1]) * bend, 2.0 * bend]
    position, velocity = np.zeros((2, len(h), len(q)))
    for order, derivative in reversed([*enumerate(derivatives, 2)]):  # Horner's scheme, from the highest power down
        position = h / order * (derivative + position)
        velocity = h / (order - 1) * (derivative + velocity)
    return q + h * (v + position), v + velocity


def _next_length(n: int, correction: Array, order: int) -> int:
    """Return the number of rows to try after n good ones; errors of predictions grow with a power of time."""
    last = float(correction[n - 1]) if n else np.inf
    growth = min(max((WANTED / max(last, 1e-300)) ** (1.0 / order), 0.5), 2.0)
    return min(max(int(n * growth), SHORTEST), BLOCK)


STEPS = (1, 4, 16, 64)
"""Numbers of steps that are tried one after the other: the last ones turn a crank by 0.1 rad on a whole turn."""

GROWTH = 4.0
"""Largest ratio of the largest entry of J^-1 before and after a step: beyond it a singular position may be near."""


class StraightWays(Record, frozen=True):
    """Ways from one closed configuration.

    Attributes:
        closing: Newton's method on the constraints, the coordinates and the free motions, which rest.
        start: The configuration, shape (nv,).
        first: Values of coordinates and free motions there, shape (k + f,).
        judged: Joints whose limits count: those that are not given, as indices in q.
    """

    closing: BatchClosing
    start: Array
    first: Array
    judged: list[int]

    @classmethod
    def of(cls, closure: Closure, prescribed: PrescribedCoordinates, start: Array) -> StraightWays | None:
        """Return the ways from a configuration, shape (nq,); ``None`` where states have to be solved one by one.

        Those are mechanisms with ball joints, screws, or sizes far from 1 m, and starts in singular positions.
        """
        solver, model = NewtonSolver(closure, prescribed), closure.model
        if model.nq > model.nv or not solver.sliding.all() or not SIZES[0] < closure.extent < SIZES[1]:
            return None
        state, places = closure.state(start), np.arange(model.nv)
        free = null_space(solver.rows(state)) / solver.scale
        resting = [LinearCoordinate(DIMENSIONLESS, direction, places) for direction in free]
        names = (*prescribed.names, *(f"free motion {k}" for k in range(len(resting))))
        coordinates = (*prescribed.coordinates, *resting)
        whole = closure.holonomic.with_guides(names, coordinates)
        closing = BatchClosing.of(whole, solver.closure.size, whole.rows(state))
        first = np.array([coordinate.value(state) for coordinate in coordinates])
        given = {getattr(coordinate, "joint", None) for coordinate in prescribed.coordinates}
        return None if closing is None else cls(closing, start, first, [q for q in range(model.nq) if q not in given])

    def ends(self, w: Array) -> tuple[Array, Flags]:
        """Return configurations, shape (n, nv), and where they are surely on the branch and within the limits."""
        rest = np.broadcast_to(self.first[w.shape[1] :], (len(w), len(self.first) - w.shape[1]))
        w, q, good = np.hstack([w, rest]), np.tile(self.start, (len(w), 1)), np.zeros(len(w), dtype=bool)
        for steps in STEPS:
            left = np.flatnonzero(~good)
            for part in (left[start : start + BLOCK] for start in range(0, len(left), BLOCK)):
                with np.errstate(all="ignore"):  # beyond the branch anything may come out: it is not accepted
                    q[part], good[part] = self._followed(w[part], steps)
        return q, good

    def _followed(self, w: Array, steps: int) -> tuple[Array, Flags]:
        """Return the ends of ways of some equal steps, and where each of these surely stays on the branch."""
        share, h, model = (w - self.first) / steps, np.ones(len(w)), self.closing.rows.model
        q, good, still = np.tile(self.start, (len(w), 1)), np.ones(len(w), dtype=bool), np.zeros_like(w)
        before, closed = self.closing.rates(self.closing.at(q), share, still), good
        for step in range(1, steps + 1):
            slope, laws = before.v + before.a, np.array([self.first + step * share, share, still])
            states = self.closing.corrected(q + before.v + 0.5 * before.a, slope, h, laws)
            growth = states.rates.size / before.size
            good &= states.near & (states.rates.sense == before.sense) & (growth <= GROWTH) & (growth >= 1.0 / GROWTH)
            q, before, closed = states.q, states.rates, states.closed
        low, high = model.lowerPositionLimit[self.judged], model.upperPositionLimit[self.judged]
        within = (q[:, self.judged] >= low) & (q[:, self.judged] <= high)
        return q, good & closed & within.all(axis=1)
