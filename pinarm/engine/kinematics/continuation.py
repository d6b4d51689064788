"""A branch of solutions through the rows of a table: many rows at once where that is sure, else row by row.

From a solved row, the rows ahead are predicted by its velocity and the last accelerations, and corrected together, as
far ahead as this surely stays on the branch: the prediction is near, every correction is much smaller than the one
before, the velocity is that of a smooth motion, and the determinant of J keeps its sign and a good part of its size.
The next sweep begins where one ends. Rows that are singular or out of reach are left to the steps of ``NewtonSolver``.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.kinematics.batch_closing import BatchClosing, Rates
from pinarm.engine.kinematics.newton import NewtonSolver
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.singular import instant
from pinarm.errors import InputError
from pinarm.mechanics.laws.motion_law import Grid

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


SHORTEST = 4
"""Smallest number of rows that is tried at once."""

WANTED = 1e-2
"""Correction of a prediction that the length of sweeps aims at [rad or m]."""

NOTHING: tuple[Array, ...] = (np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0)))
"""No rows of q, v and a."""

KNOWN = 3
"""Accelerations that a prediction is made of: of the rows before, as many as there are since the laws last jumped."""

WORSE = 10.0
"""Largest entry of J^-1, over that where rows of J were chosen, up to which they serve."""

BLOCK = 2048
"""Number of rows that are tried at once at most."""

SIZES = (1e-4, 1e4)
"""Lengths of mechanisms that are solved in metres [m]."""


class Ahead:
    """Sweeps over the rows of one table.

    Args:
        rows: The constraints, and the prescribed coordinates.
        own: Number m of rows of the constraints.
    """

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
        """Return q, v and a, shape (m, nv), at as many of the instants after the first as surely are on its branch.

        Args:
            t: Instants, of which the first is solved, shape (n,).
            w: Prescribed coordinates and their two derivatives, shape (3, n, k).
            q: Configuration at the first instant, shape (nv,).
            v: Velocity there, shape (nv,).
            before: The last instants up to the first one, at most ``KNOWN``, shape (p,).
            a: Accelerations there, shape (p, nv).
        """
        h, wanted = t[: self._length] - t[0], w[:, : self._length]
        if (chosen := self._chosen_at(q)) is None:
            return NOTHING
        with np.errstate(all="ignore"):  # beyond the branch anything may come out: it is not accepted
            predicted, slope = _predicted(h[:, None], q, v, before, a)
            found = chosen.corrected(predicted, slope, h, wanted)
            n = self._leading(chosen, found.rates, found.near & found.closed)
            self._length = _next_length(n, found.correction, 2 + len(a))
        return found.q[1:n], found.rates.v[1:n], found.rates.a[1:n]

    def rates(self, q: Array, dw: Array, ddw: Array) -> tuple[Array, ...]:
        """Return v and a, shape (m, nv), at as many of the first configurations as surely are regular.

        Args:
            q: Closed configurations, shape (n, nv).
            dw: Velocities of the prescribed coordinates, shape (n, k).
            ddw: Their accelerations, shape (n, k).
        """
        if (chosen := self._chosen_at(q[0])) is None:
            return NOTHING[1:]
        with np.errstate(all="ignore"):
            rates = chosen.rates(chosen.at(q[:BLOCK]), dw[:BLOCK], ddw[:BLOCK])
            n = self._leading(chosen, rates, np.ones(len(rates.v), dtype=bool))
        return rates.v[:n], rates.a[:n]

    def _chosen_at(self, q: Array) -> BatchClosing | None:
        """Return the rows that determine the motion: the last ones, or else those of a regular configuration."""
        if self._chosen is None:
            self._chosen = BatchClosing.of(self.rows, self.own, self.rows.rows(self.rows.state(q)))
        return self._chosen

    def _leading(self, chosen: BatchClosing, rates: Rates, good: Flags) -> int:
        """Return how many rows precede the first one that is not good; forget chosen rows that serve no longer."""
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
    _check_regular(mechanism, prescribed, q[0], float(t[0]))
    prescribed.check_mobility(mechanism, q[0])
    v[0], a[0] = solver.rates(q[0], w[1, 0], w[2, 0], t[0])
    before = 0
    for interval, (begin, end, part) in enumerate(grid.intervals()):
        row, target, within = max(part.start, 1), _across(prescribed, grid, before, interval), prescribed.on(begin, end)
        while row < part.stop:
            last, ahead = (q[row - 1], v[row - 1], a[row - 1]), slice(row - 1, part.stop)
            found, known = NOTHING, slice(max(part.start, row - KNOWN), row)
            if sweep and row > part.start:
                found = sweep.ahead(t[ahead], w[:, ahead], *last[:2], t[known], a[known])
            if not len(found[0]):
                found = tuple(x[None] for x in solver.advance(*last, t[row - 1], t[row], target))
            rows = slice(row, row + len(found[0]))
            (q[rows], v[rows], a[rows]), row = found, rows.stop
            before, target = interval, within
    return q, v, a


def _across(
    prescribed: PrescribedCoordinates, grid: Grid, first: int, last: int
) -> Callable[[float], tuple[Array, Array, Array]]:
    """Return ``t -> w, w', w''`` on several intervals, by the pieces of the laws on each; where they meet, the later.

    Between rows of a table that are far apart a law may have whole pieces.

    Args:
        prescribed: The coordinates with their laws.
        grid: Its cuts bound the intervals.
        first: The first interval.
        last: The last one.
    """
    pieces = [prescribed.on(*grid.cuts[k : k + 2]) for k in range(first, last + 1)]
    meetings = grid.cuts[first + 1 : last + 1]
    return lambda t: pieces[bisect_right(meetings, t)](t)


def _check_regular(mechanism: Mechanism, prescribed: PrescribedCoordinates, q: Array, t: float) -> None:
    """Raise where a motion begins at a singular position of the mechanism, beside which the laws are enough.

    Raises:
        InputError: Several motions meet there, and no law tells them apart.
    """
    closure = mechanism.closure
    freedom = closure.split(closure.rows(closure.state(q))).free.shape[1]
    if freedom <= len(prescribed.names):
        return
    from pinarm.engine.kinematics.closed_configurations import beside

    usual = min(closure.split(closure.rows(closure.state(one))).free.shape[1] for one in beside(mechanism, q))
    if usual == len(prescribed.names):
        raise InputError(
            f"at {instant(t)} the motion begins exactly at a singular position, such as a change point: there the "
            f"mechanism has {freedom} degrees of freedom, beside it {usual}; the motions that meet there obey the same "
            "laws",
            expected=f"a motion that begins beside it, from which it is passed smoothly: {', '.join(prescribed.names)} "
            "from another value",
            hint="a time that starts earlier",
        )


def branch_rates(
    mechanism: Mechanism, prescribed: PrescribedCoordinates, q: Array, dw: Array, ddw: Array
) -> tuple[Array, Array]:
    """Return velocities and accelerations of the joints, shape (n, nv), at closed configurations, shape (n, nq).

    The velocities dw and accelerations ddw of the coordinates have the shape (k,), or (n, k) where they differ.
    """
    solver, sweep = NewtonSolver(mechanism.closure, prescribed), Ahead.of(mechanism.closure, prescribed)
    (v, a), row = np.empty((2, len(q), mechanism.model.nv)), 0
    dw, ddw = (np.broadcast_to(x, (len(q), len(prescribed.names))) for x in (dw, ddw))
    while row < len(q):
        dq, ddq = sweep.rates(q[row:], dw[row:], ddw[row:]) if sweep else NOTHING[1:]
        if not len(dq):
            dq, ddq = (x[None] for x in solver.rates(q[row], dw[row], ddw[row], float(row)))
        rows = slice(row, row + len(dq))
        v[rows], a[rows], row = dq, ddq, rows.stop
    return v, a


def _predicted(h: Array, q: Array, v: Array, t: Array, a: Array) -> tuple[Array, Array]:
    """Return configurations and velocities ahead, shape (n, nv), by the polynomial through the last accelerations.

    Args:
        h: Times from the last instant [s], shape (n, 1).
        q: Configuration there, shape (nv,).
        v: Velocity there, shape (nv,).
        t: The last instants, ascending, at most three, shape (p,).
        a: Accelerations there, shape (p, nv).
    """
    derivatives = [a[-1]]
    if len(a) > 1:
        slopes, steps = np.diff(a, axis=0) / np.diff(t)[:, None], np.diff(t)
        derivatives.append(slopes[-1])
        if len(a) > 2:
            bend = (slopes[1] - slopes[0]) / (t[2] - t[0])
            derivatives = [a[-1], slopes[1] + steps[1] * bend, 2.0 * bend]
    position, velocity = np.zeros((2, len(h), len(q)))
    for order, derivative in reversed([*enumerate(derivatives, 2)]):  # Horner's scheme, from the highest power down
        position = h / order * (derivative + position)
        velocity = h / (order - 1) * (derivative + velocity)
    return q + h * (v + position), v + velocity


def _next_length(n: int, correction: Array, order: int) -> int:
    """Return how many rows to try next, n having been good; errors of predictions grow with a power of time."""
    last = float(correction[n - 1]) if n else np.inf
    growth = min(max((WANTED / max(last, 1e-300)) ** (1.0 / order), 0.5), 2.0)
    return min(max(int(n * growth), SHORTEST), BLOCK)
