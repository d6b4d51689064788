"""The first position of a run: the assembly of the drawing, followed to the first values of the prescribed coordinates.

The loops are closed near the start: all coordinates 0, as drawn, or what ``start`` says. From there the prescribed
coordinates go in a straight line to their first values, by the steps that follow the rows of a table. Joints that the
drawing has beyond their limits begin in the middle of these, with a note. Parts of a mechanism that do not depend on
one another are assembled one by one.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import Closure, slides
from pinarm.engine.kinematics.newton import NewtonSolver, assembled, start_configuration
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates, StateFunction
from pinarm.engine.kinematics.singular import SINGULAR
from pinarm.errors import LISTED, AssemblyError, InputError, several
from pinarm.mechanics.coordinates import GuidedCoordinate, LinearCoordinate
from pinarm.mechanics.joints import format_configuration
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.laws.motion_law import MotionLaw

APART = 1e-4
"""Difference of coordinates from which on two assemblies are not the same one [rad, or units of length]: at a dead
point a gap of ``CLOSED`` leaves an angle of its root, 1e-6."""

ROUNDING = 1e-9
"""Part of a limit by which it may be passed."""

OPEN = PrescribedCoordinates((), (), ())
"""No prescribed coordinates."""


def start_near(
    mechanism: Mechanism, start: Mapping[str, float], prescribed: PrescribedCoordinates, grid: Grid
) -> Array:
    """Return the configuration, shape (nq,), near which the first position is wanted, from joint coordinates there."""
    return near_given(mechanism, start_configuration(mechanism, start), start, prescribed, grid)


def near_given(
    mechanism: Mechanism, q: Array, given: Collection[str], prescribed: PrescribedCoordinates, grid: Grid
) -> Array:
    """Return a configuration with the joints that are not given near a solution, shape (nq,).

    They are where loops, first values of laws and given coordinates share what is left open; from where they are 0 the
    positions that are found may be on another branch than those given.

    Args:
        q: The configuration, shape (nq,).
        given: Names of coordinates of joints that are given in it for the first row; where there are none, those of the
            mechanism's own start count, which is at no row: values of laws play no part.
    """
    prescribed = prescribed if given else OPEN
    own = [name for name in given or mechanism.start if name in mechanism.joints and name not in prescribed.names]
    if not own or not mechanism.closure.size:
        return q
    places = [mechanism.joints[name].q for name in own]
    known = prescribed.holding(own, [mechanism.coordinate(name) for name in own], q[places].tolist())
    solver = NewtonSolver(mechanism.closure, known)
    w = np.append(prescribed.first(grid), q[places])
    closest = solver.closest(q, w, solver.sliding * solver.untied)[0].copy()
    closest[places] = q[places]
    return closest


def first_position(
    closure: Closure, prescribed: PrescribedCoordinates, w: Array, t: float, drawn: Array, near: Array | None = None
) -> Assembly:
    """Return the configuration in which prescribed coordinates have their first values, closed to ``CLOSED``.

    Args:
        prescribed: The coordinates; there may be fewer than degrees of freedom.
        w: Their first values, shape (k,).
        drawn: A configuration near the drawing, or that of the start, shape (nq,).
        near: A configuration with the first values, rough elsewhere; the drawn one with those of joints where it is
            left out.
    """
    whole = _Part(closure.holonomic, prescribed, w, t)
    if not whole.solver.names or (whole.has_values(drawn) and not whole.beyond(drawn, drawn)):
        return Assembly(drawn)
    notes, q = list[str](), drawn
    for part in _parts(whole):
        assembly = part.assembled(q, near)
        q = assembly.q
        notes += assembly.notes
    return Assembly(q if whole.has_values(q) else whole.solver.close(q, w, t), tuple(notes))


def closed_drawing(closure: Closure, drawn: Array) -> Assembly:
    """Return the closed configuration near the drawing; with a note where the loops close elsewhere only."""
    assembly = first_position(closure, OPEN, np.zeros(0), 0.0, drawn)
    return replace(assembly, q=assembled(closure, OPEN, assembly.q, np.zeros(0), 0.0))


def _parts(whole: _Part) -> list[_Part]:
    """Return the parts of a mechanism that do not depend on one another."""
    closure, prescribed = whole.closure, whole.prescribed
    guided = closure.with_guides(prescribed.names, prescribed.coordinates)
    places, parts = {name: place for place, name in enumerate(prescribed.names)}, []
    for joints, constraints in guided.parts:
        own = [constraint for constraint in constraints if not isinstance(constraint, GuidedCoordinate)]
        some = [places[constraint.name] for constraint in constraints if isinstance(constraint, GuidedCoordinate)]
        moving = np.flatnonzero(guided.groups == guided.groups[joints[0]])
        parts.append(_Part(Closure.of(closure.model, own), prescribed.picked(some), whole.w[some], whole.t, moving))
    return parts


class _Part:
    """A part of a mechanism, to be assembled."""

    def __init__(
        self,
        closure: Closure,
        prescribed: PrescribedCoordinates,
        w: Array,
        t: float,
        moving: Indices | slice = slice(None),
    ) -> None:
        self.closure, self.model, self.prescribed = closure, closure.model, prescribed
        self.w, self.t, self.moving = w, t, moving
        self.solver = NewtonSolver(closure, prescribed, moving)
        self.sliding = slides(self.model)

    def has_values(self, q: Array) -> bool:
        """Tell whether the loops are closed and the coordinates have their first values."""
        state = self.closure.state(q)
        return self.solver.closed(state, self.solver.gap(state, self.w), self.w)

    def assembled(self, drawn: Array, near: Array | None) -> Assembly:
        """Return the first position of the part; see ``first_position``."""
        begun, moved = self._within_limits(drawn)
        direct, error = self._closed(begun if near is None else self._copied(near, drawn))
        way, end = "", None
        with suppress(AssemblyError, InputError):
            if (end := self._followed(begun, direct)) is None and direct is None:  # whose search told nothing
                direct, _ = self._closed(self._aside(begun))
                error = error if direct is None else None
        if end is None and direct is not None and self._is_told(direct):
            end = direct
        if end is None:
            if direct is None or near is None:
                raise error or self._undecided(direct)
            way = "the way from the start ends at a singular position, and the one nearest to what is given is taken"
            end = direct
        if direct is not None and not self.solver.sliding.all() and self._apart(end, direct) <= APART:
            end = direct  # in the nearest turn of its threads
        notes = [way] if way else []
        if moved:
            notes.append(f"the start has {self._named(moved)} beyond the limits, in the middle of which the way begins")
        if over := self.beyond(end, drawn):
            notes.append(f"the first position has {self._named(over)} beyond the limits")
        said = "; ".join(notes)
        return Assembly(end, (f"assembly: {said}. start: chooses another",) if said else ())

    def _is_told(self, q: Array) -> bool:
        """Tell whether the problem itself refuses a position, in its own words.

        There the loops and some prescribed coordinates determine the motion of others, or leave a motion free.
        """
        rank, own = (closure.split_at(q).rank for closure in (self.solver.whole, self.closure))
        return bool(rank < own + len(self.prescribed.names) or len(null_space(self.solver.rows(self.closure.state(q)))))

    def beyond(self, q: Array, start: Array) -> list[int]:
        """Return the joints that are beyond their limits; not those that a given start, other than 0, has there."""
        low, high, joints = self.model.lowerPositionLimit, self.model.upperPositionLimit, []
        for joint, _, place in self._singles:
            slack = ROUNDING * max(1.0, abs(q[place]))
            trusted = start[place] and not low[place] <= start[place] <= high[place]
            if not low[place] - slack <= q[place] <= high[place] + slack and not trusted:
                joints.append(joint)
        return joints

    def _within_limits(self, drawn: Array) -> tuple[Array, list[int]]:
        """Return a start with joints in the middle of their limits if some of them are beyond, and the latter."""
        q, beyond = drawn.copy(), self.beyond(drawn, drawn)
        for place in (place for _, _, place in self._singles if beyond and not drawn[place]):
            ends = float(self.model.lowerPositionLimit[place]), float(self.model.upperPositionLimit[place])
            q[place] = 0.5 * sum(ends) if np.isfinite(ends).all() else np.clip(0.0, *ends)
        return q, beyond

    def _followed(self, begun: Array, direct: Array | None) -> Array | None:
        """Return the end of the straight way of coordinates to their values, by steps of the continuation.

        What they leave free goes where it is in the position found directly, or rests where there is none. ``None``
        where the start is a singular position.
        """
        free = NewtonSolver(self.closure, OPEN, self.moving)
        q = free.close(begun, np.zeros(0), self.t) if free.names else begun
        if self.has_values(q):
            return q
        if (kept := self._kept(q, direct)) is None:
            return None
        names = (*self.prescribed.names, *(f"free motion {k}" for k in range(len(kept))))
        everything = PrescribedCoordinates(names, (*self.prescribed.coordinates, *kept), ())  # type: ignore[arg-type]
        solver, state = NewtonSolver(self.closure, everything, self.moving), self.closure.state(q)
        there = None if direct is None else self.closure.state(direct)
        first = np.array([coordinate.value(state) for coordinate in everything.coordinates])
        change = np.append(self.w, [coordinate.value(there) if there else 0.0 for coordinate in kept]) - first
        still = np.zeros(len(first))
        rates = solver.rates(q, change, still, 0.0)
        return solver.advance(q, *rates, 0.0, 1.0, lambda s: (first + s * change, change, still))[0]

    def _kept(self, begun: Array, direct: Array | None) -> list[StateFunction] | None:
        """Return coordinates that keep what prescribed ones leave free; ``None`` where the start is singular."""
        rows = self.solver.rows(self.closure.state(begun))
        free = null_space(rows)
        if not len(free):
            return []
        ends = [rows, *([] if direct is None else [self.solver.rows(self.closure.state(direct))])]
        own = min(len(null_space(end[: self.closure.size])) for end in ends)
        if len(free) != own - len(self.w):
            return None
        return [_distance(begun, self.solver.spread(way) / self.closure.scale**2) for way in free]

    def _closed(self, rough: Array) -> tuple[Array | None, AssemblyError | None]:
        """Return the first position near a rough one, or why there is none."""
        q = rough.copy()
        for coordinate, value in zip(self.prescribed.coordinates, self.w, strict=True):
            if isinstance(coordinate, LinearCoordinate) and coordinate.joint is not None:
                q[coordinate.places[coordinate.joint]] = value
        try:
            return self.solver.close(q, self.w, self.t), None
        except AssemblyError as error:
            return None, error

    def _aside(self, q: Array) -> Array:
        """Return a configuration beside another one, in no special direction."""
        spread = 2.0 * np.remainder(GOLDEN * np.arange(1, self.model.nv + 1), 1.0) - 1.0
        return np.asarray(pin.integrate(self.model, q, STEP * self.closure.scale * spread))

    def _undecided(self, q: Array | None) -> AssemblyError:
        """Return the error of a first position that no way from the start leads to."""
        there = "" if q is None else f", such as {format_configuration(self.model, q)}"
        return AssemblyError(
            "the way from the start to the first position ends at a singular position, where several assemblies meet",
            expected=f"joint coordinates near the one that is meant{there}",
            hint="start: in the problem, or in the mechanism file",
            t=self.t,
        )

    def _named(self, joints: Sequence[int]) -> str:
        return several([str(self.model.names[joint]) for joint in joints], LISTED)

    def _apart(self, q: Array, other: Array) -> float:
        """Return the largest difference of two configurations, without whole turns [rad, or units of length]."""
        apart = pin.difference(self.model, other, q) / self.closure.scale
        turned = np.where(self.sliding, apart, np.remainder(apart + np.pi, 2.0 * np.pi) - np.pi)
        return float(np.abs(turned[self.moving]).max(initial=0.0))

    def _copied(self, q: Array, other: Array) -> Array:
        """Return a configuration with the joints of the part as in q, and all others as in another one."""
        copy = other.copy()
        for joint in self._joints:
            own = slice(self.model.idx_qs[joint], self.model.idx_qs[joint] + self.model.nqs[joint])
            copy[own] = q[own]
        return copy

    @cached_property
    def _joints(self) -> list[int]:
        """Indices of the joints of the part."""
        moving = set(np.arange(self.model.nv)[self.moving].tolist())
        return [joint for joint in range(1, self.model.njoints) if self.model.idx_vs[joint] in moving]

    @cached_property
    def _singles(self) -> list[tuple[int, int, int]]:
        """Joints of the part with one coordinate that is not prescribed: their indices, those in v and in q."""
        model, given = self.model, {getattr(coordinate, "joint", None) for coordinate in self.prescribed.coordinates}
        places = [(joint, model.idx_vs[joint], model.idx_qs[joint]) for joint in self._joints]
        return [place for place in places if model.nqs[place[0]] == model.nvs[place[0]] == 1 and place[1] not in given]


def _distance(start: Array, way: Array) -> StateFunction:
    """Return the distance from a configuration q0, shape (nq,), along a direction d, shape (nv,): ``d . (q - q0)``."""
    return StateFunction(
        lambda state: float(way @ pin.difference(state.model, start, state.q)),
        lambda state: np.asarray(way @ pin.dDifference(state.model, start, state.q)[1]),
        lambda state: 0.0,
    )


def null_space(rows: Array) -> Array:
    """Return the motions that rows leave free, orthonormal, shape (f, nv)."""
    _, values, ways = np.linalg.svd(rows)
    return np.asarray(ways[np.count_nonzero(values > SINGULAR * values.max(initial=0.0)) :])


BESIDE, STEP = 4, 0.2
"""Number of closed configurations that are compared with the first one, and how far each is from the one before
[rad, or units of length]."""

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Its multiples, but for whole numbers, are spread evenly over 0 to 1 and never repeat (``numpy.random`` is slow to
import)."""


def generic_near(mechanism: Mechanism, start: Mapping[str, float]) -> Array:
    """Return a closed configuration of no special kind, shape (nq,), near rough joint coordinates if there is one.

    Where the loops cannot be closed at all it is the rough one: what is solved says what stays open.
    """
    try:
        return closed_generic(mechanism, start)
    except AssemblyError:
        return start_configuration(mechanism, start)


def closed_generic(mechanism: Mechanism, start: Mapping[str, float]) -> Array:
    """Return a closed configuration of no special kind, shape (nq,), near a start; see ``closed_drawing``."""
    q = closed_drawing(mechanism.closure, start_configuration(mechanism, start)).q
    return generic(mechanism, beside(mechanism, q))


def mobility_when_closed(mechanism: Mechanism) -> int:
    """Return the degrees of freedom in closed configurations of no special kind."""
    closure = mechanism.closure
    return int(closure.split_at(closed_generic(mechanism, mechanism.start)).free.shape[1])


def determining(mechanism: Mechanism, motion: Mapping[str, MotionLaw]) -> PrescribedCoordinates:
    """Return the prescribed coordinates of a mechanism all of whose joints are to follow.

    Checked here: that they are not fewer than coordinates less constraint rows, and not more than coordinates. The rest
    is checked once the mechanism is assembled.
    """
    prescribed, closure = PrescribedCoordinates.bound(mechanism, motion), mechanism.closure
    least = mechanism.model.nv - closure.size  # redundant rows leave more freedom than this says
    if len(prescribed.names) < least:
        with suppress(AssemblyError):
            least = mobility_when_closed(mechanism)
        raise prescribed.miscounted(mechanism, least)
    if len(prescribed.names) > mechanism.model.nv - bool(closure.size):
        check_excess(mechanism, prescribed)
    return prescribed


def check_excess(mechanism: Mechanism, prescribed: PrescribedCoordinates) -> None:
    """Raise where coordinates are more than the degrees of freedom: their values do not fit one another."""
    mobility = mobility_when_closed(mechanism)
    if len(prescribed.names) > mobility:
        raise prescribed.miscounted(mechanism, mobility)


def beside(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return a closed configuration, shape (nq,), and others on its branch, each a step along free motions further."""
    closure, positions, nv = mechanism.closure, [q], mechanism.model.nv
    for step in range(BESIDE if closure.size else 0):
        free = closure.split_at(positions[-1]).free
        spread = 2.0 * np.remainder(GOLDEN * np.arange(1 + step * nv, 1 + (step + 1) * nv), 1.0) - 1.0
        way = free @ (free.T @ (closure.scale * spread))
        size = float(np.abs(way / closure.scale).max(initial=0.0))
        if not size:
            break
        try:
            near = pin.integrate(mechanism.model, positions[-1], STEP / size * way)
            positions.append(assembled(closure, OPEN, near, np.zeros(0), 0.0))
        except AssemblyError:  # the step was too long, as next to the end of a reach
            break
    return positions


def generic(mechanism: Mechanism, q: Sequence[Array]) -> Array:
    """Return the first of some closed configurations, shape (nq,), whose rank most of them have."""
    ranks: list[int] = mechanism.closure.split_at(np.array(q)).rank.tolist()
    counted = Counter(ranks)
    return q[ranks.index(max(counted, key=lambda rank: (counted[rank], rank)))]
