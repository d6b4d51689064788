"""Rows of prescribed motions at singular positions that are passed, such as change points, from both sides of them.

There rounding leaves little of velocities and nothing of accelerations and forces (``rounded_positions``), and at the
position itself they are not determined row by row. The motion through it is smooth nevertheless. So a row is
interpolated between eight of the same motion before and behind it, as free motions are (``systems.point_motion``).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.kinematics.abscissa import instant
from pinarm.engine.kinematics.joint_motion import DeterminedMotion, JointMotion, JointTrajectory
from pinarm.errors import AssemblyError, PinarmError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure
    from pinarm.engine.motion.prescribed_motion import Prescription
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation

CLOSE, ASIDE = 1e-2, 0.05
"""Least singular value of J, relative to the largest, and this to its largest in the run, below which rows are
interpolated, where rounding leaves 2e-10 of accelerations; and the distance of the positions between which they are
[rad]. Of 245 rows of random four-bars at change points, against closed forms, velocities were then known to 3e-12 and
accelerations to 5e-12; 0.03 rad leaves 5e-11 of these by rounding."""

PLACES = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
"""Places of these positions, in ``ASIDE``."""

PASSED = 2e-14
"""Gap of an interpolated position, relative to the reach of its row, up to which it is one of the motion: rounding.
Where lengths are 1e-13 off the motion turns beside the singular position, and is another one."""

BALANCED, SMOOTH = 1e-10, 1e-7
"""Residual of the equations of motion up to which interpolated efforts and forces are taken; part of the largest
efforts beside it by which those through six of the eight places may differ, where those of all are known to 1e-9."""

RESOLVED, UNBOUNDED = 1e-3, 1e-6
"""Part of that residual which forces that are solved leave at most, large ones their rounding; residual from which on
it is noted that there are none."""

RESTING = 1e-3
"""Speed of a drive, relative to that of the joints which it is the sum of, up to which it may be one of rounding."""

APART = 0.3
"""The same, above which the nearest row of a table tells the branch: that of four-bars 0.3 rad from change points."""

MOST, BESIDE = 50, 0.01
"""Rows at singular positions that are left out, one after the other, before a motion is given up; how far such a row is
from where steps towards it end, as a part of the way from the row before."""


def followed(motion: JointMotion, grid: Grid, start: Array) -> tuple[JointTrajectory, Flags]:
    """Return the motion at the rows of a grid that are not at singular positions, and which these are, shape (n,).

    Raises:
        AssemblyError: A position cannot be reached, or the first one is singular.
    """
    kept = np.ones(len(grid.t), dtype=bool)
    while True:
        try:
            return motion.follow(grid.some(np.flatnonzero(kept)) if not kept.all() else grid, start), kept
        except AssemblyError as error:
            row = _row_near(grid.t, kept, float(error.data.get("t", np.nan)))
            if "gap" in error.data or not row or (~kept).sum() >= MOST:
                raise
            kept &= grid.t != grid.t[row]


def _row_near(t: Array, kept: Flags, at: float) -> int:
    """Return which of the rows that are left, at t, shape (n,), is next to a singular position; 0 for none of them."""
    left = np.flatnonzero(kept)
    place = int(np.argmin(np.abs(t[left] - at))) if np.isfinite(at) else 0
    close = place and abs(t[left[place]] - at) <= BESIDE * abs(t[left[place]] - t[left[place - 1]])
    return int(left[place]) if close else 0


class PassedPositions(Record, frozen=True):
    """How singular positions of a prescribed motion are passed.

    Attributes:
        known: What is prescribed.
        t: Values of the parameter at which it has been solved, clear of singular positions, shape (n,).
        q: Configurations there, shape (n, nq).
        regular: How regular J is there, shape (n,).
        usual: How regular it is at the best of them.
        pace: See ``Prescription.solved``.
    """

    known: Prescription
    t: Array
    q: Array
    regular: Array
    usual: float
    pace: Array | None

    @classmethod
    def of(cls, known: Prescription, rows: Trajectory, regular: Array, pace: Array | None) -> PassedPositions | None:
        """Return how those of a motion are passed, of which some rows are solved; ``None`` where they are not.

        Args:
            known: What is prescribed.
            rows: The rows.
            regular: How regular J is there, shape (n,).
            pace: See ``Prescription.solved``.
        """
        if not _interpolated(known):
            return None
        usual = float(regular.max(initial=0.0))
        if not usual > 0.0:
            return None
        clear = regular > CLOSE * usual
        return cls(known, rows.grid.t[clear], rows.q[clear], regular[clear], usual, pace)

    def at(self, grid: Grid, near: Callable[[Grid], Array]) -> Trajectory:
        """Return the states at values of the parameter, on the branch of a configuration that is near the first.

        Raises:
            AssemblyError: A position cannot be reached, or is singular and not passed smoothly.
        """
        longer, q, found = grid, None, self._beginning_before(grid)
        if found is not None and self._ambiguous(grid):
            longer, q = found
        try:
            states, kept = followed(self.known.motion, longer, near(grid) if q is None else q)
        except PinarmError:  # the first one is singular
            if found is None or q is not None:
                raise
            longer, q = found
            states, kept = followed(self.known.motion, longer, q)
        rows = self.known.solved(self.known.rows_of(states), self.pace)
        rows, _ = self.through(rows, longer, kept, regularity(self.known, rows.q))
        if len(rows) < len(kept):
            self.known.motion.follow(grid, near(grid))  # which says what is singular
        return rows if longer is grid else replace(rows.some(np.arange(1, len(rows))), grid=grid)

    def _ambiguous(self, grid: Grid) -> bool:
        """Tell whether branches are so close that a row near the first of a grid does not tell on which it is."""
        nearest = int(np.abs(self.t - grid.t[0]).argmin())
        return bool(self.regular[nearest] < APART * self.usual)

    def _beginning_before(self, grid: Grid) -> tuple[Grid, Array] | None:
        """Return a grid of one interval with a row before that is clear of singular positions, and what is there."""
        if len(grid.cuts) > 2 or (first := self._before(float(grid.t[0]), *grid.cuts)) is None:
            return None
        return Grid(np.array([self.t[first], *grid.t]), grid.cuts, (0, len(grid.t) + 1)), self.q[first]

    def _before(self, t: float, start: float, end: float) -> int | None:
        """Return the last row of an interval that is before a value of the parameter; ``None`` where there is none."""
        ahead = (self.t - start) * np.sign(end - start)
        before = np.flatnonzero((ahead >= 0.0) & (ahead < (t - start) * np.sign(end - start)))
        return int(before[ahead[before].argmax()]) if len(before) else None

    def through(self, rows: Trajectory, grid: Grid, kept: Flags, regular: Array) -> tuple[Trajectory, Flags]:
        """Return all rows of a grid, of which some are known, and which of them are interpolated, shape (n,).

        Those that are neither known nor can be interpolated are left out.

        Args:
            rows: Those that are known.
            grid: The grid.
            kept: Which of its rows these are, shape (n,).
            regular: How regular J is at them.
        """
        wanted, found = ~kept, {}
        wanted[kept] = regular <= CLOSE * self.usual
        for start, end, part in grid.intervals() if wanted.any() else ():
            for row in (np.flatnonzero(wanted[part]) + part.start).tolist():
                if (one := self._between(float(grid.t[row]), start, end)) is not None:
                    found[row] = one
        if not found:
            return rows, np.zeros(len(rows), dtype=bool)
        places, taken = np.cumsum(kept) - 1, [row for row in range(len(kept)) if kept[row] or row in found]

        def joined(arrays: Callable[[Trajectory], Array]) -> Array:
            known = arrays(rows)
            return np.array([arrays(found[row])[0] if row in found else known[places[row]] for row in taken])

        whole = replace(
            rows, grid=grid.some(np.array(taken)), q=joined(lambda one: one.q), v=joined(lambda one: one.v),
            a=joined(lambda one: one.a), tau=joined(lambda one: one.tau),
            lam=Multipliers.known(joined(lambda one: np.asarray(one.lam)), rows.mechanism.closure.size),
        )  # fmt: skip
        return whole, np.isin(taken, [*found])

    def _between(self, t: float, start: float, end: float) -> Trajectory | None:
        """Return the row at a value of the parameter, within an interval; ``None`` where it cannot be interpolated."""
        stretch = next((one for one in self._stretches if one.covers(t, (start, end))), None)
        if stretch is None:
            if (stretch := self._stretch(t, start, end)) is None:
                return None
            self._stretches.append(stretch)
        one, whole = stretch.row(t), _whole(self.known)
        gap = whole.gap(whole.state(one.q[0]))
        wanted = [float(one.grid.evaluate(law)[0][0]) for law in self.known.motion.laws]
        gap[len(gap) - len(wanted) :] -= wanted
        return self._balanced(one, stretch) if (np.abs(gap) <= PASSED * whole.reach).all() else None

    def _balanced(self, one: Trajectory, stretch: _Stretch) -> Trajectory | None:
        """Return an interpolated row with efforts and forces that balance it; ``None`` where there are none.

        Towards a singular position forces of loops may grow beyond all bounds, and loads may change within a stretch.
        These are solved at the interpolated position. In the singular position itself there are no such forces, and
        ``Reactions`` tells none; efforts that go smoothly through it, and that of a single drive, are known there as
        well.
        """
        if self.known.drives is None or (left := _residual(one)) <= BALANCED:
            return one
        driven = _driven(one, self.known.drives) or (one if stretch.smooth(float(one.grid.t[0])) else None)
        with suppress(PinarmError):
            found = self.known.solved(one, self.pace) if driven is None else _held(driven)
            if _residual(found) <= RESOLVED * left:
                return found
        return driven

    @cached_property
    def _stretches(self) -> list[_Stretch]:
        """Those that have been looked at."""
        return []

    def _stretch(self, t: float, start: float, end: float) -> _Stretch | None:
        """Return the motion about a value of the parameter; ``None`` where it cannot be had at both sides."""
        way, first = np.sign(end - start), self._before(t, start, end)
        step = 0.0 if first is None else self._step(float(self.t[first]), start, end, first)
        times = t + way * step * PLACES
        if not step or (times[0] - start) * way < 0.0 or (end - times[-1]) * way < 0.0:
            return None
        if (first := self._before(float(times[0]), start, end)) is None:
            return None
        grid = Grid(np.array([self.t[first], *times]), (start, end), (0, 9))
        with suppress(PinarmError):
            beside = self.known.moving(grid, self.q[first]).some(np.arange(1, 9))
            if (regularity(self.known, beside.q) > CLOSE * self.usual).all():
                return _Stretch(t, float(way * step), self.known.solved(beside, self.pace))
        return None

    def _step(self, t: float, start: float, end: float, row: int) -> float:
        """Return in which part of the parameter the mechanism moves by ``ASIDE``; 0 where it stands still."""
        states = self.known.motion.follow(Grid(np.array([t]), (start, end), (0, 1)), self.q[row])
        speed = float(np.abs(states.v / self.known.mechanism.closure.scale).max())
        return ASIDE / speed if speed else 0.0


class _Stretch(Record, frozen=True):
    """A motion about a singular position.

    Attributes:
        t: Value of the parameter in the middle.
        step: Difference of the parameter from one place to the next; negative where it falls.
        beside: The motion at ``PLACES``.
    """

    t: float
    step: float
    beside: Trajectory

    def covers(self, t: float, cuts: tuple[float, float]) -> bool:
        """Tell whether a value of the parameter within an interval is between the two places in the middle."""
        return self.beside.grid.cuts == cuts and abs(t - self.t) < abs(self.step)

    def smooth(self, t: float) -> bool:
        """Tell whether efforts can be interpolated at a value of the parameter: fewer places tell the same."""
        tau, inner = self.beside.tau, slice(1, -1)
        apart = self._weights(t, PLACES) @ tau - self._weights(t, PLACES[inner]) @ tau[inner]
        return bool((np.abs(apart) <= SMOOTH * np.abs(tau).max(axis=0)).all())

    def _weights(self, t: float, places: Array) -> Array:
        """Return the weights of places at a value of the parameter, by Lagrange's polynomials, shape (k,)."""
        ways, apart = (t - self.t) / self.step - places, places[:, None] - places
        others = ~np.eye(len(places), dtype=bool)
        return np.asarray(
            np.prod(np.broadcast_to(ways, others.shape), where=others, axis=1) / np.prod(apart, where=others, axis=1)
        )

    def row(self, t: float) -> Trajectory:
        """Return the row at a value of the parameter that it covers."""
        weights, run = self._weights(t, PLACES), self.beside
        q, v, a, tau, forces = ((weights @ x)[None] for x in (run.q, run.v, run.a, run.tau, np.asarray(run.lam)))
        lam = Multipliers.known(forces, run.mechanism.closure.size)
        grid = Grid(np.array([t]), run.grid.cuts, (0, 1))
        return replace(run.some(np.arange(1)), grid=grid, q=q, v=v, a=a, tau=tau, lam=lam)


def unbounded_notes(rows: Trajectory) -> list[str]:
    """Return what is to be said of interpolated rows that no forces of the loops balance."""
    found = [float(t) for row, t in enumerate(rows.grid.t) if _residual(rows.some(np.array([row]))) > UNBOUNDED]
    if not found:
        return []
    more = f", as in {len(found) - 1} more rows" if len(found) > 1 else ""
    return [
        f"at {instant(found[0])}{more}, a singular position, no finite forces of the loops balance the motion, which "
        "equilibrium shows: towards it they grow beyond all bounds. The efforts of the drives balance its power"
    ]


def _driven(one: Trajectory, drives: Actuation) -> Trajectory | None:
    """Return a row with the effort of one drive that balances the power; ``None`` of several, or where it rests."""
    coordinate, *others = drives.coordinates(one.mechanism).values()
    row, v = coordinate.row(one.mechanism.closure.state(one.q[0])), one.v[0]
    speed = float(row @ v)
    if others or abs(speed) <= RESTING * float(np.abs(row) @ np.abs(v)):
        return None
    missing, own, lam = float(_balance(one)[0] @ v) / speed, one.mechanism.closure.size, np.asarray(one.lam)
    if one.closure.size == own:
        return replace(one, tau=one.tau + missing * row)
    return replace(one, lam=Multipliers.known(np.hstack([lam[:, :own], lam[:, own:] + missing]), own))


def _held(one: Trajectory) -> Trajectory:
    """Return a row with the least multipliers that hold what its efforts do not."""
    along = np.asarray(one.lam)[:, one.mechanism.closure.size :]
    return replace(one, lam=Multipliers.least(one.closure, one.q, _demand(one) - one.tau, along))


def _residual(one: Trajectory) -> float:
    """Return the residual of a row's equations of motion, relative to the largest terms of joints that are tied."""
    left, terms = (part * one.closure.scale for part in _balance(one))
    largest, groups = np.zeros_like(terms), one.closure.groups
    np.maximum.at(largest, groups, terms)
    return float((np.abs(left) / np.maximum(largest[groups], np.finfo(float).tiny)).max())


def _balance(one: Trajectory) -> tuple[Array, Array]:
    """Return what a row's efforts and forces leave of ``M a + nle - loads``, and the sizes of all terms, both (nv,)."""
    demand, lam, rows = _demand(one)[0], np.asarray(one.lam)[0], one.closure.at(one.q)[1][0]
    return demand - one.tau[0] - lam @ rows, np.abs(demand) + np.abs(one.tau[0]) + np.abs(lam) @ np.abs(rows)


def _demand(one: Trajectory) -> Array:
    """Return ``M a + nle - loads`` of a row, shape (1, nv)."""
    t, q, v, a = one.grid.t, one.q, one.v, one.a
    return one.gather(lambda dynamics, part: dynamics.inverse(t[part], q[part], v[part], a[part]))


def _interpolated(known: Prescription) -> bool:
    """Tell whether rows of a motion may be interpolated: its own velocities, no friction, joints of one coordinate."""
    mechanism = known.mechanism
    return (
        bool(mechanism.closure.size) and isinstance(known.motion, DeterminedMotion) and known.rates is None
        and not known.directed and mechanism.model.nv <= MANY and mechanism.model.nq == mechanism.model.nv
    )  # fmt: skip


def _whole(known: Prescription) -> Closure:
    """Return the constraints of a motion, and what is prescribed."""
    prescribed = known.motion.prescribed
    return known.mechanism.closure.with_guides(prescribed.names, prescribed.coordinates)


def regularity(known: Prescription, q: Array) -> Array:
    """Return the least singular value of J over the largest, of configurations (n, nq) to (n,); 0 without rank."""
    values = _whole(known).values(q)
    nv = known.mechanism.model.nv
    return np.asarray(values[:, nv - 1] / values[:, 0]) if values.shape[1] >= nv else np.zeros(len(q))
