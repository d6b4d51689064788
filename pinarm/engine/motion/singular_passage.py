"""Passage of prescribed motions through singular positions: interpolated rows, notes on lost digits, or refusal.

With s the smallest singular value of J (rows of the constraints and of the prescribed coordinates) relative to its
largest in the run, positions are known to eps / s, velocities to eps / s^2 and accelerations to eps / s^3. Rows closer
than s = ``CLOSE`` are interpolated between eight rows of the same motion before and behind, where the interpolated
position closes the loops to rounding. Other close rows have a note, and singular ones are refused.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.kinematics.joint_motion import DeterminedMotion, JointMotion, JointTrajectory
from pinarm.engine.kinematics.singular import instant
from pinarm.errors import AssemblyError, PinarmError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure
    from pinarm.engine.motion.prescribed_motion import Prescription
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.statics.actuation import Actuation

CLOSE, ASIDE = 1e-2, 0.05
"""s below which rows are interpolated, where rounding leaves 2e-10 of accelerations; and the distance of the positions
between which they are [rad]. Of 245 rows of random four-bars at change points, against closed forms, velocities were
known to 3e-12 then, and accelerations to 5e-12; 0.03 rad leaves 5e-11 of these by rounding."""

PLACES = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
WEIGHTS = np.array([-1.0, 8.0, -28.0, 56.0, 56.0, -28.0, 8.0, -1.0]) / 70.0
"""Places of these positions, in ``ASIDE``, and weights of Lagrange's polynomials through them in the middle."""

PASSED = 2e-14
"""Largest loop gap of an interpolated position, relative to the reach of its row: rounding. Where lengths are 1e-13 off
the motion turns beside the singular position, and is another one."""

BALANCED, RESOLVED, UNBOUNDED = 1e-10, 1e-3, 1e-6
"""Residual of the equations of motion up to which interpolated efforts and forces are taken; largest part of it that
forces leave which are solved instead; and residual above which a note says that no forces balance the row."""

RESTING = 1e-3
"""Speed of a drive, relative to that of the joints which it is the sum of, up to which it may be one of rounding."""

MOST, BESIDE = 50, 0.01
"""Singular rows that are left out, one after the other, before a motion is given up; and the largest distance of such a
row from the instant at which steps end, as a part of the interval before it."""

TOLD = 1e-9
"""Loss of digits, relative to the largest value, from which on a note tells it: the digits of a table, and two more."""


def followed(motion: JointMotion, grid: Grid, start: Array) -> tuple[JointTrajectory, Flags]:
    """Return the motion at the rows of a grid that are not singular, and which these are, shape (n,)."""
    kept = np.ones(len(grid.t), dtype=bool)
    while True:
        try:
            return motion.follow(grid if kept.all() else grid.some(np.flatnonzero(kept)), start), kept
        except AssemblyError as error:
            row = _row_near(grid.t, kept, float(error.data.get("t", np.nan)))
            if "gap" in error.data or not row or (~kept).sum() >= MOST:
                raise
            kept &= grid.t != grid.t[row]


def _row_near(t: Array, kept: Flags, at: float) -> int:
    """Return the index of the kept row, at t, shape (n,), close to a singular position at ``at``; 0 if none is."""
    left = np.flatnonzero(kept)
    place = int(np.argmin(np.abs(t[left] - at))) if np.isfinite(at) else 0
    close = place and abs(t[left[place]] - at) <= BESIDE * abs(t[left[place]] - t[left[place - 1]])
    return int(left[place]) if close else 0


def regularity(known: Prescription, q: Array) -> Array:
    """Return the least singular value of J over the largest, of configurations (n, nq) to (n,); 0 without rank."""
    nv = known.mechanism.model.nv
    if not isinstance(known.motion, DeterminedMotion) or nv > MANY:
        return np.ones(len(q))
    values = _whole(known).values(q)
    return np.asarray(values[:, nv - 1] / values[:, 0]) if values.shape[1] >= nv else np.zeros(len(q))


def _whole(known: Prescription) -> Closure:
    prescribed = known.motion.prescribed
    return known.mechanism.closure.with_guides(prescribed.names, prescribed.coordinates)


class SingularPassage(Record, frozen=True):
    """Passage of singular positions of one prescribed motion.

    Attributes:
        t: Values of the parameter at which the motion has been solved, clear of singular positions, shape (n,).
        usual: The largest regularity in the run.
        pace: See ``Prescription.solved``.
    """

    known: Prescription
    t: Array
    q: Array
    usual: float
    pace: Array | None

    @classmethod
    def of(cls, known: Prescription, rows: Trajectory, regular: Array, pace: Array | None) -> SingularPassage | None:
        """Return the passage of a motion, some rows of which are solved; ``None`` where none is interpolated."""
        mechanism, usual = known.mechanism, float(regular.max(initial=0.0))
        if (
            not usual > 0.0
            or not isinstance(known.motion, DeterminedMotion)
            or known.rates is not None
            or known.directed
            or mechanism.model.nv > MANY
            or mechanism.model.nq != mechanism.model.nv
        ):
            return None
        clear = regular > CLOSE * usual
        return cls(known, rows.grid.t[clear], rows.q[clear], usual, pace)

    def at(self, grid: Grid, near: Callable[[Grid], Array]) -> Trajectory:
        """Return the states at values of the parameter, followed from the last clear row before, or from one near."""
        longer, q = grid, None
        first = self._before(float(grid.t[0]), *grid.cuts) if len(grid.cuts) == 2 else None
        if first is not None:
            longer, q = Grid(np.array([self.t[first], *grid.t]), grid.cuts, (0, len(grid.t) + 1)), self.q[first]
        states, kept = followed(self.known.motion, longer, near(grid) if q is None else q)
        rows = self.known.solved(self.known.rows_of(states), self.pace)
        rows, _ = self.through(rows, longer, kept, regularity(self.known, rows.q))
        if len(rows) < len(kept):
            self.known.motion.follow(grid, near(grid))  # raises the error that says what is singular
        return rows if longer is grid else replace(rows.some(np.arange(1, len(rows))), grid=grid)

    def _before(self, t: float, start: float, end: float) -> int | None:
        """Return the last row of an interval that is before a value of the parameter; ``None`` where there is none."""
        ahead = (self.t - start) * np.sign(end - start)
        before = np.flatnonzero((ahead >= 0.0) & (ahead < (t - start) * np.sign(end - start)))
        return int(before[ahead[before].argmax()]) if len(before) else None

    def through(self, rows: Trajectory, grid: Grid, kept: Flags, regular: Array) -> tuple[Trajectory, Flags]:
        """Return all rows of a grid, and which of them are interpolated, shape (n,).

        Those that are neither known nor can be interpolated are left out. ``kept`` tells which of the grid's
        rows are known, ``regular`` the regularity at these.
        """
        wanted, interpolated = ~kept, {}
        wanted[kept] = regular <= CLOSE * self.usual
        for start, end, part in grid.intervals() if wanted.any() else ():
            for row in (np.flatnonzero(wanted[part]) + part.start).tolist():
                if (single := self._between(float(grid.t[row]), start, end)) is not None:
                    interpolated[row] = single
        if not interpolated:
            return rows, np.zeros(len(rows), dtype=bool)
        places, taken = np.cumsum(kept) - 1, [row for row in range(len(kept)) if kept[row] or row in interpolated]

        def joined(array: Callable[[Trajectory], Array]) -> Array:
            known = array(rows)
            return np.array(
                [array(interpolated[row])[0] if row in interpolated else known[places[row]] for row in taken]
            )

        arrays = {name: joined(attrgetter(name)) for name in ("q", "v", "a", "tau", "lam")}
        return replace(rows, grid=grid.some(np.array(taken)), **arrays), np.isin(taken, [*interpolated])

    def _between(self, t: float, start: float, end: float) -> Trajectory | None:
        """Return the row at a value of the parameter, within an interval; ``None`` where it cannot be interpolated."""
        if (beside := self._beside(t, start, end)) is None:
            return None
        arrays = {name: (WEIGHTS @ getattr(beside, name))[None] for name in ("q", "v", "a", "tau", "lam")}
        grid = Grid(np.array([t]), (start, end), (0, 1))
        row, whole = replace(beside.some(np.arange(1)), grid=grid, **arrays), _whole(self.known)
        gap = whole.gap(whole.state(row.q[0]))
        wanted = [float(row.grid.evaluate(law)[0][0]) for law in self.known.motion.laws]
        gap[len(gap) - len(wanted) :] -= wanted
        return self._balanced(row) if (np.abs(gap) <= PASSED * whole.reach).all() else None

    def _balanced(self, row: Trajectory) -> Trajectory | None:
        """Return an interpolated row with efforts and forces that balance it; ``None`` where there are none.

        Towards a singular position forces of loops may grow beyond all bounds, and loads may change within a stretch:
        they are solved at the interpolated position. In the singular position itself only the effort of a single drive
        is known then, by its power.
        """
        if self.known.drives is None or (left := _residual(row)) <= BALANCED:
            return row
        driven = _driven(row, self.known.drives)
        with suppress(PinarmError):
            solved = self.known.solved(row, self.pace) if driven is None else _held(driven)
            if _residual(solved) <= RESOLVED * left:
                return solved
        return driven

    def _beside(self, t: float, start: float, end: float) -> Trajectory | None:
        """Return the motion at ``PLACES`` about a value of the parameter; ``None`` where one of them is not regular."""
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
                return self.known.solved(beside, self.pace)
        return None

    def _step(self, t: float, start: float, end: float, row: int) -> float:
        """Return the part of the parameter in which the mechanism moves by ``ASIDE``; 0 where it stands still."""
        states = self.known.motion.follow(Grid(np.array([t]), (start, end), (0, 1)), self.q[row])
        speed = float(np.abs(states.v / self.known.mechanism.closure.scale).max())
        return ASIDE / speed if speed else 0.0


def lost_digits(rows: Trajectory, regular: Array) -> list[str]:
    """Return the note on the row nearest to a singular position, where rounding leaves less than ``TOLD``.

    ``regular`` is the regularity of the rows, shape (n,).
    """
    if not len(rows):
        return []
    row, usual = int(regular.argmin()), float(regular.max()) if len(rows) > 1 and not rows.separate else 1.0
    s, eps = float(regular[row]) / (usual or 1.0), float(np.finfo(float).eps) * rows.mechanism.closure.coarseness
    moves = bool(rows.v.any() or rows.a.any())
    known: dict[str, float] = {"positions": eps / max(s, eps), "velocities": moves * eps / max(s, eps) ** 2}
    known["accelerations"] = moves * eps / max(s, eps) ** 3
    known["efforts and forces"] = 0.0 if rows.no_efforts else eps / max(s, eps) ** (3 if moves else 2)
    parts = [f"{what} {f'to {x:.1g}' if x < 1.0 else 'not at all'}" for what, x in known.items() if x > TOLD]
    if s > CLOSE or not parts:
        return []
    return [
        f"at {instant(float(rows.grid.t[row]))}, next to a singular position, rounding of positions is magnified, "
        f"which no residual shows: known are about {', '.join(parts)}, relative to their largest"
    ]


def unbounded_notes(rows: Trajectory) -> list[str]:
    """Return a note on interpolated rows that no finite forces of the loops balance."""
    times = [float(t) for row, t in enumerate(rows.grid.t) if _residual(rows.some(np.array([row]))) > UNBOUNDED]
    if not times:
        return []
    more = f", as in {len(times) - 1} more rows" if len(times) > 1 else ""
    return [
        f"at {instant(times[0])}{more}, a singular position, no finite forces of the loops balance the motion, which "
        "equilibrium shows: towards it they grow beyond all bounds. The efforts of the drives balance its power"
    ]


def _driven(row: Trajectory, drives: Actuation) -> Trajectory | None:
    """Return a row with the effort of one drive that balances the power; ``None`` of several, or where it rests."""
    coordinate, *others = drives.coordinates(row.mechanism).values()
    along, v = coordinate.row(row.mechanism.closure.state(row.q[0])), row.v[0]
    speed = float(along @ v)
    if others or abs(speed) <= RESTING * float(np.abs(along) @ np.abs(v)):
        return None
    missing, own, lam = float(_balance(row)[0] @ v) / speed, row.mechanism.closure.size, row.lam
    if row.closure.size == own:
        return replace(row, tau=row.tau + missing * along)
    return replace(row, lam=np.hstack([lam[:, :own], lam[:, own:] + missing]))


def _held(row: Trajectory) -> Trajectory:
    along = row.lam[:, row.mechanism.closure.size :]
    return replace(row, lam=row.closure.multipliers(row.q, row.demand() - row.tau, along))


def _residual(row: Trajectory) -> float:
    """Return the residual of a row's equations of motion, relative to the largest terms of joints that are tied."""
    left, terms = (part * row.closure.scale for part in _balance(row))
    largest, groups = np.zeros_like(terms), row.closure.groups
    np.maximum.at(largest, groups, terms)
    return float((np.abs(left) / np.maximum(largest[groups], np.finfo(float).tiny)).max())


def _balance(row: Trajectory) -> tuple[Array, Array]:
    """Return the residual ``M a + nle - loads - tau - G^T lam`` of a row, and the sizes of its terms, both (nv,)."""
    demand, lam, rows = row.demand()[0], row.lam[0], row.closure.at(row.q)[1][0]
    return demand - row.tau[0] - lam @ rows, np.abs(demand) + np.abs(row.tau[0]) + np.abs(lam) @ np.abs(rows)
