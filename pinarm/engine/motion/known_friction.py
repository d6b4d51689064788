"""Friction in a known motion: by the direction of every slip, and at rest a band of efforts.

The efforts of the drives and the reactions follow from the motion and from the friction, linearly. Friction of joints
that slip, or are about to, has its direction from the motion. Of joints at rest it may be anything up to its bound:
tables have it as 0, and beside it the efforts that begin to move each drive's coordinate up and down, by the friction
at rest. Any effort between the two holds. Where joints stand still for an instant only, tables have the side of the
motion, and the band is that of both: of the motion, and of joints that stay at rest there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.constraint_rows import rows_of
from pinarm.engine.constraints.nullspace import Decomposition
from pinarm.engine.friction.columns import BANDS, EffortBand, bands_of, friction_columns
from pinarm.engine.friction.slip_equation import ROUNDED, BearingReactions, CarriedLoads, Slipping, jammed
from pinarm.engine.motion.standstill import STANDSTILL, Beside, at_rest, leading
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.series import Series
from pinarm.errors import DynamicsError
from pinarm.mechanics.coordinates import Coordinate
from pinarm.mechanics.friction.contact import several, sizes, slip_drifts, slip_rows, unit_vectors
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.statics.actuation import Actuation

MOVES = 1e-9
"""Slip per unit of a drive's coordinate, relative to the largest, below which a joint does not move with it."""

LOADED = 1e-9
"""Effort without friction, relative to the width of the band, below which there is nothing to hold."""

FEW, MANY = 1e-9, 6
"""Load per friction of a joint at rest that is rounding; and most such joints whose 2^n directions are tried."""


@dataclass(frozen=True, eq=False)
class KnownFriction:
    """A motion of n rows, whose efforts are not used, its drives, and the friction of its joints.

    ``demand`` is ``M a + nle - loads`` without friction that sticks [N*m or N], shape (n, nv).
    """

    run: Trajectory
    drives: Actuation
    demand: Array
    beside: Beside

    @cached_property
    def rows(self) -> Array:
        return slip_rows(self.run.mechanism.model, self.run.mechanism.frictions, self.run.q)

    @cached_property
    def slips(self) -> Array:
        """Slips [rad/s or m/s], shape (n, k)."""
        return np.asarray(np.matvec(self.rows, self.run.v))

    @cached_property
    def directions(self) -> Array:
        """Directions of the slips: 1, -1, components of a unit vector, or 0 at rest, shape (n, k).

        At standstill that of the motion beside the row, on its side of the interval; of a state of its own that of the
        motion about to begin. The pace of a slip is ``|J|`` times that of the joints.
        """
        run, contacts, (pace, side, inside) = self.run, self.run.mechanism.frictions, self.beside
        paces, later = np.matvec(np.abs(self.rows)[:, None], pace), np.matvec(self.rows, inside)
        rates = np.matvec(self.rows, run.a) + slip_drifts(run.mechanism.model, contacts, run.q, run.v)
        return unit_vectors(contacts, leading(self.slips, rates, paces, side, later, partial(sizes, contacts)))

    @cached_property
    def resting(self) -> Flags:
        return np.asarray(sizes(self.run.mechanism.frictions, self.directions) == 0.0)

    def under(self, friction: Array) -> Trajectory:
        """Return the motion with the efforts and multipliers under friction, shape (n, k)."""
        run = self.run
        tau, lam = self.drives.efforts(run.grid.t, run.q, self.demand - np.vecmat(friction, self.rows))
        return replace(
            run, tau=tau, lam=lam, columns={**run.columns, **friction_columns(run.mechanism.frictions, friction)}
        )

    @cached_property
    def loads(self) -> list[CarriedLoads]:
        run, own, contacts = self.run, self.run.mechanism.closure, self.run.mechanism.frictions
        n, k = len(run), len(contacts)
        if not any(contact.law.loaded for contact in contacts):
            return [CarriedLoads.linear(np.zeros((k, 6)), np.zeros((k, k, 6)))] * n
        split = Decomposition.of(own.rows(own.state(run.q[0])))  # the first row stands for all
        BearingReactions(contacts, own, run.intervals()[0][1]).require_determined(split, run.q[0])
        frictions = np.vstack([np.zeros(k), np.eye(k)])
        lam = np.stack([self.under(np.tile(f, (n, 1))).lam for f in frictions], axis=1)
        a, loads = np.broadcast_to(run.a[:, None], (n, 1 + k, run.a.shape[1])), list[CarriedLoads]()
        for part, dynamics in run.intervals():
            transmission = BearingReactions(contacts, run.closure, dynamics)
            for i in range(part.start, part.stop):
                state = float(run.grid.t[i]), run.q[i], run.v[i]
                loads.append(transmission.loads(*state, a[i], lam[i], np.ones(k)))
        return loads

    def _friction(self, row: int, direction: Array, *, at_rest: bool) -> Array:
        equation = self._equation(row, direction, at_rest=at_rest)
        if equation.require_one_root():
            return equation.friction()
        run = self.run
        where = f"at {run.parameter} = {run.grid.t[row]:.9g} {run.unit} "
        raise jammed(run.mechanism.frictions, direction, where)

    def _equation(self, row: int, direction: Array, *, at_rest: bool) -> Slipping:
        contacts, speeds = self.run.mechanism.frictions, sizes(self.run.mechanism.frictions, self.slips[row])
        return Slipping.of(contacts, direction, self.resting[row] & at_rest, speeds, self.loads[row])

    def moving(self) -> Trajectory:
        """Return the motion with its friction and efforts, without friction in joints at rest."""
        friction = [self._friction(i, direction, at_rest=False) for i, direction in enumerate(self.directions)]
        return self.under(np.reshape(friction, self.directions.shape))

    def solved(self) -> Trajectory:
        """Return the motion of ``moving`` with the columns ``joint.J.effort.lower`` and ``.upper``."""
        run = self.moving()
        return replace(run, columns={**run.columns, **self._bands(self.drives.coordinates(run.mechanism))})

    def _bands(self, coordinates: Mapping[str, Coordinate]) -> dict[str, Series]:
        """Return the least and the largest efforts under which the coordinates of drives stay at rest.

        With t the motion of all joints per unit of the coordinate, the other drives at rest, its effort is
        ``t . demand - (J t) . f``, and a sum of efforts is that of the sum of their t. Of a coordinate that moves both
        are the effort itself.
        """
        columns = dict[str, Series]()
        ways = self._ways(coordinates)
        for band in bands_of(self.run.mechanism.joints, coordinates):
            terms = ways * band.shares
            way = terms.sum(axis=2)
            way[np.abs(way) <= MOVES * np.abs(terms).sum(axis=2)] = 0.0
            instants, held = self._held_for_an_instant(way)
            for part, sign in zip(BANDS, (-1.0, 1.0), strict=True):
                effort = self._effort(way, sign)
                if held is not None:
                    effort[instants] = sign * np.maximum(
                        sign * effort[instants], sign * held._effort(way[instants], sign)
                    )
                side = band.side(part, effort)
                columns[side.name] = side
        return columns

    def _held_for_an_instant(self, way: Array) -> tuple[Indices, KnownFriction | None]:
        """Return the rows with joints at rest for an instant, and their motion without that of the coordinate."""
        run, slips = self.run, np.matvec(self.rows, way)
        moved = np.abs(slips) > MOVES * np.abs(way).max(axis=1, keepdims=True)
        begun = np.where(moved & standing(run, self.rows, self.beside.pace) & ~self.resting, slips, 0.0)
        instants = np.flatnonzero(begun.any(axis=1))
        if not len(instants):
            return instants, None
        begun, rows = begun[instants], run.some(instants)
        drift = slip_drifts(run.mechanism.model, run.mechanism.frictions, rows.q, rows.v)
        rates = np.matvec(self.rows[instants], rows.a) + drift
        paces = (begun * rates).sum(axis=1) / (begun * begun).sum(axis=1)
        rows = replace(rows, a=rows.a - paces[:, None] * way[instants])
        pace, side, _ = self.beside
        beside = Beside(pace if pace.ndim == 2 else pace[instants], side[instants], np.zeros_like(rows.v))
        return instants, KnownFriction(rows, self.drives, rows.demand(), beside)

    def _ways(self, coordinates: Mapping[str, Coordinate]) -> Array:
        """Return the motions of all joints per unit of each drive's coordinate, others at rest, shape (n, nv, d)."""
        run = self.run
        along = rows_of(run.mechanism.model, list(coordinates.values()), run.q)
        own = run.mechanism.closure.at(run.q)[1]
        ways = np.empty((len(run), run.v.shape[1], len(coordinates)))
        for i in range(len(run)):
            free = Decomposition.of(own[i]).free
            ways[i] = free @ np.linalg.lstsq(along[i] @ free, np.eye(len(coordinates)))[0]
        return ways

    def _effort(self, way: Array, sign: float) -> Array:
        slips, contacts = np.matvec(self.rows, way), self.run.mechanism.frictions
        largest = np.abs(slips).max(axis=1, keepdims=True, initial=0.0)
        begun = sign * unit_vectors(contacts, np.where(np.abs(slips) > MOVES * largest, slips, 0.0))
        directions = np.where(self.resting, begun, self.directions)
        terms, efforts = way * self.demand, np.empty(len(way))
        for i, direction in enumerate(directions):
            size = float(np.abs(terms[i]).sum())
            held = max(self._held(i, possible, sign * slips[i], size) for possible in self._possible(i, direction))
            efforts[i] = terms[i].sum() + sign * held
        return efforts

    def _held(self, row: int, direction: Array, slips: Array, size: float) -> float:
        """Return by how much friction raises the effort that begins to move a coordinate; infinite where it locks."""
        if self.resting[row].all() and self._equation(row, direction, at_rest=True).locks(slips, size):
            return np.inf
        return float(-slips @ self._friction(row, direction, at_rest=True))

    def _possible(self, row: int, direction: Array) -> list[Array]:
        """Return directions of friction: given ones, and both of joints that do not move but load those that do."""
        contacts, loads = self.run.mechanism.frictions, self.loads[row]
        moving = [j for j in np.flatnonzero(direction).tolist() if contacts[j].law.loaded]
        idle = [
            i
            for i in np.flatnonzero(sizes(contacts, direction) == 0.0).tolist()
            if any(loads.most(j, contacts[j].bearing)[i] > FEW for j in moving)
        ]
        if len(idle) > MANY or several(contacts)[idle].any():
            raise DynamicsError(
                f"{', '.join(dict.fromkeys(contacts[i].name for i in idle))} stand still and load joints that begin to "
                "move: what begins to move the mechanism is not found by trying directions",
                expected=f"friction along one direction, in at most {MANY} of them",
            )
        directions = np.tile(direction, (2 ** len(idle), 1))
        directions[:, idle] = list(product([1.0, -1.0], repeat=len(idle)))
        return list(directions)


def standing(run: Trajectory, rows: Array, pace: Array) -> Flags:
    """Return a mask of the slips, with J in ``rows``, whose joints have no velocity beyond rounding, shape (n, k)."""
    slips, rounding = np.matvec(rows, run.v), STANDSTILL * np.matvec(np.abs(rows), pace[..., 0, :])
    return np.asarray(sizes(run.mechanism.frictions, np.where(np.abs(slips) > rounding, slips, 0.0)) == 0.0)


def notes_of(run: Trajectory, pace: Array) -> list[str]:
    """Return notes on a motion of n rows with joints at rest under friction, and the bands of d drives."""
    coordinates = {name: run.mechanism.coordinate(name) for name in run.drives}
    along = rows_of(run.mechanism.model, list(coordinates.values()), run.q)
    speeds, rates = np.matvec(along, run.v), np.matvec(along, run.a)
    resting = at_rest(speeds, rates, np.matvec(np.abs(along)[:, None], pace))
    rows = slip_rows(run.mechanism.model, run.mechanism.frictions, run.q)
    instants = (standing(run, rows, pace) & (run.friction != 0.0)).any(axis=1)
    notes = list[str]()
    for band in bands_of(run.mechanism.joints, coordinates):
        low, high = (run.columns[f"{band.quantity}.{part}"].values for part in BANDS)
        notes += _band_notes(band, low, high, np.asarray(resting[:, band.shares != 0.0].all(axis=1)), instants)
    return notes


def _band_notes(band: EffortBand, low: Array, high: Array, resting: Flags, instants: Flags) -> Iterator[str]:
    """Yield notes on a band from low to high, with the rows in which its coordinates, or joints, rest, shape (n,)."""
    name, n, of_one = band.quantity, len(low), np.count_nonzero(band.shares) == 1
    if of_one:
        yield from _endless_notes(name, low, high, resting)
    wide = high - low > ROUNDED * np.minimum(np.abs(low), np.abs(high))
    if (wide & instants).any():
        yield (
            f"{name}: in {(wide & instants).sum()} of {n} rows a joint is at rest for an instant: {name}.lower and "
            ".upper have the efforts that move it from rest too, the table has the side of the motion"
        )
    held, moved = wide & resting & ~instants, wide & ~resting & ~instants
    others = ", the other drives free to take their part" if len(band.shares) > 1 else ""
    together = ": values of several bands need not hold together" if others else ""
    for rows, what, when, without in (
        (held, "friction holds", "at rest", "friction"),
        (moved, "friction of joints at rest leaves", "though the coordinate moves", "their friction"),
    ):
        if rows.any():
            yield (
                f"{name}: {what} any value from {name}.lower to {name}.upper in {rows.sum()} of {n} rows, {when}"
                f"{others}{together}; the table has the value without {without} there"
            )
    low, high = low[held], high[held]
    locked = (low <= 0.0) & (high >= 0.0) & (0.5 * np.abs(high + low) > LOADED * (high - low))
    if of_one and locked.any():
        drive = name.removesuffix(".effort")
        yield f"{drive} is self-locking in {locked.sum()} of {n} rows: it holds without any effort{others}"


def _endless_notes(name: str, low: Array, high: Array, resting: Flags) -> Iterator[str]:
    """Yield notes on a drive that cannot move its coordinate, whatever its effort."""
    drive, down, up = name.removesuffix(".effort"), (low == -np.inf) & resting, (high == np.inf) & resting
    for rows, what in (
        (down & up, f"is self-locking in {{}} of {len(low)} rows: friction grows with the effort and holds any"),
        (down & ~up, f"cannot move down in {{}} of {len(low)} rows, as friction grows with the effort"),
        (up & ~down, f"cannot move up in {{}} of {len(low)} rows, as friction grows with the effort"),
    ):
        if rows.any():
            yield (
                f"{drive} {what.format(rows.sum())}: {name}.lower or .upper is infinite there; a drive along another "
                "coordinate moves the mechanism"
            )
