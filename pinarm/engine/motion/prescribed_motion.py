"""Prescribed motions, and paths of positions: states at the rows of a table and between them, and efforts."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Flags, distinct
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.joint_motion import JointMotion, JointTrajectory
from pinarm.engine.kinematics.singular import running
from pinarm.engine.motion.known_motion import rest_notes, with_efforts
from pinarm.engine.motion.outcome import Outcome, SolvedMotion, positions_by_interval
from pinarm.engine.motion.standstill import Beside, at_rest, directions, lossy, row_paces
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import AssemblyError, InputError
from pinarm.input.units import Unit
from pinarm.mechanics.couplings.coupling import cams_of
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw, Piece, Values
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.singular_passage import SingularPassage
    from pinarm.engine.statics.actuation import Actuation

KINEMATIC = "the problem is kinematic and asks for no forces"

APART = 1e-9
"""Part of a motion below which two jumps of loads are one: rounding of instants at which joints pass or turn back."""

CLOSE = 0.005
"""Part of an interval up to which the nearest row tells the branch by itself."""

Rates = tuple[Array, Array]
"""Velocities and accelerations of the prescribed coordinates, each of shape (k,)."""


class Prescription(Record, frozen=True):
    """Laws that a mechanism follows, and the drives that carry the load.

    Attributes:
        motion: How its joints follow prescribed coordinates and their laws over the parameter.
        drives: What carries the load; ``None`` where only the motion is wanted.
        dynamics: The equation of motion with all forces of the run.
        parameter: Name of what runs along the rows.
        rates: Velocities and accelerations of the coordinates at every row, in place of those of the laws:
            the rows are then states of their own, not one motion.
    """

    mechanism: Mechanism
    motion: JointMotion
    drives: Actuation | None
    dynamics: Dynamics
    parameter: str
    unit: Unit
    rates: Rates | None = None

    def outcome(self, grid: Grid, start: Array, *, parted: bool = False) -> Outcome:
        """Return the states at the rows of a grid, and the motion between them; ``parted``: at all jumps of loads."""
        with running(self.parameter, self.unit):
            assembly = self.motion.begin(grid, start)
            states, kept = self._followed(grid, assembly.q)
            self._refuse_jumps(states.motion)
            known, grid = replace(self, motion=states.motion), grid if not kept.all() else states.grid
            rows = known.rows_of(states)
            if self.drives and self.dynamics.leaps_with_joints and self.parameter == "t" and self.rates is None:
                whole = PrescribedMotion(known, grid.cuts, rows.grid.t, rows.q, start, None)
                if not parted and (jumps := whole.jumps_of_loads()):
                    return self.outcome(grid.parted(jumps), start, parted=True)
                known = replace(known, dynamics=self.dynamics.at_rows(rows.grid, rows.q, rows.v, whole.middle))
                rows = replace(rows, dynamics=known.dynamics)
            pace = known._pace(rows)
            rows = known.solved(rows, pace)
            passed, regular, passing = np.zeros(len(rows), dtype=bool), np.ones(len(rows)), None
            if self.mechanism.closure.size:
                from pinarm.engine.motion.singular_passage import SingularPassage, regularity

                regular = regularity(known, rows.q)
                if passing := SingularPassage.of(known, rows, regular, pace):
                    rows, passed = passing.through(rows, grid, kept, regular)
                    regular = regularity(known, rows.q) if passed.any() else regular
            if len(rows) < len(grid.t):
                self.motion.follow(grid, assembly.q)  # which says what is singular
            notes = known._notes(rows, pace, passed, regular)
        motion = (
            None if rows.numbered else PrescribedMotion(known, grid.cuts, rows.grid.t, rows.q, start, pace, passing)
        )
        return Outcome(
            rows, motion, figures=states.motion.figures(states), notes=(*assembly.notes, *states.motion.jumps, *notes)
        )

    def _refuse_jumps(self, motion: JointMotion) -> None:
        if motion.jumps and self.drives is not None:
            raise InputError(
                f"{motion.jumps[0]}: it would take infinite efforts",
                expected="a motion without jumps of velocity"
                + (f"; there are {len(motion.jumps)}" * (len(motion.jumps) > 1)),
                hint="a posture or a path that keeps clear of the limits; kind: kinematics shows the motion",
            )

    def _followed(self, grid: Grid, start: Array) -> tuple[JointTrajectory, Flags]:
        """Return the motion at the rows of a grid, but for those at singular positions, and which these are."""
        if not self.mechanism.closure.size:
            return self.motion.follow(grid, start), np.ones(len(grid.t), dtype=bool)
        from pinarm.engine.motion.singular_passage import followed  # which open chains do not need

        return followed(self.motion, grid, start)

    def _notes(self, rows: Trajectory, pace: Array | None, passed: Flags, regular: Array) -> list[str]:
        """Return the notes on rows next to singular positions, on joints that friction holds, and on rest."""
        if not self.mechanism.closure.size:
            return rest_notes(rows, pace)
        from pinarm.engine.motion.singular_passage import lost_digits, unbounded_notes

        solved = np.flatnonzero(~passed)
        notes = lost_digits(rows.some(solved), regular[solved])
        if passed.any() and self.drives:
            notes += unbounded_notes(rows.some(np.flatnonzero(passed)))
        return [*notes, *rest_notes(rows, pace)]

    def moving(self, grid: Grid, near: Array) -> Trajectory:
        """Return the motion at the rows of a grid, without efforts, on the branch of a configuration near the first."""
        return self.rows_of(self.motion.follow(grid, near))

    def rows_of(self, states: JointTrajectory) -> Trajectory:
        mechanism, q, v, a = self.mechanism, states.q, states.v, states.a
        if self.rates is not None:
            v, a = self.motion.rates(0.0, q, *self.rates)
        lam = np.zeros((len(q), mechanism.closure.size))
        closure = self.drives.closure if self.drives else mechanism.closure
        return Trajectory(
            mechanism, self.parameter, self.unit, states.grid, q, v, a, np.zeros_like(v), lam, closure, self.dynamics,
            separate=self.rates is not None, driven=self.drives.driven if self.drives else None,
            drives=(*self.drives.coordinates(mechanism),) if self.drives else (),
        )  # fmt: skip

    def _pace(self, rows: Trajectory) -> Array | None:
        if not self.directed or self.rates is not None:
            return None
        return np.asarray(row_paces(self.mechanism, rows.v, rows.a).max(axis=0))

    @property
    def directed(self) -> list[int]:
        """Indices in v of the joints whose directions matter: those behind gears with losses, or all with friction."""
        return [*range(self.mechanism.model.nv)] if self.mechanism.frictions else lossy(self.mechanism)

    def solved(self, rows: Trajectory, pace: Array | None) -> Trajectory:
        beside = self._beside(rows, pace)
        if lossy(self.mechanism):
            rows = replace(rows, directions=directions(rows.v, rows.a, *beside))
        return replace(rows, no_efforts=KINEMATIC) if self.drives is None else with_efforts(rows, self.drives, beside)

    def _beside(self, rows: Trajectory, pace: Array | None) -> Beside:
        inside = np.zeros_like(rows.v)
        if pace is None:
            return Beside(row_paces(self.mechanism, rows.v, rows.a), np.ones(len(rows)), inside)
        if joints := self.directed:
            still = np.flatnonzero(at_rest(rows.v, rows.a, pace)[:, joints].any(axis=1))
            inside[still] = self._inside(rows.some(still))
        return Beside(pace, rows.grid.sides(), inside)

    def _inside(self, rows: Trajectory) -> Array:
        """Return the velocities a little inside the intervals, from the positions of the rows, shape (n, nv)."""
        grid, laws = rows.grid.moved_inside(), self.motion.laws
        rates = np.array([grid.evaluate(law)[1] for law in laws]).T
        inside, idle = np.zeros_like(rows.v), np.zeros(len(laws))
        for row in np.flatnonzero(rates.any(axis=1)):
            with suppress(AssemblyError):  # a singular position, at which the mechanism stands still as well
                inside[row] = self.motion.rates(float(grid.t[row]), rows.q[row][None], rates[row], idle)[0][0]
        return inside


class PrescribedTable(Record, frozen=True):
    """A prescription, and the values of the parameter at which its motion is wanted; nothing is solved yet.

    ``start`` is the configuration of the drawing, or of the start, shape (nq,): it chooses the branch.
    """

    prescription: Prescription
    grid: Grid
    start: Array

    def outcome(self) -> Outcome:
        return self.prescription.outcome(self.grid, self.start)


class PrescribedMotion(SolvedMotion, Record, frozen=True):
    """A prescribed motion that has been solved at values t of its parameter, shape (n,), with configurations q there.

    Attributes:
        cuts: Bounds of the intervals between jumps.
        q: Shape (n, nq): they tell the branch in their neighbourhood.
        start: Configuration of the drawing, or of the start, from which the first of them was found, shape (nq,).
        pace: What rounding of velocities and accelerations is judged against, shape (2, nv); ``None`` where no
            direction is asked for.
        passing: How singular positions are passed; ``None`` where they are not.
    """

    prescription: Prescription
    cuts: Sequence[float]
    t: Array
    q: Array
    start: Array
    pace: Array | None
    passing: SingularPassage | None = None

    def at(self, grid: Grid) -> Trajectory:
        """Return the states at other values of the parameter, on the branch of the nearest solved row."""
        if self.passing is not None:
            return self.passing.at(grid, self._near)
        return self.prescription.solved(self.prescription.moving(grid, self._near(grid)), self.pace)

    def _near(self, grid: Grid) -> Array:
        """Return a configuration near the first value of a grid, followed from the last row before it if it is far."""
        first, start, end = float(grid.t[0]), grid.cuts[0], grid.cuts[-1]
        ahead = (self.t - first) * np.sign(end - start)
        before = np.flatnonzero((ahead <= 0.0) & (np.abs(self.t - start) <= abs(end - start)))
        nearest = int(np.abs(ahead).argmin())
        if abs(ahead[nearest]) <= CLOSE * abs(end - start) or not len(before):
            return np.asarray(self.q[nearest])
        row = int(before[ahead[before].argmax()])
        way = Grid(np.array([self.t[row], first]), grid.cuts, (0, 2))
        return np.asarray(self.prescription.motion.follow(way, self.q[row]).q[-1])

    def positions(self, t: Array) -> Array:
        return positions_by_interval(self, self.cuts, t)

    def knots(self) -> Array:
        """Return the points of laws of coordinates, of loads, and of profiles of cams; see ``SolvedMotion``."""
        known, laws = self.prescription, [*self.prescription.motion.laws]
        forces = known.dynamics.forces.values()
        if known.parameter == "t":
            laws += [law for force in forces for law in force.laws()]
        ends, joints = sorted((self.cuts[0], self.cuts[-1])), self._joint_laws()
        passed = [t for force in forces if force.law for t in force.law.passages(joints, *ends, knots=True)]
        passed += [t for cam in cams_of(known.mechanism.constraints) for t in cam.marked(joints, *ends)]
        return distinct(np.array([*(knot for law in laws for knot in law.knots()), *passed]))

    def jumps_of_loads(self) -> list[float]:
        """Return the instants, ascending, at which loads jump with the state, beside the cuts.

        Raises:
            InputError: There are too many.
        """
        laws, (start, *_, end), known = self._joint_laws(), self.cuts, list(self.cuts)
        loads = [law for force in self.prescription.dynamics.forces.values() if (law := force.law) is not None]
        jumps = [t for law in loads for t in law.passages(laws, start, end)]
        for jump in sorted(jumps):
            if np.abs(np.subtract(known, jump)).min() > APART * (end - start):
                known.append(jump)
        return known[len(self.cuts) :]

    def middle(self, start: float, end: float) -> tuple[Array, Array]:
        grid = Grid(np.array([0.5 * (start + end)]), (start, end), (0, 1))
        states = self.prescription.moving(grid, self._near(grid))
        return states.q[0], states.v[0]

    def _joint_laws(self) -> dict[int, MotionLaw]:
        """Return the laws of joints with one coordinate, by index in v: the prescribed law, else the solved motion."""
        known = self.prescription
        laws: dict[int, MotionLaw] = {joint.v: _Way(self, joint) for joint in known.mechanism.joints.values()}
        return {**laws, **known.motion.prescribed.joint_laws}

    def moved(self, joint: Joint, way: tuple[float, float], t: Array) -> Values:
        """Return the coordinate of a joint at values of the parameter of one interval, and its derivatives by it."""
        t = np.asarray(t, float)
        order = np.argsort(t if way[0] < way[1] else -t, kind="stable")
        grid = Grid(t[order], way, (0, len(t)))
        states, back = self.prescription.motion.follow(grid, self._near(grid)), np.argsort(order)
        return states.q[back, joint.q], states.v[back, joint.v], states.a[back, joint.v]


class _Way(MotionLaw, frozen=True):
    """Motion law of a joint in a ``PrescribedMotion``, solved on request."""

    motion: Any
    joint: Any

    def pieces(self) -> list[Piece]:
        ways = [way for way in pairwise(self.motion.cuts) if way[0] != way[1]]
        return [Piece(min(way), max(way), partial(self.motion.moved, self.joint, way)) for way in ways]
