"""A motion that was recorded: its rows come from a measurement or from another program, and are not solved for.

What is not given is not known: velocities and accelerations are NaN then, and quantities of them are refused. A spline
gives them where it is asked for: of degree 5 through the positions, "not a knot" at its ends, so that accelerations are
smooth. Of a ball joint it runs through the components of the quaternion s, and with ``s*`` its conjugate

    w  = 2 vec(s* s') / |s|^2                          angular velocity in the axes of the link
    w' = 2 vec(s* s'') / |s|^2 - 2 w (s . s') / |s|^2

Friction and losses of gears need the direction of the motion. Velocities and accelerations of a spline are not known to
rounding but to its error: where a velocity is below it, the joint stands still, as far as the spline can tell. The
error is the largest difference to the spline through every second row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import slides
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.known_motion import rest_notes, with_efforts
from pinarm.engine.motion.outcome import Outcome, SolvedMotion
from pinarm.engine.motion.standstill import STANDSTILL, Beside, directions, lossy, row_paces
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.statics.actuation import Actuation
    from pinarm.mechanics.ball_joints import Ball

DEGREE = 5
"""Degree of the spline: its accelerations err by ``O(h^4)`` for rows h apart."""

MARGIN = 4.0
"""Largest error over the difference of two splines, both of which have it."""

FEWEST = 2 * (DEGREE + 1)
"""Rows that it takes to leave every second one out, for the estimate of its error."""

NO_DRIVES = "the mechanism has loops, and neither efforts nor drives are given that carry the load"


@dataclass(frozen=True, eq=False)
class RecordedRows:
    """Rows of a motion in pinarm's convention; what is not known of them is ``None``.

    Attributes:
        t: Instants [s], not descending, shape (n,).
        tau: Efforts of the drives at the joints [N*m or N], shape (n, nv).
    """

    t: Array
    q: Array
    v: Array | None = None
    a: Array | None = None
    tau: Array | None = None

    @property
    def unknown(self) -> str:
        """Sentence on missing velocities or accelerations; empty if both are known."""
        if self.v is None:
            return "the velocities of this motion are not given"
        return "the accelerations of this motion are not given" if self.a is None else ""


@dataclass(frozen=True, eq=False)
class Recording:
    """A mechanism, what carries the load where efforts are not given, if known, and all forces of the run."""

    mechanism: Mechanism
    drives: Actuation | None
    dynamics: Dynamics

    def outcome(self, rows: RecordedRows) -> Outcome:
        """Return the table of rows as they are given, and how well its derivatives belong together."""
        grid = self._grid(rows.t)
        beside = self._beside(rows, grid)
        table = replace(self.table(rows, grid, beside), sampled=True)
        notes = (*rest_notes(table, beside.pace),) if beside else ()
        return Outcome(table, figures=consistency(self.mechanism, rows), notes=notes)

    def splined(self, rows: RecordedRows) -> Outcome:
        """Return the table of rows with the derivatives of their spline, and how well it knows them."""
        spline, grid = QuinticSpline.through(self.mechanism, rows.t, rows.q), self._grid(rows.t)
        v, a = spline.at(rows.t)[1:]
        beside = spline.beside(grid)
        table = self.table(replace(rows, v=v, a=a), grid, beside)
        motion = SplinedMotion(self, spline, rows.t, table.grid.cuts) if rows.tau is None else None
        notes = (*rest_notes(table, beside.pace),)
        return Outcome(replace(table, sampled=motion is None), motion, spline.figures(), notes=notes)

    def schema_row(self, row: RecordedRows) -> Trajectory:
        grid = Grid(row.t, (0.0, 0.0), (0, 1))
        return self.table(row, grid, self._beside(row, grid))

    def _beside(self, rows: RecordedRows, grid: Grid) -> Beside | None:
        """Return the data on directions of given rows, all of one motion; ``None`` where it is not known."""
        if rows.v is None or rows.a is None:
            return None
        h = np.diff(rows.t)
        ends = np.append(h == 0.0, False) & np.insert(h > 0.0, 0, False)
        side = np.where(ends, -1.0, grid.sides())
        next_to = np.clip(np.arange(len(side)) + side.astype(int), 0, len(side) - 1)
        return Beside(row_paces(self.mechanism, rows.v, rows.a).max(axis=0), side, rows.v[next_to])

    def table(self, rows: RecordedRows, grid: Grid, beside: Beside | None) -> Trajectory:
        """Return rows as a table, with the directions and efforts that belong to them as far as these are known.

        Efforts and forces in loops are those of the closed positions nearest to the rows, since constraints that repeat
        others do so only there: by rows with six digits a linkage with one would be a truss that carries any load.
        """
        return replace(self._table(replace(rows, q=self._closed(rows)), grid, beside), q=rows.q)

    def _closed(self, rows: RecordedRows) -> Array:
        """Return closed configurations next to rows that are open by more than changes no rank, shape (n, nq)."""
        closure, q = self.mechanism.closure, rows.q.copy()
        if not closure.size or rows.a is None:
            return q
        for k in np.flatnonzero((np.abs(closure.at(q)[0]) > closure.slack).any(axis=1)).tolist():
            q[k] = assembled(closure, PrescribedCoordinates((), (), ()), q[k], np.zeros(0), float(rows.t[k]))
        return q

    def _table(self, rows: RecordedRows, grid: Grid, beside: Beside | None) -> Trajectory:
        mechanism = self.mechanism
        nothing = np.full((len(rows.t), mechanism.model.nv), np.nan)
        v, a = (nothing if x is None else x for x in (rows.v, rows.a))
        closure = mechanism.closure if self.drives is None or rows.tau is not None else self.drives.closure
        lam, still = np.zeros((len(rows.t), closure.size)), np.zeros_like(nothing)
        run = Trajectory(mechanism, "t", unit("s"), grid, rows.q, v, a, still, lam, closure, self.dynamics,
                         separate=True, unknown=rows.unknown, remedy="derivatives: spline")  # fmt: skip
        if beside is None:
            return replace(run, no_efforts=rows.unknown)
        if lossy(mechanism):
            run = replace(run, directions=directions(v, a, *beside))
        if rows.tau is not None:
            held = closure.multipliers(rows.q, run.demand() - rows.tau)
            return replace(run, tau=rows.tau, lam=held)
        if self.drives is None:
            return replace(run, no_efforts=NO_DRIVES)
        run = replace(run, driven=self.drives.driven, drives=(*self.drives.coordinates(mechanism),))
        if mechanism.frictions:
            run = replace(run, rate_errors=STANDSTILL * np.broadcast_to(beside.pace[..., 0, :], run.v.shape))
        return with_efforts(run, self.drives, beside)

    def _grid(self, t: Array) -> Grid:
        """Return the rows between the breakpoints of the forces' laws; a row at one belongs to what follows it."""
        laws = [law for force in self.dynamics.forces.values() for law in force.laws()]
        breaks = {*(x for law in laws for x in (*law.breakpoints(), *law.jumps()))}
        cuts = sorted(x for x in breaks if t[0] < x < t[-1])
        starts = np.searchsorted(t, cuts).tolist()
        return Grid(t, (float(t[0]), *cuts, float(t[-1])), (0, *starts, len(t)))


@dataclass(frozen=True, eq=False)
class QuinticSpline:
    """A spline through configurations at instants; see the module's docstring."""

    mechanism: Mechanism
    t: Array
    q: Array

    @classmethod
    def through(cls, mechanism: Mechanism, t: Array, q: Array) -> QuinticSpline:
        """Return the spline through rows."""
        if len(t) < FEWEST:
            raise InputError(
                f"{len(t)} rows are too few for a spline of degree {DEGREE} and its error",
                expected=f"at least {FEWEST}",
            )
        if (np.diff(t) == 0.0).any():
            row = int((np.diff(t) == 0.0).argmax())
            raise InputError(
                f"the rows {row} and {row + 1} have the same instant, {t[row]:.9g} s",
                expected="ascending instants, as a spline has no jumps",
            )
        for joint in mechanism.joints.values():
            steps = np.abs(np.diff(q[:, joint.q]))
            if joint.unit != METRE and steps.max() > np.pi:
                row = int(steps.argmax())
                raise InputError(
                    f"'{joint.name}' jumps by {steps[row]:.3g} rad from row {row} to row {row + 1}",
                    expected="angles whose turns are counted",
                    hint="np.unwrap(q, axis=0)",
                )
        return cls(mechanism, t, _continuous(mechanism, q))

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.t, self.q, k=DEGREE)

    @cached_property
    def _places(self) -> Indices:
        """Positions whose rates are the velocities, but for those of ball joints, shape (nv,)."""
        joints = list(self.mechanism.model.joints)[1:]
        return np.concatenate([np.arange(joint.idx_q, joint.idx_q + joint.nv) for joint in joints])

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        s, rate, second = (self._spline(t, order) for order in range(3))
        q, v, a = s.copy(), rate[:, self._places], second[:, self._places]
        for ball in self.mechanism.balls.values():
            spin, growth = _spin(ball, s, rate, second)
            ball.vectors(v)[:], ball.vectors(a)[:] = spin, growth
            ball.quaternion(q)[:] /= np.linalg.norm(ball.quaternion(s), axis=1, keepdims=True)
        return q, v, a

    @cached_property
    def _known(self) -> tuple[Array, Array]:
        """Velocities and accelerations, and by how much they differ from those of a spline through every second row.

        At all rows, both of shape (2, n, nv); the other spline has the last row, too.
        """
        last = len(self.t) - 1
        kept = np.append(np.arange(0, last, 2), last)
        coarse = replace(self, t=self.t[kept], q=self.q[kept])
        fine = np.array(self.at(self.t)[1:])
        return fine, fine - np.array(coarse.at(self.t)[1:])

    @cached_property
    def pace(self) -> Array:
        """Scale of rounding of v and a, shape (2, nv): ``STANDSTILL`` times it covers their errors."""
        fine, errors = self._known
        return np.asarray(np.maximum(
            row_paces(self.mechanism, *fine).max(axis=0), MARGIN * np.abs(errors).max(axis=1) / STANDSTILL
        ))  # fmt: skip

    def beside(self, grid: Grid) -> Beside:
        """Return the data on directions at the rows of a grid, with velocities half a row inside the interval."""
        after = np.clip(np.searchsorted(self.t, grid.t, side="right"), 1, len(self.t) - 1)
        inside = self.at(grid.moved_inside(0.5 * (self.t[after] - self.t[after - 1])).t)[1]
        return Beside(self.pace, grid.sides(), inside)

    def figures(self) -> dict[str, float]:
        """Return the relative change of velocities and accelerations when every second row is left out."""
        names = ("spline velocity", "spline acceleration")
        return {name: _relative(self.mechanism, x, y) for name, y, x in zip(names, *self._known, strict=True)}


@dataclass(frozen=True, eq=False)
class SplinedMotion(SolvedMotion):
    """A recorded motion between its rows at t, as the spline has it, with cuts where forces jump."""

    recording: Recording
    spline: QuinticSpline
    t: Array
    cuts: Sequence[float]

    def at(self, grid: Grid) -> Trajectory:
        return self.recording.table(RecordedRows(grid.t, *self.spline.at(grid.t)), grid, self.spline.beside(grid))

    def positions(self, t: Array) -> Array:
        return self.spline.at(t)[0]


def consistency(mechanism: Mechanism, rows: RecordedRows) -> dict[str, float]:
    """Return the residuals of given velocities and accelerations, relative to the largest of joints with the same unit.

    From one row to the next, h apart, positions change by ``h (v0 + v1) / 2 - h^2 (a1 - a0) / 12``, without the second
    term where accelerations are not given, and velocities by ``h (a0 + a1) / 2``. The residual is given per h. It
    contains errors of the rows and of these rules, ``O(h^4)`` and ``O(h^2)``, and for ball joints ``O(h^2)``.
    """
    model, h = mechanism.model, np.diff(rows.t)[:, None]
    some = np.flatnonzero(h[:, 0] > 0.0)
    if rows.v is None or not len(some):
        return {}
    h, after = h[some], some + 1
    steps = np.array([pin.difference(model, rows.q[k], rows.q[k + 1]) for k in some]) / h
    expected = (rows.v[some] + rows.v[after]) / 2
    if rows.a is None:
        return {"velocity consistency": _relative(mechanism, steps - expected, rows.v)}
    expected -= h / 12 * (rows.a[after] - rows.a[some])
    growth = (rows.v[after] - rows.v[some]) / h - (rows.a[some] + rows.a[after]) / 2
    return {
        "velocity consistency": _relative(mechanism, steps - expected, rows.v),
        "acceleration consistency": _relative(mechanism, growth, rows.a),
    }


def _relative(mechanism: Mechanism, errors: Array, values: Array) -> float:
    """Return the largest error relative to the largest value or error of a joint that has the same unit."""
    sliding, worst = slides(mechanism.model), 0.0
    for alike in (sliding, ~sliding):
        error = np.abs(errors[:, alike]).max(initial=0.0)
        size = max(np.abs(values[:, alike]).max(initial=0.0), error)
        worst = max(worst, float(error / size) if size else 0.0)
    return worst


def _continuous(mechanism: Mechanism, q: Array) -> Array:
    """Return configurations whose quaternions do not change their sign from row to row: both signs are one turn."""
    q = q.copy()
    for ball in mechanism.balls.values():
        quaternion = ball.quaternion(q)
        turned = (quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0.0
        quaternion[1:] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]
    return q


def _spin(ball: Ball, s: Array, rate: Array, second: Array) -> tuple[Array, Array]:
    """Return w and w' of a ball joint, axes of its link, from components that are not of unit length, each (n, 3)."""
    s, rate, second = (ball.quaternion(x) for x in (s, rate, second))
    square = (s * s).sum(axis=1, keepdims=True)
    w = 2.0 * _vector(s, rate) / square
    return w, 2.0 * (_vector(s, second) - w * (s * rate).sum(axis=1, keepdims=True)) / square


def _vector(s: Array, x: Array) -> Array:
    """Return ``vec(s* x)`` of quaternions (x, y, z, w), shape (n, 3): ``s_w x_v - x_w s_v - s_v x x_v``."""
    return np.asarray(s[:, 3:] * x[:, :3] - x[:, 3:] * s[:, :3] - np.cross(s[:, :3], x[:, :3]))
