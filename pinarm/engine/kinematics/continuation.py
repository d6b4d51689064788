"""A branch of solutions through the rows of a table: many at once where that is sure, or one after the other.

The equations are those of ``engine.following``; ``engine.sweeps`` solves many rows, ``engine.assembly`` single ones.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.abscissa import instant
from pinarm.engine.kinematics.continuation_batch import KNOWN, NOTHING, BatchContinuation
from pinarm.engine.kinematics.newton import NewtonSolver
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.errors import InputError
from pinarm.mechanics.laws.motion_law import Grid

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


def follow_branch(
    mechanism: Mechanism, prescribed: PrescribedCoordinates, grid: Grid, start: Array
) -> tuple[Array, Array, Array]:
    """Continue the branch that begins near a configuration, shape (nq,): in sweeps, row by row where these cannot."""
    solver, sweep = NewtonSolver(mechanism.closure, prescribed), BatchContinuation.of(mechanism.closure, prescribed)
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
    """Return velocities and accelerations at closed configurations; see ``following.joint_rates``."""
    solver, sweep = NewtonSolver(mechanism.closure, prescribed), BatchContinuation.of(mechanism.closure, prescribed)
    (v, a), row = np.empty((2, len(q), mechanism.model.nv)), 0
    while row < len(q):
        dq, ddq = sweep.rates(q[row:], dw, ddw) if sweep else NOTHING[1:]
        if not len(dq):
            dq, ddq = (x[None] for x in solver.rates(q[row], dw, ddw, float(row)))
        rows = slice(row, row + len(dq))
        v[rows], a[rows], row = dq, ddq, rows.stop
    return v, a
