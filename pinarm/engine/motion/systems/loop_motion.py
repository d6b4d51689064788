"""Motion along loops of any kind, step by step, past singular positions.

Far from singular positions accelerations are those of Gauss's principle. Near them every stage is closed first; in the
singular position itself the acceleration is interpolated between positions before and behind it on the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import RANK, VANISHED, Decomposition
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix, solve
from pinarm.engine.kinematics.prescribed import Targets
from pinarm.errors import DynamicsError, NumericsError
from pinarm.records import Record, replace

FLOOR = 0.3
"""Least step close to singular positions, relative to the last one that was taken far from them."""

ROUNDED = 1e-15
"""Gap that is rounding, relative to the coarseness of the rows."""

STALLED = 1e-9
"""Gap below which Newton's method may end because rounding lets it shrink no more, relative to the coarseness."""

ITERATIONS = 12
"""Steps of Newton's method at most, which close a state that is nearly closed in two or three."""

MET, LEAST = 1e-6, 1.0
"""Part of its terms that ``G a + G' v`` may be at accepted states, where closed loops leave less than 1e-10; and the
size that terms have at least, since at rest all of them vanish [m/s^2 or rad/s^2]."""

NEAR = 0.05
"""Regularity below which every stage is closed. Four-bars of equal rods end as close to the truth as with 0.2, in three
quarters of the time, at 160 tolerances from 1e-3 to 1e-13, none on another branch."""

AHEAD = 1.5
"""Stages are also closed in a step that may pass a singular position in one go: where the regularity, falling 1.5 times
as much as over the last step, is 0 or less. The error estimate of so long a step does not show the errors of its
stages."""

BLIND, ASIDE, ACROSS = 2.5e-3, 8e-3, np.array([-1.0, 8.0, -28.0, 56.0, 56.0, -28.0, 8.0, -1.0]) / 70.0
"""Regularity s below which a position says little of the state, whose place is known to eps / s and whose velocity to
eps / s^2. The state is then not closed, and the acceleration is interpolated between positions at once to four times
8e-3 rad before and behind it, with these weights, to the eighth order: below 1e-14 of the motion. None of them should
be singular: of four-bars, whose regularity changes by 0.5 per radian, a blind state is up to 5e-3 from it."""

PASSED, TURNED = 1e-11, 1e-9
"""Gap of the loops, relative to the coarseness, at the position so interpolated. Up to the first a singular position is
passed. Above the second the motion turns beside it. Between them rounding would decide: the motion is refused."""

NOISE = 1e-11
"""Part of a row that others do not have, relative to its length, up to which it repeats them but for rounding."""


class Regularity(Record, frozen=True):
    """Distance of a mechanism's rows from a loss of rank, relative to generic positions.

    The regularity is ``s_r / s_1 / usual``, with the singular values s of G in descending order, in units that suit the
    loops, and the rank r. Rows that repeat others everywhere are left out, and columns of joints that follow laws.

    Attributes:
        driven: Indices in v of joints that follow laws.
        kept: The rows that repeat no others, shape (k,).
        exact: Whether the other rows repeat these within rounding.
        rank: Rank at generic positions.
        usual: The larger ``s_r / s_1`` of two generic positions.
    """

    closure: Closure
    driven: tuple[int, ...]
    kept: Indices
    exact: bool
    rank: int
    usual: float

    @staticmethod
    @lru_cache(maxsize=16)  # the same for all runs of a mechanism
    def of(closure: Closure, driven: tuple[int, ...]) -> Regularity:
        """Return the measure of the rows of a closure."""
        whole = Regularity(closure, driven, np.arange(closure.size), True, 0, 1.0)
        rows = [whole.scaled(closure.rows(closure.state(q))) for q in places(closure)]
        kept, exact, rank = _independent(rows, list(closure.slices.values()))
        if not rank:
            return replace(whole, kept=kept)
        known = replace(whole, kept=kept, exact=exact, rank=rank)
        values = [known.values(closure.rows(closure.state(q))) for q in places(closure)]
        return replace(known, usual=max(float(value[rank - 1] / value[0]) for value in values))

    @cached_property
    def bare(self) -> list[Any]:
        """Compiled loops without loads and the note on them; empty until they have been judged."""
        return []

    def scaled(self, rows: Array) -> Array:
        """Return the kept rows of the closure, which lead ``rows``, in its units, driven columns 0, shape (k, nv)."""
        units = self.closure.scale / self.closure.measure[self.kept, None]
        units[:, self.driven] = 0.0
        return np.asarray(rows[self.kept] * units)

    def values(self, rows: Array) -> Array:
        """Return the singular values of such rows, descending; from ``G G^T``, which is exact enough, shape (k,)."""
        own = self.scaled(rows)
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(own @ own.T)[::-1], 0.0)))

    def at(self, values: Array, rank: int) -> float:
        return float(values[rank - 1] / values[0]) / self.usual if rank and values[0] else 1.0


def places(closure: Closure) -> list[Array]:
    """Return two configurations of no special kind, the same every time, slides within the size of the loops."""
    model = closure.model
    ways = np.sin(np.add.outer([1.0, 8.1], 1.3 * np.arange(model.nv))) * closure.scale
    return [pin.integrate(model, pin.neutral(model), way) for way in ways]


def _independent(places: Sequence[Array], parts: Sequence[slice]) -> tuple[Indices, bool, int]:
    """Return rows independent of earlier rows in any of several places, whether the others are dependent, and the rank.

    ``places`` has the rows in each place, shape (m, nv), ``parts`` the slices of every constraint.
    """
    bases, kept, exact = [np.zeros((0, rows.shape[1])) for rows in places], list[int](), True
    largest = max(float(np.abs(rows).max(initial=0.0)) for rows in places)
    for part in parts:
        left = [_beyond(basis, rows[part]) for basis, rows in zip(bases, places, strict=True)]
        for row in range(part.start, part.stop):
            lengths = [float(np.linalg.norm(some[row - part.start])) for some in left]
            added = [
                size > max(RANK * float(np.linalg.norm(rows[row])), VANISHED * largest)
                for size, rows in zip(lengths, places, strict=True)
            ]
            exact &= any(added) or max(lengths) <= NOISE * largest
            kept += [row] if any(added) else []
            for k in np.flatnonzero(added):
                bases[k] = np.vstack([bases[k], left[k][row - part.start] / lengths[k]])
                left[k] = _beyond(bases[k][-1:], left[k])
    return np.array(kept, dtype=np.intp), exact, min(map(len, bases))


def _beyond(basis: Array, rows: Array) -> Array:
    """Return the parts of rows orthogonal to an orthonormal basis; projected twice, as little may be left."""
    left = rows - rows @ basis.T @ basis
    return np.asarray(left - left @ basis.T @ basis)


class Place(NamedTuple):
    """A configuration, its rows G, shape (m, nv), taken apart, M, and what is open, shape (m,)."""

    q: Array
    rows: Array
    split: Decomposition
    mass: Array
    gap: Array

    def step(self, right: Array) -> Array:
        """Return the least change x, measured by the masses, with ``rows x = right``, shape (nv,)."""
        return solve(self.split, self.mass, np.zeros(self.rows.shape[1]), right)


class LoopMotion:
    """The motion on one interval; it looks at every accepted state how close a singular position is.

    ``rows`` are the constraints, then the prescribed coordinates; ``targets`` what these are to be.
    """

    def __init__(self, rows: Closure, regularity: Regularity, dynamics: Dynamics, targets: Targets) -> None:
        self.rows, self.measure, self.dynamics, self.targets = rows, regularity, dynamics, targets
        self.coarse, self.scale = rows.coarseness, rows.scale
        self.near, self.rank, self.looked = True, 0, False
        self.met = False
        """Whether it has been near a singular position after a step or at its start."""
        self.regular, self.singular, self.open = 0.0, True, 0.0
        self.t, self.step, self.least = -np.inf, 0.0, 0.0
        """Instant of the last accepted state, length of the last regular step, and the least step now [s]."""
        self.unchecked = np.nan
        """Instant of an accepted state whose acceleration is still to be looked at, when it is first asked for [s]."""
        self.q = np.zeros(0)
        """The position last looked at, shape (nq,)."""
        self._apart: tuple[Array, Decomposition] | None = None

    def split(self, rows: Array) -> Decomposition:
        """Return G taken apart: that of couplings, and of laws of joints, is the same in all positions."""
        if self._apart is None or not np.array_equal(rows, self._apart[0]):
            self._apart = rows, self.rows.split(rows)
        return self._apart[1]

    def place(self, q: Array) -> Place:
        state = self.rows.state(q)
        rows = self.rows.rows(state)
        return Place(q, rows, self.split(rows), mass_matrix(self.rows.model, q), self.rows.gap(state))

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration, near singular positions that of the closed state."""
        if self.near or self.rank < self.measure.rank:
            w, dw, _ = self.targets(t)
            place = self.place(q)
            if not self.looked:
                self.begin(t, self.closed(place, w), v)
            if v.any() and self.blind(self._regularity(place)):
                a = self.across(t, q, v)
                if not self.turns:
                    return a
            place = self.closed(place, w)
            q, v = place.q, self.tangent(place, v, dw)
        a, rows, right = self.solved(t, q, v)
        if t == self.unchecked:  # stages of steps that end there are not closed
            self.unchecked = np.nan
            require_closed_accelerations(rows, a, right, t, q)
        return a

    def solved(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return the acceleration of a state by Gauss's principle, its rows, and what these ask: ``-G' v`` or more."""
        closure, dynamics = self.rows, self.dynamics
        state = closure.state(q, v)
        rows, right = closure.rows(state), self._right(self.targets(t)[2]) - closure.drift(state)
        force = dynamics.loads(t, q, v) - pin.nonLinearEffects(dynamics.model, dynamics.data, q, v)
        return solve(self.split(rows), mass_matrix(dynamics.model, q), force, right), rows, right

    def _right(self, targets: Array) -> Array:
        """Return 0 for the constraints, then what the laws ask, shape (m,)."""
        return np.concatenate([np.zeros(self.rows.size - len(targets)), targets])

    def blind(self, regularity: float) -> bool:
        """Return whether a position is too close to a singular one that is passed."""
        return regularity < BLIND and not self.turns

    @property
    def turns(self) -> bool:
        """Whether the motion turns beside a singular position, where the loops do not close."""
        return self.open > PASSED * self.coarse

    def require_known_way(self, t: float) -> None:
        """Raise where rounding would decide whether a singular position is passed."""
        if PASSED < self.open / self.coarse <= TURNED:
            raise NumericsError(
                f"at t = {t:.9g} s the loops almost close in a singular position: they are open there by "
                f"{self.open / self.coarse:.2g} of their size, too little to tell whether the mechanism goes through "
                "it or turns beside it",
                expected=f"a gap below {PASSED:g}, which counts as a position that is passed, or above {TURNED:g}",
                hint="give lengths with all their digits, so that the position is exact, or change one by 1e-7 of it",
            )

    def across(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration at a singular position that is passed, from both sides of it; see if it is one."""
        closure, dw = self.rows, self.targets(t)[1]
        pairs = [self._beside(t, q, v, k) for k in (-4, -3, -2, -1, 1, 2, 3, 4)]
        accelerations = [self.solved(t, closed.q, self.tangent(closed, v, dw))[0] for _, closed in pairs]
        changes = [pin.difference(closure.model, moved.q, closed.q) for moved, closed in pairs]
        between = self.place(pin.integrate(closure.model, q, ACROSS @ np.array(changes)))
        self.open = self._size(between.gap[: closure.size - len(dw)])
        return np.asarray(ACROSS @ np.array(accelerations))

    def _beside(self, t: float, q: Array, v: Array, k: int) -> tuple[Place, Place]:
        """Return the position k times ``ASIDE`` along a velocity, and the closed one nearest to it."""
        closure, aside = self.rows, (k * ASIDE / float(np.abs(v / self.scale).max())) * v
        moved = self.place(pin.integrate(closure.model, q, aside))
        return moved, self.closed(moved, moved.gap[closure.size - len(self.targets(t)[1]) :])

    def _size(self, gap: Array) -> float:
        """Return the length of the first gaps, shape (k,), in the units of their rows."""
        return float(np.linalg.norm(gap / self.rows.measure[: len(gap)]))

    def floor(self) -> float:
        """Return the least step where a singular position is passed: a fraction of the last one far from them [s]."""
        return 0.0 if self.turns else self.least

    def settle(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state, and choose by it how to go on."""
        w, dw, _ = self.targets(t)
        place = self.closed(self.place(q), w)
        self.look(place)
        if not self.blind(self.regular):
            q, v = place.q, self.tangent(place, v, dw)
        if not self.singular and self.t > -np.inf:
            self.step = t - self.t
        self.least = FLOOR * self.step if self.singular else 0.0
        self.t = self.unchecked = t
        self.require_known_way(t)
        return q, v

    def closed_acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration of a state that is closed first, for the dense output.

        The error of a step says nothing of the further stages of its dense output, which may be right beside a singular
        position.
        """
        now, self.near = (self.near, self.open), True
        try:
            return self.acceleration(t, q, v)
        finally:
            self.near, self.open = now

    def begin(self, t: float, place: Place, v: Array) -> None:
        """Choose how to go on from a closed start; if it is singular, a regular step is the time to get away.

        The rank along the motion is then that of positions beside the start.
        """
        speed, rank = float(np.abs(v / self.scale).max()), self._rank(place)
        if speed and rank < self.measure.rank:
            rank = max(self._rank(self._beside(t, place.q, v, k)[1]) for k in (-4, 4))
        self.look(place, rank)
        if not self.near:
            self.t = self.unchecked = t
        if self.singular and speed:
            self.step = NEAR / speed
            self.least = FLOOR * self.step

    def _rank(self, place: Place) -> int:
        values = self.measure.values(place.rows)
        return int((values > RANK * values[:1]).sum())

    def look(self, place: Place, rank: int = 0) -> None:
        """Choose how to go on, by how regular a closed position is on a motion of at least a rank."""
        values, before = self.measure.values(place.rows), self.regular
        self.rank = max(self.rank, rank, int((values > RANK * values[:1]).sum()))
        self.regular, self.q, self.looked = self.measure.at(values, self.rank), place.q, True
        self.singular, fall = self.regular < NEAR, before - self.regular
        self.open = self.open if self.singular else 0.0
        self.near = self.singular or self.regular < AHEAD * fall
        self.met = self.met or self.near

    def _regularity(self, place: Place) -> float:
        """Return the regularity of a position, by the rank along the motion: the largest one at closed positions."""
        if not np.isfinite(place.rows).all():  # of a stage; the step will be refused
            return float("nan")
        return self.measure.at(self.measure.values(place.rows), self.rank)

    def closed(self, place: Place, w: Array) -> Place:
        """Return the closed position nearest to one by the masses, with prescribed coordinates w, shape (k,)."""
        before, target = np.inf, self._right(w)
        for _ in range(ITERATIONS):
            gap = target - place.gap
            size = self._size(gap)
            if size <= ROUNDED * self.coarse or (size < STALLED * self.coarse and size > 0.5 * before):
                break
            q, before = pin.integrate(self.rows.model, place.q, place.step(gap)), size
            place = self.place(q)
        return place

    def tangent(self, place: Place, v: Array, dw: Array) -> Array:
        """Return the velocity nearest to v that keeps the loops closed, with prescribed rates, shape (k,)."""
        return v - place.step(place.rows @ v - self._right(dw))


def require_closed_accelerations(rows: Array, a: Array, right: Array, t: float, q: Array) -> None:
    """Raise where the acceleration at an accepted state leaves the constraints: ``G a + G' v`` is not 0.

    ``right`` is ``-G' v``. It may be off by ``MET`` of its terms.
    """
    off = rows @ a - right
    if off.dot(off) <= (MET * LEAST) ** 2:  # nearly always
        return
    left, size = np.abs(off).max(), (abs(rows) @ np.abs(a) + np.abs(right)).max()
    if not left <= MET * max(size, LEAST):
        raise DynamicsError(
            f"at t = {t:.9g} s the accelerations tear the loops: G a + G' v is {left:.3g}, its terms reach {size:.3g} "
            "[m/s^2 or rad/s^2]",
            expected=f"no more than {MET:g} of its terms",
            hint="masses many orders apart in one loop, or a position all but singular, may be the reason",
            t=t,
            q=q,
        )
