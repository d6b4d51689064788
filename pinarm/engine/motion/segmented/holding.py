"""Constraints that hold while stops are rested on, and bounds of pushes where several stops hold one motion.

Of several stops only what they do together is determined.
With the rows G of constraints and laws, and N of the stops, pushes s and multipliers lam that differ by a self-stress
z, ``G^T z_G + N^T z_N = 0``, hold the same motion. Stops push only, so that possible pushes are a polyhedron,

    s + Z x >= 0,                                                                                         (1)

whose corners have as many pushes 0 as there are self-stresses: of K stops on one motion each corner is one stop alone.
Rows of a motion have the mean of the corners; the corners are other motions (``CompletedStates.others``), as those of
frictions are that hold one motion together. Where the polyhedron has no end, as between two stops that clamp a body, a
push in that direction stands for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import ACTS, Decomposition
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.segmented.end_stops import Bound
from pinarm.engine.motion.systems import CompletedStates
from pinarm.engine.motion.systems.loop_system import LoopSystem
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.motion.segmented.end_stops import Held, Stop
    from pinarm.engine.motion.segmented.hybrid_system import HybridSystem
    from pinarm.engine.motion.systems import Initial
    from pinarm.mechanics.friction.contact import FrictionContact

SLIGHT = 1e-9
"""Part of the pushes by which one may be negative and still be 0, and of a matrix's largest value that is none."""

Ends = tuple[Array, Flags]
"""Ends of the polyhedron (1) in n rows: x, shape (n, s), and in which rows there is such an end, shape (n,)."""


class Holding(Record, frozen=True):
    """Equations of a mechanism while some stops are rested on and some one-sided constraints are closed."""

    hybrid: HybridSystem
    held: Held

    @cached_property
    def stops(self) -> list[Bound]:
        return [bound for k in sorted(self.held) if isinstance(bound := self.hybrid.bounds[k], Bound)]

    @cached_property
    def separations(self) -> list[Stop]:
        return [self.hybrid.bounds[k] for k in sorted(self.held & self.hybrid.separations)]

    @cached_property
    def _opened(self) -> list[str]:
        return [self.hybrid.bounds[k].name for k in sorted(self.hybrid.separations - self.held)]

    @cached_property
    def closure(self) -> Closure:
        whole = self.hybrid.closure
        kept = [part for part in whole.constraints if part.name not in self._opened]
        return Closure.of(whole.model, kept) if self._opened else whole

    @cached_property
    def holds(self) -> Flags:
        """Mask of the rows that hold of the mechanism's constraints, shape (m,)."""
        holds = np.ones(self.hybrid.closure.size, dtype=bool)
        for name in self._opened:
            holds[self.hybrid.closure.slices[name]] = False
        return holds

    @cached_property
    def rubs(self) -> Flags:
        """Mask of the active frictions, shape (k,): an open cam, whose follower flies, has none."""
        opened = {f"coupling.{name}" for name in self._opened}
        return np.array([contact.name not in opened for contact in self.hybrid.frictions], dtype=bool)

    @cached_property
    def rubbing(self) -> tuple[FrictionContact, ...]:
        return tuple(contact for contact, rubs in zip(self.hybrid.frictions, self.rubs.tolist(), strict=True) if rubs)

    @cached_property
    def prescribed(self) -> PrescribedCoordinates:
        """Coordinates that follow laws, then those of the stops; others than joints and sums of them first."""
        names, coordinates = [stop.name for stop in self.stops], [stop.coordinate for stop in self.stops]
        limits = [stop.limit for stop in self.stops]
        return self.hybrid.prescribed.holding(names, coordinates, limits).linear_last()[0]

    @cached_property
    def rows(self) -> Closure:
        return self.closure.with_guides(self.prescribed.names, self.prescribed.coordinates)

    @cached_property
    def system(self) -> LoopSystem:
        """The equations of motion without friction."""
        system = self.following(self.prescribed, self.hybrid.initial)
        if not self.stops and self.prescribed.linear_in(self.closure):  # rows are the same everywhere
            system.require_independent(system.near)
        return system

    def following(self, prescribed: PrescribedCoordinates, initial: Initial) -> LoopSystem:
        """Return the equations to integrate while prescribed coordinates follow their laws."""
        return LoopSystem.of(self.closure, self.hybrid.dynamics, prescribed, initial.q)

    @property
    def several(self) -> bool:
        return bool(self.stops) and len(self.held) > 1

    def shares_at(self, q: Array) -> bool:
        """Tell whether several stops hold one motion, at configurations of shape (n, nq)."""
        return self.several and self.stresses(q).size > 0

    @cached_property
    def _places(self) -> Indices:
        last = self.rows.size - len(self.stops)
        own = [self.rows.slices[stop.name].start for stop in self.separations]
        return np.array([*range(last, self.rows.size), *own], dtype=np.intp)

    @cached_property
    def _sides(self) -> Array:
        return np.array([stop.side for stop in (*self.stops, *self.separations)])

    @cached_property
    def _weights(self) -> Array:
        """Rows of the prescribed joints, and sums of them, shape (k, nv)."""
        linear = [along.weights for along in self.prescribed.coordinates if isinstance(along, LinearCoordinate)]
        return np.reshape(linear, (-1, self.closure.model.nv))

    def pushes(self, states: CompletedStates) -> Array:
        efforts = (states.tau @ np.linalg.pinv(self._weights))[:, len(self._weights) - len(self.stops) :]
        if self.separations:
            lam = states.lam[:, self._places[len(self.stops) :]]
            efforts = np.concatenate([efforts, lam], axis=1)
        return np.asarray(self._sides * efforts)

    def told(self, states: CompletedStates) -> CompletedStates:
        """Return states with what end stops push along joints, and 0 for constraints and frictions that are open."""
        changes, n = dict[str, Any](), len(states.q)
        if count := len(self.stops):
            efforts = self._sides[:count] * self.pushes(states)[:, :count]
            changes["pushed"] = efforts @ self._weights[len(self._weights) - count :]
        if self._opened:
            own, friction = int(self.holds.sum()), np.zeros((n, len(self.rubs)))
            lam = np.concatenate([np.zeros((n, len(self.holds))), states.lam[:, own:]], axis=1)
            lam[:, np.flatnonzero(self.holds)] = states.lam[:, :own]
            if self.rubbing:
                friction[:, self.rubs] = states.friction
            changes |= {"lam": lam, "friction": friction, "opened": np.ones(n, dtype=bool)}
        return replace(states, others=tuple(map(self.told, states.others)), **changes) if changes else states

    def least(self, states: CompletedStates) -> Array:
        """Return the pushes with the least sum of squares of those that hold the motion, shape (n, K).

        Of stops on one motion all have one sign, and vanish at one instant.
        """
        pushes = self.pushes(states)
        if not self.several or not (ways := self._ways(self.stresses(states.q))).size:
            return pushes
        along = np.linalg.pinv(ways, rcond=SLIGHT) @ pushes[..., None]
        return np.asarray(pushes - (ways @ along)[..., 0])

    def stresses(self, q: Array) -> Array:
        """Return self-stresses that act on stops, and that no other one of the closure is part of, shape (n, m, s)."""
        matrices, count = self.rows.at(q)[1], len(self.stops)
        every = Decomposition.of(matrices, self.rows.reach).stresses
        if not every.shape[2]:
            return every
        _, sizes, ways = np.linalg.svd(every[:, self._places[:count]], full_matrices=False)
        kept = int((sizes > ACTS).sum(axis=1).max())
        return np.asarray(every @ (ways[:, :kept] * (sizes[:, :kept, None] > ACTS)).swapaxes(1, 2))

    def shared(self, states: CompletedStates) -> CompletedStates:
        """Return states with the mean of what the stops may push, and the ends of it as other states."""
        if not (stresses := self.stresses(states.q)).size:
            return states
        first, *others = [end for some in (states, *states.others) for end in self._shares(some, stresses)]
        return replace(first, others=tuple(others))

    def _shares(self, states: CompletedStates, stresses: Array) -> Iterator[CompletedStates]:
        """Yield states with the mean of the corners, with each corner, and in each direction without an end."""
        pushes, ways = self.pushes(states), self._ways(stresses)
        corners, count, mean = list(_corners(pushes, ways)), np.zeros((len(pushes), 1)), np.zeros_like(ways[:, 0])
        for x, exist in corners:
            count += exist[:, None]
            mean += np.where(exist[:, None], x, 0.0)
        mean /= np.maximum(count, 1.0)
        size = np.maximum(np.abs(pushes).max(axis=1), 1.0)[:, None]
        yield self._with(states, stresses, mean)
        for x, exist in corners:
            yield self._with(states, stresses, np.where(exist[:, None], x, mean))
        for x, exist in _endless(ways):
            beyond = self._with(states, stresses, mean + np.where(exist[:, None], size * x, 0.0))
            yield replace(beyond, endless=exist if states.endless is None else exist | states.endless)

    def _ways(self, stresses: Array) -> Array:
        """Return Z: what self-stresses, shape (n, m, s), add to the pushes, shape (n, K, s)."""
        return np.asarray(self._sides[:, None] * stresses[:, self._places])

    def _with(self, states: CompletedStates, stresses: Array, x: Array) -> CompletedStates:
        added = np.matvec(stresses, x)
        lam, efforts = np.split(added, [self.rows.size - len(self._weights)], axis=1)
        return replace(states, tau=states.tau + efforts @ self._weights, lam=states.lam + lam, others=())


def _corners(pushes: Array, ways: Array) -> Iterator[Ends]:
    """Yield the corners of (1), where as many pushes are 0 as there are self-stresses."""
    count, s = ways.shape[1:]
    slack = SLIGHT * np.abs(pushes).max(axis=1, keepdims=True)
    for some in map(list, combinations(range(count), s)):
        values = np.linalg.svd(ways[:, some], compute_uv=False)
        regular = values[:, -1] > SLIGHT * values[:, 0]
        matrices = np.where(regular[:, None, None], ways[:, some], np.eye(s))
        x = np.linalg.solve(matrices, -pushes[:, some, None])[..., 0]
        yield np.asarray(x), regular & (pushes + np.matvec(ways, x) >= -slack).all(axis=1)


def _endless(ways: Array) -> Iterator[Ends]:
    """Yield the directions in which (1) has no end."""
    n, count, s = ways.shape
    for some in map(list, combinations(range(count), s - 1)):
        x = np.linalg.svd(ways[:, some])[2][:, -1] if some else np.ones((n, 1))
        along = np.matvec(ways, x)
        for sign in (1.0, -1.0):
            exist = (sign * along >= -SLIGHT).all(axis=1) & (np.abs(along) > SLIGHT).any(axis=1)
            if exist.any():
                yield sign * x, exist


def shares_remarks(shares: Iterable[Holding]) -> list[str]:
    """Return a remark for each set of stops that hold one motion: only their sum is determined."""
    together = dict.fromkeys(", ".join(stop.title for stop in some.stops) for some in shares)
    return [
        f"{names} hold one motion together: only what they do to it is determined. Rows have the mean of the ends of "
        "what each may push, and the forces between them follow from that; NAME.least and NAME.greatest are the ends"
        for names in together
    ]
